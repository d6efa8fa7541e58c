"""Where the world stands in the room of the headset."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from quasirigid.arrays.types import FloatArray
from quasirigid.errors import InvalidValueError
from quasirigid.mocap import Calibration
from quasirigid.mocap.webxr.joints import TURN
from quasirigid.rotation import conjugate, quaternion_product, rotate

FAR = 100.0
"""Nothing in a room is farther from its origin, m."""
AHEAD, BELOW = 0.38, 0.42
"""Recentred, the world's origin lies so far ahead of the eyes and below them, m: the top of a table before somebody who sits."""


@dataclass(frozen=True)
class Placement:
    """The world's origin in the room (m, y up, ``local-floor``), and the way its user looks, rad about the vertical, 0 is along -z of the
    room.

    World x points away from the user, y to the left, z up.
    """

    position: tuple[float, float, float] = (0.0, 0.75, -0.4)
    heading: float = 0.0

    def __post_init__(self) -> None:
        if not (len(self.position) == 3 and all(math.isfinite(x) and abs(x) <= FAR for x in self.position)):
            raise InvalidValueError(
                "position of the world in the room", f"three finite numbers up to {FAR:g} m", self.position, "metres, y is up"
            )
        if not (math.isfinite(self.heading) and abs(self.heading) <= 2.0 * math.pi):
            raise InvalidValueError("heading", "an angle within +-2 pi rad", self.heading, "0 looks along -z of the room")

    @staticmethod
    def parse(text: str) -> Placement:
        """From ``"X,Y,Z"`` or ``"X,Y,Z,DEGREES"``. Raises ``InvalidValueError``."""
        try:
            numbers = [float(part) for part in text.split(",")]
            if len(numbers) not in (3, 4):
                raise ValueError(text)
        except ValueError:
            hint = "0,0.75,-0.4 is a table 75 cm high, 40 cm ahead"
            raise InvalidValueError("--place", "X,Y,Z or X,Y,Z,DEGREES", text, hint) from None
        x, y, z, degrees = (*numbers, 0.0)[:4]
        return Placement((x, y, z), math.radians(degrees))

    @staticmethod
    def before(eyes: FloatArray, forward: FloatArray) -> Placement:
        """In front of somebody whose eyes are at ``eyes`` (3,) m and who looks along ``forward`` (3,), room.

        Raises ``InvalidValueError`` for somebody who looks straight up or down, or for numbers that are not finite.
        """
        level = math.hypot(forward[0], forward[2])
        if not level > 0.05:
            raise InvalidValueError("forward", "a direction that is not vertical", tuple(forward), "look ahead and recentre again")
        x, z = forward[0] / level, forward[2] / level
        place = (float(eyes[0] + AHEAD * x), float(eyes[1] - BELOW), float(eyes[2] + AHEAD * z))
        return Placement(place, math.atan2(-x, -z))

    def calibration(self) -> Calibration:
        """From the room to the world."""
        # Room from world: x_room = position + Q x_world, with Q = (turn by the heading about y) after the exchange of axes.
        half = 0.5 * self.heading
        about_y = np.array([math.cos(half), 0.0, math.sin(half), 0.0])
        back = conjugate(quaternion_product(about_y, TURN))
        return Calibration(rotate(back, -np.array(self.position)), back)

    def message(self) -> dict[str, object]:
        """For the page."""
        return {"type": "placement", "position": list(self.position), "heading": self.heading}
