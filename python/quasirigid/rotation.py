"""Rotations: unit quaternions (w, x, y, z), matrices, rotation vectors, and poses (x, y, z, w, x, y, z).

What runs in every step has few numbers and is written as plain sums of products: ``numpy.cross`` takes ten times as long for them.
"""

from __future__ import annotations

import math

import numpy as np

from quasirigid.arrays.types import FloatArray

_YZX, _ZXY = np.array([1, 2, 0]), np.array([2, 0, 1])


def quaternion_product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Hamilton product of quaternions (..., 4) in (w, x, y, z)."""
    aw, ax, ay, az = np.moveaxis(a, -1, 0)
    bw, bx, by, bz = np.moveaxis(b, -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def conjugate(q: FloatArray) -> FloatArray:
    """The inverse of unit quaternions (..., 4)."""
    inverse: FloatArray = q * np.array([1.0, -1.0, -1.0, -1.0])
    return inverse


def rotate(q: FloatArray, v: FloatArray) -> FloatArray:
    """Vectors ``v`` (..., 3) turned by unit quaternions ``q`` (..., 4)."""
    cross = 2.0 * np.cross(q[..., 1:], v)
    turned: FloatArray = v + q[..., :1] * cross + np.cross(q[..., 1:], cross)
    return turned


def rotation_angle(q: FloatArray) -> FloatArray:
    """Angle (rad) of unit quaternions (..., 4), exact for the smallest ones too."""
    angle: FloatArray = 2.0 * np.arctan2(np.linalg.norm(q[..., 1:], axis=-1), np.abs(q[..., 0]))
    return angle


def pose_in(frame: FloatArray, pose: FloatArray) -> FloatArray:
    """Poses (T, 7) (x, y, z, w, x, y, z) as seen from the moving ``frame`` (T, 7)."""
    back = conjugate(frame[..., 3:])
    return np.concatenate([rotate(back, pose[..., :3] - frame[..., :3]), quaternion_product(back, pose[..., 3:])], axis=-1)


def matrix_of(q: FloatArray) -> FloatArray:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    w, x, y, z = q.tolist() if q.ndim == 1 else np.moveaxis(q, -1, 0)
    rows = np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )
    return rows if q.ndim == 1 else np.moveaxis(rows, (0, 1), (-2, -1))


def quaternion_of(matrix: FloatArray) -> FloatArray:
    """(w, x, y, z) of a rotation matrix (3, 3): the row of ``4 q q^T`` with the largest diagonal.

    The sums are in the order of ``scipy.spatial.transform.Rotation``, so that it gives the same bits; that takes 0.1 s to import.
    """
    m = matrix.tolist()
    trace = m[0][0] + m[1][1] + m[2][2]
    w, x, y, z = 1.0 + trace, 1.0 - trace + 2.0 * m[0][0], 1.0 - trace + 2.0 * m[1][1], 1.0 - trace + 2.0 * m[2][2]
    a, b, c = m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]
    d, e, f = m[1][0] + m[0][1], m[2][0] + m[0][2], m[2][1] + m[1][2]
    rows = ((w, a, b, c), (a, x, d, e), (b, d, y, f), (c, e, f, z))
    diagonal = (trace, m[0][0], m[1][1], m[2][2])
    w, x, y, z = rows[diagonal.index(max(diagonal))]
    return np.array([w, x, y, z]) / math.sqrt(x * x + y * y + z * z + w * w)


def rotation_vector(q: FloatArray) -> FloatArray:
    """Rotation vector of a unit quaternion, angle at most pi."""
    w, x, y, z = q.tolist()
    sine = math.copysign(math.hypot(x, y, z), w)
    share = math.copysign(2.0, w) if abs(sine) < 1e-9 else 2.0 * math.atan2(abs(sine), abs(w)) / sine
    return np.array([share * x, share * y, share * z])


def quaternion_of_vector(vector: FloatArray) -> FloatArray:
    """The inverse of ``rotation_vector``."""
    x, y, z = vector.tolist()
    angle = math.hypot(x, y, z)
    share = 0.5 if angle < 1e-9 else math.sin(0.5 * angle) / angle
    return np.array([math.cos(0.5 * angle), share * x, share * y, share * z])


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
