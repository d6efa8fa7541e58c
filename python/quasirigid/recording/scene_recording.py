"""Reads recordings of a scene: the same ``SceneModel`` and ``SceneState`` come back that were written, so that what draws a live world draws
a recording too.
"""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from quasirigid._quasirigid import STAGES
from quasirigid.arrays.types import AnyArray, FloatArray
from quasirigid.errors import RecordingError
from quasirigid.recording.file import damaged
from quasirigid.recording.reader import Recording
from quasirigid.recording.scene_columns import check_scene, frames_of
from quasirigid.recording.scene_model import read_model
from quasirigid.scene.contact_fields import FIELD_OF, contact_arrays, recorded_values
from quasirigid.scene.model import ContactsState, Moved, SceneState

ROWS_AT_ONCE = 2**18
"""Rows of a column that are read at a time where all are needed: a few megabytes."""


class SceneRecording:
    """Reads a recording as a scene: ``model``, ``times``, and ``state(step)`` as it was drawn live."""

    def __init__(self, path: str | Path) -> None:
        """Open the recording at ``path``.

        Raises ``RecordingError`` if there is none, if it is something else, if it is too old to hold a scene, or if a column is missing or
        not as ``scene_columns`` has it.
        """
        self.columns = Recording(path)
        try:
            self.model = read_model(self.columns)
            check_scene(self.columns, self.model)
            if self.columns.steps == 0:
                raise RecordingError(str(path), "a recording with at least one step", "none", "let the run go on for longer")
            for group in ("contacts", "moved"):
                self.columns.check_ends(group)
            self.times: FloatArray = self.columns["time"]
            if not np.isfinite(self.times).all() or (np.diff(self.times) < 0.0).any():
                raise damaged(self.columns.path, "column time", "times in rising order", "others")
        except BaseException:
            self.columns.close()
            raise
        self.contact_columns = frozenset(n.removeprefix("contacts/") for n in self.columns.names if n.startswith("contacts/"))
        """Columns of the group ``contacts``: older recordings have fewer."""
        frames = self.columns.labels("frames/pose")
        self._frames = [frames.index(frame) for frame in frames_of(self.model)]

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
            pressure, a, b = (self._contact_values(name, start, stop) for name in ("pressures", "collider_a", "collider_b"))
            mine = np.isin(a, tips) | np.isin(b, tips) if tips else slice(None)
            peak = float(pressure[mine].max(initial=peak))
        return peak

    def _contact_values(self, name: str, start: int, stop: int) -> AnyArray:
        """A field of the contacts in some rows of the group."""
        count = stop - start
        return recorded_values(FIELD_OF[name], self.contact_columns, lambda c: self.columns.slice(f"contacts/{c}", start, stop), count)

    def contacts(self, step: int) -> ContactsState:
        """The contacts of a step."""
        rows = self.columns.rows("contacts", step)
        return ContactsState(**contact_arrays(rows, len(rows["gap"])))

    def moved(self, step: int) -> dict[int, Moved]:
        """The displaced surface points as last written up to a step."""
        step = range(len(self))[step]
        source = int(self.columns.row("moved/step", step))
        if source == -1:
            return {}
        if not 0 <= source <= step:
            raise damaged(self.columns.path, "column moved/step", f"numbers from -1 to {step} up to row {step}", source)
        rows = self.columns.rows("moved", source)
        found: dict[int, Moved] = {}
        for body in np.unique(rows["body"]).tolist():
            mine = rows["body"] == body
            indices = rows["index"][mine].astype(np.int64)
            count = len(self.model.bodies[body].points)
            if indices.max() >= count:
                raise damaged(self.columns.path, "column moved/index", f"points of body {body}, below {count}", int(indices.max()))
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
