"""`quasirigid mocap` as a user meets it: processes that talk over the loopback, end with Ctrl-C, print JSON."""

import itertools
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from hand_frames import part
from rich.console import Console

from quasirigid import mocap
from quasirigid.cli.app import main
from quasirigid.cli.mocap_tables import live_panel
from quasirigid.errors import InvalidValueError
from quasirigid.mocap.touch_calibration import calibration_from_touches

pytestmark = pytest.mark.realtime

LIMIT = 60.0


@contextmanager
def command(*arguments: str, stdin: int | None = subprocess.DEVNULL) -> Iterator[subprocess.Popen[str]]:
    environment = {**os.environ, "COLUMNS": "120", "PYTHONUNBUFFERED": "1"}
    line = [sys.executable, "-m", "quasirigid.cli", "mocap", *arguments]
    process = subprocess.Popen(line, stdin=stdin, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def port_of(process: subprocess.Popen[str]) -> str:
    """The port that it says it listens on."""
    assert process.stderr is not None
    line = process.stderr.readline()
    found = re.search(r"UDP [\d.]+:(\d+)", line)
    assert found, line
    return found[1]


def test_what_is_replayed_is_recorded_byte_for_byte(tmp_path: Path) -> None:
    source = part(tmp_path, mocap.Take.pinch(seed=4), until=1.5)
    source.write(tmp_path / "source.take")
    copy = tmp_path / "copy.take"
    with command("record", str(copy), "-c", "0", "--bind", "127.0.0.1", "--json") as recorder:
        to = f"127.0.0.1:{port_of(recorder)}"
        options = ["--to", to, "--speed", "1", "--source-port", "0", "--json"]
        with command("replay", str(tmp_path / "source.take"), *options) as sender:
            out, err = sender.communicate(timeout=LIMIT)
            assert sender.returncode == 0, err
            assert json.loads(out)["sent"] == 90
        recorder.send_signal(signal.SIGINT)
        out, err = recorder.communicate(timeout=LIMIT)
        assert recorder.returncode == 0, err
        assert "stopped" in err
    figures = json.loads(out)
    assert (figures["recorded"], figures["lost"], figures["malformed"]) == (90, 0, 0)
    assert [p.data for p in mocap.Take.read(copy).packets] == [p.data for p in source.packets]


def test_monitor_shows_the_hand_and_ends_clean() -> None:
    with command("monitor", "-c", "0", "--bind", "127.0.0.1", "--seconds", "1.5") as monitor:
        to = f"127.0.0.1:{port_of(monitor)}"
        with mocap.Replay(mocap.shipped_take(), [to], source_port=0, rounds=0):
            out, err = monitor.communicate(timeout=LIMIT)
        assert monitor.returncode == 0, err
    assert "right thumb" in out
    assert "Hz" in out
    with command("monitor", "-c", "0", "--bind", "127.0.0.1", "--json", "--every", "0.2") as monitor:
        port_of(monitor)
        assert monitor.stdout is not None
        assert json.loads(monitor.stdout.readline())["packets"] == 0
        monitor.send_signal(signal.SIGINT)
        monitor.communicate(timeout=LIMIT)
        assert monitor.returncode == 0


class Touching:
    """Sends a body on a fingertip to a port, at ``place`` (mm), a hundred times a second; ``unsteady`` by so much (mm)."""

    def __init__(self, port: int) -> None:
        self.place, self.unsteady = (0.0, 0.0, 0.0), 0.0
        self._port, self._ended = port, threading.Event()
        self._thread = threading.Thread(target=self._send)

    def _send(self) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            for number in itertools.count(1):
                x, y, z = self.place
                x += self.unsteady * (number % 2)
                body = f"[4 1.000][{x:.3f} {y:.3f} {z:.3f}][1 0 0 0 1 0 0 0 1]"
                out.sendto(f"fr {number}\r\n6d 1 {body}\r\n".encode(), ("127.0.0.1", self._port))
                if self._ended.wait(0.01):
                    return

    def __enter__(self) -> "Touching":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()


def test_calibrate_asks_for_three_touches_and_again_for_one_that_moved(tmp_path: Path) -> None:
    file = tmp_path / "lab.toml"
    options = ["-c", "0", "--bind", "127.0.0.1", "--bodies", "index=4"]
    with command("calibrate", str(file), *options, stdin=subprocess.PIPE) as process, Touching(int(port_of(process))) as finger:
        assert process.stdin is not None
        assert process.stderr is not None
        for wanted, place, unsteady in (
            ("the origin", (100.0, 200.0, 300.0), 0.0),
            ("a point on its x axis", (300.0, 200.0, 300.0), 30.0),
            ("a point on its x axis", (300.0, 200.0, 300.0), 0.0),
            ("on the side of +y", (180.0, 500.0, 300.0), 0.0),
        ):
            asked = process.stderr.readline()
            assert wanted in asked, asked
            finger.place, finger.unsteady = place, unsteady
            time.sleep(0.05)  # what was sent before has arrived
            process.stdin.write("\n")
            process.stdin.flush()
            found = process.stderr.readline()
            assert ("at rest within 5 mm" in found and "once more" in found) if unsteady else ("mm" in found), found
        out, err = process.communicate(timeout=LIMIT)
        assert process.returncode == 0, err
    assert "lab.toml: written" in out
    lab = mocap.Calibration.read(file)
    hand = mocap.HandDecoder("right", bodies="index=4").decode(mocap.Packet.parse(b"fr 1\n6d 1 [4 1][0 0 0][1 0 0 0 1 0 0 0 1]\n"))
    assert hand is not None
    # Touched was the plane one pad radius under the centres.
    assert lab.position == pytest.approx([-0.1, -0.2, -0.3 + hand.pad_radii[1]], abs=1e-6)
    assert abs(lab.quaternion[0]) == pytest.approx(1.0, abs=1e-9)


def test_touches_that_are_no_triangle_are_refused() -> None:
    with pytest.raises(InvalidValueError, match=r"second point: expected at least 0\.01 m away"):
        calibration_from_touches((0.1, 0.2, 0.3), (0.1, 0.2, 0.3), (0.1, 0.5, 0.3), 0.008)


def test_a_take_is_not_lost_by_recording_again(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Nothing comes here: a second recording would leave an empty file."""
    file = tmp_path / "reach.take"
    mocap.Take.pinch().write(file)
    recording = ["mocap", "record", str(file), "-c", "0", "--bind", "127.0.0.1", "--seconds", "0.05"]
    assert main(recording) == 2
    said = capsys.readouterr().err
    assert "--append" in said
    assert said.count("\n") == 1
    assert main([*recording, "--append", "--force"]) == 2
    assert len(mocap.Take.read(file)) == 600
    assert main([*recording, "--append"]) == 0
    assert len(mocap.Take.read(file)) == 600
    assert main([*recording, "--force"]) == 0
    assert "recorded" not in file.read_text(), "nothing was"


def test_inspect_prints_a_panel_or_json(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["mocap", "inspect"]) == 0
    shown = capsys.readouterr().out
    assert "thumb, index, middle" in shown
    assert "middle not seen" in shown
    assert main(["mocap", "inspect", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["packets"] == 600
    assert main(["mocap", "inspect", str(tmp_path / "none.take")]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert "mocap record" in err


FLYSTICK = b"""fr 1
ts 10.0
6dcal 1
6d 0
6df2 1 1 [0 1.000 6 2][10 20 30][1 0 0 0 1 0 0 0 1][5 0.5 -0.5]
3d 2 [1 1.000][1 2 3][2 1.000][4 5 6]
"""


def test_a_flystick_is_named_and_not_taken_for_a_hand(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "fly.take"
    file.write_bytes(FLYSTICK + FLYSTICK.replace(b"fr 1", b"fr 2").replace(b"ts 10.0", b"ts 10.02"))
    assert main(["mocap", "inspect", str(file), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["hands"], found["bodies"], found["other"]) == ([], [], {"flysticks": 1, "markers": 2})
    packet = mocap.Packet.parse(FLYSTICK)
    with mocap.Receiver("0", bind="127.0.0.1") as receiver:
        figures = receiver.statistics()
    console = Console(width=100)
    with console.capture() as shown:
        console.print(live_panel("here", figures, packet, [], 0.0))
    assert "flysticks     1, not used" in shown.get()
    assert "none seen, and no bodies" in shown.get()
    assert main(["mocap", "grasp", f"take:{file}", "--points", "3000", "--out", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "never seen" in out
    assert "there is no right hand in it" in " ".join(out.replace("│", " ").split())


@pytest.mark.parametrize("name", ["record", "replay", "inspect", "monitor", "calibrate"])
def test_help_has_examples(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["mocap", name, "--help"]) == 0
    text = capsys.readouterr().out
    assert "Examples" in text
    assert f"quasirigid mocap {name}" in text
