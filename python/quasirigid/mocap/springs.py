"""The damped springs between tracker and simulated finger, and how they change their strength without making energy."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from quasirigid.arrays.types import FloatArray
from quasirigid.errors import InvalidValueError

OFFSET_FADES = 0.1
"""Time constant with which a finger that is caught again goes to where the tracker sees it, s."""
OFFSET_GONE = 1e-5
"""An offset smaller than this, m or rad, is dropped."""


MAX_FORCE = 40.0
"""Most that a simulated fingertip presses with, N, unless the session says otherwise: more than handling things takes, and less than the
strongest pinch between thumb and index finger (50 to 80 N, Mathiowetz et al. 1985)."""
LEVER = 0.01
"""About which the force of a pad turns it, m: half a fingertip."""
SPRING_SHARE = 0.8
"""Of the most that a fingertip presses with, the share that its spring pulls with: the rest is what stops a pad of its mass that hits
something at top speed."""
MAX_SPEED = (3.0, 40.0)
"""Top speed of a pad, m/s and rad/s. People handle things at 1 to 2 m/s; from a hand that is quicker the pads stay behind, and catch up."""


@dataclass(frozen=True)
class Springs:
    """Stiffness and damping between tracker and pad."""

    stiffness: tuple[float, float] = (600.0, 0.5)
    """N/m and N m/rad."""
    damping: tuple[float, float] = (8.0, 0.01)
    """N s/m and N m s/rad."""

    def check(self) -> None:
        """Refuse what is no spring. Raises ``InvalidValueError``."""
        names = (("--spring", "N/m"), ("--spring-rotation", "N m/rad"), ("--damping", "N s/m"), ("--damping-rotation", "N m s/rad"))
        for (name, unit), value in zip(names, (*self.stiffness, *self.damping), strict=True):
            check_strength(name, value, unit)


def check_strength(name: str, value: float, unit: str) -> None:
    """Refuse a stiffness or damping that is none. Raises ``InvalidValueError``."""
    if not (math.isfinite(value) and value >= 0.0):
        raise InvalidValueError(name, f"a finite number >= 0 ({unit})", value, "0 switches it off")


def check_max_force(newton: float) -> None:
    """Refuse a limit of the pads' forces that is none. Raises ``InvalidValueError``."""
    if not (math.isfinite(newton) and newton > 0.0):
        raise InvalidValueError("--max-force", "a finite number > 0 (N)", newton, f"{MAX_FORCE:g} is the default")


FASTEST = (0.5, 3.0)
"""With which what was lost goes to where it is seen again, at most, m/s and rad/s: no faster than a hand."""


def fading(value: FloatArray, fastest: float) -> FloatArray:
    """With which an offset ``value`` goes to zero, per s: exponentially, but no faster than ``fastest``."""
    size = float(np.sqrt(value @ value))
    return -value * min(1.0 / OFFSET_FADES, fastest / max(size, OFFSET_GONE))


class Offset:
    """Lets a spring grow stiffer without giving it energy.

    A spring of stretch e that goes from stiffness k0 to k1 > k0 would hold more energy than before, out of nothing. Here its target is
    moved towards the body until the energy is what it was, ``e' = e sqrt(k0 / k1)``, and goes back to where it belongs as ``fading`` says:
    that is work which the hand does. What was lost and is seen again is so caught where it is.
    """

    def __init__(self, *parts: tuple[int, float]) -> None:
        """Components of the stretch, and how fast they may go back, in m and m/s or in rad and rad/s."""
        ends = np.cumsum([0, *(size for size, _ in parts)]).tolist()
        self._parts = [(slice(start, end), fastest) for start, end, (_, fastest) in zip(ends[:-1], ends[1:], parts, strict=True)]
        self.weight = 1.0
        self.value: FloatArray = np.zeros(ends[-1])
        """To be added to the target, m or rad."""
        self.velocity: FloatArray = np.zeros(ends[-1])
        """With which it changes, per s."""
        self.zero = True

    def update(self, weight: float, stretch: FloatArray | None, dt: float) -> None:
        """``stretch`` is that from body to target without offset; it is needed if the weight has grown."""
        if self.zero and weight <= self.weight:
            self.weight = weight
            return
        self.value = self.value + dt * self.velocity
        if stretch is not None and weight > self.weight:
            self.value = math.sqrt(self.weight / weight) * (stretch + self.value) - stretch
        self.zero = bool(np.abs(self.value).max() < OFFSET_GONE)
        if self.zero:
            self.value = np.zeros_like(self.value)
        self.velocity = np.concatenate([fading(self.value[part], fastest) for part, fastest in self._parts])
        self.weight = weight
