"""Steps that keep up with the clock on the wall, and how well they do."""

from __future__ import annotations

from typing import Any

import numpy as np

from quasirigid.mocap.stream import Source

SLACK = 0.1
"""The simulation may run this much behind the clock before it gives up to catch up, s."""


class Pace:
    """When each step is due. A step that comes late is made up for; more than ``SLACK`` is not, and simulated time falls behind."""

    def __init__(self, source: Source, dt: float) -> None:
        self._source, self._dt = source, dt
        self._due = source.now()
        self.lateness: list[float] = []
        """How late each step began, s."""
        self.waits: list[float] = []
        """From the arrival of each packet to the step that knows of it, s."""
        self.slipped = 0.0
        """By how much simulated time fell behind the clock, s."""

    def wait(self) -> float:
        """Wait for the next step. Returns the moment for which it asks where the hand is, s on the source's clock."""
        self._due += self._dt
        self._source.wait_until(self._due)
        late = self._source.now() - self._due
        if late > SLACK:
            self.slipped += late
            self._due += late
        self.lateness.append(late)
        return self._due

    def used(self, arrivals: list[float]) -> None:
        """These packets go into the step that begins now."""
        now = self._source.now()
        self.waits += [now - arrival for arrival in arrivals]

    def summary(self) -> dict[str, Any]:
        """Figures for ``summary.json``."""
        return {
            "packet_to_step_ms": _spread(self.waits),
            "step_lateness_ms": _spread(self.lateness),
            "slipped_s": self.slipped,
        }


def _spread(seconds: list[float]) -> dict[str, float] | None:
    if not seconds:
        return None
    ms = 1e3 * np.array(seconds)
    return {"median": float(np.median(ms)), "p99": float(np.percentile(ms, 99)), "max": float(ms.max())}
