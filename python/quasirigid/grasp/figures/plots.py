"""Pictures of a grasp: forces over time, motion of the object, and the contact patches with their friction.

Colours are those of Okabe and Ito, distinguishable for colour-blind readers too; where two curves must not be confused they
differ in shape or line style as well.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import EngFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

from quasirigid.arrays.types import FloatArray
from quasirigid.grasp.columns import contacts_on_object
from quasirigid.grasp.summary import Columns, Phase, creep, moved, phases, settled
from quasirigid.rotation import pose_in
from quasirigid.scene.palette import BAND, FINGER_COLOURS, INK, MUTED, SLIP_COLOUR
from quasirigid.scene.pressure import SLIP
from quasirigid.units import force_words, in_small_units, pressure_unit

STYLE: dict[str, Any] = {"fontsize": 9, "color": INK}
SHEET: dict[str, Any] = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0}
"""Behind words that a curve may run through."""
ROUNDING = 1e-15
"""Less than this, m or rad, is rounding of the poses: motion is drawn as if it were this much."""
DECADES = 7
"""Labels on a logarithmic axis, at most."""


def _figure(width: float, height: float, title: str, subtitle: str = "", *, constrained: bool = True) -> Figure:
    figure = Figure(figsize=(width, height), dpi=150, facecolor="white", layout="constrained" if constrained else None)
    FigureCanvasAgg(figure)
    place: dict[str, Any] = {} if constrained else {"y": 0.985, "va": "top"}
    figure.suptitle(title, x=0.012, ha="left", fontsize=12.5, fontweight="bold", color=INK, **place)
    if subtitle:  # the name of a file is no formula
        figure.text(0.988, 0.98, subtitle, ha="right", va="top", fontsize=9, color=MUTED, parse_math=False)
    return figure


def _dress(axes: Axes, ylabel: str) -> None:
    axes.set_ylabel(ylabel, **STYLE)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color("#999999")
    axes.tick_params(labelsize=8.5, colors=MUTED)
    axes.grid(axis="y", color="#E3E3E0", linewidth=0.6)
    axes.set_axisbelow(True)


def _empty(axes: Axes, why: str) -> None:
    """An axis of values that there are not says nothing: no figures on it, but ``why``."""
    axes.yaxis.set_major_locator(NullLocator())
    axes.yaxis.set_minor_locator(NullLocator())
    axes.spines["left"].set_visible(False)
    axes.text(0.5, 0.5, why, transform=axes.transAxes, ha="center", va="center", color=MUTED, fontsize=9)


def _shade(axes: Axes, spans: Sequence[Phase], *, names: bool = False) -> None:
    """Every other phase on a band, and the names above the topmost axes."""
    total = spans[-1].end - spans[0].start if spans else 1.0
    raised = False
    for i, span in enumerate(spans):
        if i % 2 == 0:
            axes.axvspan(span.start, span.end, color=BAND, zorder=0, linewidth=0)
        if names:
            # Short phases would write over each other: every second of them goes one line up.
            short = (span.end - span.start) / total < 0.0095 * (len(span.name) + 2)
            raised = short and not raised
            place = ((span.start + span.end) / 2, 1.10 if raised else 1.02)
            axes.text(*place, span.name, transform=axes.get_xaxis_transform(), ha="center", va="bottom", fontsize=8, color=MUTED)
    if spans:
        axes.set_xlim(spans[0].start, spans[-1].end)


def forces(columns: Columns, fingers: Sequence[str], *, dt: float, weight: float, friction: float, subtitle: str = "") -> Figure:
    """Normal force, friction force and use of the friction cone of every finger over time. ``weight`` N of the object."""
    time, spans = columns["time"], phases(columns["phase"], columns["time"], dt)
    normal, tangent = columns["hand/normal_force"], columns["hand/tangential_force"]
    figure = _figure(9.0, 7.0, "Forces of the fingers on the object", subtitle)
    top, middle, bottom = figure.subplots(3, 1, sharex=True, gridspec_kw={"height_ratios": [1.2, 1.2, 1.0]})
    dashes = ("-", (0, (6, 1.5)), (0, (1.5, 1.2)), (0, (4, 1, 1, 1)), "--", ":")
    for f, name in enumerate(fingers):
        style: dict[str, Any] = {"color": FINGER_COLOURS[f % 6], "linestyle": dashes[f % 6], "linewidth": 1.6}
        top.plot(time, normal[:, f], label=name.replace("_", " "), **style)
        middle.plot(time, tangent[:, f], **style)
        loaded = normal[:, f] > 0.02 * max(float(normal.max(initial=0.0)), 1e-9)
        used = np.where(loaded, tangent[:, f] / np.where(loaded, friction * normal[:, f], 1.0), np.nan)
        bottom.plot(time, 100 * used, **style)
    bottom.axhline(100, color=INK, linewidth=1.0)
    bottom.text(1.0, 101.5, "slips ", transform=bottom.get_yaxis_transform(), ha="right", va="bottom", fontsize=8, color=INK)
    middle.axhline(weight, color=MUTED, linewidth=0.8, linestyle=(0, (2, 3)))
    weighs: dict[str, Any] = {"transform": middle.get_yaxis_transform(), "ha": "right", "va": "bottom", "fontsize": 8, "color": MUTED}
    middle.text(0.997, weight, f"weight {force_words(weight)}", bbox=SHEET, **weighs)
    for axes, label in ((top, "normal force (N)"), (middle, "friction force (N)"), (bottom, "of the friction limit (%)")):
        _dress(axes, label)
        _shade(axes, spans, names=axes is top)
        axes.set_ylim(bottom=0)
    top.set_ylim(top=1.22 * top.get_ylim()[1])  # room for the legend
    middle.set_ylim(top=max(middle.get_ylim()[1], 1.15 * weight))
    bottom.set_ylim(0, 115)
    bottom.set_xlabel("time (s)", **STYLE)
    if not (normal > 0.0).any():
        why = "no finger touched the object" if len(time) else "the run ended before its first step"
        for axes in (top, middle, bottom):
            _empty(axes, why)
    if not len(time):
        bottom.xaxis.set_major_locator(NullLocator())
    top.legend(loc="upper right", frameon=True, framealpha=0.9, edgecolor="none", fontsize=8.5, ncols=len(fingers))
    figure.align_ylabels()
    return figure


def motion(columns: Columns, *, dt: float, subtitle: str = "") -> Figure:
    """Height of object and hand, and how far the object moved and turned in the hand, over time."""
    time, spans = columns["time"], phases(columns["phase"], columns["time"], dt)
    object_pose, hand = columns["object/pose"], columns["hand/pose"]
    relative = pose_in(hand, object_pose)
    figure = _figure(9.0, 7.0, "Motion of the object", subtitle)
    top, middle, bottom = figure.subplots(3, 1, sharex=True)
    if len(time):
        top.plot(time, 1e3 * (object_pose[:, 2] - object_pose[0, 2]), color=FINGER_COLOURS[0], linewidth=1.8, label="object")
        top.plot(time, 1e3 * (hand[:, 2] - hand[0, 2]), color=FINGER_COLOURS[1], linewidth=1.2, linestyle=(0, (4, 2)), label="hand")
        top.legend(loc="upper right", frameon=True, framealpha=0.9, edgecolor="none", fontsize=8.5, ncols=2)
        top.set_ylim(top=top.get_ylim()[1] + 0.22 * np.ptp(top.get_ylim()))  # room for the legend
    else:
        _empty(top, "the run ended before its first step")
    start = next((span.first for span in spans if span.name == "hold"), None)
    if start is not None:
        end = max((span.last for span in spans if span.name in ("hold", "lift", "shake", "hold again", "fall")), default=len(time))
        distance, angle = moved(relative[start:end])
        # On a logarithmic axis zero has no place: the first step is left out.
        steps = time[start:end]
        curves = (distance, angle)
        for axes, values, unit in zip((middle, bottom), curves, ("m", "rad"), strict=True):
            if values.max(initial=0.0) <= 0.0:
                _empty(axes, "not at all")
                continue
            drawn = np.where(values > 0.0, np.maximum(values, ROUNDING), np.nan)
            axes.semilogy(steps, drawn, color=FINGER_COLOURS[0], linewidth=1.4)
            axes.yaxis.set_major_locator(LogLocator(numticks=DECADES))
            axes.yaxis.set_major_formatter(EngFormatter(unit))
            axes.yaxis.set_minor_formatter(NullFormatter())
            later = values[min(20, len(values) - 1) :]
            if later.max(initial=0.0) > 0.0:
                axes.set_ylim(max(later[later > 0.0].min(), ROUNDING) / 30, 5 * max(values.max(), ROUNDING))
            if np.nanmin(drawn) <= ROUNDING:
                note = f"1 f{unit} stands for all that is less: rounding"
                axes.text(0.005, 0.97, note, transform=axes.transAxes, va="top", fontsize=8, color=MUTED)
        for span in spans:
            if span.name in ("hold", "hold again"):
                speeds = creep(relative[settled(span, dt)], dt)
                for axes, speed, unit, values in zip((middle, bottom), speeds, ("m/s", "rad/s"), curves, strict=True):
                    if speed is None or values.max(initial=0.0) <= 0.0:  # a hold of one step, or nothing to annotate
                        continue
                    # Where the curve is not.
                    there = np.median(values[span.first - start : span.last - start])
                    low, high = axes.get_ylim()
                    place = (0.5 * (span.start + span.end), 0.06 if there > math.sqrt(low * high) else 0.45)
                    text = f"last second:\n{in_small_units(speed, unit)}"
                    axes.annotate(text, place, xycoords=axes.get_xaxis_transform(), ha="center", fontsize=8, color=INK)
    else:
        for axes in (middle, bottom):
            _empty(axes, "no data: the run ended before the hold")
    labels = (
        (top, "rise since the start (mm)"),
        (middle, "moved in the hand\nsince the hold began"),
        (bottom, "turned in the hand\nsince the hold began"),
    )
    for axes, label in labels:
        _dress(axes, label)
        _shade(axes, spans, names=axes is top)
    bottom.set_xlabel("time (s)", **STYLE)
    if not len(time):
        bottom.xaxis.set_major_locator(NullLocator())
    figure.align_ylabels()
    return figure


def patch_plane(points: FloatArray, normals: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Centre and axes (3, 2) of a patch's own plane: second axis as near to upwards as it gets."""
    total = weights.sum()
    weights = weights / total if total > 0.0 else np.full(len(points), 1.0 / len(points))
    normal = weights @ normals
    normal /= np.linalg.norm(normal)
    up = np.array([0.0, 0.0, 1.0]) - normal[2] * normal
    if np.linalg.norm(up) < 0.1:  # a patch that lies flat: x to the right instead
        up = np.array([0.0, 1.0, 0.0]) - normal[1] * normal
    up /= np.linalg.norm(up)
    return weights @ points, np.column_stack([np.cross(up, normal), up])


def friction_of(force: FloatArray, normals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What presses (n,) N and the friction (n, 3) N in every contact of ``force`` (n, 3) N and unit ``normals`` (n, 3), all in world axes.

    Summed over a finger they are the recorded ``hand/normal_force`` and, in length, ``hand/tangential_force``.
    """
    push = np.einsum("ij,ij->i", force, normals)
    return push, force - push[:, None] * normals


def patches(contacts: Mapping[str, npt.NDArray[Any]], fingers: Sequence[str], *, time: float | None = None, subtitle: str = "") -> Figure:
    """The contact patch of every finger, seen from the fingertip: pressure in colour, friction as arrows, slip as open rings.

    ``contacts`` are the recorded rows of one step: point, normal, force, pressure, area, status, finger; ``time`` s is that of the step.
    """
    width, side, left, bottom, height = 3.35 * len(fingers) + 1.25, 2.8, 0.65, 1.45, 5.05  # inches
    title = "Contact patches at the end of the first hold" + ("" if time is None else f", {time:.3f} s")
    figure = _figure(width, height, title, constrained=False)
    figure.text(0.012, 0.942, subtitle, fontsize=9, color=MUTED, va="top", parse_math=False)
    places = [((left + 3.35 * f) / width, bottom / height, side / width, side / height) for f in range(len(fingers))]
    all_axes = [figure.add_axes(place) for place in places]
    loaded = contacts["pressure"] > 0.0
    pascal = contacts["pressure"].astype(float)
    unit, unit_name = pressure_unit(float(pascal[loaded & (contacts["finger"] >= 0)].max(initial=0.0)))
    top = max(float(pascal[loaded & (contacts["finger"] >= 0)].max(initial=0.0)), 1e-3) / unit
    radius, longest = 1.0, 0.0
    layers: list[tuple[npt.NDArray[Any], ...] | None] = []
    for f in range(len(fingers)):
        mine = loaded & (contacts["finger"] == f)
        if not mine.any():
            layers.append(None)
            continue
        points, normals, force = (contacts[key][mine].astype(float) for key in ("point", "normal", "force"))
        push, friction = friction_of(force, normals)
        centre, axes2 = patch_plane(points, normals, np.abs(push))
        flat = 1e3 * (points - centre) @ axes2
        radius = max(radius, float(np.abs(flat).max()) + 1.0)
        longest = max(longest, float(np.linalg.norm(friction, axis=1).max()))
        sums = np.array([np.abs(push).sum(), np.linalg.norm(friction.sum(axis=0))])
        area = contacts["area"][mine].astype(float)
        layers.append((flat, friction @ axes2, sums, pascal[mine] / unit, contacts["status"][mine], area))
    scatter = None
    for f, (axes, layer) in enumerate(zip(all_axes, layers, strict=True)):
        axes.set_aspect("equal")
        axes.set(xlim=(-radius, radius), ylim=(-radius, radius))
        axes.xaxis.set_major_locator(MaxNLocator(5, integer=True))
        axes.yaxis.set_major_locator(MaxNLocator(5, integer=True))
        _dress(axes, "up (mm)" if f == 0 else "")
        axes.set_xlabel("across (mm)", **STYLE)
        axes.set_title(fingers[f].replace("_", " "), loc="left", fontsize=10, fontweight="bold", color=FINGER_COLOURS[f % 6])
        if layer is None:
            axes.set(xlabel="", ylabel="")
            axes.xaxis.set_major_locator(NullLocator())
            axes.spines["bottom"].set_visible(False)
            _empty(axes, "no contact")
            continue
        flat, friction, sums, pressure, status, area = layer
        slips = status == SLIP
        # Discs of the control points' own area, in points^2.
        size = 1e6 * area * (72 * side / (2 * radius)) ** 2 * 4 / np.pi
        scatter = axes.scatter(flat[:, 0], flat[:, 1], c=pressure, s=size, cmap="viridis", vmin=0.0, vmax=top, linewidths=0)
        axes.scatter(flat[slips, 0], flat[slips, 1], s=0.8 * size[slips], facecolors="none", edgecolors=SLIP_COLOUR, linewidths=1.3)
        if longest > 0.0:
            seen = np.linalg.norm(friction, axis=1) > 0.06 * longest
            start, arrows = flat[seen].T, (friction[seen] / longest * 0.24 * radius).T
            style: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "minlength": 0.1}
            style |= {"headwidth": 4.0, "headlength": 4.5, "headaxislength": 4.2, "width": 0.0075, "linewidth": 0.5}
            axes.quiver(start[0], start[1], arrows[0], arrows[1], color="white", edgecolor=INK, **style)
        text = f"presses with {force_words(float(sums[0]))}, friction {force_words(float(sums[1]))}\n"
        text += f"{len(flat)} contacts, {int(slips.sum())} of them slip"
        axes.text(0.0, -0.21, text, transform=axes.transAxes, va="top", fontsize=8.5, color=MUTED, linespacing=1.4)
    if scatter is not None:
        bar = figure.colorbar(scatter, cax=figure.add_axes((1 - 0.75 / width, bottom / height, 0.14 / width, side / height)))
        bar.set_label(f"pressure ({unit_name})", **STYLE)
        bar.ax.tick_params(labelsize=8.5, colors=MUTED)
        bar.outline.set_visible(False)
    ring = Line2D([], [], marker="o", linestyle="none", markerfacecolor="none", markeredgecolor=SLIP_COLOUR, markersize=8, label="slips")
    disc = Line2D([], [], marker="o", linestyle="none", color="#21918c", markersize=8, label="sticks")
    arrow = Line2D(
        [],
        [],
        marker=r"$\rightarrow$",
        linestyle="none",
        color=INK,
        markersize=12,
        label=f"friction on the object, longest {in_small_units(longest, 'N', 2)}",
    )
    corner = (0.4 / width, 0.05 / height)
    handles = [disc, ring, arrow] if longest > 0.0 else [disc, ring]
    figure.legend(handles=handles, loc="lower left", bbox_to_anchor=corner, ncols=3, frameon=False, fontsize=8.5)
    return figure


def save_all(
    recording: Any, out: Path, fingers: Sequence[str], *, dt: float, weight: float, friction: float, subtitle: str = ""
) -> list[Path]:
    """Write the pictures of a ``Recording`` to the directory ``out`` and return their paths."""
    figures = {
        "forces.png": forces(recording, fingers, dt=dt, weight=weight, friction=friction, subtitle=subtitle),
        "motion.png": motion(recording, dt=dt, subtitle=subtitle),
    }
    hold = next((span for span in phases(recording["phase"], recording["time"], dt) if span.name == "hold"), None)
    if hold is not None:
        at = float(recording["time"][hold.last - 1])
        figures["patches.png"] = patches(contacts_on_object(recording, hold.last - 1), fingers, time=at, subtitle=subtitle)
    out.mkdir(parents=True, exist_ok=True)
    for name, figure in figures.items():
        figure.savefig(out / name)
    return [out / name for name in figures]


__all__ = ["forces", "friction_of", "motion", "patches", "save_all"]
