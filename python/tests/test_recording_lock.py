"""A recording has one writer, in any process, and those who read it are no hindrance to it."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path

import pytest
from test_recording import COLUMNS, check, row

from quasirigid.errors import InvalidValueError, RecordingError
from quasirigid.recording.reader import Column, Recording
from quasirigid.recording.recorder import Recorder

PROGRAM = """
import sys
from test_recording import COLUMNS, Recorder, Recording, row
mine = {}
for line in sys.stdin:
    print(eval(line), flush=True)
"""


class Other:
    """Another process, that does what it is told."""

    def __init__(self) -> None:
        env = {**os.environ, "PYTHONPATH": str(Path(__file__).parent)}
        self.process = subprocess.Popen(
            [sys.executable, "-c", PROGRAM], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1, env=env
        )

    def does(self, expression: str) -> str:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(expression + "\n")
        return self.process.stdout.readline().strip()


@pytest.fixture(scope="module")
def other() -> Iterator[Other]:
    process = Other()
    yield process
    process.process.kill()
    process.process.communicate()


def write(path: Path, steps: int) -> None:
    with Recorder(path, COLUMNS) as recorder:
        for i in range(steps):
            recorder.append(row(i))


@pytest.mark.parametrize("near", [False, True], ids=["in another process", "in both"])  # HDF5 has other rules for readers in the same one
def test_a_run_ends_well_while_others_read_its_recording(tmp_path: Path, other: Other, near: bool) -> None:
    path = tmp_path / "r.h5"
    with Recorder(path, COLUMNS) as recorder:
        for i in range(250):
            recorder.append(row(i))
        recorder.flush()
        assert other.does(f"mine.update(reader=Recording({str(path)!r})) or mine['reader'].steps") == "250"
        with Recording(path) if near else nullcontext():
            recorder.close(answer=42)
    assert check(path, 250) == 250
    with Recording(path) as recording:
        assert recording.complete
        assert recording.attributes["answer"] == 42
    assert other.does("mine['reader']['time'][-1]") == str(row(249)["time"])
    assert [file.name for file in tmp_path.iterdir()] == ["r.h5"]


def test_a_new_recording_leaves_the_old_one_to_those_who_read_it(tmp_path: Path, other: Other) -> None:
    path = tmp_path / "r.h5"
    write(path, 120)
    assert other.does(f"mine.update(reader=Recording({str(path)!r}))") == "None"
    write(path, 7)
    assert check(path, 7) == 7
    assert other.does("len(mine['reader']['time'])") == "120"


def test_a_recording_that_cannot_be_begun_leaves_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / "r.h5"
    write(path, 5)
    for attributes in ({"no HDF5": object()}, {"version": 7}, {"nul": "a\0b"}, {"half a character": "\ud800"}, {"deep": {"set": {1}}}):
        with pytest.raises(InvalidValueError, match="attribute"):
            Recorder(path, COLUMNS, attributes)
    again = (Column("time"), Column("x", dtype="O"), Column("x", dtype="S0"), Column("contacts/end"), Column("a//b"), Column("time/x"))
    for column in again:
        with pytest.raises(InvalidValueError, match="column"):
            Recorder(path, [*COLUMNS, Column("end/x", ragged=True), column])
    assert check(path, 5) == 5
    assert [file.name for file in tmp_path.iterdir()] == ["r.h5"]


def test_a_recording_replaces_the_old_one_with_its_first_steps(tmp_path: Path) -> None:
    path = tmp_path / "r.h5"
    write(path, 5)
    for end in (Recorder.discard, lambda recorder: recorder.__exit__(KeyboardInterrupt, KeyboardInterrupt(), None)):
        recorder = Recorder(path, COLUMNS)
        assert check(path, 5) == 5
        end(recorder)
        assert check(path, 5) == 5, "of a run without a step nothing stays"
    recorder = Recorder(path, COLUMNS)
    recorder.append(row(0))
    recorder.flush()
    assert check(path, 1) == 1
    recorder.discard()
    assert list(tmp_path.iterdir()) == []


def test_where_another_process_records_nobody_else_does_until_it_ends(tmp_path: Path, other: Other) -> None:
    path = tmp_path / "r.h5"
    begin = f"mine.update(w=Recorder({str(path)!r}, COLUMNS)) or [mine['w'].append(row(i)) for i in range(100)] and mine['w'].flush()"
    assert other.does(begin) == "None"
    for place in (path, tmp_path / "." / "r.h5"):
        with pytest.raises(RecordingError, match=r"r\.h5: expected a file that can be written, got one that is being recorded to; wait"):
            Recorder(place, COLUMNS)
    (tmp_path / "link.h5").symlink_to(path)
    with pytest.raises(RecordingError, match="being recorded to"):
        Recorder(tmp_path / "link.h5", COLUMNS)
    assert check(path, 100) == 100, "those who were refused did no harm"
    other.process.kill()
    other.process.communicate()
    write(path, 5)
    assert check(path, 5) == 5
    assert sorted(file.name for file in tmp_path.iterdir()) == ["link.h5", "r.h5"]
