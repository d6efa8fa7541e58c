"""The interactive grasp: a world, and what a person can do to it. Belongs to the simulation thread alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from quasirigid._quasirigid import Material, StepReport
from quasirigid.arrays.types import FloatArray
from quasirigid.errors import InvalidValueError, QuasirigidError
from quasirigid.grasp.experiment import LIFT, Grasp, minimum_jerk
from quasirigid.grasp.options import GraspOptions
from quasirigid.grasp.setup import GraspTarget
from quasirigid.rotation import conjugate, rotate
from quasirigid.scene.model import SceneState
from quasirigid.scene.world import WorldScene

BASE_SPEED, BASE_TURN = 0.25, 2.5
"""The hand's base follows its gizmo no faster than this, m/s and rad/s."""
FINGER_SPEED = 0.15
"""Nor do fingertips, m/s."""
FOLLOW = 0.05
"""Time constant with which both follow, s."""
IK_EVERY = 5
"""Steps between two updates of where a fingertip should go."""
PULL_FREQUENCY = 5.0
"""Of the spring with which a person pulls the object, Hz: stiff enough to follow the mouse, soft enough to feel it give."""
PULL_LIMIT = 15.0
"""Strongest pull, N."""
LOST = 0.5
"""Objects farther away than this from the hand, and from where it started, are lost, m."""
EMPTY = 0.02
"""A hand that presses with less holds nothing, N."""
HOLDING = ("holding", "weak")
"""States of a grip that holds; weak is with less than was asked for."""
STAND_GOES = 0.4
"""The stand of an object lets go within so many seconds once the fingers hold it."""
STEP_SHARE = 0.8
"""Of the time step: how long a step that must keep up with the clock may take. The rest is for drawing."""


@dataclass(frozen=True)
class Figures:
    """What the sliders say."""

    squeeze: float
    """N."""
    friction: float
    mass: float
    """kg."""
    gravity: float
    """m/s^2, downwards."""
    pad: str
    """Material of the fingertips."""


class Play:
    """A grasp to play with. Every method is called from the simulation thread."""

    def __init__(
        self, options: GraspOptions, target: Callable[[GraspOptions, float, float], GraspTarget] | None = None, choice: str | None = None
    ) -> None:
        """``target`` makes the object from options, friction and density; ``None`` is the one the options speak of. ``choice`` is what it
        is called in the panel's list; ``None``: the name of its file, or ``"box"``.
        """
        self.options = replace(options, support=options.support or "table")
        self.choice = choice or ("box" if options.object is None else options.object.name)
        self._make = target
        self._prepared: GraspTarget | None = None
        self.build()

    def build(self) -> None:
        """Build the world again: everything as at the start. Raises the errors of ``quasirigid.errors`` and then leaves all as it was."""
        prepared = self._prepared
        if prepared is None and self._make is not None:
            material = Material.preset(self.options.material)
            friction = np.sqrt(material.friction * Material.preset("fingertip_pulp").friction)
            prepared = self._make(
                self.options, float(friction if self.options.friction is None else self.options.friction), material.density
            )
        grasp = Grasp(self.options, target=prepared, step_budget=STEP_SHARE * self.options.dt)
        self._prepared = grasp.target  # surfaces are made once
        self.grasp, self.world, self.hand, self.object = grasp, grasp.world, grasp.hand, grasp.object
        self.grip = grasp.grip
        grasp.stands_on.add_mat(self.world)
        self.scene = WorldScene(self.world)
        pad = self.hand.material
        assert pad is not None
        self.figures = Figures(grasp.target.squeeze, grasp.friction, self.object.mass, 9.81, pad.name)
        self.base = (self.hand.position, self.hand.quaternion)
        self._home = self.base
        self._aim = self.base
        self._fingers: dict[int, FloatArray] = {}
        self._aims: dict[int, FloatArray] = {}
        self._facing: dict[int, FloatArray] = {}
        self._pull: tuple[FloatArray, FloatArray] | None = None
        self._stand = 1.0
        self._count = 0
        self.report: StepReport | None = None

    # What the buttons and sliders do.

    def set_squeeze(self, newtons: float) -> None:
        """Squeeze with this force."""
        self.grip.squeeze = newtons
        self.figures = replace(self.figures, squeeze=newtons)

    def set_friction(self, coefficient: float) -> None:
        """Coulomb coefficient between fingers and object: both get it."""
        for body in (self.hand, self.object):
            material = body.material
            assert material is not None
            body.material = material.replace(friction=coefficient)
        self.figures = replace(self.figures, friction=coefficient)

    def set_mass(self, kilograms: float) -> None:
        """Make the object heavier or lighter."""
        self.object.set_mass(self.grasp.target.mass.scaled_to_mass(kilograms))
        self.figures = replace(self.figures, mass=kilograms)

    def set_gravity(self, acceleration: float) -> None:
        """Gravity downwards, m/s^2."""
        self.world.gravity = (0.0, 0.0, -acceleration)
        self.figures = replace(self.figures, gravity=acceleration)

    def set_pad(self, name: str) -> None:
        """Make the fingertips of another material; the friction stays what the slider says."""
        self.hand.material = Material.preset(name).replace(friction=self.figures.friction, compliance=self.options.compliance)
        self.figures = replace(self.figures, pad=name)

    def close(self) -> None:
        """Close the hand."""
        self._release_fingers()
        self.grip.close()

    def open(self) -> None:
        """Open the hand."""
        self._release_fingers()
        self.grip.open()

    def lift(self, up: bool) -> None:
        """Send the hand LIFT up or down from where it is sent now; down no deeper than where it started. The squeeze is
        kept up on the way.
        """
        if self.grip.state in ("squeezing", *HOLDING):
            self._let_stand_go()
            self.grip.squeeze = self.figures.squeeze
        (x, y, z), turn = self._aim
        lowest = min(float(self._home[0][2]), z)
        self._aim = (np.array([x, y, z + LIFT if up else max(z - LIFT, lowest)]), turn)

    # What hands on the scene do.

    def aim_base(self, position: FloatArray, quaternion: FloatArray) -> None:
        """Where the hand's base shall go; it follows no faster than a hand moves. Raises ``InvalidValueError`` for what is no pose."""
        _check_place("position", position)
        if np.shape(quaternion) != (4,) or not abs(float(np.linalg.norm(quaternion)) - 1.0) < 1e-3:
            raise InvalidValueError("quaternion", "four numbers of length 1", quaternion, "send w, x, y, z")
        if self.grip.state in HOLDING and self._stand > 0.0:
            self._let_stand_go()
        self._aim = (position, quaternion)

    def aim_finger(self, finger: int, position: FloatArray) -> None:
        """Where the middle of a fingertip's pad shall go, (3,) m, world; the grip lets go of all joints. Raises ``InvalidValueError`` for
        what is no place.
        """
        _check_place("position", position)
        positions, quaternions = self.hand.tip_poses()
        if finger not in self._fingers:
            self._fingers[finger] = self._in_hand(positions[finger])
            self._facing[finger] = rotate(conjugate(self.hand.quaternion), rotate(quaternions[finger], np.array([0.0, 0.0, 1.0])))
        self._aims[finger] = self._in_hand(position)

    def pull(self, grabbed: FloatArray | None, to: FloatArray | None) -> None:
        """Pull the object at ``grabbed``, (3,) m, object frame, towards ``to``, (3,) m, world; ``None`` lets go. Raises
        ``InvalidValueError`` for what is no place.
        """
        for what, place in (("grabbed", grabbed), ("to", to)):
            if place is not None:
                _check_place(what, place)
        self._pull = None if grabbed is None or to is None else (grabbed, to)
        if self._pull is None:
            self.object.apply_wrench((0.0, 0.0, 0.0))
        else:
            self._let_stand_go()

    @property
    def pulled(self) -> tuple[FloatArray, FloatArray, float] | None:
        """Where the object is pulled, to where, (3,) m each, world, and with what force, N."""
        if self._pull is None:
            return None
        start = self.object.position + rotate(self.object.quaternion, self._pull[0])
        return start, self._pull[1], float(np.linalg.norm(self._pull_wrench(start)[0]))

    def step(self) -> StepReport:
        """One step of the world."""
        self._count += 1
        self._move_base()
        if self._fingers:
            self._move_fingers()
        else:
            self.grip.update()
        if self._pull is not None:
            self.object.apply_wrench(*self._pull_wrench(self.object.position + rotate(self.object.quaternion, self._pull[0])))
        if self._stand > 0.0 and not self.grasp.target.flat and self.grip.state in HOLDING:
            self._stand = max(0.0, self._stand - self.world.dt / STAND_GOES)
            self.grasp.hold_by_stand(minimum_jerk(self._stand))
        self.report = self.world.step()
        return self.report

    def state(self) -> SceneState:
        """The world now."""
        return self.scene.state(self.report, self.phase)

    @property
    def phase(self) -> str:
        """What is going on."""
        if self.world.quarantined:
            return "a body was set aside: press Reset"
        if min(float(np.linalg.norm(self.object.position - place)) for place in (self._home[0], self.hand.position)) > LOST:
            return "the object is out of reach: press Reset"
        if self.grip.state in HOLDING and float(np.abs(self.grip.forces()).max()) < EMPTY:
            return "nothing in the hand: press Open and Close, or Reset"
        if self._fingers:
            return "fingers by hand"
        return "holding, with less than was asked for" if self.grip.state == "weak" else self.grip.state

    def finger_aims(self) -> FloatArray:
        """Where each fingertip is, or is sent, (fingers, 3) m, world: where its gizmo belongs."""
        places = self.hand.tip_poses()[0]
        for finger, place in self._aims.items():
            places[finger] = self.hand.position + rotate(self.hand.quaternion, place)
        return places

    @property
    def base_aim(self) -> tuple[FloatArray, FloatArray]:
        """Where the base is sent."""
        return self._aim

    def _in_hand(self, point: FloatArray) -> FloatArray:
        return rotate(conjugate(self.hand.quaternion), point - self.hand.position)

    def _release_fingers(self) -> None:
        self._fingers.clear()
        self._aims.clear()
        self._facing.clear()

    def _let_stand_go(self) -> None:
        self._stand = 0.0
        self.grasp.hold_by_stand(0.0)

    def _move_base(self) -> None:
        place, turn = self.base
        goal, wanted = self._aim
        dt = self.world.dt
        way = goal - place
        distance = float(np.linalg.norm(way))
        if distance > 1e-9:
            place = place + way * min(dt / FOLLOW, BASE_SPEED * dt / distance, 1.0)
        towards = wanted if turn @ wanted >= 0.0 else -wanted
        angle = 2.0 * float(np.arccos(min(1.0, abs(float(turn @ wanted)))))
        if angle > 1e-7:
            share = min(dt / FOLLOW, BASE_TURN * dt / angle, 1.0)
            turn = turn + share * (towards - turn)  # small steps: the straight way between unit quaternions will do
            turn = turn / np.linalg.norm(turn)
        if distance > 1e-9 or angle > 1e-7:
            self.base = (place, turn)
            self.hand.move_to(place, turn)

    def _move_fingers(self) -> None:
        if self._count % IK_EVERY:
            return
        targets = self.hand.joint_targets.copy()
        most = IK_EVERY * self.world.dt
        for finger, place in self._fingers.items():
            way = self._aims[finger] - place
            distance = float(np.linalg.norm(way))
            if distance < 1e-7:
                continue
            next_place = place + way * min(most / FOLLOW, FINGER_SPEED * most / distance, 1.0)
            try:
                targets[finger] = self.hand.inverse_kinematics(finger, next_place, self._facing[finger])
            except QuasirigidError:
                continue  # out of reach: the finger stays where it could go
            self._fingers[finger] = next_place
        self.hand.joint_targets = targets

    def _pull_wrench(self, start: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Force (N) and torque about the centre of mass (N m), world, of a damped spring from ``start``, the grabbed point, to the pointer:
        `F = k (x* - x) - c v`, critically damped for the free object. Neither the spring nor the whole is stronger than PULL_LIMIT.
        """
        assert self._pull is not None
        mass, rate = max(self.object.mass, 1e-3), 2.0 * np.pi * PULL_FREQUENCY
        damping = 2.0 * mass * rate
        spring = _limited(mass * rate**2 * (self._pull[1] - start))
        wanted = spring - damping * self.object.linear_velocity
        force = _limited(wanted)
        share = float(np.linalg.norm(force)) / max(float(np.linalg.norm(wanted)), 1e-300)
        # Damping acts at the centre of mass; (2 cm)^2 of it on the spin: swings die down.
        torque = share * np.cross(start - self.object.centre_of_mass, spring) - damping * 4e-4 * self.object.angular_velocity
        return force, torque


def _limited(force: FloatArray) -> FloatArray:
    size = float(np.linalg.norm(force))
    return force if size <= PULL_LIMIT else force * (PULL_LIMIT / size)


def _check_place(what: str, place: FloatArray) -> None:
    """What comes from a page may be anything."""
    if np.shape(place) != (3,) or not np.isfinite(place).all():
        raise InvalidValueError(what, "three finite numbers, m", place, "drag it again")
