"""Stiffness matrix of a mesh: linear elasticity, small strains.

Bricks are trilinear with three bubbles for each component (Wilson's incompatible modes, with the correction of R. L. Taylor, P. J.
Beresford and E. L. Wilson, A non-conforming element for stress analysis, 1976, by which bricks of any shape pass the patch test);
tetrahedra are quadratic. Neither locks at the Poisson's ratios of rubber and gels up to 0.49 or so.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy import sparse

from quasirigid.arrays.types import FloatArray
from quasirigid.errors import InvalidValueError
from quasirigid.pads.mesh import EDGES, PadMesh

__all__ = ["elasticity", "stiffness"]

SIGNS = np.array([(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)])
"""(8, 3) corners of the cube -1 <= s <= 1, in the order of a brick's."""


def elasticity(young_modulus: float, poisson_ratio: float) -> FloatArray:
    """(6, 6) Pa, stress (xx, yy, zz, yz, zx, xy) over strain with engineering shears. Raises ``InvalidValueError`` for what is no elastic
    material.
    """
    if not 0 < young_modulus < np.inf:
        raise InvalidValueError("young_modulus", "a number > 0, in Pa", young_modulus, "silicones have about 1e5 to 1e6 Pa")
    if not -1 < poisson_ratio < 0.5:
        raise InvalidValueError("poisson_ratio", "a number between -1 and 0.5", poisson_ratio, "rubber and gels have 0.45 to 0.49")
    lame = young_modulus * poisson_ratio / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio))
    shear = young_modulus / (2 * (1 + poisson_ratio))
    modulus = np.diag([2.0 * shear] * 3 + [shear] * 3)
    modulus[:3, :3] += lame
    return modulus


def stiffness(mesh: PadMesh, young_modulus: float, poisson_ratio: float) -> sparse.csr_matrix:
    """Stiffness matrix (3n, 3n) N/m; the unknowns of node i are 3 i + k along x, y, z.

    Raises ``InvalidValueError`` for elements without volume or turned inside out.
    """
    modulus = elasticity(young_modulus, poisson_ratio)
    bricks = mesh.elements.shape[1] == 8
    width = 3 * mesh.elements.shape[1]
    element = np.zeros((len(mesh.elements), width + 9 * bricks, width + 9 * bricks))
    for gradient, weight in (_brick_points if bricks else _tetrahedron_points)(mesh):
        B = _strain(gradient)
        element += weight[:, None, None] * (B.transpose(0, 2, 1) @ (modulus @ B))
    if bricks:  # the bubbles are an element's own: no force acts on them
        bubbles = element[:, width:, :width]
        element = element[:, :width, :width] - bubbles.transpose(0, 2, 1) @ np.linalg.solve(element[:, width:, width:], bubbles)
    unknowns = (3 * mesh.elements[:, :, None] + np.arange(3)).reshape(len(element), width)
    rows, columns = np.repeat(unknowns, width, axis=1).ravel(), np.tile(unknowns, width).ravel()
    return sparse.csr_matrix((element.ravel(), (rows, columns)), shape=(3 * len(mesh.points),) * 2)


def _strain(gradient: FloatArray) -> FloatArray:
    """(m, 6, 3 f) strain for each component of each of f functions, from their gradients (m, f, 3) 1/m."""
    m, f, _ = gradient.shape
    strain = np.zeros((m, 6, f, 3))
    for k in range(3):
        strain[:, k, :, k] = gradient[:, :, k]
        strain[:, 3 + k, :, (k + 1) % 3] = gradient[:, :, (k + 2) % 3]
        strain[:, 3 + k, :, (k + 2) % 3] = gradient[:, :, (k + 1) % 3]
    return strain.reshape(m, 6, 3 * f)


def _brick_points(mesh: PadMesh) -> Iterator[tuple[FloatArray, FloatArray]]:
    """At each of 2 x 2 x 2 Gauss points: gradients (m, 11, 3) 1/m of the shape functions and the bubbles, and what it weighs (m,) m^3."""
    corners = mesh.points[mesh.elements]
    middle = corners.transpose(0, 2, 1) @ (SIGNS / 8)  # (m, 3 of x, 3 of s): dx/ds in the middle
    at_middle, inverse = _jacobian(middle)
    for s in SIGNS / np.sqrt(3):
        # Shape function of corner a: prod_k (1 + S_ak s_k)/2; of bubble k: 1 - s_k^2.
        factors = (1 + SIGNS * s) / 2
        slope = np.stack([SIGNS[:, k] / 2 * factors[:, (k + 1) % 3] * factors[:, (k + 2) % 3] for k in range(3)], axis=1)
        volume, back = _jacobian(corners.transpose(0, 2, 1) @ slope)
        # Taylor: bubbles with the Jacobian of the middle, so that the integral of their gradients vanishes and a uniform stress does no
        # work on them.
        bubbles = (at_middle / volume)[:, None, None] * (np.diag(-2 * s) @ inverse)
        yield np.concatenate([slope @ back, bubbles], axis=1), volume


def _tetrahedron_points(mesh: PadMesh) -> Iterator[tuple[FloatArray, FloatArray]]:
    """At each of four Gauss points, exact for a strain that varies linearly: gradients (m, 10, 3) 1/m, and what it weighs (m,) m^3."""
    corners = mesh.points[mesh.corners]
    volume, back = _jacobian((corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1), either=True)
    barycentric = np.concatenate([-back.sum(axis=1, keepdims=True), back], axis=1)  # (m, 4, 3) gradients
    near, far = (5 + 3 * np.sqrt(5)) / 20, (5 - np.sqrt(5)) / 20
    for a in range(4):
        L = np.full(4, far)
        L[a] = near
        # Corners: L_i (2 L_i - 1); middles: 4 L_i L_j.
        at_corners = (4 * L - 1)[:, None] * barycentric
        i, j = EDGES.T
        at_middles = 4 * (L[i][:, None] * barycentric[:, j] + L[j][:, None] * barycentric[:, i])
        yield np.concatenate([at_corners, at_middles], axis=1), volume / 24


def _jacobian(dx: FloatArray, *, either: bool = False) -> tuple[FloatArray, FloatArray]:
    """Determinants (m,) and inverses (m, 3, 3) of dx/ds; the determinants are positive. ``either``: an element may be listed either way
    round.
    """
    determinant: FloatArray = np.linalg.det(dx).astype(np.float64)
    size = np.linalg.norm(dx, axis=1).prod(axis=1)
    if either:
        determinant = abs(determinant)
    bad = ~(determinant > 1e-9 * size)
    if bad.any():
        k = int(np.argmax(bad))
        got = f"{np.count_nonzero(bad)} elements of no or negative volume, the first of them element {k}"
        hint = "list four corners of a brick around one face, seen from inside turning left, and the four opposite in the same order"
        raise InvalidValueError("elements", "elements that have a volume", got, "look for nodes that coincide" if either else hint)
    return determinant, np.asarray(np.linalg.inv(dx), dtype=np.float64)
