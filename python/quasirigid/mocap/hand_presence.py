"""Whether the hand that a session follows is in the stream at all, what to say when it is not, and when the session may begin."""

from __future__ import annotations

from typing import Literal

import numpy as np

from quasirigid._quasirigid import HandFrame
from quasirigid.arrays.types import BoolArray
from quasirigid.mocap import PARTS

Side = Literal["left", "right"]
ABSENT = 1.5
"""A hand that was not seen for so long is said to be absent, s: a little less than the two seconds after which a person wonders."""
RECENT = 0.5
"""What was seen within so long is there now, s."""
PALM = PARTS.index("palm")
GRASPING = (0, 1, 2)
"""Thumb, index and middle finger."""
SETTLE = 0.2
"""How long the hand is watched before the session begins, s: by then the filter knows the stream."""
LATECOMERS = 2.0
"""Fingers that are not seen so long after the first are left out, s."""
GONE = 0.25
"""Who was not seen for so long is not there, s: longer than some frames that get lost."""


def other_side(side: Side) -> Side:
    """The other hand."""
    return "left" if side == "right" else "right"


class HandPresence:
    """Follows when something came, and which hands were in it. Times in s, on the clock of the source."""

    def __init__(self, side: Side, now: float, *, bodies: bool, when_silent: str) -> None:
        """``bodies``: the hand consists of bodies on the fingers; ``when_silent`` is what to do when nothing comes from the source."""
        self._side, self._bodies, self._when_silent = side, bodies, when_silent
        self._began = now
        self._heard = float("-inf")
        self._seen: dict[str, float] = {}

    def heard(self, now: float) -> None:
        """Something has come."""
        self._heard = max(self._heard, now)

    def saw(self, side: str, now: float) -> None:
        """A part of the hand of this ``side`` was tracked."""
        self._seen[side] = max(self._seen.get(side, now), now)

    def absence(self, now: float, *, at_least: float = ABSENT) -> str:
        """What is wrong and what to do about it; empty while the hand is there, or has been away for less than ``at_least`` s."""
        if now - max(self._began, self._seen.get(self._side, self._began)) < at_least:
            return ""
        other = other_side(self._side)
        if now - self._seen.get(other, float("-inf")) < RECENT:
            hint = f"show the {self._side} hand, or start with `--hand {other}`"
            return f"only a {other} hand is seen, and this session is for a {self._side} one: {hint}"
        if now - self._heard < RECENT:
            if self._bodies:
                hint = "show them to the tracker; `quasirigid mocap monitor` lists what it sees"
                return f"the stream comes, but none of the bodies of `--bodies` is seen: {hint}"
            return f"the stream comes, but there is no {self._side} hand in it: show it to the tracker"
        return self._when_silent


class FingerPresence:
    """Follows the frames of a hand until the fingers that are to be coupled are there, all at the same time."""

    def __init__(self, coupling: str) -> None:
        """``coupling`` is ``tips`` or ``hand``."""
        self._coupling = coupling
        self._last = np.full(len(PARTS), -np.inf)
        """When each part was last seen, s."""
        self._has: BoolArray = np.ones(len(PARTS), dtype=bool)
        """What the source has."""
        self._known: BoolArray = np.zeros(len(PARTS), dtype=bool)
        """What it has named so far, seen or not."""
        self._seen: BoolArray = np.zeros(len(PARTS), dtype=bool)
        """In the newest frame."""
        self._since: float | None = None

    def saw(self, frame: HandFrame) -> None:
        """A frame has come."""
        self._seen = frame.tracked
        self._last[self._seen] = frame.arrival
        self._known |= frame.present
        if frame.source == "dtrack-bodies":
            self._has = frame.present  # a body for each of some fingers, and perhaps none for the others

    def live(self, now: float) -> BoolArray:
        """Which parts are there now (s, on the clock of the arrivals), (6,); frames that get lost are forgiven."""
        return np.asarray(now - self._last <= GONE)

    @property
    def wanted(self) -> list[int]:
        """The rows that are waited for."""
        if self._coupling == "hand":
            return [*GRASPING, PALM]
        return [row for row in GRASPING if self._has[row]] or [row for row in range(PALM) if self._has[row]]

    @property
    def expected(self) -> tuple[int, ...]:
        """The rows of all fingers that may yet be seen."""
        return tuple(row for row in range(PALM) if row in self.wanted or self._known[row])

    def missing(self, now: float) -> tuple[str, ...]:
        """Names of those of them who are not there."""
        live = self.live(now)
        return tuple(PARTS[row] for row in self.wanted if not live[row])

    def waited(self, now: float) -> float:
        """For how long something of the hand has been there without a break, s."""
        live = self.live(now)
        if not live[:PALM].any():
            self._since = None
        elif self._since is None:
            self._since = now
        return 0.0 if self._since is None else now - self._since

    def enough(self, now: float) -> bool:
        """Whether the session may begin: with all that is waited for or, with single pads and after ``LATECOMERS``, with thumb and another
        finger.
        """
        waited, seen = self.waited(now), self.live(now) & self._seen
        if seen[self.wanted].all():
            return waited > SETTLE
        return self._coupling == "tips" and waited > LATECOMERS and bool(seen[0] and seen[1:PALM].any())
