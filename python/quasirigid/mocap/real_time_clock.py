"""Steps that keep up with the clock on the wall, and how well they do."""

from __future__ import annotations

import gc
import sys
from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from quasirigid.mocap.source import Source

SLACK = 0.05
"""A step that comes this late is simply made up for, s."""
CATCH_UP = 0.2
"""Later than that the hand is shown faster, so that it does not stay behind: twice as fast when it is so much later, s."""
MISSED = 1e-3
"""A packet that came so long (s) before a step began ought to be used by it."""
LATE = 2e-4
"""A step that begins later than this shall hurry, s."""
SUSPENDED = 2.0
"""So far behind, the program was stopped: it goes on from now, s."""
SWITCH = 1e-4
"""After so long (s) a thread that computes in Python gives way to the one that steps; Python's own figure is 5 ms, five steps."""


@contextmanager
def undisturbed() -> Iterator[None]:
    """A loop that keeps up with the clock: other threads give way soon, and the garbage collector does not go through what was there
    before.
    """
    interval = sys.getswitchinterval()
    ours = gc.get_freeze_count() == 0  # what the program around us has frozen is not ours to thaw
    gc.collect()
    if ours:
        gc.freeze()
    sys.setswitchinterval(min(SWITCH, interval))
    try:
        yield
    finally:
        sys.setswitchinterval(interval)
        if ours:
            gc.unfreeze()


class RealTimeClock:
    """When each step is due, and for which moment it asks where the hand is.

    On a computer that is too slow simulated time falls behind the clock on the wall. The hand must not: its motion is then run through
    faster (and its velocity with it), and is shown at most some tenths of a second late. The moments that are asked for do not jump, but
    for one case: a program that was stopped for more than ``SUSPENDED`` goes on from now, and it is for the filter to let the hand glide
    there (``HandTracker.sample``).
    """

    def __init__(self, source: Source, dt: float) -> None:
        self._source, self._dt = source, dt
        self._due = source.now()
        self._pending: deque[float] = deque()
        self.rate = 1.0
        """How much faster than simulated time the hand is shown."""
        self.hurried = False
        """Whether the step under way began late."""
        self.lateness: list[float] = []
        """How late each step began, s."""
        self.waits: list[float] = []
        """From the arrival of each packet to the first step for a moment after it, s."""
        self.passed_over = 0
        """Packets that had come well before a step, ``MISSED``, and were used by a later one only: none, unless something is wrong."""
        self._began = float("-inf")
        self.slipped = 0.0
        """By how much simulated time fell behind the clock, s."""

    def wait(self) -> float:
        """Wait for the next step. Returns the moment for which it asks where the hand is, s on the source's clock."""
        behind = self._source.now() - self._due
        if behind > SUSPENDED:
            self.slipped += behind
            self._due += behind
            behind = 0.0
        self.rate = 1.0 + max(0.0, behind - SLACK) / CATCH_UP
        self.slipped += (self.rate - 1.0) * self._dt
        self._due += self.rate * self._dt
        self._source.wait_until(self._due)
        return self._due

    def begin(self, arrivals: Iterable[float]) -> None:
        """The step begins now, and these packets have come since the last one."""
        now = self._source.now()
        self.lateness.append(now - self._due)
        self.hurried = self.lateness[-1] > LATE
        new = list(arrivals)
        self.passed_over += sum(arrival < self._began - MISSED for arrival in new)
        self._began = now
        self._pending.extend(new)
        while self._pending and self._pending[0] <= self._due:
            self.waits.append(now - self._pending.popleft())

    def summary(self) -> dict[str, Any]:
        """Figures for ``summary.json``."""
        return {
            "packet_to_step_ms": _spread(self.waits),
            "passed_over": self.passed_over,
            "step_lateness_ms": _spread(self.lateness),
            "slipped_s": self.slipped,
        }


def _spread(seconds: list[float]) -> dict[str, float] | None:
    if not seconds:
        return None
    ms = 1e3 * np.array(seconds)
    return {"median": float(np.median(ms)), "p99": float(np.percentile(ms, 99)), "max": float(ms.max())}
