"""The main job: a hand takes an object from a support, holds it, lifts it, shakes it, puts it down.

The phases are those of ``quasirigid.grasp.summary.PHASES``. The hand closes and squeezes on an object that stands on a support;
the squeeze is kept up while the support goes away, then the joint targets are frozen; from there on nothing but friction carries the
object.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from quasirigid._quasirigid import Body as RigidBody
from quasirigid._quasirigid import Grip, Hand, HandModel
from quasirigid.arrays.types import FloatArray
from quasirigid.errors import InvalidValueError
from quasirigid.grasp.columns import columns, contact_sums, still_columns, still_rows
from quasirigid.grasp.options import GraspOptions
from quasirigid.grasp.setup import GRAVITY, GraspTarget, Stage
from quasirigid.grasp.summary import PHASES
from quasirigid.recording.scene_recorder import SceneRecorder
from quasirigid.rotation import conjugate, quaternion_of, rotate
from quasirigid.scene.built_in_hand import FINGER_SPACING
from quasirigid.scene.world import WorldScene

PAD_DEPTH = 0.085
"""How far below the palm the pads meet the object, m."""
OPENINGS = (0.012, 0.008, 0.005, 0.003)
"""Clearances (m) between a pad and the object before closing; the widest that the fingers reach is taken."""
SUPPORT_DROP = 0.08
LIFT = 0.05
SHAKE, SHAKE_FREQUENCY = 0.005, 3.0
DURATIONS = {"close": 2.0, "squeeze": 3.0, "support away": 1.6, "lift": 1.0, "shake": 1.5}
DURATIONS |= {"hold again": 1.5, "put down": 1.8, "release": 0.6, "fall": 0.3}
"""Seconds. The first hold is as long as asked for; closing and squeezing end sooner when the grip says so."""
CLOSING = {"close": "closing", "squeeze": "squeezing"}
"""Phases that last while the grip is in this state."""
STAND_SINKS = 1e-4
"""How far the stand of an object from a file sinks under its weight, m."""
STANDS_AT = 0.05
"""Share of its weight that the fingers still carry when the object counts as put down."""
SINK = 0.002
"""How far below the place where it took the object the hand may go to put it down, m."""
DROPPED_AT = 0.03
"""Moved this far against the hand (m), the object counts as dropped and the run ends with the phase ``fall``."""
LOST_FOR = 0.05
"""The same after as long without a touch, s."""
COARSE = 4e-3
"""Points further apart than this, m, do not show the shape that a pad of 16 mm feels; half of it does."""

Progress = Callable[[str, float], None]
"""Is called now and then with the phase and the share of the whole run that is done."""


def minimum_jerk(s: float) -> float:
    """0 to 1 without a jolt at either end, for s from 0 to 1."""
    s = min(max(s, 0.0), 1.0)
    return s * s * s * (10.0 + s * (6.0 * s - 15.0))


class Grasp:
    """A world with a hand, an object and a support, and the script that moves them."""

    def __init__(
        self,
        options: GraspOptions,
        *,
        target: GraspTarget | None = None,
        step_budget: float | None = None,
    ) -> None:
        """Build the world. ``target`` is the object if it is neither the box nor from a file; ``step_budget`` is that of ``World``.

        Raises the errors of ``quasirigid.errors`` for whatever cannot be built.
        """
        self.options = options
        stage = Stage.build(options, target, step_budget)
        self.friction, self.target = stage.friction, stage.target
        target, start, pad = stage.target, stage.start, stage.pad
        self.world, self.support, self.object, self._support_top = stage.world, stage.support, stage.object, stage.support_top
        self.stands_on = stage.stands_on
        self._stand = start
        self.hold_by_stand(1.0)
        # The palm sits PAD_DEPTH behind the middle between the pads, along the hand's own z axis.
        self.palm = start + self.target.centre + PAD_DEPTH * self.target.hand[:, 2]
        self.turn = quaternion_of(self.target.hand)
        model = HandModel.three_finger()
        self._pad_semi_axes = model.pad_semi_axes
        self.hand = self.world.add_hand(model, position=self.palm, quaternion=self.turn, material=pad, motion=options.object_motion)
        self.grip = self._open_grip()
        self.fingers = tuple(self.hand.finger_names)
        self.scene = WorldScene(self.world, [self.object, self.support], [self.hand])
        self._object_index = 0  # the object's place in the scene
        self._finger_of = {place: finger for finger, place in enumerate(self.scene.model.fingertips())}
        self._start_in_hand: FloatArray | None = None
        self._carried = 0.0
        self._stands = False
        self.real_time = False
        """Whether steps keep to the clock, for a page that shows the run."""
        self.phase = ""
        """What is going on: one of PHASES, once ``run`` has begun."""
        self._began = 0.0
        self._untouched = 0.0
        self.notes = list(target.warnings)
        """What whoever reads the results should know."""
        if target.surface.spacing > COARSE:
            wanted = math.ceil(target.surface.area / (COARSE / 2) ** 2 / 100) * 100
            sparse = f"the object's points are {1e3 * target.surface.spacing:.2g} mm apart, too far to tell its shape under a fingertip"
            self.notes.append(f"{sparse}: {wanted:,} or more would do")

    def _open_grip(self) -> Grip:
        """A grip with every pad clear of the object by as much as its finger can open."""
        sides = np.array([-1.0, 1.0, 1.0])
        across = np.array([0.0, FINGER_SPACING / 2, -FINGER_SPACING / 2])
        directions = np.outer(-sides, [1.0, 0.0, 0.0])
        error: InvalidValueError | None = None
        for clearance in OPENINGS:
            starts = np.column_stack([sides * (self.target.width / 2 + clearance), across, np.full(3, -PAD_DEPTH)])
            try:
                return self.hand.grip(starts, directions, squeeze=self.target.squeeze)
            except InvalidValueError as out_of_reach:
                error = out_of_reach
        assert error is not None
        raise error

    def run(self, recorder: SceneRecorder, progress: Progress | None = None) -> None:
        """Run all phases and record every step."""
        dt = self.options.dt
        script: list[tuple[str, float, Callable[[float], None]]] = [
            ("close", DURATIONS["close"], _nothing),
            ("squeeze", DURATIONS["squeeze"], _nothing),
            ("support away", DURATIONS["support away"], self._lower_support),
            ("hold", self.options.hold, _nothing),
            ("lift", DURATIONS["lift"], self._lift),
            ("shake", DURATIONS["shake"], self._shake),
            ("hold again", DURATIONS["hold again"], _nothing),
            ("put down", DURATIONS["put down"], self._put_down),
            ("release", DURATIONS["release"], _nothing),
        ]
        # Closing ends when the fingers touch, squeezing when the forces have settled: a quarter of the time allowed is a fair guess.
        total = sum(duration if name not in CLOSING else duration / 4 for name, duration, _ in script)
        done, reported = 0.0, 0.0
        for name, duration, move in script:
            steps = max(1, round(duration / dt))
            if name == "hold":
                self._tell_weakness()
                self.grip.hold()
            if name in ("support away", "hold"):
                self._start_in_hand = self._object_in_hand()
            if name == "release":
                self._start_in_hand = None
                self.grip.open()
            for k in range(steps):
                move((k + 1) / steps)
                self._step(name, recorder)
                now = time.monotonic()
                if progress is not None and now - reported > 0.05:
                    reported = now
                    progress(name, min(1.0, (done + (k + 1) * dt) / total))
                if name in CLOSING and self.grip.state != CLOSING[name]:
                    break
                if self._dropped():
                    self._fall(recorder)
                    return
            if name == "close" and self.grip.state in ("closing", "missed"):
                self._fall(recorder)  # closed on nothing
                return
            if name == "hold":
                recorder.still(still_rows(self.object, self.hand, self._pad_semi_axes, recorder.steps - 1))
            done += duration if name not in CLOSING else duration / 4
        if progress is not None:
            progress("release", 1.0)

    def recorder(self, path: Path, attributes: dict[str, Any]) -> SceneRecorder:
        """A recorder for ``run``, which writes to ``path``."""
        fingers, joints = len(self.fingers), self.hand.joint_positions.shape[1]
        sizes = len(self.object.deformed_points()), len(self.hand.deformed_points(0))
        own = columns(self.fingers, joints) + still_columns(self.fingers, joints, *sizes)
        return SceneRecorder(path, self.scene.model, (fingers, joints), columns=own, attributes=attributes)

    def _fall(self, recorder: SceneRecorder) -> None:
        for _ in range(round(DURATIONS["fall"] / self.options.dt)):
            self._step("fall", recorder)

    def hold_by_stand(self, share: float) -> None:
        """An object from a file need not stand by itself: until the fingers have it, the support holds it like a stand does.

        ``share`` 1 is a stand that sinks by STAND_SINKS (m) under the object's weight, 0 is none.
        """
        if self.target.flat:
            return
        if share <= 0.0:
            self.object.clear_drive()
            return
        mass, length = self.target.mass.mass, 0.05
        stiffness = share * mass * GRAVITY / STAND_SINKS
        damping = 2.0 * math.sqrt(stiffness * mass)
        both = (stiffness, stiffness * length**2), (damping, damping * length**2)
        self.object.set_drive(self._stand, (1.0, 0.0, 0.0, 0.0), stiffness=both[0], damping=both[1])

    def _tell_weakness(self) -> None:
        if self.grip.state == "weak":
            found = ", ".join(f"{name.replace('_', ' ')} {force:.3g}" for name, force in zip(self.fingers, self.grip.forces(), strict=True))
            limit = "a motor is at its limit, or a finger at the end of its reach"
            self.notes.append(f"the hand cannot squeeze with {self.target.squeeze:.3g} N: it presses with {found} N, as {limit}")

    def _lower_support(self, s: float) -> None:
        """The support goes in the first half of the time; in the second half the object comes to rest in the fingers."""
        self.hold_by_stand(1.0 - minimum_jerk(4.0 * s))
        if s < 0.55:
            # The squeeze is kept up while the load moves from the support to the fingers; then it settles once more and the joint targets
            # freeze.
            self.grip.squeeze = self.target.squeeze
        # Squared: it leaves the object slowly, so that the fingers take the load without a jolt.
        self.support.move_to(self._support_top - [0.0, 0.0, SUPPORT_DROP * minimum_jerk(2.0 * s) ** 2])

    def _lift(self, s: float) -> None:
        self.hand.move_to(self.palm + np.array([0.0, 0.0, LIFT * minimum_jerk(s)]), self.turn)

    def _shake(self, s: float) -> None:
        t = s * DURATIONS["shake"]
        swing = SHAKE * math.sin(2.0 * math.pi * SHAKE_FREQUENCY * t) * math.sin(math.pi * s) ** 2
        self.hand.move_to(self.palm + np.array([swing * math.sqrt(0.5), swing * math.sqrt(0.5), LIFT]), self.turn)

    def _put_down(self, s: float) -> None:
        """The support comes back in the first third, then the hand goes down until the support carries the object."""
        self.support.move_to(self._support_top - [0.0, 0.0, SUPPORT_DROP * (1.0 - minimum_jerk(3.0 * s))])
        self._stands |= s > 0.5 and self._carried < STANDS_AT * self.target.mass.mass * GRAVITY
        if not self._stands:
            self.hand.move_to(self.palm + np.array([0.0, 0.0, LIFT * (1.0 - minimum_jerk(1.5 * s - 0.5)) - SINK * s]), self.turn)

    def _object_in_hand(self) -> FloatArray:
        return rotate(conjugate(self.hand.quaternion), self.object.position - self.hand.position)

    def _dropped(self) -> bool:
        if self._start_in_hand is None:
            return False
        return self._untouched > LOST_FOR or bool(np.linalg.norm(self._object_in_hand() - self._start_in_hand) > DROPPED_AT)

    def _step(self, phase: str, recorder: SceneRecorder) -> None:
        self.phase = phase
        self.grip.update()
        report = self.world.step()
        if self.real_time:
            # Time that was lost is not made up for.
            self._began = max(self._began, time.perf_counter() - self.world.time - self.options.dt)
            time.sleep(max(0.0, self._began + self.world.time - time.perf_counter()))
        state = self.scene.state(report, phase, moved=recorder.wants_deformation(self.world.time))
        sums = contact_sums(state.contacts, self._object_index, self._finger_of, len(self.fingers))
        self._carried = float(sums["hand/force_on_object"][:, 2].sum())
        self._untouched = 0.0 if sums["hand/contacts"].any() else self._untouched + self.options.dt
        row: dict[str, Any] = {
            "phase": PHASES.index(phase),
            "object/pose": _pose(self.object),
            "object/velocity": np.concatenate([self.object.linear_velocity, self.object.angular_velocity]),
            "hand/pose": _pose(self.hand),
            "hand/joint_targets": self.hand.joint_targets,
            "hand/joint_torques": self.hand.joint_torques,
            **sums,
        }
        recorder.append(state, row, report)


def _nothing(_: float) -> None:
    """A phase in which only the grip acts."""


def _pose(body: RigidBody | Hand) -> FloatArray:
    return np.concatenate([body.position, body.quaternion])
