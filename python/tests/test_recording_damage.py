"""No file makes a reader of recordings hang, crash or fill the memory: it is read, or refused with a typed error."""

import os
import resource
import signal
import struct
import subprocess
import sys
import time
import zlib
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from recorded import record_pinch
from test_recording import COLUMNS, row

from quasirigid.cli.app import main
from quasirigid.errors import RecordingError
from quasirigid.recording import file as recording_file
from quasirigid.recording.reader import Recording
from quasirigid.recording.recorder import Recorder


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("short") / "run.h5"
    with Recorder(path, COLUMNS, {"object": "bäll", "labels of mine": ["a", "bcd"], "figures": np.arange(3.0)}) as recorder:
        for i in range(20):
            recorder.append(row(i))
    return path


def damage_heap(path: Path) -> None:
    """Damage the heap in which HDF5 keeps texts of variable length, so that libhdf5 looks for the end of it for ever.

    HDF5 File Format Specification 3.0, III.E: a collection begins with ``GCOL``; after 16 bytes come objects with a head of 16 bytes (index
    2, references 2, reserved 4, size 8), each padded to 8 bytes. Index 0 is the free space, whose size leads to the end: here it leads
    nowhere.
    """
    content = bytearray(path.read_bytes())
    at = content.index(b"GCOL") + 16
    while (head := struct.unpack_from("<HHIQ", content, at))[0]:
        at += 16 + (head[3] + 7) // 8 * 8
    struct.pack_into("<Q", content, at + 8, 0)
    path.write_bytes(content)


@pytest.fixture
def hanging(short: Path, tmp_path: Path) -> Path:
    """A recording as before version 3, with texts of variable length, damaged."""
    path = tmp_path / "hangs.h5"
    path.write_bytes(short.read_bytes())
    with h5py.File(path, "r+") as file:
        file.attrs["object"] = "a text of variable length"
        file.attrs["version"] = 2
    damage_heap(path)
    return path


def test_nothing_that_is_written_has_a_variable_length(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    record_pinch(path, 3)
    kinds: dict[str, h5py.h5t.TypeID] = {}
    with h5py.File(path) as file:
        items = {"": file}
        file.visititems(lambda name, item: items.update({name: item}))
        for name, item in items.items():
            kinds |= {f"{name}@{key}": item.attrs.get_id(key).get_type() for key in item.attrs}
            if isinstance(item, h5py.Dataset):
                kinds[name] = item.id.get_type()
    assert len(kinds) > 100, "what was looked at?"
    variable = [name for name, kind in kinds.items() if isinstance(kind, h5py.h5t.TypeVlenID) or kind.detect_class(h5py.h5t.VLEN)]
    texts = [name for name, kind in kinds.items() if isinstance(kind, h5py.h5t.TypeStringID) and kind.is_variable_str()]
    assert variable + texts == []
    assert b"GCOL" not in path.read_bytes(), "a heap of variable-length data"


def test_texts_come_back_whole(short: Path, tmp_path: Path) -> None:
    with Recording(short) as recording:
        found = recording.attributes
        assert (found["object"], found["labels of mine"], found["figures"].tolist()) == ("bäll", ["a", "bcd"], [0.0, 1.0, 2.0])
    long = {"empty": "", "long": "ü" * 50_000, "many": [f"body {i}" for i in range(20_000)]}
    with Recorder(tmp_path / "long.h5", COLUMNS, long) as recorder:
        recorder.close(told={"a": [1, 2]})
    with Recording(tmp_path / "long.h5") as recording:
        assert {name: recording.attributes[name] for name in long} == long
        assert recording.attributes["told"] == '{"a": [1, 2]}'


def test_recordings_of_version_2_with_texts_of_variable_length_still_open(short: Path, tmp_path: Path) -> None:
    path = tmp_path / "old.h5"
    path.write_bytes(short.read_bytes())
    with h5py.File(path, "r+") as file:
        file.attrs["version"] = 2
        file.attrs["format"] = "quasirigid-recording"
        file["phase"].attrs["labels"] = ["close", "hold"]
    with Recording(path) as recording:
        assert (recording.version, recording.steps, recording.labels("phase")) == (2, 20, ["close", "hold"])


def test_a_file_in_which_hdf5_hangs_is_refused_soon(
    hanging: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(recording_file, "CPU_SECONDS", 1)
    began = time.monotonic()
    with pytest.raises(RecordingError, match=r"hangs\.h5: expected a recording that can be read, got nothing: HDF5 hangs"):
        Recording(hanging)
    taken = time.monotonic() - began
    assert taken < 20.0, f"it took {taken:.1f} s"
    assert main(["export", str(hanging), "--csv", str(hanging.parent / "tables")]) == 2
    assert "HDF5 hangs" in capfd.readouterr().err


def test_the_time_limit_holds_where_the_process_cannot_be_limited(hanging: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording_file, "WALL_SECONDS", 2)
    with pytest.raises(RecordingError, match="got nothing from HDF5 in 2 s"):
        Recording(hanging)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_a_reader_hears_signals_while_hdf5_hangs(hanging: Path, number: signal.Signals, code: int) -> None:
    program = """
import sys
from quasirigid import cli
from quasirigid.recording import file as recording_file
recording_file.CPU_SECONDS = recording_file.WALL_SECONDS = 100
examine = recording_file.examine
recording_file.examine = lambda *arguments: (print("go", flush=True), examine(*arguments))
sys.exit(cli.main(sys.argv[1:]))
"""
    command = [sys.executable, "-c", program, "export", str(hanging), "--csv", str(hanging.parent / "tables")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as reader:
        assert reader.stdout is not None
        assert reader.stdout.readline() == b"go\n"
        time.sleep(1.0)
        assert reader.poll() is None, "it was meant to hang"
        began = time.monotonic()
        reader.send_signal(number)
        _, complaint = reader.communicate(timeout=60)
    assert reader.returncode == code, complaint.decode()
    assert time.monotonic() - began < 10.0, "deaf to the signal"
    assert b"Traceback" not in complaint, complaint.decode()


def links_out(file: h5py.File) -> None:
    file["time2"] = h5py.ExternalLink("/etc/passwd", "/time")


def links_within(file: h5py.File) -> None:
    file["time2"] = h5py.SoftLink("/time")


def is_virtual(file: h5py.File) -> None:
    layout = h5py.VirtualLayout(shape=(20,), dtype="f8")
    layout[:] = h5py.VirtualSource("elsewhere.h5", "time", shape=(20,))
    file.create_virtual_dataset("time2", layout)


def is_stored_elsewhere(file: h5py.File) -> None:
    file.create_dataset("time2", (20,), "f8", external=[("elsewhere.bin", 0, 160)])


def has_texts_of_variable_length(file: h5py.File) -> None:
    file.create_dataset("word", data=["a", "b"])


def has_another_filter(file: h5py.File) -> None:
    file.create_dataset("time2", data=np.arange(20.0), chunks=(20,), compression="lzf")


def declares_more_than_gzip_can_make(file: h5py.File) -> None:
    data = file.create_dataset("time2", (2**30,), "u1", chunks=(2**30,), compression="gzip")
    data.id.write_direct_chunk((0,), zlib.compress(bytes(1000)))


def has_few_chunks_for_many_rows(file: h5py.File) -> None:
    data = file.create_dataset("model/0/points", (2**40,), "f8", chunks=(10,), compression="gzip")
    data.attrs["rows"] = "constant: the same in every step"
    data.id.write_direct_chunk((0,), zlib.compress(bytes(80)))


def has_compound_rows(file: h5py.File) -> None:
    file.create_dataset("time2", (20,), [("a", "f8"), ("b", "i4")])


REFUSED: dict[Callable[[h5py.File], None], str] = {
    links_out: "time2: expected data in the file itself, got a link",
    links_within: "time2: expected data in the file itself, got a link",
    is_virtual: "time2: expected data in the file itself, got data in other files",
    is_stored_elsewhere: "time2: expected data in the file itself, got data in other files",
    has_texts_of_variable_length: "word: expected numbers, or texts of a fixed length, got texts of variable length",
    has_another_filter: "time2: expected no other filters than shuffle and gzip, got lzf",
    declares_more_than_gzip_can_make: "time2: expected .* bytes or fewer in a chunk of",
    has_few_chunks_for_many_rows: "column model/0/points: expected .* rows",
    has_compound_rows: "time2: expected numbers, or texts of a fixed length",
}


@pytest.mark.parametrize("change", REFUSED, ids=lambda change: change.__name__)
def test_what_no_recording_has_is_refused_by_name(short: Path, tmp_path: Path, change: Callable[[h5py.File], None]) -> None:
    path = tmp_path / "run.h5"
    path.write_bytes(short.read_bytes())
    with h5py.File(path, "r+") as file:
        change(file)
    with pytest.raises(RecordingError, match=REFUSED[change]) as refused:
        Recording(path)
    assert "run.h5" in str(refused.value)


def test_a_decompression_bomb_takes_no_memory(short: Path, tmp_path: Path) -> None:
    path = tmp_path / "bomb.h5"
    path.write_bytes(short.read_bytes())
    with h5py.File(path, "r+") as file:
        data = file.create_dataset("more", (20,), "f8", chunks=(20,), compression="gzip")
        data.id.write_direct_chunk((0,), zlib.compress(bytes(2**27)))
    with Recording(path) as recording:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        with pytest.raises(RecordingError, match="more: expected a chunk of 160 bytes"):
            recording["more"]
        grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert grown < 30_000, f"{grown / 1000:.0f} MB for 160 bytes"


def test_a_file_that_takes_too_much_memory_is_refused(short: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording_file, "MEMORY", 2**26)
    with pytest.raises(RecordingError, match="takes too much memory"):
        Recording(short)


def test_a_recording_is_read_the_same_after_other_tools_have_written_it_anew(short: Path, tmp_path: Path) -> None:
    """In one piece, in small chunks without a filter, and in the head of the dataset."""
    path = tmp_path / "anew.h5"
    with h5py.File(short) as old, h5py.File(path, "w") as new:
        new.attrs.update(dict(old.attrs))
        layouts = ({"chunks": None}, {"chunks": (3,)}, {"chunks": (7,), "compression": "gzip"})
        for i, name in enumerate(["time", "phase", "object/position", "contacts/point", "contacts/gap", "contacts/end"]):
            data, layout = old[name], dict(layouts[i % 3])
            if layout["chunks"]:
                layout["chunks"] = (*layout["chunks"], *data.shape[1:])
            plan = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
            if name == "phase":
                plan.set_layout(h5py.h5d.COMPACT)
                kind, space = h5py.h5t.py_create(data.dtype), h5py.h5s.create_simple(data.shape)
                h5py.h5d.create(new.id, name.encode(), kind, space, dcpl=plan)
                new[name][...] = data[...]
            else:
                new.create_dataset(name, data=data[...], **layout)
            new[name].attrs.update(dict(data.attrs))
    with Recording(short) as before, Recording(path) as after:
        assert before.steps == after.steps == 20
        for name in before.names:
            np.testing.assert_array_equal(after[name], before[name], err_msg=name)
            assert after.unit(name) == before.unit(name)


def test_a_recording_can_be_read_in_a_forked_process_too(short: Path) -> None:
    with Recording(short) as recording:
        child = os.fork()
        if child == 0:
            os._exit(0 if recording["time"][-1] == row(19)["time"] else 1)
        assert recording["time"][-1] == row(19)["time"]
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def test_what_is_no_file_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.h5")
    with pytest.raises(RecordingError, match="something else than a file"):
        Recording(tmp_path / "pipe.h5")
    with pytest.raises(RecordingError, match="a directory"):
        Recording(tmp_path)
