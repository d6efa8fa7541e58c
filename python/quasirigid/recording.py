"""Recordings: what happened in every step, as an HDF5 file that can be read even if the run was killed.

A recording is a set of columns. A *step column* has one row per step. A *ragged column* has any number of rows per step
(contacts): its rows lie one after another, and the step column ``<group>/end`` says where each step's rows end, so that
the rows of step ``i`` are ``end[i - 1]:end[i]`` (from 0 for the first). A *still* has one row at most: it is written once in
the run, or never. A *constant* is there from the start: the shapes of the bodies.

The file is written in the single-writer-multiple-readers mode of HDF5, which keeps the file on disk valid at all times.
Rows are buffered and go to disk block by block, in a thread of their own, so that an append costs microseconds; a run that is killed
loses what was not written yet. After a clean end any HDF5 tool opens the file. After a kill the file still carries the writer's mark: open it
with ``Recording(path)``, or with ``h5py.File(path, "r", swmr=True)``.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import h5py
import numpy.typing as npt

from quasirigid.errors import ObjectFileError, UnknownNameError

FORMAT = "quasirigid-recording"
VERSION = 2
"""1 (2026): a grasp without what a replay needs. 2: every column of a replay; contacts as the engine has them, see ``scene_recording``."""
STILL = "still: one row, or none if the run did not get there"
CONSTANT = "constant: the same in every step"
Rows: TypeAlias = slice | int
ATTEMPTS = 28
"""How often HDF5 reads anew what does not have its checksum, in case it is just being written: every pause is twice the one before, 0.3 s in all.
Its own 100 attempts would never come to an end in a file that is damaged.
"""
EOF_AT, EOF_SIZE = 28, 8
"""Where a file of HDF5 (superblock of version 3, as recordings have) says how long it is at least, bytes."""


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

    @property
    def group(self) -> str:
        """The part of the name before the last slash."""
        return self.name.rpartition("/")[0]


class Recording:
    """Reads a recording: ``recording["object/velocity"]`` is a NumPy array with one row per step.

    Works on files of finished, interrupted, killed and running jobs alike; ``complete`` tells. Whatever is read raises ``ObjectFileError``
    where the file is damaged.
    """

    def __init__(self, path: str | Path) -> None:
        """Open the recording at ``path``. Raises ``ObjectFileError`` if there is none or it is something else."""
        self.path = Path(path)
        try:
            self._file = _opened(self.path)
        except FileNotFoundError:
            raise ObjectFileError(str(path), "a recording (HDF5)", "no such file", "give the path of a recording.h5") from None
        except OSError as error:
            found = "a directory" if self.path.is_dir() else str(error)
            raise ObjectFileError(str(path), "a recording (HDF5)", found, "give the path of a recording.h5") from None
        try:
            with _readable(self.path):
                self._look()
        except BaseException:
            self._file.close()
            raise

    def _look(self) -> None:
        """Find out what is in the file."""
        if self._file.attrs.get("format") != FORMAT:
            size, whole = _sizes(self.path)
            if size < whole:
                raise OSError("its attributes are missing")
            raise ObjectFileError(str(self.path), "a recording of quasirigid", "some other HDF5 file", "give the path of a recording.h5")
        if self.version > VERSION:
            expected = f"a recording of version {VERSION} or older"
            raise ObjectFileError(str(self.path), expected, f"version {self.version}", "update quasirigid to read it")
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
        if name in self._stills | self._constants:
            return self._read(name, slice(None))
        return self._read(name, slice(self._stop(name, self.steps - 1) if name in self._ragged else self.steps))

    def row(self, name: str, step: int) -> npt.NDArray[Any]:
        """One step of a step column."""
        return self._read(name, range(self.steps)[step])

    def slice(self, name: str, start: int, stop: int) -> npt.NDArray[Any]:
        """Rows ``start`` to ``stop`` of a step column or a ragged one."""
        return self._read(name, slice(start, stop))

    def rows(self, group: str, step: int) -> dict[str, npt.NDArray[Any]]:
        """The ragged rows of one step, by column name within the ``group``: ``rows("contacts", 10)["point"]``."""
        step = range(self.steps)[step]
        columns = [name for name in self._ragged if name.startswith(f"{group}/")]
        mine = slice(self._stop(f"{group}/end", step - 1), self._stop(f"{group}/end", step))
        return {name.removeprefix(f"{group}/"): self._read(name, mine) for name in sorted(columns)}

    def stills(self, group: str) -> dict[str, npt.NDArray[Any]]:
        """The stills of a ``group`` by their names within it; empty if the run did not get to where they are written."""
        names = sorted(name for name in self._stills if name.startswith(f"{group}/") and len(self._file[name]))
        return {name.removeprefix(f"{group}/"): self._read(name, 0) for name in names}

    def _stop(self, name: str, step: int) -> int:
        return int(self._read(name.rpartition("/")[0] + "/end", step)) if step >= 0 else 0

    def _read(self, name: str, rows: Rows) -> npt.NDArray[Any]:
        if name not in self.names:
            raise UnknownNameError("column", f"one of {', '.join(sorted(self.names))}", name, "see Recording.names")
        with _readable(self.path):
            values: npt.NDArray[Any] = self._file[name][rows]
        return values

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _opened(path: Path) -> h5py.File:
    """The file, as one that may still be written. Raises ``OSError`` where it cannot be opened."""
    access = h5py.h5p.create(h5py.h5p.FILE_ACCESS)
    access.set_libver_bounds(h5py.h5f.LIBVER_LATEST, h5py.h5f.LIBVER_LATEST)
    with suppress(AttributeError):  # h5py does not offer it, and on Windows it cannot be found through h5py
        set_attempts = ctypes.CDLL(h5py.h5p.__file__).H5Pset_metadata_read_attempts
        set_attempts.argtypes = (ctypes.c_int64, ctypes.c_uint)
        set_attempts(access.id, ATTEMPTS)
    return h5py.File(h5py.h5f.open(bytes(path), h5py.h5f.ACC_RDONLY | h5py.h5f.ACC_SWMR_READ, fapl=access))


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """What HDF5 says of a file that it cannot make sense of, as ``ObjectFileError``."""
    try:
        yield
    except ObjectFileError:
        raise
    except (OSError, RuntimeError, KeyError) as error:
        found, hint = " ".join(str(error).split()), "the file is damaged: record again"
        size, whole = _sizes(path)
        if size < whole:  # of a full disk, too: then what is there may well be read
            found, hint = f"{size:,} of {whole:,} bytes", "its end is missing: copy it again, or record again"
        raise ObjectFileError(str(path), "a recording that can be read", found, hint) from error


def _sizes(path: Path) -> tuple[int, int]:
    """How long the file is, and how long it says that it is at least, bytes."""
    with path.open("rb") as file:
        head = file.read(EOF_AT + EOF_SIZE)
    return path.stat().st_size, int.from_bytes(head[EOF_AT:], "little")
