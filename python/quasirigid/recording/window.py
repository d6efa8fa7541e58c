"""Which steps of a recording are drawn or written: from a time to a time, and every how many."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from quasirigid.errors import InvalidValueError
from quasirigid.recording.scene_recording import SceneRecording

BLOCK = 500
"""Steps written at a time."""


def check_times(start: float | None, end: float | None, *, single: bool = False) -> None:
    """Raises ``InvalidValueError`` for a time (s) that is none; ``single``: the options are called ``--at`` and not ``--from`` and
    ``--to``.
    """
    for name, value in (("at", end),) if single else (("from", start), ("to", end)):
        if value is not None and not math.isfinite(value):
            raise InvalidValueError(name, "a time in s", value, f"leave --{name} out for the whole recording")


def span(recording: SceneRecording, start: float | None, end: float | None, *, single: bool = False) -> tuple[float, float]:
    """First and last time of what lies between ``start`` and ``end`` s, within the recording; ``None`` is where it begins or ends.

    Raises ``InvalidValueError`` if nothing is left; ``single`` as of ``check_times``.
    """
    times = recording.times
    first, last = float(times[0]), float(times[-1])
    # A row stands for the time since the one before it: the recording of a world begins at 0, its first row at the end of a step.
    begin = first - max(recording.model.dt, float(times[1] - times[0]) if len(times) > 1 else 0.0)
    shown_from = first if start is None else max(start, first)
    shown_to = last if end is None else min(end, last)
    if begin - 1e-9 <= shown_to < first:
        shown_to = first
    if shown_from > shown_to:
        expected = f"a time within the recording, {max(round(begin, 9), 0.0):g} to {last:g} s"
        if single:
            raise InvalidValueError("at", expected, f"{shown_to:g} s", "choose another --at")
        got = f"{start if start is not None else first:g} to {end if end is not None else last:g} s"
        raise InvalidValueError("from, to", expected, got, "choose another --from or --to")
    return shown_from, shown_to


@dataclass(frozen=True)
class Window:
    """Which steps of a recording are written."""

    first: int
    last: int
    every: int

    def blocks(self) -> Iterator[npt.NDArray[np.int64]]:
        """The steps, some at a time."""
        for start in range(self.first, self.last + 1, BLOCK * self.every):
            yield np.arange(start, min(start + BLOCK * self.every, self.last + 1), self.every)


def window_of(recording: SceneRecording, every: int, start: float | None, end: float | None) -> Window:
    """The steps from ``start`` to ``end`` s, every ``every``-th. Raises ``InvalidValueError`` if there are none."""
    if every < 1:
        raise InvalidValueError("every", "at least 1 step", every, "leave --every out for all steps")
    check_times(start, end)
    begin, stop = span(recording, start, end)
    return Window(recording.step_at(begin), recording.step_at(stop), every)


__all__ = ["Window", "check_times", "span", "window_of"]
