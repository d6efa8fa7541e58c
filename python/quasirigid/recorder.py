"""Writes recordings: see ``recording`` for what is in one."""

from __future__ import annotations

import json
import math
import weakref
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from quasirigid.errors import InvalidShapeError, InvalidValueError, RecordingError
from quasirigid.recording import CONSTANT, FORMAT, STILL, VERSION, Column
from quasirigid.recording_writer import LEVEL, Block, PackedColumn, RecordingWriter, unwritable

RAGGED_CHUNK = 4096
"""Rows. The last chunk is written anew with every block, and its old place in the file is lost: 9 % of the recording of a grasp, 6 % with
2048 rows and 16 % with 8192; but fewer rows compress less well.
"""
PACKED: dict[str, Any] = {"compression": "gzip", "compression_opts": LEVEL, "shuffle": True}


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
        """Create the file at ``path`` (an old one is replaced) with these ``columns``; ``block`` steps are written at a time.

        ``constants`` are arrays by name, written at once. Raises ``RecordingError`` where no file can be written.
        """
        for c in columns:
            if c.resolution and not (c.resolution > 0.0 and math.frexp(c.resolution)[0] == 0.5 and np.dtype(c.dtype).kind == "f"):
                raise InvalidValueError(
                    f"resolution of {c.name}", "a power of 2, on numbers with a point", c.resolution, "give 2.0**-30 or 0"
                )
        self.path = Path(path)
        self.steps = 0
        self._block = block
        ends = {c.group for c in columns if c.ragged}
        self._stills = [c for c in columns if c.still]
        # Written in this order, `time` last: a step counts once its time is on disk.
        steps = [Column(f"{g}/end", (), "i8", "1", "-", "row after the last of this step") for g in sorted(ends)]
        steps += sorted((c for c in columns if not c.ragged and not c.still), key=lambda c: c.name == "time")
        self._ragged = [c for c in columns if c.ragged]
        self._steps = steps
        self._end = dict.fromkeys(ends, 0)
        self._ready: Block | None = None
        self._new_block()
        with _written(self.path):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = h5py.File(self.path, "w", libver="latest")
            self._writer = self._begin(attributes or {}, constants or {})
        # If nobody closes the recording: when it is collected as garbage, or at the end of the program.
        self._forgotten = weakref.finalize(self, _end_forgotten, self._writer, self._file)

    def _new_block(self) -> None:
        self._rows = {c.name: np.zeros((self._block, *c.shape), c.dtype) for c in self._steps}
        self._pending: dict[str, list[npt.NDArray[Any]]] = {c.name: [] for c in self._ragged}
        self._fill = 0

    def _begin(self, attributes: Mapping[str, Any], constants: Mapping[str, npt.NDArray[Any]]) -> RecordingWriter:
        """Write what is there from the start."""
        try:
            self._file.attrs.update({"format": FORMAT, "version": VERSION, "complete": False, "units": "SI: m, kg, s, N, Pa, rad"})
            self._file.attrs.update({"frames": "world: z up; quaternions are (w, x, y, z)", **attributes})
            for name, values in constants.items():
                packed = PACKED if np.size(values) else {}
                self._file.create_dataset(name, data=values, **packed).attrs["rows"] = CONSTANT
            packs = {c.name: PackedColumn(self._create(c), c.resolution) for c in self._ragged + self._steps}
            stills = {c.name: self._create(c) for c in self._stills}
            self._file.swmr_mode = True
            return RecordingWriter(packs, stills, str(self.path))
        except BaseException:
            self._file.close()
            self.path.unlink(missing_ok=True)  # half a head is no recording
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
    def waited(self) -> float:
        """How long ``append`` had to wait because the disk could not follow, s."""
        return self._writer.waited

    def append(self, row: Mapping[str, Any]) -> None:
        """Add one step: a value for every step column and an array for every ragged one (same length within a group).

        Raises ``InvalidShapeError`` for a row that does not fit, and ``RecordingError`` if earlier ones could not be written.
        """
        self._writer.check()
        counts: dict[str, int] = {}
        ragged: list[npt.NDArray[Any]] = []
        for c in self._ragged:
            if c.name not in row:
                raise _missing(c)
            values = np.array(row[c.name], c.dtype)  # a copy: it is written later, and may be changed until then
            if values.shape[1:] != c.shape or counts.setdefault(c.group, len(values)) != len(values):
                expected = f"({counts.get(c.group, 'n')}, {', '.join(map(str, c.shape))})"
                raise InvalidShapeError(c.name, expected, str(values.shape), "all columns of a group have as many rows")
            ragged.append(values)
        for c in self._steps:
            if c.name in row:
                try:
                    self._rows[c.name][self._fill] = row[c.name]
                except ValueError:
                    raise InvalidShapeError(c.name, str(c.shape), str(np.shape(row[c.name])), "one row of the column's shape") from None
            elif not c.name.endswith("/end"):
                raise _missing(c)
        # Nothing was changed up to here, so that a refused row leaves nothing behind.
        for c, values in zip(self._ragged, ragged, strict=True):
            if len(values):
                self._pending[c.name].append(values)
        for group, count in counts.items():
            self._end[group] += count
            self._rows[f"{group}/end"][self._fill] = self._end[group]
        self._fill += 1
        self.steps += 1
        if self._fill == self._block:
            self._hand_over()

    def _hand_over(self) -> None:
        """Give the writer what was appended since the last time. After an interrupt it may be called again."""
        self._give_ready()
        if self._fill:
            self._ready = Block(self._pending, {name: rows[: self._fill] for name, rows in self._rows.items()})
            self._new_block()
            self._give_ready()

    def _give_ready(self) -> None:
        if self._ready is not None:
            self._writer.give(self._ready)
            self._ready = None

    def still(self, values: Mapping[str, Any]) -> None:
        """Write stills, by name; they are on disk at once. A still that was written before is replaced."""
        known = {c.name: c for c in self._stills}
        for name, value in values.items():
            given = np.asarray(value)
            if name not in known or given.shape != known[name].shape:
                expected = str(known[name].shape) if name in known else "one of the stills of this recording"
                raise InvalidShapeError(name, expected, str(given.shape), "name it and its shape when the recording is made")
        self._writer.give(dict(values))
        self._writer.drain()

    def flush(self) -> None:
        """Put everything appended so far on disk, and wait for it. Raises ``RecordingError`` if it cannot be written."""
        self._hand_over()
        self._writer.drain()

    def close(self, **attributes: Any) -> None:
        """Write what is buffered, mark the recording as complete and add ``attributes`` (dicts become JSON) to the file.

        Raises ``RecordingError`` if something could not be written; the file is closed all the same.
        """
        if not self._file:
            return
        self._end_file()
        with _written(self.path), h5py.File(self.path, "r+", libver="latest") as file:
            file.attrs["complete"] = True
            for key, value in attributes.items():
                file.attrs[key] = json.dumps(value) if isinstance(value, dict | list) else value

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


def _end_forgotten(writer: RecordingWriter, file: h5py.File) -> None:
    writer.stop()
    with suppress(OSError, RuntimeError):  # nobody is left to be told
        file.close()


@contextmanager
def _written(path: Path) -> Iterator[None]:
    """What HDF5 and the file system say of a file that cannot be written, as ``RecordingError``."""
    try:
        yield
    except RecordingError:
        raise
    except (OSError, RuntimeError) as error:
        raise unwritable(str(path), error) from error


def _missing(column: Column) -> InvalidShapeError:
    return InvalidShapeError(column.name, "a value in every step", "none", "give a value for every column of the recording")
