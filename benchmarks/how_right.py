"""How right is it? The closed forms of contact mechanics and the engine, on the same axes.

Runs the scenes, draws the figures of ``docs/how-right.md`` into ``docs/images`` and prints what is off by how much:

    python benchmarks/how_right.py
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullFormatter
from scipy.integrate import quad
from scipy.special import ellipe, ellipk

import quasirigid as qr

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "python" / "examples"))
import condensed_block  # an example, in no package

RADIUS = 0.05  # of the ball, m
DEPTH = 2e-4  # m: contact radius 3.16 mm
MU = 0.5
GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))
RIGID = (1e13, 0.3)

# Colours of Okabe and Ito.
BLUE, VERMILION, GREEN = "#0072B2", "#D55E00", "#009E73"
INK, MUTED, GRID = "#222222", "#666666", "#E3E3E0"


@dataclass(frozen=True)
class Pair:
    """Young's modulus (Pa) and Poisson's ratio of ball and flat, and how to draw them."""

    name: str
    ball: tuple[float, float]
    flat: tuple[float, float]
    colour: str
    marker: str


PAIRS = (
    Pair("soft ball, rigid flat", (1e6, 0.5), RIGID, BLUE, "o"),
    Pair("rigid ball, soft flat", RIGID, (1e6, 0.5), VERMILION, "^"),
    Pair("alike", (1e6, 0.3), (1e6, 0.3), GREEN, "s"),
)


@dataclass(frozen=True)
class Hertz:
    """A ball of ``RADIUS`` pressed by ``depth`` (m) into a flat; K. L. Johnson, Contact Mechanics, sections 4.2 and 7.2 to 7.4."""

    pair: Pair
    depth: float = DEPTH

    @property
    def a(self) -> float:
        """Contact radius, m."""
        return float(np.sqrt(RADIUS * self.depth))

    @property
    def P(self) -> float:
        """Normal force, N."""
        e_star = 1 / sum((1 - nu**2) / e for e, nu in (self.pair.ball, self.pair.flat))
        return float(4 / 3 * e_star * np.sqrt(RADIUS) * self.depth**1.5)

    @property
    def p0(self) -> float:
        """Largest pressure, Pa."""
        return 1.5 * self.P / (np.pi * self.a**2)

    @property
    def full_slip(self) -> float:
        """Shift at which all slips, m: 3 mu P / (16 a G*), 1/G* = sum (2 - nu) / G."""
        over_g_star = sum((2 - nu) * 2 * (1 + nu) / e for e, nu in (self.pair.ball, self.pair.flat))
        return 3 * MU * self.P / (16 * self.a) * over_g_star

    @property
    def G(self) -> float:
        """Shear modulus of both in series, Pa."""
        return 1 / sum(2 * (1 + nu) / e for e, nu in (self.pair.ball, self.pair.flat))


class Indentation:
    """A ball on a flat; the ball carries the control points and is moved."""

    def __init__(self, pair: Pair, friction: float, control_points: int) -> None:
        reach = 1.6 * np.sqrt(RADIUS * DEPTH)
        self.world = qr.World(gravity=(0, 0, 0), contact_margin=1e-6)
        soft = qr.Material.preset("silicone").replace(friction=friction, relaxation_time=0.0, compliance="half-space")
        ball, flat = (soft.replace(young_modulus=e, poisson_ratio=nu) for e, nu in (pair.ball, pair.flat))
        # A cap of the ball on a Fibonacci spiral, its pole down.
        n = 8 * control_points
        height = 1 - np.sqrt(1 - (reach / RADIUS) ** 2)
        cosine = 1 - height * (np.arange(n) + 0.5) / n
        sine, angle = np.sqrt(1 - cosine**2), GOLDEN_ANGLE * np.arange(n)
        normals = np.stack([sine * np.cos(angle), -sine * np.sin(angle), -cosine], axis=1)
        areas = np.full(n, 2 * np.pi * RADIUS**2 * height / n)
        cap = qr.Surface.from_points(RADIUS * normals, normals, areas, control_points=control_points)
        self.spacing = float(np.sqrt(cap.area / control_points))
        self.ball = self.world.add_body(cap, ball, motion="fixed", position=(0, 0, RADIUS))
        # Two fixed bodies do not meet: the flat is held by a spring that gives by nothing to speak of.
        plane = qr.Surface.half_space(2 * reach, points=4 * control_points, control_points=control_points // 2)
        self.flat = self.world.add_body(plane, flat, mass=qr.MassProperties.sphere(reach, mass=1.0))
        self.flat.set_drive((0, 0, 0), stiffness=(1e12, 1e10), damping=(0, 0))

    def move(self, depth: float, shift: float = 0.0, twist: float = 0.0) -> qr.Contacts:
        """One step to ``depth`` and ``shift`` along (0.8, 0.6) (m), turned by ``twist`` (rad)."""
        place = (0.8 * shift, 0.6 * shift, RADIUS - depth)
        self.ball.move_to(place, (np.cos(twist / 2), 0, 0, np.sin(twist / 2)))
        report = self.world.step()
        if not report.converged:
            raise RuntimeError(f"the solver stopped at a residual of {report.residual:.1e}")
        return self.world.contacts()

    def press(self, depth: float = DEPTH) -> qr.Contacts:
        """Presses, and a step at rest, as a step sees the geometry of its start."""
        self.move(depth)
        return self.move(depth)


def hertz_figure() -> Figure:
    """Force over depth, pressure over radius."""
    figure = _figure("Hertz: a sphere pressed on a flat", "half-space model, 8 points for each control point")
    left, right = figure.subplots(1, 2)
    depths = np.linspace(0.0, 1.3 * DEPTH, 200)
    for k, pair in enumerate(PAIRS):
        scene = Indentation(pair, 0.0, 800)
        scale = Hertz(pair).P
        found = []
        for depth in (np.arange(1, 11) + 0.25 * (k - 1)) * 1.2 * DEPTH / 10:
            contacts = scene.press(depth)
            found.append((depth, contacts.forces[:, 2].sum() if contacts.body_a[0] == scene.ball.index else -contacts.forces[:, 2].sum()))
        depth, force = np.array(found).T
        error = force / np.array([Hertz(pair, d).P for d in depth]) - 1
        _tell(f"Hertz, {pair.name}: force off by at most", 100 * np.abs(error).max(), "%")
        left.plot(1e3 * depth, force / scale, pair.marker, color=pair.colour, markersize=5, markerfacecolor="none", label=pair.name)
        contacts = scene.press()
        hertz = Hertz(pair)
        r = np.hypot(*contacts.points[:, :2].T) / hertz.a
        pressure = contacts.pressures / hertz.p0
        look = {"color": pair.colour, "markersize": 3.5, "markerfacecolor": "none", "markeredgewidth": 0.8}
        right.plot(r[k::3], pressure[k::3], pair.marker, **look)
        inner = r < 0.9
        off = np.abs(pressure - np.sqrt(np.maximum(1 - r**2, 0)))
        _tell(f"Hertz, {pair.name}: pressure within 0.9 a off by at most", 100 * off[inner].max(), "% of p0")
        radius = np.sqrt(contacts.areas[contacts.reactions[:, 0] > 0].sum() / np.pi)
        _tell(f"Hertz, {pair.name}: contact radius off by", abs(radius - hertz.a) / scene.spacing, "control spacings")
    left.plot(1e3 * depths, (depths / DEPTH) ** 1.5, color=INK, linewidth=1.2, zorder=0, label="Hertz")
    r = np.linspace(0, 1, 400)
    right.plot(np.append(r, 1.3), np.append(np.sqrt(1 - r**2), 0), color=INK, linewidth=1.2, zorder=5)
    _dress(left, "depth (mm)", "force / Hertz's at 0.2 mm")
    _dress(right, "distance from the middle / a", "pressure / p0")
    right.set_xlim(0, 1.3)
    left.legend(frameon=False, fontsize=8.5)
    return figure


def convergence_figure() -> Figure:
    """Error of the force over the number of contacts."""
    figure = _figure("Sampling: what the number of contacts costs", "force at a depth of 0.2 mm", width=5.6)
    axes = figure.subplots()
    for pair in PAIRS:
        found = []
        for n in (60, 100, 150, 250, 400, 600, 1000, 1600):
            contacts = Indentation(pair, 0.0, n).press()
            found.append((np.count_nonzero(contacts.reactions[:, 0] > 0), abs(np.abs(contacts.forces[:, 2].sum()) / Hertz(pair).P - 1)))
        contacts_closed, error = np.array(found).T
        look = {"color": pair.colour, "markersize": 5, "markerfacecolor": "white", "linewidth": 0.9}
        axes.loglog(contacts_closed, 100 * error, pair.marker + "-", label=pair.name, **look)
        _tell(f"sampling, {pair.name}: force off with {contacts_closed[0]:.0f} contacts by", 100 * error[0], "%")
    axes.axhline(2, color=INK, linewidth=1.0, linestyle=(0, (4, 2)))
    axes.text(axes.get_xlim()[1], 2.15, "bound ", ha="right", va="bottom", fontsize=8, color=INK)
    _dress(axes, "contacts that carry load", "force off by (%)")
    for axis, ticks in ((axes.xaxis, (30, 100, 300, 600)), (axes.yaxis, (0.01, 0.1, 1))):
        axis.set_major_locator(FixedLocator(ticks))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())
    axes.set_ylim(0.001, 6)
    axes.legend(frameon=False, fontsize=8.5, loc="lower left")
    return figure


def loading(x: np.ndarray) -> np.ndarray:
    """T/(mu P) after a first push by x full slips (Mindlin; Johnson, eq. 7.42)."""
    return 1 - np.maximum(1 - x, 0) ** 1.5


def after_turn(x: np.ndarray, top: float) -> np.ndarray:
    """T/(mu P) at x after a turn at ``top`` (Mindlin and Deresiewicz; Johnson, eq. 7.48)."""
    return np.sign(top) * (loading(abs(top)) - 2 * loading(np.abs(top - x) / 2))


def cattaneo_mindlin_figure() -> Figure:
    """Tangential force over shift in a loop, and the stick radius."""
    figure = _figure("Cattaneo and Mindlin: the pressed ball is pushed sideways", "to 0.9 of full slip, back, and again")
    left, right = figure.subplots(1, 2)
    top = 0.9
    up, down = np.arange(1, 19) / 20, np.arange(17, -19, -1) / 20
    path = np.concatenate([up, down, -down])
    truth = np.concatenate([loading(up), after_turn(down, top), after_turn(-down, -top)])
    for k, pair in enumerate(PAIRS):
        hertz = Hertz(pair)
        scene = Indentation(pair, MU, 800)
        scene.press()
        force, stick = [], []
        for x in path:
            contacts = scene.move(DEPTH, x * hertz.full_slip)
            sign = -1 if contacts.body_a[0] == scene.ball.index else 1
            force.append(sign * (contacts.forces[:, :2] @ (0.8, 0.6)).sum() / (MU * hertz.P))
            stuck = (contacts.status == qr.ContactStatus.Stick) & (contacts.reactions[:, 0] > 0)
            stick.append(np.sqrt(contacts.areas[stuck].sum() / np.pi) / hertz.a)
        off = np.abs(np.array(force) - truth)
        _tell(f"Mindlin, {pair.name}: tangential force off by at most", 100 * off.max(), "% of mu P")
        _tell(f"Mindlin, {pair.name}: loop open by", 100 * abs(force[-1] - force[17]), "% of mu P")
        shown = slice(k, None, 3)
        look = {"color": pair.colour, "markersize": 4.5, "markerfacecolor": "none"}
        left.plot(path[shown], np.array(force)[shown], pair.marker, label=pair.name, **look)
        right.plot(np.array(force)[:18], stick[:18], pair.marker, **look)
        expected = np.cbrt(1 - loading(up))
        _tell(f"Cattaneo, {pair.name}: stick radius off by at most", 100 * np.abs(np.array(stick[:18]) - expected).max(), "% of a")
    x = np.linspace(0, top, 200)
    left.plot(x, loading(x), color=INK, linewidth=1.2, zorder=0, label="closed form")
    x = np.linspace(-top, top, 400)
    left.plot(x, after_turn(x, top), color=INK, linewidth=1.2, zorder=0)
    left.plot(x, after_turn(x, -top), color=INK, linewidth=1.2, zorder=0)
    t = np.linspace(0, 1, 400)
    right.plot(t, np.cbrt(1 - t), color=INK, linewidth=1.2, zorder=0)
    _dress(left, "shift / shift of full slip", r"tangential force / $\mu P$")
    _dress(right, r"tangential force / $\mu P$, first push", "stick radius / a")
    right.set_xlim(0, 1.02)
    right.set_ylim(0, 1.05)
    left.legend(frameon=False, fontsize=8.5, loc="upper left")
    return figure


def lubkin(c: float) -> tuple[float, float]:
    """Angle in mu P / (G a^2) and moment in mu P a at which the stick zone has the radius c a.

    Twist of a Hertz patch with slip outside c (Lubkin). A sum of stuck discs of radii s from c to a gives, by Abel's transform,

        angle = I(c) / (2 G),    M = 8/3 (c^3 I(c) + 3 integral_c^a s^2 I(s) ds),    I(s) = mu p0 (K(k) - E(k)),    k^2 = 1 - s^2/a^2.
    """
    p0 = 1.5 / np.pi

    def spread(s: float) -> float:
        return p0 * (ellipk(1 - s * s) - ellipe(1 - s * s))

    return spread(c) / 2, 8 / 3 * (c**3 * spread(c) + 3 * quad(lambda s: s * s * spread(s), c, 1)[0])


def torsion_figure() -> Figure:
    """Moment over angle of twist."""
    figure = _figure("Soft-finger torsion: the pressed ball is twisted", "about the normal through its middle", width=5.6)
    axes = figure.subplots()
    limit = 3 * np.pi / 16
    curve = np.array([lubkin(c) for c in np.concatenate([np.linspace(1, 0.02, 120), np.geomspace(0.02, 1e-4, 60)])])
    for k, pair in enumerate(PAIRS):
        hertz = Hertz(pair)
        scene = Indentation(pair, MU, 800)
        scene.press()
        unit = MU * hertz.P / (hertz.G * hertz.a**2)
        found = []
        for angle in np.linspace(0, 0.7, 36)[1:]:
            contacts = scene.move(DEPTH, twist=angle * unit)
            x, f = contacts.points, contacts.forces
            moment = abs((x[:, 0] * f[:, 1] - x[:, 1] * f[:, 0]).sum())
            found.append((angle, moment / (MU * hertz.P * hertz.a)))
        angle, moment = np.array(found).T
        expected = np.interp(angle, *curve.T)
        _tell(f"torsion, {pair.name}: moment off by at most", 100 * np.abs(moment / expected - 1).max(), "%")
        _tell(f"torsion, {pair.name}: moment at the last angle off its limit by", 100 * abs(moment[-1] / limit - 1), "%")
        axes.plot(angle[k::3], moment[k::3], pair.marker, color=pair.colour, markersize=5, markerfacecolor="none", label=pair.name)
    axes.plot(*curve[curve[:, 0] <= 0.72].T, color=INK, linewidth=1.2, zorder=0, label="Lubkin")
    axes.axhline(limit, color=INK, linewidth=1.0, linestyle=(0, (4, 2)))
    axes.text(0.0, limit + 0.008, r" $3\pi/16$", va="bottom", fontsize=8.5, color=INK)
    _dress(axes, r"angle $\cdot\, G a^2 / \mu P$", r"moment / $\mu P a$")
    axes.set_xlim(0, 0.72)
    axes.set_ylim(0, 0.68)
    axes.legend(frameon=False, fontsize=8.5, loc="lower right")
    return figure


def block_figure() -> Figure:
    """A condensed block of finite elements: pressure and force beside the half-space model and Hertz."""
    figure = _figure(
        "A block of finite elements, condensed to its surface",
        "rigid ball, block clamped at its bottom; half-space pressed deeper by what the ends hold back",
    )
    left, right = figure.subplots(1, 2)
    depths = (4.0, 8.0, 16.0)
    found = {depth: condensed_block.compare(depth) for depth in depths}
    one = found[8.0]
    scale = one.half_space_pressure.max()
    order = np.argsort(one.radius)
    r = one.radius[order] / condensed_block.CONTACT_RADIUS
    left.plot(r, one.half_space_pressure[order] / scale, color=INK, linewidth=1.2, label="half-space model")
    left.plot(
        r,
        one.pressure[order] / scale,
        "o",
        color=BLUE,
        markersize=3.5,
        markerfacecolor="none",
        markeredgewidth=0.8,
        label="block, 8 a deep",
    )
    hertz = condensed_block.hertz_force()
    right.plot(depths, [c.force / hertz for c in found.values()], "^", color=VERMILION, markerfacecolor="none", label="block / Hertz")
    right.plot(
        depths, [c.force_ratio for c in found.values()], "o", color=BLUE, markerfacecolor="none", label="block / half-space pressed deeper"
    )
    right.axhline(1, color=INK, linewidth=1.2, zorder=0)
    for depth, c in found.items():
        _tell(f"Block {depth:g} a deep: force, what its ends hold back taken off, off by", 100 * abs(c.force_ratio - 1), "%")
        _tell(f"Block {depth:g} a deep: pressure within 0.75 a off by at most", 100 * c.pressure_error, "% of p0")
        _tell(f"Block {depth:g} a deep: dent under a given pressure off by at most", 100 * c.dent, "% of its depth")
    _dress(left, "distance from the middle / a", "pressure / p0")
    left.set_xlim(0, 1.4)
    _dress(right, "depth of the block / a", "force / force")
    right.set_xlim(0, 18)
    right.set_ylim(0.9, 1.4)
    for axes in (left, right):
        axes.legend(frameon=False, fontsize=8.5)
    return figure


def _figure(title: str, subtitle: str, *, width: float = 9.0) -> Figure:
    figure = Figure(figsize=(width, 4.0), dpi=150, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(f"{title}\n", x=0.012, ha="left", fontsize=12, fontweight="bold", color=INK)
    figure.text(0.012, 0.915, subtitle, ha="left", va="top", fontsize=9, color=MUTED)
    return figure


def _dress(axes: Axes, xlabel: str, ylabel: str) -> None:
    axes.set_xlabel(xlabel, fontsize=9, color=INK)
    axes.set_ylabel(ylabel, fontsize=9, color=INK)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color("#999999")
    axes.tick_params(labelsize=8.5, colors=MUTED)
    axes.grid(color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)


def _tell(what: str, value: float, unit: str) -> None:
    print(f"{what} {value:.2f} {unit}")


def main() -> None:
    """Draw all figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    here = Path(__file__).resolve().parents[1]
    parser.add_argument("--out", type=Path, default=here / "docs" / "images", help="folder of the pictures (docs/images)")
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    figures = {
        "hertz": hertz_figure,
        "sampling": convergence_figure,
        "cattaneo-mindlin": cattaneo_mindlin_figure,
        "torsion": torsion_figure,
        "condensed-block": block_figure,
    }
    for name, draw in figures.items():
        draw().savefig(out / f"how-right-{name}.png")


if __name__ == "__main__":
    main()
