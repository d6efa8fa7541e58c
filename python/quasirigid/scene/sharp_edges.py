"""Sharp edges of a mesh whose vertices are points of a surface: none of them lies on an edge, which the triangles therefore cut off.

After Attene, Falcidieno, Rossignac, Spagnuolo, Edge-Sharpener: recovering sharp features in triangulations of non-adaptively re-meshed
surfaces, 2003: where the normals of a triangle's corners disagree, it is divided at the line in which their tangent planes meet.
"""

from __future__ import annotations

import numpy as np

from quasirigid.arrays.types import FloatArray, IntArray
from quasirigid.scene.meshes import Mesh

TURN = 0.9
"""Normals that differ by more lie on either side of an edge, rad."""
FURTHEST = 2.0
"""A new vertex lies no further from the middle of what it divides than so many lengths of that: beyond, planes are nearly parallel."""


def sharpened(points: FloatArray, normals: FloatArray, faces: IntArray) -> Mesh:
    """The mesh with its sharp edges. Points and normals (n, 3) are followed by those on the edges, one for each side, so that shading ends
    there.
    """
    corner, normal = points[faces], normals[faces]
    bends = np.stack([np.einsum("ij,ij->i", normal[:, k], normal[:, (k + 1) % 3]) < np.cos(TURN) for k in range(3)], axis=1)
    count = bends.sum(axis=1)
    made = _Made(len(points))
    # Two corners on one side, the third on the other: that one last.
    two = np.flatnonzero(count == 2)
    apex = (bends[two].argmin(axis=1) + 2) % 3
    order = (apex[:, None] + [1, 2, 0]) % 3
    a, b, c = np.take_along_axis(faces[two], order, axis=1).T
    (pa, pb, pc), (na, nb, nc) = (np.moveaxis(np.take_along_axis(v[two], order[..., None], axis=1), 1, 0) for v in (corner, normal))
    x, y = _on_edge(pb, nb, pc, nc), _on_edge(pc, nc, pa, na)
    xb, ya, xc, yc = made.add(x, nb), made.add(y, na), made.add(x, nc), made.add(y, nc)
    new = [faces[~np.isin(count, (2, 3))], np.stack([a, b, xb], 1), np.stack([a, xb, ya], 1), np.stack([yc, xc, c], 1)]
    # All three on different sides: a corner of the body.
    three = np.flatnonzero(count == 3)
    p, n = corner[three], normal[three]
    middle = _in_corner(p, n)
    for k in range(3):
        before, after = (k + 2) % 3, (k + 1) % 3
        there = made.add(middle, n[:, k])
        to = made.add(_on_edge(p[:, k], n[:, k], p[:, after], n[:, after]), n[:, k])
        back = made.add(_on_edge(p[:, before], n[:, before], p[:, k], n[:, k]), n[:, k])
        own = faces[three, k]
        new += [np.stack([own, to, there], 1), np.stack([own, there, back], 1)]
    return np.concatenate([points, *made.points]), np.concatenate([normals, *made.normals]), np.concatenate(new)


class _Made:
    """Vertices that are added to a mesh."""

    def __init__(self, count: int) -> None:
        self.points: list[FloatArray] = []
        self.normals: list[FloatArray] = []
        self._count = count

    def add(self, points: FloatArray, normals: FloatArray) -> IntArray:
        """Their numbers."""
        self.points.append(points)
        self.normals.append(normals)
        self._count += len(points)
        return np.arange(self._count - len(points), self._count)


def _on_edge(p: FloatArray, n: FloatArray, q: FloatArray, m: FloatArray) -> FloatArray:
    """The points (k, 3) nearest to the middles of ``p`` and ``q`` (k, 3) m on both of their tangent planes, with normals ``n`` and ``m``:
    ``x = (p + q)/2 + alpha n + beta m``, ``n.(x - p) = m.(x - q) = 0``.
    """
    middle = 0.5 * (p + q)
    c = np.einsum("ij,ij->i", n, m)
    r, s = np.einsum("ij,ij->i", n, p - middle), np.einsum("ij,ij->i", m, q - middle)
    free = np.maximum(1.0 - c * c, 1e-12)
    shift = ((r - c * s) / free)[:, None] * n + ((s - c * r) / free)[:, None] * m
    found: FloatArray = middle + _within(shift, np.linalg.norm(p - q, axis=1))
    return found


def _in_corner(p: FloatArray, n: FloatArray) -> FloatArray:
    """The points (k, 3) in which the three tangent planes at ``p`` (k, 3, 3) m with normals ``n`` meet: ``n_i.(x - p_i) = 0``."""
    middle = p.mean(axis=1)
    level = np.einsum("kij,kij->ki", n, p - middle[:, None])
    shift = np.einsum("kij,kj->ki", np.linalg.pinv(n, rcond=1e-3), level)
    found: FloatArray = middle + _within(shift, np.linalg.norm(p - middle[:, None], axis=2).max(axis=1))
    return found


def _within(shift: FloatArray, length: FloatArray) -> FloatArray:
    """The shifts (k, 3) that are no longer than ``FURTHEST`` times ``length`` (k,); none of the others."""
    near = np.linalg.norm(shift, axis=1) <= FURTHEST * length
    return np.where(near[:, None], shift, 0.0)


def divided(points: FloatArray, normals: FloatArray, faces: IntArray) -> Mesh:
    """The mesh with every triangle in four: new vertices half way along the edges, with the mean of the normals."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    unique, which = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    ab, bc, ca = (len(points) + which.reshape(3, -1)).astype(faces.dtype)
    between = normals[unique].sum(axis=1)
    between /= np.maximum(np.linalg.norm(between, axis=1, keepdims=True), 1e-12)
    a, b, c = faces.T
    quarters = [np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    return np.concatenate([points, points[unique].mean(axis=1)]), np.concatenate([normals, between]), np.concatenate(quarters)


__all__ = ["divided", "sharpened"]
