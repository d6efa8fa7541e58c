"""What a camera has seen of some bodies, pixel by pixel, and how it looks under the lights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter, maximum_filter, minimum_filter, zoom

from quasirigid.arrays.types import AnyArray

NOTHING = -1e9
"""Depth where nothing was drawn, m."""
KEY_LIGHT, FILL_LIGHT = np.array([-0.45, 0.65, 0.61]), np.array([0.7, 0.1, 0.7])
"""Towards the lights, camera axes."""


@dataclass(frozen=True, eq=False)
class Layer:
    """What was drawn: ``depth`` (height, width) m, ``normal`` (height, width, 3) camera axes, ``colour`` (height, width, 4) in
    0 to 1: red, green, blue, and how little the light changes them.
    """

    depth: AnyArray
    normal: AnyArray
    colour: AnyArray

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


def shade(layer: Layer, scale: float, *, gloss: float = 0.15, hollows: bool = True) -> AnyArray:
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


def _unit(v: AnyArray) -> AnyArray:
    unit: AnyArray = (v / np.linalg.norm(v)).astype(np.float32)
    return unit


def _openness(layer: Layer, scale: float) -> AnyArray:
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
    fine: AnyArray = zoom(open_, coarse, order=1, grid_mode=True, mode="nearest")[:height, :width_px]
    return fine


def outline(layer: Layer, step: float, *, thickness: int = 3) -> AnyArray:
    """1 where the depth jumps by more than ``step`` m within ``thickness`` px, else 0: the outlines, on the nearer side."""
    behind = minimum_filter(layer.depth, size=thickness)
    edges: AnyArray = (layer.drawn & (layer.depth - behind > step)).astype(np.float32)
    return edges


def creases(layer: Layer, *, turn: float = 0.6, thickness: int = 3) -> AnyArray:
    """1 where the normal turns by more than about ``turn`` rad within ``thickness`` px, else 0."""
    spread = np.zeros(layer.depth.shape, np.float32)
    for i in range(3):
        spread += (maximum_filter(layer.normal[..., i], size=thickness) - minimum_filter(layer.normal[..., i], size=thickness)) ** 2
    sharp: AnyArray = (layer.drawn & (spread > turn**2)).astype(np.float32)
    return sharp


def halved(image: AnyArray, factor: int = 2) -> AnyArray:
    """The image (height, width, 3) with ``factor`` x ``factor`` pixels made one: smooth edges."""
    height, width = image.shape[0] // factor, image.shape[1] // factor
    small: AnyArray = image[: height * factor, : width * factor].reshape(height, factor, width, factor, -1).mean(axis=(1, 3))
    return small
