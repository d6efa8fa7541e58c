"""The scenes, in numbers, and what every engine has to offer to be measured on them.

A box hangs between soft spherical pads. *Three pads*: a thumb at -x with 4 N, two fingers at +x with 2 N each. *Two pads*: one on either side, 4 N, and a box whose
centre of mass is off their common axis. *Capsule*: google-deepmind/mujoco issue 3328.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

GRAVITY = 9.81
BOX = 0.06
"""Edge, m."""
BOX_MASS = 0.2
PAD_RADIUS = 0.01
PAD_MASS = 0.1
FRICTION = 0.8
SQUEEZE = 4.0
"""Force of the thumb, N: 3.3 times what the weight needs."""
FINGER_SPACING = 0.024
WEIGHT = BOX_MASS * GRAVITY

CAPSULE_RADIUS, CAPSULE_HALF_LENGTH, CAPSULE_MASS, CAPSULE_FRICTION = 0.004, 0.03, 0.045, 0.7
CAPSULE_PAST_CONTACT = 0.002
"""How far the targets of the pads' position actuators lie past first contact, m."""
CAPSULE_STIFFNESS, CAPSULE_DAMPING = 6_000.0, 60.0
"""Of the position actuators: 12 N at 2 mm."""
CAPSULE_PAD = (0.005, 0.04, 0.02)
"""Half edges of the pads, m."""


def pads(count: int) -> list[tuple[str, float, float, float]]:
    """(name, side along x, y, share of the squeeze) of each pad."""
    if count == 2:
        return [("thumb", -1.0, 0.0, 1.0), ("finger", 1.0, 0.0, 1.0)]
    return [("thumb", -1.0, 0.0, 1.0), ("finger 1", 1.0, FINGER_SPACING / 2, 0.5), ("finger 2", 1.0, -FINGER_SPACING / 2, 0.5)]


@dataclass(frozen=True)
class Configuration:
    """One engine in one setting."""

    engine: str
    name: str
    dt: float
    options: dict[str, Any]
    pressure_field: str
    """What comes out about the pressure, in words."""
    costly: bool = False
    """Whether a hold of a minute takes a minute of CPU time."""


class Simulation(Protocol):
    """A scene in one engine, at rest in its pads."""

    def step(self) -> None:
        """One step of ``dt``."""

    def pull(self, newton: float) -> None:
        """Pull the box down at its centre of mass, from the next step on."""

    def height(self) -> float:
        """Of the box's origin, m."""

    def angle(self) -> float:
        """By which the box has turned about x, rad."""

    def squeeze(self) -> float:
        """Normal force at the thumb, N."""

    def contacts(self) -> int:
        """Points, polygons or control points in contact."""
