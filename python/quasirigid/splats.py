"""Draws point surfaces: discs about the points, blended where they overlap, with a depth buffer. Orthographic, NumPy only.

A pixel takes the mean of the discs that are nearest to the viewer there (M. Botsch and L. Kobbelt, High-Quality Point-Based
Rendering on Modern GPUs, 2003): colours and normals come out smooth, edges between bodies sharp. Camera axes: x to the
right, y upwards, z towards the viewer; depth is along z, larger is nearer.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter, maximum_filter, minimum_filter, zoom
from scipy.spatial import cKDTree

FloatArray = npt.NDArray[Any]

CHUNK = 2000
"""Discs drawn at a time: few enough for the cache."""
NOTHING = -1e9
"""Depth where nothing was drawn, m."""
KEY_LIGHT, FILL_LIGHT = np.array([-0.45, 0.65, 0.61]), np.array([0.7, 0.1, 0.7])
"""Towards the lights, camera axes."""


@dataclass(frozen=True)
class Camera:
    """An orthographic camera: ``axes`` (3, 3) has the camera's x, y, z as columns (world), ``centre`` (3,) m is in the middle of
    the picture, of ``size`` (width, height) px with ``scale`` px/m.
    """

    axes: FloatArray
    centre: FloatArray
    scale: float
    size: tuple[int, int]

    @staticmethod
    def towards(back: FloatArray, up: FloatArray, centre: FloatArray, scale: float, size: tuple[int, int]) -> Camera:
        """The camera that has ``back`` (3,) towards the viewer and ``up`` (3,) as near to upwards as that allows."""
        z = back / np.linalg.norm(back)
        x = np.cross(up, z)
        x /= np.linalg.norm(x)
        return Camera(np.column_stack([x, np.cross(z, x), z]), np.asarray(centre, float), scale, size)

    def project(self, points: FloatArray) -> FloatArray:
        """Points (..., 3) m, world, as seen: x and y in m from the middle of the picture, depth in m."""
        seen: FloatArray = (np.asarray(points, float) - self.centre) @ self.axes
        return seen

    def plane(self, z: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """World x and y (height, width) m and depth of where the rays through the pixels meet the level plane at ``z`` m."""
        width, height = self.size
        right = (np.arange(width) + 0.5 - width / 2) / self.scale
        up = (height / 2 - np.arange(height) - 0.5) / self.scale
        start = self.centre + right[None, :, None] * self.axes[:, 0] + up[:, None, None] * self.axes[:, 1]
        depth = (z - start[..., 2]) / self.axes[2, 2]
        return start[..., 0] + depth * self.axes[0, 2], start[..., 1] + depth * self.axes[1, 2], depth


@dataclass(frozen=True)
class Layer:
    """What was drawn: ``depth`` (height, width) m, ``normal`` (height, width, 3) camera axes, ``colour`` (height, width, 4) in
    0 to 1: red, green, blue, and how little the light changes them.
    """

    depth: FloatArray
    normal: FloatArray
    colour: FloatArray

    @property
    def drawn(self) -> npt.NDArray[np.bool_]:
        """Where there is something."""
        there: npt.NDArray[np.bool_] = self.depth > NOTHING / 2
        return there

    @staticmethod
    def nothing(size: tuple[int, int]) -> Layer:
        """A layer of ``size`` (width, height) px with nothing on it."""
        shape = (size[1], size[0])
        empty = [np.zeros((*shape, n), np.float32) for n in (3, 4)]
        return Layer(np.full(shape, NOTHING, np.float32), *empty)

    def over(self, other: Layer) -> Layer:
        """The nearer of two layers, pixel by pixel."""
        nearer = self.depth >= other.depth
        at = nearer[..., None]
        depth = np.where(nearer, self.depth, other.depth)
        return Layer(depth, np.where(at, self.normal, other.normal), np.where(at, self.colour, other.colour))


def splat(
    camera: Camera, points: FloatArray, normals: FloatArray, colours: FloatArray, radius: float, cut: FloatArray | None = None
) -> Layer:
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

    def mean(values: FloatArray) -> FloatArray:
        blended: FloatArray = (np.bincount(pixel, weight * values, width * height) * share).astype(np.float32)
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
    camera: Camera, seen: FloatArray, facing: FloatArray, radius: float, cut: FloatArray | None, chosen: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
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


def edge_planes(points: FloatArray, normals: FloatArray, radius: float, *, turn: float = 0.9) -> FloatArray:
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


def shade(layer: Layer, scale: float, *, gloss: float = 0.15, hollows: bool = True) -> FloatArray:
    """Colours (height, width, 3) of a layer under the lights, its ``hollows`` darker; ``scale`` px/m as of the camera."""
    drawn = layer.drawn
    n, own = layer.normal[drawn], layer.colour[drawn]
    key = np.clip(n @ _unit(KEY_LIGHT), 0.0, 1.0)
    fill = np.clip(n @ _unit(FILL_LIGHT), 0.0, 1.0)
    light = 0.46 + 0.50 * key + 0.12 * fill + 0.06 * n[:, 1]
    if hollows:
        light *= _openness(layer, scale)[drawn]
    light = 1.0 + (light - 1.0) * (1.0 - 0.75 * own[:, 3])
    half = _unit(_unit(KEY_LIGHT) + _unit(np.array([0.0, 0.0, 1.0])))
    shine = gloss * np.clip(n @ half, 0.0, 1.0) ** 40 * (1.0 - own[:, 3])
    lit = np.zeros(layer.normal.shape, np.float32)
    lit[drawn] = np.clip(own[:, :3] * light[:, None] + shine[:, None], 0.0, 1.0)
    return lit


def _unit(v: FloatArray) -> FloatArray:
    unit: FloatArray = (v / np.linalg.norm(v)).astype(np.float32)
    return unit


def _openness(layer: Layer, scale: float) -> FloatArray:
    """1 in the open, less where a place is deeper than the mean around it (T. Luft, C. Colditz, O. Deussen, 2006)."""
    coarse = 4  # soft anyway
    drawn = layer.drawn[::coarse, ::coarse].astype(np.float32)
    depth = layer.depth[::coarse, ::coarse]
    deep = np.where(drawn > 0.0, depth, 0.0)
    open_ = np.ones(drawn.shape, np.float32)
    for width, strength in ((2e-3, 45.0), (7e-3, 14.0)):
        sigma = width * scale / coarse
        around = gaussian_filter(deep, sigma) / np.maximum(gaussian_filter(drawn, sigma), 1e-3)
        open_ *= 1.0 - np.clip(strength * (around - deep), 0.0, 0.3) * drawn
    height, width_px = layer.depth.shape
    fine: FloatArray = zoom(open_, coarse, order=1, grid_mode=True, mode="nearest")[:height, :width_px]
    return fine


def outline(layer: Layer, step: float, *, thickness: int = 3) -> FloatArray:
    """1 where the depth jumps by more than ``step`` m within ``thickness`` px, else 0: the outlines, on the nearer side."""
    behind = minimum_filter(layer.depth, size=thickness)
    edges: FloatArray = (layer.drawn & (layer.depth - behind > step)).astype(np.float32)
    return edges


def creases(layer: Layer, *, turn: float = 0.6, thickness: int = 3) -> FloatArray:
    """1 where the normal turns by more than about ``turn`` rad within ``thickness`` px, else 0."""
    spread = np.zeros(layer.depth.shape, np.float32)
    for i in range(3):
        spread += (maximum_filter(layer.normal[..., i], size=thickness) - minimum_filter(layer.normal[..., i], size=thickness)) ** 2
    sharp: FloatArray = (layer.drawn & (spread > turn**2)).astype(np.float32)
    return sharp


def halved(image: FloatArray, factor: int = 2) -> FloatArray:
    """The image (height, width, 3) with ``factor`` x ``factor`` pixels made one: smooth edges."""
    height, width = image.shape[0] // factor, image.shape[1] // factor
    small: FloatArray = image[: height * factor, : width * factor].reshape(height, factor, width, factor, -1).mean(axis=(1, 3))
    return small


def tube(a: FloatArray, b: FloatArray, start: float, end: float, spacing: float) -> tuple[FloatArray, FloatArray]:
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


def _sphere(centre: FloatArray, radius: float, spacing: float) -> tuple[FloatArray, FloatArray]:
    normals = directions(max(50, int(4 * np.pi * (radius / spacing) ** 2)))
    return centre + radius * normals, normals


def directions(n: int) -> FloatArray:
    """``n`` unit vectors (n, 3), evenly spread: Fibonacci's spiral."""
    i = np.arange(n) + 0.5
    z, phi = 1.0 - 2.0 * i / n, np.pi * (1.0 + 5**0.5) * i
    r = np.sqrt(1.0 - z**2)
    spread: FloatArray = np.column_stack([r * np.cos(phi), r * np.sin(phi), z])
    return spread


__all__ = ["Camera", "Layer", "creases", "directions", "edge_planes", "halved", "outline", "shade", "splat", "tube"]
