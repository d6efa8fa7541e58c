"""Values are values: equal if their contents are, hashed alike, copied and pickled without a change of a bit; handles of one body are one
key.
"""

import copy
import dataclasses
import importlib
import inspect
import multiprocessing
import pickle
import pkgutil
import re
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np
import pytest

import quasirigid
import quasirigid as qr
from quasirigid import mocap

MATRIX = np.diag(np.linspace(1e-6, 2e-6, 15))


def matrix(noise: float = 0.0) -> qr.ComplianceMatrix:
    noisy = MATRIX.copy()
    noisy[0, 1] = noise
    return qr.ComplianceMatrix(noisy)


def sphere() -> qr.Surface:
    return qr.Surface.sphere(0.02, points=700, control_points=90)


def frame(time: float = 1.0) -> mocap.HandFrame:
    tracked = [True, True, False, True, True, True]
    rows = np.arange(18.0).reshape(6, 3) / 100
    turns = np.arange(24.0).reshape(6, 4) + 1
    return mocap.HandFrame("left", rows, turns, np.full(6, 0.008), tracked, time=time, arrival=2.0, source="synthetic")


PULP = qr.Material.preset("fingertip_pulp")
# By class: the same value made in one or two ways, and others.
CASES: dict[str, tuple[list[Callable[[], Any]], list[Callable[[], Any]]]] = {
    "Friction": (
        [lambda: qr.Friction(0.5, 0.5, direction=(0, 2, 0), ratio=2), lambda: qr.Friction(0.5, viscous=-0.0, direction=(-0.0, 1, 0),
        ratio=2.0)],
        [lambda: qr.Friction(0.5), lambda: qr.Friction(0.5, 0.4, direction=(0, 1, 0), ratio=2)],
    ),
    "Material": (
        [lambda: qr.Material.preset("rubber"), lambda: qr.Material.preset("rubber").replace(friction=qr.Friction(1.0), density=930)],
        [lambda: qr.Material.preset("wood"), lambda: qr.Material.preset("rubber").replace(name="other")],
    ),
    "Material with a matrix": (
        [lambda: PULP.replace(compliance=matrix()), lambda: PULP.replace(compliance=MATRIX)],
        [lambda: PULP, lambda: PULP.replace(compliance="half-space"), lambda: PULP.replace(compliance=2 * MATRIX)],
    ),
    "MassProperties": (
        [lambda: qr.MassProperties.sphere(0.1, mass=0.5), lambda: qr.MassProperties(0.5, (0, 0, -0.0),
        np.eye(3) * (0.4 * 0.5 * 0.1 * 0.1))],
        [lambda: qr.MassProperties.sphere(0.1, mass=0.6), lambda: qr.MassProperties(0.5, (0, 0, 1), np.eye(3) * 0.002)],
    ),
    "ComplianceMatrix": ([matrix, lambda: qr.ComplianceMatrix(MATRIX.tolist())], [lambda: qr.ComplianceMatrix(2 * MATRIX)]),
    "Surface": (
        [sphere, lambda: qr.Surface.from_points(sphere().points, sphere().normals, sphere().areas, control_points=90)],
        [lambda: qr.Surface.sphere(0.02, points=700, control_points=91), lambda: qr.Surface.sphere(0.021, points=700, control_points=90)],
    ),
    "Surface estimated": (
        [lambda: qr.Surface.from_points(sphere().points, control_points=90)],
        [sphere, lambda: qr.Surface.from_points(sphere().points[::-1], control_points=90)],
    ),
    "HandModel": (
        [qr.HandModel.three_finger, lambda: qr.HandModel.three_finger().with_gains(1.0, 1.0)],
        [lambda: qr.HandModel.three_finger().with_gains(1.0, 1.1)],
    ),
    "Calibration": (
        [lambda: mocap.Calibration((1, 2, 3), (1, 1, 0, 0)), lambda: mocap.Calibration((1, 2, 3), (-2, -2, -0.0, 0))],
        [mocap.Calibration, lambda: mocap.Calibration((1, 2, 3), (1, -1, 0, 0))],
    ),
    "Calibration with a residual": (
        [lambda: mocap.Calibration.from_points(np.eye(3) + 1e-3 * np.diag([1, 2, 3]), np.eye(3))],
        [lambda: mocap.Calibration.from_points(np.eye(3), np.eye(3))],
    ),
    "HandFrame": ([frame], [lambda: frame(1.5), lambda: frame().transformed(mocap.Calibration((1, 0, 0)))]),
    "HandFrame decoded": ([lambda: mocap.Take.pinch().frames(mocap.HandDecoder("right"))[270]], [frame]),
    "Take": ([lambda: mocap.Take.pinch(seed=2, rate=20)], [lambda: mocap.Take.pinch(seed=3, rate=20), lambda: mocap.Take.pinch(seed=2,
    rate=30)]),
}  # fmt: skip


def contents(value: Any) -> dict[str, bytes]:
    """What its properties say, bit by bit."""
    found = {}
    for name in dir(type(value)):
        if not name.startswith("_") and not callable(getattr(type(value), name)):
            read = getattr(value, name)
            if name == "packets":
                read = [(packet.arrival, packet.data) for packet in read]
            found[name] = pickle.dumps(np.asarray(read).tobytes() if isinstance(read, np.ndarray) else repr(read))
    return found


@pytest.mark.parametrize("case", CASES)
def test_equal_values_are_equal_and_hash_alike_whatever_way_they_were_made(case: str) -> None:
    same, others = CASES[case]
    values = [make() for make in (*same, *same)]
    for value in values:
        for other in values:
            assert value == other
            assert not value != other  # noqa: SIM202
            assert hash(value) == hash(other)
    assert len(set(values)) == 1
    for other in (make() for make in others):
        assert values[0] != other
        assert not values[0] == other  # noqa: SIM201
    assert values[0] != "a text"
    assert values[0] is not None
    assert values[0] in [1, None, values[-1]]


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("how", ["pickle 2", "pickle 5", "copy", "deepcopy"])
def test_copies_and_pickles_are_the_same_to_the_last_bit(case: str, how: str) -> None:
    value = CASES[case][0][0]()
    copies: dict[str, Callable[[Any], Any]] = {"copy": copy.copy, "deepcopy": copy.deepcopy}
    again = copies[how](value) if how in copies else pickle.loads(pickle.dumps(value, int(how[-1])))
    assert type(again) is type(value)
    assert again == value
    assert hash(again) == hash(value)
    assert contents(again) == contents(value)


def test_a_pickled_surface_steps_with_the_same_bits() -> None:
    def hash_after(ball: qr.Surface, pulp: qr.Material, mass: qr.MassProperties, hand: qr.HandModel) -> int:
        world = qr.World()
        world.add_body(qr.Surface.half_space(0.1, points=900), qr.Material.preset("wood"), motion="fixed")
        world.add_body(ball, pulp, mass=mass, position=(0.0013, 0, 0.0198))
        world.add_hand(hand, position=(0, 0, 0.3), points=400, control_points=60)
        world.step(20)
        assert len(world.contacts()) > 0
        return world.state_hash()

    for ball in (
        sphere(),
        qr.Surface.from_points(sphere().points, control_points=90),
        qr.Surface.from_points(sphere().points, sphere().normals),
    ):
        values = (ball, PULP, qr.MassProperties.sphere(0.02, mass=0.1), qr.HandModel.three_finger().with_gains(1.1, 0.9))
        assert hash_after(*values) == hash_after(*pickle.loads(pickle.dumps(values)))


def weigh(surface: qr.Surface, material: qr.Material, mass: qr.MassProperties, friction: qr.Friction) -> float:
    world = qr.World(friction_rule="minimum")
    body = world.add_body(surface, material.replace(friction=friction), mass=mass)
    return body.mass


def test_values_go_to_processes_that_are_spawned_and_come_back() -> None:
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        arguments = (sphere(), PULP, qr.MassProperties.sphere(0.02, mass=0.125), qr.Friction(0.5))
        assert pool.submit(weigh, *arguments).result(timeout=120) == 0.125
        assert pool.submit(copy.copy, arguments[0]).result(timeout=60) == arguments[0]


def test_a_spoilt_pickle_is_a_typed_error() -> None:
    rng = np.random.default_rng(0)
    counts = {"refused": 0, "read": 0}
    for case, (same, _) in CASES.items():
        value = same[0]()
        rebuild, (state,) = value.__reduce__()
        for spoilt in (b"", state[:-1], state[: len(state) // 2], b"\xa0", b"\xff" * 40, state + b"x"):
            with pytest.raises(qr.InvalidValueError, match="a whole pickle"):
                rebuild(spoilt)
        for _ in range(8 if len(state) > 100_000 else 40):
            bad = bytearray(state)
            for at in rng.integers(0, len(bad), rng.integers(1, 4)):
                bad[at] = rng.integers(256)
            try:
                assert isinstance(rebuild(bytes(bad)), type(value)), case
                counts["read"] += 1
            except qr.QuasirigidError:
                counts["refused"] += 1
    print(counts)
    assert min(counts.values()) > 20, counts


def test_handles_of_a_body_are_one_key() -> None:
    world, other = qr.World(), qr.World()
    bodies = [world.add_body(sphere(), PULP, mass=0.1, position=(i, 0, 0)) for i in range(2)]
    hand = world.add_hand(points=400, control_points=60)
    stranger = other.add_body(sphere(), PULP, mass=0.1)
    assert bodies[0] in world.bodies
    assert hand in world.hands
    assert world.bodies == bodies
    assert stranger not in world.bodies
    assert bodies[0] != bodies[1]
    assert bodies[0] != hand
    names = {bodies[0]: "first", bodies[1]: "second", hand: "hand", stranger: "other"}
    assert [names[key] for key in (*world.bodies, *world.hands, *other.bodies)] == ["first", "second", "hand", "other"]
    world.remove(bodies[0])
    assert bodies[0] not in world.bodies
    assert names[bodies[0]] == "first"
    again = world.add_body(sphere(), PULP, mass=0.1)
    assert again not in names, "a body in the place of one that was removed is another one"


def test_results_with_arrays_can_be_compared() -> None:
    problem = qr.ContactProblem(np.eye(3), [-1.0, 0.2, 0.0], [0.5])
    alike = qr.ContactProblem(np.eye(3), [-1.0, 0.2, 0.0], [0.5])
    assert problem in [alike, problem]
    assert len({problem, alike}) == 2


def test_no_data_class_with_arrays_compares_them() -> None:
    """``==`` of two arrays is no truth value: such a class would raise where it is compared, hashed or looked for in a list."""
    found = []
    for module in pkgutil.walk_packages(quasirigid.__path__, "quasirigid."):
        if module.name.endswith("__main__"):
            continue
        for thing in vars(importlib.import_module(module.name)).values():
            if inspect.isclass(thing) and thing.__module__ == module.name and dataclasses.is_dataclass(thing):
                arrays = [field.name for field in dataclasses.fields(thing) if re.search("Array|ndarray", str(field.type))]
                compared = [field.name for field in dataclasses.fields(thing) if field.name in arrays and field.compare]
                if compared and thing.__eq__ is not object.__eq__:
                    found.append(f"{module.name}.{thing.__name__}: {', '.join(compared)}")
    assert not found, found
