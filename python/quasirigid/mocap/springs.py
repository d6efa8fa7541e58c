"""The damped springs between tracker and simulated finger, and how they change their strength without making energy."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from quasirigid.errors import InvalidValueError

FloatArray = npt.NDArray[np.float64]
OFFSET_FADES = 0.1
"""Time constant with which a finger that is caught again goes to where the tracker sees it, s."""
OFFSET_GONE = 1e-5
"""An offset smaller than this, m or rad, is dropped."""


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


class Offset:
    """Lets a spring grow stiffer without giving it energy.

    A spring of stretch e that goes from stiffness k0 to k1 > k0 would hold more energy than before, out of nothing. Here its target is moved
    towards the body until the energy is what it was, ``e' = e sqrt(k0 / k1)``, and goes back to where it belongs with the time constant
    ``OFFSET_FADES``: that is work which the hand does. What was lost and is seen again is so caught where it is.
    """

    def __init__(self, size: int) -> None:
        """``size`` is the number of components of the stretch."""
        self.weight = 1.0
        self.value: FloatArray = np.zeros(size)
        """To be added to the target, (size,) m or rad."""
        self.zero = True

    def update(self, weight: float, stretch: FloatArray | None, dt: float) -> None:
        """``stretch`` (size,) is that from body to target without offset; it is needed if the weight has grown."""
        if self.zero and weight <= self.weight:
            self.weight = weight
            return
        if not self.zero:
            self.value = math.exp(-dt / OFFSET_FADES) * self.value
        if stretch is not None and weight > self.weight:
            self.value = math.sqrt(self.weight / weight) * (stretch + self.value) - stretch
        self.zero = bool(np.abs(self.value).max() < OFFSET_GONE)
        if self.zero:
            self.value = np.zeros_like(self.value)
        self.weight = weight

    @property
    def velocity(self) -> FloatArray:
        """With which it goes back, (size,) per s."""
        return -self.value / OFFSET_FADES
