"""Feedback to the person, over loopback."""

from __future__ import annotations

import json
import re
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets import ConnectionClosed, InvalidStatus, Origin
from websockets.sync.client import connect

from quasirigid.errors import InvalidValueError, NetworkError
from quasirigid.grasp.options import GraspOptions
from quasirigid.mocap import Take, shipped_take
from quasirigid.mocap.feedback import TFB_PORT, Raster, TfbSink, UdpFeedback
from quasirigid.mocap.feedback_server import LISTENERS, WebsocketFeedback
from quasirigid.mocap.feedback_targets import open_feedback
from quasirigid.mocap.observation import Observation
from quasirigid.mocap.options import MocapOptions
from quasirigid.mocap.session import OBSERVED, observation_interval, run_mocap
from quasirigid.mocap.source import TakeSource


def listener() -> socket.socket:
    ear = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    ear.bind(("127.0.0.1", 0))
    ear.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 21)
    ear.settimeout(0.5)
    return ear


def heard(ear: socket.socket) -> list[bytes]:
    out = []
    try:
        while True:
            out.append(ear.recv(65_536))
    except TimeoutError:
        return out


def look(time: float, pressing: tuple[float, float, float]) -> Observation:
    return Observation(
        time=time,
        fingers=("thumb", "index", "middle"),
        rows=(0, 1, 2),
        force=np.zeros((3, 3)),
        pressing=np.array(pressing),
        slipping=np.zeros(3),
        phase="carry",
        torque=np.zeros((3, 3)),
        contact_point=np.full((3, 3), np.nan),
        object_pose=np.array([0.0, 0.0, 0.04, 1.0, 0.0, 0.0, 0.0]),
        wall_time=1.7e9 + time,
    )


def test_thimbles_are_told_in_the_vendors_format() -> None:
    pressed = look(0.0, (2.5, 0.0, 99.0))
    assert TfbSink().encode(pressed) == b"tfb 3 [0 0 1.0 0.500][0 1 1.0 0.000][0 2 1.0 1.000]\0"
    assert TfbSink().encode(replace(pressed, hand=1)) == b"tfb 3 [1 0 1.0 0.500][1 1 1.0 0.000][1 2 1.0 1.000]\0"
    assert TfbSink(hand=2).farewell(replace(pressed, hand=1)) == b"tfb 3 [2 0 1.0 0.000][2 1 1.0 0.000][2 2 1.0 0.000]\0"
    for text, port, hand in (("tfb:127.0.0.1", TFB_PORT, 0), ("tfb:127.0.0.1:9/12", 9, 12), ("tfb:127.0.0.1/3", TFB_PORT, 3)):
        sink = open_feedback(text)
        assert isinstance(sink, UdpFeedback)
        assert sink.address == ("127.0.0.1", port)
        assert sink.sink.encode(pressed).startswith(f"tfb 3 [{hand} 0 ".encode())
        sink.close()


def test_a_force_that_is_no_number_stops_nobody() -> None:
    broken = replace(look(0.0, (1.0, 2.0, 3.0)), force=np.full((3, 3), np.nan))
    for text in ("udp:127.0.0.1:9", f"ws:{free_port()}"):
        sink = open_feedback(text)
        assert isinstance(sink, (UdpFeedback, WebsocketFeedback))
        sink(broken)
        assert sink.failed == 1
        sink.close()
        sink.close()
        if isinstance(sink, WebsocketFeedback):
            sink(look(1.0, (1.0, 2.0, 3.0)))  # its thread has gone


def test_forces_and_slip_come_over_the_socket_at_the_rate_asked_for(tmp_path: Path) -> None:
    with listener() as ear, listener() as thimbles:
        sinks = [
            open_feedback(f"udp:127.0.0.1:{ear.getsockname()[1]}", rate=25.0),
            open_feedback(f"tfb:127.0.0.1:{thimbles.getsockname()[1]}", rate=25.0),
        ]
        whole = shipped_take()
        whole.write(tmp_path / "whole.take")
        text = (tmp_path / "whole.take").read_bytes()
        # As on a system with two hands, of which this is the second.
        short = text[: text.index(b"# packet 3.0")].replace(b"gl 1 [0 ", b"gl 1 [1 ")
        (tmp_path / "short.take").write_bytes(short)
        options = GraspOptions(points=6000, dt=0.004)
        run_mocap(options, MocapOptions(idle=0.3), TakeSource(Take.read(tmp_path / "short.take")), tmp_path, observers=sinks)
        told, felt = [json.loads(packet) for packet in heard(ear)], heard(thimbles)
        for sink in sinks:
            sink.close()
        ear.settimeout(0.05)
        thimbles.settimeout(0.05)
        ends = [json.loads(packet) for packet in heard(ear)]
        assert [end["type"] for end in ends] == 3 * ["end"], "datagrams get lost"
        assert {end["sequence"] for end in ends} == {len(told)}
        assert heard(thimbles) == 3 * [b"tfb 3 [1 0 1.0 0.000][1 1 1.0 0.000][1 2 1.0 0.000]\0"], "no thimble goes on after the end"
    assert [line["sequence"] for line in told] == list(range(len(told)))
    seconds = told[-1]["time"] - told[0]["time"]
    assert abs((len(told) - 1) / seconds - 25.0) < 1.0, f"{len(told)} in {seconds} s"
    held = [line for line in told if line["time"] > 2.0 and line["fingers"]["thumb"]["pressing"] > 2.0]
    assert held, "the pinch presses with several newton"
    last = held[-1]["fingers"]
    assert last["thumb"]["force"][0] < -2.0, "the box pushes the thumb back, towards -x"
    assert last["index"]["force"][0] > 1.0
    check_fields(held[-1])
    assert {finger["state"] for line in told for finger in line["fingers"].values()} <= {"open", "stick", "slip"}
    assert len(felt) == len(told)
    assert all(re.fullmatch(rb"tfb 3 (\[1 [012] 1\.0 [01]\.\d{3}\]){3}\x00", line) for line in felt)


def check_fields(line: dict[str, Any]) -> None:
    """Of a pinch of the box, while it is held: forces, where they act, what they twist, and when that was."""
    thumb, index = line["fingers"]["thumb"], line["fingers"]["index"]
    position = np.array(line["object"]["position"])
    assert np.linalg.norm(line["object"]["quaternion"]) == pytest.approx(1.0, abs=1e-6)
    # The pads lie on the faces at x = -30 and 30 mm of the box, about its middle, 24 mm apart.
    assert np.array(thumb["point"]) - position == pytest.approx([-0.03, 0.0, 0.0], abs=4e-3)
    assert np.array(index["point"]) - position == pytest.approx([0.03, 0.012, 0.0], abs=4e-3)
    # About the point where its force acts a pad of some millimetres is twisted by less than its friction over its own width.
    assert 0.0 < np.linalg.norm(thumb["torque"]) < thumb["pressing"] * 8e-3
    # The moments of all forces about the box's middle are in balance but for what the table holds, a lever of 30 mm of its weight.
    moment = sum(
        np.cross(np.array(finger["point"]) - position, finger["force"]) + finger["torque"]
        for finger in line["fingers"].values()
        if finger["point"] is not None
    )
    assert np.linalg.norm(moment) < 0.2 * 9.81 * 0.03, moment
    assert isinstance(line["tracker"]["frame"], int)
    assert line["tracker"]["time"] == pytest.approx(36_000.0, abs=60.0)
    assert abs(line["wall_time"] - time.time()) < 600.0
    assert line["type"] == "observation"


@pytest.mark.parametrize(
    "text",
    [
        "",
        "udp",
        "udp:127.0.0.1",
        "udp::9000",
        "udp:127.0.0.1:0",
        "udp:127.0.0.1:70000",
        "tcp:127.0.0.1:9000",
        "tfb:",
        "tfb:127.0.0.1/",
        "tfb:127.0.0.1/left",
        "tfb:127.0.0.1:9/-1",
        "udp:127.0.0.1:9000/1",
        "ws",
        "ws:",
        "ws:0",
        "ws:x",
        "ws::9001",
        "ws:127.0.0.1:",
    ],
)
def test_targets_that_are_none_are_refused(text: str) -> None:
    with pytest.raises(InvalidValueError, match="feedback"):
        open_feedback(text)
    with pytest.raises(InvalidValueError, match="rate"):
        open_feedback("udp:127.0.0.1:9", rate=float("nan"))


@pytest.mark.parametrize("host", ["300.1.1.1", "192.168.1..20", "x" * 64, "192.0.2.77"])
def test_an_address_that_is_none_is_said_to_be_so_at_once(host: str) -> None:
    """No number, no name that can be written, and one that no machine has (RFC 5737)."""
    with pytest.raises(InvalidValueError, match="address to listen on: expected one of this machine's"):
        WebsocketFeedback(f"ws:{host}:9123")


@pytest.mark.parametrize("rate", [60.0, 150.0, 350.0, 600.0, 1000.0])
@pytest.mark.parametrize("dt", [1e-3, 2e-3, 4e-3])
def test_looks_come_at_the_rate_asked_for_as_far_as_steps_allow(rate: float, dt: float) -> None:
    raster, every, seconds = Raster(rate), observation_interval(max(OBSERVED, rate), dt), 10.0
    sent = sum(raster.due(step * dt) for step in range(0, round(seconds / dt), every))
    expected = min(rate, 1.0 / dt)
    assert sent / seconds == pytest.approx(expected, rel=2e-3), f"{sent / seconds} Hz of {expected}"


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


@pytest.fixture
def spoken() -> Iterator[WebsocketFeedback]:
    feedback = WebsocketFeedback(f"ws:{free_port()}", rate=1000.0)
    yield feedback
    feedback.close()


def url(feedback: WebsocketFeedback) -> str:
    return f"ws://127.0.0.1:{feedback.address[1]}"


def test_listeners_on_websockets_hear_what_goes_over_udp(tmp_path: Path) -> None:
    with listener() as ear:
        port = free_port()
        sinks = [open_feedback(f"udp:127.0.0.1:{ear.getsockname()[1]}", rate=25.0), open_feedback(f"ws:{port}", rate=25.0)]
        told: list[list[str]] = [[], []]

        def listen(lines: list[str]) -> None:
            with connect(f"ws://127.0.0.1:{port}") as socket:
                ready.release()
                lines.extend(str(line) for line in socket)

        ready = threading.Semaphore(0)
        ears = [threading.Thread(target=listen, args=(lines,)) for lines in told]
        for thread in ears:
            thread.start()
        for _ in ears:
            assert ready.acquire(timeout=20.0)
        for k in range(50):
            for sink in sinks:
                sink(look(0.04 * k, (0.1 * k, 0.0, 1.0)))
            time.sleep(0.01)
        over_udp = [packet.decode() for packet in heard(ear)]
        for sink in sinks:
            sink.close()
        for thread in ears:
            thread.join(timeout=20.0)
            assert not thread.is_alive(), "the end of the session ends the connection"
    assert len(over_udp) == 50
    for lines in told:
        # A listener that is busy misses some; what it hears is the same, in order, and the newest is always among it.
        assert len(lines) > 10, len(lines)
        assert [line for line in over_udp if line in lines] == lines[:-1]
        assert json.loads(lines[-1])["type"] == "end", "the end is said, to whoever listens"
        assert json.loads(lines[-1])["sequence"] == 50
        assert lines[-2] == over_udp[-1]
    assert sinks[1].story().endswith("2 listeners")


def test_a_listener_that_takes_nothing_holds_nobody_up(spoken: WebsocketFeedback) -> None:
    with connect(url(spoken)) as good, socket.create_connection(("127.0.0.1", spoken.address[1])) as bad:
        # The handshake, and then nothing is read any more: the buffers fill.
        bad.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        key = "dGhlIHNhbXBsZSBub25jZQ=="
        head = f"GET / HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: {key}\r\n"
        bad.sendall(f"{head}Sec-WebSocket-Version: 13\r\n\r\n".encode())
        last, end = 0.0, time.monotonic() + 60.0
        while spoken.listeners < 2 and time.monotonic() < end:
            time.sleep(0.01)

        def tell() -> None:
            for k in range(20_000):
                spoken(look(1e-3 * k, (1.0, 2.0, 3.0)))
            spoken(look(100.0, (1.0, 2.0, 3.0)))

        # Some megabytes: whoever waited for the one that reads nothing would wait for ever.
        telling = threading.Thread(target=tell, daemon=True)
        telling.start()
        telling.join(timeout=60.0)
        assert not telling.is_alive(), "the session waits for a listener"
        while last < 100.0 and time.monotonic() < end:
            last = json.loads(good.recv(timeout=20.0))["time"]
        assert last == 100.0, "the other listener hears the newest"
    began = time.monotonic()
    spoken.close()
    assert time.monotonic() - began < 9.0, "nor is the end held up"


def test_pages_from_elsewhere_may_not_listen(spoken: WebsocketFeedback) -> None:
    for origin in ("http://localhost:8000", "http://127.0.0.1"):
        connect(url(spoken), origin=Origin(origin)).close()
    for origin in ("https://example.org", "null", "http://127.0.0.1.example.org"):
        with pytest.raises(InvalidStatus, match="403"):
            connect(url(spoken), origin=Origin(origin))
    with connect(url(spoken)) as rude:
        rude.send("x" * 100_000)
        with pytest.raises(ConnectionClosed):
            rude.recv(timeout=20.0)
    with ExitStack() as many:
        for _ in range(LISTENERS):
            many.enter_context(connect(url(spoken)))
        with pytest.raises(InvalidStatus, match="503"):
            connect(url(spoken))
    with pytest.raises(NetworkError, match="port"):
        WebsocketFeedback(f"ws:{spoken.address[1]}")
