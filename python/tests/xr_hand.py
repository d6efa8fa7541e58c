"""A synthetic hand for tests of WebXR: the 25 joints of a right hand about the box of ``quasirigid grasp``, open and closed."""

from __future__ import annotations

import numpy as np

from quasirigid.arrays.types import FloatArray
from quasirigid.mocap.webxr import JOINTS

ROOM_FROM_WORLD = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
"""Heading 0: world x is -z of the room, world y is -x, world z is y."""
RADIUS = 0.008
GRIP = 0.010
"""How far the closed tips are inside the box, m: what the springs make a force of."""


def tip_axes(facing: FloatArray) -> FloatArray:
    """Columns x, y, z of our tip frame, world: a finger that hangs down, its pad turned to ``facing``."""
    x, z = np.array([0.0, 0.0, -1.0]), -facing
    return np.stack([x, np.cross(z, x), z], axis=1)


def joint_axes(ours: FloatArray) -> FloatArray:
    """The same frame with the axes of WebXR: x = -y, y = z, z = -x of ours."""
    return np.stack([-ours[:, 1], ours[:, 2], -ours[:, 0]], axis=1)


def hand(half_width: float, opening: float) -> tuple[FloatArray, FloatArray]:
    """Places (25, 3) m and axes (25, 3, 3), WebXR, both in the world, of a hand whose pads are ``opening`` away from the box (m; < 0:
    inside).
    """
    away = half_width + RADIUS + opening
    places, axes = np.zeros((25, 3)), np.tile(joint_axes(np.eye(3)), (25, 1, 1))

    def put(joint: str, place: tuple[float, float, float], facing: FloatArray | None = None) -> None:
        i = JOINTS.index(joint)
        places[i] = place
        if facing is not None:
            axes[i] = joint_axes(tip_axes(facing))

    ahead = np.array([1.0, 0.0, 0.0])
    put("wrist", (-0.100, -0.008, 0.125))
    put("thumb-metacarpal", (-0.080, 0.010, 0.110))
    put("thumb-phalanx-proximal", (-0.065, 0.008, 0.090), ahead)
    put("thumb-phalanx-distal", (-away - 0.01, 0.004, 0.068), ahead)
    put("thumb-tip", (-away, 0.0, 0.04), ahead)
    for finger, y in (("index", 0.012), ("middle", -0.012)):
        put(f"{finger}-finger-metacarpal", (-0.085, 0.5 * y, 0.120))
        put(f"{finger}-finger-phalanx-proximal", (-0.014, y, 0.107))
        put(f"{finger}-finger-phalanx-intermediate", (away - 0.005, y, 0.095), -ahead)
        put(f"{finger}-finger-phalanx-distal", (away + 0.003, y, 0.068), -ahead)
        put(f"{finger}-finger-tip", (away, y, 0.04), -ahead)
    for finger, y in (("ring", -0.036), ("pinky", -0.058)):  # stretched, clear of the box
        put(f"{finger}-finger-metacarpal", (-0.085, 0.5 * y, 0.120))
        for part, x in (("proximal", -0.018), ("intermediate", 0.015), ("distal", 0.040)):
            put(f"{finger}-finger-phalanx-{part}", (x, y, 0.115))
        put(f"{finger}-finger-tip", (0.060, y, 0.115))
    return places, axes


def matrices(half_width: float, opening: float) -> dict[str, list[float]]:
    """The hand in the room about the place of the world's origin, as column-major 4x4 matrices by joint."""
    places, axes = hand(half_width, opening)
    found = {}
    for i, name in enumerate(JOINTS):
        matrix = np.eye(4)
        matrix[:3, :3] = ROOM_FROM_WORLD @ axes[i]
        matrix[:3, 3] = ROOM_FROM_WORLD @ places[i]
        found[name] = [float(x) for x in matrix.T.ravel()]
    return found
