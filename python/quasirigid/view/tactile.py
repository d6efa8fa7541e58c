"""What a tactile sensor on each fingertip would see: pressure over the pad as a small picture."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

from quasirigid.palette import FINGER_COLOURS
from quasirigid.view.pressure import SLIP, SLIP_COLOUR, colour_map, patch_of, pressure_at, rgb
from quasirigid.view.scene import BodyView, FloatArray, SceneModel, SceneState

CELLS = 40
"""Cells of the sensor, each way."""
SIDE = 108
"""Of a pad's picture, px."""
GAP, HEADING = 8, 16
OUTSIDE = np.array([255, 255, 255], dtype=np.uint8)
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
        self._low, self._size = flat.min(axis=0), float(np.ptp(flat, axis=0).max())
        self._low = self._low - 0.5 * (self._size - np.ptp(flat, axis=0))
        # The point of the pad in each cell: where the sensor's cell lies on the curved surface.
        centres = (np.arange(CELLS) + 0.5) / CELLS * self._size
        grid = np.stack(np.meshgrid(centres, centres[::-1]), axis=-1).reshape(-1, 2) + self._low
        square, nearest = _nearest(grid, flat)
        self.covered = (square < (1.5 * self._size / CELLS) ** 2).reshape(CELLS, CELLS)
        self.cells = body.points[nearest]

    def pixels(self, points: FloatArray) -> FloatArray:
        """Where ``points`` (n, 3), body frame, lie in the picture, (n, 2) px from its upper left."""
        share = (points @ self._axes - self._low) / self._size
        place: FloatArray = np.column_stack([share[:, 0], 1.0 - share[:, 1]]) * SIDE
        return place


def _nearest(grid: FloatArray, flat: FloatArray) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    from scipy.spatial import cKDTree

    distance, index = cKDTree(flat).query(grid)
    return distance**2, index


class Tactile:
    """The pictures of all fingertips, side by side."""

    def __init__(self, model: SceneModel) -> None:
        self._tips = model.fingertips()
        self._names = model.fingers
        self._pads = [Pad(model.bodies[tip]) for tip in self._tips]

    def picture(self, state: SceneState, full_scale: float) -> npt.NDArray[np.uint8]:
        """(height, width, 3): colour is pressure against ``full_scale``, Pa; an orange cross is a contact that slips."""
        columns = max(1, len(self._pads))
        width, height = columns * SIDE + (columns - 1) * GAP, HEADING + SIDE
        image = Image.new("RGB", (width, height), "white")
        draw = ImageDraw.Draw(image)
        for i, (tip, pad) in enumerate(zip(self._tips, self._pads, strict=True)):
            left = i * (SIDE + GAP)
            patch = patch_of(state, tip)
            share = pressure_at(pad.cells, patch).reshape(CELLS, CELLS) / full_scale
            cells = colour_map(share)
            picture = Image.fromarray(cells).resize((SIDE, SIDE), Image.Resampling.BICUBIC)
            mask = Image.fromarray((255 * pad.covered).astype(np.uint8)).resize((SIDE, SIDE), Image.Resampling.BICUBIC)
            image.paste(picture, (left, HEADING), mask)
            draw.text((left, 1), self._names[i], fill=FINGER_COLOURS[i % 6])
            slipping = (patch.status == SLIP) & (patch.pressures > LEAST_SLIP * full_scale)
            for x, y in pad.pixels(patch.points[slipping]) + [left, HEADING]:
                for side in (-2, 2):
                    draw.line((x - 2, y - side, x + 2, y + side), fill=tuple(rgb(SLIP_COLOUR).tolist()))
        return np.asarray(image)
