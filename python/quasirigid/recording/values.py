"""What a column of a recording holds: a value that is given for a row is held as it is, or refused."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from quasirigid.arrays.real import refuse_masked
from quasirigid.arrays.types import AnyArray
from quasirigid.errors import InvalidShapeError, InvalidValueError
from quasirigid.recording.reader import Column


class Slot:
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


def given_value(column: Column, row: Mapping[str, Any]) -> AnyArray:
    """The value of a column as an array. Raises ``InvalidShapeError`` if there is none, or nothing that an array can be made of."""
    if column.name not in row:
        raise InvalidShapeError(column.name, "a value in every step", "none", "give a value for every column of the recording")
    refuse_masked(column.name, row[column.name])
    try:
        return np.asarray(row[column.name])
    except ValueError as error:
        raise InvalidShapeError(column.name, f"rows of {column.shape}", str(error), "give a NumPy array") from None


@cache
def _dtype(name: str) -> np.dtype[Any]:
    """A type by its name, which NumPy would parse again every time."""
    return np.dtype(name)


def held_value(column: Column, given: AnyArray) -> AnyArray:
    """The values as a column holds them: the same but for digits beyond its precision. Raises the errors of
    ``Recorder.append`` for others.
    """
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


def _shown(values: AnyArray) -> str:
    """The beginning of some values, for a message."""
    return " ".join(f"{values!r:.60}".split())


__all__ = ["Slot", "given_value", "held_value"]
