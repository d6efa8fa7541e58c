"""A world as a scene: the model once, a state whenever asked for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from quasirigid._quasirigid import Body, Hand, StepReport, World
from quasirigid.arrays.types import AnyArray, FloatArray, IntArray
from quasirigid.errors import InvalidHandleError
from quasirigid.rotation import rotate
from quasirigid.scene.contact_fields import RECORDED_FIELDS, ContactField
from quasirigid.scene.indentation import indentation_note
from quasirigid.scene.model import ContactsState, Moved, SceneModel, SceneState
from quasirigid.scene.palette import PAD
from quasirigid.scene.views import OBJECT_COLOURS, SUPPORT, Placed, body_views, finger_views, hand_views, part_of, unique_name

LEVEL = 0.999
"""Cosine of the slope of what counts as a level plane."""


class WorldScene:
    """Makes the model and the states of a world. Not thread safe: use it where the world is used."""

    def __init__(
        self, world: World, bodies: Sequence[Body] | None = None, hands: Sequence[Hand] | None = None, pads: Sequence[Body] = ()
    ) -> None:
        """``bodies`` and ``hands`` are those to draw; ``None`` draws all that are in the world now. ``pads`` are those of the bodies that
        are fingertips without a hand: fingers before those of the hands.
        """
        self.world = world
        self.bodies = list(world.bodies if bodies is None else bodies)
        self.hands = list(world.hands if hands is None else hands)
        self._indices: dict[int, int] = {}
        """By ``Body.index``: the view that stands for a body, or for a finger."""
        self._tips: list[int] = []
        placed: list[Placed] = []
        further: list[Placed] = []
        fingers: list[str] = []
        names: dict[str, int] = {}
        own = {pad.index for pad in pads}

        def add(index: int, views: list[Placed]) -> None:
            if views[0].view.kind == "fingertip":
                self._tips.append(len(placed))
            self._indices[index] = len(placed)
            further.extend(part_of(view, len(placed)) for view in views[1:])
            placed.append(views[0])

        free = 0
        for body in self.bodies:
            name = unique_name(body.name, names)
            if body.index in own:
                add(body.index, body_views(body, name, "fingertip", PAD, len(fingers)))
                fingers.append(name.replace("_", " "))
            elif body.mass == 0.0:
                add(body.index, body_views(body, name, "support", SUPPORT))
            else:
                add(body.index, body_views(body, name, "object", OBJECT_COLOURS[free % len(OBJECT_COLOURS)]))
                free += 1
        prefixes = [f"{unique_name(hand.name, names)}/" if len(self.hands) > 1 else "" for hand in self.hands]
        firsts = []
        for hand, prefix in zip(self.hands, prefixes, strict=True):
            firsts.append(len(fingers))
            for finger, (index, name) in enumerate(zip(hand.body_indices, hand.finger_names, strict=True)):
                add(index, finger_views(hand, finger, f"{prefix}{name}", len(fingers)))
                fingers.append(f"{prefix}{name}".replace("_", " "))
        for hand, prefix, first in zip(self.hands, prefixes, firsts, strict=True):
            placed += hand_views(hand, prefix, first)
        placed += further
        self._carriers = [view.carrier for view in placed]
        self._surfaces = [(place, view.collider) for place, view in enumerate(placed) if view.collider is not None]
        self._places = {
            "body": _places(self._indices),
            "collider": _places({collider.id: place for place, collider in self._surfaces}),
        }
        self._colliders = world.colliders
        self.model = SceneModel(tuple(view.view for view in placed), tuple(fingers), world.dt, _floor(placed))

    def unchanged(self) -> bool:
        """Whether the world still holds the bodies, hands and colliders of the model, and no others."""
        try:
            indices = [body.index for body in self.bodies] + [i for hand in self.hands for i in hand.body_indices]
        except InvalidHandleError:
            return False
        same = indices == list(self._indices) and len(self.world.bodies) == len(self.bodies) and len(self.world.hands) == len(self.hands)
        return same and self.world.colliders == self._colliders

    def state(self, report: StepReport | None = None, phase: str = "", *, moved: bool = True) -> SceneState:
        """The world now. ``report`` is that of the last step; without ``moved`` the surfaces are left out, which saves a
        third of the time.
        """
        positions, quaternions = np.zeros((len(self._carriers), 3)), np.zeros((len(self._carriers), 4))
        displaced: dict[int, Moved] = {}
        links: dict[Body | Hand, FloatArray] = {hand: hand.link_poses for hand in self.hands}
        for place, (owner, finger, link) in enumerate(self._carriers):
            if finger is None:
                positions[place], quaternions[place] = owner.position, owner.quaternion
            else:
                pose = links[owner][finger, link]
                positions[place], quaternions[place] = pose[:3], pose[3:]
        if moved:
            for place, collider in self._surfaces:
                indices, points = collider.moved_points()
                if len(indices):
                    displaced[place] = Moved(indices.astype(np.int64), points)
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
            quarantined=tuple(self._indices[i] for i in self.world.quarantined if i in self._indices),
            phase=phase,
            notice=" ".join(indentation_note(None if report is None else report.indentation)),
        )

    def _contacts(self) -> ContactsState:
        contacts = self.world.contacts()

        def value(field: ContactField) -> AnyArray:
            values: AnyArray = getattr(contacts, field.name)
            if not field.counts:
                return values.astype(field.dtype, copy=False)
            places = self._places[field.counts]
            return places[np.minimum(values, len(places) - 1)]

        return ContactsState(**{field.name: value(field) for field in RECORDED_FIELDS})


def forces_of(contacts: ContactsState, tips: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """What each fingertip does to whatever it touches: summed forces (fingers, 3) N, world, and summed normal reactions (fingers,) N."""
    forces, normal = np.zeros((len(tips), 3)), np.zeros(len(tips))
    for finger, tip in enumerate(tips):
        on_tip, by_tip = contacts.collider_a == tip, contacts.collider_b == tip
        forces[finger] = contacts.forces[by_tip].sum(axis=0) - contacts.forces[on_tip].sum(axis=0)
        normal[finger] = contacts.reactions[on_tip | by_tip, 0].sum()
    return forces, normal


def joint_rows(hands: Sequence[FloatArray]) -> FloatArray:
    """Joint positions (fingers, joints) rad of several hands, each (its fingers, its joints): one row a finger, NaN beyond
    its last joint.
    """
    rows = np.full((sum(len(hand) for hand in hands), max((hand.shape[1] for hand in hands), default=0)), np.nan)
    first = 0
    for hand in hands:
        rows[first : first + len(hand), : hand.shape[1]] = hand
        first += len(hand)
    return rows


def _places(numbers: dict[int, int]) -> IntArray:
    """The views of bodies or colliders by their numbers, as an array; -1 for those that are not drawn, the last of them for all numbers
    beyond.
    """
    places = np.full(max(numbers, default=0) + 2, -1, dtype=np.int64)
    places[list(numbers)] = list(numbers.values())
    return places


def _floor(placed: Sequence[Placed]) -> float:
    """The ground lies on the lowest plane on which objects stand, else under everything that is there at the start."""
    rigid = [(view, carrier.owner) for view, carrier, _ in placed if isinstance(carrier.owner, Body) and len(view.points)]
    planes = [
        float(body.position[2] + rotate(body.quaternion, view.points)[:, 2].max())
        for view, body in rigid
        if view.kind == "support" and rotate(body.quaternion, view.normals)[:, 2].min() > LEVEL
    ]
    if planes:
        return min(planes)
    return min((float((body.position[2] + rotate(body.quaternion, view.points)[:, 2]).min()) for view, body in rigid), default=0.0)
