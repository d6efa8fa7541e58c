"""The bodies of a scene where they are and as they are deformed, ready to be drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from quasirigid.arrays.types import AnyArray
from quasirigid.render.camera import Camera
from quasirigid.render.layer import Layer
from quasirigid.render.triangles import IntArray, rasterise
from quasirigid.rotation import rotate
from quasirigid.scene.model import BodyView, SceneModel, SceneState
from quasirigid.scene.pressure import pad_colours, spread


@dataclass(frozen=True, eq=False)
class Part:
    """A mesh to draw: points and normals (n, 3), world, colours (n, 4), faces (m, 3)."""

    points: AnyArray
    normals: AnyArray
    colours: AnyArray
    faces: IntArray

    def drawn_by(self, camera: Camera, *, back: bool = False) -> Layer:
        """What a camera sees of it."""
        return rasterise(camera, self.points, self.normals, self.colours, self.faces, back=back)


def joined(parts: list[Part]) -> Part:
    """Several parts as one."""
    starts = np.cumsum([0, *(len(part.points) for part in parts[:-1])])
    return Part(
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.colours for part in parts]),
        np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)]),
    )


class PosedScene:
    """The bodies of a ``model``; fingertips have the colours of their pressure, of which ``peak`` Pa is the top of the scale."""

    def __init__(self, model: SceneModel, peak: float) -> None:
        self.model, self.peak = model, peak

    def posed(self, state: SceneState, index: int) -> Part:
        """A body where it is and as it is deformed; a fingertip has the colours of its pressure."""
        body = self.model.bodies[index]
        points = world_points(body, state, index)
        colours = np.tile(np.array([*body.colour, 0.0], np.float32), (len(points), 1))
        if body.kind == "fingertip":
            colours = self._pad_colours(points, state, index)
        return Part(points, world_normals(body, state, index, points), colours, body.faces)

    def _pad_colours(self, points: AnyArray, state: SceneState, body: int) -> AnyArray:
        """Colours (n, 4) of a fingertip's ``points`` under the pressure of its contacts."""
        c = state.contacts
        mine = c.on(body) & (c.pressures > 0.0)
        return pad_colours(spread(points, c.points[mine], c.pressures[mine], c.areas[mine]), self.peak)


def world_points(body: BodyView, state: SceneState, index: int) -> AnyArray:
    """The points of a body where they are now, (n, 3) m, world."""
    points = body.points
    if index in state.moved:
        points = points.copy()
        points[state.moved[index].indices] = state.moved[index].points
    placed: AnyArray = rotate(state.quaternions[index], points) + state.positions[index]
    return placed


def world_normals(body: BodyView, state: SceneState, index: int, points: AnyArray) -> AnyArray:
    """The normals of a body now, (n, 3), world: where ``points`` (as of ``world_points``) are displaced, those of the triangles around."""
    normals: AnyArray = rotate(state.quaternions[index], body.normals)
    if index in state.moved and len(body.faces):
        corner = points[body.faces]
        flat = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        around = np.zeros_like(points)
        for i in range(3):
            np.add.at(around, body.faces[:, i], flat)
        length = np.linalg.norm(around, axis=1)
        mine = state.moved[index].indices
        mine = mine[length[mine] > 0.0]
        normals[mine] = around[mine] / length[mine, None]
    return normals
