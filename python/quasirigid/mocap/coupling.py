"""What links tracked fingers to simulated ones. Both ways are damped springs: who pinches harder than the object gives way presses harder.

- ``TipCoupling``: every tracked fingertip pulls a pad of its own, a free body, by a spring in translation and rotation.
- ``HandCoupling`` (``quasirigid.mocap.hand_coupling``): the tracked palm carries the base of the three-finger hand, inverse kinematics
  turns the tracked tips into joint targets, and the joint position controllers are the springs.

Both are taken implicitly by the step (``Body.set_drive`` and the joint controllers), so that no stiffness and no rate of the tracker makes
them unstable. Both saturate: whatever the tracker says, a pad presses with ``MAX_FORCE`` and moves with ``MAX_SPEED`` at most.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Protocol

import numpy as np

from quasirigid._quasirigid import Body, Hand, HandModel, HandTargets, MassProperties, Material, Surface, World
from quasirigid.arrays.types import FloatArray
from quasirigid.errors import InvalidValueError
from quasirigid.mocap import PARTS
from quasirigid.mocap.coupling_state import Restorable
from quasirigid.mocap.release import Release
from quasirigid.mocap.springs import FASTEST, LEVER, MAX_FORCE, MAX_SPEED, SPRING_SHARE, Offset, Springs
from quasirigid.rotation import conjugate, cross, minus_z, quaternion_of_vector, quaternion_product, rotation_vector

PALM = PARTS.index("palm")
PAD_POINTS, PAD_CONTROL_POINTS = 1200, 160
"""Of a fingertip's surface: half of those of `quasirigid grasp`, so that a step is done in time."""
PAD_MASS = 0.02
"""Of a pad that is a body of its own, kg: a fingertip's."""
ASIDE = (0.0, 0.0, -2.0)
"""Where a pad waits whose finger was not seen yet, m, world: out of the way of everything."""
APART = 0.1
"""Between two that wait, m."""
PAD_DRAG = (0.05, 1e-5)
"""Viscosity that brings a pad to rest which no tracker holds, N s/m and N m s/rad."""


class Coupling(Protocol):
    """What a session needs of a coupling."""

    fingers: tuple[str, ...]
    """Names of the simulated fingers."""
    rows: tuple[int, ...]
    """The row of ``HandTargets`` that each of them follows."""
    waiting: frozenset[int]
    """Those of these rows that were not seen yet: their pads are not there yet."""

    @property
    def pads(self) -> list[Body]:
        """Pads that are bodies of their own."""

    @property
    def hands(self) -> list[Hand]:
        """Hands that were added."""

    @property
    def ends(self) -> FloatArray:
        """(fingers, 3) m, world: apex of each simulated pad's skin, which is drawn to ``HandTargets.pad_places``."""

    @property
    def release(self) -> Release:
        """What keeps the sides of a grip in balance while the hand lets go."""

    def follow(self, targets: HandTargets, rate: float = 1.0) -> None:
        """Aim at these targets in the next step. ``rate``: how much faster than simulated time the hand is shown."""


class TipCoupling(Restorable):
    """Pads that are free bodies on springs to the tracked tips. They weigh nothing for the person: their weight is taken off."""

    def __init__(
        self,
        world: World,
        targets: HandTargets,
        pad: Material,
        springs: Springs | None = None,
        expected: Collection[int] = (),
        *,
        max_force: float = MAX_FORCE,
    ) -> None:
        """Add a pad of the material ``pad`` to ``world`` for every finger of ``targets`` that was not lost, where it is now. Pads of the
        rows ``expected`` that are not seen wait aside, until they are. ``max_force``: most that a pad presses with, N, however far the
        tracked tip.

        Raises ``InvalidValueError`` if no finger is seen.
        """
        self.springs = springs or Springs()
        self.springs.check()
        self._max_pull = SPRING_SHARE * max_force, SPRING_SHARE * LEVER * max_force
        seen = [row for row in range(PALM) if targets.states[row] not in ("absent", "lost")]
        if not seen:
            raise InvalidValueError("targets", "at least one finger that was seen", "none", "wait until the tracker sees a finger")
        self.rows = tuple(sorted({*seen, *expected}))
        self.waiting = frozenset(self.rows) - set(seen)
        self.fingers = tuple(PARTS[row] for row in self.rows)
        self._dt = world.dt
        semi = HandModel.three_finger().pad_semi_axes
        self._depth = float(semi[2])
        surface, mass = (
            Surface.fingertip(semi, points=PAD_POINTS, control_points=PAD_CONTROL_POINTS),
            MassProperties.box(2.0 * semi, mass=PAD_MASS),
        )
        places, turns, _ = self._pads(targets)
        for row in self.waiting:
            places[row], turns[row] = ASIDE + row * np.array([APART, 0.0, 0.0]), (1.0, 0.0, 0.0, 0.0)
        self._bodies = [
            world.add_body(surface, pad, mass=mass, position=places[row], quaternion=turns[row], name=PARTS[row], viscosity=PAD_DRAG)
            for row in self.rows
        ]
        for body in self._bodies:
            body.apply_wrench(-PAD_MASS * world.gravity)
        self._offsets = [Offset((3, FASTEST[0]), (3, FASTEST[1])) for _ in self.rows]
        for row in self.waiting:
            self._offsets[self.rows.index(row)].weight = 0.0
        self.release = Release(len(self.rows), self._dt)

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
        facing = -minus_z(np.array([pad.quaternion for pad in self._bodies]))
        return np.array([pad.position for pad in self._bodies]) + self._depth * facing

    def _pads(self, targets: HandTargets) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Places (6, 3) m and quaternions (6, 4) of the pads' frames (x along the finger, z out of the pad), and lever arms from the tips
        (6, 3) m.
        """
        apex, facing = targets.pad_places()
        places = apex - self._depth * facing
        w, x, y, z = targets.quaternions.T  # times half a turn about x
        return places, np.array([-x, w, z, -y]).T, places - targets.positions

    def follow(self, targets: HandTargets, rate: float = 1.0) -> None:
        """Aim at these targets in the next step. ``rate``: how much faster than simulated time the hand is shown."""
        places, turns, arms = self._pads(targets)
        spin = rate * targets.angular_velocities
        speed = rate * targets.linear_velocities + cross(spin, arms)
        weights = targets.weights
        release, rows = self.release, list(self.rows)
        apex, facing = targets.pad_places()
        release.update(apex[rows], self.ends, facing[rows])
        places[rows] += release.shift
        speed[rows] += release.velocity
        (k, kr), (d, dr) = self.springs.stiffness, self.springs.damping
        for body, row, offset in zip(self._bodies, self.rows, self._offsets, strict=True):
            weight = float(weights[row])
            place, turn, v, omega = places[row], turns[row], speed[row], spin[row]
            if row in self.waiting:
                if weight == 0.0:
                    continue
                body.set_pose(place, turn)
                self.waiting -= {row}
            stretch = None
            if weight > offset.weight:
                stretch = np.concatenate([place - body.position, rotation_vector(quaternion_product(turn, conjugate(body.quaternion)))])
            offset.update(weight, stretch, self._dt)
            if not offset.zero:
                place, v = place + offset.value[:3], v + offset.velocity[:3]
                turn, omega = quaternion_product(quaternion_of_vector(offset.value[3:]), turn), omega + offset.velocity[3:]
            body.set_drive(
                place,
                turn,
                stiffness=(weight * k, weight * kr),
                damping=(weight * d, weight * dr),
                linear_velocity=v,
                angular_velocity=omega,
                max_pull=self._max_pull,
                max_speed=MAX_SPEED,
            )
