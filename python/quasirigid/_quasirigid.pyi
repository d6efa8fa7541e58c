"""The compiled engine.

Units are SI throughout: m, kg, s, N, Pa, rad. The world frame has z up. Quaternions are (w, x, y, z).
Arrays are NumPy ``float64`` unless said otherwise; every array handed out is a copy that you own, and every array
handed in may be anything that ``numpy.asarray`` understands. ``(n, 3)`` is a shape.

Errors come from ``quasirigid.errors`` and say what was expected, what came and what to do:
``InvalidValueError`` (NaN, infinity, wrong sign or range), ``InvalidShapeError``, ``DegenerateSurfaceError``,
``UnknownNameError`` and ``InvalidHandleError`` (a body that was removed). Nothing is raised while a step runs:
a step reports through ``StepReport``.
"""

from typing import ClassVar, Literal, final

import numpy as np
import numpy.typing as npt

from quasirigid.solver import ContactProblem

__version__: str
STAGES: tuple[str, str, str, str, str]
"""Names of the five stages of a step, in order:
``free_motion, collision, contact_problem, gauss_seidel, constrained_motion``."""

Motion = Literal["inertial", "quasi-static", "fixed"]
Compliance = Literal["local", "half-space"]
FloatArray = npt.NDArray[np.float64]

@final
class Surface:
    """A point-sampled surface: points with outward normals, in the frame of its body.

    Control points are the places that carry contact forces and elastic displacements; there are fewer of them than
    points. Where ``control_points`` is ``None`` the engine takes one control point for about 7.5 points.
    """

    @staticmethod
    def box(size: npt.ArrayLike, *, points: int, control_points: int | None = None) -> Surface:
        """A box of ``size`` (3,) m, centred on the origin."""
    @staticmethod
    def sphere(radius: float, *, points: int, control_points: int | None = None) -> Surface:
        """A sphere of ``radius`` m about the origin."""
    @staticmethod
    def capsule(radius: float, length: float, *, points: int, control_points: int | None = None) -> Surface:
        """A capsule about z: ``length`` m is the cylindrical part, without the caps."""
    @staticmethod
    def cylinder(radius: float, length: float, *, points: int, control_points: int | None = None) -> Surface:
        """A cylinder about z, ``length`` m from cap to cap, centred on the origin."""
    @staticmethod
    def half_space(side: float, *, points: int, control_points: int | None = None) -> Surface:
        """A square patch of ``side`` m in the plane z = 0, outward normal +z: a floor or a table."""
    @staticmethod
    def fingertip(semi_axes: npt.ArrayLike, *, points: int = 2400, control_points: int | None = 320) -> Surface:
        """The pad of a fingertip: the +z part of an ellipsoid of ``semi_axes`` (3,) m."""
    @staticmethod
    def from_points(
        points: npt.ArrayLike,
        normals: npt.ArrayLike | None = None,
        areas: npt.ArrayLike | None = None,
        *,
        control_points: int | None = None,
    ) -> Surface:
        """A surface from ``points`` (n, 3) m.

        ``normals`` (n, 3) point outward and need not have unit length; without them they are estimated and oriented
        consistently. ``areas`` (n,) m^2 are what each point stands for; without them they are estimated.

        Raises ``InvalidShapeError``, ``InvalidValueError`` (NaN, infinity, zero normal, area <= 0) or
        ``DegenerateSurfaceError`` (too few points, all on one line or in one place).
        """
    @property
    def points(self) -> FloatArray:
        """(n, 3) m, body frame."""
    @property
    def normals(self) -> FloatArray:
        """(n, 3) unit outward normals, body frame."""
    @property
    def areas(self) -> FloatArray:
        """(n,) m^2; the sum is ``area``."""
    @property
    def control_points(self) -> FloatArray:
        """(m, 3) m, body frame."""
    @property
    def control_areas(self) -> FloatArray:
        """(m,) m^2; the sum is ``area``."""
    @property
    def area(self) -> float:
        """Total area, m^2."""
    @property
    def spacing(self) -> float:
        """Mean distance of neighbouring points, ``sqrt(area / n)``, m."""
    def __len__(self) -> int:
        """Number of points."""

@final
class MassProperties:
    """Mass, centre of mass and inertia of a rigid body."""

    def __init__(self, mass: float, centre: npt.ArrayLike, inertia: npt.ArrayLike) -> None:
        """``mass`` kg, ``centre`` (3,) m in the body frame, ``inertia`` (3, 3) kg m^2 about the centre in body axes.

        Raises ``InvalidValueError`` for a mass or an inertia that no body can have.
        """
    @staticmethod
    def box(size: npt.ArrayLike, *, mass: float | None = None, density: float | None = None) -> MassProperties:
        """A solid box of ``size`` (3,) m. Give ``mass`` (kg) or ``density`` (kg/m^3), not both."""
    @staticmethod
    def sphere(radius: float, *, mass: float | None = None, density: float | None = None) -> MassProperties:
        """A solid sphere of ``radius`` m."""
    @staticmethod
    def capsule(radius: float, length: float, *, mass: float | None = None, density: float | None = None) -> MassProperties:
        """A solid capsule about z; ``length`` m is the cylindrical part."""
    @staticmethod
    def cylinder(radius: float, length: float, *, mass: float | None = None, density: float | None = None) -> MassProperties:
        """A solid cylinder about z, ``length`` m from cap to cap."""
    @property
    def mass(self) -> float:
        """kg."""
    @property
    def centre(self) -> FloatArray:
        """Centre of mass, (3,) m, body frame."""
    @property
    def inertia(self) -> FloatArray:
        """(3, 3) kg m^2 about the centre of mass, body axes."""
    def scaled_to_mass(self, mass: float) -> MassProperties:
        """The same body, made of a denser or lighter stuff, so that it weighs ``mass`` kg."""

@final
class Material:
    """What a surface is made of. Immutable; ``replace`` gives a changed copy."""

    @staticmethod
    def preset(name: str) -> Material:
        """A named material with figures from the literature. Raises ``UnknownNameError``, which lists the names."""
    @staticmethod
    def preset_names() -> list[str]:
        """The names that ``preset`` knows."""
    def replace(
        self,
        *,
        name: str | None = None,
        density: float | None = None,
        friction: float | None = None,
        young_modulus: float | None = None,
        poisson_ratio: float | None = None,
        layer_thickness: float | None = None,
        relaxation_time: float | None = None,
        compliance: Compliance | None = None,
    ) -> Material:
        """A copy with the fields given changed. Raises ``InvalidValueError`` for a figure no material has."""
    @property
    def name(self) -> str: ...
    @property
    def density(self) -> float:
        """kg/m^3."""
    @property
    def friction(self) -> float:
        """Coulomb coefficient against itself. A pair of materials has the geometric mean of the two."""
    @property
    def young_modulus(self) -> float:
        """Pa."""
    @property
    def poisson_ratio(self) -> float:
        """Without unit, in (-1, 0.5)."""
    @property
    def layer_thickness(self) -> float:
        """Thickness of the soft layer, m (used by the local compliance)."""
    @property
    def relaxation_time(self) -> float:
        """Viscoelastic time constant of the surface, s."""
    @property
    def compliance(self) -> Compliance:
        """``"local"`` (Gaussian, Le Garrec et al. 2006) or ``"half-space"`` (Boussinesq and Cerruti)."""

@final
class HandModel:
    """The constant part of a hand: fingers, joints, limits, gains."""

    @staticmethod
    def three_finger() -> HandModel:
        """The built-in hand: a thumb (finger 0) and two fingers that oppose it, 4 joints each
        (abduction, proximal, middle, distal). Hand frame: origin in the palm, fingers along -z, closing along x.
        """
    @property
    def name(self) -> str: ...
    @property
    def finger_names(self) -> list[str]: ...
    @property
    def joint_names(self) -> list[str]:
        """Names of the joints of one finger, from the palm outwards."""
    @property
    def lower_limits(self) -> FloatArray:
        """(fingers, joints) rad."""
    @property
    def upper_limits(self) -> FloatArray:
        """(fingers, joints) rad."""
    @property
    def pad_semi_axes(self) -> FloatArray:
        """Semi-axes of the pads' ellipsoid: along the finger, across it, out of the pad, (3,) m."""

@final
class Body:
    """A rigid body in a world. Made by ``World.add_body``; raises ``InvalidHandleError`` once it was removed."""

    @property
    def name(self) -> str: ...
    @property
    def index(self) -> int:
        """The number that ``Contacts.body_a`` and ``Contacts.body_b`` speak of; it may change when a body is removed."""
    @property
    def mass(self) -> float:
        """kg; 0 for a fixed body."""
    @property
    def position(self) -> FloatArray:
        """Origin of the body frame, (3,) m, world."""
    @property
    def quaternion(self) -> FloatArray:
        """Body frame to world, (4,) (w, x, y, z)."""
    @property
    def centre_of_mass(self) -> FloatArray:
        """(3,) m, world."""
    @property
    def linear_velocity(self) -> FloatArray:
        """Of the centre of mass, (3,) m/s, world."""
    @property
    def angular_velocity(self) -> FloatArray:
        """(3,) rad/s, world axes."""
    def set_velocity(self, linear: npt.ArrayLike, angular: npt.ArrayLike = (0.0, 0.0, 0.0)) -> None:
        """Throw the body: ``linear`` (3,) m/s of the centre of mass and ``angular`` (3,) rad/s, world axes."""
    def apply_wrench(self, force: npt.ArrayLike, torque: npt.ArrayLike = (0.0, 0.0, 0.0)) -> None:
        """``force`` (3,) N at the centre of mass and ``torque`` (3,) N m, world axes; held until changed."""
    def move_to(self, position: npt.ArrayLike, quaternion: npt.ArrayLike | None = None) -> None:
        """Move a fixed body to this pose during the next step, dragging along what sticks to it.

        ``position`` (3,) m, ``quaternion`` (4,) (w, x, y, z), unchanged if left out.
        Raises ``InvalidHandleError`` for a body that is not fixed.
        """
    def set_drive(
        self,
        position: npt.ArrayLike,
        quaternion: npt.ArrayLike | None = None,
        *,
        stiffness: tuple[float, float],
        damping: tuple[float, float],
        linear_velocity: npt.ArrayLike = (0.0, 0.0, 0.0),
        angular_velocity: npt.ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        """Pull the body to a pose by a damped spring, taken implicitly: any stiffness is stable.

        ``stiffness`` (N/m, N m/rad), ``damping`` (N s/m, N m s/rad).
        """
    def clear_drive(self) -> None:
        """Let go of the spring of ``set_drive``."""
    def deformed_points(self) -> FloatArray:
        """Points of the surface as deformed now, (n, 3) m, world."""

    def deformed_normals(self) -> FloatArray:
        """Outward unit normals of the deformed points, (n, 3), world. Computed when asked for: a step does not need them."""
    def displacements(self) -> FloatArray:
        """Elastic displacement ``u`` at the control points, (m, 3) m, body frame."""

@final
class Hand:
    """An articulated hand in a world. Made by ``World.add_hand``."""

    @property
    def name(self) -> str: ...
    @property
    def position(self) -> FloatArray:
        """Origin of the hand frame (palm), (3,) m, world."""
    @property
    def quaternion(self) -> FloatArray:
        """Hand frame to world, (4,) (w, x, y, z)."""
    def move_to(self, position: npt.ArrayLike, quaternion: npt.ArrayLike | None = None) -> None:
        """Move the base to this pose during the next step: ``position`` (3,) m, ``quaternion`` (4,) (w, x, y, z)."""
    @property
    def finger_count(self) -> int: ...
    @property
    def finger_names(self) -> list[str]: ...
    @property
    def body_indices(self) -> list[int]:
        """One per finger: the numbers that ``Contacts.body_a`` and ``Contacts.body_b`` speak of."""
    @property
    def joint_positions(self) -> FloatArray:
        """(fingers, joints) rad. Settable: teleports the joints, at rest."""
    @joint_positions.setter
    def joint_positions(self, value: npt.ArrayLike) -> None: ...
    @property
    def joint_velocities(self) -> FloatArray:
        """(fingers, joints) rad/s."""
    @property
    def joint_targets(self) -> FloatArray:
        """What the joint position controllers aim at, (fingers, joints) rad. Settable."""
    @joint_targets.setter
    def joint_targets(self, value: npt.ArrayLike) -> None: ...
    @property
    def joint_torques(self) -> FloatArray:
        """Motor torques of the last step, (fingers, joints) N m."""
    def tip_poses(self) -> tuple[FloatArray, FloatArray]:
        """Middle of each pad's undeformed surface, +z out of the pad: positions (fingers, 3) m and quaternions (fingers, 4), world."""
    @property
    def link_poses(self) -> FloatArray:
        """Frames of the links, (fingers, joints, 7): origin x y z on the joint's axis (m, world) and quaternion (w, x, y, z),
        link frame to world. A straight finger hangs along -z of these frames, palmar side towards +x.
        """
    def inverse_kinematics(self, finger: int, position: npt.ArrayLike, normal: npt.ArrayLike) -> FloatArray:
        """Joint positions (joints,) rad that bring the pad's apex of ``finger`` to ``position`` (3,) m with the pad facing
        ``normal`` (3,), both in the hand frame. Raises ``InvalidValueError`` where the finger cannot reach.
        """
    def deformed_points(self, finger: int) -> FloatArray:
        """Points of the fingertip as deformed now, (n, 3) m, world."""

    def deformed_normals(self, finger: int) -> FloatArray:
        """Outward unit normals of the deformed points of a fingertip, (n, 3), world."""
    def displacements(self, finger: int) -> FloatArray:
        """Elastic displacement ``u`` at the control points of the fingertip, (m, 3) m, frame of its link."""
    def grip(
        self,
        starts: npt.ArrayLike,
        directions: npt.ArrayLike,
        *,
        squeeze: float = 4.0,
        shares: npt.ArrayLike | None = None,
    ) -> Grip:
        """A controller that closes this hand; its joints are put at once where the pads start.

        ``starts`` (fingers, 3) m: where the middle of each pad's surface begins; ``directions`` (fingers, 3): which way it
        closes and faces; both in the hand frame. ``squeeze`` N is what a pad with a share of 1 presses with;
        ``shares`` (fingers,) are by default 1 over the number of pads that close the same way, so that a thumb presses
        with the whole squeeze and two fingers that oppose it with half of it each.

        Raises ``InvalidValueError`` for a start that a finger cannot reach.
        """

GripState = Literal["closing", "squeezing", "holding", "opening", "open", "missed"]

@final
class Grip:
    """Closes a hand on whatever is between its fingers. Made by ``Hand.grip``."""

    @property
    def state(self) -> GripState:
        """``"closing"`` until all pads touch, ``"squeezing"`` until every force has settled, then ``"holding"``: the joint
        targets are frozen. ``"missed"`` after 60 mm of travel without a touch; ``"opening"`` and ``"open"`` on the way back.
        """
    @property
    def squeeze(self) -> float:
        """The force asked for, N. Settable; a held object is then squeezed anew."""
    @squeeze.setter
    def squeeze(self, value: float) -> None: ...
    def forces(self) -> FloatArray:
        """Force of each pad along its closing direction in the last step, (fingers,) N."""
    def update(self) -> None:
        """Set the joint targets for the next step. Call once before every ``World.step()``."""
    def hold(self) -> None:
        """Freeze the joint targets: from here on friction alone holds the object."""
    def open(self) -> None:
        """Let go: the pads travel back to where they started."""
    def close(self) -> None:
        """Close again."""

@final
class ContactStatus:
    """Values of ``Contacts.status``."""

    Open: ClassVar[int]
    """0: within the margin, no force."""
    Stick: ClassVar[int]
    """1: inside the friction cone, no slip."""
    Slip: ClassVar[int]
    """2: on the friction cone."""

@final
class Contacts:
    """The contacts of the last step as a struct of arrays; row i of every array is contact i. ``n = len(contacts)``."""

    @property
    def points(self) -> FloatArray:
        """(n, 3) m, world: the control point, where the reaction acts, at the start of the step."""
    @property
    def normals(self) -> FloatArray:
        """(n, 3) unit, world, from body b to body a: a positive normal force pushes body a along it."""
    @property
    def frames(self) -> FloatArray:
        """(n, 3, 3) world; columns are (normal, tangent1, tangent2)."""
    @property
    def gaps(self) -> FloatArray:
        """(n,) m after the step; > 0 is apart."""
    @property
    def reactions(self) -> FloatArray:
        """(n, 3) N in the contact frame (normal, tangent1, tangent2)."""
    @property
    def forces(self) -> FloatArray:
        """(n, 3) N, world, on body a; body b gets the opposite."""
    @property
    def areas(self) -> FloatArray:
        """(n,) m^2 of the control point."""
    @property
    def pressures(self) -> FloatArray:
        """(n,) Pa, normal force over area."""
    @property
    def friction(self) -> FloatArray:
        """(n,) Coulomb coefficient of the pair."""
    @property
    def status(self) -> npt.NDArray[np.uint8]:
        """(n,) values of ``ContactStatus``."""
    @property
    def body_a(self) -> npt.NDArray[np.uint32]:
        """(n,) index of the body whose control point it is."""
    @property
    def body_b(self) -> npt.NDArray[np.uint32]:
        """(n,) index of the other body."""
    @property
    def control_point(self) -> npt.NDArray[np.uint32]:
        """(n,) index of the control point on the surface of body a."""
    def __len__(self) -> int: ...

@final
class StepReport:
    """What a step did, and how well."""

    @property
    def time(self) -> float:
        """Simulated time at the end of the step, s."""
    @property
    def contacts(self) -> int:
        """Contacts in the problem, open ones included."""
    @property
    def sweeps(self) -> int:
        """Gauss-Seidel sweeps."""
    @property
    def residual(self) -> float:
        """Natural-map residual of the reactions, without unit."""
    @property
    def converged(self) -> bool: ...
    @property
    def stop_reason(self) -> Literal["converged", "sweep-cap", "time-budget", "non-finite"]: ...
    @property
    def stage_times(self) -> dict[str, float]:
        """Seconds per stage, keyed by ``STAGES``."""
    @property
    def part_times(self) -> dict[str, float]:
        """Seconds of parts of stages: ``traverse`` and ``interpenetration`` of collision, ``w_rigid`` and ``w_deform`` of
        the contact problem, ``hierarchy_update`` of the constrained motion.
        """
    @property
    def step_time(self) -> float:
        """Seconds for the whole step."""
    @property
    def coarse(self) -> bool:
        """True if the traversal budget ran out, so that collision stopped at a coarser level of the sphere trees."""
    @property
    def ill_posed(self) -> int:
        """Contacts left out because nothing can move or give there."""
    @property
    def quarantined(self) -> list[int]:
        """Indices of bodies that went non-finite, were rolled back and isolated in this step."""
    def __repr__(self) -> str: ...

@final
class ContactSolution:
    """Reactions and velocities of a contact problem, and how good they are. What ``solve_contacts`` returns."""

    @property
    def reactions(self) -> FloatArray:
        """(3n,), ``r``: (normal, tangent1, tangent2) of each contact in turn, in the friction cones."""
    @property
    def velocities(self) -> FloatArray:
        """(3n,), ``u = W r + q``."""
    @property
    def status(self) -> npt.NDArray[np.uint8]:
        """(n,), a ``ContactStatus`` each."""
    @property
    def residual(self) -> float:
        """The natural map with De Saxce's shift and rho = 1 over all contacts, divided by the largest of |q|, |r|, |u|."""
    @property
    def unit_free_residual(self) -> float:
        """The natural map with rho the stiffness of each contact, divided by |r|: the same in all units. ``StepReport.residual`` is of this kind."""
    @property
    def sweeps(self) -> int:
        """Gauss-Seidel sweeps, Newton steps counted as one each."""
    @property
    def newton_steps(self) -> int:
        """How many of the sweeps were Newton steps."""
    @property
    def converged(self) -> bool: ...
    @property
    def stop_reason(self) -> Literal["converged", "sweep-cap", "time-budget", "non-finite"]: ...
    @property
    def asymmetry(self) -> float:
        """Largest entry of ``W - W^T`` over the largest of ``W``."""
    @property
    def time(self) -> float:
        """Seconds that the call took."""
    def __len__(self) -> int:
        """Number of contacts."""
    def __repr__(self) -> str: ...

def _solve_contacts(
    W: object,
    q: npt.ArrayLike,
    mu: npt.ArrayLike,
    tolerance: float,
    max_sweeps: int,
    time_budget: float | None,
    warm_start: npt.ArrayLike | None,
    /,
) -> ContactSolution: ...

@final
class World:
    """Bodies, hands and time. The state changes in ``step`` and nowhere else, but for what you set yourself."""

    def __init__(
        self,
        dt: float = 1e-3,
        gravity: npt.ArrayLike = (0.0, 0.0, -9.81),
        *,
        threads: int = 1,
        tolerance: float = 1e-8,
        max_sweeps: int = 1000,
        time_budget: float | None = None,
        traversal_budget: int | None = None,
        contact_margin: float | None = None,
        collision_every: int = 1,
    ) -> None:
        """An empty world.

        ``dt`` time step, s. ``gravity`` (3,) m/s^2. ``threads`` changes the speed, never the result.
        ``tolerance`` residual at which Gauss-Seidel stops, without unit; ``max_sweeps`` its cap; ``time_budget`` seconds
        after which it stops wherever it is (``None``: never). ``traversal_budget`` most pairs of spheres that collision
        looks at in a step (``None``: all). ``contact_margin`` m: contacts up to this gap enter the problem
        (``None``: chosen from the sampling). ``collision_every`` looks at the surfaces only in every so many-th step, and carries the contacts along
        with the bodies in between: cheaper in motion, off by ``d**2 / (2 R)`` after a move ``d`` on a radius ``R``.
        """
    @property
    def dt(self) -> float:
        """s."""
    @property
    def gravity(self) -> FloatArray:
        """(3,) m/s^2."""
    @property
    def time(self) -> float:
        """Simulated seconds since the start."""
    @property
    def steps(self) -> int: ...
    def add_body(
        self,
        surface: Surface,
        material: Material,
        *,
        mass: MassProperties | float | None = None,
        motion: Motion = "inertial",
        position: npt.ArrayLike = (0.0, 0.0, 0.0),
        quaternion: npt.ArrayLike = (1.0, 0.0, 0.0, 0.0),
        name: str | None = None,
        viscosity: tuple[float, float] | None = None,
    ) -> Body:
        """Add a rigid body and return its handle.

        ``mass``: its mass properties, or kg with the inertia of the surface's bounding box; needed unless ``fixed``.
        ``motion``: ``"inertial"``, ``"quasi-static"`` (no inertia: velocity = force / viscosity) or ``"fixed"``.
        ``viscosity`` (N s/m, N m s/rad): ``None`` is none for inertial bodies, and for quasi-static ones that of a time
        constant of 0.05 s.
        """
    def add_hand(
        self,
        model: HandModel | None = None,
        *,
        position: npt.ArrayLike = (0.0, 0.0, 0.0),
        quaternion: npt.ArrayLike = (1.0, 0.0, 0.0, 0.0),
        material: Material | None = None,
        motion: Literal["inertial", "quasi-static"] = "inertial",
        points: int = 2400,
        control_points: int = 320,
    ) -> Hand:
        """Add a hand and return its handle. ``None``: the built-in three-finger hand with pads of ``fingertip_pulp``.
        ``points`` and ``control_points`` are per fingertip.
        """
    def remove(self, handle: Body | Hand) -> None:
        """Take a body or a hand out of the world; its handle is invalid from then on."""
    def step(self, n: int = 1) -> StepReport:
        """Advance by ``n`` steps of ``dt`` and return the report of the last. The GIL is released meanwhile."""
    def contacts(self) -> Contacts:
        """The contacts of the last step."""
    def contact_problem(self, *, sparse: bool = False) -> ContactProblem:
        """The contact problem of the last step, with the reactions found; ``W`` dense, or ``sparse`` as a SciPy ``bsr_array``.

        In displacements over the step: ``W`` m/N, ``q`` m, reactions N. ``problem.save("step.npz")`` keeps it.
        """
    def state_hash(self) -> int:
        """64-bit hash of the whole state: same input, same bits, whatever the number of threads."""
