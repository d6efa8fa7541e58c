"""The compiled module, class by class: shapes and units, and what a world does with it."""

import threading
import time
from collections.abc import Callable

import numpy as np
import pytest
from boxes import BOX, resting_box, small_box

import quasirigid as qr

NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize(
    ("surface", "area"),
    [
        (lambda n: qr.Surface.box(BOX, points=n), 2 * (0.06 * 0.06 + 2 * 0.06 * 0.08)),
        (lambda n: qr.Surface.sphere(0.03, points=n), 4 * np.pi * 0.03**2),
        (lambda n: qr.Surface.capsule(0.01, 0.05, points=n), 4 * np.pi * 0.01**2 + 2 * np.pi * 0.01 * 0.05),
        (lambda n: qr.Surface.cylinder(0.02, 0.05, points=n), 2 * np.pi * 0.02**2 + 2 * np.pi * 0.02 * 0.05),
        (lambda n: qr.Surface.half_space(0.3, points=n), 0.09),
    ],
    ids=["box", "sphere", "capsule", "cylinder", "half_space"],
)
def test_surface_arrays_have_the_shapes_and_areas_promised(surface: Callable[[int], qr.Surface], area: float) -> None:
    made = surface(1500)
    m = len(made.control_points)
    assert len(made) == 1500
    assert made.points.shape == made.normals.shape == (1500, 3)
    assert made.areas.shape == (1500,)
    assert made.control_points.shape == (m, 3)
    assert made.control_areas.shape == (m,)
    assert m == pytest.approx(1500 / 7.5, rel=0.05)
    assert made.area == pytest.approx(area, rel=1e-6)
    assert made.areas.sum() == pytest.approx(made.area)
    assert made.control_areas.sum() == pytest.approx(made.area)
    assert made.spacing == pytest.approx(np.sqrt(area / 1500))
    np.testing.assert_allclose(np.linalg.norm(made.normals, axis=1), 1.0, atol=1e-12)


def test_surface_from_points_keeps_their_order() -> None:
    ball = qr.Surface.sphere(0.02, points=800)
    points, normals, areas = ball.points, ball.normals, ball.areas
    shuffled = np.random.default_rng(0).permutation(800)
    again = qr.Surface.from_points(points[shuffled], normals[shuffled], areas[shuffled])
    np.testing.assert_array_equal(again.points, points[shuffled])
    np.testing.assert_allclose(again.normals, normals[shuffled], atol=1e-15)
    estimated = qr.Surface.from_points(points.tolist())
    assert np.einsum("ij,ij->i", estimated.normals, normals).min() > 0.9
    assert estimated.area == pytest.approx(ball.area, rel=0.05)


def test_mass_properties_of_solids() -> None:
    box = qr.MassProperties.box((1.0, 2.0, 3.0), mass=12.0)
    np.testing.assert_allclose(box.inertia, np.diag([13.0, 10.0, 5.0]))
    np.testing.assert_array_equal(box.centre, np.zeros(3))
    assert qr.MassProperties.sphere(0.1, density=1000.0).mass == pytest.approx(4 / 3 * np.pi)
    assert qr.MassProperties.cylinder(0.1, 1.0, density=1000.0).mass == pytest.approx(10 * np.pi)
    assert qr.MassProperties.capsule(0.1, 1.0, density=1000.0).mass == pytest.approx(10 * np.pi + 4 / 3 * np.pi)
    heavier = box.scaled_to_mass(24.0)
    np.testing.assert_allclose(heavier.inertia, 2 * box.inertia)
    assert qr.MassProperties(1.0, (0, 0, 0.1), np.eye(3)).centre[2] == 0.1


def test_material_replace_changes_only_what_is_given() -> None:
    pulp = qr.Material.preset("fingertip_pulp")
    other = pulp.replace(friction=0.3, compliance="half-space")
    assert (other.friction, other.compliance, other.density) == (0.3, "half-space", pulp.density)
    assert other.replace(compliance="gaussian").compliance == pulp.compliance == "gaussian"
    assert other.replace(young_modulus=2e5).compliance == "half-space"
    assert {"wood", "rubber", "silicone", "fingertip_pulp"} <= set(qr.Material.preset_names())
    for name in qr.Material.preset_names():
        assert qr.Material.preset(name).name == name


def test_free_fall_and_velocity() -> None:
    world = qr.World(dt=1e-3)
    ball = world.add_body(qr.Surface.sphere(0.02, points=400), qr.Material.preset("rubber"), mass=0.1, position=(0, 0, 1), name="ball")
    ball.set_velocity((1.0, 0.0, 0.0), (0.0, 0.0, 2.0))
    report = world.step(100)
    assert report.contacts == 0
    assert report.converged
    np.testing.assert_allclose(ball.linear_velocity, [1.0, 0.0, -0.981], atol=1e-9)
    np.testing.assert_allclose(ball.angular_velocity, [0.0, 0.0, 2.0], atol=1e-9)
    np.testing.assert_allclose(ball.position, [0.1, 0.0, 1 - 0.981 * 0.1 / 2], atol=6e-4)
    np.testing.assert_allclose(ball.quaternion, [np.cos(0.1), 0, 0, np.sin(0.1)], atol=1e-6)
    assert world.time == pytest.approx(0.1)
    assert world.steps == 100
    assert (ball.name, ball.mass) == ("ball", pytest.approx(0.1))


def test_contacts_carry_the_weight() -> None:
    world, table, box = resting_box()
    report = world.step(300)
    contacts = world.contacts()
    n = len(contacts)
    assert report.contacts == n > 3
    for name, shape in {
        "points": (n, 3), "normals": (n, 3), "gaps": (n,), "reactions": (n, 3), "forces": (n, 3), "frames": (n, 3, 3), "areas": (n,),
        "status": (n,), "body_a": (n,), "body_b": (n,), "control_point": (n,), "pressures": (n,), "friction": (n,),
    }.items():  # fmt: skip
        assert getattr(contacts, name).shape == shape, name
    assert contacts.status.dtype == np.uint8
    assert set(np.unique(contacts.status)) <= {qr.ContactStatus.Open, qr.ContactStatus.Stick, qr.ContactStatus.Slip}
    assert {table.index, box.index} == {int(contacts.body_a[0]), int(contacts.body_b[0])}
    on_box = np.where(contacts.body_a == box.index, 1.0, -1.0)[:, None] * contacts.forces
    np.testing.assert_allclose(on_box.sum(axis=0), [0, 0, 0.2 * 9.81], atol=1e-3)
    np.testing.assert_allclose(np.einsum("nij,nj->ni", contacts.frames, contacts.reactions), contacts.forces, atol=1e-12)
    np.testing.assert_allclose(contacts.frames[:, :, 0], contacts.normals)
    np.testing.assert_allclose(contacts.pressures, contacts.reactions[:, 0] / contacts.areas)
    assert contacts.gaps.min() > -1e-7
    loaded = contacts.reactions[:, 0] > 1e-9
    assert np.abs(contacts.gaps[loaded]).max() < 1e-7
    assert list(report.stage_times) == list(qr.STAGES)
    assert sum(report.stage_times.values()) == pytest.approx(report.step_time, rel=1e-6)
    assert report.stop_reason == "converged"
    assert report.quarantined == []
    assert report.budget_exhausted is False
    with pytest.deprecated_call(match="budget_exhausted"):
        assert report.coarse is False


def test_a_body_that_is_set_aside_in_one_of_many_steps_is_told_of() -> None:
    # In one step of 10 s it would fall by a kilometre.
    world = qr.World(dt=10.0)
    body = world.add_body(qr.Surface.box((0.03,) * 3, points=300), qr.Material.preset("rubber"), mass=0.1)
    hand = world.add_hand(points=200, control_points=25)
    assert not body.quarantined
    assert not hand.quarantined
    report = world.step(3)
    assert report.quarantined == [body.index]
    assert body.quarantined
    assert not hand.quarantined
    hand.move_to((200.0, 0.0, 0.0))
    assert set(world.step(3).quarantined) == set(hand.body_indices)
    assert hand.quarantined
    np.testing.assert_allclose(hand.position, [0, 0, 0])


def test_handles_of_another_world_are_refused() -> None:
    worlds = [qr.World(), qr.World()]
    surface, rubber = qr.Surface.sphere(0.01, points=100), qr.Material.preset("rubber")
    bodies = [world.add_body(surface, rubber, mass=0.1) for world in worlds]
    with pytest.raises(qr.InvalidHandleError):
        worlds[1].remove(bodies[0])
    assert len(worlds[1].bodies) == 1


def test_fixed_body_is_moved_and_free_body_is_driven() -> None:
    world, table, box = resting_box()
    with pytest.raises(qr.QuasirigidError, match="fixed"):
        box.move_to((0, 0, 1))
    table.move_to((0, 0, -0.1))
    box.set_drive((0, 0, 0.3), stiffness=(200.0, 1.0), damping=(15.0, 0.05))
    world.step(1000)
    np.testing.assert_allclose(table.position, [0, 0, -0.1], atol=1e-15)
    assert box.position[2] == pytest.approx(0.3 - 0.2 * 9.81 / 200.0, abs=1e-4)
    box.clear_drive()
    box.apply_wrench((0, 0, 0.2 * 9.81))
    before = box.position
    world.step(50)
    np.testing.assert_allclose(box.position, before, atol=1e-4)


def test_a_drive_with_limits_pulls_and_draws_within_them() -> None:
    world = qr.World(dt=1e-3, gravity=(0.0, 0.0, 0.0))
    ball = world.add_body(qr.Surface.sphere(0.01, points=100), qr.Material.preset("rubber"), mass=0.1)
    pull = {"stiffness": (1e4, 1.0), "damping": (1.0, 0.01), "max_pull": (2.0, 0.01), "max_speed": (0.5, 5.0)}
    ball.set_drive((1.0, 0.0, 0.0), **pull)
    world.step()
    # 2 N less what the damping takes: it holds the end speed at 0.5 m/s, so it is 4 N s/m.
    assert ball.linear_velocity[0] == pytest.approx(2.0 / (0.1 / 1e-3 + 4.0), rel=1e-2)
    for _ in range(20):
        world.step(10)
        assert ball.linear_velocity[0] <= 0.5
    assert ball.linear_velocity[0] > 0.49
    world.step(4000)
    assert ball.position == pytest.approx([1.0, 0.0, 0.0], abs=1e-4)


def test_a_finger_at_its_targets_presses_with_nothing() -> None:
    hand = qr.World().add_hand(points=600, control_points=80)
    joints = hand.joint_positions
    assert np.abs(hand.blocked_forces(joints)).max() == 0.0
    bent = joints + [0.0, 0.0, 0.1, 0.0]
    forces = hand.blocked_forces(bent)
    assert forces[0, 0] > 1.0 > -1.0 > forces[1, 0], "the thumb presses along +x, the fingers against it"
    with pytest.raises(qr.InvalidShapeError, match="joint targets"):
        hand.blocked_forces(joints[0])


def test_quasi_static_body_falls_at_terminal_velocity() -> None:
    world = qr.World(dt=1e-2)
    ball = world.add_body(
        qr.Surface.sphere(0.02, points=400), qr.Material.preset("rubber"), mass=0.1, motion="quasi-static", viscosity=(2.0, 0.1)
    )
    world.step(10)
    assert ball.position[2] == pytest.approx(-0.1 * 9.81 / 2.0 * 0.1, rel=1e-9)


def test_deformed_points_and_displacements() -> None:
    world, _, box = resting_box()
    rest = box.deformed_points()
    np.testing.assert_allclose(rest, small_box().points + [0, 0, 0.04], atol=1e-12)
    world.step(300)
    u = box.displacements()
    assert u.shape == small_box().control_points.shape
    assert np.linalg.norm(u, axis=1).max() > 0.0


def test_hand_follows_its_targets() -> None:
    world = qr.World(gravity=(0, 0, 0))
    model = qr.HandModel.three_finger()
    hand = world.add_hand(model, position=(0, 0, 0.3), points=600, control_points=80)
    assert hand.finger_count == 3
    assert len(hand.finger_names) == len(hand.body_indices) == 3
    assert model.lower_limits.shape == model.upper_limits.shape == hand.joint_positions.shape == (3, len(model.joint_names))
    goal = np.array([-0.03, 0.0, -0.085])
    joints = hand.inverse_kinematics(0, goal, (1, 0, 0))
    targets = hand.joint_targets.copy()
    targets[0] = joints
    hand.joint_targets = targets
    world.step(1000)
    np.testing.assert_allclose(hand.joint_positions[0], joints, atol=1e-4)
    positions, quaternions = hand.tip_poses()
    np.testing.assert_allclose(positions[0], goal + [0, 0, 0.3], atol=1e-4)
    assert positions.shape == (3, 3)
    assert quaternions.shape == (3, 4)
    assert hand.joint_torques.shape == hand.joint_velocities.shape == (3, 4)
    assert hand.deformed_points(2).shape == (600, 3)
    assert hand.displacements(1).shape == (80, 3)
    hand.move_to((0, 0, 0.31))
    world.step()
    np.testing.assert_allclose(hand.position, [0, 0, 0.31])
    np.testing.assert_allclose(hand.quaternion, [1, 0, 0, 0])


def test_same_bits_with_any_number_of_threads() -> None:
    hashes = set()
    for threads in (1, 1, 2):
        world, _, box = resting_box(threads=threads)
        box.set_velocity((0.2, 0, 0))
        world.step(200)
        hashes.add(world.state_hash())
    assert len(hashes) == 1


def test_step_lets_other_threads_run() -> None:
    """While one thread is inside a single call of `step`, another Python thread goes on: the GIL is released."""
    world, _, _ = resting_box()
    done = threading.Event()
    world.step(100)
    begin = time.perf_counter()
    world.step(100)
    steps = int(100 * 0.5 / (time.perf_counter() - begin))  # about half a second

    def run() -> None:
        world.step(steps)
        done.set()

    stepping = threading.Thread(target=run)
    stepping.start()
    count = 0
    while not done.wait(0.001):
        count += 1
    stepping.join()
    # Were the GIL held, the first wait would end when the last step does.
    assert count > 20, f"another thread ran {count} times during {steps} steps"


def test_another_thread_may_look_while_one_steps() -> None:
    world, _, box = resting_box()
    stepping = threading.Thread(target=lambda: [world.step() for _ in range(200)])
    stepping.start()
    heights = []
    while stepping.is_alive():
        heights.append(box.position[2])
        len(world.contacts())
    stepping.join()
    assert np.isfinite(heights).all()


def test_a_world_tells_its_step_budget_and_how_many_newton_steps_a_step_took() -> None:
    world = qr.World(step_budget=8e-4)
    assert world.step_budget == 8e-4
    world.step_budget = None
    assert world.step_budget is None
    assert world.step().newton_steps == 0
