"""Values that no function is made for, and ordinary ones to get behind the first check."""

from __future__ import annotations

from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

Random = np.random.Generator


class OddFloat(float):
    """A subclass of a plain type."""


class OddInt(int):
    """Another one."""


class OddText(str):
    """And another."""


class OddArray(np.ndarray):
    """A subclass of an array."""


class OddError(Exception):
    """What odd objects raise when they are asked for what they seem to be: it is theirs to come through."""


class BadLength:
    """Says that it is a sequence, and raises."""

    def __len__(self) -> int:
        raise OddError("no length")

    def __getitem__(self, key: object) -> object:
        raise OddError("no item")


class BadNumber:
    """Says that it is a number and an array, and raises."""

    def __float__(self) -> float:
        raise OddError("no number")

    def __index__(self) -> int:
        raise OddError("no index")

    def __array__(self, *_: object, **__: object) -> Any:
        raise OddError("no array")


NUMBERS: list[Any] = [
    0, 1, 2, 3, -1, 5, 60, 400, 0.0, -0.0, 0.01, 0.5, 1.0, -1.0, 1e-3, 1e-300, 5e-324, 1e300, -1e300, 1e9, float("nan"), float("inf"),
    float("-inf"),
    2**31, 2**32, 2**63, 2**64, -(2**63) - 1, 10**400, True, False, OddFloat(0.5), OddInt(3), np.float32(0.1), np.float64(1.5), np.int8(3),
    np.uint64(2**63),
    np.bool_(True), np.array(0.5), np.array([2]), Decimal("0.5"), Fraction(1, 3), 1j, np.longdouble(0.5), np.float16(2.0), BadNumber(),
]  # fmt: skip
TEXTS: list[Any] = [
    "", "rubber", "wood", "fixed", "inertial", "quasi-static", "left", "right", "local", "half-space", "world", "minimum", "ü\N{SNOWMAN}",
    "\0", "a" * 10_000,
    "\ud800", OddText("rubber"), "5000", "127.0.0.1:1", "thumb=0,index=1", "nan", "1", b"rubber", bytearray(b"fr 1\r\n6d 0\r\n"),
    b"fr 1\r\n6d 0\r\n",
    Path("nowhere/at/all"), "no/such/folder/file.h5", ".", "\\", "%s{0}",
]  # fmt: skip
OTHERS: list[Any] = [
    None, ..., (), [], {}, set(), object(), int, lambda *_: 1, [None], [[]], [1, [2, 3]], ["a", "b"], {"x": 1}, range(3), range(10**12),
    iter([1, 2, 3]), NotImplemented,
    slice(None), BadLength(), memoryview(b"abc"), np.datetime64("2020-01-01"), np.array(["a"]), np.array([None, 1.0]),
    np.ma.masked_array([1.0, 2.0, 3.0], [0, 1, 0]),
    ValueError("x"), complex("nan"),
]  # fmt: skip
SHAPES = [
    (),
    (0,),
    (1,),
    (2,),
    (3,),
    (4,),
    (6,),
    (3, 3),
    (6, 3),
    (6, 4),
    (3, 4),
    (12, 3),
    (0, 3),
    (3, 0),
    (3, 1),
    (1, 3),
    (2, 3, 4),
    (40, 3),
    (30, 30),
    (9, 9),
]
SPECIAL = [float("nan"), float("inf"), -float("inf"), 0.0, -0.0, 1e300, -1e300, 5e-324, 1e-160, 1e160]
DTYPES = ["f8", "f8", "f8", "f4", "f2", "i8", "i4", "u1", "?", "O", "c16", "U3", "M8[s]", "g", ">f8"]


def array(rng: Random) -> Any:
    """An array: of any shape and type, sometimes with special numbers in it, read-only, not contiguous, of a subclass, or a list."""
    shape = SHAPES[rng.integers(len(SHAPES))]
    values = rng.normal(size=shape) * 10.0 ** rng.integers(-4, 3)
    if rng.random() < 0.25 and values.size:
        values = np.array(values)
        values.flat[rng.integers(values.size)] = SPECIAL[rng.integers(len(SPECIAL))]
    if rng.random() < 0.1:
        values = np.full(shape, SPECIAL[rng.integers(len(SPECIAL))])
    with np.errstate(all="ignore"):
        made: Any = np.asarray(values).astype(DTYPES[rng.integers(len(DTYPES))])
    match rng.integers(8):
        case 0:
            made = made.tolist()
        case 1:
            made.setflags(write=False)
        case 2:
            made = np.asfortranarray(made)
        case 3 if made.ndim:
            made = np.repeat(made, 2, axis=0)[::2]
        case 4 if made.ndim:
            made = made[::-1]
        case 5:
            made = made.view(OddArray)
        case 6:
            made = np.broadcast_to(made, made.shape)
    return made


def unit_rows(rng: Random) -> Any:
    """Points or directions as a function would have them."""
    rows = rng.normal(size=(int(rng.choice([3, 6, 12, 40, 200])), 3))
    return rows / np.linalg.norm(rows, axis=1, keepdims=True) * rng.choice([1.0, 0.02])


def any_value(rng: Random, things: Callable[[Random], Any]) -> Any:
    """Anything; ``things`` draws an object of the package."""
    draw = rng.random()
    if draw < 0.28:
        return NUMBERS[rng.integers(len(NUMBERS))]
    if draw < 0.50:
        return array(rng)
    if draw < 0.56:
        return unit_rows(rng)
    if draw < 0.70:
        return TEXTS[rng.integers(len(TEXTS))]
    if draw < 0.80:
        return OTHERS[rng.integers(len(OTHERS))]
    return things(rng)
