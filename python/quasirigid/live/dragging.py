"""Hands on the scene: the object is dragged with the mouse, the hand's base and its fingertips by gizmos."""

from __future__ import annotations

from typing import Any

import numpy as np
import viser

from quasirigid.arrays.types import FloatArray
from quasirigid.live.draw import SceneDrawing
from quasirigid.live.session import Frame, Session
from quasirigid.rotation import conjugate, matrix_of, rotate

BASE_SCALE, FINGER_SCALE = 0.04, 0.02
"""Size of the gizmos, m."""
ABOVE = 0.035
"""The base's gizmo sits so far above the palm, where nothing hides it, m."""
BACK = 0.03
"""A fingertip's gizmo sits so far behind its pad, m."""
HANDLES = ("move and turn", "move", "turn", "none")
"""What the handle of the hand does. Its arcs cost a page without a graphics card up to two frames in fifteen."""


class Touch:
    """Gizmos and dragging. Callbacks run on the server's event loop and only put commands into the session's queue."""

    def __init__(self, server: viser.ViserServer, session: Session, drawing: SceneDrawing, frame: Frame) -> None:
        self._session = session
        self._frame = frame
        self._grabbed: FloatArray | None = None
        self._held: set[str] = set()
        self._object: viser.MeshHandle | None = None
        self._base = server.scene.add_transform_controls(
            "/touch/base", scale=BASE_SCALE, line_width=2.5, disable_sliders=True, depth_test=False, opacity=0.9
        )
        self._fingers = [
            server.scene.add_transform_controls(
                f"/touch/finger {i}", scale=FINGER_SCALE, disable_rotations=True, depth_test=False, opacity=0.9, visible=False
            )
            for i in range(len(frame.model.fingers))
        ]
        self._base.on_update(self._drag_base)
        for finger, gizmo in enumerate(self._fingers):
            self._hold_finger(finger, gizmo)
        for body, mesh in zip(frame.model.bodies, drawing.meshes, strict=True):
            if body.kind == "object" and mesh is not None:
                self._object = mesh
                break
        self.follow(frame)

    def remove(self) -> None:
        """Takes the gizmos out of the page."""
        for gizmo in (self._base, *self._fingers):
            gizmo.remove()

    def show(self, base: str, fingers: bool) -> None:
        """Which gizmos are there: ``base`` is one of ``HANDLES``. With those of the fingertips the object cannot be dragged: the mouse
        would meet it before arrows that point at it.
        """
        self._base.visible = base != "none"
        self._base.disable_axes, self._base.disable_rotations = base == "turn", base == "move"
        for gizmo in self._fingers:
            gizmo.visible = fingers
        if self._object is not None:
            self._object.remove_drag_callback()
            if not fingers:
                self._object.on_drag(self._drag_object)

    def follow(self, frame: Frame) -> None:
        """Gizmos that nobody holds go where the hand is."""
        self._frame = frame
        position, quaternion = frame.base
        if "base" not in self._held:
            place = position + ABOVE * matrix_of(quaternion)[:, 2]
            if np.abs(self._base.position - place).max() > 1e-5:
                self._base.position = place
            if np.abs(self._base.wxyz - quaternion).max() > 1e-5:
                self._base.wxyz = quaternion
        for finger, gizmo in enumerate(self._fingers):
            if f"finger {finger}" not in self._held and gizmo.visible:
                gizmo.position = frame.finger_aims[finger] + self._behind(finger)

    def _behind(self, finger: int) -> FloatArray:
        """From the middle of a pad to its gizmo, world."""
        tip = self._frame.model.fingertips()[finger]
        body = self._frame.model.bodies[tip]
        outwards = body.normals.mean(axis=0)
        return rotate(self._frame.state.quaternions[tip], -BACK * outwards / np.linalg.norm(outwards))

    def _hold(self, name: str, phase: str) -> None:
        if phase == "start":
            self._held.add(name)
        elif phase == "end":
            self._held.discard(name)

    async def _drag_base(self, event: Any) -> None:
        if event.client is None:
            return
        self._hold("base", event.phase)
        quaternion = np.array(self._base.wxyz)
        position = np.array(self._base.position) - rotate(quaternion, np.array([0.0, 0.0, ABOVE]))
        self._session.do(lambda play: play.aim_base(position, quaternion))

    def _hold_finger(self, finger: int, gizmo: viser.TransformControlsHandle) -> None:
        async def drag(event: Any) -> None:
            if event.client is None:
                return
            self._hold(f"finger {finger}", event.phase)
            position = np.array(gizmo.position) - self._behind(finger)
            self._session.do(lambda play: play.aim_finger(finger, position))

        gizmo.on_update(drag)

    async def _drag_object(self, event: Any) -> None:
        index = next(i for i, body in enumerate(self._frame.model.bodies) if body.kind == "object")
        if event.phase == "end":
            self._grabbed = None
            self._session.do(lambda play: play.pull(None, None))
            return
        if event.phase == "start" or self._grabbed is None:
            state = self._frame.state
            self._grabbed = rotate(conjugate(state.quaternions[index]), np.array(event.start_position) - state.positions[index])
        grabbed, to = self._grabbed, np.array(event.end_position)
        self._session.do(lambda play: play.pull(grabbed, to))
