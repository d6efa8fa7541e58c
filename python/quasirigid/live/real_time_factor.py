"""How fast simulated time goes by on the clock of the wall."""

from __future__ import annotations

import time
from collections import deque

MEASURED = 1.0
"""The factor is that of the last so many seconds."""
SAMPLED_EVERY = 0.02
"""Seconds between two moments that are kept."""
SHORTEST = 0.2
"""Over a shorter span there is no factor yet, s."""


class RealTimeFactor:
    """Simulated over wall-clock time, from the simulated times given to ``update``."""

    def __init__(self) -> None:
        self._seen: deque[tuple[float, float]] = deque()

    def clear(self) -> None:
        """Begin again: time was set back, or stood still."""
        self._seen.clear()

    def update(self, simulated: float) -> None:
        """It is ``simulated`` s now."""
        now = time.perf_counter()
        if self._seen and now - self._seen[-1][0] < SAMPLED_EVERY:
            return
        self._seen.append((now, simulated))
        while now - self._seen[0][0] > MEASURED:
            self._seen.popleft()

    def value(self, unknown: float) -> float:
        """The factor, or ``unknown`` as long as too little has been seen."""
        span = self._seen[-1][0] - self._seen[0][0] if self._seen else 0.0
        return (self._seen[-1][1] - self._seen[0][1]) / span if span > SHORTEST else unknown
