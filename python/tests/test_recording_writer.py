"""The thread that writes recordings: nothing is lost or out of order, errors reach the caller, the caller waits when the disk cannot
follow.
"""

import itertools
import os
import subprocess
import sys
import textwrap
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_recording import COLUMNS, check, row

from quasirigid.errors import InvalidShapeError, InvalidValueError, QuasirigidError, RecordingError
from quasirigid.recording.reader import Column, Recording
from quasirigid.recording.recorder import Recorder
from quasirigid.recording.writer import WAITING, PackedColumn


def child(program: str, *arguments: str, **kept: Any) -> "subprocess.CompletedProcess[str]":
    """Run a program in a process of its own."""
    env = {**os.environ, "PYTHONPATH": str(Path(__file__).parent)}
    command = [sys.executable, "-c", textwrap.dedent(program), *arguments]
    return subprocess.run(command, env=env, capture_output=True, text=True, timeout=120, check=False, **kept)


@settings(max_examples=60, deadline=None)
@given(
    kind=st.sampled_from(["f8", "f4", "u1", "i2", "u4", "i8", "S32"]),
    shape=st.sampled_from([(), (1,), (3,), (4, 3), (0,), (0, 3)]),
    chunk=st.integers(1, 7),
    apart=st.booleans(),
    parts=st.lists(st.integers(0, 30), max_size=6),
)
def test_chunks_made_here_are_what_hdf5_expects(kind: str, shape: tuple[int, ...], chunk: int, apart: bool, parts: list[int]) -> None:
    rng = np.random.default_rng(0)
    rows = [(rng.integers(-1e6, 1e6, (n, *shape))).astype("i8").astype(kind) for n in parts]
    with h5py.File("in memory", "w", driver="core", backing_store=False) as file:
        chunks = (chunk, *(1 if apart else max(1, n) for n in shape))
        maxshape = (None, *(n or None for n in shape))
        data = file.create_dataset("d", (0, *shape), kind, maxshape=maxshape, chunks=chunks, compression="gzip", shuffle=True)
        column = PackedColumn(data)
        for some in rows:
            column.extend(some)
            data.id.refresh()
        whole = np.concatenate([np.zeros((0, *shape), kind), *rows])
        np.testing.assert_array_equal(file["d"][:], whole)


def test_values_are_rounded_to_the_resolution_and_say_so(tmp_path: Path) -> None:
    path, exact = tmp_path / "r.h5", np.random.default_rng(1).normal(scale=1e-3, size=(500, 3))
    exact[0] = -1e-12
    with Recorder(path, [Column("time"), Column("g/x", (3,), "f4", "m", ragged=True, resolution=2.0**-30)]) as recorder:
        recorder.append({"time": 0.0, "g/x": exact})
    with Recording(path) as recording:
        back = recording["g/x"]
    np.testing.assert_array_equal(back, (np.round(exact.astype("f4").astype(float) * 2.0**30) * 2.0**-30).astype("f4"))
    assert not np.signbit(back[back == 0.0]).any(), "no -0"
    assert np.abs(back - exact).max() <= 2.0**-31 + np.spacing(np.abs(back).max()) / 2
    with h5py.File(path) as file:
        assert file["g/x"].attrs["resolution"] == 2.0**-30
    for wrong, kind in ((1e-9, "f4"), (-0.5, "f4"), (np.nan, "f4"), (2.0, "i4")):
        with pytest.raises(InvalidValueError, match="power of 2"):
            Recorder(tmp_path / "no.h5", [Column("time"), Column("g/x", (), kind, resolution=wrong)])


def test_arrays_may_be_reused_after_append(tmp_path: Path) -> None:
    mine = row(3)
    with Recorder(tmp_path / "r.h5", COLUMNS) as recorder:
        for i in range(230):
            new = row(i)
            mine["time"], mine["phase"] = new["time"], new["phase"]
            mine["object/position"][0] = i
            mine["contacts/point"] = np.resize(mine["contacts/point"], (i % 4, 3))
            mine["contacts/gap"] = np.resize(mine["contacts/gap"], i % 4)
            mine["contacts/point"][:], mine["contacts/gap"][:] = i, -float(i)
            recorder.append(mine)
            mine["contacts/point"][:], mine["contacts/gap"][:] = -7.0, -7.0
    assert check(tmp_path / "r.h5", 230) == 230


def slow(monkeypatch: pytest.MonkeyPatch, seconds: float) -> None:
    """A disk on which every column takes so long."""
    real = PackedColumn.store

    def store(self: PackedColumn, packed: Any) -> None:
        time.sleep(seconds)
        real(self, packed)

    monkeypatch.setattr(PackedColumn, "store", store)


def test_append_does_not_wait_for_a_slow_disk_until_too_many_blocks_wait(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    slow(monkeypatch, 0.02)
    recorder = Recorder(tmp_path / "r.h5", COLUMNS, block=10)
    for i in range(10 * WAITING):
        recorder.append(row(i))
    assert recorder.waited == 0.0
    until = time.monotonic() + 30.0
    while not (tmp_path / "r.h5").exists() and time.monotonic() < until:  # the first block
        time.sleep(0.01)
    with Recording(tmp_path / "r.h5") as so_far:
        assert so_far.steps < 10 * WAITING, "the disk was meant to be slow"
    for i in range(10 * WAITING, 10 * WAITING + 105):
        recorder.append(row(i))
    assert recorder.waited > 0.0, "more blocks than may wait: append had to"
    recorder.close()
    assert check(tmp_path / "r.h5", 10 * WAITING + 105) == 10 * WAITING + 105, "nothing is left out, nothing comes twice"


def test_interrupt_while_append_waits_loses_and_doubles_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    slow(monkeypatch, 0.02)
    steps = 0
    with pytest.raises(KeyboardInterrupt), Recorder(tmp_path / "r.h5", COLUMNS, block=1) as recorder:
        give = recorder._writer.give
        monkeypatch.setattr(recorder._writer, "give", lambda job: interrupted(give, job))

        def interrupted(give: Any, job: Any) -> None:
            give(job)
            if steps == 5:
                raise KeyboardInterrupt  # the moment after the block was handed over

        for i in range(100):
            steps = i
            recorder.append(row(i))
    assert check(tmp_path / "r.h5", 6) == 6


LIMITED = """
    import resource, sys
    from test_recording import COLUMNS, Recorder, row
    from quasirigid.errors import RecordingError
    resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))  # the disk is full then
    import numpy as np
    rng = np.random.default_rng(0)
    path, how = sys.argv[1:]
    recorder = Recorder(path, COLUMNS, block=100 if how == "append" else 5000)
    try:
        for i in range(2300):
            values = row(i)
            if i > 1000:
                values["contacts/point"] = rng.normal(size=(200, 3))
                values["contacts/gap"] = rng.normal(size=200)
            recorder.append(values)
        recorder.close()
    except RecordingError as error:
        print(error)
        for again in (lambda: recorder.append(row(0)), recorder.flush):
            try:
                again()
            except RecordingError:
                print("again")
        if how == "append":
            recorder.__exit__(RecordingError, error, None)  # else it is forgotten
"""


@pytest.mark.parametrize("how", ["append", "close"])
def test_full_disk_is_told_and_what_was_written_stays(tmp_path: Path, how: str) -> None:
    path = tmp_path / "full.h5"
    done = child(LIMITED, str(path), how)
    assert done.returncode == 0, done.stderr
    first, *rest = done.stdout.splitlines()
    assert "full.h5: expected a file that can be written, got File too large; free some space on the disk" in first
    assert rest == ["again", "again"], done.stdout
    if how == "close":  # no block was on disk
        assert list(tmp_path.iterdir()) == []
        return
    with Recording(path) as recording:
        assert not recording.complete
        np.testing.assert_array_equal(recording["time"], 1e-3 * np.arange(recording.steps))
        assert recording.steps >= 1000
        np.testing.assert_array_equal(recording.rows("contacts", 999)["gap"], np.full(3, -999.0))


def test_places_that_cannot_be_written_are_refused_at_once(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no directory")
    (tmp_path / "directory.h5").mkdir()
    for path in (tmp_path / "file" / "r.h5", tmp_path / "directory.h5"):
        with pytest.raises(RecordingError, match="can be written") as told:
            Recorder(path, COLUMNS)
        assert isinstance(told.value, QuasirigidError)
        assert isinstance(told.value, OSError)
    with Recorder(tmp_path / "twice.h5", COLUMNS), pytest.raises(RecordingError):
        Recorder(tmp_path / "twice.h5", COLUMNS)


@pytest.mark.parametrize(
    ("name", "value", "error"),
    [
        ("object/position", [1.0, 2.0], InvalidShapeError),
        ("object/position", 5.0, InvalidShapeError),
        ("object/position", None, InvalidShapeError),
        ("object/position", [[1.0], [1.0, 2.0], 3.0], InvalidShapeError),
        ("time", "now", InvalidShapeError),
        ("time", None, InvalidShapeError),
        ("contacts/gap", 3.0, InvalidShapeError),
        ("contacts/gap", [None, None, None], InvalidShapeError),
        ("contacts/gap", np.zeros(2), InvalidShapeError),
        ("phase", 1.9, InvalidValueError),
        ("phase", float("nan"), InvalidValueError),
        ("phase", -1, InvalidValueError),
        ("phase", 300, InvalidValueError),
        ("phase", np.int64(300), InvalidValueError),
        ("contacts/number", [1, 2, 70_000], InvalidValueError),
        ("contacts/number", [1.0, 2.0, 3.0], InvalidValueError),
        ("word", "text", InvalidValueError),
        ("word", b"too long", InvalidValueError),
    ],
)
def test_rows_that_do_not_fit_are_refused_and_not_made_to(
    fitting: tuple[Recorder, dict[str, Any]], name: str, value: Any, error: type[QuasirigidError]
) -> None:
    recorder, good = fitting
    before = recorder.steps
    with pytest.raises(error, match=name):
        recorder.append({**good, name: value})
    with pytest.raises(InvalidShapeError, match=f"{name}: expected a value"):
        recorder.append({key: v for key, v in good.items() if key != name})
    assert recorder.steps == before
    recorder.append(good)


@pytest.fixture(scope="module")
def fitting(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Recorder, dict[str, Any]]]:
    path = tmp_path_factory.mktemp("run") / "r.h5"
    more = [Column("contacts/number", (), "i2", ragged=True), Column("word", (), "S4")]
    good = row(3) | {"contacts/number": np.array([7, -1, 32_000]), "word": b"four"}
    with Recorder(path, COLUMNS + more) as recorder:
        yield recorder, good
        steps = recorder.steps
    with Recording(path) as recording:
        assert recording["contacts/number"].tolist() == [7, -1, 32_000] * steps
        assert recording["word"].tolist() == [b"four"] * steps


def test_an_interrupt_wherever_a_block_is_handed_over_loses_and_doubles_nothing(tmp_path: Path) -> None:
    path = tmp_path / "r.h5"
    for at in itertools.count():
        lines = 0

        def trace(frame: FrameType, event: str, _: Any, at: int = at) -> Any:
            nonlocal lines
            if frame.f_code.co_name in ("_hand_over", "_give_ready") and event == "line":
                lines += 1
                if lines == at + 1:
                    raise KeyboardInterrupt
            return trace

        before = sys.gettrace()
        with Recorder(path, COLUMNS, block=3) as recorder:
            recorder.append(row(0))
            recorder.append(row(1))
            sys.settrace(trace)
            with suppress(KeyboardInterrupt):
                recorder.append(row(2))
            sys.settrace(before)
            for i in range(recorder.steps, 8):
                recorder.append(row(i))
        assert check(path, 8) == 8, f"interrupted before line {at + 1}"
        if lines <= at:
            break
    assert at > 8, "no line was interrupted"


def test_what_was_handed_over_is_written_when_nobody_closes(tmp_path: Path) -> None:
    program = """
        import sys
        from test_recording import COLUMNS, Recorder, row
        recorder = Recorder(sys.argv[1], COLUMNS)
        for i in range(1000):
            recorder.append(row(i))
    """
    done = child(program, str(tmp_path / "r.h5"))
    assert (done.returncode, done.stderr) == (0, "")
    check(tmp_path / "r.h5", 1000)


def test_threads_end_with_their_recording(tmp_path: Path) -> None:
    def writers() -> int:
        return sum(thread.name == "quasirigid-recording" for thread in threading.enumerate())

    before = writers()
    recorder = Recorder(tmp_path / "a.h5", COLUMNS)
    assert writers() == before + 1
    recorder.close()
    recorder.close()
    assert writers() == before
    forgotten = Recorder(tmp_path / "b.h5", COLUMNS)
    del forgotten
    assert writers() == before
