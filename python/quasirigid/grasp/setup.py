"""What a grasp begins with: an object that is ready to be grasped, on its support."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace

import numpy as np

from quasirigid._quasirigid import Body as RigidBody
from quasirigid._quasirigid import MassProperties, Material, Surface, World
from quasirigid.arrays.types import FloatArray
from quasirigid.errors import GraspPlanError, SurfaceWarning
from quasirigid.grasp.options import GraspOptions
from quasirigid.grasp.plan import plan_grasp, side_up_that_fits
from quasirigid.grasp.support import BOX_CONTROL_POINTS as CONTROL_POINTS_ON_TABLE
from quasirigid.grasp.support import Support, support_of
from quasirigid.objects import DEFAULT_POINTS, ObjectGeometry, load_object
from quasirigid.objects.orientation import rotation_of, suggestion

BOX_SIZE = (0.06, 0.06, 0.08)
BOX_POINTS, BOX_CONTROL_POINTS = 36_000, 4_800
POINTS_PER_CONTROL_POINT = 7.5
"""Of a surface for which no number of control points is given."""
BOX_MASS = 0.2
BOX_SQUEEZE = 4.0
GRAVITY = 9.81
LEAST_PLANNED = 0.2
"""Friction that a grasp is planned with at least: what is more slippery shall be seen to slip, not be refused."""


@dataclass(frozen=True, eq=False)
class GraspTarget:
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


def take_box(options: GraspOptions) -> GraspTarget:
    """The box of the paper's experiment, taken at its middle."""
    points = options.points or BOX_POINTS
    control = BOX_CONTROL_POINTS if options.points is None else None  # of a sampling that was asked for, as many as usual
    if options.support == "table" and points > CONTROL_POINTS_ON_TABLE * POINTS_PER_CONTROL_POINT:
        control = CONTROL_POINTS_ON_TABLE
    return GraspTarget(
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


def take_surface(name: str, surface: Surface, mass: MassProperties, options: GraspOptions, friction: float) -> GraspTarget:
    """Any object: a grasp is found for it. Raises ``GraspPlanError`` where the hand cannot take it."""
    planned = max(friction, LEAST_PLANNED)
    try:
        plan = plan_grasp(surface.points, surface.normals, mass.centre, friction=planned)
    except GraspPlanError as error:
        side = side_up_that_fits(surface.points, surface.normals, mass.centre, friction=planned)
        if side is None or options.object is None:
            raise
        way = suggestion(rotation_of(options.up, options.rotate), side)
        raise GraspPlanError(error.what, error.expected, error.got, f"it can be taken with another side up: {way}") from error
    notes = (f"the grasp was planned as if friction were {LEAST_PLANNED:g}, not {friction:.3g}",) if friction < LEAST_PLANNED else ()
    needed = mass.mass * GRAVITY / plan.weight_per_squeeze if plan.weight_per_squeeze > 0.0 else 0.0
    return GraspTarget(
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


def take_file(options: GraspOptions, friction: float, density: float) -> GraspTarget:
    """An object from a file, and a grasp found for it."""
    assert options.object is not None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SurfaceWarning)  # reported in the summary
        geometry: ObjectGeometry = load_object(
            options.object,
            scale=options.scale,
            size=options.size,
            points=options.points or DEFAULT_POINTS,
            density=None if options.mass else density,
            mass=options.mass,
            seed=options.seed,
            up=options.up,  # type: ignore[arg-type]  # checked by GraspOptions.check
            rotate=options.rotate,
        )
    with warnings.catch_warnings(record=True) as met:
        warnings.simplefilter("always", SurfaceWarning)
        surface = Surface.from_points(geometry.points, geometry.normals, geometry.areas)
    notes = geometry.warnings + tuple(str(warning.message) for warning in met)
    mass = MassProperties(geometry.mass, geometry.centre_of_mass, geometry.inertia)
    target = take_surface(geometry.name, surface, mass, options, friction)
    return replace(target, warnings=notes + target.warnings)


@dataclass(frozen=True, eq=False)
class Stage:
    """A world with an object that stands on its support; no hand yet."""

    world: World
    object: RigidBody
    support: RigidBody
    support_top: FloatArray
    """(3,) where the support's frame is, m."""
    start: FloatArray
    """(3,) where the object's frame is, m."""
    target: GraspTarget
    pad: Material
    """What the fingertips are to be made of."""
    friction: float
    """Of object against finger."""

    stands_on: Support
    """What ``support`` was made from."""

    @staticmethod
    def build(options: GraspOptions, target: GraspTarget | None = None, step_budget: float | None = None) -> Stage:
        """Arguments and errors as of ``Grasp``."""
        options.check()
        pad = Material.preset("fingertip_pulp").replace(compliance=options.compliance)
        material = Material.preset(options.material).replace(compliance=options.compliance)
        if options.friction is not None:
            pad, material = pad.replace(friction=options.friction), material.replace(friction=options.friction)
        friction = math.sqrt(pad.friction * material.friction)
        if target is None:
            target = take_box(options) if options.object is None else take_file(options, friction, material.density)
        world = World(dt=options.dt, gravity=(0.0, 0.0, -GRAVITY), threads=options.threads, step_budget=step_budget)
        stands_on = support_of(options.support, flat=target.flat)
        support = stands_on.add_to(world)
        start = np.array([0.0, 0.0, -target.lowest])
        body = world.add_body(target.surface, material, mass=target.mass, motion=options.object_motion, position=start, name=target.name)
        return Stage(world, body, support, support.position, start, target, pad, friction, stands_on)
