"""What puts a recording on disk: a thread that compresses and writes whole blocks of steps while the run goes on.

The stepping thread hands over a block and goes on; it waits only when ``WAITING`` blocks have not been written yet. Nothing is ever left
out.

HDF5 holds Python's lock in every call, and would hold it while it compresses. So chunks are shuffled and compressed here, with functions
that let go of the lock, and given to HDF5 as they are to stand in the file: what is left of a block under the lock is a tenth of a
millisecond at a time.
"""

from __future__ import annotations

import errno
import itertools
import math
import os
import queue
import sys
import threading
import time
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import h5py
import numpy as np

from quasirigid.arrays.types import AnyArray
from quasirigid.errors import RecordingError
from quasirigid.system.forks import Owner

WAITING = 16
"""Blocks that may wait for the disk, at most: 1.6 s of steps of a millisecond, about 2 MB each in a grasp."""
LEVEL = 1
"""Of the compression. 4 saves 3 % of the space and takes a fifth more time."""
MARGIN = 2**15
"""Room beside all columns that is kept for what HDF5 writes when a file is closed, bytes: measured are 6 kB."""
PAUSE = 5e-5
"""Pause after every column, s. A thread that waits for Python's lock gets it then; otherwise it would have to wait for the interpreter's 5
ms.
"""
NICER = 5
"""By how much the thread gives way to others on a busy processor: compressing may wait, steps may not."""
Packed = tuple[int, list[tuple[tuple[int, ...], bytes]]]
"""Rows of a column once they are in, and the chunks to be written: first element and bytes of each."""


@dataclass(frozen=True, eq=False)
class Block:
    """Some steps. Columns are written in the order in which they stand here, ragged ones first."""

    ragged: Mapping[str, Sequence[AnyArray]]
    """By column: the rows of one step each."""
    steps: Mapping[str, AnyArray]
    """By column: one row per step."""


class PackedColumn:
    """The end of a column in a file, to which rows are added: shuffled and compressed as HDF5 would."""

    def __init__(self, data: h5py.Dataset, resolution: float = 0.0) -> None:
        """``data`` is chunked, with the filters shuffle and gzip alone. Values are rounded to whole multiples of ``resolution``, a power of
        2; 0: not at all.
        """
        self._data = data
        self._resolution = resolution
        self._chunk: tuple[int, ...] = data.chunks
        self._length = 0
        self._tail: AnyArray = np.zeros((0, *data.shape[1:]), data.dtype)
        # Where chunks lie across a row; none if a row is empty.
        sizes = zip(data.shape[1:], self._chunk[1:], strict=True)
        self._across = list(itertools.product(*(range(0, size, chunk) for size, chunk in sizes)))

    def extend(self, rows: AnyArray) -> None:
        """Add ``rows`` and put them on disk. The last chunk, if it is not full, is written again the next time."""
        self.store(self.pack(rows))

    def pack(self, rows: AnyArray) -> Packed:
        """The chunks in which ``rows`` will be, to be given to ``store`` in the order in which they are packed."""
        if self._resolution:
            rows = np.rint(rows * rows.dtype.type(1.0 / self._resolution)) * rows.dtype.type(self._resolution)
            rows += 0.0  # no -0
        deep = self._chunk[0]
        first = self._length - len(self._tail)
        self._length += len(rows)
        rows = np.concatenate([self._tail, rows])
        chunks: list[tuple[tuple[int, ...], bytes]] = []
        for start in range(0, len(rows), deep):
            part = rows[start : start + deep]
            for across in self._across:
                window = tuple(slice(low, low + size) for low, size in zip(across, self._chunk[1:], strict=True))
                chunk = part[(slice(None), *window)]
                chunks.append(((first + start, *across), self._packed(chunk)))
        self._tail = rows[len(rows) - len(rows) % deep :].copy()
        return self._length, chunks

    def store(self, packed: Packed) -> None:
        """Put what was packed on disk."""
        length, chunks = packed
        self._data.id.set_extent((length, *self._data.shape[1:]))
        for corner, data in chunks:
            self._data.id.write_direct_chunk(corner, data)
        self._data.id.flush()

    def growth(self) -> int:
        """Room that the index of the chunks may take beside the next ones, bytes. It grows in blocks of 4 entries per root of the entries
        that there are, each of 16 bytes (HDF5's extensible array).
        """
        return 2048 + 64 * math.isqrt(1 + len(self._across) * (self._length // self._chunk[0]))

    def _packed(self, chunk: AnyArray) -> bytes:
        """The bytes of a chunk in the file; what is missing of its rows is zero."""
        whole = np.zeros(self._chunk, chunk.dtype)
        whole[tuple(slice(n) for n in chunk.shape)] = chunk
        # Filter shuffle: the first bytes of all values, then the second ones, and so on.
        shuffled = np.ascontiguousarray(whole.view("u1").reshape(-1, chunk.dtype.itemsize).T)
        return zlib.compress(shuffled.data, LEVEL)


class RecordingWriter:
    """A thread that writes blocks in the order in which they come. All methods are for one other thread."""

    def __init__(
        self,
        columns: Mapping[str, PackedColumn],
        stills: Mapping[str, h5py.Dataset],
        path: str,
        reserve: Callable[[int], None],
        begun: Callable[[], None],
    ) -> None:
        """``reserve`` sees to it that there is room for so many bytes more; ``begun`` is called once the first block is on disk."""
        self._columns, self._stills, self._path = columns, stills, path
        self._reserve, self._begun, self._first = reserve, begun, True
        self.owner = Owner(f"recording {path}", "close it before the fork, or record to another file here")
        """The process that writes."""
        self._jobs: queue.Queue[Block | Mapping[str, Any] | None] = queue.Queue(WAITING)
        self._failure: Exception | None = None
        self._last: object = None
        self._orphan = False
        self.waited = 0.0
        """How long the other thread had to wait for the disk, s."""
        # A daemon: a recording that nobody closed does not keep a program from ending. `Recorder` sees to it that `stop` is called then.
        self._thread = threading.Thread(target=self._run, name="quasirigid-recording", daemon=True)
        self._thread.start()

    def give(self, job: Block | Mapping[str, Any]) -> None:
        """Have a block, or stills by name, written. Raises ``RecordingError`` if what came before could not be written."""
        self.check()
        try:
            self._jobs.put_nowait(job)
        except queue.Full:
            began = time.perf_counter()
            try:
                self._jobs.put(job)
            finally:
                self.waited += time.perf_counter() - began

    def drain(self) -> None:
        """Wait until all that was given is on disk. Raises ``RecordingError`` if it could not be written."""
        self.owner.check()
        self._jobs.join()
        self.check()

    def check(self) -> None:
        """Raises ``RecordingError`` if something could not be written, ``ForkError`` in a forked child."""
        self.owner.check()
        if self._failure is not None:
            raise unwritable(self._path, self._failure) from self._failure

    def margin(self) -> int:
        """Room that HDF5 may take beside the chunks of a block, bytes."""
        return MARGIN + sum(column.growth() for column in self._columns.values())

    def stop(self) -> None:
        """Write all that was given and end the thread. Raises nothing: see ``check``."""
        if self._thread is threading.current_thread():
            self._orphan = True  # the garbage collector calls from anywhere
        elif self._thread.is_alive():
            self._jobs.put(None)
            self._thread.join()

    def _run(self) -> None:
        if sys.platform == "linux":  # where each thread has a niceness of its own
            me = threading.get_native_id()
            os.setpriority(os.PRIO_PROCESS, me, os.getpriority(os.PRIO_PROCESS, me) + NICER)
        while True:
            job = self._jobs.get()
            try:
                # After a failure nothing more is written: what is on disk stays as it is. An interrupted `give` may be repeated: that is
                # seen.
                if job is not None and self._failure is None and job is not self._last:
                    self._last = job
                    self._write(job)
            except Exception as error:  # raised at the next call
                self._failure = error
            finally:
                self._jobs.task_done()
            if job is None or (self._orphan and self._jobs.empty()):
                return

    def _write(self, job: Block | Mapping[str, Any]) -> None:
        if isinstance(job, Block):
            packed: dict[str, Packed] = {}
            for name, rows in itertools.chain(((name, np.concatenate(parts)) for name, parts in job.ragged.items()), job.steps.items()):
                if len(rows):
                    packed[name] = self._columns[name].pack(rows)
                    time.sleep(PAUSE)
            # Nothing of the block is written unless there is room for all of it, and for what HDF5 has to write when the file is closed.
            self._reserve(sum(len(data) for _, chunks in packed.values() for _, data in chunks) + self.margin())
            for name, chunks in packed.items():
                self._columns[name].store(chunks)
                time.sleep(PAUSE)
            if self._first:
                self._begun()
                self._first = False
            return
        # A still is one chunk, which gzip cannot make larger by more than a thousandth and 12 bytes.
        self._reserve(
            sum(int(1.001 * self._stills[name].dtype.itemsize * np.size(value)) + 12 for name, value in job.items()) + self.margin()
        )
        for name, value in job.items():
            data = self._stills[name]
            data.resize(1, axis=0)
            data[0] = value
            data.flush()


def unwritable(path: str, error: Exception) -> RecordingError:
    """The error of a recording that cannot be written any more."""
    # HDF5 says in which of its calls it happened; people want to know what the operating system said.
    number = getattr(error, "errno", None)
    reason = os.strerror(number) if number else " ".join(str(error).split())
    full = number in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
    hint = "free some space on the disk, or record elsewhere with --record" if full else "choose another place with --record or --out"
    return RecordingError(path, "a file that can be written", reason, hint)


__all__ = ["Block", "PackedColumn", "RecordingWriter", "unwritable"]
