"""Worlds of any size are drawn as large as a hand: widths of lines, gaps, tolerances and the camera are then right for all of them.

The scale is a power of ten, 1 for whatever a hand can hold, so that grid and scale bar stay round. It is applied to what is drawn,
nowhere else: words and figures are of the world itself.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from quasirigid.arrays.types import FloatArray
from quasirigid.rotation import rotate
from quasirigid.scene.model import BodyView, Moved, SceneModel, SceneState

USUAL = 0.1
"""Half the diagonal of what is drawn, m, within a factor of the root of ten."""
SOME = 200
"""Points of a body that are used to find out where it is."""


def cloud(model: SceneModel, positions: FloatArray, quaternions: FloatArray) -> FloatArray:
    """Some points (n, 3) m, world, of all bodies that can move; of the supports where there are no others."""
    for supports in (False, True):
        points = [
            positions[i] + rotate(quaternions[i], body.points[:: max(1, len(body.points) // SOME)])
            for i, body in enumerate(model.bodies)
            if len(body.points) and (body.kind == "support") == supports and np.isfinite(positions[i]).all()
        ]
        if points:
            return np.concatenate(points)
    return np.array([[0.0, 0.0, 0.0], [USUAL, USUAL, USUAL]])


def drawing_scale(model: SceneModel, state: SceneState) -> float:
    """Metres in the drawing over metres in the world: a power of ten."""
    if any(body.kind == "link" for body in model.bodies):
        return 1.0
    reach = 0.5 * float(np.linalg.norm(np.ptp(cloud(model, state.positions, state.quaternions), axis=0)))
    return 10.0 ** round(math.log10(USUAL / max(reach, 1e-9)))


def scaled_model(model: SceneModel, scale: float) -> SceneModel:
    """The model as it is drawn, ``scale`` times as large."""
    if scale == 1.0:
        return model

    def scaled(body: BodyView) -> BodyView:
        return replace(body, points=scale * body.points)

    return replace(model, bodies=tuple(scaled(body) for body in model.bodies), floor=scale * model.floor)


def scaled_state(state: SceneState, scale: float) -> SceneState:
    """The state as it is drawn, ``scale`` times as large: lengths and areas; forces, pressures and times are those of the world."""
    if scale == 1.0:
        return state
    c = state.contacts
    contacts = replace(c, points=scale * c.points, gaps=scale * c.gaps, areas=scale**2 * c.areas)
    moved = {body: Moved(m.indices, scale * m.points) for body, m in state.moved.items()}
    tracked = state.tracked
    if tracked is not None:
        places = {name: scale * getattr(tracked, name) for name in ("positions", "radii", "aims", "ends")}
        tracked = replace(tracked, **places)
    return replace(state, positions=scale * state.positions, moved=moved, contacts=contacts, tracked=tracked)


__all__ = ["cloud", "drawing_scale", "scaled_model", "scaled_state"]
