"""Where points lie on the boundary of a mesh, and how they move with its nodes."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from quasirigid._quasirigid import Surface
from quasirigid.arrays.types import FloatArray, IntArray
from quasirigid.pads.mesh import PadMesh

__all__ = ["interpolation", "shares"]


def shares(surface: Surface) -> sparse.csr_matrix:
    """(control points, points of the surface): what share of the area of a control point each point stands for; rows sum to 1.

    A point belongs to the control point that is nearest.
    """
    owner = cKDTree(surface.control_points).query(surface.points)[1]
    count = len(surface.control_points)
    areas = sparse.csr_matrix((surface.areas, (owner, np.arange(len(owner)))), shape=(count, len(owner)))
    total = np.asarray(areas.sum(axis=1)).ravel()
    nearest = cKDTree(surface.points).query(surface.control_points)[1]
    alone = np.flatnonzero(total == 0)  # nearest to no point: the other way round
    areas = areas + sparse.csr_matrix((np.ones(len(alone)), (alone, nearest[alone])), shape=areas.shape)
    total[alone] = 1.0
    return sparse.csr_matrix(sparse.diags(1 / total) @ areas)


def interpolation(mesh: PadMesh, places: FloatArray, skip: FloatArray) -> tuple[sparse.csr_matrix, FloatArray]:
    """How points (p, 3) m move with the nodes of the boundary nearest to them: weights (p, n), which sum to 1 for each, and their distances
    (p,) m.

    Faces with all nodes within ``skip[k]`` (3,) m of the plane ``x[k] = 0`` are no boundary; a negative one leaves none out.
    """
    faces = mesh.boundary
    on_mirror = np.all(abs(mesh.points[faces]) <= skip, axis=1)  # (f, 3)
    faces = faces[~np.any(on_mirror, axis=1)]
    quads = faces.shape[1] == 4
    triangles = np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]]) if quads else faces[:, :3]
    number, L = _nearest(mesh.points[triangles], places)
    on = (L[:, :, None] * mesh.points[triangles[number]]).sum(axis=1)
    distance = np.linalg.norm(on - places, axis=1)
    nodes = faces[number % len(faces)]
    weights = _bilinear(mesh.points[nodes], on) if quads else np.concatenate([L * (2 * L - 1), 4 * L * np.roll(L, -1, axis=1)], axis=1)
    rows = np.repeat(np.arange(len(places)), nodes.shape[1])
    return sparse.csr_matrix((weights.ravel(), (rows, nodes.ravel())), shape=(len(places), len(mesh.points))), distance


def _nearest(triangles: FloatArray, places: FloatArray) -> tuple[IntArray, FloatArray]:
    """The nearest of the triangles (t, 3, 3) for each of the points (p, 3), and the barycentric coordinates (p, 3) of the nearest place on
    it.
    """
    number, best = np.zeros(len(places), dtype=np.int64), np.zeros((len(places), 3))
    chunk = max(1, 200_000 // len(triangles))
    for start in range(0, len(places), chunk):
        part = slice(start, start + chunk)
        L = _closest(triangles, places[part])
        on = np.einsum("ptk,tkx->ptx", L, triangles)
        found = ((on - places[part, None]) ** 2).sum(axis=2).argmin(axis=1)
        number[part], best[part] = found, L[np.arange(len(found)), found]
    return number, best


def _closest(triangles: FloatArray, places: FloatArray) -> FloatArray:
    """Barycentric coordinates (p, t, 3) of the place on every triangle that is closest to every point."""
    a, b, c = triangles.transpose(1, 0, 2)
    ab, ac = b - a, c - a
    ap = places[:, None] - a
    bb, cc, bc = (ab * ab).sum(-1), (ac * ac).sum(-1), (ab * ac).sum(-1)
    pb, pc = (ap * ab).sum(-1), (ap * ac).sum(-1)
    area = np.maximum(bb * cc - bc * bc, 1e-300)
    v, w = (cc * pb - bc * pc) / area, (bb * pc - bc * pb) / area
    inside = np.stack([1 - v - w, v, w], axis=-1)
    best, least = inside, np.where((inside >= 0).all(axis=-1), -1.0, np.inf)
    for k in range(3):  # on the edge from corner k to the next
        p, q = triangles[:, k], triangles[:, (k + 1) % 3]
        t = np.clip(((places[:, None] - p) * (q - p)).sum(-1) / np.maximum(((q - p) ** 2).sum(-1), 1e-300), 0, 1)
        away = ((places[:, None] - p - t[..., None] * (q - p)) ** 2).sum(-1)
        edge = np.zeros_like(inside)
        edge[..., k], edge[..., (k + 1) % 3] = 1 - t, t
        nearer = away < least
        best, least = np.where(nearer[..., None], edge, best), np.where(nearer, away, least)
    return best


def _bilinear(corners: FloatArray, places: FloatArray) -> FloatArray:
    """Weights (p, 4) of the corners (p, 4, 3) of a quadrilateral each at places (p, 3) on it, by Gauss and Newton."""
    sign = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    s = np.zeros((len(places), 2))
    for _ in range(20):
        factors = (1 + sign * s[:, None]) / 2  # (p, 4, 2)
        off = places - (factors.prod(axis=2)[:, :, None] * corners).sum(axis=1)
        slope = np.stack([sign[:, 0] / 2 * factors[:, :, 1], sign[:, 1] / 2 * factors[:, :, 0]], axis=1) @ corners  # (p, 2, 3)
        square = slope @ slope.transpose(0, 2, 1)
        s = np.clip(s + np.linalg.solve(square, (slope @ off[:, :, None]))[:, :, 0], -1, 1)
    return np.asarray(((1 + sign * s[:, None]) / 2).prod(axis=2))
