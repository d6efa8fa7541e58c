"""What a tactile sensor on each fingertip would see: pressure and shear over the pad as small pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont
from scipy.spatial import cKDTree

from quasirigid.arrays.types import FloatArray
from quasirigid.scene.model import BodyView, SceneModel, SceneState
from quasirigid.scene.palette import FINGER_COLOURS, SLIP_COLOUR
from quasirigid.scene.pressure import SLIP, colour_map, patch_of, pressure_at, rgb, spread

CELLS = 40
"""Cells of the sensor, each way."""
AROUND = 1.08
"""Side of the picture over the length of the pad: its rim is in the picture."""
SIDE = 108
"""Of a pad's picture, px."""
GAP, HEADING, LETTERS = 8, 19, 14
SHEAR_WORDS = "shear on the pads, same colours, and its direction"
LEAST_COLUMNS = 3
"""The picture is at least as wide as that of so many pads."""
EVERY, ARROW = 5, 14.0
"""Cells from one arrow of shear to the next, and the length of the longest, px."""
LEAST_SHEAR, SEEN_ARROW = 0.01, 0.12
"""Shear under this share of the full scale has no arrows, nor has less than this share of the largest."""
LEAST_SLIP = 0.02
"""A slipping contact is marked if its pressure is more than this share of the full scale."""


class Pad:
    """The plane in which a pad is seen, from outside; the palm is above."""

    def __init__(self, body: BodyView) -> None:
        normal = body.normals.mean(axis=0)
        normal /= np.linalg.norm(normal)
        up = np.array([0.0, 0.0, 1.0]) - normal[2] * normal
        if np.linalg.norm(up) < 0.1:
            up = np.array([0.0, 1.0, 0.0]) - normal[1] * normal
        up /= np.linalg.norm(up)
        self._axes = np.column_stack([np.cross(up, normal), up])
        flat = body.points @ self._axes
        self._low, self._size = flat.min(axis=0), AROUND * float(np.ptp(flat, axis=0).max())
        self._low = self._low - 0.5 * (self._size - np.ptp(flat, axis=0))
        # The point of the pad in each cell: where the sensor's cell lies on the curved surface.
        centres = (np.arange(CELLS) + 0.5) / CELLS * self._size
        grid = np.stack(np.meshgrid(centres, centres[::-1]), axis=-1).reshape(-1, 2) + self._low
        _, nearest = _nearest(grid, flat)
        self.cells = self.flattened(body.points[nearest])
        fine = (np.arange(SIDE) + 0.5) / SIDE * self._size
        pixels = np.stack(np.meshgrid(fine, fine[::-1]), axis=-1).reshape(-1, 2) + self._low
        distance, _ = _nearest(pixels, flat)
        edge = 1.2 * self._size / CELLS
        cover = np.clip((edge - distance) / (self._size / SIDE), 0.0, 1.0)
        self.mask = Image.fromarray((255 * cover).astype(np.uint8).reshape(SIDE, SIDE))

    def flattened(self, points: FloatArray) -> FloatArray:
        """``points`` (n, 3) in the plane of the picture, third coordinate 0: there a pad looks the same pressed in or not."""
        return np.column_stack([points @ self._axes, np.zeros(len(points))])

    def pixels(self, points: FloatArray) -> FloatArray:
        """Where ``points`` (n, 3), body frame, lie in the picture, (n, 2) px from its upper left."""
        share = (points @ self._axes - self._low) / self._size
        place: FloatArray = np.column_stack([share[:, 0], 1.0 - share[:, 1]]) * SIDE
        return place


def _nearest(grid: FloatArray, flat: FloatArray) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    distance, index = cKDTree(flat).query(grid)
    return distance, index


class Tactile:
    """The pictures of all fingertips, side by side: pressure above, shear below."""

    def __init__(self, model: SceneModel) -> None:
        self._tips = model.fingertips()
        self._names = model.fingers
        self._pads = [Pad(model.bodies[tip]) for tip in self._tips]
        columns = max(LEAST_COLUMNS, len(self._pads))
        self._empty = Image.new("RGB", (columns * SIDE + (columns - 1) * GAP, 2 * (HEADING + SIDE)), "white")
        draw, font = ImageDraw.Draw(self._empty), ImageFont.load_default(LETTERS)
        for i, name in enumerate(self._names):
            draw.text((i * (SIDE + GAP), 0), name, fill=FINGER_COLOURS[i % 6], font=font)
        draw.text((0, SIDE + HEADING), SHEAR_WORDS, fill="#374151", font=font)

    def picture(self, state: SceneState, full_scale: float) -> npt.NDArray[np.uint8]:
        """(height, width, 3): colour is pressure, and below it shear on the pad, against ``full_scale``, Pa; an orange cross is a contact
        that slips, arrows are the direction of the shear.
        """
        image = self._empty.copy()
        draw = ImageDraw.Draw(image)
        shears = []
        for i, (tip, pad) in enumerate(zip(self._tips, self._pads, strict=True)):
            left = i * (SIDE + GAP)
            patch = patch_of(state, tip)
            pressure, shear = np.zeros(CELLS * CELLS), np.zeros((CELLS * CELLS, 2))
            flat = replace(patch, points=pad.flattened(patch.points))
            near = flat.near(pad.cells)
            pressure[near] = pressure_at(pad.cells[near], flat)
            shear[near] = spread(pad.cells[near], flat.points, pad.flattened(patch.shear)[:, :2], flat.areas)
            shears.append(shear)
            for row, field in enumerate((pressure, np.linalg.norm(shear, axis=1))):
                colours = colour_map(field.reshape(CELLS, CELLS) / full_scale)
                top = HEADING + row * (HEADING + SIDE)
                image.paste(Image.fromarray(colours).resize((SIDE, SIDE), Image.Resampling.BICUBIC), (left, top), pad.mask)
            slipping = (patch.status == SLIP) & (patch.pressures > LEAST_SLIP * full_scale)
            for x, y in pad.pixels(patch.points[slipping]) + [left, HEADING]:
                for side in (-2, 2):
                    draw.line((x - 2, y - side, x + 2, y + side), fill=tuple(rgb(SLIP_COLOUR).tolist()))
        self._arrows(draw, shears, LEAST_SHEAR * full_scale)
        return np.asarray(image)

    def _arrows(self, draw: ImageDraw.ImageDraw, shears: list[FloatArray], least: float) -> None:
        """Direction of the ``shears`` (cells, 2) Pa of all pads; the longest arrow is the largest shear, if that is above ``least`` Pa."""
        largest = max((float(np.linalg.norm(shear, axis=1).max()) for shear in shears), default=0.0)
        if largest < least:
            return
        some = np.arange(EVERY // 2, CELLS, EVERY)
        for i, shear in enumerate(shears):
            field = shear.reshape(CELLS, CELLS, 2)[np.ix_(some, some)]
            for row, column in np.argwhere(np.linalg.norm(field, axis=2) > SEEN_ARROW * largest):
                along = field[row, column] * [1.0, -1.0] * (ARROW / largest)  # rows of a picture run down
                centre = np.array([some[column], some[row]]) + 0.5
                middle = centre * (SIDE / CELLS) + [i * (SIDE + GAP), 2 * HEADING + SIDE]
                tip, across = middle + 0.5 * along, np.array([-along[1], along[0]])
                draw.line((*(middle - 0.5 * along), *tip), fill="white")
                for side in (-0.25, 0.25):
                    draw.line((*tip, *(tip - 0.35 * along + side * across)), fill="white")
