"""Pieces of HTML in the panel: the line of figures, the legend, messages."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from math import isnan

from quasirigid.scene.palette import SLIP_COLOUR, STICK_COLOUR
from quasirigid.scene.pressure import byte_colours

SLOW = 0.95
"""Below this share of the speed asked for, the view says that it is slow motion."""
FRICTIONS = (
    f'<div style="margin-top:4px"><b style="color:{STICK_COLOUR}">&#8212;</b> sticks &nbsp; '
    f'<b style="color:{SLIP_COLOUR}">&#215;&#8212;</b> slips</div>'
)


def figures(phase: str, time: float, real_time: float, speed: float | None, step_time: float, contacts: int, *, running: bool) -> str:
    """What goes on, in a few figures with their units.

    ``real_time`` is the real-time factor, NaN as long as it is not known; ``speed`` is the one asked for, ``None`` if nobody did.
    """
    slow = running and speed is not None and real_time < SLOW * speed
    factor = "being measured" if isnan(real_time) else f"{real_time:.2f} × real time"
    if slow:
        factor = f'<b style="color:#b45309">slow motion: {factor}</b>, the machine is too slow for {speed:g} ×'
    elif not running:
        factor = "paused"
    rows = [("state", escape(phase))] if phase else []
    rows += [("time", f"{time:.3f} s"), ("pace", factor), ("step", f"{1e3 * step_time:.2f} ms, {contacts} contacts")]
    return _rows(rows)


def table(rows: Sequence[tuple[str, str]]) -> str:
    """Names and what is to be said of them, one below the other."""
    return _rows([(escape(name), escape(value)) for name, value in rows])


def _rows(rows: Sequence[tuple[str, str]]) -> str:
    cells = "".join(
        f'<tr><td style="color:#6b7280;padding-right:10px;vertical-align:top">{name}</td><td>{value}</td></tr>' for name, value in rows
    )
    return f'<div style="font-size:13px;padding:2px 12px"><table style="border-spacing:0;line-height:1.45">{cells}</table></div>'


def pressure(pascal: float) -> str:
    """``"20 kPa"``."""
    for factor, unit in ((1e6, "MPa"), (1e3, "kPa")):
        if pascal >= factor:
            return f"{pascal / factor:g} {unit}"
    return f"{pascal:g} Pa"


def legend(full_scale: float | None) -> str:
    """The colours of pressure, up to ``full_scale`` Pa, and of friction; ``None``: there are no pads on which pressure is shown."""
    pressures = "" if full_scale is None else _pressures(full_scale)
    return f'<div style="font-size:12px;padding:2px 12px;color:#374151">{pressures}{FRICTIONS}</div>'


def _pressures(full_scale: float) -> str:
    stops = ",".join("#{:02x}{:02x}{:02x}".format(*byte_colours()[i].tolist()) for i in range(0, 256, 17))
    marks = "".join(f"<span>{'0' if share == 0 else pressure(share * full_scale)}</span>" for share in (0.0, 0.5, 1.0))
    return (
        '<div style="margin-bottom:3px">Pressure and shear on the pads</div>'
        f'<div style="height:10px;border-radius:3px;background:linear-gradient(to right,{stops})"></div>'
        f'<div style="display:flex;justify-content:space-between">{marks}</div>'
    )


def curve_legend(styles: Sequence[tuple[str, str, bool]]) -> str:
    """Whose curve has which colour: name, colour, and whether the curve is dashed."""
    entries = "".join(
        f'<span style="white-space:nowrap;margin-right:7px"><span style="display:inline-block;width:14px;vertical-align:middle;'
        f'border-top:2px {"dashed" if dashed else "solid"} {colour}"></span> {escape(name)}</span>'
        for name, colour, dashed in styles
    )
    return f'<div class="curve-legend" style="font-size:11.5px;padding:2px 12px;color:#374151">{entries}</div>'


def no_data(what: str) -> str:
    """In place of a plot of which there is nothing yet."""
    return f'<div style="font-size:12px;padding:6px 12px;color:#6b7280">{escape(what)}: no data yet</div>'


def force(newtons: float, largest: float) -> str:
    """The pull of a hand on the object."""
    if newtons <= 0.0:
        return ""
    limit = " (the most it pulls)" if newtons > 0.999 * largest else ""
    return f'<div style="font-size:13px;padding:2px 12px;color:#a8478a"><b>you pull with {newtons:.2f} N</b>{limit}</div>'


def complaint(text: str) -> str:
    """Something that was refused, and why."""
    return f'<div style="font-size:12px;padding:4px 12px;color:#b91c1c">{escape(text)}</div>' if text else ""


def note(text: str) -> str:
    """Something worth knowing."""
    return f'<div style="font-size:12px;padding:4px 12px;color:#4b5563">{escape(text)}</div>' if text else ""
