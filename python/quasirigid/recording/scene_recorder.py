"""Writes recordings of a scene: all that a replay in 3D needs, for any world.

The shapes of the bodies are written once, their poses, the contacts and the forces in every step. The elastic deformation of the
surfaces, the bulk of it all, is written ``deformation_rate`` times a second: the displaced points alone, by how much they are displaced.

Written is a ``SceneModel`` and one ``SceneState`` per step; ``quasirigid.recording.scene_recording`` reads them back.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt

from quasirigid._quasirigid import STAGES, StepReport, __version__
from quasirigid.errors import InvalidShapeError, InvalidValueError
from quasirigid.recording.reader import VERSION, Column
from quasirigid.recording.recorder import Recorder
from quasirigid.recording.scene_columns import PHASE_CODES, frames_of, scene_columns
from quasirigid.recording.scene_model import model_columns, model_constants
from quasirigid.recording.schema import described
from quasirigid.scene.contact_fields import RECORDED_FIELDS
from quasirigid.scene.model import Moved, SceneModel, SceneState

DEFORMATION_RATE = 60.0
"""Times a second of simulated time that the deformation is written."""
UNCHANGED = 1e-9
"""Deformation that differs by less than this from what was written last is not written again, m."""


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

        ``columns`` are further columns of your own; ``phase`` may be a number with labels (``PHASE_CODES``). ``deformation_rate`` in 1/s of
        simulated time; infinity writes the deformation in every step.
        """
        if not deformation_rate > 0.0:
            raise InvalidValueError("deformation_rate", "times a second, above 0", deformation_rate, f"{DEFORMATION_RATE:g} is the default")
        own = {column.name: column for column in columns}
        common = []
        for column in scene_columns(model, joints):
            mine = own.get(column.name, column)
            if described(mine) not in (described(column), described(PHASE_CODES) if column.name == "phase" else ""):
                hint = "give your column another name"
                raise InvalidValueError(
                    f"column {column.name}", f"{described(column)}, as every reader of a scene has it", described(mine), hint
                )
            if mine is column:
                common.append(column)
        self.model = model
        # To the nearest step: the deformation is never older than this and half a step.
        self._interval = 1.0 / deformation_rate - 0.5 * model.dt
        self._looked_at = -math.inf
        self._moved_at = -1
        self._moved: Mapping[int, Moved] = {}
        self._aside: frozenset[int] = frozenset()
        frames = frames_of(model)
        self._carriers = [frames.index(frame) for frame in dict.fromkeys(frames)]
        constants, scene = model_constants(model)
        common_attributes = {"quasirigid_version": __version__, "dt": model.dt, "scene": scene, "deformation_rate": deformation_rate}
        described_model = model_columns([len(body.control.points) for body in model.bodies], VERSION)
        self._recorder = Recorder(
            path, [*columns, *common, *described_model], {**common_attributes, **(attributes or {})}, constants=constants
        )

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

        Raises ``InvalidShapeError`` for other bodies than those of the model, ``InvalidValueError`` for a phase longer than
        ``PHASE_BYTES``.
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
            **{f"contacts/{field.column}": getattr(c, field.name) for field in RECORDED_FIELDS},
            **self._moved_rows(moved),
            "moved/step": self._recorder.steps if changed else self._moved_at,
            "fingers/force": state.finger_forces,
            "fingers/normal_force": state.normal_forces,
            "hand/joint_positions": state.joint_positions,
            "report/contacts": len(c),
            "report/sweeps": report.sweeps if report is not None else 0,
            "report/residual": state.residual,
            "report/converged": state.converged,
            "report/coarse": report is not None and report.budget_exhausted,
            "report/indentation": 0.0 if report is None else report.indentation,
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
