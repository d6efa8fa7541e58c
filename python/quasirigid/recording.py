"""Recordings: what happened in every step, as an HDF5 file that can be read even if the run was killed.

A recording is a set of columns. A *step column* has one row per step. A *ragged column* has any number of rows per step
(contacts): its rows lie one after another, and the step column ``<group>/end`` says where each step's rows end, so that
the rows of step ``i`` are ``end[i - 1]:end[i]`` (from 0 for the first). A *still* has one row at most: it is written once in
the run, or never. A *constant* is there from the start: the shapes of the bodies.

The file is written in the single-writer-multiple-readers mode of HDF5, which keeps the file on disk valid at all times.
Rows are buffered and go to disk block by block, so that an append costs microseconds; a run that is killed loses the last
block at most. After a clean end any HDF5 tool opens the file. After a kill the file still carries the writer's mark: open it
with ``Recording(path)``, or with ``h5py.File(path, "r", swmr=True)``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from quasirigid.errors import InvalidShapeError, ObjectFileError, UnknownNameError

FORMAT = "quasirigid-recording"
VERSION = 2
"""1 (2026): a grasp without what a replay needs. 2: every column of a replay; contacts as the engine has them, see ``scene_recording``."""
RAGGED_CHUNK = 2048
"""Rows. The last chunk is written anew with every block, and its old place in the file is lost: few rows lose little."""
STILL = "still: one row, or none if the run did not get there"
CONSTANT = "constant: the same in every step"
PACKED: dict[str, Any] = {"compression": "gzip", "compression_opts": 1, "shuffle": True}


@dataclass(frozen=True)
class Column:
    """One column of a recording: ``shape`` is that of one row; ``unit`` and ``frame`` are written beside the data."""

    name: str
    shape: tuple[int, ...] = ()
    dtype: str = "f8"
    unit: str = "1"
    frame: str = "-"
    what: str = ""
    ragged: bool = False
    labels: tuple[str, ...] = ()
    still: bool = False

    @property
    def group(self) -> str:
        """The part of the name before the last slash."""
        return self.name.rpartition("/")[0]


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

        ``constants`` are arrays by name, written at once.
        """
        self.path = Path(path)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self.steps = 0
        self._block = block
        self._fill = 0
        ends = {c.group for c in columns if c.ragged}
        self._stills = [c for c in columns if c.still]
        # Written in this order, `time` last: a step counts once its time is on disk.
        steps = [Column(f"{g}/end", (), "i8", "1", "-", "row after the last of this step") for g in sorted(ends)]
        steps += sorted((c for c in columns if not c.ragged and not c.still), key=lambda c: c.name == "time")
        self._ragged = [c for c in columns if c.ragged]
        self._steps = steps
        self._rows = {c.name: np.zeros((block, *c.shape), c.dtype) for c in steps}
        self._pending: dict[str, list[npt.NDArray[Any]]] = {c.name: [] for c in self._ragged}
        self._end = dict.fromkeys(ends, 0)
        self._file = h5py.File(self.path, "w", libver="latest")
        try:
            self._file.attrs.update({"format": FORMAT, "version": VERSION, "complete": False, "units": "SI: m, kg, s, N, Pa, rad"})
            self._file.attrs.update({"frames": "world: z up; quaternions are (w, x, y, z)", **(attributes or {})})
            for name, values in (constants or {}).items():
                packed = PACKED if np.size(values) else {}
                self._file.create_dataset(name, data=values, **packed).attrs["rows"] = CONSTANT
            self._data = {c.name: self._create(c, RAGGED_CHUNK if c.ragged else block) for c in self._ragged + steps}
            self._data |= {c.name: self._create(c, 1) for c in self._stills}
            self._file.swmr_mode = True
        except BaseException:
            self._file.close()
            self.path.unlink(missing_ok=True)  # half a head is no recording
            raise

    def _create(self, column: Column, chunk: int) -> h5py.Dataset:
        # HDF5 has no chunks of no size: a column of no fingers gets one of a row.
        chunks = (chunk, *(max(1, n) for n in column.shape))
        data = self._file.create_dataset(
            column.name, (0, *column.shape), column.dtype, maxshape=(None, *(n or None for n in column.shape)), chunks=chunks, **PACKED
        )
        data.attrs.update({"unit": column.unit, "frame": column.frame, "what": column.what})
        if column.ragged:
            data.attrs["rows"] = f"ragged: step i has rows end[i - 1]:end[i] of {column.group}/end"
        if column.still:
            data.attrs["rows"] = STILL
        if column.labels:
            data.attrs["labels"] = list(column.labels)
        return data

    def append(self, row: Mapping[str, Any]) -> None:
        """Add one step: a value for every step column and an array for every ragged one (same length within a group)."""
        counts: dict[str, int] = {}
        ragged: list[npt.NDArray[Any]] = []
        for c in self._ragged:
            values = np.asarray(row[c.name], c.dtype)
            if values.shape[1:] != c.shape or counts.setdefault(c.group, len(values)) != len(values):
                expected = f"({counts.get(c.group, 'n')}, {', '.join(map(str, c.shape))})"
                raise InvalidShapeError(c.name, expected, str(values.shape), "all columns of a group have as many rows")
            ragged.append(values)
        for c in self._steps:
            if c.name in row:
                self._rows[c.name][self._fill] = row[c.name]
            elif not c.name.endswith("/end"):
                raise InvalidShapeError(c.name, "a value in every step", "none", "give a value for every column of the recording")
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
            self.flush()

    def still(self, values: Mapping[str, Any]) -> None:
        """Write stills, by name; they are on disk at once. A still that was written before is replaced."""
        known = {c.name: c for c in self._stills}
        for name, value in values.items():
            given = np.asarray(value)
            if name not in known or given.shape != known[name].shape:
                expected = str(known[name].shape) if name in known else "one of the stills of this recording"
                raise InvalidShapeError(name, expected, str(given.shape), "name it and its shape when the recording is made")
        for name, value in values.items():
            data = self._data[name]
            data.resize(1, axis=0)
            data[0] = value
            data.flush()

    def flush(self) -> None:
        """Put everything appended so far on disk."""
        for c in self._ragged:
            if self._pending[c.name]:
                self._extend(self._data[c.name], np.concatenate(self._pending[c.name]))
                self._pending[c.name].clear()
        if self._fill:
            for c in self._steps:
                self._extend(self._data[c.name], self._rows[c.name][: self._fill])
            self._fill = 0

    @staticmethod
    def _extend(data: h5py.Dataset, rows: npt.NDArray[Any]) -> None:
        old = data.shape[0]
        data.resize(old + len(rows), axis=0)
        data[old:] = rows
        data.flush()

    def close(self, **attributes: Any) -> None:
        """Write what is buffered, mark the recording as complete and add ``attributes`` (dicts become JSON) to the file."""
        if not self._file:
            return
        try:
            self.flush()
        finally:
            self._file.close()
        with h5py.File(self.path, "r+", libver="latest") as file:
            file.attrs["complete"] = True
            for key, value in attributes.items():
                file.attrs[key] = json.dumps(value) if isinstance(value, dict | list) else value

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if kind is None:
            self.close()
        elif self._file:
            # Interrupted: keep what there is, and leave `complete` false.
            try:
                self.flush()
            finally:
                self._file.close()


class Recording:
    """Reads a recording: ``recording["object/velocity"]`` is a NumPy array with one row per step.

    Works on files of finished, interrupted, killed and running jobs alike; ``complete`` tells.
    """

    def __init__(self, path: str | Path) -> None:
        """Open the recording at ``path``. Raises ``ObjectFileError`` if there is none or it is something else."""
        self.path = Path(path)
        try:
            self._file = h5py.File(self.path, "r", libver="latest", swmr=True)
        except FileNotFoundError:
            raise ObjectFileError(str(path), "a recording (HDF5)", "no such file", "give the path of a recording.h5") from None
        except OSError as error:
            raise ObjectFileError(str(path), "a recording (HDF5)", str(error), "give the path of a recording.h5") from None
        if self._file.attrs.get("format") != FORMAT:
            self._file.close()
            raise ObjectFileError(str(path), "a recording of quasirigid", "some other HDF5 file", "give the path of a recording.h5")
        if self.version > VERSION:
            found = f"version {self.version}"
            self._file.close()
            raise ObjectFileError(str(path), f"a recording of version {VERSION} or older", found, "update quasirigid to read it")
        self.names: list[str] = []
        self._file.visititems(lambda name, item: self.names.append(name) if isinstance(item, h5py.Dataset) else None)
        special = {name: str(self._file[name].attrs["rows"]) for name in self.names if "rows" in self._file[name].attrs}
        self._stills = {name for name, rows in special.items() if rows == STILL}
        self._constants = {name for name, rows in special.items() if rows == CONSTANT}
        self._ragged = special.keys() - self._stills - self._constants
        self.steps: int = min((self._file[name].shape[0] for name in self.names if name not in special), default=0)

    @property
    def version(self) -> int:
        """Version of the format that it was written in, 1 up to ``VERSION``."""
        return int(self._file.attrs["version"])

    @property
    def complete(self) -> bool:
        """True if the run that wrote it came to its end."""
        return bool(self._file.attrs["complete"])

    @property
    def attributes(self) -> dict[str, Any]:
        """Attributes of the file: format, units, frames, and what the writer added."""
        return dict(self._file.attrs)

    def unit(self, name: str) -> str:
        """Unit of a column."""
        return str(self._file[name].attrs["unit"])

    def labels(self, name: str) -> list[str]:
        """Names of a column's entries: bodies, fingers, stages, or phases."""
        return [str(label) for label in self._file[name].attrs.get("labels", [])]

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        """A whole column: (steps, ...), (all rows, ...) for a ragged one, (1 or 0, ...) for a still; a constant as it is."""
        if name not in self.names:
            raise UnknownNameError("column", f"one of {', '.join(sorted(self.names))}", name, "see Recording.names")
        if name in self._stills | self._constants:
            still: npt.NDArray[Any] = self._file[name][:]
            return still
        stop = self._stop(name, self.steps - 1) if name in self._ragged else self.steps
        values: npt.NDArray[Any] = self._file[name][:stop]
        return values

    def row(self, name: str, step: int) -> npt.NDArray[Any]:
        """One step of a step column."""
        values: npt.NDArray[Any] = self._file[name][range(self.steps)[step]]
        return values

    def slice(self, name: str, start: int, stop: int) -> npt.NDArray[Any]:
        """Rows ``start`` to ``stop`` of a step column or a ragged one."""
        values: npt.NDArray[Any] = self._file[name][start:stop]
        return values

    def rows(self, group: str, step: int) -> dict[str, npt.NDArray[Any]]:
        """The ragged rows of one step, by column name within the ``group``: ``rows("contacts", 10)["point"]``."""
        step = range(self.steps)[step]
        columns = [name for name in self._ragged if name.startswith(f"{group}/")]
        start = self._stop(f"{group}/end", step - 1)
        stop = self._stop(f"{group}/end", step)
        return {name.removeprefix(f"{group}/"): self._file[name][start:stop] for name in sorted(columns)}

    def stills(self, group: str) -> dict[str, npt.NDArray[Any]]:
        """The stills of a ``group`` by their names within it; empty if the run did not get to where they are written."""
        names = sorted(name for name in self._stills if name.startswith(f"{group}/") and len(self._file[name]))
        return {name.removeprefix(f"{group}/"): self._file[name][0] for name in names}

    def _stop(self, name: str, step: int) -> int:
        return int(self._file[name.rpartition("/")[0] + "/end"][step]) if step >= 0 else 0

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
