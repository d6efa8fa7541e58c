"""Stiffness of an axisymmetric elastic solid whose load and displacement go round the axis as a Fourier harmonic.

In cylindrical coordinates (r, phi, z), with harmonic n (0 pressed along the axis, 1 sheared across it):

    u_r = U(r, z) cos(n phi),    u_phi = V(r, z) sin(n phi),    u_z = W(r, z) cos(n phi)

so that three functions in the half-plane r >= 0 are all that is unknown. Quadrilaterals with nine nodes carry them, and within each the
change of volume is replaced by its projection on 1, r, z (mean dilatation, of first order): with nine nodes that is the pair Q2/P1, which
does not lock as Poisson's ratio tends to 1/2. T. J. R. Hughes, The Finite Element Method (1987), sections 4.4 and 4.5; O. C. Zienkiewicz
and R. L. Taylor, The Finite Element Method (2000), volume 1, chapter 9 (harmonics) and 12 (nearly incompressible).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import sparse

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.intp]

GAUSS, WEIGHTS = np.polynomial.legendre.leggauss(3)


@dataclass(frozen=True)
class Mesh:
    """A grid of nodes (2 m + 1, 2 k + 1) for m x k elements: the first index runs from the axis outwards, the second from the back to the
    surface.

    The first row of nodes is the axis, the first column the back, which is bonded to something rigid, and the last column the surface.
    """

    r: Array
    """(2 m + 1, 2 k + 1) m."""
    z: Array
    """(2 m + 1, 2 k + 1) m."""

    @property
    def numbers(self) -> Ints:
        """Number of every node, of the shape of ``r``; the unknowns of node i are 3 i (U), 3 i + 1 (V) and 3 i + 2 (W)."""
        return np.arange(self.r.size).reshape(self.r.shape)

    @property
    def surface(self) -> Ints:
        """Numbers of the nodes of the surface, from the axis outwards."""
        return self.numbers[:, -1]

    @property
    def surface_r(self) -> Array:
        """Their distances from the axis, m."""
        return self.r[:, -1]

    def elements(self) -> Ints:
        """(m k, 9) nodes of every element; a and b of node 3 a + b count along the first and the second index."""
        number = self.numbers
        rows, columns = number.shape
        return np.stack([number[a : rows - 2 + a : 2, b : columns - 2 + b : 2].ravel() for a in range(3) for b in range(3)], axis=1)


def quadratic(s: float) -> tuple[Array, Array]:
    """The three quadratic functions on -1, 0, 1 at s, and their slopes."""
    return np.array([s * (s - 1) / 2, 1 - s * s, s * (s + 1) / 2]), np.array([s - 0.5, -2 * s, s + 0.5])


def stiffness(mesh: Mesh, young_modulus: float, poisson_ratio: float, harmonic: int) -> sparse.csc_matrix:
    """Stiffness matrix, N/m, of all 3 unknowns of every node: u^T K u / 2 is the energy (J) of the whole body, integrated over phi."""
    shear = young_modulus / (2 * (1 + poisson_ratio))
    bulk = young_modulus / (3 * (1 - 2 * poisson_ratio))
    elements = mesh.elements()
    r, z = mesh.r.ravel()[elements], mesh.z.ravel()[elements]
    m, n = len(elements), harmonic
    around = 2 * np.pi if n == 0 else np.pi  # integral of cos^2 (and, but for n = 0, where nothing depends on it, sin^2) over phi
    # Stress of a change of shape over strain (rr, phi phi, zz, rz, r phi, phi z), with engineering shears.
    shape_modulus = np.diag([2 * shear] * 3 + [shear] * 3)
    shape_modulus[:3, :3] -= 2 * shear / 3
    element = np.zeros((m, 27, 27))
    volume = np.zeros((m, 3, 27))  # integral of (1, r - r_c, z - z_c) times the change of volume
    gram = np.zeros((m, 3, 3))
    for s, weight_s in zip(GAUSS, WEIGHTS, strict=True):
        for t, weight_t in zip(GAUSS, WEIGHTS, strict=True):
            (f, df), (g, dg) = quadratic(s), quadratic(t)
            N = np.outer(f, g).ravel()
            dN = np.stack([np.outer(df, g).ravel(), np.outer(f, dg).ravel()])
            jacobian = np.stack([r @ dN.T, z @ dN.T], axis=2)  # (m, 2 of s and t, 2 of r and z)
            gradient = np.linalg.solve(jacobian, np.broadcast_to(dN, (m, 2, 9)))
            radius = (r @ N)[:, None]
            weight = weight_s * weight_t * np.linalg.det(jacobian) * radius[:, 0] * around
            over_r = N / radius
            strain = np.zeros((m, 6, 9, 3))
            strain[:, 0, :, 0] = gradient[:, 0]
            strain[:, 1, :, 0], strain[:, 1, :, 1] = over_r, n * over_r
            strain[:, 2, :, 2] = gradient[:, 1]
            strain[:, 3, :, 0], strain[:, 3, :, 2] = gradient[:, 1], gradient[:, 0]
            strain[:, 4, :, 0], strain[:, 4, :, 1] = -n * over_r, gradient[:, 0] - over_r
            strain[:, 5, :, 1], strain[:, 5, :, 2] = gradient[:, 1], -n * over_r
            B = strain.reshape(m, 6, 27)
            element += weight[:, None, None] * (B.transpose(0, 2, 1) @ (shape_modulus @ B))
            psi = np.stack([np.ones(m), radius[:, 0] - r[:, 4], z @ N - z[:, 4]], axis=1)
            volume += weight[:, None, None] * psi[:, :, None] * B[:, None, :3].sum(axis=2)
            gram += weight[:, None, None] * psi[:, :, None] * psi[:, None, :]
    element += bulk * volume.transpose(0, 2, 1) @ np.linalg.solve(gram, volume)
    unknowns = (3 * elements[:, :, None] + np.arange(3)).reshape(m, 27)
    rows, columns = np.repeat(unknowns, 27, axis=1).ravel(), np.tile(unknowns, 27).ravel()
    return sparse.csc_matrix((element.ravel(), (rows, columns)), shape=(3 * mesh.r.size,) * 2)


def supported(mesh: Mesh, harmonic: int) -> npt.NDArray[np.bool_]:
    """(nodes, 3) which unknowns are 0: all of the back, V of harmonic 0 (no twist), and on the axis U of harmonic 0 and W of 1."""
    held = np.zeros((mesh.r.size, 3), dtype=bool)
    held[mesh.numbers[:, 0]] = True
    if harmonic == 0:
        held[:, 1] = True
        held[mesh.numbers[0], 0] = True
    else:
        held[mesh.numbers[0], 2] = True
    return held


def rings(mesh: Mesh, edges: int) -> tuple[Array, Array]:
    """What pressure on the first ``edges`` elements of the surface does to their nodes: forces (N) along the axis.

    Returns the integrals of N_i N_j dA (2 edges + 1, 2 edges + 1) m^2 and those of N_i dA over each element (2 edges + 1, edges) m^2, where
    dA is area across the axis: 2 pi r dr.
    """
    products, loads = np.zeros((2 * edges + 1,) * 2), np.zeros((2 * edges + 1, edges))
    points, weights = np.polynomial.legendre.leggauss(4)
    for k in range(edges):
        nodes = slice(2 * k, 2 * k + 3)
        r = mesh.surface_r[nodes]
        for s, weight in zip(points, weights, strict=True):
            N, dN = quadratic(s)
            area = weight * 2 * np.pi * (N @ r) * (dN @ r)
            products[nodes, nodes] += area * np.outer(N, N)
            loads[nodes, k] += area * N
    return products, loads
