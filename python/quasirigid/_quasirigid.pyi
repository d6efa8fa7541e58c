"""The compiled engine.

Units are SI throughout: m, kg, s, N, Pa, rad. The world frame has z up. Quaternions are (w, x, y, z).
Arrays are NumPy ``float64`` unless said otherwise; every array handed out is a copy, and every array
handed in may be anything that ``numpy.asarray`` understands. ``(n, 3)`` is a shape. The copy is yours, but for
properties that are state (all of ``Body``, ``Hand`` and ``World``) or part of a small value (``MassProperties``, ``Friction``,
``HandModel``, ``Calibration``): those are read-only, for nothing would come of a change. Writing into one raises ``InvalidValueError``,
which says what to do instead; ``.copy()`` is yours. ``hand.joint_targets += 0.1`` works, for it assigns.

``Surface``, ``MassProperties``, ``ComplianceMatrix``, ``Friction``, ``Material``, ``HandModel``, ``Calibration``, ``HandFrame`` and
``Take`` are values: they never change, are equal if their contents are, can be keys, copied and pickled (a surface is built again, to the
same bits). Two ``Body`` or ``Hand`` objects of one body or hand are equal, and are the same key.

After ``os.fork`` (``multiprocessing`` with its default on Linux up to Python 3.13) all of this works in the child, worlds of the parent
too. What works through a thread of the parent (``Receiver``, ``Replay``, ``TakeWriter``), or was in use by one at the fork, raises
``ForkError`` there.

Errors come from ``quasirigid.errors`` and say what was expected, what came and what to do:
``InvalidValueError`` (NaN, infinity, wrong sign or range), ``InvalidShapeError``, ``DegenerateSurfaceError``,
``UnknownNameError``, ``InvalidHandleError`` (a body that was removed) and ``ForkError``. Nothing is raised while a step runs:
a step reports through ``StepReport``.
"""

from collections.abc import Sequence
from os import PathLike
from typing import Any, ClassVar, Literal, final

import numpy as np
import numpy.typing as npt

from quasirigid.solver import ContactProblem

__version__: str
STAGES: tuple[str, str, str, str, str]
"""Names of the five stages of a step, in order:
``free_motion, collision, contact_problem, gauss_seidel, constrained_motion``."""

Motion = Literal["inertial", "quasi-static", "fixed"]
Compliance = Literal["local", "layer", "half-space", "gaussian"]
FrictionRule = Literal["geometric-mean", "minimum", "maximum", "mean", "product"]
FloatArray = npt.NDArray[np.float64]

@final
class Surface:
    """A point-sampled surface: points with outward normals, in the frame of its body.

    Building one can be ended with Ctrl-C, and more points than fit in memory are refused before any is made.

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

        The cloud is checked first, see docs/objects.md. Stray points are left out unless ``areas`` are given, so that
        ``len(surface)`` may be less than n; normals without a common side are oriented, and those of a closed surface
        that point in are turned outward; noise is smoothed. Each is said by a ``SurfaceWarning``.

        Raises ``InvalidShapeError``, ``InvalidValueError`` (NaN, infinity, zero normal, area <= 0; normals that stand
        across the surface, as colours do; more points than fit in memory) or ``DegenerateSurfaceError`` (too few points,
        all on one line or in one place). Ctrl-C ends it with ``KeyboardInterrupt``.
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
    def control_normals(self) -> FloatArray:
        """(m, 3) unit outward normals at the control points, body frame."""
    @property
    def control_areas(self) -> FloatArray:
        """(m,) m^2, what each stands for; the sum is ``area``."""
    @property
    def area(self) -> float:
        """Total area, m^2."""
    @property
    def spacing(self) -> float:
        """Mean distance of neighbouring points, ``sqrt(area / n)``, m."""
    @property
    def unresolved(self) -> int:
        """How many points lie on faces too narrow for how they are sampled: contact there may be missed.

        A ``SurfaceWarning`` says so when the surface is built, and what would help.
        """
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
        """The same body, made of a denser or lighter material, so that it weighs ``mass`` kg."""

@final
class ComplianceMatrix:
    """A compliance of your own over the control points of one surface: a finite-element model condensed to its surface, say.

    Give it to ``Material.replace(compliance=...)``. A material with it is good for that surface only.
    """

    def __init__(self, matrix: npt.ArrayLike) -> None:
        """``matrix`` (3m, 3m) m/N: displacement of every control point under a unit force at each. Row and column ``3 i + k`` are axis
        ``k`` (x, y, z of the body frame) of ``Surface.control_points[i]``.

        It must be symmetric (within 1e-8 of its largest entry; the symmetric part is kept) and positive semidefinite (no eigenvalue below
        -1e-9 of that entry); to check takes about two seconds for 1,000 control points, and milliseconds for 100. Raises
        ``InvalidShapeError`` or ``InvalidValueError``, which say what was found.
        """
    @property
    def matrix(self) -> FloatArray:
        """(3m, 3m) m/N, as it is used."""
    @property
    def asymmetry(self) -> float:
        """Largest difference between an entry and its mirror image that was found, over the largest entry."""
    def __len__(self) -> int:
        """Number of control points ``m``."""

@final
class Friction:
    """Coulomb friction and what goes beyond it. Immutable.

    A contact sticks up to ``static`` times its normal force. While it slips with speed v its coefficient is
    ``kinetic + (static - kinetic) * exp(-(v / stribeck_velocity)**2)``, and a viscous traction ``viscous * v`` comes on top.
    With a ``direction`` these coefficients hold along it, and are ``ratio`` times as large across it: the friction circle
    becomes an ellipse. ``Friction(0.5)`` is Coulomb's law.

    >>> import quasirigid as qr
    >>> qr.Friction(0.5) == qr.Friction(0.5, 0.5), qr.Friction(0.5) in {qr.Friction(0.5): "rubber on rubber"}
    (True, True)
    """

    def __init__(
        self,
        static: float,
        kinetic: float | None = None,
        *,
        stribeck_velocity: float = 1e-3,
        viscous: float = 0.0,
        direction: npt.ArrayLike | None = None,
        ratio: float | None = None,
    ) -> None:
        """``static`` and ``kinetic`` (the same, if left out) have no unit; ``stribeck_velocity`` m/s; ``viscous`` Pa s/m.

        ``direction`` (3,), of any length, is in the frame of the surface's points (of a finger: of its last link), and goes
        with ``ratio`` from 0.01 to 100. Where it is normal to the surface, every tangent is across it.

        Raises ``InvalidValueError`` for what no friction is: a negative or non-finite number, ``kinetic`` above ``static``.
        """
    @property
    def static(self) -> float: ...
    @property
    def kinetic(self) -> float: ...
    @property
    def stribeck_velocity(self) -> float:
        """m/s."""
    @property
    def viscous(self) -> float:
        """Pa s/m: traction per slip speed."""
    @property
    def direction(self) -> FloatArray | None:
        """(3,) unit, frame of the surface's points; ``None`` if friction is the same in all directions."""
    @property
    def ratio(self) -> float:
        """Coefficients across ``direction`` over those along it."""
    def coefficient(self, speed: float) -> float:
        """The coefficient along ``direction`` at a slip speed (m/s), without the viscous part."""

@final
class Material:
    """What a surface is made of. Immutable; ``replace`` gives a changed copy."""

    @staticmethod
    def preset(name: str, *, version: str | None = None) -> Material:
        """A named material with figures from the literature; ``version="0.1"``: with the figures that this version had.

        Raises ``UnknownNameError``, which lists the names.

        >>> Material.preset("silicone", version="0.1").young_modulus
        151000.0
        """
    @staticmethod
    def preset_names() -> list[str]:
        """The names that ``preset`` knows."""
    def replace(
        self,
        *,
        name: str | None = None,
        density: float | None = None,
        friction: float | Friction | None = None,
        young_modulus: float | None = None,
        poisson_ratio: float | None = None,
        layer_thickness: float | None = None,
        relaxation_time: float | None = None,
        compliance: Compliance | ComplianceMatrix | npt.ArrayLike | None = None,
    ) -> Material:
        """A copy with the fields given changed. Raises ``InvalidValueError`` for a figure no material has.

        ``compliance`` is ``"layer"`` (an elastic layer bonded to a rigid backing, Poisson's ratio at most 0.499), ``"local"`` (the same
        without what couples normal and tangential displacements: nearly as right, and fast), ``"half-space"`` (E and nu alone),
        ``"gaussian"`` (the paper's, which version 0.1 called local), or a matrix of your own for one surface: see ``ComplianceMatrix``.
        Young's modulus, Poisson's ratio and layer thickness have no effect on a matrix.

        >>> gel = Material.preset("silicone").replace(young_modulus=0.435e6, layer_thickness=4e-3, compliance="layer")
        """
    @property
    def name(self) -> str: ...
    @property
    def density(self) -> float:
        """kg/m^3."""
    @property
    def friction(self) -> float:
        """Static friction coefficient against itself. ``World.friction_rule`` makes that of a pair from the two."""
    @property
    def friction_law(self) -> Friction:
        """Friction against itself, all of it."""
    @property
    def young_modulus(self) -> float:
        """Pa."""
    @property
    def poisson_ratio(self) -> float:
        """Without unit, in (-1, 0.5)."""
    @property
    def layer_thickness(self) -> float:
        """Thickness of the soft layer, m (not used by the half-space and by matrices)."""
    @property
    def relaxation_time(self) -> float:
        """Viscoelastic time constant of the surface, s."""
    @property
    def compliance(self) -> Literal["local", "layer", "half-space", "gaussian", "matrix"]:
        """``"layer"`` (bonded to a rigid backing), ``"local"`` (the same without its coupling), ``"half-space"`` (Boussinesq and Cerruti),
        ``"gaussian"`` (Le Garrec et al. 2006) or ``"matrix"`` (your own).
        """
    @property
    def compliance_matrix(self) -> ComplianceMatrix | None:
        """The matrix, where ``compliance`` is ``"matrix"``."""

@final
class HandModel:
    """The constant part of a hand: fingers, joints, limits, gains."""

    @staticmethod
    def three_finger() -> HandModel:
        """The built-in hand: a thumb (finger 0) and two fingers that oppose it, 4 joints each
        (abduction, proximal, middle, distal). Hand frame: origin in the palm, fingers along -z, closing along x.
        """
    @staticmethod
    def three_finger_link_radii() -> tuple[float, float, float]:
        """Radii of the proximal, middle and distal phalanx of the built-in hand, m: of their inertia, and of what is drawn."""
    def with_gains(self, stiffness: float, damping: float) -> HandModel:
        """The same hand with the stiffness and the damping of all position controllers multiplied by these factors.

        Raises ``InvalidValueError`` for a factor that is negative or not finite.
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
    def knuckles(self) -> FloatArray:
        """Where the first joint of each finger is, hand frame, (fingers, 3) m."""
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
    def quarantined(self) -> bool:
        """Whether it was set aside because it went non-finite, or would have moved by more than 100 m in a step: it neither
        moves nor touches any more.
        """
    @property
    def mass(self) -> float:
        """kg; 0 for a fixed body."""
    @property
    def colliders(self) -> list[Collider]:
        """The surfaces that it carries, in the order in which they were added. That of ``World.add_body`` is the first; ``surface``,
        ``material``, ``deformed_points``, ``deformed_normals``, ``moved_points`` and ``displacements`` are those of the first.
        """
    @property
    def surface(self) -> Surface | None:
        """The surface at rest, body frame."""
    @property
    def material(self) -> Material | None:
        """What the surface is made of. Settable: holds from the next step on, what is elastically displaced stays so."""
    @material.setter
    def material(self, value: Material) -> None: ...
    def set_mass(self, mass: MassProperties | float) -> None:
        """Another mass, as in ``World.add_body``; pose and velocities stay. Raises ``InvalidValueError`` for a fixed body."""
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
    def set_pose(self, position: npt.ArrayLike, quaternion: npt.ArrayLike | None = None) -> None:
        """Put the body elsewhere at once, without friction on the way: ``position`` (3,) m, ``quaternion`` (4,), unchanged if left out. A
        free body keeps its velocities, a fixed one is at rest.
        """
    def set_drive(
        self,
        position: npt.ArrayLike,
        quaternion: npt.ArrayLike | None = None,
        *,
        stiffness: npt.ArrayLike,
        damping: npt.ArrayLike,
        linear_velocity: npt.ArrayLike = (0.0, 0.0, 0.0),
        angular_velocity: npt.ArrayLike = (0.0, 0.0, 0.0),
        max_pull: npt.ArrayLike | None = None,
        max_speed: npt.ArrayLike | None = None,
    ) -> None:
        """Pull the body to a pose by a damped spring, integrated implicitly: any stiffness is stable.

        ``stiffness`` (2,): N/m, N m/rad; ``damping`` (2,): N s/m, N m s/rad. ``max_pull`` (2,): N, N m, most that it pulls with, however
        far the target; ``max_speed`` (2,): m/s, rad/s, most speed that it draws with a body that nothing else moves (where the damping is
        too little for that it is raised). Without a limit where left out. Raises ``InvalidValueError`` for a limit that is not above 0.
        """
    def clear_drive(self) -> None:
        """Let go of the spring of ``set_drive``."""
    def deformed_points(self) -> FloatArray:
        """Points of the surface as deformed now, (n, 3) m, world."""

    def deformed_normals(self) -> FloatArray:
        """Outward unit normals of the deformed points, (n, 3), world. Computed when asked for: a step does not need them."""
    def moved_points(self) -> tuple[npt.NDArray[np.uint32], FloatArray]:
        """The points of the surface that are displaced: their indices (k,) and where they are, (k, 3) m, body frame."""
    def displacements(self) -> FloatArray:
        """Elastic displacement ``u`` at the control points, (m, 3) m, body frame."""

@final
class Collider:
    """A surface on a link of a body: what touches. Made by ``World.add_body``, ``World.add_hand`` and ``World.add_collider``; raises
    ``InvalidHandleError`` once it, or its body, was removed.

    Two colliders of one body never touch each other, nor do two that are fixed, nor fingers of one hand. Others may if each of them meets a
    group of the other, ``a.mask & b.group and b.mask & a.group``, and the pair is not excluded (``World.exclude``). By default everything
    meets everything.
    """

    @property
    def id(self) -> int:
        """The number that ``Contacts.collider_a`` and ``Contacts.collider_b`` speak of. It stays the same for as long as the collider is
        there; later it may be that of another.
        """
    @property
    def body(self) -> Body | Hand:
        """What carries it."""
    @property
    def finger(self) -> int | None:
        """Which finger of the hand carries it; ``None`` on a body."""
    @property
    def link(self) -> int:
        """Link of the body, or of the finger, that it is fixed to, from 0; 0 for a rigid body."""
    @property
    def surface(self) -> Surface:
        """The surface at rest, frame of the link."""
    @property
    def material(self) -> Material:
        """What it is made of. Settable: holds from the next step on, what is elastically displaced stays so."""
    @material.setter
    def material(self, value: Material) -> None: ...
    @property
    def group(self) -> int:
        """The groups that it belongs to, one for each bit of 32. Settable: where it may no longer touch what it is in contact with, the
        contact ends with the next step, and what is elastically displaced relaxes.
        """
    @group.setter
    def group(self, value: int) -> None: ...
    @property
    def mask(self) -> int:
        """The groups that it meets, one for each bit of 32. Settable, as ``group``."""
    @mask.setter
    def mask(self, value: int) -> None: ...
    def deformed_points(self) -> FloatArray:
        """Points of the surface as deformed now, (n, 3) m, world."""
    def moved_points(self) -> tuple[npt.NDArray[np.uint32], FloatArray]:
        """The points of the surface that are displaced: their indices (k,) and where they are, (k, 3) m, frame of the link."""
    def displacements(self) -> FloatArray:
        """Elastic displacement ``u`` at the control points, (m, 3) m, frame of the link."""
    def remove(self) -> None:
        """Take it off its body, with what touched it; the handle is invalid from then on. The body stays, and no other contact changes."""

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
    def quarantined(self) -> bool:
        """Whether any of its fingers was set aside, see ``Body.quarantined``."""
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
    def blocked_forces(self, joint_targets: npt.ArrayLike) -> FloatArray:
        """Force with which the middle of each pad would press on something that holds it where it is now, if its controllers had the
        targets ``joint_targets`` (fingers, joints) rad: (fingers, 3) N, world. Without damping, weight and torque limits.
        """
    def inverse_kinematics(self, finger: int, position: npt.ArrayLike, normal: npt.ArrayLike) -> FloatArray:
        """Joint positions (joints,) rad that bring the pad's apex of ``finger`` to ``position`` (3,) m with the pad facing
        ``normal`` (3,), both in the hand frame. Raises ``InvalidValueError`` where the finger cannot reach.
        """
    def reach(
        self,
        finger: int,
        position: npt.ArrayLike,
        normal: npt.ArrayLike,
        *,
        start: npt.ArrayLike | None = None,
        angle_weight: float = 0.005,
        iterations: int = 20,
    ) -> tuple[FloatArray, float]:
        """As near as the finger comes to a goal of ``inverse_kinematics``, within the joint limits: joint positions (joints,) rad, and by
        how much the pad's apex misses ``position``, m. For a goal that moves from step to step: a few steps from ``start`` (joints,) rad,
        by default the joint targets, and no search elsewhere. ``angle_weight`` m/rad says how much a wrong direction counts against a wrong
        place.
        """
    def reach_all(
        self,
        positions: npt.ArrayLike,
        normals: npt.ArrayLike,
        start: npt.ArrayLike,
        *,
        angle_weight: float = 0.005,
        iterations: int = 20,
        step_tolerance: float = 1e-12,
    ) -> tuple[FloatArray, FloatArray]:
        """``reach`` for all fingers at once: ``positions`` (fingers, 3) m and ``normals`` (fingers, 3), hand frame, ``start`` (fingers,
        joints) rad. Joint positions (fingers, joints) rad, and by how much they miss (fingers,) m. A search ends when no joint moves by
        more than ``step_tolerance`` (rad) any more.
        """
    def deformed_points(self, finger: int) -> FloatArray:
        """Points of the fingertip as deformed now, (n, 3) m, world."""

    def deformed_normals(self, finger: int) -> FloatArray:
        """Outward unit normals of the deformed points of a fingertip, (n, 3), world."""
    def moved_points(self, finger: int) -> tuple[npt.NDArray[np.uint32], FloatArray]:
        """The displaced points of a fingertip: their indices (k,) and where they are, (k, 3) m, frame of its last link."""
    def colliders(self, finger: int) -> list[Collider]:
        """The surfaces that a finger carries, in the order in which they were added; its pad is the first."""
    def surface(self, finger: int) -> Surface | None:
        """A fingertip at rest, frame of its last link."""
    @property
    def material(self) -> Material | None:
        """What the fingertips are made of. Settable: holds from the next step on."""
    @material.setter
    def material(self, value: Material) -> None: ...
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

GripState = Literal["closing", "squeezing", "holding", "weak", "opening", "open", "missed"]

@final
class Grip:
    """Closes a hand on whatever is between its fingers. Made by ``Hand.grip``."""

    @property
    def state(self) -> GripState:
        """``"closing"`` until all pads touch, ``"squeezing"`` until every force has settled, then ``"holding"``: the joint
        targets are frozen. ``"weak"`` is holding with less than was asked for: a motor is at its limit, or a finger at the
        end of its reach. ``"missed"`` after 60 mm of travel without a touch; ``"opening"`` and ``"open"`` on the way back.
        """
    @property
    def squeeze(self) -> float:
        """The force asked for, N. Settable; a held object is then squeezed again."""
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
        """Close again; pads that have missed start again from the start of their paths."""
    def restore(self, earlier: Grip) -> None:
        """Go on from the state of ``earlier``, a ``copy.copy`` of this grip: with ``World.restore``, to take a grasp back to that time.

            before, grip_before = world.snapshot(), copy.copy(grip)
            ...
            world.restore(before)
            grip.restore(grip_before)

        A copy that goes on by itself: ``copy.deepcopy((world, grip))``, both in one call, and the new grip closes the hand of the new
        world. Grips are pickled together with their world.

        Raises ``InvalidHandleError`` for a grip of another hand.
        """

@final
class ContactStatus:
    """Values of ``Contacts.status``."""

    Open: ClassVar[int]
    """Open, 0: within the margin, no force."""
    Stick: ClassVar[int]
    """Stick, 1: inside the friction cone, no slip."""
    Slip: ClassVar[int]
    """Slip, 2: on the friction cone."""

@final
class Contacts:
    """The contacts of the last step as a struct of arrays; row i of every array is contact i. ``n = len(contacts)``."""

    @property
    def points(self) -> FloatArray:
        """(n, 3) m, world: the control point, where the reaction acts, at the start of the step."""
    @property
    def normals(self) -> FloatArray:
        """(n, 3) world: unit normal from body b to body a; a positive normal force pushes body a along it."""
    @property
    def frames(self) -> FloatArray:
        """(n, 3, 3) world: columns are (normal, tangent1, tangent2)."""
    @property
    def forces(self) -> FloatArray:
        """(n, 3) N, world: on body a; body b gets the opposite."""
    @property
    def reactions(self) -> FloatArray:
        """(n, 3) N, contact frame: normal, tangent1, tangent2."""
    @property
    def gaps(self) -> FloatArray:
        """(n,) m, contact frame: after the step; > 0 is apart."""
    @property
    def pressures(self) -> FloatArray:
        """(n,) Pa: normal force over area."""
    @property
    def areas(self) -> FloatArray:
        """(n,) m^2: of the control point."""
    @property
    def friction(self) -> FloatArray:
        """(n,) friction coefficient, along tangent1. Falls with slip speed if the pair's kinetic coefficient is lower."""
    @property
    def friction_ratio(self) -> FloatArray:
        """(n,) friction coefficient along tangent2 over that along tangent1: 1 unless friction has a direction."""
    @property
    def status(self) -> npt.NDArray[np.uint8]:
        """(n,) 0 open, 1 stick, 2 slip, as ``ContactStatus``."""
    @property
    def body_a(self) -> npt.NDArray[np.uint32]:
        """(n,) index of a body: the body whose control point it is."""
    @property
    def link_a(self) -> npt.NDArray[np.uint32]:
        """(n,) link of body a that carries the control point, from 0; 0 for a rigid body."""
    @property
    def collider_a(self) -> npt.NDArray[np.uint32]:
        """(n,) ``Collider.id``: the surface whose control point it is; unlike ``body_a`` it does not change when a body is removed."""
    @property
    def control_point(self) -> npt.NDArray[np.uint32]:
        """(n,) which control point of the surface of collider a it is."""
    @property
    def body_b(self) -> npt.NDArray[np.uint32]:
        """(n,) index of a body: the other body."""
    @property
    def link_b(self) -> npt.NDArray[np.uint32]:
        """(n,) link of body b."""
    @property
    def collider_b(self) -> npt.NDArray[np.uint32]:
        """(n,) ``Collider.id``: the other surface."""
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
        """Gauss-Seidel sweeps, Newton steps counted as one each."""
    @property
    def newton_steps(self) -> int:
        """How many of the sweeps were Newton steps, each of which takes the time of 10 to 20; 0 for soft grasps."""
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
        the contact problem, ``hierarchy_update`` of the constrained motion and, where spheres are refitted, of collision.
        """
    @property
    def step_time(self) -> float:
        """Seconds for the whole step."""
    @property
    def budget_exhausted(self) -> bool:
        """True if the traversal budget ran out, so that collision stopped at a coarser level of the sphere trees."""
    @property
    def coarse(self) -> bool:
        """The old name of ``budget_exhausted``, which goes with the next release: a ``DeprecationWarning`` says so."""
    @property
    def indentation(self) -> float:
        """Largest indentation of any patch over the thickness of its layer, without unit, in any step of this ``World.step``. Compliances
        are those of small strains: beyond 0.5 they are not to be trusted. ``World.indentations`` has those of every patch.
        """
    @property
    def ill_posed(self) -> int:
        """Contacts left out because nothing can move or deform there."""
    @property
    def quarantined(self) -> list[int]:
        """Indices of bodies that went non-finite, were rolled back and quarantined in this step,
        or in any step of this ``World.step``. Reported once;
        ``World.quarantined``, ``Body.quarantined`` and ``Hand.quarantined`` go on saying so.
        """
    @property
    def penetrated(self) -> list[tuple[int, int]]:
        """Pairs of indices of bodies that have penetrated each other by half or more, or lie one inside the other, in this step or in any
        step of this ``World.step``. They are pushed apart the shortest way at ``push_out_speed``; of equal ways, as for bodies with one
        centre, the first in a fixed order is chosen.
        """
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
        """The natural map with rho the stiffness of each contact, divided by |r|: the same in all units.
        ``StepReport.residual`` is of this kind.
        """
    @property
    def sweeps(self) -> int:
        """Gauss-Seidel sweeps, Newton steps counted as one each."""
    @property
    def newton_steps(self) -> int:
        """How many of the sweeps were Newton steps."""
    @property
    def converged(self) -> bool: ...
    @property
    def stop_reason(self) -> Literal["converged", "sweep-cap", "stagnated", "time-budget", "non-finite"]:
        """``sweep-cap``: ``max_sweeps`` were done. ``stagnated``: sweeps were left, but nothing made the reactions better; there is
        no solution, or rounding is in the way.
        """
    @property
    def asymmetry(self) -> float:
        """Largest entry of ``W - W^T`` over the largest of ``W``."""
    @property
    def time(self) -> float:
        """Seconds that the call took."""
    def __len__(self) -> int:
        """Number of contacts."""
    def __repr__(self) -> str: ...

def _screen_cloud(
    points: npt.ArrayLike, normals: npt.ArrayLike | None = None, /
) -> tuple[npt.NDArray[np.uint32], FloatArray | None, list[str]]: ...
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
        push_out_speed: float | None = None,
        friction_rule: FrictionRule = "geometric-mean",
        step_budget: float | None = None,
    ) -> None:
        """An empty world.

        ``dt`` time step, s. ``gravity`` (3,) m/s^2. ``threads`` changes the speed, never the result.
        ``tolerance`` residual at which Gauss-Seidel stops, without unit; ``max_sweeps`` its cap; ``time_budget`` seconds
        after which it stops wherever it is (``None``: never). ``traversal_budget`` most pairs of spheres that collision
        considers in a step (``None``: all). ``contact_margin`` m: contacts up to this gap enter the problem
        (``None``: chosen from the sampling). ``collision_every`` searches the surfaces only in every so many-th step, and carries the
        contacts along with the bodies in between: cheaper in motion, off by ``d**2 / (2 R)`` after a move ``d`` on a radius ``R``.
        ``push_out_speed`` m/s: how fast bodies that were put into each other come apart
        (``None``: 0.02; ``inf``: within a step, with the velocity that this takes). ``friction_rule`` makes the friction of a
        pair from that of its two materials; ``set_friction`` goes before it.
        ``step_budget`` s: see the property of that name.
        """
    @property
    def step_budget(self) -> float | None:
        """Time that a step may take, s; settable. ``None``: none. For loops that must keep up with the clock: ``0.8 * dt``.

        The solver gets what the other stages leave of it, a quarter at least. Where that is not enough it stops at the best that it has,
        the step's report says ``time-budget``, and the next step goes on from there. Results then depend on the machine; ``max_sweeps`` is
        a limit that is the same everywhere.
        """
    @step_budget.setter
    def step_budget(self, value: float | None) -> None: ...
    @property
    def dt(self) -> float:
        """s."""
    @property
    def gravity(self) -> FloatArray:
        """(3,) m/s^2. Settable: holds from the next step on."""
    @gravity.setter
    def gravity(self, value: npt.ArrayLike) -> None: ...
    @property
    def bodies(self) -> list[Body]:
        """The rigid bodies, in the order in which contacts count them."""
    @property
    def hands(self) -> list[Hand]:
        """The hands, in the order in which they were added."""
    @property
    def friction_rule(self) -> FrictionRule: ...
    @property
    def time(self) -> float:
        """Simulated seconds since the start."""
    @property
    def steps(self) -> int: ...
    @property
    def report(self) -> StepReport | None:
        """What ``step`` returned last; ``None`` before the first step."""
    @property
    def quarantined(self) -> list[int]:
        """Indices (``Body.index``, ``Hand.body_indices``) of the bodies that went non-finite and have been set aside since."""
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
        viscosity: npt.ArrayLike | None = None,
    ) -> Body:
        """Add a rigid body and return its handle.

        ``mass``: its mass properties, or kg with the inertia of the surface's bounding box; needed unless ``fixed``.
        ``motion``: ``"inertial"``, ``"quasi-static"`` (no inertia: velocity = force / viscosity) or ``"fixed"``.
        ``viscosity`` (2,), N s/m and N m s/rad: ``None`` is none for inertial bodies, and for quasi-static ones that of a time
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
    def add_collider(
        self,
        body: Body | Hand,
        surface: Surface,
        material: Material,
        *,
        link: int = 0,
        finger: int | None = None,
        group: int = 1,
        mask: int = 0xFFFFFFFF,
    ) -> Collider:
        """Fix another surface (frame of the link) to a body, or to a link of a finger of a hand, and return its handle. Mass and inertia
        stay.

        ``link``: from 0; a rigid body has one, a finger one for each joint, the last with the pad. ``finger``: of a hand.
        ``group`` and ``mask``: what it may touch, see ``Collider``.

        Raises ``InvalidValueError`` for a link that the body does not have, and ``InvalidHandleError`` for a body that was removed, or a
        hand without ``finger``. Views and recordings show the first collider of a body only, and the contacts of all.

        >>> world = World()
        >>> body = world.add_body(Surface.sphere(0.01, points=400), Material.preset("rubber"), mass=0.1)
        >>> nose = world.add_collider(body, Surface.sphere(0.002, points=200), Material.preset("steel"), group=2)
        >>> len(body.colliders), nose.body == body, nose.link, nose.group
        (2, True, 0, 2)
        """
    @property
    def colliders(self) -> list[Collider]:
        """Handles of all surfaces, in the order in which they were added."""
    def exclude(self, a: Collider | Body | Hand, b: Collider | Body | Hand) -> None:
        """From the next step on ``a`` and ``b`` never touch, whatever their groups say. A body or a hand stands for the colliders that it
        has now. What is in contact ends as with ``Collider.group``. Raises ``InvalidValueError`` for one collider twice.
        """
    def include(self, a: Collider | Body | Hand, b: Collider | Body | Hand) -> None:
        """Take back ``exclude``."""
    def remove(self, handle: Body | Hand | Collider) -> None:
        """Take a body, a hand or a collider out of the world, with what touched it; its handle is invalid from then on. Contacts between
        others stay as they are.
        """
    def set_friction(self, a: Material | Body | Hand | str, b: Material | Body | Hand | str, friction: float | Friction | None) -> None:
        """Say what friction is between ``a`` and ``b``, instead of combining it from two materials, from the next step on.

        A material, or its name, stands for all bodies of that name, also those added later; a hand for its fingers. A name must be
        one of ``Material.preset_names()``, or of the material of a body in this world or of a pair set before: give the ``Material``
        itself where its bodies come later. What is
        said of two bodies goes before what is said of a body and a material, and that before two materials; of equals the
        last one set holds. ``None`` takes back what was said of this pair. A direction of friction lies in the frame of
        ``a`` (of the body added first, if both are one material).

        Raises ``InvalidHandleError`` for a body that was removed or is of another world, and ``UnknownNameError`` for another name.
        """
    def step(self, n: int = 1) -> StepReport:
        """Advance by ``n`` >= 1 steps of ``dt``. The GIL is released meanwhile. Raises ``InvalidValueError`` for 0 and less.

        The report is that of the last step, with what must not be missed of the others: every body in ``quarantined``, every pair
        in ``penetrated``, the sum of ``ill_posed``, whether any has ``budget_exhausted``, and ``residual``, ``converged`` and
        ``stop_reason`` of the worst.
        """
    def contacts(self) -> Contacts:
        """The contacts of the last step."""
    def indentations(self) -> list[tuple[Collider, Collider, float, float]]:
        """How deep the surfaces of every pair of colliders that touch are pressed in at most, over the thickness of their layers: the two
        colliders, and the figures of both, without unit. 0 where a compliance knows no thickness (half-space, matrix). Beyond 0.5, small
        strains are not to be trusted.

        >>> for pad, thing, of_pad, of_thing in world.indentations():
        ...     print(pad.body, of_pad)
        """
    def contact_problem(self, *, sparse: bool = False) -> ContactProblem:
        """The contact problem of the last step, with the reactions found; ``W`` dense, or ``sparse`` as a SciPy ``bsr_array``.

        In displacements over the step: ``W`` m/N, ``q`` m, reactions N. ``problem.save("step.npz")`` keeps it. Always plain
        Coulomb: where friction has a direction tangent2 is stretched by ``Contacts.friction_ratio``, and viscous drag is in ``q``.
        """
    def state_hash(self) -> int:
        """64-bit hash of all that decides the future: worlds with the same hash go on with the same bits, whatever the number of threads.
        Copies hash alike. Numbers of threads, measured times and scratch are not in it. 0.3 ms for a held box, and once some milliseconds
        for every new surface.
        """
    def snapshot(self) -> Snapshot:
        """The whole state as it is now, to come back to and to branch from."""
    def restore(self, snapshot: Snapshot) -> None:
        """Take this world back to ``snapshot``, of this world or of another. Steps from here give the same bits as they did from there.

        Handles of bodies and hands that were there at the time name them again, those of later ones raise ``InvalidHandleError``. The
        number of threads stays that of this world. What is beside the world is taken back by itself: ``Grip.restore``, and ``restore`` of a
        coupling.
        """
    @staticmethod
    def from_snapshot(snapshot: Snapshot) -> World:
        """A new world in the state of ``snapshot``, independent of the one that it is of; ``copy.copy(world)`` does both
        steps. Surfaces are shared.
        """
    def body(self, handle: Body) -> Body:
        """In a copy of a world: its own handle of the body that ``handle`` names in the original. Raises
        ``InvalidHandleError`` if there is none here.
        """
    def hand(self, handle: Hand) -> Hand:
        """In a copy of a world: its own handle of the hand that ``handle`` names in the original. Raises
        ``InvalidHandleError`` if there is none here.
        """
    def collider(self, handle: Collider) -> Collider:
        """In a copy of a world: its own handle of the collider that ``handle`` names in the original. Raises
        ``InvalidHandleError`` if there is none here.
        """

@final
class Snapshot:
    """The state of a world at one time. Never changes; can be restored any number of times, compared, hashed and pickled.

    In it: bodies with velocities, drives, targets and loads, elastic displacements, what pairs of bodies remember of their contact,
    friction, parameters, the caches of the search, and contacts, forces and report of the last step. Not in it: what is beside a world (a
    ``Grip`` and couplings have a ``restore`` of their own), and memory that is written before it is read. Surfaces are shared with the
    world.

        >>> held = world.snapshot()
        >>> for squeeze in (2.0, 4.0):
        ...     world.restore(held)
        ...     world.step(100)
    """

    @property
    def time(self) -> float:
        """Simulated time at which it was taken, s."""
    @property
    def steps(self) -> int:
        """Steps that the world had taken."""
    @property
    def nbytes(self) -> int:
        """About how much memory it takes, without the surfaces."""
    def to_bytes(self) -> bytes:
        """As bytes, to be kept or sent: pickle does the same. Surfaces are in them, once each (65 bytes a point)."""
    @staticmethod
    def from_bytes(data: bytes) -> Snapshot:
        """Read what ``to_bytes`` has written. The bytes may come from anywhere: all of them is checked, nothing in them is executed.

        Surfaces are built anew, which takes as long as it took at first. Raises ``SnapshotError`` for bytes that are damaged, or of another
        version of quasirigid.
        """
    def __hash__(self) -> int: ...

# --- motion capture -------------------------------------------------------------------------------------------------------
# `quasirigid.mocap` has these under the same names. Rows of hand arrays: thumb, index, middle, ring, little, palm.

HandSide = Literal["left", "right"]

@final
class Packet:
    """One datagram of a tracker: one frame."""

    @staticmethod
    def parse(data: bytes, arrival: float = 0.0) -> Packet:
        """Read a datagram of DTrack. Raises ``PacketError`` with line and reason."""
    @property
    def frame(self) -> int:
        """The tracker's frame counter."""
    @property
    def time(self) -> float | None:
        """Seconds on the tracker's clock (Unix time of DTRACK3, else seconds since midnight UTC); ``None`` if it sends none."""
    @property
    def arrival(self) -> float:
        """Seconds on the clock of the receiver or of the take."""
    @property
    def data(self) -> bytes:
        """The datagram as it came."""
    @property
    def sender(self) -> tuple[str, int] | None:
        """Address and port it came from; ``None`` for one from a file."""
    @property
    def order(self) -> Literal["new", "late", "duplicate", "restart"] | None:
        """Where it stands among those before it; ``None`` for one from a file."""
    @property
    def bodies(self) -> dict[int, tuple[float, float, float]]:
        """Bodies that are seen: id, and position in the tracker's room, m."""
    @property
    def hands(self) -> list[tuple[int, HandSide, list[bool]]]:
        """Id, side, and for each finger whether it is seen."""
    def counts(self) -> dict[str, int | None]:
        """How many there are of each kind of target; ``None`` where the line was not sent."""

@final
class Receiver:
    """An open UDP port, listened to by a thread of its own. A context manager."""

    def __init__(
        self,
        connection: str = "5000",
        *,
        bind: str = "0.0.0.0",
        interface: str = "0.0.0.0",
        max_bytes: int = 32_768,
        controller_port: int = 50_107,
    ) -> None:
        """Open and listen.

        ``connection`` is ``PORT``, ``GROUP:PORT`` (multicast), ``HOST:PORT`` (packets of that controller only) or ``HOST:PORT:fw``
        (greets it, for firewalls). ``bind`` is the address of this machine to listen on; for a multicast group it names the interface that
        joins, as ``interface`` does. Larger datagrams than ``max_bytes`` are refused. Raises ``InvalidValueError`` or ``NetworkError``.
        """
    @property
    def address(self) -> tuple[str, int]:
        """Address and port that are listened on."""
    def now(self) -> float:
        """Seconds since it was opened: the clock of ``Packet.arrival``."""
    def wait(self, timeout: float) -> bool:
        """Wait until there is something to take, at most ``timeout`` s; the GIL is released. Raises ``NetworkError`` if it
        cannot listen any more.
        """
    def take(self) -> list[Packet]:
        """All packets since the last call, in order of arrival; at most the last 512."""
    @property
    def latest(self) -> Packet | None:
        """The newest by its frame counter."""
    def statistics(self) -> dict[str, Any]:
        """Counts (``datagrams, bytes, packets, lost, late, duplicates, restarts, malformed, oversize, empty, foreign, overrun``), Hz
        (``rate``, ``tracker_rate``), s (``jitter, lateness, tracker_latency, pick_up_mean, pick_up_max``) and ``last_refusal``.
        """
    def close(self) -> None:
        """Stop and close the port. Raises ``ForkError`` in a forked child, as all but ``address``; to leave a ``with``
        block there does nothing.
        """
    def __enter__(self) -> Receiver: ...
    def __exit__(self, *_exception: object) -> None: ...

@final
class Take:
    """Recorded packets with their arrivals."""

    @staticmethod
    def read(path: str | PathLike[str]) -> Take:
        """Read a take, compressed (gzip) or not, or packets that were captured elsewhere. Raises ``CaptureFileError``."""
    @staticmethod
    def pinch(*, seed: int = 1, rate: float = 60.0, noise: float = 3e-4, tremor: float = 1.5e-4, side: HandSide = "right") -> Take:
        """A made-up right hand that pinches the box of the scene ``grasp``, lifts it by 10 cm, turns it by 30 degrees and puts it down, in
        10 s.

        ``rate`` Hz; ``noise`` m, standard deviation; ``tremor`` m. The middle finger is lost for 0.2 s. Same seed, same take.
        """
    def write(self, path: str | PathLike[str]) -> None:
        """Write a file; compressed if its name ends in ``.gz``. Raises ``CaptureFileError``."""
    @property
    def packets(self) -> list[Packet]: ...
    @property
    def arrivals(self) -> FloatArray:
        """(n,) s."""
    @property
    def notes(self) -> list[str]:
        """Lines of notes."""
    @property
    def damaged(self) -> int:
        """Packets that were cut or spoilt and are left out."""
    @property
    def duration(self) -> float:
        """From first to last arrival, s."""
    def statistics(self) -> dict[str, Any]:
        """As ``Receiver.statistics``, for the whole take."""
    def frames(self, decoder: HandDecoder) -> list[HandFrame]:
        """The hand in every packet that has the line it would be in."""
    def __len__(self) -> int: ...

@final
class TakeWriter:
    """Writes a take while it is recorded; after every packet the file is whole. A context manager."""

    def __init__(self, path: str | PathLike[str], *, append: bool = False) -> None:
        """Create or overwrite the file, or go on behind what is there. Raises ``CaptureFileError``."""
    def note(self, text: str) -> None:
        """A line of notes."""
    def packet(self, arrival: float, data: bytes) -> None:
        """A packet that came ``arrival`` s after the start of the recording. Raises ``InvalidValueError`` before that and
        from eleven days on.
        """
    def close(self) -> None:
        """Close the file; whoever writes on is refused with ``InvalidValueError``."""
    def __enter__(self) -> TakeWriter: ...
    def __exit__(self, *_exception: object) -> None: ...

@final
class Replay:
    """Sends a take as a controller would, in time, on a thread of its own. A context manager."""

    def __init__(
        self,
        take: Take,
        targets: Sequence[str] = (),
        *,
        speed: float = 1.0,
        rounds: int = 1,
        source_port: int = 50_107,
        bind: str | None = None,
        serve_greeters: bool = True,
        bodies: bool = False,
    ) -> None:
        """Start to send to ``targets`` (``HOST:PORT``, ``PORT``, ``GROUP:PORT``) and to whoever greets from a local network; without
        targets it waits for a greeting.

        ``rounds`` 0 sends until it is stopped. ``source_port`` falls back to any port if it is taken: see ``address``. ``bind`` is the
        address of this machine to send from, and to hear greetings at: by default 127.0.0.1 if all ``targets`` are there, else any.
        ``bodies`` also sends each fingertip as a body of ``6d``. Raises ``InvalidValueError`` or ``NetworkError``.
        """
    @property
    def address(self) -> tuple[str, int]:
        """Address and port that it sends from."""
    def wait(self, timeout: float) -> bool:
        """Wait for the end, at most ``timeout`` s; the GIL is released. Whether it has ended."""
    def state(self) -> dict[str, Any]:
        """``sent, rounds, greetings, targets, displaced`` (greeters that had to make room: 16 are served), ``expired`` (that did not greet
        again for 10 s), ``strangers`` (greetings from outside local networks), ``withheld`` (packets that a greeter was not sent, beyond
        500 in a second), ``refused, latest`` (s behind the schedule at worst) and ``done``.
        """
    def stop(self) -> None:
        """Stop."""
    def __enter__(self) -> Replay: ...
    def __exit__(self, *_exception: object) -> None: ...

@final
class HandFrame:
    """One hand at one moment, whatever the tracker.

    Tip frames: origin in the centre of the sphere that models the pad, +x along the outstretched finger, +z out of the nail.
    Palm frame: origin in the index knuckle, +x along the outstretched index finger, +z out of the back of the hand.
    A stretched finger has the orientation of the palm. Same for both hands.
    """

    def __init__(
        self,
        side: HandSide,
        positions: npt.ArrayLike,
        quaternions: npt.ArrayLike,
        pad_radii: npt.ArrayLike,
        tracked: Sequence[bool],
        *,
        time: float,
        arrival: float,
        source: Literal["webxr", "dtrack-hand", "dtrack-bodies", "synthetic"] = "webxr",
        frame: Literal["tracker", "world"] = "tracker",
    ) -> None:
        """From ``positions`` (6, 3) m, ``quaternions`` (6, 4), ``pad_radii`` (6,) m and ``tracked`` (6,). Rows that are not tracked are not
        read.

        ``time`` s on the tracker's clock, ``arrival`` s on the clock of whoever asks for targets.
        """
    @property
    def side(self) -> HandSide: ...
    @property
    def time(self) -> float:
        """s on the tracker's clock."""
    @property
    def arrival(self) -> float:
        """s on the clock of the receiver or of the take."""
    @property
    def source(self) -> str: ...
    @property
    def frame(self) -> Literal["tracker", "world"]:
        """The frame of all poses."""
    @property
    def positions(self) -> FloatArray:
        """(6, 3) m; NaN where not tracked."""
    @property
    def quaternions(self) -> FloatArray:
        """(6, 4); NaN where not tracked."""
    @property
    def pad_radii(self) -> FloatArray:
        """(6,) m; NaN for fingers that the source does not have, 0 for the palm."""
    @property
    def tracked(self) -> npt.NDArray[np.bool_]:
        """(6,)"""
    @property
    def present(self) -> npt.NDArray[np.bool_]:
        """(6,) whether the source has it at all."""
    def transformed(self, calibration: Calibration) -> HandFrame:
        """The same hand seen from the world."""

@final
class HandDecoder:
    """Makes frames of one hand from packets."""

    def __init__(self, side: HandSide = "right", *, bodies: str | None = None) -> None:
        """The fingertracking hand of that side or, with ``bodies``, bodies that are fixed to its fingers.

        ``bodies`` is a text such as ``"thumb=0,index=1,middle=2,palm=3"``, or the name of a TOML file, which has its own side.
        """
    @property
    def side(self) -> HandSide: ...
    def decode(self, packet: Packet) -> HandFrame | None:
        """The hand; one in which nothing is tracked if it is hidden; ``None`` if the packet lacks the line it would be in."""

@final
class HandTracker:
    """Takes frames when they come, gives targets when they are needed: smooth for any rate, jitter, loss and order, and without poses that
    no hand can have come to.
    """

    def __init__(
        self,
        side: HandSide = "right",
        *,
        calibration: Calibration | None = None,
        delay: float | None = None,
        hold: float = 0.5,
        fade: float = 0.5,
        catch: float = 0.1,
    ) -> None:
        """All times in s. ``delay``: how far in the past the hand is shown; ``None`` fits the stream, 0 predicts. What is not seen keeps
        its full weight for ``hold`` and fades within ``fade``; ``catch`` is the time constant with which a pose glides to where it is seen
        again, by 0.5 m/s and 3 rad/s at most.
        """
    def push(self, frame: HandFrame) -> None:
        """Take a frame. Raises ``InvalidValueError`` for one of the other hand or with numbers that are out of range. Any
        thread may call it.
        """
    def sample(self, now: float) -> HandTargets | None:
        """The hand at ``now``, s on the clock of the arrivals, which must not fall back. ``None`` before the first frame.

        To be asked at 10 Hz or more: from one call to the next no more is made up for than in 0.1 s.
        """
    @property
    def side(self) -> HandSide: ...
    @property
    def delay(self) -> float:
        """How far in the past the hand is shown now, s."""
    @property
    def dropped(self) -> dict[str, Any]:
        """What was not believed so far: ``frames`` of which a pose was dropped, ``parts``, how many poses of each part (those with none
        left out), and these by fault: ``jumps`` where no hand can have come, ``exchanged`` fingers, ``flipped`` ones with the nail where
        the pad was. ``relocations``: how often the hand or a part of it was believed to be elsewhere after all.
        """

@final
class HandTargets:
    """A hand at the moment it was asked for, in the world."""

    @property
    def positions(self) -> FloatArray:
        """(6, 3) m; NaN where never seen."""
    @property
    def quaternions(self) -> FloatArray:
        """(6, 4); NaN where never seen."""
    @property
    def linear_velocities(self) -> FloatArray:
        """(6, 3) m/s; NaN where never seen."""
    @property
    def angular_velocities(self) -> FloatArray:
        """(6, 3) rad/s; NaN where never seen."""
    @property
    def weights(self) -> FloatArray:
        """(6,) 0 to 1: how much to believe it. Scale the spring by it; it is continuous in time."""
    @property
    def pad_radii(self) -> FloatArray:
        """(6,) m; NaN where never seen, 0 for the palm."""
    @property
    def states(self) -> list[Literal["absent", "live", "held", "fading", "lost"]]:
        """One for each row."""
    def pad_places(self) -> tuple[FloatArray, FloatArray]:
        """Apex of every tracked pad's skin, (6, 3) m, and the direction that it faces, (6, 3), world; NaN where never seen."""
    @property
    def delay(self) -> float:
        """How far in the past the hand is shown, s."""
    @property
    def time(self) -> float:
        """Time on the tracker's clock that is shown, s."""

@final
class Calibration:
    """Rigid transform from the tracker's room to the world: ``x_world = R(quaternion) x_tracker + position``."""

    def __init__(self, position: npt.ArrayLike | None = None, quaternion: npt.ArrayLike | None = None) -> None:
        """``position`` (3,) m, ``quaternion`` (4,); the room is the world without them."""
    @staticmethod
    def read(path: str | PathLike[str]) -> Calibration:
        """Read a TOML file with ``translation`` and ``quaternion``. Raises ``CaptureFileError`` or ``InvalidValueError``."""
    def write(self, path: str | PathLike[str]) -> None:
        """Write such a file."""
    @staticmethod
    def from_three_points(origin: npt.ArrayLike, on_x: npt.ArrayLike, in_plane: npt.ArrayLike) -> Calibration:
        """From three points (3,) m touched in the tracker's room: the world's origin, one on +x, one of the half plane y > 0, z = 0."""
    @staticmethod
    def from_points(tracker: npt.ArrayLike, world: npt.ArrayLike) -> Calibration:
        """Least squares from points (n, 3) m touched in the tracker's room and their places in the world, n >= 3."""
    @property
    def position(self) -> FloatArray:
        """(3,) m."""
    @property
    def quaternion(self) -> FloatArray:
        """(4,)"""
    @property
    def residual(self) -> float | None:
        """Root mean square distance after a fit, m."""
