"""`quasirigid mocap` as a user meets it: processes that talk over the loopback, end with Ctrl-C, print JSON."""

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from rich.console import Console

from quasirigid import mocap
from quasirigid.cli import main
from quasirigid.mocap.tables import live_panel

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
    source = mocap.Take.pinch(seed=4)
    source.write(tmp_path / "source.take")
    copy = tmp_path / "copy.take"
    with command("record", str(copy), "-c", "0", "--bind", "127.0.0.1", "--json") as recorder:
        to = f"127.0.0.1:{port_of(recorder)}"
        options = ["--to", to, "--speed", "1", "--source-port", "0", "--json"]
        with command("replay", str(tmp_path / "source.take"), *options) as sender:
            out, err = sender.communicate(timeout=LIMIT)
            assert sender.returncode == 0, err
            assert json.loads(out)["sent"] == 600
        recorder.send_signal(signal.SIGINT)
        out, err = recorder.communicate(timeout=LIMIT)
        assert recorder.returncode == 0, err
        assert "stopped" in err
    figures = json.loads(out)
    assert (figures["recorded"], figures["lost"], figures["malformed"]) == (600, 0, 0)
    assert [p.data for p in mocap.Take.read(copy).packets] == [p.data for p in source.packets]


def test_monitor_shows_the_hand_and_ends_clean() -> None:
    with command("monitor", "-c", "0", "--bind", "127.0.0.1", "--seconds", "4") as monitor:
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


def test_calibrate_asks_for_three_touches(tmp_path: Path) -> None:
    """The hand rests on one point: three touches of it are no triangle, and that is what it says."""
    with command("calibrate", str(tmp_path / "lab.toml"), "-c", "0", "--bind", "127.0.0.1", stdin=subprocess.PIPE) as process:
        to = f"127.0.0.1:{port_of(process)}"
        resting = mocap.Take.pinch(noise=0.0, tremor=0.0)
        resting.write(tmp_path / "rest.take")
        text = (tmp_path / "rest.take").read_bytes()
        # Half a second of rest at the start, sent over and over.
        (tmp_path / "rest.take").write_bytes(b"".join(text.partition(b"# packet 0.4")[:1]))
        with mocap.Replay(mocap.Take.read(tmp_path / "rest.take"), [to], source_port=0, rounds=0):
            _, err = process.communicate("\n\n\n", timeout=LIMIT)
        assert process.returncode == 2
        assert "touch a point on its x axis" in err
        assert "second point: expected at least 0.01 m away" in err


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
    assert main(["grasp", "--mocap", f"take:{file}", "--points", "3000", "--out", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "never seen" in out
    assert "quasirigid mocap monitor" in " ".join(out.replace("│", " ").split())


@pytest.mark.parametrize("name", ["record", "replay", "inspect", "monitor", "calibrate"])
def test_help_has_examples(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["mocap", name, "--help"]) == 0
    text = capsys.readouterr().out
    assert "Examples" in text
    assert f"quasirigid mocap {name}" in text
