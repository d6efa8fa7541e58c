"""Reference figures of soft layers and tips for the tests: what a pad gives way by, from finite elements of their own.

    python benchmarks/finite_elements/reference.py                      writes python/tests/references/pads.json, two minutes
    python benchmarks/finite_elements/reference.py --ball 50 0.2 3 0.45     one case: radius, depth, thickness (mm), Poisson's ratio
    python benchmarks/finite_elements/reference.py --tip 10 7 0.3 0.45      one case: radius, height, depth (mm), Poisson's ratio

Young's modulus is 1 MPa; forces, pressures and stiffnesses are proportional to it.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np
from contact import Curve, Gap, Soft, ball, checked, plane_on_tip, shear_stiffness
from elements import Mesh
from meshes import COARSE, Fineness, layer, tip

YOUNG_MODULUS = 1e6  # Pa
POISSON_RATIOS = (0.3, 0.45, 0.49)
LAYERS = ((50, 0.2, 3), (50, 0.2, 5), (50, 0.2, 10), (10, 0.3, 3), (10, 0.3, 5), (10, 0.3, 10))
"""Radius of the ball, depth, thickness of the layer, mm."""
TIPS = {(9, 9): (0.15, 0.308, 0.615, 0.844, 1.1), (10, 7): (0.15, 0.3, 0.6, 0.85, 1.1), (8, 10): (0.15, 0.3, 0.6, 0.85, 1.1)}
"""By radius and height (mm) of the half of an ellipsoid: depths, mm. The second is about as wide and as high as the built-in fingertip."""
PLACE = Path(__file__).resolve().parents[2] / "python" / "tests" / "references" / "pads.json"
MEANING = {
    "F": "force, N",
    "a": "contact radius, m",
    "p0": "pressure in the middle, Pa",
    "dF_dd": "growth of the force with the depth, N/m",
    "k_n": "stiffness along the axis of the disc r <= a, flat and free to slide, N/m; for contact without friction it is dF_dd",
    "k_t": "stiffness across the axis of the disc r <= a, free to rise and sink, N/m",
    "k_t_level": "the same, with the disc held in its plane, N/m",
}
Case = dict[str, float]


def figures(mesh: Callable[[float], Mesh], soft: Soft, gap: Gap, curve: Curve, depth: float) -> Case:
    """The figures of ``MEANING`` at a depth (m)."""
    found, step = curve.press(depth), 1e-3 * depth
    a = found.radius
    growth = (curve.press(depth + step).force - curve.press(depth - step).force) / (2 * step)
    rim = mesh(a)
    touch = checked(rim, soft, gap, depth, a)
    if max(touch.tension, touch.overlap) > 1e-3:
        raise RuntimeError(f"not the contact at a depth of {depth:g} m: {touch}")
    k_t, level = (shear_stiffness(rim, soft, a, level=level) for level in (False, True))
    return dict(zip(MEANING, (found.force, a, touch.peak, growth, touch.flat_stiffness, k_t, level), strict=True))


def pressed_layer(ball_radius: float, depth: float, thickness: float, nu: float, fine: Fineness) -> Case:
    """A ball on a layer; lengths in m."""
    soft, gap, hertz = Soft(YOUNG_MODULUS, nu), ball(ball_radius), np.sqrt(ball_radius * depth)
    mesh = lambda a: layer(thickness, a, fine)  # noqa: E731
    # Hertz has sqrt(R d); a compressible thin layer sqrt(2 R d), an incompressible one 2 sqrt(R d).
    return figures(mesh, soft, gap, Curve(mesh, soft, gap, 0.8 * hertz, 2.1 * hertz, 6), depth)


def pressed_tip(radius: float, height: float, depths: list[float], nu: float, fine: Fineness) -> list[Case]:
    """A plane on a tip, at several depths; lengths in m."""
    soft, gap = Soft(YOUNG_MODULUS, nu), plane_on_tip(radius, height)
    mesh = lambda a: tip(radius, height, a, fine)  # noqa: E731
    smallest, largest = (np.sqrt(radius**2 / height * d) for d in (min(depths), max(depths)))
    curve = Curve(mesh, soft, gap, 0.7 * smallest, min(1.4 * largest, 0.65 * radius), 8)
    return [figures(mesh, soft, gap, curve, depth) for depth in depths]


def layers(fine: Fineness) -> Iterator[Case]:
    """All of ``LAYERS``."""
    for nu in POISSON_RATIOS:
        for case in LAYERS:
            R, d, h = (round(1e-3 * length, 9) for length in case)
            yield {"ball_radius": R, "depth": d, "thickness": h, "poisson_ratio": nu, **pressed_layer(R, d, h, nu, fine)}


def tips(fine: Fineness) -> Iterator[Case]:
    """All of ``TIPS``."""
    for (radius, height), depths in TIPS.items():
        for nu in POISSON_RATIOS:
            R, H, *d = (round(1e-3 * length, 9) for length in (radius, height, *depths))
            for depth, found in zip(d, pressed_tip(R, H, d, nu, fine), strict=True):
                yield {"radius": R, "height": H, "depth": depth, "poisson_ratio": nu, **found}


def rounded(case: Case) -> Case:
    """Six digits."""
    return {name: float(f"{value:.6g}") for name, value in case.items()}


def all_figures() -> dict[str, object]:
    """What the file holds."""
    made = {name: [list(make(fine)) for fine in (Fineness(), COARSE)] for name, make in (("layers", layers), ("tips", tips))}
    off = {
        name: {what: float(f"{max(abs(c[what] / f[what] - 1) for f, c in zip(*both, strict=True)):.2g}") for what in MEANING}
        for name, both in made.items()
    }
    return {
        "about": "a rigid ball pressed on a layer bonded to a rigid backing; a rigid plane pressed on half an ellipsoid bonded at its flat"
        " back; small strains, no friction",
        "command": "python benchmarks/finite_elements/reference.py",
        "units": "SI: m, N, Pa, N/m",
        "meaning": MEANING,
        "young_modulus": YOUNG_MODULUS,
        "mesh": asdict(Fineness()),
        "largest relative difference to a mesh": asdict(COARSE),
        "is": off,
        **{name: [rounded(case) for case in both[0]] for name, both in made.items()},
    }


def main() -> None:
    """Writes the file, or prints one case."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ball", type=float, nargs=4, metavar=("RADIUS", "DEPTH", "THICKNESS", "NU"), help="a ball on a layer; mm")
    parser.add_argument("--tip", type=float, nargs=4, metavar=("RADIUS", "HEIGHT", "DEPTH", "NU"), help="a plane on a tip; mm")
    options = parser.parse_args()
    if options.ball or options.tip:
        x, y, z, nu = options.ball or options.tip
        lengths = 1e-3 * x, 1e-3 * y, 1e-3 * z
        case = pressed_layer(*lengths, nu, Fineness()) if options.ball else pressed_tip(*lengths[:2], [lengths[2]], nu, Fineness())[0]
        for name, meaning in MEANING.items():
            print(f"{name:10} {case[name]:12.6g}  {meaning}")
        return
    PLACE.parent.mkdir(exist_ok=True)
    PLACE.write_text(json.dumps(all_figures(), indent=1) + "\n")
    print(f"written to {PLACE}")


if __name__ == "__main__":
    main()
