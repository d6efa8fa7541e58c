"""Draws point surfaces: discs about the points, blended where they overlap, with a depth buffer. Orthographic, NumPy only.

A pixel takes the mean of the discs that are nearest to the viewer there (M. Botsch and L. Kobbelt, High-Quality Point-Based
Rendering on Modern GPUs, 2003): colours and normals come out smooth, edges between bodies sharp. Camera axes: x to the
right, y upwards, z towards the viewer; depth is along z, larger is nearer.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from quasirigid.arrays.types import AnyArray
from quasirigid.render.camera import Camera
from quasirigid.render.layer import NOTHING, Layer

CHUNK = 2000
"""Discs drawn at a time: few enough for the cache."""


def splat(camera: Camera, points: AnyArray, normals: AnyArray, colours: AnyArray, radius: float, cut: AnyArray | None = None) -> Layer:
    """Draw discs of ``radius`` m about ``points`` (n, 3) m that face along ``normals`` (n, 3), world, in ``colours`` (n, 4).

    Only those that face the viewer are drawn: turn the normals round to see the inside of a surface. ``cut`` is what
    ``edge_planes`` gives, and keeps the discs from sticking out at edges.
    """
    width, height = camera.size
    seen, facing = camera.project(points), np.asarray(normals, float) @ camera.axes
    if cut is not None:
        cut = np.concatenate([cut[..., :3] @ camera.axes, cut[..., 3:]], axis=-1)
    front = np.flatnonzero(facing[:, 2] > 0.0)
    colours = np.broadcast_to(colours, (len(points), 4)).astype(np.float32)
    fragments = [_discs(camera, seen, facing, radius, cut, front[i : i + CHUNK]) for i in range(0, len(front), CHUNK)]
    empty = np.zeros(0, int), np.zeros(0, int), np.zeros(0, np.float32), np.zeros(0, np.float32)
    disc, pixel, z, weight = (np.concatenate([f[i] for f in [empty, *fragments]]) for i in range(4))

    depth = np.full(width * height, NOTHING, np.float32)
    np.maximum.at(depth, pixel, z)
    top = z > depth[pixel] - 0.8 * radius
    disc, pixel, z, weight = disc[top], pixel[top], z[top], weight[top]
    total = np.bincount(pixel, weight, width * height)
    there = total > 0.0
    share = 1.0 / np.where(there, total, 1.0)

    def mean(values: AnyArray) -> AnyArray:
        blended: AnyArray = (np.bincount(pixel, weight * values, width * height) * share).astype(np.float32)
        return blended

    facing = facing.astype(np.float32)
    normal = np.stack([mean(facing[disc, i]) for i in range(3)], axis=-1)
    normal /= np.maximum(np.sqrt(np.einsum("ij,ij->i", normal, normal)), 1e-9)[:, None]
    if (colours == colours[:1]).all():
        colour = np.where(there[:, None], colours[:1], np.float32(0.0))
    else:
        colour = np.stack([mean(colours[disc, i]) for i in range(4)], axis=-1)
    blended = np.where(there, mean(z), np.float32(NOTHING))
    return Layer(blended.reshape(height, width), normal.reshape(height, width, 3), colour.reshape(height, width, 4))


def _discs(
    camera: Camera, seen: AnyArray, facing: AnyArray, radius: float, cut: AnyArray | None, chosen: AnyArray
) -> tuple[AnyArray, AnyArray, AnyArray, AnyArray]:
    """The pixels under some discs: number of the disc, number of the pixel, depth (m), weight."""
    width, height = camera.size
    reach = int(np.ceil(radius * camera.scale))
    step = np.arange(-reach, reach + 1)
    centre = seen[chosen]
    column = np.floor(centre[:, 0] * camera.scale + width / 2).astype(int)[:, None, None] + step[None, None, :]
    row = np.floor(height / 2 - centre[:, 1] * camera.scale).astype(int)[:, None, None] + step[None, :, None]
    right = ((column + 0.5 - width / 2) / camera.scale - centre[:, 0, None, None]).astype(np.float32)
    up = ((height / 2 - row - 0.5) / camera.scale - centre[:, 1, None, None]).astype(np.float32)
    n = facing[chosen].astype(np.float32)[:, :, None, None]
    # Height of the disc's plane above its centre; discs seen from the side are taken for a little less so.
    rise = -(n[:, 0] * right + n[:, 1] * up) / np.maximum(n[:, 2], 0.2)
    far = (right**2 + up**2 + rise**2) / np.float32(radius**2)
    inside = (far <= 1.0) & (column >= 0) & (column < width) & (row >= 0) & (row < height)
    if cut is not None:
        # Few discs are near an edge: only theirs are looked at.
        near = np.flatnonzero(np.isfinite(cut[chosen, 0, 3]))
        for plane in np.moveaxis(cut[chosen[near]], 1, 0).astype(np.float32)[..., None, None]:
            inside[near] &= plane[:, 0] * right[near] + plane[:, 1] * up[near] + plane[:, 2] * rise[near] <= plane[:, 3]
    disc = np.broadcast_to(chosen[:, None, None], inside.shape)[inside]
    return disc, (row * width + column)[inside], (centre[:, 2, None, None].astype(np.float32) + rise)[inside], np.exp(-2.5 * far[inside])


def edge_planes(points: AnyArray, normals: AnyArray, radius: float, *, turn: float = 0.9) -> AnyArray:
    """Planes (n, 2, 4) that cut discs off at convex edges (M. Zwicker and others, Perspective Accurate Splatting, 2004).

    A disc about a point ``p`` keeps the places ``x`` with ``m.(x - p) <= level``; ``m`` are the first three figures of a plane,
    ``level`` (m) the last, infinity where nothing is cut. The planes are those of the nearest point within twice the
    ``radius`` whose normal is ``turn`` rad or more off, and of the nearest one that is off from both: a corner.
    """
    planes = np.zeros((len(points), 2, 4))
    planes[..., 3] = np.inf
    distance, near = cKDTree(points).query(points, k=min(24, len(points)), distance_upper_bound=2.0 * radius)
    found = np.isfinite(distance)
    near = np.where(found, near, 0)
    other = normals[near]
    level = np.einsum("nkj,nkj->nk", other, points[near] - points[:, None, :])
    bends = found & (np.einsum("nkj,nj->nk", other, normals) < np.cos(turn)) & (level > 0.0)
    for i in range(2):
        at = np.flatnonzero(bends.any(axis=1))
        first = bends[at].argmax(axis=1)
        chosen = other[at, first]
        planes[at, i, :3], planes[at, i, 3] = chosen, level[at, first]
        bends[at] &= np.einsum("nkj,nj->nk", other[at], chosen) < np.cos(turn)
    return planes


def tube(a: AnyArray, b: AnyArray, start: float, end: float, spacing: float) -> tuple[AnyArray, AnyArray]:
    """Points and normals (n, 3) of a round tube from ``a`` to ``b`` (3,) m, of radius ``start`` there and ``end`` here, with
    round ends, about ``spacing`` m apart.
    """
    a, b = np.asarray(a, float), np.asarray(b, float)
    axis = b - a
    length = float(np.linalg.norm(axis))
    parts = [_sphere(a, start, spacing), _sphere(b, end, spacing)]
    if length > 1e-9:
        axis /= length
        side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        side /= np.linalg.norm(side)
        rings, around = max(2, int(length / spacing)), max(8, int(2 * np.pi * max(start, end) / spacing))
        s, phi = (g.ravel() for g in np.meshgrid(np.linspace(0, 1, rings), 2 * np.pi * np.arange(around) / around, indexing="ij"))
        out = np.cos(phi)[:, None] * side + np.sin(phi)[:, None] * np.cross(axis, side)
        points = a + s[:, None] * length * axis + (start + s * (end - start))[:, None] * out
        normals = out + (start - end) / length * axis
        parts.append((points, normals / np.linalg.norm(normals, axis=1, keepdims=True)))
    return np.concatenate([p for p, _ in parts]), np.concatenate([n for _, n in parts])


def _sphere(centre: AnyArray, radius: float, spacing: float) -> tuple[AnyArray, AnyArray]:
    normals = directions(max(50, int(4 * np.pi * (radius / spacing) ** 2)))
    return centre + radius * normals, normals


def directions(n: int) -> AnyArray:
    """``n`` unit vectors (n, 3), evenly spread: Fibonacci's spiral."""
    i = np.arange(n) + 0.5
    z, phi = 1.0 - 2.0 * i / n, np.pi * (1.0 + 5**0.5) * i
    r = np.sqrt(1.0 - z**2)
    spread: AnyArray = np.column_stack([r * np.cos(phi), r * np.sin(phi), z])
    return spread


__all__ = ["directions", "edge_planes", "splat", "tube"]
