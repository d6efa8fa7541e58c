"""Spoils bytes and texts as disks, editors and other programs do. All chance comes from ``rng``."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

import numpy as np

Rng = np.random.Generator

NUMBER = re.compile(rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
ODD_NUMBERS = (
    b"0", b"-0", b"-1", b"1", b"2", b"3", b"1e-400", b"1e400", b"1e308", b"-1e308", b"1e-30", b"nan", b"inf", b"-inf", b"4294967295",
    b"2147483648", b"-2147483649", b"9223372036854775807", b"18446744073709551616", b"99999999999999999999999999", b"", b"x", b"0x10",
    b"1,5", b"1/2", b"--3", b"1e", b"1_000", b"\xc2\xbd", b"\xff", b"true", b"null", b"[]", b'"1"', b"1000000000",
)  # fmt: skip
ODD_INTEGERS = (0, 1, -1, 2, 3, 127, 128, 255, 32767, 65535, 2**31 - 1, -(2**31), 2**32 - 1, 2**40, 2**63 - 1, -(2**63), 2**62)


def _at(rng: Rng, length: int) -> int:
    """A place in a file: anywhere, or near its start, where the headers are."""
    return int(rng.integers(0, length + 1)) if rng.random() < 0.6 else int(rng.integers(0, min(length, 200) + 1))


def flip_bits(rng: Rng, data: bytes) -> bytes:
    """A few bits somewhere."""
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 9))):
        if out:
            out[min(_at(rng, len(out)), len(out) - 1)] ^= 1 << int(rng.integers(8))
    return bytes(out)


def overwrite(rng: Rng, data: bytes) -> bytes:
    """A stretch of zeros, of 0xff, or of noise."""
    start, length = _at(rng, len(data)), int(rng.integers(1, 65))
    fill = (b"\x00" * length, b"\xff" * length, rng.bytes(length))[int(rng.integers(3))]
    return data[:start] + fill[: max(0, len(data) - start)] + data[start + length :]


def write_integer(rng: Rng, data: bytes) -> bytes:
    """An odd number in the place of a count, an offset or an index."""
    width = int(rng.choice([1, 2, 4, 8]))
    value = int(ODD_INTEGERS[int(rng.integers(len(ODD_INTEGERS)))]) % 2 ** (8 * width)
    start = _at(rng, len(data)) // width * width if rng.random() < 0.7 else _at(rng, len(data))
    return data[:start] + value.to_bytes(width, ("little", "big")[int(rng.integers(2))]) + data[start + width :]


def cut(rng: Rng, data: bytes) -> bytes:
    """The end is missing, or the start."""
    start = _at(rng, len(data))
    return data[:start] if rng.random() < 0.8 else data[start:]


def remove(rng: Rng, data: bytes) -> bytes:
    """A stretch is missing."""
    start, length = _at(rng, len(data)), int(rng.integers(1, max(2, len(data) // 4)))
    return data[:start] + data[start + length :]


def repeat(rng: Rng, data: bytes) -> bytes:
    """A stretch comes twice, at its place or elsewhere."""
    start, length = _at(rng, len(data)), int(rng.integers(1, max(2, len(data) // 4)))
    to = start + length if rng.random() < 0.5 else _at(rng, len(data))
    return data[:to] + data[start : start + length] + data[to:]


def insert(rng: Rng, data: bytes) -> bytes:
    """Bytes that do not belong there."""
    start = _at(rng, len(data)) if rng.random() < 0.7 else len(data)
    return data[:start] + rng.bytes(int(rng.integers(1, 100))) + data[start:]


def change_numbers(rng: Rng, data: bytes) -> bytes:
    """Odd numbers in the place of one or a few."""
    places = list(NUMBER.finditer(data))
    if not places:
        return flip_bits(rng, data)
    # Half of the time those near the start: counts, sizes, versions.
    reach = len(places) if rng.random() < 0.5 else min(len(places), 12)
    for index in sorted(set(rng.integers(0, reach, int(rng.integers(1, 4))).tolist()), reverse=True):
        place = places[index]
        new = ODD_NUMBERS[int(rng.integers(len(ODD_NUMBERS)))]
        if rng.random() < 0.3 and place[0].isdigit():
            new = str(max(0, int(place[0]) + int(rng.integers(-2, 3)))).encode()
        data = data[: place.start()] + new + data[place.end() :]
    return data


def change_tokens(rng: Rng, data: bytes) -> bytes:
    """A word is missing, comes twice, or is another of the same file."""
    parts = re.split(rb"(\s+)", data)
    if len(parts) < 3:
        return cut(rng, data)
    index = int(rng.integers(0, len(parts) if rng.random() < 0.5 else min(len(parts), 40)))
    other = parts[int(rng.integers(0, len(parts)))]
    parts[index] = (b"", parts[index] + b" " + parts[index], other)[int(rng.integers(3))]
    return b"".join(parts)


def change_lines(rng: Rng, data: bytes) -> bytes:
    """A line is missing, comes often, changes places with another, or is very long."""
    lines = data.split(b"\n")
    i, j = (int(k) for k in rng.integers(0, len(lines), 2))
    choice = int(rng.integers(5))
    if choice == 0:
        del lines[i]
    elif choice == 1:
        lines[i:i] = [lines[i]] * int(rng.integers(1, 30))
    elif choice == 2:
        lines[i], lines[j] = lines[j], lines[i]
    elif choice == 3:
        lines[i] = lines[i] * int(rng.integers(2, 200))
    else:
        lines[i] = lines[i][: int(rng.integers(0, len(lines[i]) + 1))]
    return b"\n".join(lines)


def change_ends(rng: Rng, data: bytes) -> bytes:
    """Other ends of line, a byte order mark, another encoding."""
    choice = int(rng.integers(4))
    if choice == 0:
        return data.replace(b"\n", b"\r\n")
    if choice == 1:
        return data.replace(b"\n", b"\r")
    if choice == 2:
        return b"\xef\xbb\xbf" + data
    return data.decode("latin-1").encode("utf-16")


BYTES: Sequence[Callable[[Rng, bytes], bytes]] = (flip_bits, overwrite, write_integer, write_integer, cut, remove, repeat, insert)
TEXTS: Sequence[Callable[[Rng, bytes], bytes]] = (change_numbers, change_numbers, change_numbers, change_tokens, change_lines, change_ends)


def is_text(data: bytes) -> bool:
    """Whether most of it can be read."""
    head = data[:400]
    return sum(32 <= byte < 127 or byte in (9, 10, 13) for byte in head) > 0.95 * len(head)


def spoil(rng: Rng, data: bytes) -> bytes:
    """One to three changes. Texts are mostly changed as texts; text headers of binary files often."""
    text = is_text(data)
    for _ in range(int(rng.choice([1, 1, 1, 2, 3]))):
        kinds = TEXTS if rng.random() < (0.75 if text else 0.25) else BYTES
        data = kinds[int(rng.integers(len(kinds)))](rng, data)
    return data
