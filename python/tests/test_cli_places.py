"""Where results go: what cannot be written is said in one line with the option that chooses another place, and nothing is lost by it."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from quasirigid.cli.app import main
from quasirigid.recording.reader import Recording


def test_the_live_view_replaces_a_recording_when_all_is_ready_and_closes_it_when_told_to_end(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "live.h5"
    path.write_text("of yesterday")
    command = ["view", "--no-browser", "--points", "500", "--record", str(path)]
    assert main([*command, "--port", "0"]) == 2
    assert capfd.readouterr().err.count("\n") == 1
    for seconds in ("nan", "inf", "-1"):
        assert main([*command, "--seconds", seconds]) == 2
        assert "'--seconds'" in capfd.readouterr().err
    assert main([*command, "--port", "8450", "--seconds", "0"]) == 0  # no step
    assert path.read_text() == "of yesterday"
    assert capfd.readouterr().out == ""

    def end() -> None:
        deadline = time.monotonic() + 60.0
        while time.monotonic() < deadline:
            time.sleep(0.05)
            if path.read_bytes()[:4] == b"\x89HDF":
                with Recording(path) as so_far:
                    if so_far.steps:
                        break
        os.kill(os.getpid(), signal.SIGTERM)

    ending = threading.Thread(target=end)
    ending.start()
    code = main([*command, "--port", "8450", "--run"])
    ending.join()
    assert code == 143
    assert capfd.readouterr().out == f"{path}\n"
    with Recording(path) as recording:
        assert recording.complete


def test_figures_that_cannot_be_written_name_their_option(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "--json", str(tmp_path / "none" / "bench.json")]) == 2
    err = capfd.readouterr().err
    assert "No such file or directory; choose another with --json" in err
    assert err.count("\n") == 1


def test_a_reader_of_the_output_may_leave() -> None:
    with subprocess.Popen(
        [sys.executable, "-m", "quasirigid.cli", "materials"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        process.stdout.close()
        assert process.stderr is not None
        assert process.stderr.read() == ""
        assert process.wait(timeout=60) == 141
