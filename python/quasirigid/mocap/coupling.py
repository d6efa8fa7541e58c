"""What links tracked fingers to simulated ones. Both ways are damped springs: who pinches harder than the object gives way presses harder.

- ``TipCoupling``: every tracked fingertip pulls a pad of its own, a free body, by a spring in translation and rotation.
- ``HandCoupling``: the tracked palm carries the base of the three-finger hand, inverse kinematics turns the tracked tips into joint targets, and
  the joint position controllers are the springs.

Both are taken implicitly by the step (``Body.set_drive`` and the joint controllers), so that no stiffness and no rate of the tracker makes them unstable.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from quasirigid._quasirigid import Body, Hand, HandModel, HandTargets, MassProperties, Material, Surface, World
from quasirigid.errors import InvalidValueError
from quasirigid.mocap import PARTS
from quasirigid.summary import conjugate

FloatArray = npt.NDArray[np.float64]
PALM = PARTS.index("palm")
PAD_POINTS, PAD_CONTROL_POINTS = 1200, 160
"""Of a fingertip's surface: half of those of `quasirigid grasp`, so that a step is done in time."""
PAD_MASS = 0.02
"""Of a pad that is a body of its own, kg: a fingertip's."""
PAD_DRAG = (0.05, 1e-5)
"""Viscosity that brings a pad to rest which no tracker holds, N s/m and N m s/rad."""
OFFSET_FADES = 0.1
"""Time constant with which a pad that is caught again goes to where the tracker sees it, s."""
OFFSET_GONE = 1e-5
"""An offset smaller than this, m or rad, is dropped."""
BASE_IN_PALM = (0.014, -0.012, 0.018)
"""Origin of the three-finger hand in the palm frame of a right hand, m: between the fingers, over the knuckles; axes as the palm's."""


@dataclass(frozen=True)
class Springs:
    """Stiffness and damping between tracker and pad."""

    stiffness: tuple[float, float] = (600.0, 0.5)
    """N/m and N m/rad."""
    damping: tuple[float, float] = (8.0, 0.01)
    """N s/m and N m s/rad."""

    def check(self) -> None:
        """Refuse what is no spring. Raises ``InvalidValueError``."""
        for name, pair in (("stiffness", self.stiffness), ("damping", self.damping)):
            if not all(math.isfinite(x) and x >= 0.0 for x in pair):
                raise InvalidValueError(name, "two finite numbers >= 0 (translation, rotation)", pair, "give SI units")


class Coupling(Protocol):
    """What a session needs of a coupling."""

    fingers: tuple[str, ...]
    """Names of the simulated fingers."""
    rows: tuple[int, ...]
    """The row of ``HandTargets`` that each of them follows."""

    @property
    def pads(self) -> list[Body]:
        """Pads that are bodies of their own."""

    @property
    def hands(self) -> list[Hand]:
        """Hands that were added."""

    @property
    def ends(self) -> FloatArray:
        """(fingers, 3) m, world: apex of each simulated pad's skin, which is drawn to ``pad_places``."""

    def follow(self, targets: HandTargets, rate: float = 1.0) -> None:
        """Aim at these targets in the next step. ``rate``: how much faster than simulated time the hand is shown."""


def pad_places(targets: HandTargets) -> tuple[FloatArray, FloatArray]:
    """Apex of every tracked pad's skin, (6, 3) m, and the direction that it faces, (6, 3), world; NaN where never seen."""
    facing = _minus_z(targets.quaternions)
    return targets.positions + targets.pad_radii[:, None] * facing, facing


# Plain sums of products: `numpy.cross` takes ten times as long for so few numbers, and this is done in every step.


def _minus_z(q: FloatArray) -> FloatArray:
    """The negative z axes of the frames ``q`` (n, 4)."""
    w, x, y, z = q.T
    facing = np.empty((len(q), 3))
    facing[:, 0] = -2.0 * (x * z + w * y)
    facing[:, 1] = -2.0 * (y * z - w * x)
    facing[:, 2] = 2.0 * (x * x + y * y) - 1.0
    return facing


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross products of rows (n, 3)."""
    return a[:, _YZX] * b[:, _ZXY] - a[:, _ZXY] * b[:, _YZX]


_YZX, _ZXY = np.array([1, 2, 0]), np.array([2, 0, 1])


def _matrix(q: FloatArray) -> FloatArray:
    """(3, 3) of the quaternion ``q`` (4,)."""
    w, x, y, z = q.tolist()
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def _product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Quaternion product."""
    w, v, u, s = a[0], a[1:], b[1:], b[0]
    return np.concatenate([[w * s - v @ u], w * u + s * v + np.cross(v, u)])


def _rotation_vector(q: FloatArray) -> FloatArray:
    """Rotation vector of a unit quaternion, angle at most pi."""
    q = q if q[0] >= 0.0 else -q
    sine = float(np.linalg.norm(q[1:]))
    return 2.0 * q[1:] if sine < 1e-9 else q[1:] * (2.0 * math.atan2(sine, float(q[0])) / sine)


def _quaternion(vector: FloatArray) -> FloatArray:
    """The inverse of ``_rotation_vector``."""
    angle = float(np.linalg.norm(vector))
    share = 0.5 if angle < 1e-9 else math.sin(0.5 * angle) / angle
    return np.concatenate([[math.cos(0.5 * angle)], share * vector])


class _Offset:
    """Lets a spring grow stiffer without giving it energy.

    A spring of stretch e that goes from stiffness k0 to k1 > k0 would hold more energy than before, out of nothing. Here its target is moved
    towards the body until the energy is what it was, ``e' = e sqrt(k0 / k1)``, and goes back to where it belongs with the time constant
    ``OFFSET_FADES``: that is work which the hand does. A pad that was lost and is seen again is so caught where it is.
    """

    def __init__(self) -> None:
        self.weight = 1.0
        self.linear: FloatArray = np.zeros(3)
        self.angular: FloatArray = np.zeros(3)
        self.zero = True

    def update(self, weight: float, stretch: tuple[FloatArray, FloatArray] | None, dt: float) -> None:
        """``stretch`` is that between body and target without offset (m and rad); it is needed if the weight has grown."""
        if self.zero and weight <= self.weight:
            self.weight = weight
            return
        if not self.zero:
            share = math.exp(-dt / OFFSET_FADES)
            self.linear, self.angular = share * self.linear, share * self.angular
        if stretch is not None and weight > self.weight:
            kept = math.sqrt(self.weight / weight)
            self.linear = kept * (stretch[0] + self.linear) - stretch[0]
            self.angular = kept * (stretch[1] + self.angular) - stretch[1]
        self.zero = bool(max(np.abs(self.linear).max(), np.abs(self.angular).max()) < OFFSET_GONE)
        if self.zero:
            self.linear, self.angular = np.zeros(3), np.zeros(3)
        self.weight = weight


class TipCoupling:
    """Pads that are free bodies on springs to the tracked tips. They weigh nothing for the person: their weight is taken off."""

    def __init__(self, world: World, targets: HandTargets, pad: Material, springs: Springs | None = None) -> None:
        """Add a pad of the material ``pad`` to ``world`` for every finger that ``targets`` knows, where it is now.

        Raises ``InvalidValueError`` if it knows none.
        """
        self.springs = springs or Springs()
        self.springs.check()
        self.rows = tuple(row for row in range(PALM) if np.isfinite(targets.positions[row]).all())
        if not self.rows:
            raise InvalidValueError("targets", "at least one finger that was seen", "none", "wait until the tracker sees a finger")
        self.fingers = tuple(PARTS[row] for row in self.rows)
        self._dt = world.dt
        semi = HandModel.three_finger().pad_semi_axes
        self._depth = float(semi[2])
        surface, mass = (
            Surface.fingertip(semi, points=PAD_POINTS, control_points=PAD_CONTROL_POINTS),
            MassProperties.box(2.0 * semi, mass=PAD_MASS),
        )
        places, turns, _ = self._pads(targets)
        self._bodies = [
            world.add_body(surface, pad, mass=mass, position=places[row], quaternion=turns[row], name=PARTS[row], viscosity=PAD_DRAG)
            for row in self.rows
        ]
        for body in self._bodies:
            body.apply_wrench(-PAD_MASS * world.gravity)
        self._offsets = [_Offset() for _ in self.rows]

    @property
    def pads(self) -> list[Body]:
        """The pads, in the order of ``fingers``."""
        return self._bodies

    @property
    def hands(self) -> list[Hand]:
        """None."""
        return []

    @property
    def ends(self) -> FloatArray:
        """Apex of every pad's skin, (fingers, 3) m, world."""
        facing = -_minus_z(np.array([pad.quaternion for pad in self._bodies]))
        return np.array([pad.position for pad in self._bodies]) + self._depth * facing

    def _pads(self, targets: HandTargets) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Places (6, 3) m and quaternions (6, 4) of the pads' frames (x along the finger, z out of the pad), and lever arms from the tips (6, 3) m."""
        apex, facing = pad_places(targets)
        places = apex - self._depth * facing
        w, x, y, z = targets.quaternions.T  # times half a turn about x
        return places, np.array([-x, w, z, -y]).T, places - targets.positions

    def follow(self, targets: HandTargets, rate: float = 1.0) -> None:
        """Aim at these targets in the next step. ``rate``: how much faster than simulated time the hand is shown."""
        places, turns, arms = self._pads(targets)
        spin = rate * targets.angular_velocities
        speed = rate * targets.linear_velocities + _cross(spin, arms)
        weights = targets.weights
        (k, kr), (d, dr) = self.springs.stiffness, self.springs.damping
        for body, row, offset in zip(self._bodies, self.rows, self._offsets, strict=True):
            weight = float(weights[row])
            place, turn, v, omega = places[row], turns[row], speed[row], spin[row]
            stretch = None
            if weight > offset.weight:
                stretch = place - body.position, _rotation_vector(_product(turn, conjugate(body.quaternion)))
            offset.update(weight, stretch, self._dt)
            if not offset.zero:
                place, v = place + offset.linear, v - offset.linear / OFFSET_FADES
                turn, omega = _product(_quaternion(offset.angular), turn), omega - offset.angular / OFFSET_FADES
            body.set_drive(
                place,
                turn,
                stiffness=(weight * k, weight * kr),
                damping=(weight * d, weight * dr),
                linear_velocity=v,
                angular_velocity=omega,
            )


class HandCoupling:
    """The three-finger hand: its base goes with the palm, its fingers reach for thumb, index and middle finger, within their joint limits."""

    fingers: tuple[str, ...]
    rows: tuple[int, ...]

    def __init__(self, world: World, targets: HandTargets, pad: Material, *, side: str = "right") -> None:
        """Add the hand to ``world`` where the palm is now.

        Raises ``InvalidValueError`` if palm, thumb, index and middle finger were not all seen.
        """
        # Seen from the palm a left hand has its index finger on the other side.
        self.rows = (0, 1, 2) if side == "right" else (0, 2, 1)
        if not np.isfinite(targets.positions[[*self.rows, PALM]]).all():
            expected = "palm, thumb, index and middle finger to have been seen"
            raise InvalidValueError(
                "targets", expected, "one of them was not", "wait until the tracker sees them, or couple the tips alone"
            )
        mirror = np.array([1.0, 1.0 if side == "right" else -1.0, 1.0])
        self._base = np.array(BASE_IN_PALM) * mirror
        base, turn = self._base_pose(targets)
        model = HandModel.three_finger()
        self._hand = world.add_hand(
            model, position=base, quaternion=turn, material=pad, points=PAD_POINTS, control_points=PAD_CONTROL_POINTS
        )
        self.fingers = tuple(model.finger_names)
        # Searched from half-closed: a stretched finger cannot tell which way to bend.
        middle = 0.5 * (model.lower_limits + model.upper_limits)
        self._aims = self._reach(targets, middle, iterations=200)
        self._hand.joint_positions = self._aims
        self._hand.joint_targets = self._aims
        self.miss: FloatArray = np.zeros(len(self.rows))

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

    def _base_pose(self, targets: HandTargets) -> tuple[FloatArray, FloatArray]:
        turn = targets.quaternions[PALM]
        return targets.positions[PALM] + _matrix(turn) @ self._base, turn

    def _reach(self, targets: HandTargets, start: FloatArray, iterations: int = 12) -> FloatArray:
        apex, facing = pad_places(targets)
        base, turn = self._base_pose(targets)
        rows, to_world = list(self.rows), _matrix(turn)
        places, ways = (apex[rows] - base) @ to_world, facing[rows] @ to_world
        found = [self._hand.reach(f, places[f], ways[f], start=start[f], iterations=iterations) for f in range(len(rows))]
        self.miss = np.array([error for _, error in found])
        """How far the fingers fall short of the tracked tips, m: beyond their reach or their joint limits."""
        return np.stack([joints for joints, _ in found])

    def follow(self, targets: HandTargets, rate: float = 1.0) -> None:  # noqa: ARG002  # joint controllers aim at places, not velocities
        """Aim at these targets in the next step. The base follows the palm wherever it is; fingers that the tracker has lost go limp."""
        self._hand.move_to(*self._base_pose(targets))
        self._aims = self._reach(targets, self._aims)
        weights = targets.weights[list(self.rows), None]
        if weights.min() < 1.0:
            self._hand.joint_targets = self._aims * weights + self._hand.joint_positions * (1.0 - weights)
        else:
            self._hand.joint_targets = self._aims
