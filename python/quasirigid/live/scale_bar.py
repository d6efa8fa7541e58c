"""A scale bar on the floor, in front of what is shown: it has the right length from wherever it is seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import viser

from quasirigid.arrays.types import FloatArray
from quasirigid.live.framing import Frame, Framing
from quasirigid.live.stage import GRID, add_ground
from quasirigid.live.unlit import unlit_glb
from quasirigid.scene.pressure import nice_above
from quasirigid.units import in_small_units

SHARE = 0.12
"""Of the diagonal of the scene: the bar is at least so long."""
THICK, TICK, CLEAR = 1.2e-3, 6e-3, 0.015
"""Thickness of the bar, length of the strokes at its ends, and way to the bodies, m in the drawing."""
INK = np.array([0.03, 0.035, 0.045], np.float32)
"""Linear light."""


def set_scene(server: viser.ViserServer, framing: Framing, frame: Frame, floor: float, scale: float = 1.0) -> None:
    """Floor and scale bar of a scene, and the cameras of all pages that nobody turned. ``frame`` and ``floor``, m, are those of the
    drawing, which is ``scale`` times as large as the world.
    """
    add_ground(server, floor)
    framing.show(add_scale_bar(server, frame, floor, scale))


def add_scale_bar(server: viser.ViserServer, frame: Frame, floor: float, scale: float) -> Frame:
    """Puts the bar on the ``floor``, m in the drawing, which is ``scale`` times as large as the world. The frame with the bar in it."""
    low, high = frame.points.min(axis=0), frame.points.max(axis=0)
    length = nice_above(SHARE * float(np.linalg.norm(high - low)) / scale)
    across = np.array([-frame.towards[1], frame.towards[0], 0.0])
    across /= max(float(np.linalg.norm(across)), 1e-9)
    ahead = np.array([across[1], -across[0], 0.0])
    away = float(((frame.points - 0.5 * (low + high)) @ ahead).max()) + CLEAR
    middle = np.array([*(0.5 * (low + high) + away * ahead)[:2], floor + 4e-4])
    half = 0.5 * length * scale
    strokes = [
        _stroke(middle - half * across, middle + half * across, ahead),
        *(_stroke(middle + s * half * across - TICK * ahead, middle + s * half * across + TICK * ahead, across) for s in (-1.0, 1.0)),
    ]
    points = np.concatenate(strokes)
    faces = np.concatenate([4 * i + np.array([[0, 1, 2], [0, 2, 3]]) for i in range(len(strokes))])
    server.scene.add_glb("/scale bar", unlit_glb(points, faces, INK), cast_shadow=False, receive_shadow=False)
    words = f"{in_small_units(length, 'm')} (grid {in_small_units(GRID / scale, 'm')})"
    server.scene.add_label("/scale bar/words", words, position=middle + 2.0 * TICK * ahead, font_screen_scale=0.8, anchor="top-center")
    ends = middle + half * np.array([[-1.0], [1.0]]) * across
    return replace(frame, points=np.concatenate([frame.points, ends, ends + 4.0 * TICK * ahead]))


def _stroke(start: FloatArray, end: FloatArray, sideways: FloatArray) -> FloatArray:
    """Corners (4, 3) of a flat line that is seen from above."""
    side = 0.5 * THICK * sideways
    corners = np.array([start - side, end - side, end + side, start + side])
    return corners if np.cross(end - start, side)[2] > 0.0 else corners[::-1]


__all__ = ["add_scale_bar", "set_scene"]
