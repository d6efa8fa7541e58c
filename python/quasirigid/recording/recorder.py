"""Writes recordings: see ``recording.reader`` for what is in one."""

from __future__ import annotations

import io
import weakref
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from quasirigid.arrays.real import refuse_masked
from quasirigid.arrays.types import AnyArray
from quasirigid.errors import InvalidShapeError, RecordingError
from quasirigid.recording.attributes import as_array, as_json, write_attribute
from quasirigid.recording.disk_space import DiskSpace
from quasirigid.recording.head import check_attributes, check_head
from quasirigid.recording.lock import RecordingLock
from quasirigid.recording.reader import CONSTANT, FORMAT, RAGGED, STILL, VERSION, Column
from quasirigid.recording.values import Slot, given_value, held_value
from quasirigid.recording.writer import LEVEL, MARGIN, Block, PackedColumn, RecordingWriter, unwritable
from quasirigid.system.forks import close_kept, keep_for_parent

RAGGED_CHUNK = 4096
"""Rows. The last chunk is written again with every block, and its old place in the file is lost: 9 % of the recording of a grasp, 6 % with
2048 rows and 16 % with 8192; but fewer rows compress less well.
"""
PACKED: dict[str, Any] = {"compression": "gzip", "compression_opts": LEVEL, "shuffle": True}


class _Filling:
    """The steps that wait to become a block."""

    def __init__(self, steps: Iterable[Column], size: int, before: int, ends: Mapping[str, int], ready: Block | None) -> None:
        self.rows: dict[str, AnyArray] = {c.name: np.zeros((size, *c.shape), c.dtype) for c in steps}
        """By step column: a row for each step; those of steps that are not in are of no account."""
        self.ragged: list[tuple[AnyArray, ...]] = []
        """By step: the rows of every ragged column. A step is in once it is here."""
        self.before = before
        """Steps in the blocks before this one."""
        self.ends = ends
        """By group of ragged columns: the row after the last of the block before."""
        self.ready = ready
        """The block before this one, until the writer has it."""


class Recorder:
    """Writes a recording. Use it in a ``with`` block: then the file is closed whatever happens inside."""

    def __init__(
        self,
        path: str | Path,
        columns: Sequence[Column],
        attributes: Mapping[str, Any] | None = None,
        *,
        constants: Mapping[str, npt.NDArray[Any]] | None = None,
        block: int = 100,
    ) -> None:
        """Create the file at ``path`` with these ``columns``; ``block`` steps are written at a time. An older file there is replaced when
        the first of them are on disk, or by ``close``.

        ``constants`` are arrays by name, written at once; ``columns`` may describe them. Raises ``RecordingError`` where no file can be
        written, and ``InvalidValueError`` for columns and attributes that no file can have.
        """
        check_head(columns, attributes or {}, constants or {}, block)
        self.path = Path(path)
        self._block = block
        ends = {c.group for c in columns if c.ragged}
        self._stills = [c for c in columns if c.still]
        self._constants = [c for c in columns if c.constant]
        # Written in this order, `time` last: a step counts once its time is on disk.
        steps = [Column(f"{g}/end", (), "i8", "1", "-", "row after the last of this step") for g in sorted(ends)]
        steps += sorted((c for c in columns if not (c.ragged or c.still or c.constant)), key=lambda c: c.name == "time")
        self._ragged = [(c, Slot(c)) for c in columns if c.ragged]
        self._steps = [(c, Slot(c)) for c in steps]
        self._filling = _Filling(steps, block, 0, dict.fromkeys(ends, 0), None)
        with _written(self.path):
            self._place = RecordingLock(self.path)
            try:
                self._begin(self._head(attributes or {}, constants or {}))
            except BaseException:
                self._place.abandon()  # half a head is no recording
                raise
        # If nobody closes the recording: when it is collected as garbage, or at the end of the program.
        end = (self._writer, self._file, self._space, self._place.release)
        self._forgotten = weakref.finalize(self, _end_forgotten, *end)

    def _head(self, attributes: Mapping[str, Any], constants: Mapping[str, npt.NDArray[Any]]) -> bytes:
        """The file as it is before the first step. It is made in memory, where no disk is full."""
        memory = io.BytesIO()
        with h5py.File(memory, "w", libver="latest") as file:
            fixed = {"format": FORMAT, "version": VERSION, "complete": False, "units": "SI: m, kg, s, N, Pa, rad"}
            for name, value in {**fixed, "frames": "world: z up; quaternions are (w, x, y, z)", **attributes}.items():
                write_attribute(file, name, value)
            described = {c.name: c for c in self._constants}
            for name, values in constants.items():
                data = file.create_dataset(name, data=values, **(PACKED if np.size(values) else {}))
                write_attribute(data, "rows", CONSTANT)
                if name in described:
                    _describe(data, described[name])
            for column in [c for c, _ in self._ragged + self._steps] + self._stills:
                self._create(file, column)
        return memory.getvalue()

    def _begin(self, head: bytes) -> None:
        """Write what is there from the start, and make room for the end."""
        with self._place.draft.open("wb") as draft:
            draft.write(head)
        self._space = DiskSpace(self._place.draft)
        settle = partial(_settle, self._space, self._place)
        try:
            # Whoever has the file open elsewhere, as one must on Windows, would be in the way of HDF5's own lock.
            self._file = h5py.File(self._place.draft, "r+", libver="latest", locking=False)
            keep_for_parent(self._file)
            try:
                packs = {c.name: PackedColumn(self._file[c.name], c.resolution) for c, _ in self._ragged + self._steps}
                stills = {c.name: self._file[c.name] for c in self._stills}
                self._writer = RecordingWriter(packs, stills, str(self.path), partial(_reserve, self._space, self._file), settle)
                try:
                    _reserve(self._space, self._file, self._writer.margin())
                    self._file.swmr_mode = True
                except BaseException:
                    self._writer.stop()
                    raise
            except BaseException:
                close_kept(self._file)
                raise
        except BaseException:
            self._space.close()
            raise

    def _create(self, file: h5py.File, column: Column) -> None:
        rows = RAGGED_CHUNK if column.ragged else 1 if column.still else self._block
        # The coordinates of a contact, each by itself, take a fifth less room than x y z x y z.
        apart = column.ragged and len(column.shape) == 1
        # HDF5 has no chunks of no size: a column of no fingers gets one of a row.
        chunks = (rows, *(1 if apart else max(1, n) for n in column.shape))
        data = file.create_dataset(
            column.name, (0, *column.shape), column.dtype, maxshape=(None, *(n or None for n in column.shape)), chunks=chunks, **PACKED
        )
        if column.ragged:
            write_attribute(data, "rows", f"{RAGGED}: step i has rows end[i - 1]:end[i] of {column.group}/end")
        if column.still:
            write_attribute(data, "rows", STILL)
        _describe(data, column)

    @property
    def steps(self) -> int:
        """Steps appended so far."""
        return self._filling.before + len(self._filling.ragged)

    @property
    def waited(self) -> float:
        """How long ``append`` had to wait because the disk could not follow, s."""
        return self._writer.waited

    def append(self, row: Mapping[str, Any]) -> None:
        """Add one step: a value for every step column and an array for every ragged one (same length within a group).

        Values may have more digits than their column; nothing else is made to fit. Raises ``InvalidShapeError`` for a row of the wrong
        shape, ``InvalidValueError`` for values that a column cannot hold, and ``RecordingError`` if earlier rows could not be written.
        """
        self._writer.check()
        filling = self._filling
        if len(filling.ragged) == self._block:  # an interrupt came before they were handed over
            self._hand_over()
            filling = self._filling
        at = len(filling.ragged)
        counts: dict[str, int] = {}
        ragged: list[AnyArray] = []
        for c, slot in self._ragged:
            given = given_value(c, row)
            if given.shape[1:] != c.shape or given.ndim != slot.ndim or counts.setdefault(slot.group, len(given)) != len(given):
                expected = f"({', '.join(map(str, (counts.get(slot.group, 'n'), *c.shape)))})"
                raise InvalidShapeError(c.name, expected, str(given.shape), "all columns of a group have as many rows")
            # A copy: it is written later, and may be changed until then.
            ragged.append(given.astype(slot.dtype) if given.dtype.kind in slot.sure else held_value(c, given).copy())
        for c, slot in self._steps:
            value: Any = row.get(c.name)
            if type(value) in slot.plain and slot.least <= value <= slot.most:  # what comes most often, the quick way
                filling.rows[c.name][at] = value
            elif c.name in row or not c.name.endswith("/end"):
                given = given_value(c, row)
                if given.shape != c.shape:
                    raise InvalidShapeError(c.name, str(c.shape), str(given.shape), "one row of the column's shape")
                filling.rows[c.name][at] = given if given.dtype.kind in slot.sure else held_value(c, given)
        for group, count in counts.items():
            ends = filling.rows[f"{group}/end"]
            ends[at] = count + (ends[at - 1] if at else filling.ends[group])
        # The step is in from here on: a refused row, or an interrupt above, leaves nothing behind.
        filling.ragged.append(tuple(ragged))
        if at + 1 == self._block:
            self._hand_over()

    def _hand_over(self) -> None:
        """Give the writer what was appended since the last time. After an interrupt, wherever it came, it may be called again."""
        self._give_ready()
        full = self._filling
        count = len(full.ragged)
        if count:
            ragged = dict(zip((c.name for c, _ in self._ragged), zip(*full.ragged, strict=True), strict=False))
            block = Block(ragged, {name: rows[:count] for name, rows in full.rows.items()})
            ends = {group: int(full.rows[f"{group}/end"][count - 1]) for group in full.ends}
            # One statement: these steps are either still filling or ready, never both or neither.
            self._filling = _Filling((c for c, _ in self._steps), self._block, full.before + count, ends, block)
            self._give_ready()

    def _give_ready(self) -> None:
        if self._filling.ready is not None:
            self._writer.give(self._filling.ready)
            self._filling.ready = None

    def still(self, values: Mapping[str, Any]) -> None:
        """Write stills, by name; they are on disk at once. A still that was written before is replaced.

        Raises ``InvalidShapeError`` and ``InvalidValueError`` as ``append``.
        """
        known = {c.name: c for c in self._stills}
        for name, value in values.items():
            refuse_masked(name, value)
            given = np.asarray(value)
            if name not in known or given.shape != known[name].shape:
                expected = str(known[name].shape) if name in known else "one of the stills of this recording"
                raise InvalidShapeError(name, expected, str(given.shape), "name it and its shape when the recording is made")
            held_value(known[name], given)
        self._writer.give(dict(values))
        self._writer.drain()

    def flush(self) -> None:
        """Put everything appended so far on disk, and wait for it. Raises ``RecordingError`` if it cannot be written."""
        self._hand_over()
        self._writer.drain()

    def discard(self) -> None:
        """End a recording that nobody wants: nothing of it stays, and an older file keeps its place if there was no step
        yet to replace it.
        """
        self._writer.owner.check()
        if self._file:
            self._forgotten.detach()
            _end_forgotten(self._writer, self._file, self._space, self._place.abandon)

    def close(self, **attributes: Any) -> None:
        """Write what is buffered, mark the recording as complete and add ``attributes`` (dicts and lists become JSON) to the file.

        Raises ``RecordingError`` if something could not be written; the file is closed all the same. Raises ``InvalidValueError`` for
        attributes that no file can hold, and then the recording goes on. Raises ``ForkError`` in a forked child.
        """
        self._writer.owner.check()
        if not self._file:
            return
        texts = {name: as_json(name, value) if isinstance(value, dict | list) else value for name, value in attributes.items()}
        check_attributes(texts)
        try:
            self._end_file()
            with _written(self.path):
                _settle(self._space, self._place)
                # Beside the attributes themselves HDF5 writes some hundred bytes about each.
                sizes = [as_array(name, value).nbytes + 1024 for name, value in texts.items()]
                self._space.reserve(self._place.target.stat().st_size + sum(sizes) + MARGIN)
                with self._reopened() as file:
                    for name, value in texts.items():
                        write_attribute(file, name, value)
                    file.attrs.modify("complete", True)
                self._space.trim()
        finally:
            self._leave()

    def _reopened(self) -> h5py.File:
        """The finished file. Whoever reads it in another process may have it locked, but is not disturbed by what is added."""
        return h5py.File(self._place.target, "r+", libver="latest", locking=False)

    def _leave(self) -> None:
        """Let others record here."""
        self._space.close()
        self._place.release()

    def _end_file(self) -> None:
        try:
            self._hand_over()
        finally:
            self._forgotten.detach()
            self._writer.stop()
            with _written(self.path):
                try:
                    close_kept(self._file)
                    self._space.trim()
                except (OSError, RuntimeError):
                    self._writer.check()  # says better what was wrong
                    raise
        self._writer.check()

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if not self._writer.owner.here:
            return  # a forked child leaves the block; the parent goes on recording
        if kind is None:
            self.close()
        elif self._file:
            # Interrupted: keep what there is, and leave `complete` false.
            try:
                self._end_file()
            except RecordingError:
                if not isinstance(error, RecordingError):  # else it is on its way already
                    raise
            finally:
                self._leave()


def _end_forgotten(writer: RecordingWriter, file: h5py.File, space: DiskSpace, leave: Callable[[], None]) -> None:
    if not writer.owner.here:
        return
    writer.stop()
    with suppress(OSError, RuntimeError):  # nobody is left to report it to
        close_kept(file)
        space.trim()
    space.close()
    leave()


def _reserve(space: DiskSpace, file: h5py.File, more: int) -> None:
    """Make room for so many bytes beyond what HDF5 has of the file."""
    space.reserve(file.id.get_filesize() + more)


def _settle(space: DiskSpace, place: RecordingLock) -> None:
    """Put the file where it belongs, if it is not there."""
    if not place.settled:
        space.to_disk()
        place.settle()


def _describe(data: h5py.Dataset, column: Column) -> None:
    for name, text in (("unit", column.unit), ("frame", column.frame), ("what", column.what)):
        write_attribute(data, name, text)
    if column.resolution:
        write_attribute(data, "resolution", column.resolution)
    if column.labels:
        write_attribute(data, "labels", column.labels)


@contextmanager
def _written(path: Path) -> Iterator[None]:
    """What HDF5 and the file system say of a file that cannot be written, as ``RecordingError``."""
    try:
        yield
    except RecordingError:
        raise
    except (OSError, RuntimeError) as error:
        raise unwritable(str(path), error) from error
