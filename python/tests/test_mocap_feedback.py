"""Feedback to the person, over loopback."""

from __future__ import annotations

import json
import re
import socket
from pathlib import Path

import numpy as np
import pytest

from quasirigid.errors import InvalidValueError
from quasirigid.grasp_options import GraspOptions
from quasirigid.mocap import Take, shipped_take
from quasirigid.mocap.feedback import Feedback, TfbSink
from quasirigid.mocap.look import Look
from quasirigid.mocap.options import MocapOptions
from quasirigid.mocap.session import run_mocap
from quasirigid.mocap.stream import TakeSource


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


def look(time: float, pressing: tuple[float, float, float]) -> Look:
    return Look(time, ("thumb", "index", "middle"), (0, 1, 2), np.zeros((3, 3)), np.array(pressing), np.zeros(3), "carry")


def test_thimbles_are_told_in_the_vendors_format() -> None:
    assert TfbSink().encode(look(0.0, (2.5, 0.0, 99.0))) == b"tfb 3 [0 0 1.0 0.500][0 1 1.0 0.000][0 2 1.0 1.000]\0"


def test_forces_and_slip_come_over_the_socket_at_the_rate_asked_for(tmp_path: Path) -> None:
    with listener() as ear, listener() as thimbles:
        sinks = [
            Feedback(f"udp:127.0.0.1:{ear.getsockname()[1]}", rate=25.0),
            Feedback(f"tfb:127.0.0.1:{thimbles.getsockname()[1]}", rate=25.0),
        ]
        whole = shipped_take()
        whole.write(tmp_path / "whole.take")
        text = (tmp_path / "whole.take").read_bytes()
        (tmp_path / "short.take").write_bytes(text[: text.index(b"# packet 3.0")])
        options = GraspOptions(points=6000, dt=0.004)
        run_mocap(options, MocapOptions(idle=0.3), TakeSource(Take.read(tmp_path / "short.take")), tmp_path, observers=sinks)
        told, felt = [json.loads(packet) for packet in heard(ear)], heard(thimbles)
        for sink in sinks:
            sink.close()
    seconds = told[-1]["time"] - told[0]["time"]
    assert abs((len(told) - 1) / seconds - 25.0) < 1.0, f"{len(told)} in {seconds} s"
    held = [line for line in told if line["time"] > 2.0 and line["fingers"]["thumb"]["pressing"] > 2.0]
    assert held, "the pinch presses with several newton"
    last = held[-1]["fingers"]
    assert last["thumb"]["force"][0] < -2.0, "the box pushes the thumb back, towards -x"
    assert last["index"]["force"][0] > 1.0
    assert {finger["state"] for line in told for finger in line["fingers"].values()} <= {"open", "stick", "slip"}
    assert len(felt) == len(told)
    assert all(re.fullmatch(rb"tfb 3 (\[0 [012] 1\.0 [01]\.\d{3}\]){3}\x00", line) for line in felt)


@pytest.mark.parametrize(
    "text", ["", "udp", "udp:127.0.0.1", "udp::9000", "udp:127.0.0.1:0", "udp:127.0.0.1:70000", "tcp:127.0.0.1:9000", "tfb:"]
)
def test_targets_that_are_none_are_refused(text: str) -> None:
    with pytest.raises(InvalidValueError, match="feedback"):
        Feedback(text)
    with pytest.raises(InvalidValueError, match="rate"):
        Feedback("udp:127.0.0.1:9", rate=float("nan"))
