"""What a case is: a seed file, spoilt, and read as a user would read it.

All of it follows from the kind of file, a seed and a number, so that a finding can be had again::

    python python/tests/fuzz/run.py objects --seed 1 --case 1234 --keep /tmp/found
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from mutate_bytes import Rng, spoil
from mutate_files import spoil_gzip, spoil_hdf5, spoil_npy, spoil_npz

import quasirigid as qr
from quasirigid import mocap
from quasirigid.errors import (
    CaptureFileError,
    DegenerateSurfaceError,
    InvalidShapeError,
    InvalidValueError,
    ObjectFileError,
    RecordingError,
    SnapshotError,
)

SPOILERS: dict[str, Callable[[Rng, bytes], bytes]] = {".npy": spoil_npy, ".npz": spoil_npz, ".gz": spoil_gzip}
MOST_SWEEPS = 50


def run_case(context: dict[str, Any], number: int) -> str:
    """Make and read a case of ``context``: ``kind``, ``seed``, ``folder`` with the seed files. How it ended, in a word."""
    with tempfile.TemporaryDirectory() as folder:
        path = make_case(context, number, Path(folder))
        return read_case(context["kind"], path, np.random.default_rng([context["seed"], number, 1]))


def make_case(context: dict[str, Any], number: int, folder: Path) -> Path:
    """Write the spoilt file of a case to a folder."""
    rng = np.random.default_rng([context["seed"], number])
    seeds = sorted(Path(context["folder"]).iterdir())
    source = seeds[int(rng.integers(len(seeds)))]
    path = folder / source.name
    if source.suffix == ".h5":
        path.write_bytes(source.read_bytes())
        spoil_hdf5(rng, path)
    else:
        path.write_bytes(SPOILERS.get(source.suffix, spoil)(rng, source.read_bytes()))
    return path


def read_case(kind: str, path: Path, rng: Rng) -> str:
    """``"value"``, or the name of a documented error. Everything else is raised."""
    readers, documented = READERS[kind]
    word = "value"
    for reader in readers:  # a refusal by the first must not keep the second from its turn
        try:
            reader(path, rng)
        except documented as error:
            if not all((error.what, error.expected, error.got, error.hint)):
                raise RuntimeError("an error that does not say all") from error
            word = type(error).__name__
    return word


def _read_object(path: Path, rng: Rng) -> None:
    # Half of them by size: a spoilt coordinate else ends most cases with the refusal of a thing of a kilometre.
    given = qr.load_object(path, points=60, size=0.08 if rng.random() < 0.5 else None)
    for name in ("points", "centre_of_mass", "inertia", "extents"):
        assert np.isfinite(getattr(given, name)).all(), f"{name} is not finite"
    assert np.isfinite(given.mass), f"mass {given.mass}"
    assert given.mass > 0.0, f"mass {given.mass}"
    assert given.normals is None or np.allclose(np.linalg.norm(given.normals, axis=1), 1.0), "normals without unit length"
    qr.Surface.from_points(given.points, given.normals, given.areas, control_points=20)


def _read_recording(path: Path, rng: Rng) -> None:
    """In one way of three: every opening looks the file through in a process of its own, which takes time."""
    (_read_columns, _read_columns, _read_scene, _read_scene, _render)[int(rng.integers(5))](path, rng)


def _read_columns(path: Path, rng: Rng) -> None:
    with qr.Recording(path) as recording:
        assert recording.steps >= 0
        bool(recording.complete), recording.attributes
        for name in recording.names:
            recording[name], recording.labels(name)
            if not name.startswith("model/"):  # shapes of the bodies have no unit of their own
                recording.unit(name)


def _read_scene(path: Path, rng: Rng) -> None:
    with qr.SceneRecording(path) as scene:
        for step in (0, len(scene) // 2, -1):
            scene.state(step)
        scene.phases()
        scene.peak_pressure()


def _export(path: Path, rng: Rng) -> None:
    from quasirigid.recording.export import export_tables

    export_tables(path, path.parent / "tables", "csv")


def _render(path: Path, rng: Rng) -> None:
    from quasirigid.render.pictures import RenderOptions, render

    render(path, path.parent / "picture.png", RenderOptions(size=(320, 180), single=True))


def _read_take(path: Path, rng: Rng) -> None:
    from quasirigid.mocap.contents import contents

    take = mocap.Take.read(path)
    assert np.isfinite([*take.arrivals, take.duration]).all()
    assert all(isinstance(note, str) for note in take.notes)
    if len(take):
        contents(take)
    tracker = mocap.HandTracker("right")
    for frame in take.frames(mocap.HandDecoder("right")):
        tracker.push(frame)
        tracker.sample(frame.arrival)
    take.write(path.parent / "again.take")
    assert len(mocap.Take.read(path.parent / "again.take")) == len(take)


def _append_to_take(path: Path, rng: Rng) -> None:
    if path.suffix != ".gz":  # those are refused
        with mocap.TakeWriter(path, append=True) as writer:
            writer.note("more")


def _read_calibration(path: Path, rng: Rng) -> None:
    found = mocap.Calibration.read(path)
    assert np.isfinite([*found.position, *found.quaternion]).all()


def _solve_problem(path: Path, rng: Rng) -> None:
    problem = qr.ContactProblem.load(path)
    solution = problem.solve(max_sweeps=MOST_SWEEPS)
    assert np.isfinite(solution.reactions).all(), "reactions are not finite"
    if problem.reactions is not None:
        problem.solve(max_sweeps=MOST_SWEEPS, warm_start=problem.reactions)


def _read_snapshot(path: Path, rng: Rng) -> None:
    world = qr.World.from_snapshot(qr.Snapshot.from_bytes(path.read_bytes()))
    world.step(3)
    world.contacts(), world.state_hash(), [hand.joint_positions for hand in world.hands], world.report
    qr.Snapshot.from_bytes(world.snapshot().to_bytes())


Reader = Callable[[Path, Rng], None]
READERS: dict[str, tuple[tuple[Reader, ...], tuple[type[qr.QuasirigidError], ...]]] = {
    "objects": ((_read_object,), (ObjectFileError, InvalidValueError, InvalidShapeError, DegenerateSurfaceError)),
    "recordings": (
        (_export, _read_recording),
        (ObjectFileError, RecordingError, InvalidValueError),
    ),
    "takes": ((_read_take, _append_to_take), (CaptureFileError, InvalidValueError)),
    "contact_problems": ((_solve_problem,), (ObjectFileError, InvalidValueError, InvalidShapeError)),
    "snapshots": ((_read_snapshot,), (SnapshotError,)),
    "calibrations": ((_read_calibration,), (CaptureFileError, InvalidValueError, InvalidShapeError)),
}
