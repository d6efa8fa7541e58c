"""Rotations of single poses and of the six of a hand.

Plain sums of products: `numpy.cross` takes ten times as long for so few numbers, and this is done in every step.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
_YZX, _ZXY = np.array([1, 2, 0]), np.array([2, 0, 1])


def minus_z(q: FloatArray) -> FloatArray:
    """The negative z axes of the frames ``q`` (n, 4)."""
    w, x, y, z = q.T
    facing = np.empty((len(q), 3))
    facing[:, 0] = -2.0 * (x * z + w * y)
    facing[:, 1] = -2.0 * (y * z - w * x)
    facing[:, 2] = 2.0 * (x * x + y * y) - 1.0
    return facing


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross products of rows (n, 3)."""
    return a[:, _YZX] * b[:, _ZXY] - a[:, _ZXY] * b[:, _YZX]


def matrix(q: FloatArray) -> FloatArray:
    """(3, 3) of the quaternion ``q`` (4,)."""
    w, x, y, z = q.tolist()
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def rotation_vector(q: FloatArray) -> FloatArray:
    """Rotation vector of a unit quaternion, angle at most pi."""
    w, x, y, z = q.tolist()
    sine = math.copysign(math.hypot(x, y, z), w)
    share = math.copysign(2.0, w) if abs(sine) < 1e-9 else 2.0 * math.atan2(abs(sine), abs(w)) / sine
    return np.array([share * x, share * y, share * z])


def quaternion(vector: FloatArray) -> FloatArray:
    """The inverse of ``rotation_vector``."""
    x, y, z = vector.tolist()
    angle = math.hypot(x, y, z)
    share = 0.5 if angle < 1e-9 else math.sin(0.5 * angle) / angle
    return np.array([math.cos(0.5 * angle), share * x, share * y, share * z])
