"""Orthographic cameras. Camera axes: x to the right, y upwards, z towards the viewer; depth is along z, larger is nearer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from quasirigid.arrays.types import AnyArray


@dataclass(frozen=True, eq=False)
class Camera:
    """An orthographic camera: ``axes`` (3, 3) has the camera's x, y, z as columns (world), ``centre`` (3,) m is in the middle of
    the picture, of ``size`` (width, height) px with ``scale`` px/m.
    """

    axes: AnyArray
    centre: AnyArray
    scale: float
    size: tuple[int, int]

    @staticmethod
    def towards(back: AnyArray, up: AnyArray, centre: AnyArray, scale: float, size: tuple[int, int]) -> Camera:
        """The camera that has ``back`` (3,) towards the viewer and ``up`` (3,) as near to upwards as that allows."""
        z = back / np.linalg.norm(back)
        x = np.cross(up, z)
        x /= np.linalg.norm(x)
        return Camera(np.column_stack([x, np.cross(z, x), z]), np.asarray(centre, float), scale, size)

    def project(self, points: AnyArray) -> AnyArray:
        """Points (..., 3) m, world, as seen: x and y in m from the middle of the picture, depth in m."""
        seen: AnyArray = (np.asarray(points, float) - self.centre) @ self.axes
        return seen

    def plane(self, z: float) -> tuple[AnyArray, AnyArray, AnyArray]:
        """World x and y (height, width) m and depth of where the rays through the pixels meet the level plane at ``z`` m."""
        width, height = self.size
        right = (np.arange(width) + 0.5 - width / 2) / self.scale
        up = (height / 2 - np.arange(height) - 0.5) / self.scale
        start = self.centre + right[None, :, None] * self.axes[:, 0] + up[:, None, None] * self.axes[:, 1]
        depth = (z - start[..., 2]) / self.axes[2, 2]
        return start[..., 0] + depth * self.axes[0, 2], start[..., 1] + depth * self.axes[1, 2], depth
