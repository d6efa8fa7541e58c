"""Draws triangle meshes: scan lines with a depth buffer, all triangles at once. Orthographic, NumPy only.

For still and moving pictures. Where every point has its triangles a pixel is covered about twice. Colours and normals go from corner to
corner in straight lines: what changes faster needs more triangles (``quasirigid.scene.sharp_edges``).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from quasirigid.arrays.types import AnyArray
from quasirigid.render.camera import Camera
from quasirigid.render.layer import NOTHING, Layer

IntArray = npt.NDArray[np.integer]


def rasterise(camera: Camera, points: AnyArray, normals: AnyArray, colours: AnyArray, faces: IntArray, *, back: bool = False) -> Layer:
    """Draw a mesh: ``points`` and ``normals`` (n, 3), world, ``colours`` (n, 4) as ``Layer`` has them, ``faces`` (m, 3) counter-clockwise
    from outside.

    Triangles that face away are left out; with ``back`` those alone are drawn, with normals turned round: the far walls seen from inside.
    """
    width, height = camera.size
    seen = camera.project(points)
    facing = (np.asarray(normals, float) @ camera.axes) * (-1.0 if back else 1.0)
    x, y = seen[:, 0] * camera.scale + width / 2, height / 2 - seen[:, 1] * camera.scale
    corner = np.stack([x[faces], y[faces], seen[:, 2][faces]], axis=1)  # (m, xyz, 3)
    u, v = corner[..., 1] - corner[..., 0], corner[..., 2] - corner[..., 0]
    # y runs downwards: counter-clockwise triangles have a negative area here.
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    kept = np.flatnonzero((area > 1e-9) if back else (area < -1e-9))
    face, pixel, depth_of = _fragments(corner[kept], u[kept], v[kept], area[kept], camera.size)

    depth = np.full(width * height, NOTHING, np.float32)
    np.maximum.at(depth, pixel, depth_of)
    top = depth_of == depth[pixel]
    owner = np.full(width * height, -1)
    owner[pixel[top]] = kept[face[top]]
    there = np.flatnonzero(owner >= 0)
    mine = owner[there]
    # Barycentric coordinates of the pixels' centres.
    dx = there % width + 0.5 - corner[mine, 0, 0]
    dy = there // width + 0.5 - corner[mine, 1, 0]
    s = (dx * v[mine, 1] - dy * v[mine, 0]) / area[mine]
    t = (dy * u[mine, 0] - dx * u[mine, 1]) / area[mine]
    share = np.stack([1.0 - s - t, s, t], axis=1).astype(np.float32)
    ids = faces[mine]

    def blend(values: AnyArray) -> AnyArray:
        values = np.asarray(values, np.float32)
        mixed = share[:, :1] * values[ids[:, 0]]
        for i in (1, 2):
            mixed += share[:, i : i + 1] * values[ids[:, i]]
        full = np.zeros((width * height, values.shape[1]), np.float32)
        full[there] = mixed
        return full

    normal = blend(facing)
    normal[there] /= np.maximum(np.linalg.norm(normal[there], axis=1, keepdims=True), 1e-9)
    colour = blend(np.broadcast_to(colours, (len(points), 4)))
    return Layer(depth.reshape(height, width), normal.reshape(height, width, 3), colour.reshape(height, width, 4))


def _fragments(corner: AnyArray, u: AnyArray, v: AnyArray, area: AnyArray, size: tuple[int, int]) -> tuple[IntArray, IntArray, AnyArray]:
    """The pixels whose centres lie in the triangles: number of the triangle, number of the pixel, depth (m).

    A pixel on the common side of two triangles belongs to one of them.
    """
    width, height = size
    first = np.clip(np.ceil(corner[:, 1].min(axis=1) - 0.5), 0, height).astype(int)
    stop = np.clip(np.ceil(corner[:, 1].max(axis=1) - 0.5), 0, height).astype(int)
    face, row = _ranges(first, stop)
    middle = row + 0.5
    left, right = np.full(len(row), np.inf), np.full(len(row), -np.inf)
    for i in range(3):
        j = (i + 1) % 3
        xa, ya, xb, yb = corner[face, 0, i], corner[face, 1, i], corner[face, 0, j], corner[face, 1, j]
        crossed = (ya <= middle) != (yb <= middle)
        x = xa + (middle - ya) * (xb - xa) / np.where(crossed, yb - ya, 1.0)
        left = np.where(crossed, np.minimum(left, x), left)
        right = np.where(crossed, np.maximum(right, x), right)
    empty = left > right
    start = np.where(empty, 0, np.clip(np.ceil(np.where(empty, 0.0, left) - 0.5), 0, width)).astype(int)
    end = np.where(empty, 0, np.clip(np.ceil(np.where(empty, 0.0, right) - 0.5), 0, width)).astype(int)
    span, column = _ranges(start, end)
    face, row = face[span], row[span]
    slope_x = (u[:, 2] * v[:, 1] - v[:, 2] * u[:, 1]) / area
    slope_y = (v[:, 2] * u[:, 0] - u[:, 2] * v[:, 0]) / area
    depth = corner[face, 2, 0] + slope_x[face] * (column + 0.5 - corner[face, 0, 0]) + slope_y[face] * (row + 0.5 - corner[face, 1, 0])
    # Of a sliver seen from the side the plane runs away between the centres of pixels; a triangle is never outside its corners.
    depth = np.clip(depth, corner[:, 2].min(axis=1)[face], corner[:, 2].max(axis=1)[face])
    return face, row * width + column, depth.astype(np.float32)


def _ranges(first: IntArray, stop: IntArray) -> tuple[IntArray, IntArray]:
    """All numbers of all ranges ``first[i]:stop[i]``, one after another: which range, and the number."""
    count = np.maximum(stop - first, 0)
    which = np.repeat(np.arange(len(count)), count)
    number = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count) + np.repeat(first, count)
    return which, number


__all__ = ["rasterise"]
