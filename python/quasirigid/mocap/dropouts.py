"""When the tracker did not see a finger, for the summary of a session."""

from __future__ import annotations

from typing import Any

from quasirigid._quasirigid import HandTargets
from quasirigid.mocap import PARTS


class Dropouts:
    """Follows the parts of a hand that were seen once; ``update`` is called some hundred times per second."""

    def __init__(self) -> None:
        self._since: dict[int, float] = {}
        self._limp: dict[int, float] = {}
        self._found: list[dict[str, Any]] = []
        self._fresh = self._time = 0.0

    def update(self, time: float, targets: HandTargets, silent: float) -> None:
        """``time`` is simulated, s; ``silent``: since when nothing has come, s."""
        elapsed, self._time = time - self._time, time
        self._fresh = time - silent
        weights = targets.weights
        for row, state in enumerate(targets.states):
            if state in ("held", "fading", "lost"):
                self._since.setdefault(row, time)
                self._limp[row] = self._limp.get(row, 0.0) + (elapsed if weights[row] == 0.0 else 0.0)
            elif row in self._since:
                self._found.append(self._dropout(row, time))
                del self._since[row], self._limp[row]

    def _dropout(self, row: int, end: float) -> dict[str, Any]:
        return {
            "part": PARTS[row],
            "start": round(self._since[row], 6),
            "end": round(end, 6),
            "limp_s": round(self._limp[row], 6),
        }

    def summary(self) -> list[dict[str, Any]]:
        """Every dropout: ``part``, ``start`` and ``end`` (simulated s), and ``limp_s``, how long its spring had no strength. The silence
        that ends a session is none.
        """
        going_on = [self._dropout(row, self._time) for row, since in self._since.items() if since < self._fresh]
        return sorted([*self._found, *going_on], key=lambda dropout: (dropout["start"], PARTS.index(dropout["part"])))
