"""What the module refuses: typed errors that say what was expected, what came, and what to do."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from boxes import BOX, resting_box, small_box
from scipy.sparse import csr_array

import quasirigid as qr

NAN, INF = float("nan"), float("inf")


MATERIAL = qr.Material.preset("wood")
BAD: list[tuple[str, Callable[[], Any], type[Exception], str]] = [
    ("negative size", lambda: qr.Surface.box((0.1, -0.1, 0.1), points=100), qr.InvalidValueError, "got -0.1"),
    ("NaN size", lambda: qr.Surface.box((0.1, NAN, 0.1), points=100), qr.InvalidValueError, "NaN"),
    ("zero points", lambda: qr.Surface.box(BOX, points=0), qr.QuasirigidError, "got 0"),
    ("negative points", lambda: qr.Surface.sphere(0.1, points=-5), qr.InvalidValueError, "got -5"),
    ("infinite radius", lambda: qr.Surface.sphere(INF, points=100), qr.InvalidValueError, "inf"),
    ("zero radius", lambda: qr.Surface.capsule(0.0, 0.1, points=100), qr.InvalidValueError, "got 0"),
    ("negative length", lambda: qr.Surface.cylinder(0.1, -1.0, points=100), qr.InvalidValueError, "got -1"),
    ("negative side", lambda: qr.Surface.half_space(-1.0, points=100), qr.InvalidValueError, "got -1"),
    ("NaN semi-axis", lambda: qr.Surface.fingertip((0.01, 0.01, NAN)), qr.InvalidValueError, "NaN"),
    ("no control points", lambda: qr.Surface.box(BOX, points=100, control_points=0), qr.InvalidValueError, "control_points"),
    ("too many control points", lambda: qr.Surface.box(BOX, points=100, control_points=90), qr.InvalidValueError, "control_points"),
    ("no points", lambda: qr.Surface.from_points(np.zeros((0, 3))), qr.QuasirigidError, "got"),
    ("all in one place", lambda: qr.Surface.from_points(np.ones((100, 3))), qr.DegenerateSurfaceError, "expected"),
    ("points with NaN", lambda: qr.Surface.from_points(np.full((100, 3), NAN)), qr.InvalidValueError, "points"),
    ("points of shape (n, 2)", lambda: qr.Surface.from_points(np.zeros((100, 2))), qr.InvalidShapeError, r"\(100, 2\)"),
    ("text for points", lambda: qr.Surface.from_points("abc"), qr.InvalidShapeError, "points"),
    ("fewer normals", lambda: qr.Surface.from_points(np.eye(3), np.zeros((2, 3))), qr.QuasirigidError, "expected"),
    ("negative mass", lambda: qr.MassProperties.box(BOX, mass=-1.0), qr.InvalidValueError, "got -1"),
    ("NaN mass", lambda: qr.MassProperties.sphere(0.1, mass=NAN), qr.InvalidValueError, "NaN"),
    ("mass and density", lambda: qr.MassProperties.sphere(0.1, mass=1.0, density=1.0), qr.InvalidValueError, "both"),
    ("no mass", lambda: qr.MassProperties.sphere(0.1), qr.InvalidValueError, "neither"),
    ("impossible inertia", lambda: qr.MassProperties(1.0, (0, 0, 0), np.diag([1.0, 1.0, 5.0])), qr.InvalidValueError, "inertia"),
    ("inertia of shape (3,)", lambda: qr.MassProperties(1.0, (0, 0, 0), (1, 1, 1)), qr.InvalidShapeError, "inertia"),
    ("unknown material", lambda: qr.Material.preset("cheese"), qr.UnknownNameError, "fingertip_pulp"),
    ("negative friction", lambda: MATERIAL.replace(friction=-0.1), qr.InvalidValueError, "friction"),
    ("NaN density", lambda: MATERIAL.replace(density=NAN), qr.InvalidValueError, "density"),
    ("Poisson's ratio", lambda: MATERIAL.replace(poisson_ratio=0.7), qr.InvalidValueError, "0.7"),
    ("unknown compliance", lambda: MATERIAL.replace(compliance="jelly"), qr.UnknownNameError, "half-space"),  # type: ignore[arg-type]
    ("zero dt", lambda: qr.World(dt=0.0), qr.InvalidValueError, "dt"),
    ("NaN gravity", lambda: qr.World(gravity=(0, 0, NAN)), qr.InvalidValueError, "gravity"),
    ("gravity of two numbers", lambda: qr.World(gravity=(0, 0)), qr.InvalidShapeError, "gravity"),
    ("no threads", lambda: qr.World(threads=0), qr.InvalidValueError, "threads"),
    ("negative tolerance", lambda: qr.World(tolerance=-1.0), qr.InvalidValueError, "tolerance"),
    ("no sweeps", lambda: qr.World(max_sweeps=0), qr.InvalidValueError, "max_sweeps"),
    ("negative time budget", lambda: qr.World(time_budget=-1.0), qr.InvalidValueError, "time_budget"),
    ("negative step budget", lambda: qr.World(step_budget=-1e-3), qr.InvalidValueError, "step_budget"),
    ("step budget of nothing", lambda: setattr(qr.World(), "step_budget", 0.0), qr.InvalidValueError, "step_budget"),
    ("negative margin", lambda: qr.World(contact_margin=-1.0), qr.InvalidValueError, "contact_margin"),
    ("body without mass", lambda: qr.World().add_body(small_box(), MATERIAL), qr.InvalidValueError, "mass"),
    ("text for mass", lambda: qr.World().add_body(small_box(), MATERIAL, mass="heavy"), qr.InvalidValueError, "mass"),  # type: ignore[arg-type]
    ("negative body mass", lambda: qr.World().add_body(small_box(), MATERIAL, mass=-1.0), qr.InvalidValueError, "mass"),
    ("unknown motion", lambda: qr.World().add_body(small_box(), MATERIAL, mass=1, motion="flying"), qr.UnknownNameError, "flying"),  # type: ignore[arg-type]
    ("fixed hand", lambda: qr.World().add_hand(motion="fixed"), qr.UnknownNameError, "fixed"),  # type: ignore[arg-type]
    ("zero quaternion", lambda: qr.World().add_hand(quaternion=(0, 0, 0, 0)), qr.InvalidValueError, "quaternion"),
    ("infinite position", lambda: qr.World().add_hand(position=(0, INF, 0)), qr.InvalidValueError, "position"),
    ("no steps", lambda: qr.World().step(0), qr.InvalidValueError, "n: expected a whole number >= 1 that a machine can count to, got 0"),
    (
        "steps back",
        lambda: qr.World().step(-1),
        qr.InvalidValueError,
        "n: expected a whole number >= 1 that a machine can count to, got -1",
    ),
    ("no sweeps", lambda: qr.World(max_sweeps=0), qr.InvalidValueError, "max_sweeps: expected a whole number >= 1 .* got 0"),
    ("sweeps back", lambda: qr.World(max_sweeps=-1), qr.InvalidValueError, "max_sweeps: expected a whole number >= 1 .* got -1"),
    ("more points than 64 bits count", lambda: qr.Surface.sphere(0.1, points=2**64), qr.InvalidValueError, f"got {2**64}"),
    ("far too many control points", lambda: qr.Surface.box(BOX, points=100, control_points=-(10**30)), qr.InvalidValueError, "got -1000"),
    ("a number too long to print", lambda: qr.World(threads=10**5000), qr.InvalidValueError, "threads"),
    ("text for numbers", lambda: qr.World(gravity=("0", "0", "-9.81")), qr.InvalidShapeError, "list|tuple of"),
    ("dates for numbers", lambda: qr.World(gravity=np.zeros(3, dtype="datetime64[s]")), qr.InvalidShapeError, "datetime64"),
    ("complex numbers", lambda: qr.World(gravity=np.zeros(3, dtype=complex)), qr.InvalidShapeError, "complex128"),
    (
        "viscosity of three",
        lambda: qr.World().add_body(small_box(), MATERIAL, mass=1.0, viscosity=(1, 1, 1)),
        qr.InvalidShapeError,
        r"\(2,\)",
    ),
    (
        "W that is no matrix",
        lambda: qr.ContactProblem(np.ones(9), np.zeros(3), np.zeros(1)),
        qr.InvalidShapeError,
        r"W: expected shape \(3, 3\)",
    ),
    ("q with NaN", lambda: qr.ContactProblem(np.eye(3), np.full(3, NAN), np.zeros(1)), qr.InvalidValueError, "3 of 3 NaN"),
    ("negative mu", lambda: qr.ContactProblem(np.eye(3), np.zeros(3), -np.ones(1)), qr.InvalidValueError, "mu"),
    (
        "reactions of another problem",
        lambda: qr.ContactProblem(np.eye(3), np.zeros(3), np.ones(1), np.zeros(6)),
        qr.InvalidShapeError,
        "reactions",
    ),
    ("sparse W with NaN", lambda: qr.ContactProblem(csr_array(NAN * np.eye(3)), np.zeros(3), np.ones(1)), qr.InvalidValueError, "W: "),
    ("removing a number", lambda: qr.World().remove(3), qr.InvalidHandleError, "remove"),  # type: ignore[arg-type]
]


@pytest.mark.parametrize(("call", "error", "says"), [case[1:] for case in BAD], ids=[case[0] for case in BAD])
def test_bad_input_is_a_typed_error_that_helps(call: Callable[[], Any], error: type[Exception], says: str) -> None:
    with pytest.raises(error, match=says) as caught:
        call()
    assert isinstance(caught.value, qr.QuasirigidError)
    assert caught.value.what
    assert caught.value.expected
    assert caught.value.hint


def test_bad_input_to_handles() -> None:
    world, table, box = resting_box()
    hand = world.add_hand(position=(0, 0, 1), points=600, control_points=80)
    before = hand.joint_positions
    for call in (
        lambda: box.apply_wrench((NAN, 0, 0)),
        lambda: table.move_to((0, 0, INF)),
        lambda: box.set_drive((0, 0, 0), stiffness=(-1.0, 0.0), damping=(0.0, 0.0)),
        lambda: box.set_drive((0, 0, 0), stiffness=(1.0, 0.0), damping=np.array([NAN, 0.0])),
        lambda: box.set_drive((0, 0, 0), stiffness=(1.0, 0.0), damping=(1.0, 0.0), max_pull=(0.0, 1.0)),
        lambda: box.set_drive((0, 0, 0), stiffness=(1.0, 0.0), damping=(1.0, 0.0), max_speed=(1.0, -1.0)),
        lambda: hand.surface(2**63),
        lambda: world.step(-(2**63) - 1),
        lambda: box.set_velocity((0, NAN, 0)),
        lambda: setattr(hand, "joint_targets", np.full((3, 4), NAN)),
        lambda: setattr(hand, "joint_positions", np.full((3, 4), 99.0)),
        lambda: hand.inverse_kinematics(0, (1, 1, 1), (1, 0, 0)),
        lambda: hand.inverse_kinematics(7, (0, 0, -0.08), (1, 0, 0)),
        lambda: hand.deformed_points(-1),
        lambda: hand.grip(np.ones((3, 3)), np.eye(3)),
        lambda: hand.move_to((0, 0, 0), (0, 0, 0, 0)),
    ):
        with pytest.raises(qr.InvalidValueError):
            call()
    with pytest.raises(qr.InvalidShapeError, match=r"\(3, 4\)"):
        hand.joint_targets = np.zeros((2, 4))
    with pytest.raises(qr.InvalidShapeError):
        hand.grip(np.zeros((2, 3)), np.zeros((2, 3)))
    with pytest.raises(qr.InvalidShapeError, match=r"stiffness.*\(2,\)"):
        box.set_drive((0, 0, 0), stiffness=(1.0, 1.0, 1.0), damping=(0.0, 0.0))
    np.testing.assert_array_equal(hand.joint_positions, before)


def test_removed_bodies_and_hands_are_refused() -> None:
    world, _, box = resting_box()
    hand = world.add_hand(position=(0, 0, 1), points=600, control_points=80)
    world.remove(box)
    world.remove(hand)
    world.step()
    for call in (lambda: box.position, lambda: box.deformed_points(), lambda: hand.joint_positions, lambda: world.remove(box)):
        with pytest.raises(qr.InvalidHandleError):
            call()
    assert "removed" in repr(box)
