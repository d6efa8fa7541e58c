"""A mesh of one's own, condensed to the surface of a pad: right beside closed forms and finite elements that are made otherwise, and
refused where it does not fit.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import quasirigid as qr
from quasirigid.pads.elements import stiffness
from quasirigid.pads.mesh import pad_mesh

Array = np.ndarray[Any, np.dtype[Any]]
REFERENCE = json.loads((Path(__file__).parent / "references" / "pads.json").read_text())
E = REFERENCE["young_modulus"]


def grid(x: Array, y: Array, z: Array) -> tuple[Array, Array]:
    """Nodes and bricks between planes."""
    points = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1)
    number = np.arange(points[..., 0].size).reshape(points.shape[:3])
    ends = [slice(None, -1), slice(1, None)]
    around = [(0, 0), (1, 0), (1, 1), (0, 1)]
    bricks = np.stack([number[ends[i], ends[j], k].ravel() for k in ends for i, j in around], axis=1)
    return points.reshape(-1, 3), bricks


def tetrahedra(bricks: Array) -> Array:
    """Six of each brick, all along the diagonal from its first corner to its seventh, so that neighbours fit together."""
    ring = [1, 2, 3, 7, 4, 5]
    return np.concatenate([bricks[:, [0, a, b, 6]] for a, b in zip(ring, [*ring[1:], ring[0]], strict=True)])


def graded(inner: float, step: float, end: float, growth: float) -> Array:
    """Planes from 0: steps of ``step`` up to ``inner``, then growing ones to ``end``."""
    planes = list(np.linspace(0, inner, round(inner / step) + 1))
    outer = [step * growth]
    while sum(outer) < end - inner:
        outer.append(outer[-1] * growth)
    return np.array(planes + list(inner + np.cumsum(outer) * (end - inner) / sum(outer)))


def patch(half: float, count: int, height: Any = None) -> qr.Surface:
    """(2 count)^2 control points on the square within ``half`` (m), four surface points each, on the plane or at ``height(x, y)``, with its
    slopes.

    A little longer along x: a tree that halves squares may halve them along a diagonal.
    """
    at = half * ((np.arange(4 * count) + 0.5) / (2 * count) - 1)
    x, y = (axis.ravel() for axis in np.meshgrid(1.02 * at, at, indexing="ij"))
    z, slope_x, slope_y = (0 * x, 0 * x, 0 * x) if height is None else height(x, y)
    normals = np.stack([-slope_x, -slope_y, np.ones_like(x)], axis=1)
    areas = 1.02 * (half / (2 * count)) ** 2 * np.linalg.norm(normals, axis=1)
    return qr.Surface.from_points(np.stack([x, y, z], axis=1), normals, areas, control_points=len(x) // 4)


def pressed(matrix: Array, surface: qr.Surface, gap: Array, depth: float, a: float) -> tuple[float, float]:
    """Force (N) along z of a rigid indenter without friction, and stiffness (N/m) along x of the control points within ``a`` (m) of the
    axis.
    """
    order = np.arange(len(matrix)).reshape(-1, 3)[:, [2, 0, 1]].ravel()  # normal first
    q = np.zeros(len(matrix))
    q[::3] = gap - depth
    found = qr.solve_contacts(matrix[np.ix_(order, order)], q, np.zeros(len(gap)))
    assert found.converged
    within = np.flatnonzero(np.hypot(*surface.control_points[:, :2].T) < a)
    across = (3 * within[:, None] + np.arange(2)).ravel()
    shear = np.linalg.solve(matrix[np.ix_(across, across)], np.tile([1.0, 0.0], len(within)))[::2].sum()
    # The discs of the control points cover a little more or less than that of radius a, whose stiffness is as its radius.
    return float(found.reactions[::3].sum()), float(shear * a / np.sqrt(surface.control_areas[within].sum() / np.pi))


@pytest.mark.parametrize("kind", ["bricks", "tetrahedra"])
def test_a_uniform_stretch_is_exact_in_elements_of_any_shape(kind: str) -> None:
    points, bricks = grid(*[np.linspace(0, 1, 4)] * 3)
    inner = ((points > 0.1) & (points < 0.9)).all(axis=1)
    points[inner] += np.random.default_rng(0).uniform(-0.08, 0.08, (inner.sum(), 3))
    mesh = pad_mesh(points, bricks if kind == "bricks" else tetrahedra(bricks), fixed=[])
    x = mesh.points
    free = ((x > 1e-9) & (x < 1 - 1e-9)).all(axis=1)
    u = x @ np.array([[1.0, 0.3, -0.2], [0.3, -0.5, 0.4], [-0.2, 0.4, 0.7]])
    force = (stiffness(mesh, 1e6, 0.45) @ u.ravel()).reshape(-1, 3)
    off = np.abs(force[free]).max() / np.abs(force).max()
    print(f"{kind}: inner nodes feel {off:.1e} of the largest force")
    assert off < 1e-12, off


@pytest.mark.parametrize(("kind", "most"), [("bricks", 1e-9), ("tetrahedra", 0.02)])
def test_a_pressure_on_all_of_a_pad_that_does_not_bulge_sinks_in_by_p_h_over_e(kind: str, most: float) -> None:
    side, h = 0.01, 0.004
    points, bricks = grid(1.02 * np.linspace(-side, side, 9), np.linspace(-side, side, 9), np.linspace(-h, 0, 4))
    surface = patch(side, 8)
    matrix = qr.pads.condense(
        points,
        bricks if kind == "bricks" else tetrahedra(bricks),
        young_modulus=E,
        poisson_ratio=0.0,
        fixed=points[:, 2] == -h,
        surface=surface,
    ).matrix
    sinking = matrix[2::3, 2::3] @ surface.control_areas  # under 1 Pa
    off = abs(sinking / (h / E) - 1).max()
    print(f"{kind}: sinking under a uniform pressure off by at most {off:.1e}")
    assert off < most, off


def test_a_quarter_and_its_mirror_images_are_the_whole() -> None:
    side, h = 0.01, 0.006
    half, z = np.array([0, 0.3, 0.65, 1.0]) * side, np.linspace(-h, 0, 3)
    surface = patch(0.8 * side, 3)
    whole, part = [
        qr.pads.condense(
            *grid(1.1 * x, x, z),
            young_modulus=E,
            poisson_ratio=0.45,
            fixed=grid(1.1 * x, x, z)[0][:, 2] == -h,
            surface=surface,
            mirrors=mirrors,
        ).matrix
        for x, mirrors in ((np.concatenate([-half[:0:-1], half]), ""), (half, "xy"))
    ]
    off = abs(part - whole).max() / abs(whole).max()
    print(f"quarter beside whole: {off:.1e}")
    assert off < 1e-11, off


def test_a_finer_mesh_than_the_surface_sinks_in_no_deeper() -> None:
    half, h, surface = 4e-3, 3e-3, patch(4e-3, 2)
    mean = []
    for fine in (4, 6):  # elements for each control point; surface points are half a control spacing apart
        step = half / 2 / fine
        points, bricks = grid(1.02 * graded(half, step, 8e-3, 1.8), graded(half, step, 8e-3, 1.8), -graded(2 * step, step, h, 1.5)[::-1])
        matrix = qr.pads.condense(
            points, bricks, young_modulus=E, poisson_ratio=0.45, fixed=points[:, 2] <= -0.999 * h, surface=surface, mirrors="xy"
        ).matrix
        mean.append(np.diag(matrix)[2::3].mean())
    off = mean[0] / mean[1] - 1
    print(f"own sinking of a control point, 4 elements beside 6: {off:+.1%}")
    assert abs(off) < 0.02, off


def test_a_ball_on_a_condensed_layer_is_that_on_the_reference() -> None:
    nu = 0.49
    case = next(c for c in REFERENCE["layers"] if (c["ball_radius"], c["thickness"], c["poisson_ratio"]) == (0.05, 0.005, nu))
    a, h, R = case["a"], case["thickness"], case["ball_radius"]
    half, count = 1.2 * a, 6
    step = half / count / 2  # two elements for each control point
    planes = graded(half, step, half + 2.5 * h, 1.6)
    points, bricks = grid(1.02 * planes, planes, -graded(2.8 * step, 0.7 * step, h, 1.35)[::-1])
    surface = patch(half, count)
    matrix = qr.pads.condense(
        points, bricks, young_modulus=E, poisson_ratio=nu, fixed=points[:, 2] <= -0.999 * h, surface=surface, mirrors="xy"
    ).matrix
    r = np.hypot(*surface.control_points[:, :2].T)
    force, shear = pressed(matrix, surface, R - np.sqrt(R**2 - r**2), case["depth"], a)
    print(f"nu {nu}: layer of bricks, force {force / case['F'] - 1:+.2%}, tangential stiffness {shear / case['k_t'] - 1:+.2%}")
    assert force == pytest.approx(case["F"], rel=0.025)
    assert shear == pytest.approx(case["k_t"], rel=0.025)


@pytest.mark.parametrize("kind", ["bricks", "tetrahedra"])
def test_a_plane_on_a_condensed_tip_is_that_on_the_reference(kind: str) -> None:
    case = next(c for c in REFERENCE["tips"] if (c["radius"], c["height"], c["depth"], c["poisson_ratio"]) == (0.01, 0.007, 0.0006, 0.45))
    R, H, a = case["radius"], case["height"], case["a"]
    half, count = 1.2 * a, 5
    # Half the unit cube, of which a quarter, becomes half a ball: see below. Finer where it is touched, around the middle of its upper
    # face.
    bricks_apiece = 2 if kind == "bricks" else 1
    step = half / R / count / bricks_apiece
    across = graded(half / R, step, 1.0, 1.6)
    p, bricks = grid(
        across, across, 1 - graded(4 * step, step, 1.0, 1.3)[::-1] if kind == "bricks" else 1 - graded(2 * step, step, 1.0, 1.5)[::-1]
    )
    u, v, w = p.T
    # The cube to the ball: x^2 + y^2 + z^2 = 1 wherever one of u, v, w is 1 (x = u sqrt(1 - v^2/2 - w^2/2 + v^2 w^2/3), and so on).
    x, y, z = (i * np.sqrt(1 - j**2 / 2 - k**2 / 2 + j**2 * k**2 / 3) for i, j, k in ((u, v, w), (v, w, u), (w, u, v)))
    points = np.stack([R * x, R * y, H * z], axis=1)

    def height(x: Array, y: Array) -> tuple[Array, Array, Array]:
        z = H * np.sqrt(1 - (x**2 + y**2) / R**2)
        return z, -(H**2) * x / (R**2 * z), -(H**2) * y / (R**2 * z)

    surface = patch(half, count, height)
    matrix = qr.pads.condense(
        points,
        bricks if kind == "bricks" else tetrahedra(bricks),
        young_modulus=E,
        poisson_ratio=0.45,
        fixed=w < 1e-9,
        surface=surface,
        mirrors="xy",
    ).matrix
    r = np.hypot(*surface.control_points[:, :2].T)
    force, shear = pressed(matrix, surface, H * (1 - np.sqrt(1 - (r / R) ** 2)), case["depth"], a)
    print(f"tip of {len(bricks)} {kind}: force {force / case['F'] - 1:+.2%}, tangential stiffness {shear / case['k_t'] - 1:+.2%}")
    assert force == pytest.approx(case["F"], rel=0.03)
    assert shear == pytest.approx(case["k_t"], rel=0.04)


POINTS, BRICKS = grid(*[np.linspace(-0.01, 0.01, 3)] * 2, np.linspace(-0.005, 0, 3))
FIXED = POINTS[:, 2] == -0.005
BAD: dict[str, tuple[dict[str, Any], type[qr.QuasirigidError], str]] = {
    "points of two": ({"points": POINTS[:, :2]}, qr.InvalidShapeError, r"points: .*\(n, 3\)"),
    "nan": ({"points": np.where(POINTS == 0.01, np.nan, POINTS)}, qr.InvalidValueError, "points: .*NaN"),
    "elements of six": ({"elements": BRICKS[:, :6]}, qr.InvalidShapeError, r"elements: .*\(m, 8\).*\(8, 6\)"),
    "no elements": ({"elements": BRICKS[:0]}, qr.InvalidShapeError, "elements: "),
    "floats": ({"elements": BRICKS + 0.5}, qr.InvalidValueError, "elements: .*whole numbers"),
    "ragged": ({"elements": [[0, 1, 2, 3], [0, 1]]}, qr.InvalidValueError, "elements: .*whole numbers"),
    "counted from 1": ({"elements": BRICKS + 1}, qr.InvalidValueError, "elements: .*27 points, from 0, got 27 in row 7"),
    "inside out": (
        {"elements": BRICKS[:, [4, 5, 6, 7, 0, 1, 2, 3]]},
        qr.InvalidValueError,
        "elements: .*8 elements of no or negative volume",
    ),
    "flat tetrahedra": ({"elements": BRICKS[:, :4]}, qr.InvalidValueError, "elements: .*of no or negative volume"),
    "short mask": ({"fixed": FIXED[:5]}, qr.InvalidShapeError, r"fixed: .*\(27,\).*\(5,\)"),
    "fixed out of range": ({"fixed": [0, 99]}, qr.InvalidValueError, "fixed: .*99"),
    "not held": ({"fixed": []}, qr.InvalidValueError, "fixed: .*hold the mesh"),
    "held on a line": ({"fixed": (POINTS[:, 2] == -0.005) & (POINTS[:, 0] == 0)}, qr.InvalidValueError, "fixed: .*3 of 27 nodes"),
    "E": ({"young_modulus": 0.0}, qr.InvalidValueError, "young_modulus: "),
    "nu": ({"poisson_ratio": 0.5}, qr.InvalidValueError, "poisson_ratio: "),
    "elsewhere": ({"surface": qr.Surface.sphere(0.02, points=200)}, qr.InvalidValueError, "surface: .*further off"),
    "mirrors": ({"mirrors": "xq"}, qr.InvalidValueError, "mirrors: "),
    "beyond the mirror": ({"mirrors": "x"}, qr.InvalidValueError, "mirrors: .*x >= 0"),
    "load": ({"load": "line"}, qr.InvalidValueError, "load: "),
}


@pytest.mark.parametrize("case", BAD)
def test_what_does_not_fit_is_refused_by_a_message_that_names_it(case: str) -> None:
    change, error, what = BAD[case]
    arguments: dict[str, Any] = {"points": POINTS, "elements": BRICKS, "young_modulus": E, "poisson_ratio": 0.4, "fixed": FIXED}
    arguments |= {"surface": qr.Surface.half_space(0.02, points=64, control_points=16)} | change
    with pytest.raises(error, match=what):
        qr.pads.condense(**arguments)
