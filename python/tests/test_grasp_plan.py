"""Grasps that a person would choose: opposing sides, near the centre of mass, within the friction cone, at a width that fits."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
import trimesh
from elsewhere import DATA, missing
from hypothesis import given, settings
from hypothesis import strategies as st

from quasirigid import MassProperties, Surface
from quasirigid.errors import GraspPlanError, InvalidShapeError, InvalidValueError, QuasirigidError, UnknownNameError
from quasirigid.grasp.options import GraspOptions
from quasirigid.grasp.plan import GraspPlan, HandGeometry, plan_grasp
from quasirigid.grasp.setup import take_surface
from quasirigid.objects import load_object
from quasirigid.objects.sampling import sample_mesh


def surface(mesh: trimesh.Trimesh, count: int = 8000) -> tuple[np.ndarray, np.ndarray]:
    faces = np.asarray(mesh.faces, dtype=np.int64)
    points, face, _ = sample_mesh(np.asarray(mesh.vertices, dtype=float), faces, count, np.random.default_rng(1))
    return points, np.asarray(mesh.face_normals)[face]


def check(plan: GraspPlan, points: np.ndarray, friction: float = 0.8, com: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
    """What every plan promises, whatever the object."""
    hand = HandGeometry()
    rotation = plan.rotation
    np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) > 0.0
    assert hand.min_width <= plan.width <= hand.max_width
    closing = rotation[:, 0]
    limit = math.cos(math.atan(friction))
    assert plan.thumb_normal @ -closing > limit, f"thumb normal {plan.thumb_normal} outside the cone"
    assert (plan.finger_normals @ closing > limit).all(), f"finger normals {plan.finger_normals} outside the cone"
    contacts = np.vstack([plan.thumb_point, plan.finger_points])
    distance = np.array([np.linalg.norm(points - contact, axis=1).min() for contact in contacts])
    gaps = np.sort(np.linalg.norm(points[:100, None] - points[None, :], axis=2), axis=1)[:, 1]
    assert distance.max() < max(3e-3, 1.5 * float(gaps.mean())), f"contacts {distance} m off the surface"
    local = (contacts - plan.centre) @ rotation
    assert local[0, 0] < 0.0 < local[1:, 0].min(), "thumb at -x, fingers at +x"
    assert np.abs(local[:, 1] - [0.0, -0.0125, 0.0125]).max() < 6e-3, f"contacts at y = {local[:, 1]} m"
    assert np.abs(local[:, 2]).max() < 6e-3
    beyond = ((points - plan.centre) @ rotation)[:, 2].max()
    assert beyond < hand.reach + hand.palm_half_width
    assert plan.weight_per_squeeze > 0.1 * friction
    if abs(closing[2]) < 0.01:  # a level pinch cannot carry more than its two sides' friction, but for a slant of the surface
        assert plan.weight_per_squeeze <= 2.0 * friction * 1.2
    assert 0.0 < plan.score <= 1.0
    assert np.linalg.norm(plan.centre - com) < 0.1


def test_box_is_taken_square_on_its_faces_above_its_middle() -> None:
    points, normals = surface(trimesh.creation.box((0.06, 0.06, 0.08)))
    plan = plan_grasp(points, normals)
    check(plan, points)
    assert plan.width == pytest.approx(0.06, abs=1e-3)
    assert plan.approach.startswith("from above")
    assert np.abs(plan.thumb_normal @ plan.rotation[:, 0] + 1.0) < 1e-6
    assert np.linalg.norm(plan.centre[:2]) < 3e-3, plan.centre
    assert plan.weight_per_squeeze == pytest.approx(1.6, rel=0.1), "a perfect pinch carries 2 mu per newton"


def test_sphere_is_taken_across_its_diameter() -> None:
    points, normals = surface(trimesh.creation.icosphere(4, 0.03))
    plan = plan_grasp(points, normals)
    check(plan, points)
    assert 0.052 < plan.width <= 0.0605, plan.width


def test_cylinder_standing_is_taken_across() -> None:
    points, normals = surface(trimesh.creation.cylinder(0.02, 0.1, sections=96))
    plan = plan_grasp(points, normals)
    check(plan, points)
    assert 0.030 < plan.width < 0.041, plan.width


def test_thin_plate_standing_is_taken_across_its_thickness() -> None:
    points, normals = surface(trimesh.creation.box((0.10, 0.012, 0.08)))
    plan = plan_grasp(points, normals)
    check(plan, points)
    assert plan.width == pytest.approx(0.012, abs=1e-3)
    assert abs(plan.rotation[1, 0]) > 0.99


def test_plate_lying_on_a_support_is_too_large_but_free_in_the_air_it_is_taken() -> None:
    points, normals = surface(trimesh.creation.box((0.12, 0.10, 0.012)))
    with pytest.raises(GraspPlanError, match="too large"):
        plan_grasp(points, normals)
    plan = plan_grasp(points, normals, resting=False)
    check(plan, points)
    assert plan.width == pytest.approx(0.012, abs=1e-3)


def test_off_centre_mass_pulls_the_grasp_towards_it() -> None:
    points, normals = surface(trimesh.creation.box((0.14, 0.04, 0.04)))
    com = (0.04, 0.0, 0.0)
    plan = plan_grasp(points, normals, com, approach="above")
    check(plan, points, com=com)
    assert plan.centre[0] == pytest.approx(0.04, abs=0.012), plan.centre


def test_the_plan_moves_with_the_object() -> None:
    points, normals = surface(trimesh.creation.box((0.05, 0.06, 0.07)))
    shift = np.array([0.3, -0.2, 1.1])
    here, there = plan_grasp(points, normals), plan_grasp(points + shift, normals, shift)
    np.testing.assert_allclose(there.rotation, here.rotation, atol=1e-12)
    np.testing.assert_allclose(there.centre - shift, here.centre, atol=3e-3)


def test_same_input_same_plan_and_input_untouched() -> None:
    points, normals = surface(trimesh.creation.icosphere(3, 0.03), 3000)
    before = points.copy()
    first, second = plan_grasp(points, normals), plan_grasp(points, normals)
    assert np.array_equal(first.rotation, second.rotation)
    assert np.array_equal(first.centre, second.centre)
    assert first.score == second.score
    assert np.array_equal(points, before)


@pytest.mark.parametrize("approach", ["above", "side"])
def test_the_approach_can_be_chosen(approach: str) -> None:
    points, normals = surface(trimesh.creation.box((0.05, 0.05, 0.12)))
    plan = plan_grasp(points, normals, approach=approach)  # type: ignore[arg-type]
    check(plan, points)
    assert approach in plan.approach
    assert abs(plan.rotation[2, 2] - (1.0 if approach == "above" else 0.0)) < 1e-12


def test_on_a_support_the_hand_stays_above_it() -> None:
    points, normals = surface(trimesh.creation.box((0.05, 0.05, 0.03)))
    plan = plan_grasp(points, normals)
    lowest = min(plan.thumb_point[2], plan.finger_points[:, 2].min()) - points[:, 2].min()
    assert lowest > 0.008, f"pads {lowest} m above the support"


def test_coarse_cloud_is_planned_too() -> None:
    points, normals = surface(trimesh.creation.box((0.05, 0.05, 0.06)), 600)
    check(plan_grasp(points, normals), points)


@pytest.mark.parametrize(("radius", "size"), [(0.1, "too large"), (0.002, "too small"), (0.5, "too large")], ids=["200 mm", "4 mm", "1 m"])
def test_sphere_that_does_not_fit_is_an_error_that_says_so(radius: float, size: str) -> None:
    points, normals = surface(trimesh.creation.icosphere(4, radius))
    with pytest.raises(GraspPlanError, match=size) as caught:
        plan_grasp(points, normals)
    assert "between 8 and 80 mm" in str(caught.value)
    assert ("scale it down" if size == "too large" else "scale it up") in caught.value.hint


@pytest.mark.parametrize(
    ("extents", "size"),
    [((0.2, 0.2, 0.2), "too large"), ((0.004, 0.06, 0.003), "too small"), ((0.004, 0.1, 0.1), "mm one way and .* mm another")],
)
def test_box_that_does_not_fit_is_an_error_that_says_so(extents: tuple[float, float, float], size: str) -> None:
    points, normals = surface(trimesh.creation.box(extents))
    with pytest.raises(GraspPlanError, match=size):
        plan_grasp(points, normals)


def test_flat_thing_on_a_support_is_out_of_reach() -> None:
    points, normals = surface(trimesh.creation.box((0.06, 0.05, 0.006)))
    with pytest.raises(GraspPlanError, match="support is in the way"):
        plan_grasp(points, normals)


def test_slippery_cone_has_no_opposing_sides() -> None:
    points, normals = surface(trimesh.creation.cone(0.03, 0.03, sections=96))
    with pytest.raises(GraspPlanError):
        plan_grasp(points, normals, (0.0, 0.0, 0.0075), friction=0.1)


def test_a_grasp_planned_for_more_friction_than_there_is_says_so() -> None:
    size = (0.05, 0.05, 0.06)
    box, mass = Surface.box(size, points=2_000), MassProperties.box(size, mass=0.1)
    slippery, rough = (take_surface("cube", box, mass, GraspOptions(), friction) for friction in (0.05, 0.5))
    assert slippery.warnings == ("the grasp was planned as if friction were 0.2, not 0.05",)
    assert rough.warnings == ()


@settings(max_examples=12, deadline=None)
@given(
    st.tuples(*[st.floats(0.03, 0.075)] * 3),
    st.floats(0.3, 1.2),
    st.integers(0, 3),
)
def test_any_box_of_graspable_size_is_taken(extents: tuple[float, float, float], friction: float, quarter: int) -> None:
    mesh = trimesh.creation.box(extents)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(quarter * math.pi / 8.0, [0, 0, 1]))
    points, normals = surface(mesh, 4000)
    check(plan_grasp(points, normals, friction=friction), points, friction)


def test_bad_input_is_a_typed_error() -> None:
    points, normals = surface(trimesh.creation.box((0.05, 0.05, 0.06)), 500)
    holed = points.copy()
    holed[3, 1] = np.nan
    zeroed = normals.copy()
    zeroed[7] = 0.0
    cases: list[tuple[type[QuasirigidError], tuple[object, ...], dict[str, object]]] = [
        (InvalidValueError, (holed, normals), {}),
        (InvalidValueError, (points, zeroed), {}),
        (InvalidShapeError, (points, normals[:-1]), {}),
        (InvalidShapeError, (points[:, :2], normals), {}),
        (InvalidShapeError, (points[:10], normals[:10]), {}),
        (InvalidShapeError, ("bunny", normals), {}),
        (InvalidShapeError, (points, normals, (0.0, 0.0)), {}),
        (InvalidValueError, (points, normals, (0.0, 0.0, math.inf)), {}),
        (InvalidValueError, (points, normals), {"friction": -0.1}),
        (InvalidValueError, (points, normals), {"friction": math.nan}),
        (UnknownNameError, (points, normals), {"approach": "below"}),
    ]
    for error, arguments, keywords in cases:
        with pytest.raises(error):
            plan_grasp(*arguments, **keywords)  # type: ignore[arg-type]
    with pytest.raises(InvalidValueError, match="reach"):
        HandGeometry(reach=-1.0)
    with pytest.raises(InvalidValueError, match="min_width < max_width"):
        HandGeometry(min_width=0.09)


@pytest.mark.parametrize(
    ("name", "size"), [("stanford-bunny", 0.08), ("rocker-arm", 0.08), ("ycb-mustardbottle", None), ("ycb-banana", None)]
)
def test_real_object(name: str, size: float | None) -> None:
    file = DATA / "objects" / f"{name}.obj"
    if not file.exists():
        pytest.skip(missing(f"objects/{name}.obj"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        item = load_object(file, size=size, points=20_000)
    assert item.normals is not None
    plan = plan_grasp(item.points, item.normals)
    print(
        f"\n{name}: {plan.approach}, width {1e3 * plan.width:.1f} mm, centre {np.round(1e3 * plan.centre, 1)} mm, "
        f"{plan.weight_per_squeeze:.2f} N per N, score {plan.score:.3f}"
    )
    check(plan, item.points)
    # Where the pads meet a real surface, it is within the margin of the cone that the planner keeps, and near the weight.
    assert np.linalg.norm(plan.centre) < 0.05
