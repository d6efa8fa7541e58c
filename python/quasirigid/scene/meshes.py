"""Triangles through the points of a surface, and the shapes of a hand's links.

The vertices of every mesh of a surface are the surface's own points, so that a mesh deforms exactly as the surface does.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull, Delaunay, QhullError, cKDTree

from quasirigid.arrays.types import FloatArray, IntArray

SAGITTA = 5e-5
"""How far a thinned mesh may be from the surface, m."""
BACK_SAGITTA = 4e-4
"""The same for the backs of pads, which are decoration, m."""
PLANE = 0.02
"""A plane part of a surface has at least this share of its points."""
FULL = 0.97
"""A body without dents fills this share of its convex hull: the edges of a coarsely sampled box are a little ragged."""
VERTEX_CACHE = 24
"""Vertices that whoever draws the triangles keeps at hand, about."""
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
    return outward(points, normals, _without_long_edges(points, faces))


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
                return outward(rays, rays, np.asarray(ConvexHull(rays).simplices, dtype=np.int64))
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


def outward(points: FloatArray, normals: FloatArray, faces: IntArray) -> IntArray:
    """The ``faces`` (m, 3) with their corners counter-clockwise as seen from outside, where the ``normals`` (n, 3) point."""
    a, b, c = (points[faces[:, i]] for i in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), normals[faces].sum(axis=1)) < 0.0
    faces = faces.copy()
    faces[inward] = faces[inward][:, ::-1]
    return faces


def in_drawing_order(faces: IntArray, n: int) -> IntArray:
    """The same triangles (m, 3) of ``n`` points, each near the last one, so that most of its vertices have just been computed by a page
    without a graphics card. The fans of Sander, Nehab and Barczak, *Fast triangle reordering
    for vertex locality and reduced overdraw*, 2007, section 4.
    """
    if len(faces) == 0:
        return faces
    around: list[list[int]] = [[] for _ in range(n)]
    corners: list[list[int]] = faces.tolist()
    for triangle, corner in enumerate(corners):
        for vertex in corner:
            around[vertex].append(triangle)
    left = [len(triangles) for triangles in around]  # triangles of a vertex that are not out yet
    stamp, clock = [-VERTEX_CACHE - 1] * n, 0
    out: list[int] = []
    done = [False] * len(corners)
    recent: list[int] = []
    fan, scan = corners[0][0], 0
    while len(out) < len(corners):
        ring: list[int] = []
        for triangle in around[fan]:
            if done[triangle]:
                continue
            done[triangle] = True
            out.append(triangle)
            for vertex in corners[triangle]:
                ring.append(vertex)
                left[vertex] -= 1
                if clock - stamp[vertex] > VERTEX_CACHE:
                    clock += 1
                    stamp[vertex] = clock
        recent += ring
        # Go on with the oldest vertex of the ring that will still be at hand when its fan is drawn, else with the latest of all.
        fan, oldest = -1, -1
        for vertex in ring:
            age = clock - stamp[vertex]
            if left[vertex] > 0 and oldest < (age if age + 2 * left[vertex] <= VERTEX_CACHE else 0):
                fan, oldest = vertex, age if age + 2 * left[vertex] <= VERTEX_CACHE else 0
        while fan < 0 and recent:
            vertex = recent.pop()
            fan = vertex if left[vertex] > 0 else -1
        while fan < 0 and scan < n:
            fan = scan if left[scan] > 0 else -1
            scan += 1
    return faces[out]


def thinned(points: FloatArray, normals: FloatArray, sagitta: float = SAGITTA) -> tuple[IntArray, IntArray] | None:
    """A mesh through fewer points, within ``sagitta`` (m) of the surface: which points (k,), and triangles (m, 3) of those. ``None`` if the
    surface is neither plane nor seen whole from within.

    Of the plane parts of a convex body the corners are kept. Elsewhere points are as far apart as curvature allows: a triangle within a
    circle of radius s, over a curvature kappa, is off by kappa s^2 / 2.
    """
    mean = normals.mean(axis=0)
    length = float(np.linalg.norm(mean))
    if length > 0.5 and (normals @ mean).min() > FLAT * length:
        _, _, axes = np.linalg.svd((mean / length)[None])
        kept = np.asarray(ConvexHull(points @ axes[1:].T).vertices, dtype=np.int64)
        return kept, outward(points[kept], normals[kept], _in_plane(points[kept], mean / length))
    kept = _apart_enough(points, normals, sagitta)
    inner, corners = _plane_parts(points, normals)
    if len(inner):
        few = np.union1d(corners, np.setdiff1d(kept, inner))
        hull = _convex(points, normals, few, sagitta)
        if hull is not None:
            used, places = np.unique(hull.ravel(), return_inverse=True)
            return few[used], np.asarray(places, dtype=np.int64).reshape(-1, 3)
    faces = _from_within(points[kept], normals[kept])
    return None if faces is None else (kept, faces)


def in_bands(points: FloatArray, faces: IntArray) -> IntArray:
    """The same triangles (m, 3) in bands across the surface, two triangles wide: as ``in_drawing_order``, not quite as good and at once."""
    _, _, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    middles = points[faces].mean(axis=1) @ axes[:2].T
    width = 2.0 * np.sqrt(np.ptp(middles, axis=0).prod() / max(1, len(faces)))
    band = np.floor(middles[:, 1] / max(float(width), 1e-12))
    ordered: IntArray = faces[np.lexsort((middles[:, 0], band))]
    return ordered


def is_convex(points: FloatArray, faces: IntArray) -> bool:
    """Whether a closed mesh of ``points`` (n, 3) and triangles (m, 3) has no dents to speak of: it fills its convex hull to ``FULL``."""
    try:
        hull = ConvexHull(points).volume
    except QhullError:
        return True  # it is flat
    a, b, c = (points[faces[:, i]] - points[0] for i in range(3))
    return bool(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0 > FULL * hull)


def _plane_parts(points: FloatArray, normals: FloatArray) -> tuple[IntArray, IntArray]:
    """The points (k,) of parts of the surface that are plane, and of these the corners of the parts' convex hulls."""
    inner, corners = [], []
    scale = float(np.ptp(points, axis=0).max())
    height = np.einsum("ij,ij->i", points, normals)
    keys = np.round(np.column_stack([normals * 1e3, height / (1e-4 * scale)])).astype(np.int64)
    _, part, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    for which in np.flatnonzero(count > max(PLANE * len(points), 9)):
        mine = np.flatnonzero(part.ravel() == which)
        _, _, axes = np.linalg.svd(normals[mine].mean(axis=0)[None])
        try:
            hull = ConvexHull(points[mine] @ axes[1:].T)
        except QhullError:
            continue
        inner.append(mine)
        corners.append(mine[hull.vertices])
    none = np.zeros(0, dtype=np.int64)
    return np.concatenate(inner or [none]), np.concatenate(corners or [none])


def _apart_enough(points: FloatArray, normals: FloatArray, sagitta: float) -> IntArray:
    tree = cKDTree(points)
    distance, neighbour = tree.query(points, k=9)
    bend = np.linalg.norm(normals[neighbour[:, 1:]] - normals[:, None], axis=2) / np.maximum(distance[:, 1:], 1e-12)
    widest = float(np.ptp(points, axis=0).max()) / 8.0
    distances = np.minimum(np.sqrt(2.0 * sagitta / np.maximum(bend.max(axis=1), 1e-9)), widest)
    waiting = np.ones(len(points), dtype=bool)
    kept = []
    for i in np.argsort(distances, kind="stable"):
        if waiting[i]:
            kept.append(i)
            waiting[tree.query_ball_point(points[i], distances[i])] = False
    return np.array(kept, dtype=np.int64)


def _convex(points: FloatArray, normals: FloatArray, kept: IntArray, sagitta: float) -> IntArray | None:
    """The hull of the points ``kept``, triangles (m, 3) of these, if none of ``points`` is deeper in it than ``sagitta``, m."""
    try:
        hull = ConvexHull(points[kept])
    except QhullError:
        return None
    for some in np.array_split(points, max(1, len(points) * len(hull.equations) // 4_000_000)):
        if (some @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1).min() < -sagitta:
            return None
    return outward(points[kept], normals[kept], np.asarray(hull.simplices, dtype=np.int64))


Mesh = tuple[FloatArray, FloatArray, IntArray]
"""Points, normals, faces."""


def tapered_capsule(start: FloatArray, end: FloatArray, start_radius: float, end_radius: float, *, around: int = 12, caps: int = 3) -> Mesh:
    """A tube with round ends from ``start`` to ``end`` (3,) m, its radius (m) going from one to the other, of ``around`` sides and with
    ``caps`` rings from an end's pole to the tube.
    """
    axis = end - start
    length = float(np.linalg.norm(axis))
    z = axis / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
    _, _, frame = np.linalg.svd(z[None])
    x, y = frame[1], np.cross(z, frame[1])
    angle = np.linspace(0.0, 2.0 * np.pi, around, endpoint=False)
    ring = np.cos(angle)[:, None] * x + np.sin(angle)[:, None] * y
    tilt = np.linspace(0.0, 0.5 * np.pi, caps + 1)[:-1]
    rows = [(start, start_radius, -t) for t in tilt[::-1]] + [(end, end_radius, t) for t in tilt]
    normals = np.concatenate([-z[None], *(np.cos(t) * ring + np.sin(t) * z for _, _, t in rows), z[None]])
    points = np.concatenate(
        [(start - start_radius * z)[None], *(p + r * (np.cos(t) * ring + np.sin(t) * z) for p, r, t in rows), (end + end_radius * z)[None]]
    )
    i, j = np.meshgrid(np.arange(len(rows) - 1), np.arange(around), indexing="ij")
    a, b = 1 + i * around + j, 1 + i * around + (j + 1) % around
    side = np.concatenate([np.stack([a, b, b + around], axis=-1), np.stack([a, b + around, a + around], axis=-1)]).reshape(-1, 3)
    k = np.arange(around)
    first, last = 1 + np.stack([k, (k + 1) % around]), 1 + (len(rows) - 1) * around + np.stack([k, (k + 1) % around])
    poles = [np.stack([np.full(around, pole), *ends], axis=-1) for pole, ends in ((0, first), (len(points) - 1, last))]
    return points, normals, outward(points, normals, np.concatenate([side, *poles]))


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


def few_points(points: FloatArray, normals: FloatArray, sagitta: float = SAGITTA) -> IntArray:
    """Points (k,) of a curved surface through which a mesh is within ``sagitta`` of it, m, and all those at its rim if it is open."""
    kept = _apart_enough(points, normals, sagitta)
    mean = normals.mean(axis=0)
    length = float(np.linalg.norm(mean))
    if length < CLOSED:
        return kept
    height = points @ (mean / length)
    return np.union1d(kept, np.flatnonzero(height < height.min() + 0.8 * spacing_of(points)))


def open_mesh(points: FloatArray, normals: FloatArray, kept: IntArray) -> IntArray | None:
    """Triangles (m, 3) of ``points``, through the points ``kept`` (k,) alone, of a surface that is closed or open at a rim, all of which is
    kept. ``None`` if it is not seen whole from within.
    """
    faces = _from_within(points[kept], normals[kept])
    if faces is None:
        return None
    mean = normals.mean(axis=0)
    length = float(np.linalg.norm(mean))
    if length >= CLOSED:
        faces = faces[~_closes_rim(points[kept], faces, mean / length)]
    return kept[faces]


def mirrored(points: FloatArray, normals: FloatArray, faces: IntArray, axis: FloatArray, *, thickness: float = 0.75) -> Mesh:
    """The back of a pad: its mirror image in the plane of its rim, ``thickness`` times as thick. ``axis`` (3,) points out of the pad.

    It does not deform, and is made of fewer triangles.
    """
    rim = float((points @ axis).min())
    kept = few_points(points, normals, BACK_SAGITTA)
    few = open_mesh(points, normals, kept)
    if few is not None:
        used, places = np.unique(few.ravel(), return_inverse=True)
        points, normals, faces = points[used], normals[used], np.asarray(places, dtype=np.int64).reshape(-1, 3)
    height = points @ axis
    back = points - np.outer((1.0 + thickness) * (height - rim), axis)
    along = normals @ axis
    turned = normals - np.outer(along * (1.0 + 1.0 / thickness), axis)
    turned /= np.linalg.norm(turned, axis=1)[:, None]
    return back, turned, faces[:, ::-1]
