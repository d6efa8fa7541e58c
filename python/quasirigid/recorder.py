"""Writes recordings: see ``recording`` for what is in one."""

from __future__ import annotations

import json
import math
import weakref
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from quasirigid.errors import InvalidShapeError, InvalidValueError, RecordingError
from quasirigid.recording import CONSTANT, FORMAT, STILL, VERSION, Column
from quasirigid.recording_place import Place
from quasirigid.recording_writer import LEVEL, Block, PackedColumn, RecordingWriter, unwritable

RAGGED_CHUNK = 4096
"""Rows. The last chunk is written anew with every block, and its old place in the file is lost: 9 % of the recording of a grasp, 6 % with
2048 rows and 16 % with 8192; but fewer rows compress less well.
"""
Array = npt.NDArray[Any]
PACKED: dict[str, Any] = {"compression": "gzip", "compression_opts": LEVEL, "shuffle": True}


class _Slot:
    """What ``append`` has to know of a column, found out once."""

    def __init__(self, column: Column) -> None:
        self.group, self.ndim = column.group, 1 + len(column.shape)
        self.dtype: np.dtype[Any] = np.dtype(column.dtype)
        kind = self.dtype.kind
        self.sure = {"f": "fiub", "i": "b", "u": "b"}.get(kind, "")
        """Kinds of arrays that it holds whatever is in them."""
        self.plain: tuple[type, ...] = () if column.shape else {"f": (float,), "i": (int, bool), "u": (int, bool)}.get(kind, ())
        """Python's own numbers that it holds from ``least`` to ``most``."""
        self.least, self.most = -math.inf, math.inf
        if kind in "iu":
            self.least, self.most = np.iinfo(self.dtype).min, np.iinfo(self.dtype).max


class _Filling:
    """The steps that wait to become a block."""

    def __init__(self, steps: Iterable[Column], size: int, before: int, ends: Mapping[str, int], ready: Block | None) -> None:
        self.rows: dict[str, Array] = {c.name: np.zeros((size, *c.shape), c.dtype) for c in steps}
        """By step column: a row for each step; those of steps that are not in are of no account."""
        self.ragged: list[tuple[Array, ...]] = []
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
        the first of them are, or by ``flush`` or ``close``.

        ``constants`` are arrays by name, written at once. Raises ``RecordingError`` where no file can be written.
        """
        for c in columns:
            if c.resolution and not (c.resolution > 0.0 and math.frexp(c.resolution)[0] == 0.5 and np.dtype(c.dtype).kind == "f"):
                raise InvalidValueError(
                    f"resolution of {c.name}", "a power of 2, on numbers with a point", c.resolution, "give 2.0**-30 or 0"
                )
        self.path = Path(path)
        self._block = block
        ends = {c.group for c in columns if c.ragged}
        self._stills = [c for c in columns if c.still]
        # Written in this order, `time` last: a step counts once its time is on disk.
        steps = [Column(f"{g}/end", (), "i8", "1", "-", "row after the last of this step") for g in sorted(ends)]
        steps += sorted((c for c in columns if not c.ragged and not c.still), key=lambda c: c.name == "time")
        self._ragged = [(c, _Slot(c)) for c in columns if c.ragged]
        self._steps = [(c, _Slot(c)) for c in steps]
        self._filling = _Filling(steps, block, 0, dict.fromkeys(ends, 0), None)
        with _written(self.path):
            self._place = Place(self.path)
            try:
                self._file = h5py.File(self._place.draft, "w", libver="latest")
                self._writer = self._begin(attributes or {}, constants or {})
            except BaseException:
                self._place.abandon()  # half a head is no recording
                raise
        # If nobody closes the recording: when it is collected as garbage, or at the end of the program.
        self._forgotten = weakref.finalize(self, _end_forgotten, self._writer, self._file, self._place.release)

    def _begin(self, attributes: Mapping[str, Any], constants: Mapping[str, npt.NDArray[Any]]) -> RecordingWriter:
        """Write what is there from the start."""
        try:
            self._file.attrs.update({"format": FORMAT, "version": VERSION, "complete": False, "units": "SI: m, kg, s, N, Pa, rad"})
            self._file.attrs.update({"frames": "world: z up; quaternions are (w, x, y, z)", **attributes})
            for name, values in constants.items():
                packed = PACKED if np.size(values) else {}
                self._file.create_dataset(name, data=values, **packed).attrs["rows"] = CONSTANT
            packs = {c.name: PackedColumn(self._create(c), c.resolution) for c, _ in self._ragged + self._steps}
            stills = {c.name: self._create(c) for c in self._stills}
            self._file.swmr_mode = True
            return RecordingWriter(packs, stills, str(self.path))
        except BaseException:
            self._file.close()
            raise

    def _create(self, column: Column) -> h5py.Dataset:
        rows = RAGGED_CHUNK if column.ragged else 1 if column.still else self._block
        # The coordinates of a contact, each by itself, take a fifth less room than x y z x y z.
        apart = column.ragged and len(column.shape) == 1
        # HDF5 has no chunks of no size: a column of no fingers gets one of a row.
        chunks = (rows, *(1 if apart else max(1, n) for n in column.shape))
        data = self._file.create_dataset(
            column.name, (0, *column.shape), column.dtype, maxshape=(None, *(n or None for n in column.shape)), chunks=chunks, **PACKED
        )
        data.attrs.update({"unit": column.unit, "frame": column.frame, "what": column.what})
        if column.ragged:
            data.attrs["rows"] = f"ragged: step i has rows end[i - 1]:end[i] of {column.group}/end"
        if column.still:
            data.attrs["rows"] = STILL
        if column.resolution:
            data.attrs["resolution"] = column.resolution
        if column.labels:
            data.attrs["labels"] = list(column.labels)
        return data

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

        Values may have more digits than their column; nothing else is made to fit. Raises ``InvalidShapeError`` for a row of the wrong shape,
        ``InvalidValueError`` for values that a column cannot hold, and ``RecordingError`` if earlier rows could not be written.
        """
        self._writer.check()
        filling = self._filling
        if len(filling.ragged) == self._block:  # an interrupt came before they were handed over
            self._hand_over()
            filling = self._filling
        at = len(filling.ragged)
        counts: dict[str, int] = {}
        ragged: list[Array] = []
        for c, slot in self._ragged:
            given = _given(c, row)
            if given.shape[1:] != c.shape or given.ndim != slot.ndim or counts.setdefault(slot.group, len(given)) != len(given):
                expected = f"({', '.join(map(str, (counts.get(slot.group, 'n'), *c.shape)))})"
                raise InvalidShapeError(c.name, expected, str(given.shape), "all columns of a group have as many rows")
            # A copy: it is written later, and may be changed until then.
            ragged.append(given.astype(slot.dtype) if given.dtype.kind in slot.sure else _held(c, given).copy())
        for c, slot in self._steps:
            value: Any = row.get(c.name)
            if type(value) in slot.plain and slot.least <= value <= slot.most:  # what comes most often, the quick way
                filling.rows[c.name][at] = value
            elif c.name in row or not c.name.endswith("/end"):
                given = _given(c, row)
                if given.shape != c.shape:
                    raise InvalidShapeError(c.name, str(c.shape), str(given.shape), "one row of the column's shape")
                filling.rows[c.name][at] = given if given.dtype.kind in slot.sure else _held(c, given)
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
            self._settle()
            ragged = dict(zip((c.name for c, _ in self._ragged), zip(*full.ragged, strict=True), strict=False))
            block = Block(ragged, {name: rows[:count] for name, rows in full.rows.items()})
            ends = {group: int(full.rows[f"{group}/end"][count - 1]) for group in full.ends}
            # One statement: these steps are either still filling or ready, never both or neither.
            self._filling = _Filling((c for c, _ in self._steps), self._block, full.before + count, ends, block)
            self._give_ready()

    def _settle(self) -> None:
        with _written(self.path):
            self._place.settle()

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
            given = np.asarray(value)
            if name not in known or given.shape != known[name].shape:
                expected = str(known[name].shape) if name in known else "one of the stills of this recording"
                raise InvalidShapeError(name, expected, str(given.shape), "name it and its shape when the recording is made")
            _held(known[name], given)
        self._settle()
        self._writer.give(dict(values))
        self._writer.drain()

    def flush(self) -> None:
        """Put everything appended so far on disk, and wait for it. Raises ``RecordingError`` if it cannot be written."""
        self._hand_over()
        self._settle()
        self._writer.drain()

    def discard(self) -> None:
        """End a recording that nobody wants: nothing of it stays, and an older file keeps its place if there was no step yet to replace it."""
        if self._file:
            self._forgotten.detach()
            _end_forgotten(self._writer, self._file, self._place.abandon)

    def close(self, **attributes: Any) -> None:
        """Write what is buffered, mark the recording as complete and add ``attributes`` (dicts become JSON) to the file.

        Raises ``RecordingError`` if something could not be written; the file is closed all the same.
        """
        if not self._file:
            return
        try:
            self._end_file()
            self._settle()
            with _written(self.path), self._reopened() as file:
                file.attrs["complete"] = True
                for key, value in attributes.items():
                    file.attrs[key] = json.dumps(value) if isinstance(value, dict | list) else value
        finally:
            self._place.release()

    def _reopened(self) -> h5py.File:
        """The finished file. Whoever reads it in another process has it locked, but is not disturbed by what is added."""
        try:
            return h5py.File(self._place.target, "r+", libver="latest")
        except BlockingIOError:
            return h5py.File(self._place.target, "r+", libver="latest", locking=False)

    def _end_file(self) -> None:
        try:
            self._hand_over()
        finally:
            self._forgotten.detach()
            self._writer.stop()
            with _written(self.path):
                try:
                    self._file.close()
                except (OSError, RuntimeError):
                    self._writer.check()  # says better what was wrong
                    raise
        self._writer.check()

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
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
                self._place.release()


def _end_forgotten(writer: RecordingWriter, file: h5py.File, leave: Callable[[], None]) -> None:
    writer.stop()
    with suppress(OSError, RuntimeError):  # nobody is left to be told
        file.close()
    leave()


@contextmanager
def _written(path: Path) -> Iterator[None]:
    """What HDF5 and the file system say of a file that cannot be written, as ``RecordingError``."""
    try:
        yield
    except RecordingError:
        raise
    except (OSError, RuntimeError) as error:
        raise unwritable(str(path), error) from error


def _given(column: Column, row: Mapping[str, Any]) -> Array:
    """The value of a column as an array. Raises ``InvalidShapeError`` if there is none, or nothing that an array can be made of."""
    if column.name not in row:
        raise InvalidShapeError(column.name, "a value in every step", "none", "give a value for every column of the recording")
    try:
        return np.asarray(row[column.name])
    except ValueError as error:
        raise InvalidShapeError(column.name, f"rows of {column.shape}", str(error), "give a NumPy array") from None


@cache
def _dtype(name: str) -> np.dtype[Any]:
    """A type by its name, which NumPy would read anew every time."""
    return np.dtype(name)


def _held(column: Column, given: Array) -> Array:
    """The values as a column holds them: the same but for digits beyond its precision. Raises the errors of ``Recorder.append`` for others."""
    wanted, dtype = _dtype(column.dtype), given.dtype
    if dtype == wanted:
        return given
    if wanted.kind == "S":
        if dtype.kind != "S" or dtype.itemsize > wanted.itemsize:
            raise InvalidValueError(
                column.name, f"at most {wanted.itemsize} bytes", _shown(given), "say it in fewer words, as bytes (UTF-8)"
            )
        return given
    if dtype.kind not in "fiub":
        raise InvalidShapeError(column.name, "numbers", _shown(given), "give a number, or an array of numbers")
    whole = wanted.kind != "f" and given.size > 0
    if not (whole and dtype.kind == "f"):
        held = given.astype(wanted)
        if not whole or not np.count_nonzero(held != given):
            return held
    expected = f"whole numbers from {np.iinfo(wanted).min} to {np.iinfo(wanted).max}"
    raise InvalidValueError(column.name, expected, _shown(given), "round them yourself, or give the column another dtype")


def _shown(values: Array) -> str:
    """The beginning of some values, for a message."""
    return " ".join(f"{values!r:.60}".split())
