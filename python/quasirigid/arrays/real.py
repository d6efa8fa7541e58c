"""Arrays from outside: real numbers, all of them known. NumPy alone would drop imaginary parts and masks without an error."""

from __future__ import annotations

from typing import Any

import numpy as np

from quasirigid.arrays.types import FloatArray
from quasirigid.errors import InvalidShapeError, InvalidValueError

__all__ = ["finite_array", "real_array", "refuse_masked"]


def refuse_masked(what: str, value: object) -> None:
    """Raises ``InvalidValueError`` for a masked array, or a list that has one in it: the numbers under the masks are not data."""
    if isinstance(value, list | tuple):
        masked = any(isinstance(item, np.ma.MaskedArray) for item in value)
    else:
        masked = isinstance(value, np.ma.MaskedArray)
    if masked:
        hint = "fill the masked entries, array.filled(0.0), or leave them out, array.compressed()"
        raise InvalidValueError(what, "numbers, all of them known", "a masked array", hint)


def real_array(what: str, value: Any, shape: str) -> FloatArray:
    """An array-like as an array of real numbers, of whatever shape; ``shape`` is for the error.

    Raises ``InvalidShapeError`` for what is no array of real numbers (texts, dates, complex numbers, ragged lists) and
    ``InvalidValueError`` for a masked array.
    """
    refuse_masked(what, value)
    got = type(value).__name__
    try:
        array = np.asarray(value)
        if array.ndim and array.dtype.kind not in "biufO":
            got = f"{got} of {array.dtype}"
        elif array.ndim:
            numbers: FloatArray = array.astype(np.float64, copy=False)
            return numbers
    except (TypeError, ValueError, OverflowError, MemoryError):
        pass
    raise InvalidShapeError(what, f"numbers of shape {shape}", got, "give an array of real numbers")


def finite_array(what: str, value: Any, shape: str) -> FloatArray:
    """``real_array`` of numbers that are finite; raises ``InvalidValueError`` for NaN and infinity."""
    numbers = real_array(what, value, shape)
    if not np.isfinite(numbers).all():
        got = f"{np.count_nonzero(~np.isfinite(numbers))} of {numbers.size} NaN or infinite"
        raise InvalidValueError(what, "finite numbers only", got, "look at where they come from")
    return numbers
