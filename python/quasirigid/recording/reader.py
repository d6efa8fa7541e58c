"""Recordings: what happened in every step, as an HDF5 file that can be read even if the run was killed.

A recording is a set of columns. A *step column* has one row per step. A *ragged column* has any number of rows per step
(contacts): its rows lie one after another, and the step column ``<group>/end`` says where each step's rows end, so that
the rows of step ``i`` are ``end[i - 1]:end[i]`` (from 0 for the first). A *still* has one row at most: it is written once in
the run, or never. A *constant* is there from the start: the shapes of the bodies.

The file is written in the single-writer-multiple-readers mode of HDF5, which keeps the file on disk valid at all times.
Rows are buffered and go to disk block by block, in a thread of their own, so that an append costs microseconds; a run that is killed
loses what was not written yet. After a clean end any HDF5 tool opens the file. After a kill the file still carries the writer's mark: open
it with ``Recording(path)``, or with ``h5py.File(path, "r", swmr=True)``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from operator import index
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from quasirigid.errors import RecordingError, UnknownNameError
from quasirigid.recording.file import RecordingFile, Stored, damaged

FORMAT = "quasirigid-recording"
VERSION = 4
"""1 (2026): a grasp without what a replay needs. 2: every column of a replay; contacts as the engine has them, see
``quasirigid.scene.contact_fields``. 3: texts have a fixed length; the control point of every contact; material and mass of every body.
4: every collider of a body, and those of every contact; how deep pads are pressed in over their thickness.
"""
RAGGED = "ragged"
STILL = "still: one row, or none if the run did not get there"
CONSTANT = "constant: the same in every step"


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
    resolution: float = 0.0
    """Values are rounded to whole multiples of this, a power of 2 in the column's unit; 0: not at all."""
    constant: bool = False
    """It is there once, for all steps; ``shape`` is that of the whole, with -1 for a length that is not known beforehand."""
    values: tuple[int, int] | None = None
    """Least and largest value of a whole number that stands for something: a body, a label. Readers refuse others."""

    def __post_init__(self) -> None:
        for field in ("name", "dtype", "unit", "frame", "what"):
            if not isinstance(getattr(self, field), str):
                raise TypeError(f"{field} of a column must be a text, not {type(getattr(self, field)).__name__}")
        object.__setattr__(self, "shape", tuple(index(size) for size in self.shape))
        object.__setattr__(self, "labels", tuple(map(str, self.labels)))

    @property
    def group(self) -> str:
        """The part of the name before the last slash."""
        return self.name.rpartition("/")[0]


class Recording:
    """Reads a recording: ``recording["object/velocity"]`` is a NumPy array with one row per step.

    Works on files of finished, interrupted, killed and running jobs alike; ``complete`` tells. What is there when the file is opened can be
    read, also if its run goes on. Nothing that is in a file makes a program hang or crash: see ``recording.file``. Whatever is read raises
    ``RecordingError`` where the file is damaged.
    """

    def __init__(self, path: str | Path) -> None:
        """Open the recording at ``path``. Raises ``RecordingError`` if there is none, if it is something else or damaged."""
        self.path = Path(path)
        self._expected: dict[str, Column] = {}
        self._file = RecordingFile(self.path)
        try:
            self._check_head()
            self._check_columns()
        except BaseException:
            self._file.close()
            raise

    def _check_head(self) -> None:
        """The attributes that every recording has."""
        head = self._file.attributes
        kind = head.get("format")
        if not isinstance(kind, str) or kind != FORMAT:  # a list of names is none either
            raise RecordingError(str(self.path), "a recording of quasirigid", "some other HDF5 file", "give the path of a recording.h5")
        version, complete = head.get("version"), head.get("complete")
        if type(version) is not int or version < 1:
            raise damaged(self.path, "attribute version", "a whole number from 1", version)
        if version > VERSION:
            expected = f"a recording of version {VERSION} or older"
            raise RecordingError(str(self.path), expected, f"version {version}", "update quasirigid to read it")
        if type(complete) is not bool:
            raise damaged(self.path, "attribute complete", "True or False", complete)
        self.version: int = version
        """Version of the format that it was written in, 1 up to ``VERSION``."""
        self.complete: bool = complete
        """True if the run that wrote it had come to its end when the file was opened."""

    def _check_columns(self) -> None:
        """Which kind of column each dataset is, and how many steps there are."""
        stored = self._file.datasets
        self.names: list[str] = list(stored)
        kinds = {name: self._kind(name) for name in stored}
        self._stills = {name for name, kind in kinds.items() if kind == STILL}
        self._constants = {name for name, kind in kinds.items() if kind == CONSTANT}
        self._ragged = {name for name, kind in kinds.items() if kind == RAGGED}
        self._step_columns = stored.keys() - self._stills - self._constants - self._ragged
        self.steps: int = min((stored[name].rows for name in self._step_columns), default=0)
        if self.complete:
            longest = max((stored[name].shape[0] for name in self._step_columns), default=0)
            for name in sorted(self._step_columns):
                if stored[name].rows < longest:
                    raise damaged(self.path, f"column {name}", f"{longest} rows, as the longest column has", stored[name].rows)
        for name in sorted(self._constants):
            item = stored[name]
            if item.shape and item.rows < item.shape[0]:
                raise damaged(self.path, f"column {name}", f"{item.shape[0]} rows", item.rows)
        self._ends: dict[str, npt.NDArray[np.int64]] = {}
        """By group of ragged columns, once they were asked for: where the rows of each step end."""

    def _kind(self, name: str) -> str:
        item = self._file.datasets[name]
        kind = item.attributes.get("rows", "")
        kind = RAGGED if isinstance(kind, str) and kind.startswith(RAGGED) else kind
        if not isinstance(kind, str) or kind not in ("", STILL, CONSTANT, RAGGED):
            raise damaged(self.path, f"attribute rows of {name}", f"none, or one that begins with {STILL}, {CONSTANT} or {RAGGED}", kind)
        if kind != CONSTANT and not item.shape:
            raise damaged(self.path, f"column {name}", "rows", "a single value")
        if kind == STILL and item.rows > 1:
            raise damaged(self.path, f"column {name}", "one row at most, as it is a still", item.rows)
        return kind

    def _ends_of(self, group: str) -> npt.NDArray[np.int64]:
        """Where the rows of each step end in a group of ragged columns."""
        if group in self._ends:
            return self._ends[group]
        members = sorted(name for name in self._ragged if name.rpartition("/")[0] == group)
        if not members:
            groups = sorted({name.rpartition("/")[0] for name in self._ragged})
            raise UnknownNameError("group", f"one of {', '.join(groups)}", group, "see Recording.names")
        name = f"{group}/end"
        item = self._file.datasets.get(name)
        if item is None or name not in self._step_columns:
            raise damaged(self.path, f"column {name}", "one row per step, as there are ragged columns beside it", "none")
        if item.dtype.kind not in "iu" or len(item.shape) != 1:
            raise damaged(self.path, f"column {name}", "one whole number per step", f"{item.dtype} of shape {item.shape}")
        ends = self._file.read(name, 0, self.steps).astype(np.int64)
        if (np.diff(ends, prepend=0) < 0).any():
            raise damaged(self.path, f"column {name}", "numbers that never fall, from 0", "some that do")
        for member in members:
            rows = self._file.datasets[member].rows
            if len(ends) and rows < ends[-1]:
                raise damaged(self.path, f"column {member}", f"{ends[-1]} rows, as {name} says", rows)
        self._ends[group] = ends
        return ends

    @property
    def attributes(self) -> dict[str, Any]:
        """Attributes of the file: format, units, frames, and what the writer added."""
        return dict(self._file.attributes)

    def unit(self, name: str) -> str:
        """Unit of a column."""
        return str(self._stored(name).attributes.get("unit", "1"))

    def labels(self, name: str) -> list[str]:
        """Names of a column's entries: bodies, fingers, stages, or phases."""
        labels = self._stored(name).attributes.get("labels", [])
        return labels if isinstance(labels, list) else []

    def column(self, name: str) -> Column:
        """What a column is: the shape of its rows, type, unit and so on. Constants have the shape of the whole."""
        item = self._stored(name)
        unit, frame, what = (str(item.attributes.get(key, default)) for key, default in (("unit", "1"), ("frame", "-"), ("what", "")))
        return Column(
            name,
            item.shape if name in self._constants else item.shape[1:],
            item.dtype.str,
            unit,
            frame,
            what,
            ragged=name in self._ragged,
            labels=tuple(self.labels(name)),
            still=name in self._stills,
            constant=name in self._constants,
        )

    def check_ends(self, group: str) -> None:
        """Raises ``RecordingError`` if the ``end`` of a group of ragged columns does not go with their rows."""
        self._ends_of(group)

    def expect(self, columns: Iterable[Column]) -> None:
        """See to it that values which are read are those that these ``columns`` may have, from now on."""
        self._expected |= {column.name: column for column in columns}

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        """A whole column: (steps, ...), (all rows, ...) for a ragged one, (1 or 0, ...) for a still; a constant as it is."""
        item = self._stored(name)
        if name in self._constants:
            return self._file.whole(name)
        if name in self._stills:
            return self._read(name, 0, item.rows)
        ends = self._ends_of(name.rpartition("/")[0]) if name in self._ragged else None
        return self._read(name, 0, self.steps if ends is None else int(ends[-1]) if len(ends) else 0)

    def row(self, name: str, step: int) -> npt.NDArray[Any]:
        """One step of a step column."""
        step = range(self.steps)[step]
        row: npt.NDArray[Any] = self._read(name, step, step + 1)[0]
        return row

    def slice(self, name: str, start: int, stop: int) -> npt.NDArray[Any]:
        """Rows ``start`` to ``stop`` of a step column or a ragged one, as of a list: what is beyond its end is left out."""
        start, stop, _ = slice(start, stop).indices(self._stored(name).rows)
        return self._read(name, start, max(start, stop))

    def rows(self, group: str, step: int) -> dict[str, npt.NDArray[Any]]:
        """The ragged rows of one step, by column name within the ``group``: ``rows("contacts", 10)["point"]``."""
        step = range(self.steps)[step]
        ends = self._ends_of(group)
        start, stop = int(ends[step - 1]) if step else 0, int(ends[step])
        columns = [name for name in self._ragged if name.rpartition("/")[0] == group]
        return {name.removeprefix(f"{group}/"): self._read(name, start, stop) for name in sorted(columns)}

    def stills(self, group: str) -> dict[str, npt.NDArray[Any]]:
        """The stills of a ``group`` by their names within it; empty if the run did not get to where they are written."""
        names = sorted(name for name in self._stills if name.startswith(f"{group}/") and self._stored(name).rows)
        return {name.removeprefix(f"{group}/"): self._read(name, 0, 1)[0] for name in names}

    def _stored(self, name: str) -> Stored:
        if name not in self._file.datasets:
            raise UnknownNameError("column", f"one of {', '.join(sorted(self.names))}", name, "see Recording.names")
        return self._file.datasets[name]

    def _read(self, name: str, start: int, stop: int) -> npt.NDArray[Any]:
        self._stored(name)
        values = self._file.read(name, start, stop)
        expected = self._expected.get(name)
        if expected is not None and expected.values is not None and values.size:
            least, most = expected.values
            if values.min() < least or values.max() > most:
                wrong = int(np.flatnonzero((values < least) | (values > most))[0])
                at = start + wrong // max(1, math.prod(values.shape[1:]))
                raise damaged(self.path, f"column {name}", f"numbers from {least} to {most}", f"{values.flat[wrong]} in row {at}")
        return values

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


__all__ = ["Column", "Recording"]
