"""Triangle meshes made fit for use: welded, cleaned, turned outward, with what was found said in words; and their shading normals."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from quasirigid.arrays.types import FloatArray, IntArray
from quasirigid.errors import DegenerateSurfaceError

WELD = 1e-7
"""Vertices closer than this share of the largest extent are one: formats such as STL repeat each corner."""

SMOOTH_ANGLE = math.radians(30.0)
"""Edges that bend less are shaded smoothly; sharper ones stay edges, so that a box keeps flat faces."""

MAX_PARTS_TURNED = 1000
"""Parts checked one by one to turn them outward; a mesh in more pieces is a soup, and is turned as a whole."""


@dataclass(frozen=True, eq=False)
class CleanMesh:
    """A mesh ready to be sampled.

    Attributes:
        vertices: (n, 3), m.
        faces: (m, 3), outward by the right-hand rule as far as that could be made out.
        watertight: every edge has exactly two faces that agree on its direction.
        warnings: what was found and what was done about it.
    """

    vertices: FloatArray
    faces: IntArray
    watertight: bool
    warnings: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Edges:
    """The edges of a mesh, sorted so that the uses of one edge lie side by side."""

    ends: IntArray  # (3 m, 2), smaller vertex first
    face: IntArray  # (3 m,)
    forward: NDArray[np.bool_]  # (3 m,) the face runs from the smaller to the larger vertex
    start: IntArray  # (e,) position of the first use of each edge
    uses: IntArray  # (e,) number of uses of each edge


def clean_mesh(vertices: FloatArray, faces: IntArray, what: str) -> CleanMesh:
    """Welds, drops useless faces, turns the surface outward, and counts what remains wrong.

    Args:
        vertices: (n, 3), finite.
        faces: (m, 3), in range.
        what: the name of the mesh, for messages.

    Raises:
        DegenerateSurfaceError: no face with an area is left.
    """
    notes: list[str] = []
    vertices, faces = _weld(vertices, faces)
    faces = _drop_useless_faces(faces, notes)
    vertices, faces = _used(vertices, faces)  # corners of dropped faces alone are no part of the object
    area = 0.5 * float(np.linalg.norm(_crosses(vertices, faces), axis=1).sum()) if len(faces) else 0.0
    extent = float(np.ptp(vertices, axis=0).max()) if len(vertices) else 0.0
    if not area > 1e-12 * extent**2 or extent == 0.0:
        hint = "all faces are points or lines; export the object again"
        raise DegenerateSurfaceError(what, "faces with an area", f"{len(faces)} faces of total area {area:.3g}", hint)

    edges = _edges(faces)
    if not _consistent(edges):
        mesh = trimesh.Trimesh(vertices, faces, process=False)
        trimesh.repair.fix_winding(mesh)  # type: ignore[no-untyped-call]
        faces = np.asarray(mesh.faces, dtype=np.int64)
        edges = _edges(faces)
        fixed = _consistent(edges)
        notes.append(
            "faces wound in different directions: " + ("repaired" if fixed else "could not be fully repaired (one-sided surface?)")
        )
    part = _parts(edges, len(faces))
    faces = _turn_outward(vertices, faces, part, notes)
    edges = _edges(faces)

    holes = _count_holes(edges)
    if holes:
        notes.append(f"{holes} hole{'s' if holes > 1 else ''} (boundary loops): the surface is not closed")
    crossed = int((edges.uses > 2).sum())
    if crossed:
        notes.append(f"{crossed} non-manifold edges (shared by more than two faces)")
    parts = int(part.max()) + 1
    if parts > 1:
        notes.append(f"{parts} separate parts, taken as one rigid object")
    watertight = bool((edges.uses == 2).all()) and _consistent(edges)
    return CleanMesh(vertices, faces, watertight, tuple(notes))


def corner_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Outward unit normals at the three corners of each face, (m, 3, 3) by face, corner, axis.

    Faces around a vertex that hang together over edges bent by less than 30 degrees share one normal, weighted by area: large flat faces
    stay flat beside small fillets.
    """
    crosses = _crosses(vertices, faces)
    unit = crosses / np.maximum(np.linalg.norm(crosses, axis=1), np.finfo(float).tiny)[:, None]
    edges = _edges(faces)
    two = edges.start[edges.uses == 2]
    left, right = edges.face[two], edges.face[two + 1]
    smooth = np.einsum("ij,ij->i", unit[left], unit[right]) > math.cos(SMOOTH_ANGLE)
    # A face without area has no direction of its own and must not cut a smooth surface in two.
    doubled = np.linalg.norm(crosses, axis=1)
    flat = doubled < 1e-12 * max(float(doubled.max()), np.finfo(float).tiny)
    smooth |= flat[left] | flat[right]
    two, left, right = two[smooth], left[smooth], right[smooth]
    # Corner number = 3 face + position; the corners at each end of a smooth edge are tied together.
    ties: list[tuple[IntArray, IntArray]] = []
    for end in (0, 1):
        vertex = edges.ends[two, end]
        ties.append(
            (3 * left + np.argmax(faces[left] == vertex[:, None], axis=1), 3 * right + np.argmax(faces[right] == vertex[:, None], axis=1))
        )
    rows, columns = (np.concatenate([tie[side] for tie in ties]) for side in (0, 1))
    count = 3 * len(faces)
    _, group = connected_components(coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(count, count)), directed=False)
    weights = np.repeat(crosses, 3, axis=0)
    sums = np.stack([np.bincount(group, weights[:, axis]) for axis in range(3)], axis=1)
    lengths = np.linalg.norm(sums, axis=1)
    shared = sums / np.maximum(lengths, np.finfo(float).tiny)[:, None]
    normals = shared[group]
    lost = lengths[group] <= 0.0
    normals[lost] = np.repeat(unit, 3, axis=0)[lost]
    corners: FloatArray = normals.reshape(-1, 3, 3)
    return corners


def _crosses(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Face normals times twice the area, (m, 3)."""
    corners = vertices[faces]
    crosses: FloatArray = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return crosses


def _weld(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    vertices, faces = _used(vertices, faces)
    extent = float(np.ptp(vertices, axis=0).max()) if len(vertices) else 0.0
    if extent == 0.0:
        return vertices, faces
    # What is equal goes first, and fast: it is most of what there is to weld.
    _, first, same = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    pairs = cKDTree(vertices[first]).query_pairs(WELD * extent, output_type="ndarray")
    count, group = connected_components(coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(first), len(first))), directed=False)
    lowest = np.full(count, len(vertices))
    np.minimum.at(lowest, group, first)
    # Numbered in the order of the file, so that the result reads like the input.
    order = np.argsort(lowest)
    rank = np.empty_like(order)
    rank[order] = np.arange(count)
    return np.ascontiguousarray(vertices[lowest[order]]), rank[group[same.reshape(-1)]][faces]


def _used(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """The vertices that faces have, in their order."""
    used, compact = np.unique(faces, return_inverse=True)
    return vertices[used], compact.reshape(faces.shape).astype(np.int64)


def _drop_useless_faces(faces: IntArray, notes: list[str]) -> IntArray:
    # Slivers of zero area with three different corners stay: without them the surface would have a slit.
    collapsed = (faces[:, 0] == faces[:, 1]) | (faces[:, 1] == faces[:, 2]) | (faces[:, 2] == faces[:, 0])
    if collapsed.any():
        notes.append(f"{int(collapsed.sum())} degenerate faces dropped")
        faces = faces[~collapsed]
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    if len(first) < len(faces):
        notes.append(f"{len(faces) - len(first)} duplicate faces dropped")
        faces = faces[np.sort(first)]
    return faces


def _edges(faces: IntArray) -> _Edges:
    raw = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    ends = np.sort(raw, axis=1)
    order = np.lexsort((ends[:, 1], ends[:, 0]))
    ends = ends[order]
    fresh = np.ones(len(ends), dtype=bool)
    fresh[1:] = (ends[1:] != ends[:-1]).any(axis=1)
    start = np.flatnonzero(fresh)
    uses = np.diff(np.append(start, len(ends)))
    return _Edges(ends, (order // 3).astype(np.int64), (raw[:, 0] < raw[:, 1])[order], start, uses)


def _consistent(edges: _Edges) -> bool:
    two = edges.start[edges.uses == 2]
    return bool((edges.forward[two] != edges.forward[two + 1]).all())


def _parts(edges: _Edges, count: int) -> IntArray:
    """The number of the connected part that each face belongs to, over edges."""
    same = np.flatnonzero((edges.ends[1:] == edges.ends[:-1]).all(axis=1))
    left, right = edges.face[same], edges.face[same + 1]
    _, part = connected_components(coo_matrix((np.ones(len(left)), (left, right)), shape=(count, count)), directed=False)
    return np.asarray(part, dtype=np.int64)


def _turn_outward(vertices: FloatArray, faces: IntArray, part: IntArray, notes: list[str]) -> IntArray:
    """Turns parts that enclose a negative volume, unless they are cavities in another part."""
    corners = vertices[faces]
    if int(part.max()) + 1 > MAX_PARTS_TURNED:
        part = np.zeros(len(faces), dtype=np.int64)
    # Six times the signed volume of each part, about the middle of its own box: an open surface gets a sensible sign too.
    count = int(part.max()) + 1
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, part, corners.min(axis=1))
    np.maximum.at(high, part, corners.max(axis=1))
    local = corners - (0.5 * (low + high))[part][:, None, :]
    volume = np.bincount(part, np.einsum("ij,ij->i", local[:, 0], np.cross(local[:, 1], local[:, 2])), count)
    turned = 0
    faces = faces.copy()
    for number in np.flatnonzero(volume < 0.0):
        around = [
            other
            for other in np.flatnonzero((low <= low[number]).all(axis=1) & (high >= high[number]).all(axis=1))
            if other != number and _winding_number(corners[part == other], corners[part == number][0, 0]) > 0.5
        ]
        if len(around) % 2 == 0:
            mine = part == number
            faces[mine] = faces[mine][:, ::-1]
            turned += 1
    if turned:
        notes.append(
            "the surface was inside out: turned outward" if count == 1 else f"{turned} of {count} parts were inside out: turned outward"
        )
    return faces


def _winding_number(corners: FloatArray, point: FloatArray) -> float:
    """How often a surface goes round a point: the sum of the solid angles of its triangles (van Oosterom and Strackee, 1983), over 4 pi."""
    a, b, c = (corners[:, k] - point for k in range(3))
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    above = np.einsum("ij,ij->i", a, np.cross(b, c))
    below = la * lb * lc + np.einsum("ij,ij->i", a, b) * lc + np.einsum("ij,ij->i", b, c) * la + np.einsum("ij,ij->i", c, a) * lb
    return abs(float((2.0 * np.arctan2(above, below)).sum())) / (4.0 * math.pi)


def _count_holes(edges: _Edges) -> int:
    rim = edges.ends[edges.start[edges.uses == 1]]
    if len(rim) == 0:
        return 0
    corner, compact = np.unique(rim, return_inverse=True)
    compact = compact.reshape(rim.shape)
    graph = coo_matrix((np.ones(len(rim)), (compact[:, 0], compact[:, 1])), shape=(len(corner), len(corner)))
    return int(connected_components(graph, directed=False)[0])


def cap_holes(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray, float]:
    """Closes every hole with a fan of triangles to the middle of its rim.

    Returns:
        the vertices and faces of the closed mesh, and the share of its area that is caps.
    """
    edges = _edges(faces)
    single = edges.start[edges.uses == 1]
    if len(single) == 0:
        return vertices, faces, 0.0
    # Against the direction of the face at the rim, so that the fan agrees with it.
    rim = np.where(edges.forward[single][:, None], edges.ends[single][:, ::-1], edges.ends[single])
    corner, compact = np.unique(rim, return_inverse=True)
    compact = compact.reshape(rim.shape)
    graph = coo_matrix((np.ones(len(rim)), (compact[:, 0], compact[:, 1])), shape=(len(corner), len(corner)))
    count, loop = connected_components(graph, directed=False)
    members = np.bincount(loop, minlength=count)
    middle = np.stack([np.bincount(loop, vertices[corner, axis], count) / members for axis in range(3)], axis=1)
    fan = np.column_stack([rim, len(vertices) + loop[compact[:, 0]]]).astype(np.int64)
    closed = np.concatenate([vertices, middle])
    cap_area = float(np.linalg.norm(_crosses(closed, fan), axis=1).sum())
    return closed, np.concatenate([faces, fan]), cap_area / (cap_area + float(np.linalg.norm(_crosses(vertices, faces), axis=1).sum()))
