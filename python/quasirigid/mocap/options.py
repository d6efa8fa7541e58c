"""What can be chosen about a session with a tracked hand."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from quasirigid._quasirigid import Calibration
from quasirigid.errors import InvalidValueError
from quasirigid.mocap.springs import MAX_FORCE, Springs, check_max_force, check_strength


@dataclass(frozen=True)
class MocapOptions:
    """How a tracked hand is coupled."""

    side: Literal["left", "right"] = "right"
    coupling: Literal["tips", "hand"] = "tips"
    calibration: Calibration | None = None
    bodies: str | None = None
    """Bodies on the fingers in place of fingertracking, as of ``HandDecoder``."""
    springs: Springs = field(default_factory=Springs)
    """Of the coupling ``tips``."""
    gains: tuple[float, float] = (1.0, 1.0)
    """Of the coupling ``hand``: factors of the stiffness and of the damping of its joint controllers."""
    max_force: float = MAX_FORCE
    """Most that a simulated fingertip presses with, N, whatever the tracker says."""
    delay: float | None = None
    """How far in the past the hand is shown, s; ``None`` fits the stream, 0 predicts."""
    hold: float = 0.5
    """How long what is not seen keeps its full weight, s."""
    fade: float = 0.5
    """How long its weight then takes to 0, s."""
    idle: float = 3.0
    """The session ends when nothing has come for so long, s."""

    def check(self) -> None:
        """Refuse what cannot be. Raises ``InvalidValueError``."""
        for name, value, known in (("--hand", self.side, ("left", "right")), ("--coupling", self.coupling, ("tips", "hand"))):
            if value not in known:
                raise InvalidValueError(name, " or ".join(known), value, "choose one of them")
        if not (math.isfinite(self.idle) and self.idle > 0.0):
            raise InvalidValueError("--idle", "a finite number > 0 (s)", self.idle, "3 is the default")
        check_max_force(self.max_force)
        self.springs.check()
        for name, gain in zip(("--joint-stiffness", "--joint-damping"), self.gains, strict=True):
            check_strength(name, gain, "1 is as the hand is built")
        times = (("--delay", self.delay, 1.0), ("--loss-hold", self.hold, 60.0), ("--loss-fade", self.fade, 60.0))
        for name, seconds, most in times:
            if seconds is not None and not 0.0 <= seconds <= most:
                raise InvalidValueError(name, f"a number from 0 to {most:g} (s)", seconds, "leave it out for what is usual")
