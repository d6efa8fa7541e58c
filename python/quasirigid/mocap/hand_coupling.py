"""The whole hand: a base that goes with the tracked palm, fingers that reach for the tracked tips."""

from __future__ import annotations

import math

import numpy as np

from quasirigid._quasirigid import Body, Hand, HandModel, HandTargets, Material, World
from quasirigid.arrays.types import FloatArray
from quasirigid.errors import InvalidValueError
from quasirigid.mocap.coupling import PAD_CONTROL_POINTS, PAD_POINTS, PALM
from quasirigid.mocap.coupling_state import Restorable
from quasirigid.mocap.release import Release
from quasirigid.mocap.springs import FASTEST, MAX_FORCE, OFFSET_GONE, SPRING_SHARE, Offset, fading
from quasirigid.rotation import conjugate, matrix_of, quaternion_of_vector, quaternion_product, rotation_vector

BASE_IN_PALM = (0.014, -0.012, 0.018)
"""Origin of the three-finger hand in the palm frame of a right hand, m: between the fingers, over the knuckles; axes as the palm's."""
ITERATIONS, SEARCH = 12, 200
"""Of inverse kinematics from the posture of the step before, and from a half-closed finger."""
SETTLED = 1e-8
"""Inverse kinematics ends when no joint moves by more than this, rad: a nanometre at the tip."""
JOINT_FASTEST = 8.0
"""With which joint targets move at most, rad/s in all joints of a finger together: where inverse kinematics finds another posture, it is
not jumped to.
"""

MAX_SPEED = (1.5, 15.0)
"""Top speed of the base, m/s and rad/s. Nothing yields where it moves to, so it is slower than a pad on its spring."""


class Base:
    """Where the base of the hand goes: with the palm. It stays where it is while the palm is lost, and glides to it when it is seen again.
    It never moves faster than ``MAX_SPEED``: from a palm that does it stays behind, and catches up.
    """

    def __init__(self, place: FloatArray, turn: FloatArray) -> None:
        """``place`` (3,) m and ``turn`` (4,): where it begins, world."""
        self.place, self.turn = place, turn
        self._weight = 1.0
        self._there = True
        self._away: FloatArray = np.zeros(6)
        """From where it should be to where it is, unless it is there: m, and rotation vector, world."""

    def follow(self, place: FloatArray, turn: FloatArray, weight: float, dt: float) -> None:
        """Go on for ``dt`` s; it should be at ``place`` and ``turn``, of which ``weight`` is to be believed."""
        if weight > 0.0:
            if self._weight == 0.0:
                self._away = np.concatenate([self.place - place, rotation_vector(quaternion_product(self.turn, conjugate(turn)))])
                self._there = False
            elif not self._there:
                self._away[:3] += dt * fading(self._away[:3], FASTEST[0])
                self._away[3:] += dt * fading(self._away[3:], FASTEST[1])
                self._there = bool(np.abs(self._away).max() < OFFSET_GONE)
            before = self.place, self.turn
            self.place, self.turn = place, turn
            if not self._there:
                self.place, self.turn = place + self._away[:3], quaternion_product(quaternion_of_vector(self._away[3:]), turn)
            self._keep_speed(*before, dt)
        self._weight = weight

    def _keep_speed(self, place: FloatArray, turn: FloatArray, dt: float) -> None:
        """Go no farther from ``place`` and ``turn`` than in ``dt`` s at top speed."""
        way, rotation = self.place - place, rotation_vector(quaternion_product(self.turn, conjugate(turn)))
        shares = [top * dt / max(math.sqrt(v @ v), 1e-12) for top, v in zip(MAX_SPEED, (way, rotation), strict=True)]
        if shares[0] < 1.0:
            self.place = place + shares[0] * way
        if shares[1] < 1.0:
            self.turn = quaternion_product(quaternion_of_vector(shares[1] * rotation), turn)


class HandCoupling(Restorable):
    """The three-finger hand: its base goes with the palm, its fingers reach for thumb, index and middle finger, within
    their joint limits.
    """

    fingers: tuple[str, ...]
    rows: tuple[int, ...]
    waiting: frozenset[int] = frozenset()

    def __init__(
        self,
        world: World,
        targets: HandTargets,
        pad: Material,
        *,
        side: str = "right",
        gains: tuple[float, float] = (1.0, 1.0),
        max_force: float = MAX_FORCE,
    ) -> None:
        """Add the hand to ``world`` where the palm is now. ``gains``: factors of the joints' stiffness and damping. ``max_force``: most
        that a pad presses with, N.

        Raises ``InvalidValueError`` if palm, thumb, index and middle finger were not all seen.
        """
        # Seen from the palm a left hand has its index finger on the other side.
        self.rows = (0, 1, 2) if side == "right" else (0, 2, 1)
        if not np.isfinite(targets.positions[[*self.rows, PALM]]).all():
            expected = "palm, thumb, index and middle finger to have been seen"
            raise InvalidValueError(
                "targets", expected, "one of them was not", "wait until the tracker sees them, or couple the tips alone"
            )
        self._rows = list(self.rows)
        self.miss: FloatArray = np.zeros(len(self.rows))
        """How far the fingers fall short of the tracked tips, m: beyond their reach or their joint limits."""
        self._base_in_palm = np.array(BASE_IN_PALM) * [1.0, 1.0 if side == "right" else -1.0, 1.0]
        self._dt, self._max_force = world.dt, SPRING_SHARE * max_force
        base, turn = self._wanted(targets)
        self._base = Base(base, turn)
        model = HandModel.three_finger().with_gains(*gains)
        self._hand = world.add_hand(
            model, position=base, quaternion=turn, material=pad, points=PAD_POINTS, control_points=PAD_CONTROL_POINTS
        )
        self.fingers = tuple(model.finger_names)
        # Searched from half-closed: a stretched finger cannot tell which way to bend.
        middle = 0.5 * (model.lower_limits + model.upper_limits)
        self._middle = middle
        self._found = self._reach(targets, middle, iterations=SEARCH)
        self._aims = self._found.copy()
        """Joint targets, and the postures that inverse kinematics has found, (fingers, joints) rad."""
        self._hand.joint_positions = self._aims
        self._hand.joint_targets = self._aims
        self.release = Release(len(self.rows), self._dt)
        self._offsets = [Offset((self._aims.shape[1], JOINT_FASTEST)) for _ in self.rows]

    @property
    def pads(self) -> list[Body]:
        """None: they belong to the hand."""
        return []

    @property
    def hands(self) -> list[Hand]:
        """The hand."""
        return [self._hand]

    @property
    def ends(self) -> FloatArray:
        """Apex of every pad's skin, (fingers, 3) m, world."""
        return self._hand.tip_poses()[0]

    def _wanted(self, targets: HandTargets) -> tuple[FloatArray, FloatArray]:
        """Place (3,) m and quaternion (4,) of the base if it were with the palm."""
        turn = targets.quaternions[PALM]
        return targets.positions[PALM] + matrix_of(turn) @ self._base_in_palm, turn

    def _reach(self, targets: HandTargets, start: FloatArray, iterations: int, shift: FloatArray | float = 0.0) -> FloatArray:
        apex, facing = targets.pad_places()
        rows, to_world = self._rows, matrix_of(self._base.turn)
        places, ways = (apex[rows] + shift - self._base.place) @ to_world, facing[rows] @ to_world
        joints, self.miss = self._hand.reach_all(places, ways, start, iterations=iterations, step_tolerance=SETTLED)
        return joints

    def follow(self, targets: HandTargets, rate: float = 1.0) -> None:
        """Aim at these targets in the next step. Fingers that the tracker has lost go limp; the base stays where the palm was lost."""
        self._base.follow(*self._wanted(targets), float(targets.weights[PALM]), self._dt)
        self._hand.move_to(self._base.place, self._base.turn)
        weights = targets.weights[self._rows]
        back = [f for f, offset in enumerate(self._offsets) if offset.weight == 0.0 < weights[f]]
        if back:
            # Seen again, perhaps far away: the posture of before may lead astray.
            self._found[back] = self._middle[back]
        apex, facing = targets.pad_places()
        self.release.update(apex[self._rows], self.ends, facing[self._rows])
        self._found = self._reach(targets, self._found, iterations=SEARCH if back else ITERATIONS, shift=self.release.shift)
        way = self._found - self._aims
        length = np.linalg.norm(way, axis=1, keepdims=True)
        self._aims = self._aims + way * np.minimum(1.0, rate * JOINT_FASTEST * self._dt / np.maximum(length, 1e-12))
        if weights.min() == 1.0 and all(offset.zero and offset.weight == 1.0 for offset in self._offsets):
            self._aim(self._aims)
            return
        # A controller of weight w is one whose target is w of the way from where the joints are to where they should be.
        joints, goals = self._hand.joint_positions, self._aims.copy()
        for f, (weight, offset) in enumerate(zip(weights.tolist(), self._offsets, strict=True)):
            offset.update(weight, self._aims[f] - joints[f] if weight > offset.weight else None, self._dt)
            goals[f] += offset.value
        self._aim(joints + weights[:, None] * (goals - joints))

    def _aim(self, joints: FloatArray) -> None:
        """Joint targets, no farther from where the joints are than makes a pad that is held fast press with the largest force."""
        forces = np.linalg.norm(self._hand.blocked_forces(joints), axis=1)
        if forces.max() > self._max_force:
            now = self._hand.joint_positions
            joints = now + np.minimum(1.0, self._max_force / np.maximum(forces, 1e-12))[:, None] * (joints - now)
        self._hand.joint_targets = joints
