"""Draws a scene with viser: takes a model once and then states, from a live world or a recording alike.

What is sent per state is small: poses of objects that changed, the vertices of the hand if it moved and of surfaces that deformed further,
the places of the coloured points of the patches, and one set of line segments for all forces.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import viser

from quasirigid.arrays.types import FloatArray, IntArray
from quasirigid.live.batched_nodes import POSE_TOLERANCE, SHAPE_TOLERANCE, Joined, LinePool, PatchPool
from quasirigid.live.pad_detail import PadDetail
from quasirigid.live.unlit import unlit_glb
from quasirigid.rotation import matrix_of
from quasirigid.scene.meshes import is_convex, spacing_of, thinned
from quasirigid.scene.model import BodyView, Colour, SceneModel, SceneState
from quasirigid.scene.palette import FINGER_COLOURS, SLIP_COLOUR, STICK_COLOUR
from quasirigid.scene.pressure import SLIP, Scale, alike, colour_map, pressure_at, rgb, world_patch

LARGE = 10_000
"""Surfaces of more points are sent at most every ``LARGE_EVERY`` seconds."""
LARGE_EVERY = 0.1
FEW = 1_000
"""Objects and supports of more points are drawn with fewer triangles as long as they do not deform by ..."""
SEEN = 4e-6
"""... more than this, m."""
FLAT_NORMALS = 1e-3
"""A support whose normals differ by less is a plane."""
GROUND, GROUND_LIT = np.array([0.895, 0.905, 0.915], np.float32), (0.99, 0.995, 1.0)
"""Of plane supports: in linear light, and the colour that looks so in the light of the page."""
SEEN_STROKE = 0.05
"""Forces under this share of the largest would be strokes of a pixel or two."""
OLDEST = 2
"""States after which colours that are put off are worked out again: 12 times a second."""
OPAQUE = 0.999
LIFT = 1.5e-4
"""How far the coloured points stand out of the surface, so that it does not hide half of each, m."""
LOADED = 0.01
"""Points under less than this share of the full scale keep the colour of the pad."""
HEAD = 0.3
"""Length of an arrow's head as a share of the arrow."""
LONGEST_FORCE = 0.09
"""Of the arrows of the fingers, m: one that leaves the picture says nothing."""
PULL = rgb("#A8478A")
LEVELS = 32
"""Colours that can be distinguished on a pad: steps of the pressure scale."""
PRESSURES = colour_map((np.arange(LEVELS) + 0.5) / LEVELS)
"""(levels, 3)."""
FRICTIONS = np.array([rgb(STICK_COLOUR), rgb(SLIP_COLOUR)])
FINGERS = np.array([rgb(colour) for colour in FINGER_COLOURS])
NOTHING = np.zeros((0, 2, 3)), np.zeros((0, 3), np.uint8)


@dataclass
class Layers:
    """What is shown."""

    object: bool = True
    object_opacity: float = 0.4
    hand: bool = True
    patches: bool = True
    patch_colours: str = "pressure"
    """``"pressure"`` or ``"stick and slip"``."""
    contact_forces: bool = True
    finger_forces: bool = True
    force_scale: float = 0.012
    """Length of the arrow of 1 N, m, for the sum over a finger; less where one would be longer than ``LONGEST_FORCE``."""


class SceneDrawing:
    """A scene in the page. Call from one thread at a time."""

    def __init__(self, server: viser.ViserServer, model: SceneModel, *, layers: Layers | None = None) -> None:
        self.server, self.model = server, model
        self.layers = layers or Layers()
        self.hurried = False
        """While all moves, work out only now and then which point of a pad has which colour; set by who draws states that stay with
        ``exact``."""
        self.scale = Scale()
        """Of the pressure colours."""
        self.meshes: list[viser.MeshHandle | None] = [None] * len(model.bodies)
        """Of objects and supports, by body."""
        self._hand: list[Joined] = []
        """Links, fingertips and further colliders of fingers, those of one colour joined."""
        self._pads: Joined | None = None
        self._paths: dict[int, str] = {}
        self._few: dict[int, tuple[IntArray, IntArray]] = {}
        """Fewer points and triangles of objects and supports, which are shown while these do not deform."""
        self._thin: set[int] = set()
        """Bodies of which these are on show."""
        self._planes: dict[int, viser.GlbHandle] = {}
        """Plane supports, as long as they do not deform."""
        self._veils: dict[int, viser.MeshHandle] = {}
        """Of see-through bodies with dents: a copy that only hides what lies behind the foremost side."""
        self._sent_shape: dict[int, npt.NDArray[np.float32]] = {}
        self._sent_at: dict[int, float] = {}
        self._frames: dict[str, tuple[int, viser.FrameHandle]] = {}
        """By name: a body that has the pose, and the node that carries all bodies of the frame."""
        self._poses = np.full((len(model.bodies), 7), np.nan)
        """Of all bodies, as sent last."""
        self._coloured = np.zeros(0, np.int64)
        """Vertices of the pads that have the colour of their pressure."""
        self._lift = np.zeros((0, 3), np.float32)
        """How their colours stand out, world."""
        self._faded = 0
        """How many states these are behind the one on show."""
        self._shown: SceneState | None = None
        self._tips = model.fingertips()
        pads = [model.bodies[tip] for tip in self._tips]
        self._details: list[PadDetail] = []
        with server.atomic():
            for i, body in enumerate(model.bodies):
                if len(body.faces) and body.kind in ("object", "support"):
                    self._add(i, body)
            hand = [*self._tips, *(i for i, body in enumerate(model.bodies) if body.kind == "link" and len(body.faces))]
            for number, colour in enumerate(dict.fromkeys(model.bodies[i].colour for i in hand)):
                parts = [(i, model.bodies[i].points, model.bodies[i].faces) for i in hand if model.bodies[i].colour == colour]
                name = f"links {number}" if number or not pads else "pads"
                self._hand.append(Joined(server, f"/hand/{name}", parts, colour))
            if pads:
                self._pads = self._hand[0]
                self._details = [PadDetail(pad) for pad in pads]
                self._pads.retriangulate({part: detail.faces for part, detail in enumerate(self._details)})
        self._patches = PatchPool(server, "/hand/patches", 1.7 * spacing_of(pads[0].points) if pads else 1e-3)
        self._contact_lines = LinePool(server, "/forces/contacts", 1.2)
        self._sum_lines = LinePool(server, "/forces/fingers", 4.0)
        self._pull_lines = LinePool(server, "/forces/pull", 4.0)
        self.apply_layers()

    def _add(self, index: int, body: BodyView) -> None:
        path = f"/bodies/{_path(body.frame or body.name)}"
        if path not in self._frames:
            self._frames[path] = (index, self.server.scene.add_frame(path, show_axes=False))
        self._paths[index] = f"{path}/{_path(body.name)}"
        few = thinned(body.points, body.normals) if len(body.points) > FEW else None
        points, faces = body.points, body.faces
        if few is not None:
            self._few[index] = few
            self._thin.add(index)
            points, faces = body.points[few[0]], few[1]
        else:
            self._sent_shape[index] = points.astype(np.float32)
        if few is not None and body.kind == "support" and np.ptp(body.normals, axis=0).max() < FLAT_NORMALS:
            self._plane(index, points, faces)
            return
        if body.kind == "object" and not is_convex(points, faces):
            self._veils[index] = self._mesh(f"{self._paths[index]} veil", points, faces, body.colour, 0.0)
        self.meshes[index] = self._mesh(self._paths[index], points, faces, body.colour, self._opacity(body))

    def _plane(self, index: int, points: FloatArray, faces: IntArray) -> None:
        """A plane support: as bright everywhere, so that it needs no light."""
        self._planes[index] = self.server.scene.add_glb(
            self._paths[index], unlit_glb(points, faces, GROUND), cast_shadow=False, receive_shadow=False
        )

    def _opacity(self, body: BodyView) -> float | None:
        return None if body.kind != "object" or self.layers.object_opacity >= OPAQUE else self.layers.object_opacity

    def _mesh(
        self, path: str, points: FloatArray | npt.NDArray[np.float32], faces: IntArray, colour: Colour, opacity: float | None
    ) -> viser.MeshHandle:
        return self.server.scene.add_mesh_simple(
            path,
            points.astype(np.float32, copy=False),
            faces.astype(np.uint32),
            color=colour,
            opacity=opacity,
            cast_shadow=False,
            receive_shadow=False,
        )

    def remove(self) -> None:
        """Takes everything out of the page."""
        for name in ("/bodies", "/hand", "/forces"):
            self.server.scene.remove_by_name(name)

    def apply_layers(self) -> None:
        """Shows and hides what ``layers`` says; forces and patches follow with the next state."""
        self._shown = None
        for i, (body, mesh) in enumerate(zip(self.model.bodies, self.meshes, strict=True)):
            if mesh is not None and body.kind == "object":
                mesh.visible = self.layers.object
                mesh.opacity = self._opacity(body)
                if i in self._veils:
                    self._veils[i].visible = self.layers.object and mesh.opacity is not None
        for group in self._hand:
            group.handle.visible = self.layers.hand

    def draw(self, state: SceneState, pull: tuple[FloatArray, FloatArray] | None = None, *, exact: bool = False) -> None:
        """Shows a state. ``pull`` is where a person pulls, (3,) m, and to where, world.

        Large surfaces follow every ``LARGE_EVERY`` seconds, or at once if ``exact``: for a state that stays.
        """
        poses = np.concatenate([state.positions, state.quaternions], axis=1)
        changed = ~(np.abs(poses - self._poses) <= POSE_TOLERANCE).all(axis=1)  # true for NaN: not sent yet
        self._poses[changed] = poses[changed]
        rotations = matrix_of(state.quaternions)
        with self.server.atomic():
            for index, frame in self._frames.values():
                if changed[index]:
                    frame.position, frame.wxyz = state.positions[index], state.quaternions[index]
            self._shapes(state, exact=exact)
            if self._pads is not None:
                for part, tip in enumerate(self._tips):
                    self._pads.deform(part, state.moved.get(tip))
                changed_pads = [i for i, tip in enumerate(self._tips) if self._details[i].follow(state.moved.get(tip))]
                if changed_pads:
                    self._pads.retriangulate({i: self._details[i].faces for i in changed_pads})
            for group in self._hand:
                for part, index in enumerate(group.bodies):
                    if self.model.bodies[index].part_of is not None:
                        group.deform(part, state.moved.get(index))
            moved = [group.place(state.positions, rotations, changed) for group in self._hand]
            other = self._shown is None or not alike(self._shown, state)
            if other:
                self._shown = state
                self._forces(state)
            if self._pads is not None and (other or moved[0] or self._faded > 0):
                self._faded = self._faded + 1 if self.hurried and not exact and self._faded < OLDEST else 0
                if self._faded == 0:
                    self._pressure(state, self._pads, rotations)
                self._patches.move(self._pads.world[self._coloured] + self._lift)
            if pull is None:
                self._pull_lines.show(*NOTHING)
            else:
                self._pull_lines.show(*arrows(pull[0][None], (pull[1] - pull[0])[None], PULL[None], wings=2))
        self.server.flush()

    def _shapes(self, state: SceneState, *, exact: bool) -> None:
        for i, mesh in enumerate(self.meshes):
            body, moved = self.model.bodies[i], state.moved.get(i)
            if mesh is None and i not in self._planes:
                continue
            if i in self._few:
                deformation = 0.0 if moved is None else float(np.abs(moved.points - body.points[moved.indices]).max())
                if i in self._thin:
                    if deformation < SEEN:
                        continue
                    self._thin.discard(i)
                    self._show_shape(i, body.points.astype(np.float32), body.faces)
                elif deformation < 0.5 * SEEN:
                    self._thin.add(i)
                    kept, faces = self._few[i]
                    self._show_shape(i, body.points[kept].astype(np.float32), faces)
                    continue
            if not exact and len(body.points) > LARGE and abs(state.time - self._sent_at.get(i, -1.0)) < LARGE_EVERY:
                continue
            shape = body.points.astype(np.float32)
            if moved is not None:
                shape[moved.indices] = moved.points
            if np.abs(shape - self._sent_shape[i]).max() > SHAPE_TOLERANCE:
                self._sent_at[i] = state.time
                self._show_shape(i, shape)

    def _show_shape(self, index: int, points: npt.NDArray[np.float32], faces: IntArray | None = None) -> None:
        self._sent_shape[index] = points
        if faces is not None and index in self._planes:  # it deforms: from now on a mesh as all others
            self._planes.pop(index).remove()
            self.meshes[index] = self._mesh(self._paths[index], points, faces, GROUND_LIT, None)
            return
        for mesh in (self.meshes[index], self._veils.get(index)):
            if mesh is not None:
                mesh.vertices = points
                if faces is not None:
                    mesh.faces = faces.astype(np.uint32)

    def _pressure(self, state: SceneState, pads: Joined, rotations: FloatArray) -> None:
        """Which points of the pads have which colour."""
        rows, levels, lifts = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], [np.zeros((0, 3))]
        by_pressure = self.layers.patch_colours == "pressure"
        for tip, vertices in zip(self._tips, pads.rows, strict=False):  # after the tips come nails and further colliders
            patch, moved = world_patch(state.contacts, tip), state.moved.get(tip)
            if moved is None or len(patch.points) == 0 or not (self.layers.patches and self.layers.hand):
                continue
            points = pads.world[vertices[moved.indices]]
            near = patch.near(points)
            share = pressure_at(points[near], patch) / self.scale.top
            loaded = share > LOADED
            near, share = near[loaded], share[loaded]
            rows.append(vertices[moved.indices[near]])
            lifts.append(self.model.bodies[tip].normals[moved.indices[near]] @ (LIFT * rotations[tip].T))
            if by_pressure:
                levels.append(np.minimum(share * LEVELS, LEVELS - 1).astype(np.int64))
            else:
                nearest = ((points[near, None] - patch.points[None]) ** 2).sum(axis=2).argmin(axis=1)
                levels.append((patch.status[nearest] == SLIP).astype(np.int64))
        self._coloured, self._lift = np.concatenate(rows), np.concatenate(lifts).astype(np.float32)
        self._patches.arrange(np.concatenate(levels), PRESSURES if by_pressure else FRICTIONS)

    def _forces(self, state: SceneState) -> None:
        contacts = state.contacts
        on_tips = [contacts.on(tip) for tip in self._tips]
        if on_tips:
            self.scale.follow(float((contacts.pressures * np.logical_or.reduce(on_tips)).max(initial=0.0)))
        size = np.sqrt((contacts.forces**2).sum(axis=1))
        largest = float(size.max(initial=0.0))
        if self.layers.contact_forces and largest > 0.0:
            loaded = np.flatnonzero(size > SEEN_STROKE * largest)
            starts = contacts.points[loaded]
            # The strokes point from the pad into the object.
            ends = starts + self.model.pushes(contacts)[loaded] * (0.005 / max(largest, 1e-9))
            slipping = contacts.status[loaded] == SLIP
            crosses = cross_marks(starts[slipping], contacts.normals[loaded][slipping], 6e-4)
            which = np.concatenate([slipping.astype(np.int64), np.ones(len(crosses), np.int64)])
            self._contact_lines.show(np.concatenate([np.stack([starts, ends], axis=1), crosses]), FRICTIONS[which])
        else:
            self._contact_lines.show(*NOTHING)
        forces = [contacts.reactions[:, 0] * mine for mine in on_tips] if self.layers.finger_forces else []
        pressed = [(finger, force) for finger, force in enumerate(forces) if force.sum() > 0.0]
        if pressed:
            sums = state.finger_forces[[finger for finger, _ in pressed]]
            scale = min(self.layers.force_scale, LONGEST_FORCE / max(float(np.linalg.norm(sums, axis=1).max()), 1e-9))
            self._sum_lines.show(
                *arrows(
                    np.array([force @ contacts.points / force.sum() for _, force in pressed]),
                    scale * sums,
                    FINGERS[[finger % 6 for finger, _ in pressed]],
                    wings=2,
                )
            )
        else:
            self._sum_lines.show(*NOTHING)


def arrows(
    starts: FloatArray, vectors: FloatArray, colours: npt.NDArray[np.uint8], *, wings: int
) -> tuple[FloatArray, npt.NDArray[np.uint8]]:
    """Arrows as line segments: a shaft and ``wings`` pairs of strokes as head. ``starts`` and ``vectors`` (n, 3) m."""
    ends = starts + vectors
    lengths = np.sqrt((vectors**2).sum(axis=1))[:, None]
    # Square to the arrow, and level unless it stands upright.
    across = np.stack([vectors[:, 1], -vectors[:, 0], np.zeros(len(vectors))], axis=1)
    flat = np.abs(across).max(axis=1) < 1e-3 * lengths[:, 0]
    across[flat] = np.stack([np.zeros(len(vectors)), vectors[:, 2], -vectors[:, 1]], axis=1)[flat]
    pieces = [np.stack([starts, ends], axis=1)]
    for _ in range(wings):
        across = across * (0.45 * HEAD * lengths / np.maximum(np.sqrt((across**2).sum(axis=1))[:, None], 1e-300))
        pieces += [np.stack([ends - HEAD * vectors + sign * across, ends], axis=1) for sign in (-1.0, 1.0)]
        across = cross(vectors, across)
    return np.concatenate(pieces), np.tile(colours, (len(pieces), 1))


def cross_marks(points: FloatArray, normals: FloatArray, size: float) -> FloatArray:
    """Two strokes (2n, 2, 3) across each of ``points`` (n, 3), in the plane of its normal: the mark of a contact that slips."""
    one = cross(normals, np.array([[0.31, 0.52, 0.79]]))
    one *= size / np.maximum(np.sqrt((one**2).sum(axis=1)), 1e-300)[:, None]
    two = cross(normals, one)
    return np.concatenate([np.stack([points - side, points + side], axis=1) for side in (one, two)])


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross products of (n, 3): what ``numpy.cross`` gives for the few vectors of a frame, in a fifth of its time."""
    result = a[:, [1, 2, 0]] * b[:, [2, 0, 1]]
    result -= a[:, [2, 0, 1]] * b[:, [1, 2, 0]]
    return result


def _path(name: str) -> str:
    """A name as one level of viser's tree."""
    return name.replace("/", " ")
