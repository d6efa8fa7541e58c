"""What a column of a recording must be like: checked once, when a recording is opened, for all who read it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from quasirigid.recording.file import damaged
from quasirigid.recording.reader import Column, Recording

ANY = -1
"""A length that is not known beforehand, in the shape of a column."""


def described(column: Column, like: Column | None = None) -> str:
    """Rows, type, shape and unit of a column in words. Lengths that are ``ANY`` in ``like``, or in the column itself, are called n."""
    free = (column if like is None else like).shape
    free = free if len(free) == len(column.shape) else column.shape
    lengths = ["n" if ANY in (length, known) else str(length) for length, known in zip(column.shape, free, strict=True)]
    shape = f"({', '.join(lengths)}{',' if len(lengths) == 1 else ''})"
    rows = (
        "a constant"
        if column.constant
        else "a still"
        if column.still
        else f"{'any number of rows' if column.ragged else 'one row'} per step"
    )
    return f"{rows}, {np.dtype(column.dtype)} of shape {shape}, unit {column.unit}, frame {column.frame}"


def check_columns(recording: Recording, expected: Iterable[Column], since: Mapping[str, int] | None = None) -> None:
    """See to it that a recording has these columns, as they are described here, and holds no other values than they may have.

    ``since`` is the version of the format in which a column came: older recordings do without it. Raises ``RecordingError``, which names
    the column, what was expected and what came.
    """
    expected = list(expected)
    for column in expected:
        where = f"column {column.name}"
        if column.name not in recording.names:
            if recording.version < (since or {}).get(column.name, 0):
                continue
            raise damaged(recording.path, where, described(column), "no such column")
        found = recording.column(column.name)
        if described(found, column) != described(column):
            raise damaged(recording.path, where, described(column), described(found, column))
        if column.labels and found.labels != column.labels:
            raise damaged(recording.path, f"labels of {where}", ", ".join(column.labels), ", ".join(found.labels) or "none")
    recording.expect(expected)


__all__ = ["ANY", "check_columns", "described"]
