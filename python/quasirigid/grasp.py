"""The main job: a hand takes an object from a support, holds it, lifts it, shakes it, puts it down.

The phases are those of ``quasirigid.summary.PHASES``. The hand closes and squeezes on an object that stands on a support;
the squeeze is kept up while the support goes away, then the joint targets are frozen; from there on nothing but friction carries the object.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from quasirigid._quasirigid import Body as RigidBody
from quasirigid._quasirigid import Grip, Hand, HandModel, MassProperties, Material, Surface, World
from quasirigid.errors import InvalidValueError, SurfaceWarning
from quasirigid.grasp_columns import columns, contact_sums, still_columns, still_rows
from quasirigid.grasp_options import GraspOptions
from quasirigid.grasp_plan import plan_grasp
from quasirigid.objects import DEFAULT_POINTS, ObjectGeometry, load_object
from quasirigid.scene_recording import SceneRecorder
from quasirigid.summary import PHASES, FloatArray, conjugate, rotate
from quasirigid.view.world_scene import WorldScene

BOX_SIZE = (0.06, 0.06, 0.08)
BOX_POINTS, BOX_CONTROL_POINTS = 36_000, 4_800
BOX_MASS = 0.2
BOX_SQUEEZE = 4.0
FINGER_SPACING = 0.024
"""Distance of the two fingers' pads, along the hand's y, m."""
PAD_DEPTH = 0.085
"""How far below the palm the pads meet the object, m."""
OPENINGS = (0.012, 0.008, 0.005, 0.003)
"""Clearances (m) between a pad and the object before closing; the widest that the fingers reach is taken."""
PEDESTAL = (0.03, 0.03, 0.01)
TABLE = 0.4
SUPPORT_DROP = 0.08
LIFT = 0.05
SHAKE, SHAKE_FREQUENCY = 0.005, 3.0
DURATIONS = {"close": 2.0, "squeeze": 3.0, "support away": 1.6, "lift": 1.0, "shake": 1.5}
DURATIONS |= {"hold again": 1.5, "put down": 1.8, "release": 0.6, "fall": 0.3}
"""Seconds. The first hold is as long as asked for; closing and squeezing end sooner when the grip says so."""
CLOSING = {"close": "closing", "squeeze": "squeezing"}
"""Phases that last while the grip is in this state."""
STAND_GIVES = 1e-4
"""How far the stand of an object from a file yields under its weight, m."""
STANDS_AT = 0.05
"""Share of its weight that the fingers still carry when the object counts as put down."""
SINK = 0.002
"""How far below the place where it took the object the hand may go to put it down, m."""
DROPPED_AT = 0.03
"""Moved this far against the hand (m), the object is taken for dropped and the run ends with the phase ``fall``."""
LOST_FOR = 0.05
"""The same after as long without a touch, s."""
GRAVITY = 9.81
COARSE = 4e-3
"""Points further apart than this, m, do not tell the shape that a pad of 16 mm feels; half of it does."""
LEAST_PLANNED = 0.2
"""Friction that a grasp is planned with at least: what is more slippery shall be seen to slip, not be refused."""

Progress = Callable[[str, float], None]
"""Told now and then the phase and the share of the whole run that is done."""


@dataclass(frozen=True)
class Taken:
    """An object ready to be taken: its surface, where the hand goes, and how it stands. Object frame, m."""

    name: str
    surface: Surface
    mass: MassProperties
    lowest: float
    hand: FloatArray
    """(3, 3) hand frame to object frame."""
    centre: FloatArray
    """(3,) middle between the pads."""
    width: float
    approach: str
    squeeze: float
    warnings: tuple[str, ...] = ()
    flat: bool = False
    """Stands by itself on a small pedestal; whatever else is held by its stand until the fingers have it."""


def minimum_jerk(s: float) -> float:
    """0 to 1 without a jolt at either end, for s from 0 to 1."""
    s = min(max(s, 0.0), 1.0)
    return s * s * s * (10.0 + s * (6.0 * s - 15.0))


def quaternion_of(rotation: FloatArray) -> FloatArray:
    """(w, x, y, z) of a rotation matrix."""
    x, y, z, w = Rotation.from_matrix(rotation).as_quat()
    return np.array([w, x, y, z])


def take_box(options: GraspOptions) -> Taken:
    """The box of the paper's experiment, taken at its middle."""
    points = options.points or BOX_POINTS
    control = BOX_CONTROL_POINTS if options.points is None else None
    return Taken(
        name="box",
        surface=Surface.box(BOX_SIZE, points=points, control_points=control),
        mass=MassProperties.box(BOX_SIZE, mass=options.mass or BOX_MASS),
        lowest=-BOX_SIZE[2] / 2,
        hand=np.eye(3),
        centre=np.zeros(3),
        width=BOX_SIZE[0],
        approach="from above",
        squeeze=options.squeeze or BOX_SQUEEZE,
        flat=True,
    )


def take_surface(name: str, surface: Surface, mass: MassProperties, options: GraspOptions, friction: float) -> Taken:
    """Any object: a grasp is found for it. Raises ``GraspPlanError`` where the hand cannot take it."""
    plan = plan_grasp(surface.points, surface.normals, mass.centre, friction=max(friction, LEAST_PLANNED))
    notes = (f"the grasp was planned as if friction were {LEAST_PLANNED:g}, not {friction:.3g}",) if friction < LEAST_PLANNED else ()
    needed = mass.mass * GRAVITY / plan.weight_per_squeeze if plan.weight_per_squeeze > 0.0 else 0.0
    return Taken(
        name=name,
        surface=surface,
        mass=mass,
        lowest=float(surface.points[:, 2].min()),
        hand=np.asarray(plan.rotation),
        centre=np.asarray(plan.centre),
        width=plan.width,
        approach=plan.approach,
        squeeze=options.squeeze or max(BOX_SQUEEZE, 3.0 * needed),
        warnings=notes,
    )


def take_file(options: GraspOptions, friction: float, density: float) -> Taken:
    """An object from a file, and a grasp found for it."""
    assert options.object is not None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SurfaceWarning)  # reported in the summary
        thing: ObjectGeometry = load_object(
            options.object,
            scale=options.scale,
            size=options.size,
            points=options.points or DEFAULT_POINTS,
            density=None if options.mass else density,
            mass=options.mass,
            seed=options.seed,
        )
    surface = Surface.from_points(thing.points, thing.normals, thing.areas)
    mass = MassProperties(thing.mass, thing.centre_of_mass, thing.inertia)
    taken = take_surface(thing.name, surface, mass, options, friction)
    return replace(taken, warnings=thing.warnings + taken.warnings)


@dataclass(frozen=True)
class Stage:
    """A world with an object that stands on its support; no hand yet."""

    world: World
    object: RigidBody
    support: RigidBody
    support_top: FloatArray
    """(3,) where the support's frame is, m."""
    start: FloatArray
    """(3,) where the object's frame is, m."""
    taken: Taken
    pad: Material
    """What the fingertips are to be made of."""
    friction: float
    """Of object against finger."""

    @staticmethod
    def build(
        options: GraspOptions, taken: Taken | None = None, pedestal: tuple[float, float, float] = PEDESTAL, step_budget: float | None = None
    ) -> Stage:
        """Arguments and errors as of ``Grasp``."""
        options.check()
        pad = Material.preset("fingertip_pulp").replace(compliance=options.compliance)
        stuff = Material.preset(options.material).replace(compliance=options.compliance)
        if options.friction is not None:
            pad, stuff = pad.replace(friction=options.friction), stuff.replace(friction=options.friction)
        friction = math.sqrt(pad.friction * stuff.friction)
        if taken is None:
            taken = take_box(options) if options.object is None else take_file(options, friction, stuff.density)
        world = World(dt=options.dt, gravity=(0.0, 0.0, -GRAVITY), threads=options.threads, step_budget=step_budget)
        # A flat box stands on a small pedestal, whatever else on a table.
        flat = taken.flat
        surface = Surface.box(pedestal, points=2_000) if flat else Surface.half_space(TABLE, points=4_000)
        top = np.array([0.0, 0.0, -pedestal[2] / 2 if flat else 0.0])
        support = world.add_body(surface, Material.preset("rubber"), motion="fixed", position=top, name="support")
        start = np.array([0.0, 0.0, -taken.lowest])
        thing = world.add_body(taken.surface, stuff, mass=taken.mass, motion=options.object_motion, position=start, name=taken.name)
        return Stage(world, thing, support, top, start, taken, pad, friction)


class Grasp:
    """A world with a hand, an object and a support, and the script that moves them."""

    def __init__(
        self,
        options: GraspOptions,
        *,
        taken: Taken | None = None,
        pedestal: tuple[float, float, float] = PEDESTAL,
        step_budget: float | None = None,
    ) -> None:
        """Build the world. ``taken`` is the object if it is neither the box nor from a file, ``pedestal`` (m) what a flat one stands on;
        ``step_budget`` is that of ``World``. Raises the errors of ``quasirigid.errors`` for whatever cannot be built.
        """
        self.options = options
        stage = Stage.build(options, taken, pedestal, step_budget)
        self.friction, self.taken = stage.friction, stage.taken
        taken, start, pad = stage.taken, stage.start, stage.pad
        self.world, self.support, self.object, self._support_top = stage.world, stage.support, stage.object, stage.support_top
        self._stand = start
        self.hold_by_stand(1.0)
        # The palm sits PAD_DEPTH behind the middle between the pads, along the hand's own z axis.
        self.palm = start + self.taken.centre + PAD_DEPTH * self.taken.hand[:, 2]
        self.turn = quaternion_of(self.taken.hand)
        model = HandModel.three_finger()
        self._pad_semi_axes = model.pad_semi_axes
        self.hand = self.world.add_hand(model, position=self.palm, quaternion=self.turn, material=pad, motion=options.object_motion)
        self.grip = self._open_grip()
        self.fingers = tuple(self.hand.finger_names)
        self.scene = WorldScene(self.world, [self.object, self.support], [self.hand])
        self._thing = 0  # the object's place in the scene
        self._finger_of = {place: finger for finger, place in enumerate(self.scene.model.fingertips())}
        self._start_in_hand: FloatArray | None = None
        self._carried = 0.0
        self._stands = False
        self.paced = False
        """Whether steps keep to the clock, for whoever looks on."""
        self.phase = ""
        """What is going on: one of PHASES, once ``run`` has begun."""
        self._began = 0.0
        self._untouched = 0.0
        self.notes = list(taken.warnings)
        """What whoever reads the results should know."""
        if taken.surface.spacing > COARSE:
            wanted = math.ceil(taken.surface.area / (COARSE / 2) ** 2 / 100) * 100
            apart = f"the object's points are {1e3 * taken.surface.spacing:.2g} mm apart, too far to tell its shape under a fingertip"
            self.notes.append(f"{apart}: {wanted:,} or more would do")

    def _open_grip(self) -> Grip:
        """A grip with every pad clear of the object by as much as its finger can open."""
        sides = np.array([-1.0, 1.0, 1.0])
        across = np.array([0.0, FINGER_SPACING / 2, -FINGER_SPACING / 2])
        directions = np.outer(-sides, [1.0, 0.0, 0.0])
        error: InvalidValueError | None = None
        for clearance in OPENINGS:
            starts = np.column_stack([sides * (self.taken.width / 2 + clearance), across, np.full(3, -PAD_DEPTH)])
            try:
                return self.hand.grip(starts, directions, squeeze=self.taken.squeeze)
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
        done, told = 0.0, 0.0
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
                if progress is not None and now - told > 0.05:
                    told = now
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

        ``share`` 1 is a stand that gives STAND_GIVES (m) under the object's weight, 0 is none.
        """
        if self.taken.flat:
            return
        if share <= 0.0:
            self.object.clear_drive()
            return
        mass, length = self.taken.mass.mass, 0.05
        stiffness = share * mass * GRAVITY / STAND_GIVES
        damping = 2.0 * math.sqrt(stiffness * mass)
        both = (stiffness, stiffness * length**2), (damping, damping * length**2)
        self.object.set_drive(self._stand, (1.0, 0.0, 0.0, 0.0), stiffness=both[0], damping=both[1])

    def _tell_weakness(self) -> None:
        if self.grip.state == "weak":
            found = ", ".join(f"{name.replace('_', ' ')} {force:.3g}" for name, force in zip(self.fingers, self.grip.forces(), strict=True))
            limit = "a motor is at its limit, or a finger at the end of its reach"
            self.notes.append(f"the hand cannot squeeze with {self.taken.squeeze:.3g} N: it presses with {found} N, as {limit}")

    def _lower_support(self, s: float) -> None:
        """The support goes in the first half of the time; in the second half the object comes to rest in the fingers."""
        self.hold_by_stand(1.0 - minimum_jerk(4.0 * s))
        if s < 0.55:
            # The squeeze is kept up while the load moves from the support to the fingers; then it settles once more and the joint targets freeze.
            self.grip.squeeze = self.taken.squeeze
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
        self._stands |= s > 0.5 and self._carried < STANDS_AT * self.taken.mass.mass * GRAVITY
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
        if self.paced:
            # Time that was lost is not made up for.
            self._began = max(self._began, time.perf_counter() - self.world.time - self.options.dt)
            time.sleep(max(0.0, self._began + self.world.time - time.perf_counter()))
        state = self.scene.state(report, phase, moved=recorder.wants_deformation(self.world.time))
        sums = contact_sums(state.contacts, self._thing, self._finger_of, len(self.fingers))
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


def _pose(thing: RigidBody | Hand) -> FloatArray:
    return np.concatenate([thing.position, thing.quaternion])
