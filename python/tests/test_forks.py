"""A forked child makes threads of its own: whatever was used before, it works there with the same bits, or says that it is its parent's. It
never hangs.
"""

import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import quasirigid as qr
from quasirigid import mocap

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
TIMEOUT = 40.0
"""A child that takes longer hangs, s: alone it takes half a second."""


def in_child(work: Callable[[], Any]) -> Any:
    """What ``work`` returns in a forked child, or the error that it raises, raised here."""
    source, sink = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # Python warns of forks where there are threads: they are the subject
        child = os.fork()
    if child == 0:
        try:
            os.close(source)
            try:
                answer: Any = work()
            except BaseException as error:
                error.__notes__ = [traceback.format_exc()]  # type: ignore[attr-defined]
                answer = error
            with os.fdopen(sink, "wb") as file:
                pickle.dump(answer, file)
        finally:
            os._exit(0)
    os.close(sink)
    chunks = []
    alarm = threading.Timer(TIMEOUT, os.kill, (child, signal.SIGKILL))
    alarm.start()
    try:
        with os.fdopen(source, "rb") as file:
            while chunk := file.read(1 << 16):
                chunks.append(chunk)
        _, status = os.waitpid(child, 0)
    finally:
        alarm.cancel()
    assert not os.WIFSIGNALED(status), f"the child hung for {TIMEOUT} s, or died of signal {os.WTERMSIG(status)}"
    answer = pickle.loads(b"".join(chunks))
    if isinstance(answer, BaseException):
        raise answer
    return answer


def scene(threads: int = 1, hand: bool = True) -> qr.World:
    world = qr.World(threads=threads)
    wood, rubber = qr.Material.preset("wood"), qr.Material.preset("rubber")
    world.add_body(qr.Surface.half_space(0.2, points=1200), wood, motion="fixed")
    points = qr.Surface.sphere(0.02, points=900, control_points=120).points
    world.add_body(qr.Surface.from_points(points, control_points=120), rubber, mass=0.1, position=(0, 0, 0.0198))
    if hand:
        world.add_hand(position=(0, 0, 0.3), points=600, control_points=80)
    return world


def stepped(world: qr.World) -> int:
    world.step(5)
    return world.state_hash()


def made_and_stepped(threads: int = 1) -> int:
    return stepped(scene(threads))


@pytest.fixture(scope="module")
def bits() -> int:
    """Of the scene after five steps. Surfaces, a hand and threads were used in this process once this is known."""
    alone, together = made_and_stepped(), made_and_stepped(threads=2)
    assert alone == together
    return alone


@pytest.mark.parametrize("threads", [1, 2])
def test_a_child_makes_and_steps_a_world_with_the_bits_of_its_parent(bits: int, threads: int) -> None:
    assert in_child(lambda: made_and_stepped(threads)) == bits
    assert in_child(lambda: in_child(lambda: made_and_stepped(threads))) == bits, "a child of a child"


@pytest.mark.parametrize("threads", [1, 2])
def test_a_child_goes_on_with_a_world_of_its_parent(bits: int, threads: int) -> None:
    world = scene(threads)
    assert in_child(lambda: stepped(world)) == bits
    assert in_child(lambda: (world.step(2), stepped(world))[1]) != bits
    assert stepped(world) == bits, "the parent's world is not the child's"

    def drop() -> bool:
        nonlocal world
        del world
        return True

    assert in_child(drop), "a world whose threads are elsewhere is let go of"


def test_after_other_uses_a_child_works(bits: int, tmp_path: Path) -> None:
    trimesh.creation.box(extents=(0.04, 0.03, 0.05)).export(tmp_path / "box.obj")
    world = scene(hand=False)
    world.step()

    def uses() -> list[Any]:
        solution = world.contact_problem().solve()
        box = qr.load_object(tmp_path / "box.obj", points=1000)
        again = qr.Surface.from_points(box.points, box.normals)
        return [solution.reactions.tolist(), again.areas.tolist(), len(mocap.Take.pinch(seed=3))]

    assert in_child(uses) == uses()


def pool_job(count: int) -> float:
    world = scene(hand=False)
    world.step(count)
    return float(world.bodies[1].position[2])


def test_a_pool_with_the_default_start_method_works(bits: int) -> None:
    context = multiprocessing.get_context("fork") if sys.version_info >= (3, 14) else multiprocessing.get_context()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        with context.Pool(2) as pool:
            found = pool.map_async(pool_job, [3, 4, 3]).get(timeout=TIMEOUT)
    assert found == [pool_job(count) for count in (3, 4, 3)]


@contextmanager
def another_thread(work: Callable[[], object]) -> Iterator[None]:
    """While another thread does this over and over."""
    ends, begun = threading.Event(), threading.Event()

    def run() -> None:
        while not ends.is_set():
            work()
            begun.set()

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        assert begun.wait(TIMEOUT)
        yield
    finally:
        ends.set()
        thread.join()


@pytest.mark.parametrize("threads", [1, 2])
def test_while_another_thread_steps_a_child_works_and_is_told_whose_that_world_is(bits: int, threads: int) -> None:
    world = scene(threads, hand=False)

    def child() -> tuple[int, str]:
        try:
            before = world.steps
            world.step()
            return made_and_stepped(), f"{world.steps - before} step"  # the fork came between two of its steps
        except qr.ForkError as error:
            return made_and_stepped(), str(error)

    refusal = "world: expected one that is used by the process that made it"
    answers: list[tuple[int, str]] = []
    deadline = time.monotonic() + TIMEOUT
    with another_thread(lambda: world.step(20)):
        # Whether a fork meets the thread inside a step or between two is chance.
        while len(answers) < 6 or (not any(text.startswith(refusal) for _, text in answers) and time.monotonic() < deadline):
            answers.append(in_child(child))
    assert all(found == bits for found, _ in answers)
    assert all(text == "1 step" or text.startswith(refusal) for _, text in answers), answers
    assert any(text.startswith(refusal) for _, text in answers), f"in {len(answers)} forks the other thread was never inside a step"


def test_while_another_thread_builds_surfaces_a_child_works(bits: int) -> None:
    with another_thread(lambda: qr.Surface.sphere(0.02, points=3000)):
        for _ in range(3):
            assert in_child(made_and_stepped) == bits


def refusal(work: Callable[[], Any]) -> str:
    def told() -> str:
        try:
            work()
        except qr.ForkError as error:
            return str(error)
        return "nothing"

    return str(in_child(told))


def test_a_receiver_and_a_replay_of_the_parent_are_refused() -> None:
    take = mocap.Take.pinch(seed=1)
    with mocap.Receiver("0", bind="127.0.0.1") as receiver:
        target = f"127.0.0.1:{receiver.address[1]}"
        with mocap.Replay(take, [target], source_port=0, rounds=0) as replay:
            assert receiver.wait(10.0)
            uses: list[Callable[[], object]] = [
                receiver.take, lambda: receiver.wait(5.0), lambda: receiver.latest, receiver.statistics, receiver.now, receiver.close
            ]  # fmt: skip
            for use in uses:
                assert refusal(use).startswith("receiver: expected one that is used by the process that made it")
            for other in (replay.state, lambda: replay.wait(5.0), replay.stop):
                assert refusal(other).startswith("replay: expected one that is used by the process that made it")

            def leave() -> str:
                with receiver, replay:
                    pass
                return str(receiver.address)

            assert in_child(leave) == str(receiver.address), "to leave a block in a child does nothing"
            receiver.take()
            assert receiver.wait(10.0), "the parent goes on listening"


def test_a_take_writer_of_the_parent_is_refused(tmp_path: Path) -> None:
    packet = mocap.Take.pinch(seed=1).packets[0].data
    with mocap.TakeWriter(tmp_path / "a.take") as writer:
        writer.packet(0.0, packet)
        assert refusal(lambda: writer.packet(1.0, packet)).startswith("take writer")
        writer.packet(2.0, packet)
    assert mocap.Take.read(tmp_path / "a.take").arrivals.tolist() == [0.0, 2.0]


def test_a_recording_of_the_parent_is_refused_and_stays_whole(tmp_path: Path) -> None:
    world = scene(hand=False)
    with qr.record(world, tmp_path / "run.h5") as recording:
        for _ in range(120):
            recording.append(world.step())
        report = world.step()
        for use in (lambda: recording.append(report), recording.flush, recording.close):
            assert "run.h5" in refusal(use)

        def record_here() -> int:
            other = scene(hand=False)
            with qr.record(other, tmp_path / "child.h5") as mine:
                for _ in range(3):
                    mine.append(other.step())
            with qr.Recording(tmp_path / "child.h5") as read:
                return len(read["time"])

        assert in_child(record_here) == 3
        recording.append(report)
        for _ in range(150):
            recording.append(world.step())
    with qr.Recording(tmp_path / "run.h5") as read:
        assert read.complete
        assert len(read["time"]) == 271


ENDS_AS_A_PROGRAM_DOES = """
import os, sys
import quasirigid as qr

world = qr.World()
world.add_body(qr.Surface.sphere(0.02, points=400), qr.Material.preset("wood"), mass=0.1)
wait, go = os.pipe()
with qr.record(world, sys.argv[1]) as recording:
    for step in range(250):
        recording.append(world.step())
        if step == 130 and os.fork() == 0:
            os.read(wait, 1)  # until the parent has finished the file
            sys.exit(0)  # inside the block, and not `os._exit`: exit handlers, garbage collection and HDF5's own end run
before = open(sys.argv[1], "rb").read()
os.write(go, b"x")
os.wait()
assert open(sys.argv[1], "rb").read() == before, "the child wrote to the finished recording"
"""


def test_a_child_that_ends_as_programs_do_leaves_the_recording_to_its_parent(tmp_path: Path) -> None:
    ran = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", ENDS_AS_A_PROGRAM_DOES, tmp_path / "run.h5"],
        timeout=2 * TIMEOUT,
        capture_output=True,
        text=True,
    )
    assert (ran.returncode, ran.stderr) == (0, "")
    with qr.Recording(tmp_path / "run.h5") as read:
        assert read.complete
        assert len(read["time"]) == 250


def test_a_view_of_the_parent_is_refused() -> None:
    world = scene(hand=False)
    with qr.view(world, port=18950, browser=False) as shown:
        assert refusal(shown.close).startswith("view of a world")
        assert in_child(made_and_stepped) == made_and_stepped()
        world.step()


def test_a_grip_and_mocap_objects_of_the_parent_work_in_a_child() -> None:
    take, decoder, tracker = mocap.shipped_take(), mocap.HandDecoder("right"), mocap.HandTracker("right")

    def pads() -> list[float]:
        for frame in take.frames(decoder)[:5]:
            tracker.push(frame)
        targets = tracker.sample(0.1)
        assert targets is not None
        return np.nan_to_num(targets.positions).ravel().tolist()

    here = in_child(pads)
    assert here == pads()
