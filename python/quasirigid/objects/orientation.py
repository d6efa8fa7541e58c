"""Which way up an object stands: rotations in words, from the axes of its file to those of the world (z up)."""

from __future__ import annotations

import math
import re
from typing import Literal

import numpy as np

from quasirigid.arrays.types import FloatArray
from quasirigid.errors import InvalidValueError, UnknownNameError

Up = Literal["x", "y", "z", "-x", "-y", "-z"]
SIDES: tuple[Up, ...] = ("z", "y", "x", "-z", "-y", "-x")
"""Axes of a file that can point up; most files have z or y."""

_TO_Z = {"z": "0 about z", "y": "90 about x", "-y": "-90 about x", "x": "-90 about y", "-x": "90 about y", "-z": "180 about x"}
_EXAMPLE = '"90 about x", or "90 about x, 45 about z" for one after the other; degrees'


def rotation_of(up: str = "z", rotate: str | None = None) -> FloatArray:
    """The rotation (3, 3) that makes the file's axis ``up`` point along +z, and then turns as ``rotate`` says.

    Args:
        up: an axis of the file: "x", "y", "z", "-x", "-y" or "-z".
        rotate: rotations about the world's axes in degrees, one after the other: "90 about x", "x 90" or "90 about x, 45 about z".
            Counterclockwise as seen from the tip of the axis.

    Raises:
        UnknownNameError: no such axis.
        InvalidValueError: words that are no rotation.

    Example:
        >>> rotation_of("y") @ [0.0, 1.0, 0.0]
        array([0., 0., 1.])
    """
    if up not in SIDES:
        raise UnknownNameError("up", ", ".join(SIDES), repr(up), "name the axis of the file that points up: y in many modelling programs")
    total = np.eye(3)
    for words in (_TO_Z[up],) if rotate is None else (_TO_Z[up], rotate):
        if not isinstance(words, str):
            raise InvalidValueError("rotate", _EXAMPLE, repr(words), "give the rotation in words")
        for part in words.split(","):
            total = _turn(part, words) @ total
    return total


def suggestion(turned: FloatArray, side: str) -> str:
    """How to ask for an object, turned by ``turned`` (3, 3) already, with what is now its axis ``side`` up."""
    wanted = rotation_of(side) @ turned
    for up in SIDES:
        if np.allclose(rotation_of(up)[2], wanted[2], atol=1e-9):
            return f'--up {up}, in Python load_object(..., up="{up}")'
    return f'another rotation "{_TO_Z[side]}" behind those of --rotate'


def _turn(part: str, words: str) -> FloatArray:
    found = re.fullmatch(
        r"(?:about\s+)?(?P<a>[xyz]\s+)?(?P<n>[-+]?[0-9.]+(?:e[-+]?[0-9]+)?)\s*(?:degrees?|deg|°)?(?P<b>(?:\s+about)?\s+[xyz])?",
        part.strip(),
    )
    axes = [] if found is None else [axis.split()[-1] for axis in (found["a"], found["b"]) if axis]
    try:
        degrees = math.nan if found is None else float(found["n"])
    except ValueError:
        degrees = math.nan
    if len(axes) != 1 or not math.isfinite(degrees):
        raise InvalidValueError(
            "rotate", f"rotations such as {_EXAMPLE}", repr(words), "say an angle and one of the axes x, y and z for each"
        )
    cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    if degrees % 90.0 == 0.0:  # exact, so that a box stays along the axes
        cosine, sine = float(round(cosine)), float(round(sine))
    axis = "xyz".index(axes[0])
    first, second = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[first, first] = turn[second, second] = cosine
    turn[second, first], turn[first, second] = sine, -sine
    return turn
