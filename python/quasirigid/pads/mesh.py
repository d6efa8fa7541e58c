"""A mesh of bricks or tetrahedra, checked, with its boundary."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np

from quasirigid.arrays.real import finite_array, refuse_masked
from quasirigid.arrays.types import BoolArray, FloatArray, IntArray
from quasirigid.errors import InvalidShapeError, InvalidValueError

__all__ = ["EDGES", "PadMesh", "pad_mesh", "whole_numbers"]

EDGES = np.array(list(combinations(range(4), 2)))
"""(6, 2) corners of a tetrahedron at the ends of its edges; the node in the middle of edge k is its node 4 + k."""

FACES = {
    4: np.array([(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)]),
    8: np.array([(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]),
}
"""By number of corners: corners of every face of an element, in order around it."""


@dataclass(frozen=True, eq=False)
class PadMesh:
    """Bricks of 8 nodes, or tetrahedra of 10: 4 corners and a node in the middle of every edge."""

    points: FloatArray
    """(n, 3) m; the corners first, as they were given."""
    elements: IntArray
    """(m, 8) or (m, 10) nodes."""
    fixed: BoolArray
    """(n,) nodes that cannot move. The middle of an edge between two of them is one."""

    @cached_property
    def corners(self) -> IntArray:
        """(m, 8) or (m, 4) nodes at the corners of the elements."""
        return self.elements[:, : 8 if self.elements.shape[1] == 8 else 4]

    @cached_property
    def boundary(self) -> IntArray:
        """(f, 4) corners, or (f, 6) corners and middles of the edges 01, 12, 20, of the faces that belong to one element only."""
        local = FACES[self.corners.shape[1]]
        faces = self.corners[:, local].reshape(-1, local.shape[1])
        _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
        single = np.sort(first[count == 1])
        if self.elements.shape[1] == 8:
            return np.asarray(faces[single])
        middle = {tuple(edge): 4 + k for k, edge in enumerate(EDGES.tolist())}
        sides = np.array([[middle[min(a, b), max(a, b)] for a, b in ((f[0], f[1]), (f[1], f[2]), (f[2], f[0]))] for f in local.tolist()])
        middles = self.elements[:, sides].reshape(-1, 3)
        return np.concatenate([faces[single], middles[single]], axis=1)


def pad_mesh(points: Any, elements: Any, fixed: Any) -> PadMesh:
    """A mesh from arrays from outside: points (n, 3) m, elements (m, 4) or (m, 8), fixed (n,) bool or indices.

    Raises ``InvalidShapeError`` and ``InvalidValueError``, which say what is wrong and where.
    """
    nodes = finite_array("points", points, "(n, 3)")
    if nodes.ndim != 2 or nodes.shape[1] != 3:
        raise InvalidShapeError("points", "shape (n, 3)", f"shape {nodes.shape}", "give a row of x, y, z in m for every node")
    corners = whole_numbers("elements", elements)
    if corners.ndim != 2 or corners.shape[1] not in FACES or not len(corners):
        hint = "give the four corners of tetrahedra, or the eight of bricks; nodes in between are made here"
        raise InvalidShapeError("elements", "shape (m, 4) or (m, 8), m >= 1", f"shape {corners.shape}", hint)
    _within("elements", corners, len(nodes))
    held = _held(fixed, len(nodes))
    if corners.shape[1] == 4:
        nodes, corners, held = _quadratic(nodes, corners, held)
    return PadMesh(nodes, corners, held)


def whole_numbers(what: str, value: Any) -> IntArray:
    """An array-like of integers. Raises ``InvalidValueError`` for anything else."""
    refuse_masked(what, value)
    try:
        array = np.asarray(value)
    except ValueError:
        array = np.asarray(None)
    if array.size and array.dtype.kind not in "iu":
        raise InvalidValueError(what, "indices of nodes, whole numbers", f"an array of {array.dtype}", "give integers, array.astype(int)")
    return array.astype(np.int64)


def _within(what: str, indices: IntArray, count: int) -> None:
    outside = (indices < 0) | (indices >= count)
    if outside.any():
        got = f"{indices[outside][0]} in row {np.argwhere(outside)[0][0]}"
        raise InvalidValueError(what, f"indices of the {count} points, from 0", got, "count the nodes from 0")


def _held(fixed: Any, count: int) -> BoolArray:
    refuse_masked("fixed", fixed)
    mask = np.asarray(fixed)
    if mask.dtype != np.bool_:
        indices = whole_numbers("fixed", fixed).ravel()
        _within("fixed", indices, count)
        mask = np.zeros(count, dtype=np.bool_)
        mask[indices] = True
    if mask.shape != (count,):
        hint = "say for every node whether it is bonded to the backing, or give their indices"
        raise InvalidShapeError("fixed", f"a mask of shape ({count},), or indices", f"shape {mask.shape}", hint)
    return mask


def _quadratic(points: FloatArray, corners: IntArray, fixed: BoolArray) -> tuple[FloatArray, IntArray, BoolArray]:
    """Tetrahedra with a node in the middle of every edge: with corners alone they are far too stiff in bending, and lock where Poisson's
    ratio nears 1/2.
    """
    ends, number = np.unique(np.sort(corners[:, EDGES].reshape(-1, 2), axis=1), axis=0, return_inverse=True)
    elements = np.concatenate([corners, len(points) + number.reshape(-1, 6)], axis=1)
    return np.concatenate([points, points[ends].mean(axis=1)]), elements, np.concatenate([fixed, fixed[ends].all(axis=1)])
