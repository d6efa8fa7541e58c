"""The figures as Markdown."""

from __future__ import annotations

from typing import Any

HEAD = (
    "",
    "dt, ms",
    "hold",
    "slip threshold",
    "3 mm off centre",
    "10 mm off centre",
    "contacts",
    "CPU ms a step: held, shaken",
    "pressure field",
)
MISSING = "not installed"


def markdown(results: list[dict[str, Any]], capsule: list[dict[str, Any]], about: str) -> str:
    """Both tables under one line that says what ran."""
    lines = [about, "", _row(HEAD), _row(["---"] * len(HEAD))]
    lines += [_row(_cells(r)) for r in results]
    lines += ["", _row(("pinched capsule", "dt, ms", "squeeze", "friction over weight", "drift")), _row(["---"] * 5)]
    for r in capsule:
        if "missing" in r:
            lines.append(_row([r["name"], f"{r['dt_ms']:g}", MISSING, "", ""]))
        else:
            lines.append(_row([r["name"], f"{r['dt_ms']:g}", f"{r['squeeze_n']:.1f} N", f"{r['margin']:.0f} x", rate(r["drift_m_per_s"])]))
    return "\n".join(lines)


def _row(cells: Any) -> str:
    return "| " + " | ".join(cells) + " |"


def _cells(r: dict[str, Any]) -> list[str]:
    start = [r["name"], f"{r['dt_ms']:g}"]
    if "missing" in r:
        return [*start, MISSING, *[""] * (len(HEAD) - 3)]
    held = rate(r["creep_m_per_s"])
    if r["fell_at_s"]:
        held += f", 30 mm in {r['fell_at_s']:.1f} s"
    if r["short_hold"]:
        held += f" (over {r['hold_s']:g} s)"
    ratio = r["slip_ratio"]
    slip = "never slips" if ratio is None else f"{ratio:.3f} ({100 * r['slip_error']:+.1f} %)"
    if r["slips_under_its_weight"]:
        slip = "slides under its weight"
    cost = f"{r['cpu_ms']:.3f}, {r['cpu_shaken_ms']:.3f}"
    return [*start, held, slip, *map(_twist, r["twist"]), str(r["contacts"]), cost, r["pressure_field"]]


def _twist(figures: dict[str, Any]) -> str:
    if figures["peak_deg"] > 150.0:
        return "swings free"
    speed = abs(figures["rate_deg_per_s"])
    if speed < 1e-5:
        return f"holds at {figures['angle_deg']:.2f}°"
    return f"{figures['angle_deg']:.2f}°, {speed:.2g}°/s"


def rate(value: float) -> str:
    """A speed such as ``3.1 µm/s``."""
    for prefix, factor in (("m", 1e3), ("µ", 1e6), ("n", 1e9), ("p", 1e12)):
        if abs(value) * factor >= 1.0:
            return f"{value * factor:.3g} {prefix}m/s"
    return "under 1 pm/s"
