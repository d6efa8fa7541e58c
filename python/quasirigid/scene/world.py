"""A world as a scene: the model once, a state whenever asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from quasirigid._quasirigid import Body, Hand, Material, StepReport, Surface, World
from quasirigid.arrays.types import AnyArray, FloatArray
from quasirigid.errors import InvalidHandleError
from quasirigid.rotation import conjugate, rotate
from quasirigid.scene.contact_fields import CONTACT_FIELDS, ContactField
from quasirigid.scene.meshes import Mesh, joined, mirrored, tapered_capsule, triangulate
from quasirigid.scene.model import BodyView, Colour, ContactsState, ControlPoints, Kind, Moved, SceneModel, SceneState
from quasirigid.scene.palette import BONE, FINGER_COLOURS, GLASS, LINK_RADII, PAD, PALM

OBJECT_COLOURS: tuple[Colour, ...] = (GLASS, (0.62, 0.50, 0.36), (0.42, 0.55, 0.40))
SUPPORT: Colour = (0.90, 0.91, 0.93)
LEVEL = 0.999
"""Cosine of the slope of what counts as a level plane."""
KNUCKLE = 0.42
"""Radius of the axle at a joint, as a share of the link's."""


def colour_of(text: str) -> Colour:
    """The colour of ``"#0072B2"``."""
    red, green, blue = (int(text[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return red, green, blue


class WorldScene:
    """Makes the model and the states of a world. Not thread safe: use it where the world is used."""

    def __init__(
        self, world: World, bodies: Sequence[Body] | None = None, hands: Sequence[Hand] | None = None, pads: Sequence[Body] = ()
    ) -> None:
        """``bodies`` and ``hands`` are those to draw; ``None`` draws all that are in the world now. ``pads`` are those of the bodies that are
        fingertips without a hand: fingers before those of the hands.
        """
        self.world = world
        self.bodies = list(world.bodies if bodies is None else bodies)
        self.hands = list(world.hands if hands is None else hands)
        views: list[BodyView] = []
        names: dict[str, int] = {}
        self._place: dict[int, int] = {}
        self._tips: list[int] = []
        fingers: list[str] = []
        own = {pad.index for pad in pads}
        free = 0
        for body in self.bodies:
            place = self._place[body.index] = len(views)
            name = _unique(body.name, names)
            if body.index in own:
                views.append(replace(_body_view(body, name, "fingertip", PAD), finger=len(fingers)))
                self._tips.append(place)
                fingers.append(name.replace("_", " "))
                continue
            kind: Kind = "support" if body.mass == 0.0 else "object"
            colour = SUPPORT if kind == "support" else OBJECT_COLOURS[free % len(OBJECT_COLOURS)]
            free += kind == "object"
            views.append(_body_view(body, name, kind, colour))
        for hand in self.hands:
            prefix = f"{_unique(hand.name, names)}/" if len(self.hands) > 1 else ""
            for finger, (index, name) in enumerate(zip(hand.body_indices, hand.finger_names, strict=True)):
                self._place[index] = len(views)
                self._tips.append(len(views))
                views.append(_tip_view(hand, finger, f"{prefix}{name}", len(fingers)))
                fingers.append(f"{prefix}{name}".replace("_", " "))
        self._links: list[tuple[Hand, int | None, int]] = []
        shown = len(self._tips) - sum(hand.finger_count for hand in self.hands)
        for hand in self.hands:
            prefix = f"{hand.name}/" if len(self.hands) > 1 else ""
            views.append(BodyView(f"{prefix}palm", "link", *_palm(hand), PALM))
            self._links.append((hand, None, 0))
            for finger, name in enumerate(hand.finger_names):
                for link, mesh, colour, part in _link_meshes(hand, finger, colour_of(FINGER_COLOURS[shown % 6])):
                    views.append(
                        BodyView(f"{prefix}{name}/{part} {link}", "link", *mesh, colour, finger=shown, frame=f"{prefix}{name} {link}")
                    )
                    self._links.append((hand, finger, link))
                shown += 1
        self.model = SceneModel(tuple(views), tuple(fingers), world.dt, _floor(views, self.bodies))

    def unchanged(self) -> bool:
        """Whether the world still holds the bodies and hands of the model, and no others."""
        try:
            indices = [body.index for body in self.bodies] + [i for hand in self.hands for i in hand.body_indices]
        except InvalidHandleError:
            return False
        return indices == list(self._place) and len(self.world.bodies) == len(self.bodies) and len(self.world.hands) == len(self.hands)

    def state(self, report: StepReport | None = None, phase: str = "", *, moved: bool = True) -> SceneState:
        """The world now. ``report`` is that of the last step; without ``moved`` the surfaces are left out, which saves a third of the time."""
        bodies = self.model.bodies
        positions, quaternions = np.zeros((len(bodies), 3)), np.tile([1.0, 0.0, 0.0, 0.0], (len(bodies), 1))
        displaced: dict[int, Moved] = {}

        def put(place: int, indices: np.ndarray[tuple[int], np.dtype[np.uint32]], points: FloatArray) -> None:
            if len(indices):
                displaced[place] = Moved(indices.astype(np.int64), points)

        for place, body in enumerate(self.bodies):
            positions[place], quaternions[place] = body.position, body.quaternion
            if moved:
                put(place, *body.moved_points())
        links = {id(hand): hand.link_poses for hand in self.hands}
        tip = len(self._tips) - sum(hand.finger_count for hand in self.hands)
        for hand in self.hands:
            for finger in range(hand.finger_count):
                place = self._tips[tip]
                pose = links[id(hand)][finger, -1]
                positions[place], quaternions[place] = pose[:3], pose[3:]
                if moved:
                    put(place, *hand.moved_points(finger))
                tip += 1
        for place, (hand, which, link) in enumerate(self._links, start=len(bodies) - len(self._links)):
            if which is None:
                positions[place], quaternions[place] = hand.position, hand.quaternion
            else:
                pose = links[id(hand)][which, link]
                positions[place], quaternions[place] = pose[:3], pose[3:]
        contacts = self._contacts()
        forces, normal = forces_of(contacts, self._tips)
        return SceneState(
            time=self.world.time,
            step=self.world.steps,
            positions=positions,
            quaternions=quaternions,
            moved=displaced,
            contacts=contacts,
            finger_forces=forces,
            normal_forces=normal,
            joint_positions=joint_rows([hand.joint_positions for hand in self.hands]),
            step_time=0.0 if report is None else report.step_time,
            stage_times={} if report is None else report.stage_times,
            residual=0.0 if report is None else report.residual,
            converged=True if report is None else report.converged,
            quarantined=tuple(self._place[i] for i in self.world.quarantined if i in self._place),
            phase=phase,
        )

    def _contacts(self) -> ContactsState:
        contacts = self.world.contacts()
        last = max(self._place, default=0)
        place = np.full(last + 2, -1, dtype=np.int64)
        place[list(self._place)] = list(self._place.values())

        def value(field: ContactField) -> AnyArray:
            values: AnyArray = getattr(contacts, field.name)
            return place[np.minimum(values, last + 1)] if field.counts_bodies else values.astype(field.dtype, copy=False)

        return ContactsState(**{field.name: value(field) for field in CONTACT_FIELDS})


def forces_of(contacts: ContactsState, tips: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """What each fingertip does to whatever it touches: summed forces (fingers, 3) N, world, and summed normal reactions (fingers,) N."""
    forces, normal = np.zeros((len(tips), 3)), np.zeros(len(tips))
    for finger, tip in enumerate(tips):
        on_tip, by_tip = contacts.body_a == tip, contacts.body_b == tip
        forces[finger] = contacts.forces[by_tip].sum(axis=0) - contacts.forces[on_tip].sum(axis=0)
        normal[finger] = contacts.reactions[on_tip | by_tip, 0].sum()
    return forces, normal


def _unique(name: str, names: dict[str, int]) -> str:
    names[name] = names.get(name, 0) + 1
    return name if names[name] == 1 else f"{name} {names[name]}"


def _body_view(body: Body, name: str, kind: Kind, colour: Colour) -> BodyView:
    surface = body.surface
    x, y, z = rotate(conjugate(body.quaternion), body.centre_of_mass - body.position).tolist()
    weight: dict[str, Any] = {"mass": body.mass, "centre_of_mass": (x, y, z)}
    if surface is None:
        return BodyView(name, kind, np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64), colour, **weight)
    points, normals = surface.points, surface.normals
    skin: dict[str, Any] = {"control": _control_points(surface), "material": _figures_of(body.material)}
    return BodyView(name, kind, points, normals, triangulate(points, normals), colour, **skin, **weight)


def _tip_view(hand: Hand, finger: int, name: str, number: int) -> BodyView:
    surface = hand.surface(finger)
    assert surface is not None
    points, normals = surface.points, surface.normals
    last = hand.link_poses.shape[1] - 1
    skin: dict[str, Any] = {"control": _control_points(surface), "material": _figures_of(hand.material)}
    mesh = triangulate(points, normals)
    return BodyView(f"{name}/tip", "fingertip", points, normals, mesh, PAD, finger=number, frame=f"{name} {last}", **skin)


def _control_points(surface: Surface) -> ControlPoints:
    return ControlPoints(surface.control_points, surface.control_normals, surface.control_areas)


def _figures_of(material: Material | None) -> dict[str, Any] | None:
    """A material as plain values, for ``BodyView.material``."""
    if material is None:
        return None
    names = ("name", "density", "friction", "young_modulus", "poisson_ratio", "layer_thickness", "relaxation_time", "compliance")
    law = material.friction_law
    direction = None if law.direction is None else law.direction.tolist()
    friction = {name: getattr(law, name) for name in ("static", "kinetic", "stribeck_velocity", "viscous", "ratio")}
    return {**{name: getattr(material, name) for name in names}, "friction_law": {**friction, "direction": direction}}


def joint_rows(hands: Sequence[FloatArray]) -> FloatArray:
    """Joint positions (fingers, joints) rad of several hands, each (its fingers, its joints): one row a finger, NaN beyond its last joint."""
    rows = np.full((sum(len(hand) for hand in hands), max((hand.shape[1] for hand in hands), default=0)), np.nan)
    first = 0
    for hand in hands:
        rows[first : first + len(hand), : hand.shape[1]] = hand
        first += len(hand)
    return rows


def _palm(hand: Hand) -> Mesh:
    """The palm, hand frame: a stem, and an arm to every knuckle, a little thinner than the link there, so that the two do not flicker."""
    links, turn, origin = hand.link_poses, conjugate(hand.quaternion), hand.position
    zero = np.zeros(3)
    arms = [tapered_capsule(zero, rotate(turn, knuckle - origin), 0.0115, 0.9 * LINK_RADII[0]) for knuckle in links[:, 0, :3]]
    return joined([*arms, tapered_capsule(zero, np.array([0.0, 0.0, 0.018]), 0.0122, 0.0095)])


def _link_meshes(hand: Hand, finger: int, own: Colour) -> list[tuple[int, Mesh, Colour, str]]:
    """The links of a finger that have a length, each in its own frame: number, mesh, colour, what it is."""
    links = hand.link_poses[finger]
    tip_positions, tip_quaternions = hand.tip_poses()
    surface = hand.surface(finger)
    assert surface is not None
    last = conjugate(links[-1, 3:])
    outwards = rotate(last, rotate(tip_quaternions[finger], np.array([0.0, 0.0, 1.0])))
    apex = rotate(last, tip_positions[finger] - links[-1, :3])
    depth = float(np.ptp(surface.points @ outwards))
    parts: list[tuple[int, Mesh, Colour, str]] = []
    sizes = iter(range(len(LINK_RADII)))
    for link in range(len(links)):
        here = conjugate(links[link, 3:])
        end = rotate(here, links[link + 1, :3] - links[link, :3]) if link + 1 < len(links) else apex - depth * outwards
        if np.linalg.norm(end) < 1e-6:
            continue
        i = min(next(sizes, len(LINK_RADII) - 1), len(LINK_RADII) - 2)
        start_radius, end_radius = LINK_RADII[i], LINK_RADII[i + 1]
        parts.append((link, tapered_capsule(np.zeros(3), end, start_radius, end_radius), BONE, "link"))
        axle = np.array([0.0, 1.04 * start_radius, 0.0])
        parts.append((link, tapered_capsule(-axle, axle, KNUCKLE * start_radius, KNUCKLE * start_radius, around=12, caps=2), own, "joint"))
    points, normals = surface.points, surface.normals
    parts.append((len(links) - 1, mirrored(points, normals, triangulate(points, normals), outwards), PAD, "nail"))
    return parts


def _floor(views: Sequence[BodyView], bodies: Sequence[Body]) -> float:
    """The ground lies on the lowest plane on which objects stand, else under everything that is there at the start."""
    planes = [
        float(body.position[2] + rotate(body.quaternion, view.points)[:, 2].max())
        for view, body in zip(views, bodies, strict=False)
        if view.kind == "support" and len(view.points) and rotate(body.quaternion, view.normals)[:, 2].min() > LEVEL
    ]
    if planes:
        return min(planes)
    lowest = [
        float((body.position[2] + rotate(body.quaternion, view.points)[:, 2]).min())
        for view, body in zip(views, bodies, strict=False)
        if len(view.points)
    ]
    return min(lowest, default=0.0)
