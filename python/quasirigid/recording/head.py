"""What a recording may be made with: its columns, attributes and constants, checked before there is a file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from quasirigid.errors import InvalidValueError
from quasirigid.recording.attributes import as_array
from quasirigid.recording.reader import Column

RESERVED = ("format", "version", "complete")
"""Attributes by which a recording is known."""


def check_head(columns: Sequence[Column], attributes: Mapping[str, Any], constants: Mapping[str, Any], block: int) -> None:
    """Raises ``InvalidValueError`` for what no recording can have."""
    if type(block) is not int or block < 1:
        raise InvalidValueError("block", "at least 1 step", block, "leave it out for 100")
    names: set[str] = set()
    for c in columns:
        where = f"column {c.name}"
        try:
            dtype = np.dtype(c.dtype)
        except TypeError as error:
            raise InvalidValueError(
                f"dtype of {where}", "the name of a NumPy type", error, "give f8, f4, i8, u1, S16 or the like"
            ) from None
        if dtype.kind not in "fiubS" or not dtype.itemsize:
            raise InvalidValueError(
                f"dtype of {where}", "numbers, or texts of a fixed length", c.dtype, "give f8, f4, i8, u1, S16 or the like"
            )
        if c.resolution and not (c.resolution > 0.0 and math.frexp(c.resolution)[0] == 0.5 and dtype.kind == "f"):
            raise InvalidValueError(f"resolution of {c.name}", "a power of 2, on numbers with a point", c.resolution, "give 2.0**-30 or 0")
        if c.constant and c.name not in constants:
            raise InvalidValueError(where, "a value among the constants", "none", "give it, or leave the column out")
        if not all(part and part != "." for part in c.name.split("/")):
            raise InvalidValueError(where, "parts with a name between slashes", c.name, "such as object/pose")
        names |= {f"{c.group}/end"} if c.ragged else set()
    own = [c.name for c in columns if not c.constant] + list(constants)
    for name in own:
        parents = {name.rsplit("/", i)[0] for i in range(1, name.count("/") + 1)}
        if name in names or parents & names or own.count(name) > 1 or parents & set(own):
            raise InvalidValueError(
                f"column {name}", "a name of its own", "that of another column, or of its group", "give it another name"
            )
    for name, values in constants.items():
        as_array(name, values)
    check_attributes(attributes)


def check_attributes(attributes: Mapping[str, Any]) -> None:
    """Raises ``InvalidValueError`` for attributes that no file can hold."""
    for name, value in attributes.items():
        if name in RESERVED:
            raise InvalidValueError(f"attribute {name}", "a name that the format does not use itself", name, "give it another name")
        as_array(name, value)


__all__ = ["check_attributes", "check_head"]
