"""``quasirigid export --rerun``: a recording for the Rerun viewer, with its timeline and plots. Rerun is imported when asked for alone."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from quasirigid.errors import MissingPackageError
from quasirigid.recording.scene_columns import frames_of
from quasirigid.recording.scene_recording import SceneRecording
from quasirigid.recording.window import window_of
from quasirigid.rotation import rotate
from quasirigid.scene.model import SceneState
from quasirigid.scene.palette import FINGER_COLOURS, SLIP_COLOUR, STICK_COLOUR
from quasirigid.scene.pressure import SLIP, pad_colours, rgb, spread

RATE = 60.0
"""States per second of simulated time, at most: as often as the deformation is recorded."""
LARGE = 10_000
"""Surfaces of more points keep their shape at rest, which spares the file."""
METRES_PER_NEWTON = 0.012
Progress = Callable[[str, float], None]


def export_rerun(
    path: str | Path,
    out: str | Path,
    *,
    every: int = 1,
    start: float | None = None,
    end: float | None = None,
    progress: Progress | None = None,
) -> list[Path]:
    """Write the recording at ``path`` as ``out`` (``.rrd``); return what was written.

    At most ``RATE`` states a second are written, and of these steps each ``every``-th at most. Raises ``MissingPackageError`` without
    rerun-sdk.
    """
    try:
        import rerun as rr
    except ImportError:
        raise MissingPackageError.of("rerun-sdk", "to write for the Rerun viewer", "rerun") from None
    out = Path(out)
    with SceneRecording(path) as recording:
        every = max(every, round(1.0 / (RATE * recording.model.dt)))
        window = window_of(recording, every, start, end)
        out.parent.mkdir(parents=True, exist_ok=True)
        stream = rr.RecordingStream("quasirigid")
        stream.save(out)
        writer = _Writer(rr, stream, recording)
        writer.begin()
        for steps in window.blocks():
            for step in steps.tolist():
                writer.add(recording.state(step))
                if progress is not None:
                    progress(out.name, (step - window.first + 1) / (window.last - window.first + 1))
        stream.flush()
        stream.disconnect()
    return [out]


class _Writer:
    def __init__(self, rr: Any, stream: Any, recording: SceneRecording) -> None:
        self._rr, self._stream, self._model = rr, stream, recording.model
        self._paths = [
            f"scene/{_safe(frame)}/{_safe(body.name)}" for frame, body in zip(frames_of(self._model), self._model.bodies, strict=True)
        ]
        self._peak = max(recording.peak_pressure(), 1.0)
        self._tips = self._model.fingertips()
        self._loaded: set[int] = set()

    def begin(self) -> None:
        """What stays the same."""
        rr = self._rr
        self._stream.log("scene", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for path, body in zip(self._paths, self._model.bodies, strict=True):
            if len(body.faces):
                colour = [*(round(255 * c) for c in body.colour), 90 if body.kind == "object" and self._tips else 255]
                faces, points, normals = body.faces, body.points.astype("f4"), body.normals.astype("f4")
                self._stream.log(
                    path,
                    rr.Mesh3D(vertex_positions=points, triangle_indices=faces, vertex_normals=normals, albedo_factor=colour),
                    static=not body.deforms or len(body.points) > LARGE,
                )
        for finger, name in enumerate(self._model.fingers):
            style = rr.SeriesLines(colors=[_colour(FINGER_COLOURS[finger % 6])], names=[f"{name} (N)"])
            self._stream.log(f"normal_force/{_safe(name)}", style, static=True)

    def add(self, state: SceneState) -> None:
        """One state."""
        rr, log = self._rr, self._stream.log
        self._stream.set_time("time", duration=state.time)
        self._stream.set_time("step", sequence=state.step)
        for i, path in enumerate(self._paths):
            frame = path.rpartition("/")[0]
            w, x, y, z = state.quaternions[i].tolist()
            log(frame, rr.Transform3D(translation=state.positions[i], quaternion=rr.Quaternion(xyzw=[x, y, z, w])))
            self._surface(state, i, path)
        c = state.contacts
        loaded = c.reactions[:, 0] > 0.0
        colours = np.where((c.status[loaded] == SLIP)[:, None], rgb(SLIP_COLOUR), rgb(STICK_COLOUR)).astype(np.uint8)
        longest = max(float(np.linalg.norm(c.forces, axis=1).max(initial=0.0)), 1e-9)
        log(
            "scene/contacts",
            rr.Arrows3D(origins=c.points[loaded], vectors=self._model.pushes(c)[loaded] * (0.005 / longest), colors=colours),
        )
        for finger, (tip, name) in enumerate(zip(self._tips, self._model.fingers, strict=True)):
            weight = c.reactions[:, 0] * c.on(tip)
            at = [weight @ c.points / weight.sum()] if weight.sum() > 0.0 else np.zeros((0, 3))
            force = METRES_PER_NEWTON * state.finger_forces[finger : finger + 1][: len(at)]
            log(f"scene/forces/{_safe(name)}", rr.Arrows3D(origins=at, vectors=force, colors=[_colour(FINGER_COLOURS[finger % 6])]))
            log(f"normal_force/{_safe(name)}", rr.Scalars(state.normal_forces[finger]))
        log("contacts", rr.Scalars(float(loaded.sum())))
        log("step_time_ms", rr.Scalars(1e3 * state.step_time))

    def _surface(self, state: SceneState, index: int, path: str) -> None:
        """The deformed surface, and on fingertips the pressure; once more when it has gone back to rest."""
        body, moved = self._model.bodies[index], state.moved.get(index)
        if not body.deforms or len(body.points) > LARGE or (moved is None and index not in self._loaded):
            return
        points = body.points.copy()
        if moved is None:
            self._loaded.discard(index)
        else:
            self._loaded.add(index)
            points[moved.indices] = moved.points
        new: dict[str, npt.NDArray[Any]] = {"vertex_positions": points.astype("f4")}
        if body.kind == "fingertip":
            c = state.contacts
            mine = c.on(index) & (c.pressures > 0.0)
            placed = rotate(state.quaternions[index], points) + state.positions[index]
            colour = pad_colours(spread(placed, c.points[mine], c.pressures[mine], c.areas[mine]), self._peak)
            # The albedo multiplies: what is divided out here comes back there.
            share = np.clip(colour[:, :3] / np.maximum(body.colour, 1e-3), 0.0, 1.0)
            new["vertex_colors"] = (255 * share + 0.5).astype(np.uint8)
        self._stream.log(path, self._rr.Mesh3D.from_fields(**new))


def _safe(name: str) -> str:
    """A name as one part of an entity's path."""
    return re.sub(r"[^\w.-]+", "_", name)


def _colour(text: str) -> list[int]:
    values: list[int] = rgb(text).tolist()
    return values
