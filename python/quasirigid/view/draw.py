"""Draws a scene with viser: takes a model once and then states, from a live world or a recording alike.

What is sent per state is small: poses that changed, the vertices of surfaces that yielded further, the coloured points of the patches,
and one set of line segments for all forces.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import viser

from quasirigid.palette import FINGER_COLOURS
from quasirigid.view.meshes import spacing_of, thinned
from quasirigid.view.pressure import SLIP, SLIP_COLOUR, STICK_COLOUR, Scale, alike, colour_map, patch_of, pressure_at, rgb
from quasirigid.view.scene import BodyView, FloatArray, IntArray, SceneModel, SceneState

POSE_TOLERANCE = 1e-6
"""Poses that changed by less (m, and without unit for quaternions) are not sent again."""
SHAPE_TOLERANCE = 2e-6
"""Nor are vertices that moved by less, m: a fifth of what the view promises."""
LARGE = 10_000
"""Surfaces of more points are sent at most every ``LARGE_EVERY`` seconds."""
LARGE_EVERY = 0.1
FEW = 1_000
"""Objects and supports of more points are drawn with fewer triangles as long as they do not yield by ..."""
SEEN = 4e-6
"""... more than this, m."""
OPAQUE = 0.999
LIFT = 1.5e-4
"""How far the coloured points stand out of the surface, so that it does not hide half of each, m."""
LOADED = 0.01
"""Points under less than this share of the full scale keep the colour of the pad."""
HEAD = 0.3
"""Length of an arrow's head as a share of the arrow."""
INK = np.array([40, 44, 52], dtype=np.uint8)
PULL = rgb("#A8478A")
_SHARE = np.arange(256) / 255.0
LINEAR = (255.0 * np.where(_SHARE <= 0.04045, _SHARE / 12.92, ((_SHARE + 0.055) / 1.055) ** 2.4)).round().astype(np.uint8)
"""The page takes the colours of lines, unlike those of points and meshes, for linear light: from sRGB (IEC 61966-2-1) to that, (256,)."""


@dataclass
class Layers:
    """What is shown."""

    object: bool = True
    object_opacity: float = 0.25
    hand: bool = True
    patches: bool = True
    patch_colours: str = "pressure"
    """``"pressure"`` or ``"stick and slip"``."""
    contact_forces: bool = True
    finger_forces: bool = True
    force_scale: float = 0.012
    """Length of the arrow of 1 N, m, for the sum over a finger."""


class LinePool:
    """Line segments whose number changes: room is kept for some, the rest have no length."""

    def __init__(self, server: viser.ViserServer, name: str, width: float) -> None:
        self._server, self._name, self._width = server, name, width
        self._room = 0
        self._last = np.zeros((0, 2, 3), np.float32)
        self._handle: viser.LineSegmentsHandle | None = None

    def show(self, segments: FloatArray, colours: npt.NDArray[np.uint8]) -> None:
        """``segments`` (n, 2, 3) m, world; ``colours`` (n, 3)."""
        n = len(segments)
        if n == 0 and self._handle is None:
            return
        if n > self._room:
            self._room = max(64, 1 << (n - 1).bit_length())
            self._handle = None
        points = np.zeros((self._room, 2, 3), np.float32)
        points[:n] = segments
        if n:
            points[n:] = segments[0, 0]
        shades = np.zeros((self._room, 2, 3), np.uint8)
        shades[:n] = LINEAR[colours][:, None]
        if self._handle is None:
            self._handle = self._server.scene.add_line_segments(self._name, points, shades, thickness=self._width, thickness_units="screen")
        else:
            self._handle.visible = n > 0
            self._handle.points = points
            self._handle.colors = shades


class PointPool:
    """Coloured points on a body whose number changes."""

    def __init__(self, server: viser.ViserServer, name: str, size: float) -> None:
        self._server, self._name, self._size = server, name, size
        self._room = 0
        self._handle: viser.PointCloudHandle | None = None

    def show(self, points: FloatArray, colours: npt.NDArray[np.uint8]) -> None:
        """``points`` (n, 3) m, body frame; ``colours`` (n, 3)."""
        n = len(points)
        if n == 0:
            if self._handle is not None:
                self._handle.visible = False
            return
        if n > self._room:
            self._room = max(256, 1 << (n - 1).bit_length())
            self._handle = None
        places = np.empty((self._room, 3), np.float32)
        places[:n], places[n:] = points, points[0]
        shades = np.empty((self._room, 3), np.uint8)
        shades[:n], shades[n:] = colours, colours[0]
        if self._handle is None:
            self._handle = self._server.scene.add_point_cloud(
                self._name, places, shades, point_size=self._size, point_shape="circle", precision="float32", point_shading="flat"
            )
        else:
            self._handle.visible = True
            self._handle.points = places
            self._handle.colors = shades


class SceneDrawing:
    """A scene in the page. Call from one thread at a time."""

    def __init__(self, server: viser.ViserServer, model: SceneModel, *, layers: Layers | None = None) -> None:
        self.server, self.model = server, model
        self.layers = layers or Layers()
        self.scale = Scale()
        """Of the pressure colours."""
        self.meshes: list[viser.MeshHandle | None] = []
        self._paths: dict[int, str] = {}
        self._thin: set[int] = set()
        """Bodies that are drawn with fewer triangles."""
        self._sent_shape: dict[int, npt.NDArray[np.float32]] = {}
        self._sent_at: dict[int, float] = {}
        self._patches: dict[int, PointPool] = {}
        self._frames: dict[str, tuple[int, viser.FrameHandle]] = {}
        """By name: a body that has the pose, and the node that carries all bodies of the frame."""
        self._shown: SceneState | None = None
        self._tips = model.fingertips()
        with server.atomic():
            for i, body in enumerate(model.bodies):
                self.meshes.append(self._add(i, body))
        self._contact_lines = LinePool(server, "/forces/contacts", 1.2)
        self._sum_lines = LinePool(server, "/forces/fingers", 4.0)
        self._pull_lines = LinePool(server, "/forces/pull", 4.0)
        self.apply_layers()

    def _add(self, index: int, body: BodyView) -> viser.MeshHandle | None:
        if len(body.faces) == 0:
            return None
        path = f"/bodies/{_path(body.frame or body.name)}"
        if path not in self._frames:
            self._frames[path] = (index, self.server.scene.add_frame(path, show_axes=False))
        path = f"{path}/{_path(body.name)}"
        if body.kind == "fingertip":
            self._patches[index] = PointPool(self.server, f"{path}/pressure", 1.7 * spacing_of(body.points))
        self._paths[index] = path
        coarse = thinned(body.points, body.normals) if len(body.points) > FEW and body.kind in ("object", "support") else None
        if coarse is not None:
            self._thin.add(index)
            return self._mesh(index, body.points[coarse[0]], coarse[1])
        self._sent_shape[index] = body.points.astype(np.float32)
        return self._mesh(index, body.points, body.faces)

    def _mesh(self, index: int, points: FloatArray, faces: IntArray) -> viser.MeshHandle:
        body = self.model.bodies[index]
        opaque = body.kind != "object" or self.layers.object_opacity >= OPAQUE
        return self.server.scene.add_mesh_simple(
            self._paths[index],
            points.astype(np.float32),
            faces.astype(np.uint32),
            color=body.colour,
            opacity=None if opaque else self.layers.object_opacity,
            cast_shadow=False,
            receive_shadow=False,
        )

    def remove(self) -> None:
        """Takes everything out of the page."""
        for name in ("/bodies", "/forces"):
            self.server.scene.remove_by_name(name)

    def apply_layers(self) -> None:
        """Shows and hides what ``layers`` says; forces and patches follow with the next state."""
        self._shown = None
        for body, mesh in zip(self.model.bodies, self.meshes, strict=True):
            if mesh is None:
                continue
            if body.kind == "object":
                mesh.visible = self.layers.object
                mesh.opacity = None if self.layers.object_opacity >= OPAQUE else self.layers.object_opacity
            elif body.kind in ("link", "fingertip"):
                mesh.visible = self.layers.hand

    def draw(self, state: SceneState, pull: tuple[FloatArray, FloatArray] | None = None, *, exact: bool = False) -> None:
        """Shows a state. ``pull`` is where a person pulls, (3,) m, and to where, world.

        Large surfaces follow every ``LARGE_EVERY`` seconds, or at once if ``exact``: for a state that stays.
        """
        with self.server.atomic():
            self._poses(state)
            self._shapes(state, exact=exact)
            if self._shown is None or not alike(self._shown, state):
                self._shown = state
                self._pressure(state)
                self._forces(state)
            if pull is None:
                self._pull_lines.show(np.zeros((0, 2, 3)), np.zeros((0, 3), np.uint8))
            else:
                self._pull_lines.show(*arrows(pull[0][None], (pull[1] - pull[0])[None], PULL[None], wings=2))
        self.server.flush()

    def _poses(self, state: SceneState) -> None:
        for index, frame in self._frames.values():
            position, quaternion = state.positions[index], state.quaternions[index]
            if np.abs(frame.position - position).max() > POSE_TOLERANCE:
                frame.position = position
            if np.abs(frame.wxyz - quaternion).max() > POSE_TOLERANCE:
                frame.wxyz = quaternion

    def _shapes(self, state: SceneState, *, exact: bool) -> None:
        for i, mesh in enumerate(self.meshes):
            if mesh is None or self.model.bodies[i].kind == "link":
                continue
            body, moved = self.model.bodies[i], state.moved.get(i)
            if i in self._thin:
                if moved is None or np.abs(moved.points - body.points[moved.indices]).max() < SEEN:
                    continue
                self._thin.discard(i)
                self._sent_shape[i] = body.points.astype(np.float32)
                mesh.vertices, mesh.faces = body.points.astype(np.float32), body.faces.astype(np.uint32)
            if not exact and len(body.points) > LARGE and abs(state.time - self._sent_at.get(i, -1.0)) < LARGE_EVERY:
                continue
            shape = body.points.astype(np.float32)
            if moved is not None:
                shape[moved.indices] = moved.points
            if np.abs(shape - self._sent_shape[i]).max() > SHAPE_TOLERANCE:
                self._sent_at[i] = state.time
                self._sent_shape[i] = shape
                mesh.vertices = shape

    def _pressure(self, state: SceneState) -> None:
        contacts = state.contacts
        on_pads = np.isin(contacts.body_a, self._tips) | np.isin(contacts.body_b, self._tips)
        self.scale.follow(float(contacts.pressures[on_pads].max(initial=0.0)))
        for tip, pool in self._patches.items():
            patch, moved = patch_of(state, tip), state.moved.get(tip)
            if moved is None or len(patch.points) == 0 or not self.layers.patches:
                pool.show(np.zeros((0, 3)), np.zeros((0, 3), np.uint8))
                continue
            near = patch.near(moved.points)
            share = pressure_at(moved.points[near], patch) / self.scale.top
            loaded = near[share > LOADED]
            share = share[share > LOADED]
            points = moved.points[loaded] + LIFT * self.model.bodies[tip].normals[moved.indices[loaded]]
            if self.layers.patch_colours == "pressure":
                colours = colour_map(share)
            else:
                nearest = ((points[:, None] - patch.points[None]) ** 2).sum(axis=2).argmin(axis=1)
                colours = np.where((patch.status[nearest] == SLIP)[:, None], rgb(SLIP_COLOUR), rgb(STICK_COLOUR)).astype(np.uint8)
            pool.show(points, colours)

    def _forces(self, state: SceneState) -> None:
        contacts, none = state.contacts, (np.zeros((0, 2, 3)), np.zeros((0, 3), np.uint8))
        if self.layers.contact_forces and len(contacts):
            size = np.linalg.norm(contacts.forces, axis=1)
            loaded = size > 1e-3 * size.max(initial=0.0)
            # On side b, into which fingertips press: the arrows point from the pad into the object.
            vectors = -contacts.forces[loaded] * (0.005 / max(float(size.max(initial=0.0)), 1e-9))
            slipping = contacts.status[loaded] == SLIP
            colours = np.where(slipping[:, None], rgb(SLIP_COLOUR), rgb(STICK_COLOUR)).astype(np.uint8)
            lines, shades = arrows(contacts.points[loaded], vectors, colours, wings=1)
            crosses = cross_marks(contacts.points[loaded][slipping], contacts.normals[loaded][slipping], 6e-4)
            self._contact_lines.show(
                np.concatenate([lines, crosses]), np.concatenate([shades, np.tile(rgb(SLIP_COLOUR), (len(crosses), 1))])
            )
        else:
            self._contact_lines.show(*none)
        if self.layers.finger_forces and self._tips:
            starts, vectors, shades_of = [], [], []
            for finger, tip in enumerate(self._tips):
                patch = contacts.reactions[:, 0] * ((contacts.body_a == tip) | (contacts.body_b == tip))
                if patch.sum() > 0.0:
                    starts.append(patch @ contacts.points / patch.sum())
                    vectors.append(self.layers.force_scale * state.finger_forces[finger])
                    shades_of.append(rgb(FINGER_COLOURS[finger % 6]))
            if starts:
                self._sum_lines.show(*arrows(np.array(starts), np.array(vectors), np.array(shades_of), wings=2))
                return
        self._sum_lines.show(*none)


def arrows(
    starts: FloatArray, vectors: FloatArray, colours: npt.NDArray[np.uint8], *, wings: int
) -> tuple[FloatArray, npt.NDArray[np.uint8]]:
    """Arrows as line segments: a shaft and ``wings`` pairs of strokes as head. ``starts`` and ``vectors`` (n, 3) m."""
    ends = starts + vectors
    across = np.cross(vectors, [0.0, 0.0, 1.0])
    flat = np.linalg.norm(across, axis=1) < 1e-3 * np.linalg.norm(vectors, axis=1)
    across[flat] = np.cross(vectors[flat], [1.0, 0.0, 0.0])
    pieces = [np.stack([starts, ends], axis=1)]
    for _ in range(wings):
        across *= (0.45 * HEAD * np.linalg.norm(vectors, axis=1) / np.maximum(np.linalg.norm(across, axis=1), 1e-300))[:, None]
        pieces += [np.stack([ends - HEAD * vectors + sign * across, ends], axis=1) for sign in (-1.0, 1.0)]
        across = np.cross(vectors, across)
    return np.concatenate(pieces), np.tile(colours, (len(pieces), 1))


def cross_marks(points: FloatArray, normals: FloatArray, size: float) -> FloatArray:
    """Two strokes (2n, 2, 3) across each of ``points`` (n, 3), in the plane of its normal: the mark of a contact that slips."""
    one = np.cross(normals, [0.31, 0.52, 0.79])
    one *= size / np.maximum(np.linalg.norm(one, axis=1), 1e-300)[:, None]
    two = np.cross(normals, one)
    return np.concatenate([np.stack([points - side, points + side], axis=1) for side in (one, two)])


def _path(name: str) -> str:
    """A name as one level of viser's tree."""
    return name.replace("/", " ")
