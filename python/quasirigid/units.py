"""Figures with their units for people, never with an exponent: the files have all their digits."""

from __future__ import annotations

import numpy as np

PREFIXES = ((1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))
LONGEST_NAME = 32
"""Letters of an object's name in a picture."""

__all__ = ["force_words", "in_small_units", "mass_words", "percent", "plain", "pressure_unit", "short_name"]


def plain(value: float, digits: int = 3) -> str:
    """``value`` rounded to ``digits`` significant digits, without an exponent: ``"110"``, ``"0.71"``, ``"2"``."""
    return np.format_float_positional(float(f"{value:.{digits}g}"), trim="-")


def in_small_units(value: float, unit: str, digits: int = 3) -> str:
    """A figure >= 0 of a base unit, with the prefix with which it reads well: ``"110 mN"``, ``"0.02 nm/s"``, ``"under 0.001 nm/s"``."""
    for size, prefix in PREFIXES:
        if float(f"{value / size:.{digits}g}") >= 1.0:
            return f"{plain(value / size, digits)} {prefix}{unit}"
    return f"{plain(value * 1e9, digits)} n{unit}" if value * 1e9 >= 1e-3 else f"under 0.001 n{unit}"


def force_words(newtons: float) -> str:
    """``"4.01 N"``, ``"13 mN"``."""
    return f"{newtons:.2f} N" if newtons >= 0.1 or newtons <= 0.0 else in_small_units(newtons, "N", 2)


def mass_words(kilograms: float) -> str:
    """``"13.1 g"``, ``"5 kg"``."""
    return in_small_units(1e3 * kilograms, "g")


def pressure_unit(pascal: float) -> tuple[float, str]:
    """The unit in which pressures up to ``pascal`` read well: its size in Pa, and its name."""
    return next(((size, unit) for size, unit in ((1e6, "MPa"), (1e3, "kPa")) if pascal >= size), (1.0, "Pa"))


def percent(share: float) -> str:
    """A share >= 0: ``"0.25 %"``, ``"0.001 %"`` for whatever is less."""
    return f"{plain(max(100 * share, 1e-3), 2)} %"


def short_name(name: str, longest: int = LONGEST_NAME) -> str:
    """A ``name`` with an ellipsis in its middle where it has more than ``longest`` letters, so that it fits in a title."""
    if len(name) <= longest:
        return name
    front = (longest - 1) // 2
    return f"{name[:front]}…{name[len(name) - (longest - 1 - front) :]}"
