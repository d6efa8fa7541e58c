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


def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Quaternion product."""
    w, v, u, s = a[0], a[1:], b[1:], b[0]
    return np.concatenate([[w * s - v @ u], w * u + s * v + np.cross(v, u)])


def rotation_vector(q: FloatArray) -> FloatArray:
    """Rotation vector of a unit quaternion, angle at most pi."""
    q = q if q[0] >= 0.0 else -q
    sine = float(np.linalg.norm(q[1:]))
    return 2.0 * q[1:] if sine < 1e-9 else q[1:] * (2.0 * math.atan2(sine, float(q[0])) / sine)


def quaternion(vector: FloatArray) -> FloatArray:
    """The inverse of ``rotation_vector``."""
    angle = float(np.linalg.norm(vector))
    share = 0.5 if angle < 1e-9 else math.sin(0.5 * angle) / angle
    return np.concatenate([[math.cos(0.5 * angle)], share * vector])
