"""Recordings: what is appended comes back, whatever happened to the writer."""

import gc
import os
import re
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from quasirigid.errors import InvalidShapeError, RecordingError
from quasirigid.recording.reader import Column, Recording
from quasirigid.recording.recorder import Recorder

COLUMNS = [
    Column("time", unit="s", what="simulated time"),
    Column("phase", dtype="u1", labels=("close", "hold")),
    Column("object/position", (3,), unit="m", frame="world"),
    Column("contacts/point", (3,), "f4", "m", "world", ragged=True),
    Column("contacts/gap", (), "f4", "m", "-", ragged=True),
]


def row(i: int) -> dict[str, Any]:
    n = i % 4  # every fourth step has no contact
    return {
        "time": 1e-3 * i,
        "phase": i % 2,
        "object/position": [i, 0.0, 1.0],
        "contacts/point": np.full((n, 3), i, dtype=float),
        "contacts/gap": np.full(n, -float(i)),
    }


def check(path: Path, at_least: int) -> int:
    """Whatever is in the file is right, and there are enough steps."""
    with Recording(path) as recording:
        steps = recording.steps
        assert steps >= at_least
        np.testing.assert_array_equal(recording["time"], 1e-3 * np.arange(steps))
        np.testing.assert_array_equal(recording["object/position"][:, 0], np.arange(steps))
        assert len(recording["contacts/gap"]) == recording["contacts/end"][-1] == sum(i % 4 for i in range(steps))
        for i in (0, steps // 2, steps - 1, -1):
            contacts = recording.rows("contacts", i)
            k = i % steps
            np.testing.assert_array_equal(contacts["gap"], np.full(k % 4, -k))
            assert contacts["point"].shape == (k % 4, 3)
    return steps


@pytest.mark.parametrize("steps", [1, 99, 100, 250])
def test_what_is_appended_comes_back(tmp_path: Path, steps: int) -> None:
    path = tmp_path / "new" / "recording.h5"
    with Recorder(path, COLUMNS, {"object": "box"}) as recorder:
        for i in range(steps):
            recorder.append(row(i))
    assert check(path, steps) == steps
    with Recording(path) as recording:
        assert recording.complete
        assert recording.attributes["object"] == "box"
        assert recording.unit("object/position") == "m"
        assert recording.labels("phase") == ["close", "hold"]
    with h5py.File(path) as file:  # any tool opens a finished one
        for name in ("time", "phase", "object/position", "contacts/gap", "contacts/end"):
            assert {"unit", "frame", "what"} <= set(file[name].attrs)


def test_error_in_the_run_keeps_every_step(tmp_path: Path) -> None:
    path = tmp_path / "recording.h5"
    with pytest.raises(KeyboardInterrupt), Recorder(path, COLUMNS) as recorder:
        for i in range(137):
            recorder.append(row(i))
        raise KeyboardInterrupt
    assert check(path, 137) == 137
    with Recording(path) as recording:
        assert not recording.complete


def test_killed_run_leaves_a_readable_file(tmp_path: Path) -> None:
    program = f"""
        import sys; sys.path[:0] = {sys.path!r}
        from test_recording import COLUMNS, Recorder, row
        recorder = Recorder(sys.argv[1], COLUMNS)
        for i in range(10**9):
            recorder.append(row(i))
            if i == 1000:
                recorder.flush()
                print("go", flush=True)
                sys.stdin.readline()
    """
    env = {**os.environ, "PYTHONPATH": str(Path(__file__).parent)}
    pauses = (0.0, 0.013, 0.05, 0.2)
    paths = [tmp_path / f"{pause}.h5" for pause in pauses]
    command = [sys.executable, "-c", textwrap.dedent(program)]
    writers = [subprocess.Popen([*command, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=env) for path in paths]
    for pause, path, writer in zip(pauses, paths, writers, strict=True):
        with writer:
            assert writer.stdin is not None
            assert writer.stdout is not None
            assert writer.stdout.readline() == b"go\n"
            writer.stdin.write(b"on\n")
            writer.stdin.flush()
            time.sleep(pause)
            writer.send_signal(signal.SIGKILL)
            writer.wait()
        check(path, 1000)


def test_bad_rows_and_files_are_refused(tmp_path: Path) -> None:
    with Recorder(tmp_path / "recording.h5", COLUMNS) as recorder:
        with pytest.raises(InvalidShapeError, match="contacts"):
            recorder.append({**row(3), "contacts/gap": np.zeros(2)})
        with pytest.raises(InvalidShapeError, match="object/position"):
            recorder.append({k: v for k, v in row(3).items() if k != "object/position"})
        for i in range(5):
            recorder.append(row(i))
    assert check(tmp_path / "recording.h5", 5) == 5, "a refused row leaves nothing behind"
    with pytest.raises(RecordingError, match="no such file"):
        Recording(tmp_path / "none.h5")
    (tmp_path / "text.h5").write_text("hello")
    with pytest.raises(RecordingError, match="expected a recording"):
        Recording(tmp_path / "text.h5")


def test_stills_come_back_and_do_not_count_as_steps(tmp_path: Path) -> None:
    path = tmp_path / "recording.h5"
    stills = [Column("scene/points", (4, 3), "f4", "m", "world", still=True), Column("scene/never", (2,), still=True)]
    with Recorder(path, COLUMNS + stills) as recorder:
        for i in range(150):
            recorder.append(row(i))
        for values in ({"scene/points": np.zeros((5, 3))}, {"scene/other": 1.0}):
            with pytest.raises(InvalidShapeError):
                recorder.still(values)
        recorder.still({"scene/points": np.ones((4, 3))})
        with Recording(path) as recording:  # while the run goes on
            assert recording.stills("scene")["points"].sum() == 12.0
    assert check(path, 150) == 150
    with Recording(path) as recording:
        assert list(recording.stills("scene")) == ["points"]
        assert recording["scene/never"].shape == (0, 2)
        assert recording.unit("scene/points") == "m"


CUT = """
import sys, quasirigid as qr
for path in sys.argv[1:]:
    try:
        print(len(qr.Recording(path)["time"]))
    except qr.RecordingError as error:
        print(error)
"""


def test_a_file_that_was_cut_off_is_a_typed_error_and_hangs_nobody(tmp_path: Path) -> None:
    path = tmp_path / "recording.h5"
    with Recorder(path, COLUMNS) as recorder:
        for i in range(500):
            recorder.append(row(i))
        recorder.flush()
        killed = path.read_bytes()  # as kill -9 would leave it
        begun = int.from_bytes(killed[28:36], "little")
    finished = path.read_bytes()
    cases = {
        finished[: len(finished) // 2]: r"can be read, got [\d,]+ of [\d,]+ bytes; its end is missing",
        killed[: begun // 2]: "its end is missing",
        killed[: begun + 3000]: "checksum",
    }
    paths = [tmp_path / f"cut-{i}.h5" for i in range(len(cases))]
    for cut, content in zip(paths, cases, strict=True):
        cut.write_bytes(content)
    # In another process: it would hang inside HDF5, where no signal of Python's reaches it.
    done = subprocess.run([sys.executable, "-c", CUT, *map(str, paths)], capture_output=True, text=True, timeout=60, check=True)
    for message, told in zip(cases.values(), done.stdout.splitlines(), strict=True):
        assert re.search(message, told), done.stdout


def test_damaged_files_are_a_typed_error_wherever_they_are_read(tmp_path: Path) -> None:
    path = tmp_path / "recording.h5"
    with Recorder(path, COLUMNS) as recorder:
        for i in range(100):
            recorder.append(row(i))
    whole = path.read_bytes()
    with h5py.File(path) as file:
        chunks = {name: file[name].id.get_chunk_info(0) for name in ("time", "contacts/gap", "contacts/end")}
    for chunk in chunks.values():
        whole = whole[: chunk.byte_offset] + b"\0" * chunk.size + whole[chunk.byte_offset + chunk.size :]
    path.write_bytes(whole)
    with Recording(path) as recording:
        for read in (lambda: recording["time"], lambda: recording.row("time", 3), lambda: recording.rows("contacts", 3)):
            with pytest.raises(RecordingError, match=r"recording\.h5: (time|contacts/end): expected values that can be decompressed"):
                read()
        assert recording["phase"].tolist() == [0, 1] * 50


@pytest.mark.filterwarnings("error")
def test_a_recording_that_nobody_closes_leaves_no_file_open(tmp_path: Path) -> None:
    path = tmp_path / "recording.h5"
    with Recorder(path, COLUMNS) as recorder:
        recorder.append(row(0))
    before = len(os.listdir("/proc/self/fd")) if sys.platform == "linux" else 0
    forgotten: list[Any] = [Recording(path)]
    forgotten.append(forgotten)  # in a circle, which only the collector ends
    del forgotten
    gc.collect()
    if sys.platform == "linux":
        assert len(os.listdir("/proc/self/fd")) == before
