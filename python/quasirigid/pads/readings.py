"""Where points lie on the boundary of a mesh, and how they move with its nodes."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from quasirigid._quasirigid import Surface
from quasirigid.arrays.types import FloatArray, IntArray
from quasirigid.pads.mesh import PadMesh

__all__ = ["cells", "interpolation"]


FINEST = 8
"""A surface point is spread over at most so many places along either side of what it stands for."""


def cells(mesh: PadMesh, surface: Surface) -> tuple[FloatArray, sparse.csr_matrix]:
    """Places (q, 3) m that cover the surface, two to each face of the mesh or more, and what share (m, q) of a control point each stands
    for.

    A surface point belongs to the control point that is nearest, and stands for a square of its area, across its normal, with places spread
    over it evenly. Points alone would be forces on single nodes where the mesh is finer than they are, and sink in without bound as it is
    made finer. Shares of a control point sum to 1.
    """
    owner = cKDTree(surface.control_points).query(surface.points)[1]
    areas, normals = surface.areas.copy(), surface.normals
    alone = np.setdiff1d(
        np.arange(len(surface.control_points)), owner
    )  # nearest to no point: themselves, without taking any area from others
    points = np.concatenate([surface.points, surface.control_points[alone]])
    owner, areas = np.concatenate([owner, alone]), np.concatenate([areas, surface.control_areas[alone]])
    normals = np.concatenate([normals, surface.control_normals[alone]])
    sides = np.sqrt(areas)
    corners = mesh.points[mesh.boundary[:, :4] if mesh.boundary.shape[1] == 4 else mesh.boundary[:, :3]]
    edge = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).min(axis=1)
    nearest = cKDTree(corners.mean(axis=1)).query(points)[1]
    apiece = int(np.clip(np.ceil(2 * (sides / edge[nearest]).max() - 1e-6), 1, FINEST))
    # Two directions across the normal: along x of the body as nearly as can be, so that grids along the axes stay grids.
    first = np.eye(3)[np.where(abs(normals[:, 0]) < 0.9, 0, 1)]
    first -= (first * normals).sum(axis=1, keepdims=True) * normals
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normals, first)
    offsets = (np.arange(apiece) + 0.5) / apiece - 0.5
    u, v = (axis.ravel() for axis in np.meshgrid(offsets, offsets))
    across = u[:, None] * first[:, None] + v[:, None] * second[:, None]  # (points, apiece^2, 3), in sides
    places = (points[:, None] + sides[:, None, None] * across).reshape(-1, 3)
    weights = np.repeat(areas, apiece**2) / apiece**2
    owners = np.repeat(owner, apiece**2)
    total = np.bincount(owners, weights)
    share = sparse.csr_matrix((weights / total[owners], (owners, np.arange(len(owners)))), shape=(len(total), len(owners)))
    return places, share


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

    Those with the nearest middles are tried first. No other is nearer than its middle is, less its radius; where that does not settle it,
    all are tried.
    """
    middles = triangles.mean(axis=1)
    radius = np.linalg.norm(triangles - middles[:, None], axis=2).max(axis=1)
    tree, count = cKDTree(middles), min(24, len(triangles))
    reach = tree.query(places)[0].max()
    near = cKDTree(places).query(middles)[0] <= reach + radius  # all others are further from every point than the nearest middle
    distance, candidates = tree.query(places, count)
    distance, candidates = distance.reshape(-1, count), candidates.reshape(-1, count)
    number, best, away = _best(triangles, candidates, places)
    unsettled = np.flatnonzero(away > distance[:, -1] - radius[near].max()) if count < len(triangles) else np.zeros(0, np.int64)
    others = np.flatnonzero(near)
    step = max(1, 200_000 // len(others))
    for start in range(0, len(unsettled), step):
        part = unsettled[start : start + step]
        number[part], best[part], _ = _best(triangles, np.broadcast_to(others, (len(part), len(others))), places[part])
    return number, best


def _best(triangles: FloatArray, candidates: IntArray, places: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Of the candidates (p, c) of each point (p, 3): the nearest triangle, the place on it, and how far that is."""
    tried = triangles[candidates]  # (p, c, 3, 3)
    L = _closest(tried, places)
    distance = np.linalg.norm((L[..., None] * tried).sum(axis=2) - places[:, None], axis=2)
    found, all_points = distance.argmin(axis=1), np.arange(len(places))
    return candidates[all_points, found], L[all_points, found], distance[all_points, found]


def _closest(triangles: FloatArray, places: FloatArray) -> FloatArray:
    """Barycentric coordinates (p, c, 3) of the place on each of the triangles (p, c, 3, 3) that is closest to the point (p, 3)."""
    a, b, c = triangles[:, :, 0], triangles[:, :, 1], triangles[:, :, 2]
    ab, ac = b - a, c - a
    ap = places[:, None] - a
    bb, cc, bc = (ab * ab).sum(-1), (ac * ac).sum(-1), (ab * ac).sum(-1)
    pb, pc = (ap * ab).sum(-1), (ap * ac).sum(-1)
    area = np.maximum(bb * cc - bc * bc, 1e-300)
    v, w = (cc * pb - bc * pc) / area, (bb * pc - bc * pb) / area
    inside = np.stack([1 - v - w, v, w], axis=-1)
    best, least = inside, np.where((inside >= 0).all(axis=-1), -1.0, np.inf)
    for k in range(3):  # on the edge from corner k to the next
        p, q = triangles[:, :, k], triangles[:, :, (k + 1) % 3]
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
