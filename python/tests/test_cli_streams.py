"""How commands end: streams that were closed, readers who left, terminals that went, signals at any moment. Never a traceback, never a lost
file.
"""

import json
import os
import pty
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from recorded import record_pinch

from quasirigid.cli.running import Terminated, exit_code, terminable
from quasirigid.mocap import Take
from quasirigid.recording.reader import Recording

PROGRAM = [sys.executable, "-m", "quasirigid.cli"]
LIMIT = 120.0
QUICK = ["--points", "2000", "--dt", "0.005"]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("streams") / "run.h5"
    record_pinch(path, 5)
    return path


def shell(command: str) -> subprocess.CompletedProcess[str]:
    """What a shell makes of it; ``Q`` stands for the program."""
    line = command.replace("Q ", " ".join(PROGRAM) + " ")
    return subprocess.run(["bash", "-c", f"set -o pipefail; {line}"], capture_output=True, text=True, timeout=LIMIT, check=False)


@pytest.mark.parametrize(
    ("command", "code"),
    [
        ("Q materials >&-", 0),
        ("Q --help <&- >&- 2>&-", 0),
        ("Q mocap inspect --json 2>&- | grep -c hands", 0),
        ("Q no-such-command 2>&-", 2),
        ("Q mocap calibrate nowhere.toml -c 0 <&-", 2),
        ("Q mocap inspect --json | true", 141),
        ("Q materials | true", 141),
        ("Q --version >/dev/full", 2),
        ("Q materials 2>/dev/full", 0),
    ],
)
def test_streams_that_are_closed_or_full_end_no_command_with_a_traceback(command: str, code: int) -> None:
    if "/dev/full" in command and not Path("/dev/full").exists():
        pytest.skip("no /dev/full")
    done = shell(command)
    if code == 141:
        assert done.returncode in (0, 141), done  # the reader may have waited for all of it
        assert done.stderr == "", done
        return
    assert done.returncode == code, done
    assert "Traceback" not in done.stderr, done.stderr
    assert "Exception ignored" not in done.stderr, done.stderr
    if command.endswith(">/dev/full") and code == 2:
        assert "No space left on device" in done.stderr
        assert done.stderr.count("\n") == 1


def test_files_are_written_whole_when_all_streams_are_closed(tmp_path: Path, recording: Path) -> None:
    """A stream that is closed leaves its number to the next file: what is printed must not end up in there."""
    assert shell(f"Q export {recording} --csv {tmp_path / 'as-ever'}").returncode == 0
    assert shell(f"Q export {recording} --csv {tmp_path / 'closed'} <&- >&- 2>&-").returncode == 0
    names = sorted(path.name for path in (tmp_path / "as-ever").iterdir())
    assert names == sorted(path.name for path in (tmp_path / "closed").iterdir())
    for name in names:
        assert (tmp_path / "closed" / name).read_bytes() == (tmp_path / "as-ever" / name).read_bytes(), name
    path = tmp_path / "live.h5"
    command = f"Q view --points 500 --run --seconds 0.5 --no-browser --port 8555 --record {path}"
    assert shell(f"{command} <&- >&- 2>&-").returncode == 0
    with Recording(path) as written:
        assert written.complete
        assert written.steps > 0


def hung_up(arguments: list[str], until: Path, size: int, *, signals: int = 1) -> int:
    """Exit code of the program in a terminal that is closed when the file ``until`` has grown to ``size`` bytes."""
    child, terminal = pty.fork()
    if child == 0:  # pragma: no cover
        os.execv(PROGRAM[0], [*PROGRAM, *arguments])
    end = time.monotonic() + LIMIT
    os.set_blocking(terminal, False)
    while not (until.exists() and until.stat().st_size >= size) and time.monotonic() < end:
        time.sleep(0.05)
        with suppress(OSError):  # nothing said
            os.read(terminal, 65536)
    os.close(terminal)
    for _ in range(signals - 1):  # a shell that goes sends another one
        time.sleep(0.02)
        os.kill(child, signal.SIGHUP)
    while time.monotonic() < end:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.05)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    pytest.fail("the program went on without a terminal")


def test_a_terminal_that_is_closed_ends_a_grasp_with_its_recording_and_a_summary(tmp_path: Path) -> None:
    recorded = tmp_path / "recording.h5"
    code = hung_up(["grasp", *QUICK, "--hold", "1000", "--out", str(tmp_path)], recorded, 1_000_000, signals=3)
    assert code == 129
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["interrupted"] is True
    with Recording(recorded) as recording:
        assert recording.steps == summary["steps"] > 0


def test_a_terminal_that_is_closed_ends_a_live_view_with_its_recording(tmp_path: Path) -> None:
    path = tmp_path / "live.h5"
    command = ["view", "--no-browser", "--points", "500", "--run", "--record", str(path), "--port", "8550"]
    assert hung_up(command, path, 300_000, signals=2) == 129
    with Recording(path) as recording:
        assert recording.complete
        assert recording.steps > 0


def test_what_lasts_until_it_is_told_to_end_says_by_its_exit_code_who_told_it(tmp_path: Path) -> None:
    take = tmp_path / "x.take"
    ends = {signal.SIGINT: 0, signal.SIGTERM: 143, signal.SIGHUP: 129}
    command = [*PROGRAM, "mocap", "record", "TAKE", "-c", "0", "--bind", "127.0.0.1", "--json", "--force"]
    running = {
        number: subprocess.Popen(
            [str(take) + str(number) if word == "TAKE" else word for word in command],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for number in ends
    }
    for number, process in running.items():
        with process:
            assert process.stderr is not None
            process.stderr.readline()
            time.sleep(0.2)
            process.send_signal(number)
            out, err = process.communicate(timeout=LIMIT)
            assert process.returncode == ends[number], err
            assert json.loads(out)["recorded"] == 0, "the figures are printed all the same"
            assert "Traceback" not in err


class Fallen:
    """Python drops what is raised while it takes this away."""

    def __init__(self, number: int) -> None:
        self.number = number

    def __del__(self) -> None:
        os.kill(os.getpid(), self.number)
        for _ in range(100):
            time.sleep(0.001)  # the handler runs in here


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_that_comes_where_python_drops_exceptions_is_not_lost(number: int) -> None:
    with pytest.raises(KeyboardInterrupt) as stopped, terminable():
        fallen = Fallen(number)
        del fallen
        end = time.monotonic() + 10.0
        while time.monotonic() < end:
            time.sleep(0.01)
    assert exit_code(stopped.value) == 128 + number


def test_a_second_signal_does_not_disturb_the_closing_of_files_and_an_ignored_one_stays_ignored() -> None:
    closed = False
    with pytest.raises(Terminated), terminable() as ending:
        try:
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(1.0)
        finally:
            os.kill(os.getpid(), signal.SIGHUP)
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(0.05)
            closed = True
    assert closed
    assert ending.stop is not None
    assert ending.stop.number == signal.SIGTERM
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
    try:
        with terminable() as ending:
            os.kill(os.getpid(), signal.SIGHUP)
            time.sleep(0.05)
        assert ending.stop is None
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_take_is_kept_when_the_terminal_of_its_recorder_is_closed(tmp_path: Path) -> None:
    """Everything that is said then fails, too."""
    path = tmp_path / "kept.take"
    sender = subprocess.Popen(
        [*PROGRAM, "mocap", "replay", "--rounds", "0", "--to", "127.0.0.1:5994", "--source-port", "0"], stderr=subprocess.DEVNULL
    )
    try:
        assert hung_up(["mocap", "record", str(path), "-c", "5994", "--bind", "127.0.0.1"], path, 10_000) == 129
    finally:
        sender.kill()
        sender.wait()
    assert len(Take.read(path)) > 5
