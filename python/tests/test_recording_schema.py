"""A recording has the columns that its readers need, or it is refused by the name of the column: one schema, checked once,
for all readers.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from recorded import pinch, record_pinch

import quasirigid as qr
from quasirigid.cli.app import main
from quasirigid.errors import InvalidValueError, RecordingError
from quasirigid.grasp.columns import check_grasp
from quasirigid.grasp.columns import columns as grasp_columns
from quasirigid.recording.export import export_tables
from quasirigid.recording.file import Stored
from quasirigid.recording.reader import Column, Recording
from quasirigid.recording.scene_columns import check_scene, scene_columns
from quasirigid.recording.scene_model import read_model
from quasirigid.recording.scene_recorder import SceneRecorder
from quasirigid.recording.scene_recording import SceneRecording
from quasirigid.scene.world import WorldScene

STEPS = 160


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run") / "run.h5"
    record_pinch(path, STEPS)
    return path


def attributes(item: Stored, **changed: Any) -> Stored:
    return replace(item, attributes={**item.attributes, **changed})


def shorter(item: Stored) -> Stored | None:
    """One value less in a row; any number of joints is right."""
    return replace(item, shape=(*item.shape[:-1], item.shape[-1] - 1)) if len(item.shape) > 1 and "joint" not in item.name else None


WRONG: dict[str, Callable[[Stored], Stored | None]] = {
    "one dimension more": lambda item: replace(item, shape=(*item.shape, 1)),
    "one value less in a row": shorter,
    "another type": lambda item: replace(item, dtype=np.dtype("i2" if item.dtype.kind == "f" else "f2")),
    "another order of bytes": lambda item: replace(item, dtype=item.dtype.newbyteorder(">")) if item.dtype.byteorder != "|" else None,
    "another unit": lambda item: attributes(item, unit="furlong"),
    "another frame": lambda item: attributes(item, frame="moon"),
    "other rows": lambda item: attributes(item, rows="constant: the same in every step"),
}


@pytest.mark.parametrize("wrong", ["missing", *WRONG])
def test_a_column_that_is_not_as_it_should_be_is_refused_by_name(run: Path, wrong: str) -> None:
    looked_at = []
    with Recording(run) as recording:
        model = read_model(recording)
        check_scene(recording, model)
        datasets = recording._file.datasets
        for name in [column.name for column in scene_columns(model, (0, 0))]:
            stored = datasets.pop(name)
            changed = None if wrong == "missing" else WRONG[wrong](stored)
            if changed is not None:
                datasets[name] = changed
            if changed is not None or wrong == "missing":
                looked_at.append(name)
                with pytest.raises(RecordingError, match=name):
                    recording._check_columns()
                    check_scene(recording, model)
            datasets[name] = stored
    assert len(looked_at) > 8, looked_at


def put(file: h5py.File, name: str, values: Any, **changed: Any) -> None:
    """Other values in a column, with its attributes."""
    kept = dict(file[name].attrs)
    del file[name]
    file.create_dataset(name, data=values).attrs.update({**kept, **changed})


def change(name: str, where: Any, value: float) -> Callable[[h5py.File], None]:
    def into(file: h5py.File) -> None:
        values = file[name][...]
        values[where] = value
        put(file, name, values)

    return into


CONTENTS: dict[str, tuple[str, Callable[[h5py.File], None]]] = {
    "a status that there is not": ("contacts/status", change("contacts/status", -1, 9)),
    "a body that there is not": ("contacts/body_a", change("contacts/body_a", -1, 99)),
    "a moved body that there is not": ("moved/body", change("moved/body", -1, 99)),
    "a moved point that there is not": ("moved/index", change("moved/index", -1, 2**31)),
    "a deformation of the future": ("moved/step", change("moved/step", -1, STEPS + 5)),
    "rows that fall": ("contacts/end", change("contacts/end", 3, 10**6)),
    "rows that are missing": ("contacts/gap", lambda file: put(file, "contacts/gap", file["contacts/gap"][:-1])),
    "steps that are missing": ("report/sweeps", lambda file: put(file, "report/sweeps", file["report/sweeps"][:-1])),
    "a time that is none": ("time", change("time", 5, np.nan)),
    "times out of order": ("time", change("time", 5, 0.0)),
    "a face without its point": ("model/0/faces", change("model/0/faces", (0, 0), 10**6)),
    "a point that is none": ("model/0/points", change("model/0/points", (0, 0), np.inf)),
    "other labels": ("frames/pose", lambda file: file["frames/pose"].attrs.update({"labels": ["a", "b"]})),
    "a scene that is no JSON": ("scene", lambda file: file.attrs.update({"scene": "{"})),
    "a scene without bodies": (
        "bodies",
        lambda file: file.attrs.update({"scene": '{"fingers": [], "materials": [], "dt": 1, "floor": 0}'}),
    ),
    "a version that is none": ("version", lambda file: file.attrs.update({"version": "two"})),
    "a version without a letter": ("version: .* got nothing", lambda file: file.attrs.update({"version": np.bytes_(b"")})),
    "two formats": ("some other HDF5 file", lambda file: file.attrs.update({"format": [1.5, 2.5]})),
}


@pytest.mark.parametrize("what", CONTENTS)
def test_content_that_no_recording_has_is_refused_by_name(run: Path, tmp_path: Path, what: str) -> None:
    name, damage = CONTENTS[what]
    path = tmp_path / "run.h5"
    path.write_bytes(run.read_bytes())
    with h5py.File(path, "r+") as file:
        damage(file)
    with pytest.raises(RecordingError, match=name), SceneRecording(path) as recording:
        for step in range(0, len(recording), 7):
            recording.state(step)
        recording.state(-1)


@pytest.mark.parametrize("command", [["export", "--csv"], ["render", "--out"], ["replay", "--no-browser", "--seconds", "0.1", "--port"]])
def test_every_command_refuses_a_recording_without_a_column(run: Path, tmp_path: Path, command: list[str], capfd: Any) -> None:
    path = tmp_path / "run.h5"
    path.write_bytes(run.read_bytes())
    with h5py.File(path, "r+") as file:
        put(file, "contacts/pressure", file["contacts/pressure"][:][:, None])
    place = "18911" if command[-1] == "--port" else str(tmp_path / "out.png")
    assert main([command[0], str(path), *command[1:], place]) == 2
    complaint = capfd.readouterr().err
    assert "column contacts/pressure: expected any number of rows per step, float32 of shape (), unit Pa" in complaint, complaint
    assert "Traceback" not in complaint


def test_what_is_no_grasp_is_refused_by_name(run: Path) -> None:
    with (
        Recording(run) as recording,
        pytest.raises(RecordingError, match=r"column object/pose: expected one row per step.*got no such column"),
    ):
        check_grasp(recording)


def test_columns_of_ones_own_cannot_take_the_place_of_those_that_readers_need(tmp_path: Path) -> None:
    model = WorldScene(pinch()[0]).model
    with pytest.raises(InvalidValueError, match="column contacts/gap"):
        SceneRecorder(tmp_path / "r.h5", model, columns=[Column("contacts/gap", (3,))])
    phase = next(column for column in grasp_columns(("thumb",), 4) if column.name == "phase")
    SceneRecorder(tmp_path / "r.h5", model, columns=[phase, Column("mine", (3,))]).discard()


def test_fingers_without_joints_have_none_in_the_tables(tmp_path: Path) -> None:
    """A body that was named as a fingertip beside a hand: exported without a mistake, its joints being no numbers."""
    world, _, grip = pinch()
    rubber = qr.Material.preset("rubber")
    pad = world.add_body(qr.Surface.sphere(0.01, points=300), rubber, motion="fixed", position=(1.0, 0.0, 0.0), name="pad")
    with qr.record(world, tmp_path / "r.h5", fingertips=[pad]) as recording:
        for _ in range(3):
            grip.update()
            recording.append(world.step())
    export_tables(tmp_path / "r.h5", tmp_path, "csv")
    lines = (tmp_path / "fingers.csv").read_text().splitlines()
    assert len(lines) == 1 + 3 * 4
    assert lines[1].split(",")[2] == "pad"
    assert lines[1].endswith("nan,nan,nan,nan")
    assert "nan" not in lines[2]
