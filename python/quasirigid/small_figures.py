"""Figures next to nothing, for people: the files have all their digits."""

from __future__ import annotations

__all__ = ["in_small_units", "percent"]


def in_small_units(value: float, unit: str) -> str:
    """A figure >= 0 of a base unit, with the prefix with which it reads well: ``"1.9 mm/s"``, ``"0.02 nm/s"``, ``"under 0.001 nm/s"``."""
    for factor, prefix in ((1.0, ""), (1e3, "m"), (1e6, "µ")):
        if value * factor >= 1.0:
            return f"{value * factor:.3g} {prefix}{unit}"
    return f"{value * 1e9:.3g} n{unit}" if value * 1e9 >= 1e-3 else f"under 0.001 n{unit}"


def percent(share: float) -> str:
    """A share >= 0: ``"0.25 %"``, ``"0.001 %"`` for whatever is less."""
    return f"{max(100 * share, 1e-3):.2g} %"
