"""Motion capture from Python: receivers, takes, hands and what they say to bad input. Sockets of the loopback only."""

import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from quasirigid import mocap
from quasirigid.errors import CaptureFileError, InvalidShapeError, InvalidValueError, NetworkError, PacketError, UnknownNameError
from quasirigid.mocap.contents import contents
from quasirigid.mocap.springs import FASTEST
from quasirigid.mocap.touch_calibration import calibration_from_touches

EYE = "[1 0 0 0 1 0 0 0 1]"
LOCAL = "127.0.0.1"


def here(receiver: mocap.Receiver) -> str:
    return f"{LOCAL}:{receiver.address[1]}"


def listen() -> mocap.Receiver:
    return mocap.Receiver("0", bind=LOCAL)


def test_a_packet_is_read_and_its_bytes_are_kept() -> None:
    data = f"fr 7\r\nts 12.5\r\n6dcal 3\r\n6d 1 [2 1.000][100 200 -300]{EYE}\r\n".encode()
    packet = mocap.Packet.parse(data, arrival=1.5)
    assert (packet.frame, packet.time, packet.arrival, packet.data) == (7, 12.5, 1.5, data)
    assert packet.bodies == {2: pytest.approx((0.1, 0.2, -0.3))}
    assert packet.counts()["calibrated_bodies"] == 3
    assert packet.counts()["hands"] is None
    with pytest.raises(PacketError, match=r"line 2: a number is missing"):
        mocap.Packet.parse(b"fr 1\r\n6d x\r\n")


def test_hand_of_the_shipped_take_has_the_frames_promised() -> None:
    frames = mocap.shipped_take().frames(mocap.HandDecoder("right"))
    assert len(frames) == 600
    hand = frames[150]  # 2.5 s: the box is pinched
    thumb, index, _middle = hand.positions[:3]
    assert thumb == pytest.approx([-0.028, 0.0, 0.04], abs=3e-3)
    assert index == pytest.approx([0.033, 0.012, 0.04], abs=3e-3)
    assert list(hand.tracked) == list(hand.present) == [True, True, True, False, False, True]
    assert hand.pad_radii[:3] == pytest.approx(0.008)
    w, x, y, z = hand.quaternions[1]
    nail = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    assert nail == pytest.approx([1.0, 0.0, 0.0], abs=0.02), "the nail of the index finger looks away from the box"
    assert np.isnan(hand.positions[3]).all()
    assert not frames[204].tracked[2], "3.4 s: the middle finger is lost"
    assert all(mocap.HandDecoder("left").decode(p) is not None for p in mocap.shipped_take().packets[:3])


def test_replay_reaches_receiver_and_tracker() -> None:
    take = mocap.Take.pinch(seed=3)
    decoder, tracker = mocap.HandDecoder("right"), mocap.HandTracker("right")
    assert tracker.sample(0.0) is None
    with listen() as receiver, mocap.Replay(take, [here(receiver)], speed=10.0, source_port=0, bind=LOCAL) as replay:
        while not replay.wait(0.005):
            for packet in receiver.take():
                frame = decoder.decode(packet)
                assert frame is not None
                tracker.push(frame)
        assert replay.state()["sent"] == 600
        targets = tracker.sample(receiver.now())
    assert targets is not None
    assert targets.positions.shape == targets.linear_velocities.shape == targets.angular_velocities.shape == (6, 3)
    assert targets.quaternions.shape == (6, 4)
    assert targets.states[3:5] == ["absent", "absent"]
    assert targets.weights[3] == 0.0


def test_waiting_releases_the_gil() -> None:
    counted = 0
    done = threading.Event()

    def count() -> None:
        nonlocal counted
        while not done.is_set():
            counted += 1
            time.sleep(0.001)

    thread = threading.Thread(target=count)
    with listen() as receiver:
        thread.start()
        assert receiver.wait(0.3) is False
        done.set()
    thread.join()
    assert counted > 20, f"the other thread came to {counted}"


TWO_THREADS = """
import sys, threading, time
import numpy as np
from quasirigid import mocap
sys.setswitchinterval(1e-4)
tracker = mocap.HandTracker("right")
radii, tracked = np.full(6, 0.007), [True] * 5 + [False]
turns = np.tile([1.0, 0, 0, 0], (6, 1))
refused = mocap.HandFrame("left", np.zeros((6, 3)), turns, radii, tracked, time=0.0, arrival=0.0)
end = time.monotonic() + 0.1
def push():
    while time.monotonic() < end:
        try:
            tracker.push(refused)
        except Exception:
            pass
thread = threading.Thread(target=push)
thread.start()
while time.monotonic() < end:
    tracker.sample(0.0), tracker.delay, tracker.side
thread.join()
print("done")
"""


def test_one_thread_may_push_what_is_refused_while_another_samples() -> None:
    """In a process of its own: if they wait for each other, all of Python stops."""
    done = subprocess.run([sys.executable, "-c", TWO_THREADS], capture_output=True, text=True, timeout=30, check=True)
    assert done.stdout == "done\n"


def test_a_hand_that_is_seen_elsewhere_after_one_unseen_frame_glides_there() -> None:
    """As of the page of a headset that recentres: frames of 72 Hz, one without the hand, and all is 0.3 m aside."""
    tracker = mocap.HandTracker("right")
    turns, radii = np.tile([1.0, 0, 0, 0], (6, 1)), np.full(6, 0.007)

    def push(time: float, x: float, *, seen: bool = True) -> None:
        places = np.tile([x, 0.0, 0.0], (6, 1))
        tracker.push(mocap.HandFrame("right", places, turns, radii, [seen] * 6, time=time, arrival=time))

    due, places = 0, []
    # It is believed after 0.1 s, and then glides for 0.6 s.
    for now in np.arange(0.0, 2.5, 1e-3):
        while due / 72 <= now:
            push(due / 72, 0.0 if due < 72 else 0.3)
            if due == 71:
                push(due / 72 + 1e-6, 0.0, seen=False)
            due += 1
        targets = tracker.sample(now)
        assert targets is not None
        places.append(targets.positions[:, 0])
    fastest = np.abs(np.diff(places, axis=0)).max() / 1e-3
    assert fastest <= 1.001 * FASTEST[0], f"{fastest} m/s"
    assert places[-1] == pytest.approx(0.3, abs=1e-3)


def test_takes_are_written_read_and_gone_on_with(tmp_path: Path) -> None:
    take = mocap.Take.pinch(seed=2, rate=30.0)
    for name in ("a.take", "a.take.gz"):
        take.write(tmp_path / name)
        again = mocap.Take.read(tmp_path / name)
        assert len(again) == len(take) == 300
        assert [p.data for p in again.packets] == [p.data for p in take.packets]
        assert again.arrivals == pytest.approx(take.arrivals, abs=1e-6)
    with mocap.TakeWriter(tmp_path / "a.take", append=True) as writer:
        writer.note("take 1")
        writer.note("packet 1 of 2")
        writer.packet(0.0, b"fr 1\r\n")
        with pytest.raises(InvalidValueError, match="arrival"):
            writer.packet(1e7, b"fr 2\r\n")
    with pytest.raises(InvalidValueError, match="closed"):
        writer.note("too late")
    again = mocap.Take.read(tmp_path / "a.take")
    assert len(again) == 301
    assert again.notes[-2:] == ["take 1", "packet 1 of 2"]
    assert mocap.Take.pinch(seed=1).packets[5].data == mocap.shipped_take().packets[5].data, "the shipped take is the one that is made"
    with pytest.raises(CaptureFileError, match="mocap record"):
        mocap.Take.read(tmp_path / "none.take")


def test_contents_of_the_shipped_take() -> None:
    found = contents(mocap.shipped_take())
    assert (found["packets"], found["lost"], found["damaged"]) == (600, 0, 0)
    assert found["rate_hz"] == pytest.approx(60.0, rel=1e-3)
    assert found["tracker_rate_hz"] == pytest.approx(60.0, rel=1e-3)
    (hand,) = found["hands"]
    assert (hand["side"], hand["fingers"], hand["seen"]) == ("right", ["thumb", "index", "middle"], 1.0)
    ((start, end),) = hand["losses_s"]["middle"]
    assert (start, end) == pytest.approx((3.3, 3.5), abs=0.02)


def test_hand_frame_from_arrays_goes_through_a_tracker() -> None:
    positions = np.full((6, 3), np.nan)
    positions[1] = (0.1, 0.2, 0.3)
    quaternions = np.full((6, 4), np.nan)
    quaternions[1] = (1, 0, 0, 0)
    radii = np.full(6, 0.007)
    tracked = [False, True, False, False, False, False]
    frame = mocap.HandFrame("left", positions, quaternions, radii, tracked, time=5.0, arrival=1.0)
    assert (frame.side, frame.source, frame.frame) == ("left", "webxr", "tracker")
    assert list(frame.tracked) == tracked
    quarter = mocap.Calibration((1, 0, 0), (np.sqrt(0.5), 0, 0, np.sqrt(0.5)))
    assert frame.transformed(quarter).positions[1] == pytest.approx([0.8, 0.1, 0.3])
    assert frame.transformed(quarter).frame == "world"
    tracker = mocap.HandTracker("left", calibration=quarter, delay=0.0)
    tracker.push(frame)
    targets = tracker.sample(1.0)
    assert targets is not None
    assert targets.positions[1] == pytest.approx([0.8, 0.1, 0.3])
    with pytest.raises(InvalidShapeError, match="tracked"):
        mocap.HandFrame("left", positions, quaternions, radii, [True], time=0.0, arrival=0.0)
    with pytest.raises(InvalidShapeError, match=r"positions: expected shape \(6, \.\.\.\)"):
        mocap.HandFrame("left", [[1, 2, 3]], quaternions, radii, tracked, time=0.0, arrival=0.0)
    with pytest.raises(InvalidValueError, match="finite numbers"):
        mocap.HandFrame("left", positions, quaternions, radii, [True] + tracked[1:], time=0.0, arrival=0.0)
    with pytest.raises(InvalidValueError, match="one tracker for each hand"):
        mocap.HandTracker("right").push(frame)


def test_calibration_file_and_touches(tmp_path: Path) -> None:
    truth = mocap.Calibration((0.3, -0.2, 1.1), (0.9, 0.1, -0.3, 0.2))
    truth.write(tmp_path / "lab.toml")
    read = mocap.Calibration.read(tmp_path / "lab.toml")
    assert read.position == pytest.approx(truth.position)
    assert read.quaternion == pytest.approx(truth.quaternion)
    world = np.array([[0, 0, 0], [0.3, 0, 0], [0.05, 0.2, 0], [0, 0, 0.1]])
    w, v = truth.quaternion[0], truth.quaternion[1:]
    # p = R^T (x - t), R^T by the conjugate quaternion (Rodrigues)
    x = world - truth.position
    tracker = x + 2 * np.cross(-v, np.cross(-v, x) + w * x)
    fitted = mocap.Calibration.from_points(tracker, world)
    assert fitted.position == pytest.approx(truth.position, abs=1e-9)
    assert fitted.residual == pytest.approx(0.0, abs=1e-9)
    # Touched with a pad of 8 mm: centres are 8 mm above the table.
    lifted = x + [0, 0, 0.008]
    touched = lifted + 2 * np.cross(-v, np.cross(-v, lifted) + w * lifted)
    found = calibration_from_touches(*touched[:3], 0.008)
    assert found.position == pytest.approx(truth.position, abs=1e-9)
    (tmp_path / "bad.toml").write_text("translation = [0, 0]\n")
    with pytest.raises(InvalidValueError, match="calibration: expected TOML"):
        mocap.Calibration.read(tmp_path / "bad.toml")


def test_bodies_on_fingers_by_text_and_by_file(tmp_path: Path) -> None:
    packet = mocap.Packet.parse(f"fr 7\r\n6d 1 [2 1.000][100 200 -300]{EYE}\r\n".encode())
    hand = mocap.HandDecoder("left", bodies="index=2,thumb=1").decode(packet)
    assert hand is not None
    assert list(hand.tracked[:2]) == [False, True]
    assert hand.source == "dtrack-bodies"
    file = tmp_path / "bodies.toml"
    file.write_text('side = "left"\n[index]\nbody = 2\nposition = [0.0, 0.0, -0.01]\n')
    hand = mocap.HandDecoder("left", bodies=str(file)).decode(packet)
    assert hand is not None
    assert hand.positions[1] == pytest.approx([0.1, 0.2, -0.31])
    with pytest.raises(InvalidValueError, match="thumb=0"):
        mocap.HandDecoder("left", bodies="toe=1")


def test_bad_input_says_what_was_expected() -> None:
    with pytest.raises(UnknownNameError, match="left or right"):
        mocap.HandDecoder("both")  # type: ignore[arg-type]
    with pytest.raises(InvalidValueError, match="GROUP:PORT"):
        mocap.Receiver("nonsense:x")
    with pytest.raises(InvalidValueError, match="IPv4"):
        mocap.Receiver("0", bind="here")
    with listen() as receiver, pytest.raises(NetworkError, match="another program"):
        mocap.Receiver(str(receiver.address[1]), bind=LOCAL)
    with listen() as receiver, pytest.raises(InvalidValueError, match="timeout"):
        receiver.wait(float("nan"))
    with pytest.raises(InvalidValueError, match="hold"):
        mocap.HandTracker("left", hold=-1.0)
    with pytest.raises(InvalidValueError, match="now"):
        mocap.HandTracker("left").sample(float("inf"))
    with pytest.raises(InvalidValueError, match="speed"):
        mocap.Replay(mocap.shipped_take(), ["1.2.3.4:5"], speed=0.0)


def test_whole_numbers_out_of_range_are_typed_errors(tmp_path: Path) -> None:
    take, here = mocap.shipped_take(), ["127.0.0.1:9"]
    for rounds in (-1, 5_000_000_000):
        with pytest.raises(InvalidValueError, match="rounds: expected a whole number from 0 to 4294967295"):
            mocap.Replay(take, here, rounds=rounds)
    with pytest.raises(InvalidValueError, match="source_port: expected a whole number from 0 to 65535"):
        mocap.Replay(take, here, source_port=70_000)
    with pytest.raises(InvalidValueError, match="controller_port"):
        mocap.Receiver("0", bind=LOCAL, controller_port=99_999)
    with pytest.raises(InvalidValueError, match="max_bytes"):
        mocap.Receiver("0", bind=LOCAL, max_bytes=-1)
    with pytest.raises(InvalidValueError, match="seed"):
        mocap.Take.pinch(seed=-1)
    turns, tracked = np.tile([1.0, 0, 0, 0], (6, 1)), [True] * 6
    with pytest.raises(InvalidShapeError, match="pad_radii: expected numbers"):
        mocap.HandFrame("left", np.zeros((6, 3)), turns, ["wide"] * 6, tracked, time=0.0, arrival=0.0)


def test_a_group_is_joined_by_one_interface() -> None:
    with pytest.raises(InvalidValueError, match="interface"):
        mocap.Receiver("225.1.1.1:0", bind=LOCAL, interface="127.0.0.2")
