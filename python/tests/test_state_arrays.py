"""Copies of state look like live arrays. They are read-only, and say what to do instead of writing into them."""

import copy
import inspect
import io
import json
import pickle
import timeit
from typing import Any

import h5py
import matplotlib.figure
import numpy as np
import pytest

import quasirigid as qr
from quasirigid import mocap
from quasirigid.arrays.read_only import CLASSES, StateArray


@pytest.fixture(scope="module")
def world() -> qr.World:
    world = qr.World()
    wood = qr.Material.preset("wood").replace(friction=qr.Friction(0.5, direction=(1, 1, 0), ratio=2.0))
    world.add_body(qr.Surface.half_space(0.1, points=400), wood, motion="fixed")
    world.add_body(qr.Surface.sphere(0.02, points=400), wood, mass=0.1, position=(0, 0, 0.0199))
    world.add_hand(position=(0, 0, 0.3), points=400, control_points=60)
    world.step(2)
    return world


def owners(world: qr.World) -> dict[str, Any]:
    return {
        "Body": world.bodies[1], "Hand": world.hands[0], "World": world, "MassProperties": qr.MassProperties.sphere(0.1, mass=1),
        "Friction": qr.Friction(0.5, direction=(1, 1, 0), ratio=2.0), "HandModel": qr.HandModel.three_finger(),
        "Calibration": mocap.Calibration()
    }  # fmt: skip


def copies(world: qr.World) -> dict[str, np.ndarray[Any, Any]]:
    """By name: all properties of these classes that are arrays."""
    found = {}
    for name, owner in owners(world).items():
        for member, kind in inspect.getmembers(type(owner), inspect.isgetsetdescriptor):
            del kind
            value = getattr(owner, member)
            if isinstance(value, np.ndarray):
                found[f"{name}.{member}"] = value
    return found


def test_all_arrays_among_the_properties_are_known(world: qr.World) -> None:
    found = copies(world)
    assert set(found) == set(CLASSES)
    assert all(type(value) is CLASSES[name] for name, value in found.items())


WRITES = {
    "an element": lambda a: a.__setitem__((0,) * a.ndim, 0.9),
    "all": lambda a: a.__setitem__(..., 0.9),
    "a row of it": lambda a: a[:1].__setitem__(0, 0.9),
    "its transpose": lambda a: a.T.__setitem__(0, 0.9),
    "flattened": lambda a: a.reshape(-1).__setitem__(0, 0.9),
    "fill": lambda a: a.fill(0.9),
    "sort": lambda a: a.sort(),
    "partition": lambda a: a.partition(1),
    "put": lambda a: a.put(0, 0.9),
    "np.put": lambda a: np.put(a, 0, 0.9),
    "out": lambda a: np.add(a, 1.0, out=a),
    "at": lambda a: np.add.at(a, (0,) * a.ndim, 1.0),
}


@pytest.mark.parametrize("how", WRITES)
def test_to_write_into_a_copy_raises_and_says_what_works(world: qr.World, how: str) -> None:
    for name, value in copies(world).items():
        before = value.copy()
        with pytest.raises(qr.InvalidValueError, match=r"\.copy\(\)") as refused:
            WRITES[how](value)
        assert refused.value.what == name
        assert name.startswith(("HandModel", "MassP", "Friction", "Calib")) or any(c in str(refused.value) for c in "(=")
        np.testing.assert_array_equal(value, before)


def test_the_writes_that_numpy_refuses_itself_raise(world: qr.World) -> None:
    position = world.bodies[1].position
    for write in (
        lambda: position.setflags(write=True),
        lambda: np.copyto(position, 1.0),
        lambda: np.asarray(position).__setitem__(0, 1.0),
        lambda: position.flat.__setitem__(0, 1.0),
        lambda: np.random.default_rng(0).shuffle(position),
    ):
        with pytest.raises(ValueError, match=r"read-only|WRITEABLE|copy"):
            write()


def test_an_assignment_in_place_works_where_there_is_one_and_raises_elsewhere(world: qr.World) -> None:
    hand, body = world.hands[0], world.bodies[1]
    before = hand.joint_targets.copy()
    hand.joint_targets += 0.125
    np.testing.assert_array_equal(hand.joint_targets, before + 0.125)
    hand.joint_targets -= 0.125
    hand.joint_positions *= 1.0
    world.gravity *= 0.5
    np.testing.assert_array_equal(world.gravity, [0.0, 0.0, -4.905])
    world.gravity /= 0.5
    with pytest.raises(qr.InvalidValueError, match=r"body\.set_pose"):
        body.position += 1.0  # type: ignore[misc]
    with pytest.raises(qr.InvalidValueError, match=r"body\.set_velocity"):
        body.linear_velocity *= 2.0  # type: ignore[misc]


def test_what_the_message_says_works(world: qr.World) -> None:
    hand, body = world.hands[0], world.bodies[1]
    targets = hand.joint_targets.copy()
    targets[0, 1] = 0.25
    hand.joint_targets = targets
    assert hand.joint_targets[0, 1] == 0.25
    place = body.position.copy()
    place[2] = 0.5
    body.set_pose(place)
    assert body.position[2] == 0.5
    body.set_pose(body.position, body.quaternion)
    body.set_velocity(body.linear_velocity, body.angular_velocity)
    hand.move_to(hand.position, hand.quaternion)
    body.set_pose((0, 0, 0.0199))


def test_what_is_computed_from_it_is_a_plain_array_of_ones_own(world: qr.World) -> None:
    targets = world.hands[0].joint_targets
    turn = np.eye(3)
    position = world.bodies[1].position
    made = [
        targets + 1, 1 - targets, -targets, targets * targets, targets == targets, np.sqrt(np.abs(targets)), turn @ position,
        position @ turn,
        np.dot(turn, position), np.concatenate([position, position]), np.stack([position, position]), np.cross(position, position),
        np.array(targets), np.copy(targets), targets.copy(), targets.astype(np.float32), copy.copy(targets), copy.deepcopy(targets),
        pickle.loads(pickle.dumps(targets)), np.where(targets > 0, targets, 0), np.einsum("ij,j->i", turn, position), np.add.outer(position,
        position),
        np.linalg.inv(turn + np.outer(position, position)), np.maximum(targets, 0.0),
    ]  # fmt: skip
    for k, value in enumerate(made):
        assert type(value) is np.ndarray, (k, type(value))
        assert value.flags.writeable, k
    selected = targets[[0, 1]]
    selected[0] = 1.0  # new memory
    for scalar in (position[2], position.sum(), np.linalg.norm(position), position @ position, position.max()):
        assert isinstance(scalar, float)
    out = np.zeros(3)
    assert np.add(position, 1.0, out=out) is out
    mean = np.mean(targets, axis=0)
    mean[0] = 1.0


def test_other_packages_take_it_like_any_array(world: qr.World) -> None:
    position = world.bodies[1].position
    assert json.loads(json.dumps(position.tolist())) == list(position)
    assert repr(position) == repr(np.array(position))
    assert str(position) == str(np.array(position))
    assert f"{position[0]:.3f}" == "0.000"
    with h5py.File(io.BytesIO(), "w") as file:
        file["position"] = position
        assert file["position"][2] == position[2]
    axes = matplotlib.figure.Figure().subplots()
    axes.plot(position, position)
    axes.scatter(*world.hands[0].link_poses[..., :2].reshape(-1, 2).T)
    np.testing.assert_allclose(position, [0, 0, 0.0199], atol=1e-3)
    with io.BytesIO() as file:
        np.save(file, position)
    x, _, z = position
    assert (x, z) == (position[0], position[2])
    body = world.add_body(qr.Surface.sphere(0.01, points=100), qr.Material.preset("wood"), mass=0.1, position=position + (0, 0, 1))
    world.remove(body)


def test_contacts_surfaces_and_solutions_stay_the_callers_own(world: qr.World) -> None:
    contacts, surface = world.contacts(), world.bodies[1].surface
    assert surface is not None
    solution = world.contact_problem().solve()
    for array in (contacts.points, contacts.forces, surface.points, surface.normals, solution.reactions, world.hands[0].deformed_points(0)):
        assert type(array) is np.ndarray
        array[...] = 0.0


def test_to_read_a_position_takes_microseconds(world: qr.World) -> None:
    body = world.bodies[1]
    best = min(timeit.repeat(lambda: body.position, number=2000, repeat=5)) / 2000
    print(f"{1e6 * best:.2f} us")
    assert best < 50e-6, f"{1e6 * best:.2f} us: alone it takes about one"
    assert isinstance(body.position, StateArray)
