"""The floor under a scene, solid and glass over it, and from where a hand is looked at."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from quasirigid.arrays.types import AnyArray
from quasirigid.render.layer import Layer, creases, outline, shade
from quasirigid.rotation import rotate

EDGE = (0.20, 0.26, 0.34)
GRID, CELL = 0.01, 1.5e-3
"""Spacing of the floor's lines, and size of the cells of shadows, m."""


def floor_lines(x: AnyArray, y: AnyArray, middle: AnyArray, reach: float) -> AnyArray:
    """How strong the grid is (height, width) where the pixels see the floor at ``x``, ``y`` m; it fades out at ``reach`` m from the
    ``middle``.
    """
    far = np.hypot(x - middle[0], y - middle[1]) / reach
    lines = np.zeros(x.shape)
    # Lines one fine pixel and a half wide, whichever way the floor is foreshortened.
    for along in (x, y):
        slope = np.hypot(*np.gradient(along)) + 1e-12
        off = np.abs((along / GRID + 0.5) % 1.0 - 0.5) * GRID / slope
        lines = np.maximum(lines, np.clip(1.6 - off, 0.0, 1.0))
    strength: AnyArray = np.clip(1.25 * (1.0 - far), 0.0, 1.0) * lines
    return strength


def soft_shadow(covered: AnyArray, x: AnyArray, y: AnyArray, reach: float) -> AnyArray:
    """A soft shadow (height, width), 0 to 1, of what covers the floor: ``covered`` (cells, cells) of ``CELL`` m, along x and y from
    ``-reach``.
    """
    soft = 0.5 * gaussian_filter(covered, 2e-3 / CELL) + 0.5 * gaussian_filter(covered, 7e-3 / CELL)
    dark: AnyArray = map_coordinates(soft, [(x + reach) / CELL - 0.5, (y + reach) / CELL - 0.5], order=1)
    return dark


def tinted(light: AnyArray) -> AnyArray:
    """The colour (height, width, 3) of a floor under this much ``light``: shadows are a little blue."""
    tint = np.array([0.97, 0.985, 1.0])
    floor: AnyArray = np.clip(light[..., None] ** (1.0 / tint), 0.0, 1.0)
    return floor


def compose(background: AnyArray, solid: Layer, glass: list[Layer], scale: float) -> AnyArray:
    """Solid and glass, pixel by pixel from far to near, on a background."""
    body = shade(solid, scale)
    body *= 1.0 - 0.55 * np.clip(outline(solid, 2.5e-3), 0.0, 1.0)[..., None]
    # Where a pad lies on the object, the pad counts as nearer.
    layers = [(solid.depth + np.float32(6e-4), body, solid.drawn.astype(np.float32))]
    for layer in glass:
        facing = np.clip(layer.normal[..., 2], 0.0, 1.0)
        inside = layer is glass[0]
        edge = np.maximum(outline(layer, 2e-3), 0.75 * creases(layer))
        alpha = (0.07 if inside else 0.13) + 0.40 * (1.0 - facing) ** 2.5
        colour = shade(layer, scale, gloss=0.5, hollows=False)
        line = (0.35 if inside else 0.75) * edge
        colour += (np.array(EDGE, np.float32) - colour) * line[..., None]
        layers.append((layer.depth, colour, layer.drawn * np.clip(np.maximum(alpha, line), 0.0, 1.0)))
    image = background.copy()
    # Only where there is anything, as a list of pixels.
    there = np.any([layer.drawn for layer in (solid, *glass)], axis=0)
    pixels = image[there]
    flat = [(depth[there], colour[there], alpha[there]) for depth, colour, alpha in layers]
    order = np.argsort([depth for depth, _, _ in flat], axis=0)
    for rank in order:
        colour = np.choose(rank[:, None], [colour for _, colour, _ in flat])
        share = np.choose(rank, [alpha for _, _, alpha in flat])
        pixels += (colour - pixels) * share[:, None]
    image[there] = pixels
    return image


def view_of(palm: AnyArray, centre: AnyArray) -> AnyArray:
    """Unit vector (3,) towards the viewer, world: from the thumb's side, a little from above, with the palm not in between.

    ``palm`` (7,) pose of the hand, ``centre`` (3,) m of what it holds.
    """
    up = np.array([0.0, 0.0, 1.0])
    across = rotate(palm[3:], np.array([1.0, 0.0, 0.0]))
    across[2] = 0.0
    if np.linalg.norm(across) < 0.3:  # closes upwards: look along the palm's other axis
        across = rotate(palm[3:], np.array([0.0, 1.0, 0.0])) * [1.0, 1.0, 0.0]
    across /= np.linalg.norm(across)
    side = np.cross(up, across)
    if side @ (palm[:3] - centre) > -1e-6:
        side = -side
    turn, lift = np.radians(50.0), np.radians(17.0)
    view: AnyArray = np.cos(lift) * (-np.sin(turn) * across + np.cos(turn) * side) + np.sin(lift) * up
    return view
