"""Colliders: surfaces on any link of a body, stable in number whatever else goes, and with a say in what they touch."""

import numpy as np
import pytest

import quasirigid as qr

RADIUS = 0.01
LOW = 0.95 * RADIUS
"""Height of the middle of a sphere whose control points reach into the plate that it lies on, m."""


def sphere(x: float = 0.0) -> qr.Surface:
    made = qr.Surface.sphere(RADIUS, points=360)
    return qr.Surface.from_points(made.points + (x, 0.0, 0.0), made.normals, areas=made.areas, control_points=60)


RUBBER, STEEL = qr.Material.preset("rubber"), qr.Material.preset("steel")
SPHERE = sphere()
PLATE = qr.Surface.half_space(0.08, points=400, control_points=40)


def plate(world: qr.World) -> qr.Body:
    return world.add_body(PLATE, RUBBER, motion="fixed", name="plate")


def ball(world: qr.World, x: float = 0.0, z: float = LOW) -> qr.Body:
    return world.add_body(SPHERE, RUBBER, mass=0.1, position=(x, 0.0, z), name="ball")


def test_a_body_lists_its_colliders_and_each_says_what_it_is() -> None:
    world = qr.World()
    table, body = plate(world), ball(world)
    first = body.colliders[0]
    nose = world.add_collider(body, sphere(0.03), STEEL, group=6, mask=5)
    assert body.colliders == [first, nose]
    assert world.colliders == [*table.colliders, first, nose]
    assert (nose.body, nose.finger, nose.link, nose.material, nose.group, nose.mask) == (body, None, 0, STEEL, 6, 5)
    assert (first.group, first.mask, first.material) == (1, 0xFFFFFFFF, RUBBER)
    assert nose.surface != first.surface == body.surface
    assert len({nose.id, first.id, table.colliders[0].id}) == len({nose, first, body.colliders[1]}) + 1 == 3
    assert repr(nose) == f'Collider({nose.id}, link 0 of "ball", "steel")'
    np.testing.assert_allclose(nose.deformed_points().mean(axis=0), body.position + (0.03, 0.0, 0.0), atol=1e-5)
    assert nose.displacements().shape == (len(nose.surface.control_points), 3)
    # The first stands for the body, and when it goes the next does.
    nose.material = RUBBER
    body.material = STEEL
    assert (first.material, nose.material) == (STEEL, RUBBER)
    first.remove()
    assert (body.material, body.colliders) == (RUBBER, [nose])
    world.remove(nose)
    assert (body.surface, body.material, body.deformed_points().shape) == (None, None, (0, 3))


def test_contacts_tell_links_and_colliders_and_count_bodies_as_ever() -> None:
    world = qr.World()
    gone, table, body = ball(world, x=1.0), plate(world), ball(world, x=-0.02)
    foot = world.add_collider(body, sphere(0.04), RUBBER)
    world.step(3)
    before = world.contacts()
    assert set(before.collider_a) == {body.colliders[0].id, foot.id}
    assert set(before.collider_b) == {table.colliders[0].id}
    assert (set(before.body_a), set(before.body_b)) == ({body.index}, {table.index})
    assert not before.link_a.any()
    assert not before.link_b.any()
    assert before.link_a.dtype == before.collider_a.dtype == np.uint32

    world.remove(gone)
    after = world.contacts()
    assert (table.index, body.index) == (0, 1)
    assert (set(after.body_a), set(after.body_b)) == ({1}, {0})
    for name in ("points", "reactions", "gaps", "collider_a", "collider_b", "control_point", "status"):
        assert np.array_equal(getattr(after, name), getattr(before, name)), f"{name} changed with the removal of what is far away"


@pytest.mark.parametrize("what", ["pair", "bodies", "group", "mask"])
def test_what_is_kept_apart_ends_its_contact_and_can_touch_again(what: str) -> None:
    world = qr.World()
    table, body = plate(world), ball(world)
    world.step(5)
    held = body.colliders[0]
    assert len(world.contacts()) > 0
    if what == "pair":
        world.exclude(held, table.colliders[0])
    elif what == "bodies":
        world.exclude(body, table)
    elif what == "group":
        held.group, table.colliders[0].mask = 2, 1
    else:
        held.mask = 4
    assert world.step().contacts == 0
    world.step(20)
    assert body.linear_velocity[2] == pytest.approx(-9.81 * 0.021, rel=0.05), "it falls freely"
    body.set_pose((0.0, 0.0, LOW))
    if what in ("pair", "bodies"):
        world.include(table, body)
    else:
        held.group, held.mask = 1, 0xFFFFFFFF
    assert world.step().contacts > 0


def test_a_hand_takes_colliders_on_the_links_of_its_fingers() -> None:
    world = qr.World(gravity=(0, 0, 0))
    hand = world.add_hand(points=240, control_points=40, motion="quasi-static")
    joints = hand.joint_positions.shape[1]
    pad = hand.colliders(2)[0]
    assert (pad.body, pad.finger, pad.link) == (hand, 2, joints - 1)
    knuckle = world.add_collider(hand, SPHERE, RUBBER, finger=2, link=1)
    assert (hand.colliders(2), hand.colliders(0)[0].finger) == ([pad, knuckle], 0)
    assert (knuckle.body, knuckle.finger, knuckle.link) == (hand, 2, 1)
    struck = world.add_body(SPHERE, RUBBER, mass=0.1, position=hand.link_poses[2, 1, :3] + (0, 0, 1.9 * RADIUS))
    world.step()
    contacts = world.contacts()
    on_knuckle = (contacts.collider_a == knuckle.id) | (contacts.collider_b == knuckle.id)
    assert on_knuckle.any()
    assert set(np.where(contacts.collider_a == knuckle.id, contacts.link_a, contacts.link_b)[on_knuckle]) == {1}
    world.exclude(hand, struck)
    assert world.step().contacts == 0

    with pytest.raises(qr.InvalidValueError, match=rf"link: expected a link below {joints}: '.*' has {joints}, got {joints};"):
        world.add_collider(hand, SPHERE, RUBBER, finger=0, link=joints)
    with pytest.raises(qr.InvalidValueError, match="finger: expected an index below 3, got 3"):
        world.add_collider(hand, SPHERE, RUBBER, finger=3)
    with pytest.raises(qr.InvalidHandleError, match="expected a Hand with finger=, got a Hand without"):
        world.add_collider(hand, SPHERE, RUBBER)
    assert len(world.colliders) == 5, "what was refused leaves nothing behind"


def test_bad_input_is_refused_with_what_was_expected() -> None:
    world, other = qr.World(), qr.World()
    body, foreign = ball(world), ball(other)
    only = body.colliders[0]
    with pytest.raises(qr.InvalidValueError, match="link: expected a link below 1: 'ball' has 1, got 1"):
        world.add_collider(body, SPHERE, RUBBER, link=1)
    with pytest.raises(qr.InvalidHandleError, match="a Body with finger=0"):
        world.add_collider(body, SPHERE, RUBBER, finger=0)
    with pytest.raises(qr.InvalidHandleError, match="a Body, or a Hand with finger="):
        world.add_collider(only, SPHERE, RUBBER)  # type: ignore[arg-type]
    for value in (-1, 2**32):
        with pytest.raises(qr.InvalidValueError, match=f"mask: expected a whole number from 0 to 4294967295, got {value}"):
            only.mask = value
        with pytest.raises(qr.InvalidValueError, match="group"):
            world.add_collider(body, SPHERE, RUBBER, group=value)
    for a, b in [(body, foreign), (only, foreign.colliders[0])]:
        with pytest.raises(qr.InvalidHandleError, match="another world"):
            world.exclude(a, b)
    with pytest.raises(qr.InvalidValueError, match="one collider twice"):
        world.exclude(only, body)
    with pytest.raises(qr.InvalidHandleError, match="a Collider, a Body or a Hand"):
        world.exclude(only, "ball")  # type: ignore[arg-type]
    with pytest.raises(qr.InvalidHandleError, match="another world"):
        world.add_collider(foreign, SPHERE, RUBBER)


def test_a_handle_of_what_is_gone_raises_and_never_names_what_came_in_its_place() -> None:
    world = qr.World()
    table, body = plate(world), ball(world)
    gone = body.colliders[0]
    number = gone.id
    world.exclude(gone, table)
    world.remove(body)
    again = ball(world)
    assert (again.colliders[0].id, again.colliders[0] == gone) == (number, False)
    assert world.step().contacts > 0, "the exclusion went with the collider"
    assert repr(gone) == "Collider(removed)"
    for use in (lambda: gone.id, lambda: gone.body, lambda: gone.link, lambda: gone.material, gone.remove, gone.deformed_points):
        with pytest.raises(qr.InvalidHandleError, match="removed"):
            use()
    with pytest.raises(qr.InvalidHandleError):
        gone.mask = 3
    with pytest.raises(qr.InvalidHandleError):
        body.colliders  # noqa: B018
