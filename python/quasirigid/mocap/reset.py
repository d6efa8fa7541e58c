"""The object of a session is put back where it stood at the start."""

from __future__ import annotations

import numpy as np

from quasirigid._quasirigid import Body
from quasirigid.arrays.types import FloatArray
from quasirigid.rotation import conjugate, rotate

CLEARANCE = 0.012
"""A reset waits until the apex of every pad is so far from where the object is to stand, m: more than a pad is wide."""
WAITS = "reset: take the hand away from where the object stood"


def pose_of(body: Body) -> FloatArray:
    """(7,) m and quaternion (w, x, y, z), body frame to world."""
    return np.concatenate([body.position, body.quaternion])


class Reset:
    """Remembers where an object stood, and puts it back when no finger is there."""

    def __init__(self, body: Body) -> None:
        self._object = body
        self.start = pose_of(body)
        """(7,) where it stood."""
        self.pending = False
        """Whether it is to be put back as soon as that can be."""
        self.count = 0
        """How often it was put back."""

    def done(self, ends: FloatArray | None) -> bool:
        """Put it back if no pad is in the way. ``ends`` (fingers, 3) m, world: apex of every pad, ``None`` where there are none."""
        if ends is not None and not self._clear(ends):
            return False
        self._object.set_pose(self.start[:3], self.start[3:])
        self._object.set_velocity((0.0, 0.0, 0.0))
        self.pending = False
        self.count += 1
        return True

    def _clear(self, ends: FloatArray) -> bool:
        surface = self._object.surface
        assert surface is not None
        points, normals = surface.points, surface.normals
        for end in rotate(conjugate(self.start[3:]), ends - self.start[:3]):
            away = end - points
            squared = (away**2).sum(axis=1)
            nearest = int(np.argmin(squared))
            if squared[nearest] < CLEARANCE**2 or away[nearest] @ normals[nearest] < 0.0:
                return False
        return True
