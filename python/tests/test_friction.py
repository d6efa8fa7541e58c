"""Friction beyond Coulomb, from Python: the laws are held by the Rust tests, here it is what a user touches."""

import numpy as np
import pytest

import quasirigid as qr

G = 9.81


def block_on_plane(rubber: qr.Material, *, angle: float, friction_rule="geometric-mean", dt: float = 1e-3):
    """A block of 100 g on a plane; gravity falls off by ``angle`` (rad) towards +x."""
    gravity = (G * np.sin(angle), 0.0, -G * np.cos(angle))
    world = qr.World(dt, gravity, friction_rule=friction_rule)
    plane = world.add_body(qr.Surface.half_space(0.2, points=4000, control_points=400), rubber, motion="fixed")
    surface = qr.Surface.box((0.04, 0.04, 0.02), points=1500, control_points=200)
    block = world.add_body(surface, rubber, mass=0.1, position=(0, 0, 0.01))
    return world, plane, block


def rubber(friction) -> qr.Material:
    return qr.Material.preset("rubber").replace(friction=friction)


def test_a_friction_shows_what_it_was_given():
    law = qr.Friction(0.6, 0.4, stribeck_velocity=2e-3, viscous=50.0, direction=(0, 3, 0), ratio=0.5)
    assert (law.static, law.kinetic, law.stribeck_velocity, law.viscous, law.ratio) == (0.6, 0.4, 2e-3, 50.0, 0.5)
    np.testing.assert_array_equal(law.direction, (0, 1, 0))
    assert law.coefficient(0.0) == 0.6
    assert law.coefficient(2e-3) == pytest.approx(0.4 + 0.2 * np.exp(-1), rel=1e-14)
    assert repr(law) == "Friction(0.6, 0.4, stribeck_velocity=0.002, viscous=50, direction=(0, 1, 0), ratio=0.5)"
    assert eval(repr(law), {"Friction": qr.Friction}) == law
    plain = qr.Friction(0.5)
    assert plain.kinetic == 0.5
    assert plain.direction is None
    assert plain.ratio == 1.0
    assert repr(plain) == "Friction(0.5)"


def test_a_material_takes_a_number_or_a_law():
    law = qr.Friction(0.6, 0.4)
    assert rubber(law).friction == 0.6
    assert rubber(law).friction_law == law
    assert rubber(0.3).friction_law == qr.Friction(0.3)
    assert rubber(law).replace(density=1000.0).friction_law == law


@pytest.mark.parametrize(
    "arguments",
    [
        {"static": -0.1},
        {"static": float("nan")},
        {"static": 0.5, "kinetic": 0.6},
        {"static": 0.5, "kinetic": 0.4, "stribeck_velocity": 0.0},
        {"static": 0.5, "viscous": -1.0},
        {"static": 0.5, "direction": (1, 0, 0)},
        {"static": 0.5, "ratio": 2.0},
        {"static": 0.5, "direction": (0, 0, 0), "ratio": 2.0},
        {"static": 0.5, "direction": (1, 0, 0), "ratio": 0.0},
    ],
)
def test_what_no_friction_is_is_refused(arguments):
    with pytest.raises(qr.InvalidValueError, match=r"expected .*; "):
        qr.Friction(**arguments)


def test_static_friction_holds_a_block_that_kinetic_friction_would_let_slide():
    law = qr.Friction(0.6, 0.3)
    world, _, block = block_on_plane(rubber(law), angle=0.45)
    world.step(300)
    at = block.position
    world.step(200)
    assert np.linalg.norm(block.position - at) / 0.2 < 1e-9
    block.set_velocity((0.1, 0, 0))
    world.step(100)
    v = block.linear_velocity[0]
    world.step(50)
    acceleration = (block.linear_velocity[0] - v) / 0.05
    assert acceleration == pytest.approx(G * (np.sin(0.45) - 0.3 * np.cos(0.45)), rel=0.01)
    assert world.contacts().friction == pytest.approx(0.3, rel=1e-6)


def test_contacts_of_directed_friction_are_in_plain_newtons():
    law = qr.Friction(0.6, direction=(1, 0, 0), ratio=0.5)
    world, _, block = block_on_plane(rubber(law), angle=0.0)
    world.step(100)
    block.apply_wrench((0.2, 0.15, 0.0))
    world.step(300)
    contacts = world.contacts()
    frames, closed = contacts.frames, contacts.reactions[:, 0] > 0
    np.testing.assert_allclose(np.einsum("nij,nik->njk", frames, frames), np.broadcast_to(np.eye(3), frames.shape), atol=1e-12)
    np.testing.assert_allclose(np.einsum("nij,nj->ni", frames, contacts.reactions), contacts.forces, atol=1e-12)
    np.testing.assert_allclose(contacts.friction_ratio, 0.5, rtol=1e-9)
    # The block is side a or b; friction balances the load either way.
    np.testing.assert_allclose(abs(contacts.forces.sum(axis=0)), (0.2, 0.15, 0.1 * G), rtol=1e-6)
    inside = np.hypot(contacts.reactions[closed, 1] / 0.6, contacts.reactions[closed, 2] / 0.3) / contacts.reactions[closed, 0]
    assert inside.max() <= 1 + 1e-9


def test_the_exported_problem_is_plain_coulomb():
    law = qr.Friction(0.5, 0.3, viscous=2e4, direction=(1, 0, 0), ratio=0.5)
    world, _, _ = block_on_plane(rubber(law), angle=0.6)
    report = world.step(200)
    assert report.converged
    problem = world.contact_problem()
    solution = qr.solve_contacts(problem.W, problem.q, problem.mu, warm_start=problem.reactions)
    # Drag is a load there: its Coulomb part solves the problem as it stands.
    np.testing.assert_allclose(solution.reactions, problem.reactions, atol=1e-6 * abs(problem.reactions).max())
    tangential = problem.reactions.reshape(-1, 3)
    slack = problem.mu * tangential[:, 0] - np.hypot(tangential[:, 1], tangential[:, 2])
    assert slack.min() > -1e-9


def test_rules_and_table():
    wood = qr.Material.preset("wood")
    world = qr.World(friction_rule="minimum")
    assert world.friction_rule == "minimum"
    assert qr.World().friction_rule == "geometric-mean"
    with pytest.raises(qr.UnknownNameError, match="geometric-mean"):
        qr.World(friction_rule="median")

    def friction_of(change=None, rule="geometric-mean"):
        world = qr.World(friction_rule=rule)
        plane = world.add_body(qr.Surface.half_space(0.1, points=1000), rubber(0.8), motion="fixed", name="plane")
        block = world.add_body(qr.Surface.box((0.02, 0.02, 0.02), points=500), wood.replace(friction=0.2), mass=0.01, position=(0, 0, 0.01))
        world.step()
        if change is not None:
            change(world, plane, block)
        world.step()
        return world.contacts().friction[0]

    for rule, expected in {"geometric-mean": 0.4, "minimum": 0.2, "maximum": 0.8, "mean": 0.5, "product": 0.16}.items():
        assert friction_of(rule=rule) == pytest.approx(expected, rel=1e-14)
    assert friction_of(lambda world, plane, block: world.set_friction(wood, "rubber", 0.7)) == 0.7
    assert friction_of(lambda world, plane, block: world.set_friction(plane, block, qr.Friction(0.6))) == 0.6

    def both(world, plane, block):
        world.set_friction(plane, "wood", 0.3)
        world.set_friction("rubber", "wood", 0.7)

    assert friction_of(both) == 0.3

    def taken_back(world, plane, block):
        both(world, plane, block)
        world.set_friction("wood", plane, None)

    assert friction_of(taken_back) == 0.7


def test_the_table_knows_hands_and_refuses_strangers():
    world, other = qr.World(), qr.World()
    hand = world.add_hand(points=600, control_points=80)
    box = world.add_body(qr.Surface.box((0.02, 0.02, 0.02), points=500), rubber(0.5), mass=0.01, position=(0, 0, 0.5))
    world.set_friction(hand, box, 0.9)
    world.set_friction(hand, rubber(0.5), 0.9)
    with pytest.raises(qr.InvalidHandleError, match="another"):
        other.set_friction(box, "wood", 0.5)
    with pytest.raises(qr.InvalidHandleError, match="Material"):
        world.set_friction(3, box, 0.5)
    with pytest.raises(qr.InvalidValueError, match="friction coefficient"):
        world.set_friction(hand, box, -0.5)
    with pytest.raises(qr.InvalidValueError, match="Friction"):
        world.set_friction(hand, box, "sticky")
    world.remove(box)
    with pytest.raises(qr.InvalidHandleError):
        world.set_friction(hand, box, 0.5)


def test_a_name_that_no_material_has_is_refused_as_by_the_presets():
    world = qr.World()
    own = qr.Material.preset("rubber").replace(name="own")
    for pair in (("rubbr", "wood"), ("wood", "rubbr"), ("own", "wood"), ("", "wood"), ("Rubber", "wood")):
        for friction in (0.5, None):
            with pytest.raises(qr.UnknownNameError, match=r"expected one of .*rubber.* got '") as error:
                world.set_friction(*pair, friction)
            assert "preset" not in str(error.value)
            assert error.value.what == "material"
    world.set_friction(own, "wood", 0.5)  # who has the material cannot mistype it
    world.set_friction("own", "wood", None)
    with pytest.raises(qr.UnknownNameError):
        world.set_friction("own", "wood", 0.5)
    world.add_body(qr.Surface.box((0.02, 0.02, 0.02), points=500), own, mass=0.01)
    world.set_friction("own", "fingertip_pulp", 0.5)
