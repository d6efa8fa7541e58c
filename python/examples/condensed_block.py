"""A finite-element block as the soft side of a contact: condense it to its surface, press a ball on it, compare with Hertz.

    python python/examples/condensed_block.py

A surface knows nothing of what lies below it but its compliance: how far each control point gives under a force at each. For a
finite-element model that is a part of the inverse of its stiffness matrix, and any symmetric positive semidefinite matrix will do. Here it is a block of
trilinear bricks, clamped at the bottom. The deeper the block against the patch, the nearer it comes to an elastic half-space, and Hertz.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy import linalg, sparse
from scipy.spatial import cKDTree

import quasirigid as qr

RADIUS = 0.05  # of the ball, m
DEPTH = 2e-4  # of the ball below first contact, m
CONTACT_RADIUS = float(np.sqrt(RADIUS * DEPTH))  # Hertz, m
YOUNG_MODULUS, POISSON_RATIO = 1e6, 0.3  # of the block
Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Bricks:
    """A block of bricks below z = 0: the coordinates (m) of the planes of nodes along each axis, ascending; z ends at 0."""

    x: Array
    y: Array
    z: Array

    @classmethod
    def graded(cls, depth: float, fine: float, element: float) -> Bricks:
        """A block ``depth`` m deep and twice as wide: elements of ``element`` m, half as high, within ``fine`` m of the middle of the top, then growing outwards."""
        out = _graded(depth, fine, element)
        across = np.concatenate([-out[:0:-1], out])
        return cls(across, across, -_graded(depth, fine, element / 2)[::-1])

    @property
    def shape(self) -> tuple[int, int, int]:
        """Nodes along x, y and z; node (i, j, k) has the number ``(i * ny + j) * nz + k``."""
        return len(self.x), len(self.y), len(self.z)

    def corners(self) -> npt.NDArray[np.intp]:
        """Numbers of the 8 nodes of every brick, (bricks, 8): the last axis runs over (0 or 1) along x, then y, then z."""
        nx, ny, nz = self.shape
        number = np.arange(nx * ny * nz).reshape(nx, ny, nz)
        ends = [slice(None, -1), slice(1, None)]
        return np.stack([number[i, j, k].ravel() for i in ends for j in ends for k in ends], axis=1)

    def stiffness(self, young_modulus: float, poisson_ratio: float) -> sparse.csc_matrix:
        """Stiffness matrix of linear elasticity, N/m: 2 x 2 x 2 Gauss points in every trilinear brick."""
        lame = young_modulus * poisson_ratio / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio))
        shear = young_modulus / (2 * (1 + poisson_ratio))
        steps = np.meshgrid(*(np.diff(axis) for axis in (self.x, self.y, self.z)), indexing="ij")
        size = np.stack([step.ravel() for step in steps], axis=1)  # (bricks, 3) m
        sign = np.array([(i, j, k) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
        # Stress (xx, yy, zz, yz, zx, xy) over strain, with engineering shears.
        elasticity = np.diag([2.0 * shear] * 3 + [shear] * 3)
        elasticity[:3, :3] += lame
        element = np.zeros((len(size), 24, 24))
        for gauss in sign / np.sqrt(3):
            # Shape function of corner a: prod_k (1 + s_ak g_k)/2; its gradient, 1/m, in a brick of this size.
            factors = (1 + sign * gauss) / 2
            gradient = np.stack([sign[:, k] / 2 * factors[:, (k + 1) % 3] * factors[:, (k + 2) % 3] for k in range(3)], axis=1)
            g = 2 * gradient / size[:, None, :]
            strain = np.zeros((len(size), 6, 8, 3))
            for k in range(3):
                strain[:, k, :, k] = g[:, :, k]
                strain[:, 3 + k, :, (k + 1) % 3] = g[:, :, (k + 2) % 3]
                strain[:, 3 + k, :, (k + 2) % 3] = g[:, :, (k + 1) % 3]
            b = strain.reshape(len(size), 6, 24)
            element += (size.prod(axis=1) / 8)[:, None, None] * (b.transpose(0, 2, 1) @ (elasticity @ b))
        unknowns = (3 * self.corners()[:, :, None] + np.arange(3)).reshape(len(size), 24)
        rows, columns = np.repeat(unknowns, 24, axis=1).ravel(), np.tile(unknowns, 24).ravel()
        n = 3 * int(np.prod(self.shape))
        return sparse.csc_matrix((element.reshape(-1), (rows, columns)), shape=(n, n))

    def condensed(self, young_modulus: float, poisson_ratio: float) -> Array:
        """Stiffness of the nodes of the top, N/m, with the bottom clamped and the nodes between left to themselves: (3 nx ny, 3 nx ny).

        Static condensation, a layer of nodes at a time from the bottom up: what lies below the layer k gives it the stiffness
        ``S_k = K_kk - K_k,k-1 S_k-1^-1 K_k-1,k``, where K_kk holds the bricks on either side of the layer.
        """
        stiffness = self.stiffness(young_modulus, poisson_ratio)
        nx, ny, nz = self.shape
        layer = [(3 * (np.arange(nx * ny) * nz + k)[:, None] + np.arange(3)).ravel() for k in range(nz)]
        top = stiffness[layer[1]][:, layer[1]].toarray()
        for below, above in pairwise(layer[1:]):
            up = stiffness[below][:, above]
            top = stiffness[above][:, above].toarray() - up.T @ (_inverse(top) @ up)
        return top

    def on_top(self, points: Array) -> sparse.csr_matrix:
        """Bilinear interpolation from the nodes of the top to ``points`` (m, 3) on it, (m, nx ny)."""
        nx, ny, _ = self.shape
        rows, columns, weights = [], [], []
        for axis in (0, 1):
            planes = (self.x, self.y)[axis]
            cell = np.clip(np.searchsorted(planes, points[:, axis]) - 1, 0, len(planes) - 2)
            share = (points[:, axis] - planes[cell]) / (planes[cell + 1] - planes[cell])
            rows.append(cell)
            weights.append((1 - share, share))
        entries = []
        for i in (0, 1):
            for j in (0, 1):
                columns.append((rows[0] + i) * ny + rows[1] + j)
                entries.append(weights[0][i] * weights[1][j])
        at = np.tile(np.arange(len(points)), 4)
        return sparse.csr_matrix((np.concatenate(entries), (at, np.concatenate(columns))), shape=(len(points), nx * ny))


def _graded(length: float, fine: float, element: float) -> Array:
    """Planes from 0 to ``length``: evenly spaced up to ``fine``, then each step twice the last."""
    inner = np.linspace(0, fine, int(np.ceil(fine / element)) + 1)
    outer = [2 * element]
    while sum(outer) < length - fine:
        outer.append(2 * outer[-1])
    return np.concatenate([inner, fine + np.cumsum(outer) * (length - fine) / sum(outer)])


def _inverse(stiffness: Array) -> Array:
    """Inverse of a symmetric positive definite matrix."""
    factor, _ = linalg.lapack.dpotrf(stiffness, lower=True)
    inverse, _ = linalg.lapack.dpotri(factor, lower=True)
    return np.asarray(np.tril(inverse) + np.tril(inverse, -1).T)


def condensed(bricks: Bricks, surface: qr.Surface, young_modulus: float, poisson_ratio: float) -> Array:
    """Compliance (3m, 3m) m/N of the top of a block, clamped at its bottom, over the m control points of a surface that lies on it.

    The force of a control point is spread over the surface points around it, and its displacement is their mean: ``C = N K^-1 N^T``, symmetric and positive
    semidefinite whatever the mesh. Point forces would sink in the deeper the finer the mesh.
    """
    owner = cKDTree(surface.control_points).query(surface.points)[1]
    m = len(surface.control_points)
    share = surface.areas / np.bincount(owner, surface.areas, m)[owner]
    gather = sparse.csr_matrix((share, (owner, np.arange(len(surface)))), shape=(m, len(surface)))
    spread = sparse.kron(gather @ bricks.on_top(surface.points), np.eye(3), format="csr")  # N: (3m, 3 nodes of the top)
    return np.asarray(spread @ (_inverse(bricks.condensed(young_modulus, poisson_ratio)) @ spread.T))


def top_surface(control_points: int, side: float = 3.2 * CONTACT_RADIUS) -> qr.Surface:
    """The piece of the top that the ball may touch."""
    return qr.Surface.half_space(side, points=8 * control_points, control_points=control_points)


def press(surface: qr.Surface, material: qr.Material, depth: float = DEPTH) -> qr.Contacts:
    """Presses a rigid ball ``depth`` (m) into a surface at z = 0 and returns the contacts."""
    world = qr.World(gravity=(0, 0, 0))
    hard = qr.Material.preset("steel").replace(young_modulus=1e13, friction=0.0, compliance="half-space")
    angle = np.linspace(0, 0.12, 25)[1:]
    ring = [np.linspace(0, 2 * np.pi, 6 * k, endpoint=False) for k in range(1, len(angle) + 1)]
    normals = np.concatenate(
        [
            [(0, 0, -1)],
            *[np.stack([np.sin(a) * np.cos(r), np.sin(a) * np.sin(r), -np.cos(a) + 0 * r], 1) for a, r in zip(angle, ring, strict=True)],
        ]
    )
    cap = qr.Surface.from_points(RADIUS * normals, normals, control_points=len(surface.control_points) // 3)
    ball = world.add_body(cap, hard, motion="fixed", position=(0, 0, RADIUS))
    block = world.add_body(surface, material.replace(friction=0.0), mass=qr.MassProperties.sphere(0.01, mass=1.0))
    block.set_drive((0, 0, 0), stiffness=(1e12, 1e10), damping=(0, 0))
    for share in (0.5, 1, 1):
        ball.move_to((0, 0, RADIUS - share * depth))
        report = world.step(2)
    if not report.converged:
        raise RuntimeError(f"the solver stopped at a residual of {report.residual:.1e}")
    return world.contacts()


def block_material() -> qr.Material:
    """Rubber with the figures of the block, answering at once."""
    return qr.Material.preset("rubber").replace(young_modulus=YOUNG_MODULUS, poisson_ratio=POISSON_RATIO, relaxation_time=0.0)


def force(contacts: qr.Contacts) -> float:
    """Force between ball and block, N."""
    return float(abs(contacts.forces[:, 2].sum()))


def hertz_force(depth: float = DEPTH) -> float:
    """Force (N) of a rigid ball pressed into a half-space; Johnson, Contact Mechanics, section 4.2."""
    return float(4 / 3 * YOUNG_MODULUS / (1 - POISSON_RATIO**2) * np.sqrt(RADIUS) * depth**1.5)


def main() -> None:
    """Prints the force of blocks of several sizes beside that of a half-space and Hertz's."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--control-points", type=int, default=100, help="on the piece of the top that is touched (100)")
    parser.add_argument("--element", type=float, default=0.3, help="edge of the smallest bricks, contact radii (0.3)")
    parser.add_argument("--depths", type=float, nargs="+", default=[4, 8, 16], help="of the blocks, contact radii (4 8 16)")
    options = parser.parse_args()
    surface = top_surface(options.control_points)
    material = block_material()
    half_space = force(press(surface, material.replace(compliance="half-space")))
    print(f"half-space model: {half_space / hertz_force():.3f} of Hertz's force")
    for depth in options.depths:
        bricks = Bricks.graded(depth * CONTACT_RADIUS, 1.6 * CONTACT_RADIUS, options.element * CONTACT_RADIUS)
        matrix = condensed(bricks, surface, YOUNG_MODULUS, POISSON_RATIO)
        found = force(press(surface, material.replace(compliance=matrix)))
        print(f"block {depth:g} contact radii deep, {int(np.prod(bricks.shape))} nodes: {found / hertz_force():.3f} of Hertz's force")


if __name__ == "__main__":
    main()
