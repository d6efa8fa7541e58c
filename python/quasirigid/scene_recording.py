"""Recordings of a scene: all that a replay in 3D needs, for any world.

The shapes of the bodies are written once, their poses, the contacts and the forces in every step. The elastic deformation of the
surfaces, the bulk of it all, is written ``deformation_rate`` times a second: the displaced points alone, by how much they are displaced.

Written is a ``SceneModel`` and one ``SceneState`` per step, and the same come back: what draws a live world draws a recording too.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt

from quasirigid._quasirigid import STAGES, StepReport, __version__
from quasirigid.errors import InvalidShapeError, InvalidValueError, ObjectFileError
from quasirigid.recorder import Recorder
from quasirigid.recording import Column, Recording
from quasirigid.view.scene import BodyView, ContactsState, Moved, SceneModel, SceneState

FloatArray = npt.NDArray[np.float64]
DEFORMATION_RATE = 60.0
"""Times a second of simulated time that the deformation is written."""
POINT_RESOLUTION, GAP_RESOLUTION, MOVED_RESOLUTION = 2.0**-24, 2.0**-33, 2.0**-30
"""Where contacts are is recorded to 30 nm, their gap to 0.06 nm, deformation to 0.5 nm: half of these, m. The digits below are noise, which
cannot be compressed and would be a third of a recording.
"""
PHASE_BYTES = 64
"""Longest name of a phase, in UTF-8."""
ROWS_AT_ONCE = 2**18
"""Rows of a column that are read at a time where all are looked at: a few megabytes."""
UNCHANGED = 1e-9
"""Deformation that differs by less than this from what was written last is not written again, m."""


def scene_columns(model: SceneModel, joints: tuple[int, int]) -> list[Column]:
    """The columns that every recorded scene has; ``joints`` is the shape of ``SceneState.joint_positions``."""
    B, F = len(model.bodies), len(model.fingers)
    bodies, frames = tuple(body.name for body in model.bodies), tuple(dict.fromkeys(frames_of(model)))
    counted = "counted as in bodies/quarantined, -1 for a body that is not drawn"
    what = "x y z and quaternion w x y z of the frames; the bodies that a frame carries are in the attribute scene of the file"
    return [
        Column("frames/pose", (len(frames), 7), unit="m, 1", frame="world", what=what, labels=frames),
        Column("bodies/quarantined", (B,), "u1", what="1 from when it became non-finite and was set aside", labels=bodies),
        Column("contacts/point", (3,), "f4", "m", "world", ragged=True, resolution=POINT_RESOLUTION),
        Column("contacts/normal", (3,), "f4", "1", "world", "from body b to body a", ragged=True),
        Column("contacts/force", (3,), "f4", "N", "world", "on body a; body b gets the opposite", ragged=True),
        Column("contacts/reaction", (3,), "f4", "N", "contact", "normal, tangent1, tangent2", ragged=True),
        Column("contacts/gap", (), "f4", "m", "contact", "> 0 is apart", ragged=True, resolution=GAP_RESOLUTION),
        Column("contacts/pressure", (), "f4", "Pa", ragged=True),
        Column("contacts/area", (), "f4", "m^2", ragged=True),
        Column("contacts/status", (), "u1", what="0 open, 1 stick, 2 slip", ragged=True, labels=("open", "stick", "slip")),
        Column("contacts/body_a", (), "i2", what=f"whose control point it is; {counted}", ragged=True),
        Column("contacts/body_b", (), "i2", what=f"the other body; {counted}", ragged=True),
        Column("moved/body", (), "u2", what="body whose surface point is displaced, counted as in bodies/quarantined", ragged=True),
        Column("moved/index", (), "u4", what="row of model/<body>/points", ragged=True),
        Column("moved/displacement", (3,), "f4", "m", "body", "from the point at rest", ragged=True, resolution=MOVED_RESOLUTION),
        Column("moved/step", (), "i8", what="the step whose rows of moved/ hold here: the last one written, -1 before the first"),
        Column("fingers/force", (F, 3), "f4", "N", "world", "of a fingertip on whatever it touches", labels=model.fingers),
        Column("fingers/normal_force", (F,), "f4", "N", "contact", "sum of the normal reactions of a fingertip", labels=model.fingers),
        Column("hand/joint_positions", joints, unit="rad", frame="joint", labels=model.fingers),
        Column("report/contacts", (), "i4", what="contacts in the problem, open ones included"),
        Column("report/sweeps", (), "i4", what="Gauss-Seidel sweeps"),
        Column("report/residual", what="natural-map residual of the reactions"),
        Column("report/converged", (), "u1"),
        Column("report/coarse", (), "u1", what="1 if the traversal budget ran out"),
        Column("report/quarantined", (), "i4", what="bodies set aside in this step"),
        Column("report/step_time", unit="s", what="computing time of the step"),
        Column("report/stage_times", (len(STAGES),), unit="s", what="computing time of the stages", labels=STAGES),
        Column("phase", (), f"S{PHASE_BYTES}", what="what is going on, UTF-8"),
        Column("time", unit="s", what="simulated time at the end of the step"),
    ]


def frames_of(model: SceneModel) -> list[str]:
    """The frame of every body: bodies that move as one share it, and their pose is written once."""
    return [body.frame or body.name for body in model.bodies]


def model_constants(model: SceneModel) -> tuple[dict[str, npt.NDArray[Any]], str]:
    """What is written of a model: its arrays by name, and the rest as JSON."""
    arrays: dict[str, npt.NDArray[Any]] = {}
    bodies = []
    for i, body in enumerate(model.bodies):
        arrays |= {
            f"model/{i}/points": body.points,
            f"model/{i}/normals": body.normals.astype("f4"),
            f"model/{i}/faces": body.faces.astype("u4"),
        }
        bodies.append({"name": body.name, "kind": body.kind, "colour": list(body.colour), "finger": body.finger, "frame": body.frame})
    return arrays, json.dumps({"bodies": bodies, "fingers": list(model.fingers), "dt": model.dt, "floor": model.floor})


class SceneRecorder:
    """Writes a recording of a scene. Use it in a ``with`` block: then the file is closed whatever happens inside."""

    def __init__(
        self,
        path: str | Path,
        model: SceneModel,
        joints: tuple[int, int] = (0, 0),
        *,
        columns: Sequence[Column] = (),
        attributes: Mapping[str, Any] | None = None,
        deformation_rate: float = DEFORMATION_RATE,
    ) -> None:
        """Create the file at ``path`` (an old one is replaced) for the bodies of ``model`` and joints of the shape (fingers, joints).

        ``columns`` are further columns of your own, or replace those of the same name. ``deformation_rate`` in 1/s of simulated
        time; infinity writes the deformation in every step.
        """
        if not deformation_rate > 0.0:
            raise InvalidValueError("deformation_rate", "times a second, above 0", deformation_rate, f"{DEFORMATION_RATE:g} is the default")
        own = {column.name for column in columns}
        common = [column for column in scene_columns(model, joints) if column.name not in own]
        self.model = model
        # To the nearest step: the deformation is never older than this and half a step.
        self._interval = 1.0 / deformation_rate - 0.5 * model.dt
        self._looked_at = -math.inf
        self._own = {column.name: column for column in columns}
        self._moved_at = -1
        self._moved: Mapping[int, Moved] = {}
        self._aside: frozenset[int] = frozenset()
        frames = frames_of(model)
        self._carriers = [frames.index(frame) for frame in dict.fromkeys(frames)]
        constants, described = model_constants(model)
        told = {"quasirigid_version": __version__, "dt": model.dt, "scene": described, "deformation_rate": deformation_rate}
        self._recorder = Recorder(path, [*columns, *common], {**told, **(attributes or {})}, constants=constants)

    @property
    def path(self) -> Path:
        """The file."""
        return self._recorder.path

    @property
    def steps(self) -> int:
        """Steps recorded so far."""
        return self._recorder.steps

    @property
    def waited(self) -> float:
        """How long ``append`` had to wait because the disk could not follow, s."""
        return self._recorder.waited

    def wants_deformation(self, time: float) -> bool:
        """Whether the deformation of a state at ``time`` s is written: if not, its ``SceneState.moved`` may be left empty."""
        return abs(time - self._looked_at) >= self._interval

    def append(self, state: SceneState, row: Mapping[str, Any] | None = None, report: StepReport | None = None) -> None:
        """Add one step. ``row`` holds the values of the further columns, ``report`` what only the engine's report knows.

        Raises ``InvalidShapeError`` for other bodies than those of the model, ``InvalidValueError`` for a phase longer than ``PHASE_BYTES``.
        """
        if len(state.positions) != len(self.model.bodies):
            expected, got = f"{len(self.model.bodies)} bodies, those of the model", f"{len(state.positions)}"
            raise InvalidShapeError("state", expected, got, "a recording has the same bodies from start to end: start a new one")
        wanted = self.wants_deformation(state.time)
        changed = wanted and self._has_changed(state.moved)
        moved: Mapping[int, Moved] = state.moved if changed else {}
        quarantined = np.zeros(len(self.model.bodies), "u1")
        quarantined[[body for body in state.quarantined if body >= 0]] = 1  # -1: not drawn
        went = len(set(state.quarantined) - self._aside)
        c = state.contacts
        values: dict[str, Any] = {
            "time": state.time,
            "phase": state.phase.encode(),
            "frames/pose": np.concatenate([state.positions, state.quaternions], axis=1)[self._carriers],
            "bodies/quarantined": quarantined,
            "contacts/point": c.points,
            "contacts/normal": c.normals,
            "contacts/force": c.forces,
            "contacts/reaction": c.reactions,
            "contacts/gap": c.gaps,
            "contacts/pressure": c.pressures,
            "contacts/area": c.areas,
            "contacts/status": c.status,
            "contacts/body_a": c.body_a,
            "contacts/body_b": c.body_b,
            **self._moved_rows(moved),
            "moved/step": self._recorder.steps if changed else self._moved_at,
            "fingers/force": state.finger_forces,
            "fingers/normal_force": state.normal_forces,
            "hand/joint_positions": state.joint_positions,
            "report/contacts": len(c),
            "report/sweeps": report.sweeps if report is not None else 0,
            "report/residual": state.residual,
            "report/converged": state.converged,
            "report/coarse": report is not None and report.coarse,
            "report/quarantined": max(went, 0 if report is None else len(report.quarantined)),
            "report/step_time": state.step_time,
            "report/stage_times": [state.stage_times.get(name, 0.0) for name in STAGES],
        }
        self._recorder.append({**values, **(row or {})})
        self._aside = frozenset(state.quarantined)
        if wanted:
            self._looked_at = state.time
        if changed:
            self._moved, self._moved_at = moved, self._recorder.steps - 1

    def _has_changed(self, moved: Mapping[int, Moved]) -> bool:
        """True if the deformation is another than what was written last: an object at rest costs nothing."""
        last = self._moved
        return moved.keys() != last.keys() or any(
            len(m.indices) != len(last[body].indices)
            or (m.indices != last[body].indices).any()
            or np.abs(m.points - last[body].points).max(initial=0.0) > UNCHANGED
            for body, m in moved.items()
        )

    def _moved_rows(self, moved: Mapping[int, Moved]) -> dict[str, npt.NDArray[Any]]:
        parts = sorted(moved.items())
        bodies = [np.full(len(m.indices), body) for body, m in parts]
        shifts = [m.points - self.model.bodies[body].points[m.indices] for body, m in parts]
        return {
            "moved/body": np.concatenate([np.zeros(0, np.int64), *bodies]),
            "moved/index": np.concatenate([np.zeros(0, np.int64), *(m.indices for _, m in parts)]),
            "moved/displacement": np.concatenate([np.zeros((0, 3)), *shifts]),
        }

    def still(self, values: Mapping[str, Any]) -> None:
        """Write stills, by name; they are on disk at once."""
        self._recorder.still(values)

    def flush(self) -> None:
        """Put everything appended so far on disk, and wait for it."""
        self._recorder.flush()

    def discard(self) -> None:
        """End a recording that nobody wants; see ``Recorder.discard``."""
        self._recorder.discard()

    def close(self, **attributes: Any) -> None:
        """Write what is buffered and mark the recording as complete."""
        self._recorder.close(**attributes)

    def __enter__(self) -> SceneRecorder:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._recorder.__exit__(kind, error, trace)


class SceneRecording:
    """Reads a recording as a scene: ``model``, ``times``, and ``state(step)`` as it was drawn live."""

    def __init__(self, path: str | Path) -> None:
        """Open the recording at ``path``.

        Raises ``ObjectFileError`` if there is none, if it is something else, or if it is too old to hold a scene.
        """
        self.columns = Recording(path)
        try:
            if "scene" not in self.columns.attributes:
                got = f"a recording of version {self.columns.version}, without the shapes of its bodies"
                hint = "record the run again; its columns are still readable with quasirigid.Recording"
                raise ObjectFileError(str(path), "a recording that holds a scene", got, hint)
            if self.columns.steps == 0:
                raise ObjectFileError(str(path), "a recording with at least one step", "none", "let the run go on for longer")
            self.model = self._read_model()
        except BaseException:
            self.columns.close()
            raise
        self.times: FloatArray = self.columns["time"]
        frames = self.columns.labels("frames/pose")
        self._frames = [frames.index(frame) for frame in frames_of(self.model)]

    def _read_model(self) -> SceneModel:
        told = json.loads(self.columns.attributes["scene"])
        bodies = []
        for i, body in enumerate(told["bodies"]):
            points, normals, faces = (self.columns[f"model/{i}/{name}"] for name in ("points", "normals", "faces"))
            body["colour"] = tuple(body["colour"])
            bodies.append(BodyView(points=points, normals=normals.astype(float), faces=faces.astype(np.int64), **body))
        return SceneModel(bodies=tuple(bodies), fingers=tuple(told["fingers"]), dt=told["dt"], floor=told["floor"])

    def __len__(self) -> int:
        """Number of steps."""
        return self.columns.steps

    def step_at(self, time: float) -> int:
        """The last step that had ended at ``time`` s; 0 if none had."""
        return max(0, int(np.searchsorted(self.times, time + 1e-9 * max(1.0, abs(time)), side="right")) - 1)

    def phase(self, step: int) -> str:
        """What was going on in a step."""
        code = self.columns.row("phase", step)
        labels = self.columns.labels("phase")
        return labels[int(code)] if labels else bytes(code).decode(errors="replace")

    def phases(self, steps: slice = slice(None)) -> list[tuple[float, float, str]]:
        """The phases among some steps: start and end in s, and name; without those that have no name."""
        codes, times = self.columns["phase"][steps], self.times[steps]
        if not len(codes):
            return []
        changes = [0, *(np.flatnonzero(codes[1:] != codes[:-1]) + 1).tolist(), len(codes)]
        first = range(len(self))[steps].start
        spans = []
        for start, stop in itertools.pairwise(changes):
            spans.append((float(times[start]) - self.model.dt, float(times[stop - 1]), self.phase(first + start)))
        return [span for span in spans if span[2]]

    def peak_pressure(self, first: int = 0, last: int = -1) -> float:
        """Largest pressure on a fingertip from the ``first`` to the ``last`` step, Pa; on anything if there are no fingertips."""
        first, last = range(len(self))[first], range(len(self))[last]
        ends = self.columns["contacts/end"]
        begin, end, tips = int(ends[first - 1]) if first else 0, int(ends[last]), self.model.fingertips()
        peak = 0.0
        for start in range(begin, end, ROWS_AT_ONCE):  # all at once may not fit into memory
            stop = min(start + ROWS_AT_ONCE, end)
            pressure, a, b = (self.columns.slice(f"contacts/{name}", start, stop) for name in ("pressure", "body_a", "body_b"))
            mine = np.isin(a, tips) | np.isin(b, tips) if tips else slice(None)
            peak = float(pressure[mine].max(initial=peak))
        return peak

    def contacts(self, step: int) -> ContactsState:
        """The contacts of a step."""
        rows = self.columns.rows("contacts", step)
        return ContactsState(
            points=rows["point"].astype(float),
            normals=rows["normal"].astype(float),
            forces=rows["force"].astype(float),
            reactions=rows["reaction"].astype(float),
            gaps=rows["gap"].astype(float),
            pressures=rows["pressure"].astype(float),
            areas=rows["area"].astype(float),
            status=rows["status"],
            body_a=rows["body_a"].astype(np.int64),
            body_b=rows["body_b"].astype(np.int64),
        )

    def moved(self, step: int) -> dict[int, Moved]:
        """The displaced surface points as last written up to a step."""
        source = int(self.columns.row("moved/step", step))
        if source < 0:
            return {}
        rows = self.columns.rows("moved", source)
        found: dict[int, Moved] = {}
        for body in np.unique(rows["body"]).tolist():
            mine = rows["body"] == body
            indices = rows["index"][mine].astype(np.int64)
            points = self.model.bodies[body].points[indices] + rows["displacement"][mine]
            found[body] = Moved(indices, points)
        return found

    def state(self, step: int) -> SceneState:
        """Everything at the end of a ``step``, counted from 0; negative ones from the end."""
        step = range(len(self))[step]

        def row(name: str) -> npt.NDArray[Any]:
            return self.columns.row(name, step)

        pose = row("frames/pose")[self._frames]
        return SceneState(
            time=float(self.times[step]),
            step=step,
            positions=pose[:, :3],
            quaternions=pose[:, 3:],
            moved=self.moved(step),
            contacts=self.contacts(step),
            finger_forces=row("fingers/force").astype(float),
            normal_forces=row("fingers/normal_force").astype(float),
            joint_positions=row("hand/joint_positions"),
            step_time=float(row("report/step_time")),
            stage_times=dict(zip(STAGES, row("report/stage_times").tolist(), strict=True)),
            residual=float(row("report/residual")),
            converged=bool(row("report/converged")),
            quarantined=tuple(np.flatnonzero(row("bodies/quarantined")).tolist()),
            phase=self.phase(step),
        )

    def close(self) -> None:
        """Close the file."""
        self.columns.close()

    def __enter__(self) -> SceneRecording:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
