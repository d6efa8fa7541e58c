"""What a page is sent of a scene: little, and only what an eye in a headset can see.

A pixel of a headset is about 0.3 mm wide at the distance of a table. So bodies that hardly deform are sent with few triangles, and the
displacement of a point in 1/127 of the largest one of its body.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from quasirigid.arrays.types import IntArray
from quasirigid.mocap.observation import press_and_slip
from quasirigid.mocap.webxr.messages import packed
from quasirigid.scene.meshes import thinned
from quasirigid.scene.model import SceneModel, SceneState
from quasirigid.scene.palette import FINGER_COLOURS
from quasirigid.scene.pressure import Scale, byte_colours, patch_of, pressure_at

FEW = 1_000
"""Objects and supports of more points are sent with fewer triangles as long as they do not deform by ``SEEN``."""
SEEN = 2e-5
"""No displacement under this is sent, m."""
LEVELS = 127
"""Of a displacement, each way."""
LOADED = 1e-6
"""Contacts and fingers that press with less are not drawn, N."""


class SceneWire:
    """Makes the messages of one scene. Not thread safe."""

    def __init__(self, model: SceneModel) -> None:
        self.model = model
        self.scale = Scale()
        """Of the pressure colours."""
        self._tips = model.fingertips()
        self._thin: dict[int, tuple[IntArray, IntArray]] = {}
        for i, body in enumerate(model.bodies):
            if len(body.points) > FEW and body.kind in ("object", "support"):
                coarse = thinned(body.points, body.normals)
                if coarse is not None:
                    self._thin[i] = coarse
        self._object = next((i for i, body in enumerate(model.bodies) if body.kind == "object"), None)
        self._height: float | None = None

    def model_message(self) -> bytes:
        """The bodies: meshes in their own frames, names of the fingers, colours."""
        arrays: dict[str, npt.NDArray[Any]] = {"colours": byte_colours()}
        bodies = []
        for i, body in enumerate(self.model.bodies):
            bodies.append({"name": body.name, "kind": body.kind, "colour": [float(c) for c in body.colour], "finger": body.finger})
            kept, faces = self._thin.get(i, (slice(None), body.faces))
            arrays |= {
                f"points{i}": body.points[kept].astype(np.float32),
                f"normals{i}": body.normals[kept].astype(np.float32),
                f"faces{i}": faces.astype(_counting(len(body.points))),
            }
        fingers = [{"name": name, "colour": FINGER_COLOURS[k % len(FINGER_COLOURS)]} for k, name in enumerate(self.model.fingers)]
        return packed({"type": "model", "bodies": bodies, "fingers": fingers, "floor": float(self.model.floor)}, arrays)

    def outgrown(self, state: SceneState) -> bool:
        """Whether a body that was sent with few triangles deforms visibly: the model is then to be sent again, with all of its points."""
        found = False
        for i in list(self._thin):
            moved, body = state.moved.get(i), self.model.bodies[i]
            if moved is not None and body.kind == "object" and np.abs(moved.points - body.points[moved.indices]).max() > SEEN:
                del self._thin[i]
                found = True
        return found

    def state_message(self, state: SceneState) -> bytes:
        """Poses (bodies, 7), what deforms and its pressure, the forces of the pads on what they touch, per contact and per finger."""
        arrays: dict[str, npt.NDArray[Any]] = {
            "poses": np.concatenate([state.positions, state.quaternions], axis=1).astype(np.float32),
            **self._forces(state),
        }
        quanta: dict[int, float] = {}
        for i, moved in state.moved.items():
            body = self.model.bodies[i]
            if i in self._thin or body.kind == "support":
                continue
            by = moved.points - body.points[moved.indices]
            size = np.abs(by).max(axis=1)
            seen = size > SEEN
            if not seen.any():
                continue
            quanta[i] = float(size.max()) / LEVELS
            arrays[f"at{i}"] = moved.indices[seen].astype(_counting(len(body.points)))
            arrays[f"by{i}"] = np.rint(by[seen] / quanta[i]).astype(np.int8)
            if i in self._tips:
                arrays[f"press{i}"] = self._pressure(state, i, moved.points[seen])
        header = {
            "type": "state",
            "time": state.time,
            "step": state.step,
            "phase": state.phase,
            "notice": state.notice,
            "fingers": self._fingers(state),
            "lifted_m": self._lifted(state),
            "scale_pa": self.scale.top,
            "quanta_m": quanta,
        }
        return packed(header, arrays)

    def _pressure(self, state: SceneState, tip: int, points: npt.NDArray[np.float64]) -> npt.NDArray[np.uint8]:
        """Share of full scale at ``points`` (n, 3) of a pad, body frame, 0 to 255."""
        patch = patch_of(state, tip)
        share = np.zeros(len(points))
        near = patch.near(points)
        if len(near):
            self.scale.follow(float(patch.pressures.max()))
            share[near] = pressure_at(points[near], patch) / self.scale.top
        return np.rint(255.0 * np.clip(share, 0.0, 1.0)).astype(np.uint8)

    def _forces(self, state: SceneState) -> dict[str, npt.NDArray[Any]]:
        """Arrows from pads into what they touch: ``contacts`` (c, 6) with their ``status`` (c,), and ``sums`` (fingers, 6): point m, force
        N, world.
        """
        c = state.contacts
        on_tip, by_tip = np.isin(c.collider_a, self._tips), np.isin(c.collider_b, self._tips)
        mine = (on_tip | by_tip) & (c.reactions[:, 0] > LOADED)
        forces = np.where(on_tip, -1.0, 1.0)[mine, None] * c.forces[mine]
        sums = np.zeros((len(self._tips), 6))
        for finger, tip in enumerate(self._tips):
            press = c.reactions[:, 0] * c.on(tip)
            if press.sum() > LOADED:
                sums[finger, :3] = press @ c.points / press.sum()
                sums[finger, 3:] = state.finger_forces[finger]
        return {
            "contacts": np.concatenate([c.points[mine], forces], axis=1).astype(np.float32),
            "status": c.status[mine],
            "sums": sums.astype(np.float32),
        }

    def _fingers(self, state: SceneState) -> list[list[float]]:
        """Per finger: normal force, N, and the share of it whose contacts slip."""
        sums = (press_and_slip(state.contacts, tip) for tip in self._tips)
        return [[round(total, 4), round(slip, 3) if total > LOADED else 0.0] for total, slip in sums]

    def _lifted(self, state: SceneState) -> float:
        """How much higher the object is than in the first state of the scene, m."""
        if self._object is None:
            return 0.0
        height = float(state.positions[self._object, 2])
        if self._height is None:
            self._height = height
        return height - self._height


def _counting(points: int) -> type[np.uint16] | type[np.uint32]:
    """What counts that many points."""
    return np.uint16 if points <= 65536 else np.uint32
