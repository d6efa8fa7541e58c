"""What is drawn: a model that stays, and a state per instant. Neither knows the viewer nor the engine.

A live world and a recording make the same two structures, so that one drawing code serves both. Every body is a triangle mesh in its own
frame, and a pose. The vertices of a body that can touch are the points of its surface, in the caller's order: where the surface deforms,
its vertices move.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from quasirigid.arrays.types import FloatArray, IntArray
from quasirigid.scene.contact_fields import no_contacts

Kind = Literal["object", "fingertip", "link", "support"]
PUSHERS: tuple[Kind, ...] = ("fingertip", "link", "support", "object")
"""Who pushes whom: each kind those after it."""
Colour = tuple[float, float, float]
"""Red, green, blue, 0 to 1, sRGB."""


@dataclass(frozen=True, eq=False)
class ControlPoints:
    """Where the surface of a body carries contact forces, at rest, in the frame of its points: ``Surface.control_points`` and so on."""

    points: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    """(m, 3) m."""
    normals: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    """(m, 3) outward unit normals."""
    areas: FloatArray = field(default_factory=lambda: np.zeros(0))
    """(m,) m^2."""


@dataclass(frozen=True, eq=False)
class BodyView:
    """One surface, or part of a hand, with a pose: what touches and what is drawn. The first surface of a body stands for the body."""

    name: str
    """Unique in the scene: ``"box"``, ``"thumb/tip"``, ``"thumb/link 2"``, ``"palm"``."""
    kind: Kind
    points: FloatArray
    """(n, 3) m, at rest, body frame."""
    normals: FloatArray
    """(n, 3) outward unit normals at rest, body frame."""
    faces: IntArray
    """(m, 3) triangles of points, counter-clockwise seen from outside."""
    colour: Colour
    finger: int | None = None
    """Of a fingertip or a link: which finger it belongs to."""
    frame: str = ""
    """Bodies that name the same frame always have the same pose; empty: a pose of its own."""
    control: ControlPoints = field(default_factory=ControlPoints)
    """None of what cannot touch."""
    material: Mapping[str, Any] | None = None
    """Of the surface: the properties of ``Material`` by their names, SI units, and those of its ``Friction`` under ``friction_law``."""
    mass: float | None = None
    """kg, 0 for a fixed body; ``None`` of the parts of a hand, whose masses belong to its model."""
    centre_of_mass: tuple[float, float, float] | None = None
    """m, body frame."""
    part_of: int | None = None
    """Of a further collider: the body that carries it, a row of ``SceneModel.bodies``. ``None`` of all others."""
    link: int = 0
    """Link of the body, or of the finger, that it is fixed to, from 0; 0 for a rigid body."""

    @property
    def deforms(self) -> bool:
        """Whether its dents are drawn: those of what is gripped and of what grips, not those of the ground."""
        return self.kind in ("object", "fingertip") or (self.kind == "link" and self.part_of is not None)


@dataclass(frozen=True, eq=False)
class SceneModel:
    """What stays the same: the bodies and the names of the fingers."""

    bodies: tuple[BodyView, ...]
    """One for each body and link of a hand; behind them the further colliders of bodies that carry several (``BodyView.part_of``)."""
    fingers: tuple[str, ...] = ()
    dt: float = 1e-3
    """Time step, s."""
    floor: float = 0.0
    """Height of the ground grid, m, world."""

    def fingertips(self) -> list[int]:
        """Index of the body that is the fingertip of each finger."""
        where = {body.finger: i for i, body in enumerate(self.bodies) if body.kind == "fingertip"}
        return [where[f] for f in range(len(self.fingers)) if f in where]

    def pushes(self, contacts: ContactsState) -> FloatArray:
        """(c, 3) N, world: in every contact the force on what is pushed. Fingers push whatever they touch, supports push objects; between
        two equals it is the force on body b. Which of the two is body a depends on whose surface is sampled finer.
        """
        rank = np.array([PUSHERS.index(body.kind) for body in self.bodies] + [PUSHERS.index("support")])  # the last is of a collider -1
        on_a = rank[contacts.collider_b] < rank[contacts.collider_a]
        pushed: FloatArray = np.where(on_a, 1.0, -1.0)[:, None] * contacts.forces
        return pushed


@dataclass(frozen=True, eq=False)
class Moved:
    """Surface points of a body that are displaced; all others are at rest."""

    indices: IntArray
    """(k,) rows of ``BodyView.points``."""
    points: FloatArray
    """(k, 3) where they are now, m, body frame."""


@dataclass(frozen=True, eq=False)
class ContactsState:
    """The contacts of a step; row i of every array is contact i. Bodies and colliders are counted as in ``SceneModel.bodies``. The fields
    are those of ``RECORDED_FIELDS``.
    """

    points: FloatArray
    """(c, 3) m, world."""
    normals: FloatArray
    """(c, 3) unit, world, from body b to body a."""
    forces: FloatArray
    """(c, 3) N, world, on body a."""
    reactions: FloatArray
    """(c, 3) N, contact frame: normal, tangent1, tangent2."""
    gaps: FloatArray
    """(c,) m, > 0 is apart."""
    pressures: FloatArray
    """(c,) Pa."""
    areas: FloatArray
    """(c,) m^2."""
    status: npt.NDArray[np.uint8]
    """(c,) 0 open, 1 stick, 2 slip."""
    body_a: IntArray
    """(c,) the body whose control point it is; -1 if it is not drawn."""
    body_b: IntArray
    """(c,) the other body; -1 if it is not drawn."""
    collider_a: IntArray
    """(c,) the surface of body a that it is on: body a itself, or one of its further colliders; -1 if it is not drawn. In recordings from
    before it was recorded, body a.
    """
    collider_b: IntArray
    """(c,) the other surface; -1 if it is not drawn."""
    control_point: IntArray
    """(c,) which control point of collider a it is, a row of its ``BodyView.control``; -1 in recordings from before it was recorded."""

    def __len__(self) -> int:
        return len(self.points)

    def on(self, collider: int) -> npt.NDArray[np.bool_]:
        """(c,) which of them are on a surface, a row of ``SceneModel.bodies``."""
        mine: npt.NDArray[np.bool_] = (self.collider_a == collider) | (self.collider_b == collider)
        return mine

    @staticmethod
    def none() -> ContactsState:
        """No contact."""
        return ContactsState(**no_contacts())


@dataclass(frozen=True, eq=False)
class TrackedHand:
    """What a tracker sees of a hand; row i of every array is part i."""

    names: tuple[str, ...]
    positions: FloatArray
    """(n, 3) centre of the sphere that models the tip, m, world; NaN where it was never seen."""
    radii: FloatArray
    """(n,) of that sphere, m; 0 for a palm."""
    weights: FloatArray
    """(n,) 0 to 1: how much of its spring acts."""
    states: tuple[str, ...]
    """``"live"``, ``"held"``, ``"fading"``, ``"lost"`` or ``"absent"``."""
    fingers: tuple[int, ...]
    """(n,) the finger of ``SceneModel.fingers`` that follows it, -1 for none."""
    aims: FloatArray
    """(fingers, 3) where the skin of each finger's tip is drawn to, m, world."""
    ends: FloatArray
    """(fingers, 3) where it is."""
    dropped: int = 0
    """Frames so far of which a pose was dropped, because no hand can have come there."""


@dataclass(frozen=True, eq=False)
class SceneState:
    """Everything at one instant."""

    time: float
    """Simulated, s."""
    step: int
    positions: FloatArray
    """(bodies, 3) origin of each body frame, m, world."""
    quaternions: FloatArray
    """(bodies, 4) body frame to world, (w, x, y, z)."""
    moved: dict[int, Moved] = field(default_factory=dict)
    """By body; a body that is not there has its surface at rest."""
    contacts: ContactsState = field(default_factory=ContactsState.none)
    finger_forces: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    """(fingers, 3) sum of the contact forces of each fingertip on whatever it touches, N, world; without those of other surfaces of the
    finger.
    """
    normal_forces: FloatArray = field(default_factory=lambda: np.zeros(0))
    """(fingers,) sum of the normal reactions of each fingertip, N."""
    joint_positions: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    """(fingers, joints) rad; NaN beyond the last joint of a finger that has fewer than others."""
    step_time: float = 0.0
    """Computing time of the step, s."""
    stage_times: dict[str, float] = field(default_factory=dict)
    """Computing time per stage, s."""
    residual: float = 0.0
    converged: bool = True
    quarantined: tuple[int, ...] = ()
    """Bodies that became non-finite, in this step or before, and are set aside since; those that are not drawn are left out."""
    phase: str = ""
    """What is going on, in a word or two, for the panel."""
    notice: str = ""
    """What a person should know or do now, in a sentence; empty where there is nothing."""
    tracked: TrackedHand | None = None
    """The hand that the fingers follow, if a tracker sees one."""
