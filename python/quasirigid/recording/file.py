"""Reads recordings from files that nobody vouches for.

What is in the file is found out by ``hdf5_structure`` in a process of its own, with limits of time and memory: whatever a damaged file does
to libhdf5 happens there. The numbers are then read here, from where they are in the file: a chunk is read, decompressed to the size that it
must have, and unshuffled. None of that can hang, and no other thread waits for it.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import threading
import weakref
import zlib
from dataclasses import dataclass
from pathlib import Path
from subprocess import DEVNULL, PIPE
from typing import Any

import numpy as np

from quasirigid.arrays.types import AnyArray
from quasirigid.errors import RecordingError
from quasirigid.recording.disk_space import EOF_AT, EOF_SIZE
from quasirigid.recording.hdf5_structure import GZIP, SHUFFLE

SIGNATURE = b"\x89HDF\r\n\x1a\n"
CPU_SECONDS, WALL_SECONDS = 5, 15
"""How long the structure of a file may take, s. A recording of an hour takes 2 s."""
SCANNED_PER_SECOND = 2**24
"""Bytes of a file for which there is a second more: the tables of its chunks grow with it."""
MEMORY = 2**30
"""Address space of the process that checks a file, bytes, beyond as much as the file has: Python and h5py alone take a quarter of it."""
GZIP_MOST = 1032
"""Gzip makes no more of a byte (zlib's technical details: a code of 2 bits for 258 bytes); what declares more is damaged."""
READ_MOST = 2**32
"""Bytes that are read at once, at most: a damaged file shall not fill the memory. What is longer is read in pieces."""
KEPT = 2**20
"""Decompressed bytes of a column that are kept for the next read, beyond one chunk: the steps of a recording are read one after another."""
DAMAGED = "the file is damaged: record again"


@dataclass(frozen=True, eq=False)
class Stored:
    """A dataset: what it is, and where its bytes are."""

    name: str
    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    """As declared. In a recording whose run was killed, the last rows may be missing: see ``rows``."""
    attributes: dict[str, Any]
    filters: tuple[int, ...]
    chunk: tuple[int, ...] | None
    """Shape of a chunk; ``None`` where the values lie in one piece."""
    address: int | None
    """Of values that lie in one piece, bytes."""
    values: bytes | None
    """Of small ones, the values themselves."""
    cells: AnyArray
    """(chunks,) number of each chunk in its grid, rising."""
    places: AnyArray
    """(chunks, 3) filter mask, address and size in bytes, in the order of ``cells``."""
    rows: int
    """Rows that are there, from the first."""

    @property
    def grid(self) -> tuple[int, ...]:
        """Chunks along each dimension."""
        assert self.chunk is not None
        return tuple(-(-size // piece) for size, piece in zip(self.shape, self.chunk, strict=True))


def damaged(path: Path, what: str, expected: str, got: object) -> RecordingError:
    """The error of a part of a file that is not as a recording has it."""
    return RecordingError(f"{path}: {what}", expected, got if str(got) else "nothing", DAMAGED)


class RecordingFile:
    """An HDF5 file, open for reading: the attributes of the file, and its datasets by name. Any thread may read."""

    def __init__(self, path: Path) -> None:
        """Open ``path``. Raises ``RecordingError`` if there is no such file, or if it is damaged or no HDF5 file."""
        self.path = path
        if path.exists() and not path.is_file():  # of a pipe one would wait for the other end
            found = "a directory" if path.is_dir() else "something else than a file"
            raise RecordingError(str(path), "a recording (HDF5)", found, "give the path of a recording.h5")
        try:
            self._file = path.open("rb", buffering=0)
        except FileNotFoundError:
            raise RecordingError(str(path), "a recording (HDF5)", "no such file", "give the path of a recording.h5") from None
        except OSError as error:
            raise RecordingError(str(path), "a recording (HDF5)", error.strerror or error, "give the path of a recording.h5") from None
        try:
            self._lock = threading.Lock()
            self._kept: dict[str, tuple[tuple[int, AnyArray], ...]] = {}
            """By dataset: chunks that were read last, by their number. Replaced as one, so that no thread need wait for another."""
            about, tables = self._structure()
            self.size = os.fstat(self._file.fileno()).st_size
            self.attributes = {name: _attribute(value) for name, value in about["attributes"].items()}
            stored = [self._stored(item, table) for item, table in zip(about["datasets"], tables, strict=True)]
            stored_bytes = sum(int(item.places[:, 2].sum()) for item in stored)
            if stored_bytes > self.size:
                raise damaged(path, "the chunks", f"{self.size:,} bytes or fewer in all, as long as the file", f"{stored_bytes:,}")
        except BaseException:
            self._file.close()
            raise
        self.datasets: dict[str, Stored] = {item.name: item for item in stored}
        self._closing = weakref.finalize(self, self._file.close)  # whoever forgets a recording loses nothing by it

    def _structure(self) -> tuple[dict[str, Any], list[AnyArray]]:
        """What ``hdf5_structure`` finds in the file that is open here."""
        if self._file.read(len(SIGNATURE)) != SIGNATURE:
            raise RecordingError(str(self.path), "a recording (HDF5)", "a file of another kind", "give the path of a recording.h5")
        while True:
            here = os.fstat(self._file.fileno())
            about, data = examine(self.path, here.st_size)
            if about["file"] == [here.st_dev, here.st_ino] or sys.platform == "win32":
                break
            # Another recording took its place meanwhile.
            self._file.close()
            self._file = self.path.open("rb", buffering=0)
        tables, at = [], 0
        for item in about["datasets"]:
            width = len(item["shape"]) + 3
            count = item["chunks"] * width
            tables.append(np.frombuffer(data, "<i8", count, at).reshape(-1, width))
            at += 8 * count
        return about, tables

    def _stored(self, about: dict[str, Any], table: AnyArray) -> Stored:
        """A dataset, once its chunks are known to lie in the file and in their grid."""
        name, shape, dtype = about["name"], tuple(about["shape"]), np.dtype(about["dtype"])
        chunk = None if about["chunk"] is None else tuple(about["chunk"])
        cells, places, rows = np.zeros(0, np.int64), np.zeros((0, 3), np.int64), shape[0] if shape else 0
        if chunk is not None:
            cells, places = _checked_chunks(self.path, name, shape, chunk, dtype.itemsize, GZIP in about["filters"], table, self.size_now())
            across = math.prod(-(-n // c) for n, c in zip(shape[1:], chunk[1:], strict=True))
            # Whole rows of chunks from the first; a gap further on is the end of what can be read.
            whole = int(np.searchsorted(cells - np.arange(len(cells)), 0, side="right")) // across if across else shape[0]
            rows = min(shape[0], whole * chunk[0]) if across else shape[0]
        elif about["values"] is None and math.prod(shape):
            address, length = about["address"], math.prod(shape) * dtype.itemsize
            if address is None or address < 0 or address + length > self.size_now():
                raise damaged(self.path, name, f"{length:,} bytes within the file", f"{self.size_now():,} bytes of file, from {address}")
        values = None if about["values"] is None else bytes.fromhex(about["values"])
        attributes = {key: _attribute(value) for key, value in about["attributes"].items()}
        return Stored(name, dtype, shape, attributes, tuple(about["filters"]), chunk, about["address"], values, cells, places, rows)

    def size_now(self) -> int:
        """Length of the file, bytes: it grows while it is written."""
        return os.fstat(self._file.fileno()).st_size

    def read(self, name: str, start: int, stop: int) -> AnyArray:
        """Rows ``start`` to ``stop`` of a dataset, as a new array. Raises ``RecordingError`` if they are not in the file or damaged."""
        item = self.datasets[name]
        if not 0 <= start <= stop <= item.rows:
            raise damaged(self.path, name, f"rows {start} to {stop}", f"{item.rows} rows")
        shape = (stop - start, *item.shape[1:])
        length = math.prod(shape) * item.dtype.itemsize
        if length > READ_MOST:
            hint = "read it in pieces, with Recording.slice"
            raise RecordingError(f"{self.path}: {name}", f"{READ_MOST:,} bytes at once at most", f"{length:,}", hint)
        if item.chunk is None:
            return self._piece(item, start, stop).reshape(shape).copy()
        try:
            found = np.empty(shape, item.dtype)
        except MemoryError:
            hint = "read it in pieces, with Recording.slice"
            raise RecordingError(f"{self.path}: {name}", "what fits into memory", f"{length:,} bytes", hint) from None
        if not found.size:
            return found
        across = np.ndindex(*item.grid[1:])
        cells = [
            (cell, math.prod(item.grid[1:]), [slice(a * c, (a + 1) * c) for a, c in zip(cell, item.chunk[1:], strict=True)])
            for cell in across
        ]
        deep = item.chunk[0]
        for row in range(start // deep, -(-stop // deep)):
            low, high = max(start, row * deep), min(stop, (row + 1) * deep)
            for number, (_, count, window) in enumerate(cells):
                target = found[(slice(low - start, high - start), *window)]
                chunk = self._chunk(item, row * count + number)
                target[...] = chunk[(slice(low - row * deep, high - row * deep), *(slice(n) for n in target.shape[1:]))]
        return found

    def whole(self, name: str) -> AnyArray:
        """A dataset of any shape, all of it. Raises ``RecordingError`` as ``read``."""
        item = self.datasets[name]
        if item.shape:
            return self.read(name, 0, item.shape[0])
        return self._piece(item, 0, 1).reshape(())

    def _piece(self, item: Stored, start: int, stop: int) -> AnyArray:
        row = math.prod(item.shape[1:]) * item.dtype.itemsize
        if item.values is not None:
            data = item.values[start * row : stop * row]
        else:
            data = self._bytes(item.name, (item.address or 0) + start * row, (stop - start) * row)
        if len(data) != (stop - start) * row:
            raise damaged(self.path, item.name, f"{(stop - start) * row:,} bytes", f"{len(data):,}")
        return np.frombuffer(data, item.dtype)

    def _chunk(self, item: Stored, cell: int) -> AnyArray:
        """A chunk, which nobody may change."""
        kept = self._kept.get(item.name, ())
        for number, chunk in kept:
            if number == cell:
                return chunk
        chunk = self._unpacked(item, cell)
        most = min(2 * math.prod(item.grid[1:]), max(1, KEPT // max(1, chunk.nbytes)))
        self._kept[item.name] = ((cell, chunk), *kept)[:most]
        return chunk

    def _unpacked(self, item: Stored, cell: int) -> AnyArray:
        assert item.chunk is not None
        mask, address, size = item.places[int(np.searchsorted(item.cells, cell))].tolist()
        data = self._bytes(item.name, address, size)
        count = math.prod(item.chunk)
        length = count * item.dtype.itemsize
        used = [which for i, which in enumerate(item.filters) if not mask >> i & 1]
        if GZIP in used:
            stream = zlib.decompressobj()
            try:
                # One byte more than there may be: whoever has it is found out, and nobody gets to fill the memory.
                data = stream.decompress(data, length + 1)
            except zlib.error as error:
                raise damaged(self.path, item.name, "values that can be decompressed", error) from error
            if not stream.eof:
                raise damaged(self.path, item.name, f"a chunk of {length:,} bytes", f"{len(data):,} bytes without an end")
        if len(data) != length:
            raise damaged(self.path, item.name, f"a chunk of {length:,} bytes", f"{len(data):,}")
        if SHUFFLE in used:
            # Filter shuffle: the first bytes of all values, then the second ones, and so on.
            data = np.ascontiguousarray(np.frombuffer(data, "u1").reshape(item.dtype.itemsize, count).T).tobytes()
        return np.frombuffer(data, item.dtype).reshape(item.chunk)

    def _bytes(self, name: str, address: int, size: int) -> bytes:
        parts: list[bytes] = []
        try:
            while size > 0 and (part := self._part(address, size)):
                parts.append(part)
                address, size = address + len(part), size - len(part)
        except (OSError, ValueError) as error:  # a disk that fails; a file that was closed
            raise RecordingError(f"{self.path}: {name}", "a file that can be read", error, "open the recording again") from error
        if size:
            raise damaged(self.path, name, "its bytes", f"{size:,} bytes fewer: the end of the file is missing")
        return b"".join(parts)

    def _part(self, address: int, size: int) -> bytes:
        if sys.platform == "win32":
            with self._lock:
                self._file.seek(address)
                return self._file.read(size)
        else:  # a process shares with those that it forks where a file is read next
            return os.pread(self._file.fileno(), size, address)

    def close(self) -> None:
        """Close the file."""
        self._closing()


def _checked_chunks(
    path: Path, name: str, shape: tuple[int, ...], chunk: tuple[int, ...], itemsize: int, gzip: bool, table: AnyArray, size: int
) -> tuple[AnyArray, AnyArray]:
    """The numbers of the chunks in their grid, rising, and mask, address and size of each. Raises ``RecordingError`` where they cannot be
    right.
    """
    grid = [-(-n // c) for n, c in zip(shape, chunk, strict=True)]
    length = math.prod(chunk) * itemsize
    table = table[(table[:, : len(shape)] < shape).all(axis=1)]  # of a dataset that was cut shorter
    corners, places = table[:, : len(shape)], table[:, len(shape) :]
    if (corners % chunk).any() or (corners < 0).any():
        raise damaged(path, name, f"chunks of the shape {chunk}", "chunks that overlap")
    if len(table) and (math.prod(grid) >= 2**62 or length > READ_MOST):
        raise damaged(path, name, f"chunks of {READ_MOST:,} bytes at most", f"shape {shape} in chunks of {length:,} bytes")
    addresses, sizes = places[:, 1], places[:, 2]
    if len(table) and (
        addresses.min() < 0 or sizes.min() <= 0 or addresses.max() > size or sizes.max() > size or (addresses + sizes).max() > size
    ):
        raise damaged(path, name, f"chunks within the {size:,} bytes of the file", f"one that ends at {int((addresses + sizes).max()):,}")
    stored = int(sizes.min(initial=length))
    if length > stored * (GZIP_MOST if gzip else 1) + GZIP_MOST:
        raise damaged(path, name, f"{GZIP_MOST * stored:,} bytes or fewer in a chunk of {stored:,} bytes", f"{length:,}")
    cells = np.zeros(len(table), np.int64)
    for corner, piece, pieces in zip(corners.T, chunk, grid, strict=True):
        cells = cells * pieces + corner // piece
    order = np.argsort(cells, kind="stable")
    cells = cells[order]
    if (np.diff(cells) == 0).any():
        raise damaged(path, name, "each chunk once", "a chunk that is there twice")
    return cells, places[order]


def examine(path: Path, size: int) -> tuple[dict[str, Any], bytes]:
    """What ``hdf5_structure`` says of the file at ``path`` of ``size`` bytes: the JSON, and the chunk tables.

    Raises ``RecordingError`` if it has a say against the file, or none in time.
    """
    more = size // SCANNED_PER_SECOND
    program = Path(__file__).with_name("hdf5_structure.py")
    arguments = [path.resolve(), CPU_SECONDS + more, MEMORY + size, json.dumps(sys.path)]
    command = [sys.executable, "-I", str(program), *map(str, arguments)]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}  # each of its threads would take memory
    with subprocess.Popen(command, env=environment, stdin=DEVNULL, stdout=PIPE, stderr=DEVNULL) as process:
        try:
            out, _ = process.communicate(timeout=WALL_SECONDS + more)
        except subprocess.TimeoutExpired:
            process.kill()
            raise _unreadable(path, f"nothing from HDF5 in {WALL_SECONDS + more} s") from None
        except BaseException:
            process.kill()
            raise
    line, _, tables = out.partition(b"\n")
    if process.returncode or not line:
        raise _unreadable(path, f"nothing: HDF5 hangs, crashes or takes too much memory in it (exit {process.returncode})")
    about = json.loads(line)
    if "refused" in about:
        what, expected, got = about["refused"]
        raise damaged(path, what, expected, got)
    if "error" in about:
        raise _unreadable(path, about["error"])
    return about, tables


def _unreadable(path: Path, found: str) -> RecordingError:
    """The error of a file that HDF5 cannot make sense of."""
    with path.open("rb") as file:
        head = file.read(EOF_AT + EOF_SIZE)
    size, whole = path.stat().st_size, int.from_bytes(head[EOF_AT:], "little") if head[8:9] in (b"\2", b"\3") else 0
    if size < whole:  # of a full disk, too: then what is there may well be read
        hint = "its end is missing: copy it again, or record again"
        return RecordingError(str(path), "a recording that can be read", f"{size:,} of {whole:,} bytes", hint)
    return RecordingError(str(path), "a recording that can be read", found, DAMAGED)


def _attribute(value: Any) -> Any:
    """An attribute as it was before it became JSON."""
    return np.array(value["values"], value["dtype"]).reshape(value["shape"]) if isinstance(value, dict) else value


__all__ = ["RecordingFile", "Stored", "damaged"]
