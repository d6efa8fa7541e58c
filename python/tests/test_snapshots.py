"""Worlds can be kept, taken back, copied, pickled and sent to other processes; what goes on from there has the same bits."""

from __future__ import annotations

import copy
import multiprocessing
import pickle
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np
import pytest
from hand_frames import START

import quasirigid as qr
from quasirigid import mocap
from quasirigid.mocap.coupling import TipCoupling
from quasirigid.mocap.hand_coupling import HandCoupling

RUBBER, PULP = qr.Material.preset("rubber"), qr.Material.preset("fingertip_pulp")
SIZE = (0.04, 0.04, 0.05)
STEPS = 40


def cube(points: int = 600, control_points: int = 80) -> qr.Surface:
    return qr.Surface.box(SIZE, points=points, control_points=control_points)


def closing_hand() -> tuple[qr.World, qr.Hand, qr.Grip, qr.Body]:
    """A hand amid its squeeze on a box that nothing else holds."""
    world = qr.World()
    hand = world.add_hand(points=400, control_points=60, position=(0, 0, 0.1))
    box = world.add_body(cube(), RUBBER, mass=0.05, position=(0, 0, 0.015), name="box")
    directions = np.array([(1.0, 0, 0), (-1, 0, 0), (-1, 0, 0)])
    starts = np.array([(-0.028, 0, -0.082), (0.028, 0.012, -0.082), (0.028, -0.012, -0.082)])
    grip = hand.grip(starts, directions, squeeze=3.0)
    world.gravity = (0, 0, 0)
    for _ in range(400):
        grip.update()
        world.step()
        if grip.state == "squeezing":
            break
    run(world, grip, 10)
    assert grip.state == "squeezing"
    assert len(world.contacts()) > 10
    return world, hand, grip, box


def run(world: qr.World, grip: qr.Grip, steps: int = STEPS) -> list[int]:
    hashes = []
    for _ in range(steps):
        grip.update()
        world.step()
        hashes.append(world.state_hash())
    return hashes


def resting() -> tuple[qr.World, qr.Body]:
    world = qr.World()
    world.add_body(qr.Surface.half_space(0.1, points=400, control_points=50), RUBBER, motion="fixed", name="table")
    box = world.add_body(cube(), RUBBER, mass=0.1, position=(0, 0, 0.0251), name="box")
    world.step(20)
    return world, box


def test_a_grasp_under_control_is_taken_back_and_goes_on_with_the_same_bits() -> None:
    world, hand, grip, box = closing_hand()
    before, grip_before = world.snapshot(), copy.copy(grip)
    report, targets = world.report, hand.joint_targets
    first = run(world, grip)
    for _ in range(2):
        world.restore(before)
        grip.restore(grip_before)
        assert world.report is report
        assert (world.steps, world.time) == (before.steps, before.time)
        assert world.snapshot() == before
        assert np.array_equal(hand.joint_targets, targets)
        assert run(world, grip) == first
    assert box.name == "box"


@pytest.mark.parametrize("how", ["deepcopy", "pickle"])
def test_a_copied_grip_closes_the_copied_hand(how: str) -> None:
    world, hand, grip, box = closing_hand()
    copies: dict[str, Callable[[Any], Any]] = {"deepcopy": copy.deepcopy, "pickle": lambda it: pickle.loads(pickle.dumps(it))}
    other, its_grip, its_hand, its_box = copies[how]((world, grip, hand, box))
    assert other.state_hash() == world.state_hash()
    assert (its_hand, its_box) == (other.hand(hand), other.body(box))
    assert its_box in other.bodies
    assert box not in other.bodies
    before, place = world.state_hash(), box.position
    its_grip.squeeze = 6.0
    others = run(other, its_grip)
    assert world.state_hash() == before, "the copy moved its original"
    assert np.array_equal(box.position, place)
    again, again_grip = copies[how]((world, grip))
    assert run(again, again_grip) == run(world, grip) != others


def test_copies_of_a_world_are_independent_and_share_surfaces() -> None:
    world, box = resting()
    for make in (copy.copy, copy.deepcopy, lambda it: qr.World.from_snapshot(it.snapshot()), lambda it: pickle.loads(pickle.dumps(it))):
        other = make(world)
        assert (other.state_hash(), other.time, other.report.contacts) == (world.state_hash(), world.time, world.report.contacts)
        assert other.body(box).surface == box.surface
        kept = world.state_hash()
        other.body(box).apply_wrench((1.0, 0, 5.0))
        other.step(10)
        assert world.state_hash() == kept
        assert other.state_hash() != kept
        assert other.body(box).position[2] > box.position[2]
    twin = copy.copy(world)
    world.step(30)
    twin.step(30)
    assert twin.state_hash() == world.state_hash()


def test_handles_resolve_after_restore_and_those_of_another_future_do_not() -> None:
    world, box = resting()
    before = world.snapshot()
    later = world.add_body(cube(), RUBBER, mass=0.1, position=(0.2, 0, 0.1), name="later")
    world.remove(box)
    world.step(3)
    world.restore(before)
    assert box.name == "box"
    assert [body.name for body in world.bodies] == ["table", "box"]
    other = world.add_body(cube(), RUBBER, mass=0.1, position=(0.2, 0, 0.1), name="other")
    for stale in (lambda: later.position, lambda: world.body(later), lambda: qr.World().body(box)):
        with pytest.raises(qr.InvalidHandleError):
            stale()
    assert other.name == "other"
    with pytest.raises(qr.InvalidHandleError):
        copy.copy(world).body(later)


def test_a_snapshot_is_a_value() -> None:
    world, _ = resting()
    first, same = world.snapshot(), world.snapshot()
    world.step()
    later = world.snapshot()
    assert first == same
    assert hash(first) == hash(same)
    assert first != later
    assert first != "a text"
    assert (later.steps, later.time) == (world.steps, world.time)
    assert copy.copy(first) is first
    assert copy.deepcopy(first) is first
    assert repr(first) == "Snapshot(2 bodies, time=0.020000, steps=20)"
    assert 0 < first.nbytes < len(first.to_bytes())
    again = qr.Snapshot.from_bytes(first.to_bytes())
    assert again == first
    assert again.to_bytes() == first.to_bytes()
    assert pickle.loads(pickle.dumps(first)) == first


def go_on(state: Any, steps: int) -> list[int]:
    world, grip = state
    return run(world, grip, steps)


def test_a_grasp_goes_on_in_another_process_with_the_same_bits() -> None:
    world, _, grip, _ = closing_hand()
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        there = pool.submit(go_on, (world, grip), STEPS).result(timeout=120)
        back = pool.submit(copy.copy, world).result(timeout=60)
    assert back.state_hash() == world.state_hash()
    assert run(world, grip) == there


def targets_at(times: list[float]) -> list[mocap.HandTargets]:
    """What a tracker says of the shipped motion at these times, s."""
    tracker = mocap.HandTracker("right")
    frames = list(mocap.Take.pinch(noise=0.0, tremor=0.0).frames(mocap.HandDecoder("right")))
    out = []
    for time in times:
        while frames and frames[0].time - START <= time:
            tracker.push(frames.pop(0))
        targets = tracker.sample(frames[0].arrival if frames else time)
        assert targets is not None
        out.append(targets)
    return out


@pytest.mark.parametrize("kind", [TipCoupling, HandCoupling])
def test_a_tracked_hand_is_taken_back_and_copied_with_its_world(kind: type[TipCoupling] | type[HandCoupling]) -> None:
    targets = targets_at([1.8 + 0.004 * k for k in range(24)])
    world = qr.World(dt=0.004)
    coupling = kind(world, targets[0], PULP)

    def follow(world: qr.World, coupling: TipCoupling | HandCoupling, some: list[mocap.HandTargets]) -> list[int]:
        hashes = []
        for target in some:
            coupling.follow(target)
            world.step()
            hashes.append(world.state_hash())
        return hashes

    follow(world, coupling, targets[1:8])
    world_before, before = world.snapshot(), coupling.snapshot()
    copied, its_coupling = copy.deepcopy((world, coupling))
    pickled, pickled_coupling = pickle.loads(pickle.dumps((world, coupling)))
    first = follow(world, coupling, targets[8:])
    assert len(set(first)) == len(first)
    world.restore(world_before)
    coupling.restore(before)
    assert follow(world, coupling, targets[8:]) == first
    kept = world.state_hash()
    with pytest.raises(qr.InvalidValueError):
        its_coupling.restore(before)
    assert follow(copied, its_coupling, targets[8:]) == first
    assert follow(pickled, pickled_coupling, targets[8:]) == first
    assert world.state_hash() == kept


def test_a_copied_tracker_goes_on_by_itself() -> None:
    frames = mocap.Take.pinch(noise=0.0, tremor=0.0).frames(mocap.HandDecoder("right"))[:40]
    tracker = mocap.HandTracker("right")
    for frame in frames[:20]:
        tracker.push(frame)
    tracker.sample(frames[19].arrival)
    other = copy.deepcopy(tracker)

    def rest(tracker: mocap.HandTracker) -> list[Any]:
        out = []
        for frame in frames[20:]:
            tracker.push(frame)
            targets = tracker.sample(frame.arrival)
            assert targets is not None
            out.append(targets.positions.tolist())
        return out

    first = rest(other)
    assert np.array_equal(rest(tracker), first, equal_nan=True)


def test_spoilt_and_foreign_bytes_are_a_typed_error() -> None:
    world, _ = resting()
    data = world.snapshot().to_bytes()
    other = data.replace(qr.__version__.encode(), b"9.9.9", 1)
    with pytest.raises(qr.SnapshotError, match=r"quasirigid 9\.9\.9") as refused:
        qr.Snapshot.from_bytes(other)
    assert qr.__version__ in refused.value.expected
    for spoilt in (b"", b"x", pickle.dumps(1), data[:-1], data[: len(data) // 2], data[:60], data + b"x"):
        with pytest.raises(qr.SnapshotError) as refused:
            qr.Snapshot.from_bytes(spoilt)
        assert all((refused.value.what, refused.value.expected, refused.value.got, refused.value.hint))
    rng = np.random.default_rng(1)
    counts = {"refused": 0, "read": 0}
    for _ in range(60):
        bad = bytearray(data)
        for at in rng.integers(len(bad) // 2, len(bad), rng.integers(1, 3)):
            bad[at] = rng.integers(256)
        try:
            spoilt_world = qr.World.from_snapshot(qr.Snapshot.from_bytes(bytes(bad)))
            spoilt_world.step(3)
            counts["read"] += 1
        except qr.SnapshotError:
            counts["refused"] += 1
    print(counts)
    assert min(counts.values()) > 3, counts


def test_colliders_filters_and_exclusions_go_along() -> None:
    """Of two boxes over a plate the one rests on it, whose second surface is in no group; the other is excluded from the plate and falls
    past.
    """
    world = qr.World()
    steel, size = qr.Material.preset("steel"), (0.02, 0.02, 0.02)
    cube = qr.Surface.box(size, points=300, control_points=60)
    plate = world.add_body(qr.Surface.half_space(0.2, points=900, control_points=120), steel, motion="fixed")
    resting, falling = (world.add_body(cube, steel, mass=0.1, position=(x, 0.0, 0.0105)) for x in (-0.05, 0.05))
    world.exclude(plate, falling)
    removed = world.add_collider(resting, cube, steel)
    second = world.add_collider(resting, cube, steel, group=0, mask=0)
    before = world.snapshot()
    removed.remove()
    world.step(20)
    held = world.snapshot()
    world.step(100)
    end = (world.state_hash(), falling.position[2])
    assert end[1] < -0.02 < 0.005 < resting.position[2], (end[1], resting.position[2])

    twin, twin_second = copy.deepcopy((world, second))
    assert (twin_second.group, twin_second.mask, twin_second.id, twin_second.body.index) == (0, 0, second.id, resting.index)
    assert twin.collider(second) == twin_second
    twin_second.mask = 1
    assert second.mask == 0
    read, read_second = pickle.loads(pickle.dumps((world, second)))
    assert read.state_hash() == world.state_hash()
    assert read_second == read.collider(second)

    for again in (world, qr.World.from_snapshot(held), pickle.loads(pickle.dumps(qr.World.from_snapshot(held)))):
        again.restore(held)
        assert len(again.colliders) == 4
        again.step(100)
        assert (again.state_hash(), again.body(falling).position[2]) == end
    with pytest.raises(qr.InvalidHandleError, match="removed"):
        _ = removed.group
    world.restore(before)
    assert removed.group == 1
    assert len(world.colliders) == 5
