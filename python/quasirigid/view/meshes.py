"""Triangles through the points of a surface, and the shapes of a hand's links.

The vertices of every mesh of a surface are the surface's own points, so that a mesh yields exactly as the surface does.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull, Delaunay, QhullError, cKDTree

from quasirigid.view.scene import FloatArray, IntArray

SAGITTA = 3e-5
"""How far a thinned mesh may be from the surface, m."""
FLAT = 0.999
"""Normals whose cosine with their mean is above this all belong to one plane."""
CLOSED = 0.1
"""A surface whose mean normal is shorter is closed."""
LONGEST = 4.0
"""Triangles with an edge of more than so many spacings close a hole that the surface has."""
COCONE = np.cos(np.radians(67.5))
"""Sine of the half angle between tangent plane and dual edge, 22.5 degrees: Amenta, Choi, Dey and Leekha, 2000."""


def spacing_of(points: FloatArray) -> float:
    """Distance of a point to its neighbours, the median over the surface, m."""
    distance, _ = cKDTree(points).query(points[:: max(1, len(points) // 2000)], k=5)
    return float(np.median(distance[:, 1:]))


def triangulate(points: FloatArray, normals: FloatArray) -> IntArray:
    """Triangles (m, 3) between ``points`` (n, 3) m of a surface with outward unit ``normals`` (n, 3), outside counter-clockwise.

    A plane is triangulated in the plane; a surface that is seen whole from a point within, such as a box or a fingertip, on the
    sphere of directions from there; any other by the cocone of its Delaunay tetrahedra.
    """
    mean = normals.mean(axis=0)
    length = float(np.linalg.norm(mean))
    if length > 0.5 and (normals @ mean).min() > FLAT * length:
        faces = _in_plane(points, mean / length)
    else:
        star = _from_within(points, normals)
        if star is not None:
            # On a closed surface the normals cancel: there is no hole to keep open.
            return star if length < CLOSED else _without_long_edges(points, star)
        faces = _cocone(points, normals)
    return _outward(points, normals, _without_long_edges(points, faces))


def _in_plane(points: FloatArray, normal: FloatArray) -> IntArray:
    _, _, axes = np.linalg.svd(normal[None])
    return np.asarray(Delaunay(points @ axes[1:].T).simplices, dtype=np.int64)


def _from_within(points: FloatArray, normals: FloatArray) -> IntArray | None:
    """The convex hull of the directions in which the points are seen, if every point shows its inner side."""
    low, high = points.min(axis=0), points.max(axis=0)
    centre = 0.5 * (low + high)
    # An open surface, such as a pad: step back against the mean normal, behind its rim.
    mean = normals.mean(axis=0)
    for back in (0.0, 0.25, 0.5):
        rays = points - (centre - back * np.ptp(points @ mean) * mean)
        lengths = np.linalg.norm(rays, axis=1)
        if lengths.min() <= 0.0:
            continue
        rays /= lengths[:, None]
        if np.einsum("ij,ij->i", rays, normals).min() > 0.02:
            try:
                return _outward(rays, rays, np.asarray(ConvexHull(rays).simplices, dtype=np.int64))
            except QhullError:
                return None
    return None


def _cocone(points: FloatArray, normals: FloatArray) -> IntArray:
    """Delaunay triangles whose dual edge crosses the surface near each of their corners: it comes within 22.5 degrees of the tangent
    planes there (the cocone of Amenta, Choi, Dey and Leekha, *A simple algorithm for homeomorphic surface reconstruction*, 2000).
    """
    scale = np.ptp(points, axis=0).max()
    try:
        cells = Delaunay(points / scale, qhull_options="Qbb Qc Qz Q12")
    except QhullError:
        return np.zeros((0, 3), dtype=np.int64)
    corners = points[cells.simplices]
    # Circumcentre c: 2 (p_i - p_0) . (c - p_0) = |p_i - p_0|^2.
    edges = corners[:, 1:] - corners[:, :1]
    volume = np.linalg.det(edges)
    flat = np.abs(volume) < 1e-12 * scale**3
    edges[flat] = np.eye(3)
    centres = corners[:, 0] + np.linalg.solve(2.0 * edges, (edges**2).sum(axis=2)[..., None])[..., 0]
    middle = points.mean(axis=0)
    away = corners.mean(axis=1) - middle
    centres[flat] = corners[flat].mean(axis=1) + 1e3 * away[flat]
    cell, opposite = np.nonzero(np.arange(len(cells.simplices))[:, None] > cells.neighbors)  # each triangle once, those of the hull too
    keep = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
    faces = np.take_along_axis(cells.simplices[cell], keep[opposite], axis=1)
    other = cells.neighbors[cell, opposite]
    one = centres[cell]
    # Beyond a triangle of the hull the dual edge goes on for ever, away from the cell.
    inside = corners[cell, opposite]
    a, b, c = (points[faces[:, i]] for i in range(3))
    out = np.cross(b - a, c - a)
    out *= -np.sign(np.einsum("ij,ij->i", out, inside - a))[:, None] / np.maximum(np.linalg.norm(out, axis=1), 1e-300)[:, None]
    two = np.where((other < 0)[:, None], one + 1e3 * scale * out, centres[other])
    good = np.ones(len(faces), dtype=bool)
    for i in range(3):
        p, n = points[faces[:, i]], normals[faces[:, i]]
        ends = []
        for end in (one, two):
            ray = end - p
            ends.append(np.einsum("ij,ij->i", ray, n) / np.maximum(np.linalg.norm(ray, axis=1), 1e-300))
        low, high = np.minimum(*ends), np.maximum(*ends)
        good &= (low <= COCONE) & (high >= -COCONE)
    # Four points in a plane and on a circle make a flat cell, both sides of which pass: its outer side is enough.
    all_four = np.bincount(cell[good], minlength=len(corners)) + np.bincount(other[good & (other >= 0)], minlength=len(corners)) == 4
    towards = np.einsum("ij,ij->i", out, normals[faces].sum(axis=1))
    good &= ~((all_four[cell] & (towards < 0.0)) | ((other >= 0) & all_four[other] & (towards > 0.0)))
    return np.asarray(faces[good], dtype=np.int64)


def _without_long_edges(points: FloatArray, faces: IntArray) -> IntArray:
    if len(faces) == 0:
        return faces
    corners = points[faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    short: IntArray = faces[longest < LONGEST * spacing_of(points)]
    return short


def _outward(points: FloatArray, normals: FloatArray, faces: IntArray) -> IntArray:
    a, b, c = (points[faces[:, i]] for i in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), normals[faces].sum(axis=1)) < 0.0
    faces = faces.copy()
    faces[inward] = faces[inward][:, ::-1]
    return faces


def thinned(points: FloatArray, normals: FloatArray) -> tuple[IntArray, IntArray] | None:
    """A mesh through fewer points, within ``SAGITTA`` of the surface: which points (k,), and triangles (m, 3) of those. ``None`` if the
    surface is neither plane nor seen whole from within.

    Points are kept as far apart as curvature allows: a triangle within a circle of radius s, over a
    curvature kappa, is off by kappa s^2 / 2.
    """
    mean = normals.mean(axis=0)
    length = float(np.linalg.norm(mean))
    if length > 0.5 and (normals @ mean).min() > FLAT * length:
        _, _, axes = np.linalg.svd((mean / length)[None])
        kept = np.asarray(ConvexHull(points @ axes[1:].T).vertices, dtype=np.int64)
        return kept, _outward(points[kept], normals[kept], _in_plane(points[kept], mean / length))
    tree = cKDTree(points)
    distance, neighbour = tree.query(points, k=9)
    bend = np.linalg.norm(normals[neighbour[:, 1:]] - normals[:, None], axis=2) / np.maximum(distance[:, 1:], 1e-12)
    widest = float(np.ptp(points, axis=0).max()) / 8.0
    apart = np.minimum(np.sqrt(2.0 * SAGITTA / np.maximum(bend.max(axis=1), 1e-9)), widest)
    waiting = np.ones(len(points), dtype=bool)
    kept_points = []
    for i in np.argsort(apart, kind="stable"):
        if waiting[i]:
            kept_points.append(i)
            waiting[tree.query_ball_point(points[i], apart[i])] = False
    kept = np.array(kept_points, dtype=np.int64)
    faces = _from_within(points[kept], normals[kept])
    return None if faces is None else (kept, faces)


Mesh = tuple[FloatArray, FloatArray, IntArray]
"""Points, normals, faces."""


def tapered_capsule(start: FloatArray, end: FloatArray, start_radius: float, end_radius: float, *, around: int = 16) -> Mesh:
    """A tube with round ends from ``start`` to ``end`` (3,) m, its radius (m) going from one to the other."""
    axis = end - start
    length = float(np.linalg.norm(axis))
    z = axis / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
    _, _, frame = np.linalg.svd(z[None])
    x, y = frame[1], np.cross(z, frame[1])
    angle = np.linspace(0.0, 2.0 * np.pi, around, endpoint=False)
    ring = np.cos(angle)[:, None] * x + np.sin(angle)[:, None] * y
    caps = 5
    lower = [(start, start_radius, t) for t in np.linspace(-0.5 * np.pi, 0.0, caps)]
    upper = [(end, end_radius, t) for t in np.linspace(0.0, 0.5 * np.pi, caps)]
    normals = np.concatenate([np.cos(t) * ring + np.sin(t) * z for _, _, t in lower + upper])
    points = np.concatenate([p + r * (np.cos(t) * ring + np.sin(t) * z) for p, r, t in lower + upper])
    rows = len(lower + upper)
    i, j = np.meshgrid(np.arange(rows - 1), np.arange(around), indexing="ij")
    a, b = i * around + j, i * around + (j + 1) % around
    faces = np.concatenate([np.stack([a, b, b + around], axis=-1), np.stack([a, b + around, a + around], axis=-1)]).reshape(-1, 3)
    return points, normals, _outward(points, normals, faces)


def joined(meshes: list[Mesh]) -> Mesh:
    """Several meshes as one."""
    starts = np.cumsum([0] + [len(points) for points, _, _ in meshes[:-1]])
    return (
        np.concatenate([points for points, _, _ in meshes]),
        np.concatenate([normals for _, normals, _ in meshes]),
        np.concatenate([faces + start for (_, _, faces), start in zip(meshes, starts, strict=True)]),
    )


def _closes_rim(points: FloatArray, faces: IntArray, axis: FloatArray) -> npt.NDArray[np.bool_]:
    """Triangles (m,) that span the open rim of a pad: they lie low and square to its axis."""
    a, b, c = (points[faces[:, i]] for i in range(3))
    across = np.cross(b - a, c - a)
    height = points @ axis
    low = height[faces].max(axis=1) < np.median(height)
    closing: npt.NDArray[np.bool_] = low & (np.abs(across @ axis) > 0.95 * np.linalg.norm(across, axis=1))
    return closing


def mirrored(points: FloatArray, normals: FloatArray, faces: IntArray, axis: FloatArray, *, thickness: float = 0.75) -> Mesh:
    """The back of a pad: its mirror image in the plane of its rim, ``thickness`` times as thick. ``axis`` (3,) points out of the pad.

    It does not yield, and is made of fewer triangles.
    """
    height = points @ axis
    rim = height.min()
    few = thinned(points, normals)
    if few is not None:
        at_rim = np.flatnonzero(height < rim + 1.5 * spacing_of(points))
        kept = np.union1d(few[0], at_rim)
        points, normals, height = points[kept], normals[kept], height[kept]
        star = _from_within(points, normals)
        assert star is not None
        faces = star[~_closes_rim(points, star, axis)]
    back = points - np.outer((1.0 + thickness) * (height - rim), axis)
    along = normals @ axis
    turned = normals - np.outer(along * (1.0 + 1.0 / thickness), axis)
    turned /= np.linalg.norm(turned, axis=1)[:, None]
    return back, turned, faces[:, ::-1]
