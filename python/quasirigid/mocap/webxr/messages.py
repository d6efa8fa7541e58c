"""What the page and the server say to each other. ``static/protocol.js`` has the other half.

Page to server, binary, one message per frame of the headset, little-endian, always ``HANDS_SIZE`` bytes::

    4 bytes   "QXH1"
    uint32    bit 0: the left hand is there, bit 1: the right one
    float64   time of the frame, s, on the page's clock
    2 x 25 x 8 float32   left, right; per joint position m, quaternion x y z w, radius m; NaN for what is not tracked

and texts, JSON: ``{"type": "recentre", "position": [x, y, z], "forward": [x, y, z]}``, eyes and view direction in the room, and
``{"type": "reset"}``, which puts the object back where it stood at the start.

Server to page: texts ``hello``, ``writer`` (``yours``: whether this page's hands are listened to), ``placement``, and packed messages
(``wire.py`` makes them): uint32 length of a JSON header, the header, then the arrays it lists under ``arrays`` as
``name: [type, offset, items]``, offsets in bytes from the end of the header, all multiples of 4.
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from quasirigid.arrays.types import FloatArray
from quasirigid.errors import PacketError
from quasirigid.mocap.webxr.joints import JOINTS

HEAD = struct.Struct("<4sId")
MAGIC = b"QXH1"
HANDS_SIZE = HEAD.size + 2 * len(JOINTS) * 8 * 4
TEXT_LIMIT = 1024
"""Longest text that a page may send, bytes."""
FAR, THICK = 100.0, 0.05
"""No joint is farther from the room's origin, or deeper under the skin, m."""
TURN_ERROR = 0.02
"""A quaternion's norm may differ from 1 by so much."""
HINT = "is the page of the same version as the server?"


def read_hands(data: bytes) -> tuple[float, dict[str, FloatArray]]:
    """Time (s) and the joints (25, 8) of the hands that are there. Raises ``PacketError`` for anything but a proper message."""
    if len(data) != HANDS_SIZE:
        raise PacketError("hand message", f"{HANDS_SIZE} bytes", len(data), HINT)
    magic, there, time = HEAD.unpack_from(data)
    if magic != MAGIC or there > 3:
        raise PacketError("head of a hand message", f"{MAGIC!r} and 0 to 3", (magic, there), HINT)
    if not (np.isfinite(time) and abs(time) < 1e9):
        raise PacketError("time of a hand message", "a finite number of seconds", time, HINT)
    with np.errstate(invalid="ignore"):  # a signalling NaN is as good as any other
        hands = np.frombuffer(data, "<f4", offset=HEAD.size).reshape(2, len(JOINTS), 8).astype(np.float64)
    return float(time), {side: _checked(hands[i]) for i, side in enumerate(("left", "right")) if there >> i & 1}


def _checked(joints: FloatArray) -> FloatArray:
    lost = np.isnan(joints).all(axis=1)
    seen = joints[~lost]
    if not np.isfinite(seen).all():
        raise PacketError("joint", "finite numbers, or NaN in all eight", "some of each", HINT)
    if not (np.abs(seen[:, :3]) <= FAR).all():
        raise PacketError("position of a joint", f"within {FAR:g} m", f"{np.abs(seen[:, :3]).max():g} m", "metres")
    if not (np.abs(np.linalg.norm(seen[:, 3:7], axis=1) - 1.0) <= TURN_ERROR).all():
        raise PacketError("orientation of a joint", "a unit quaternion", "another norm", HINT)
    if not ((seen[:, 7] >= 0.0) & (seen[:, 7] <= THICK)).all():
        raise PacketError("radius of a joint", f"0 to {THICK:g} m", "another", "metres")
    return joints


@dataclass(frozen=True, eq=False)
class Recentre:
    """A wish: the table before a person."""

    eyes: FloatArray
    """(3,) m, room."""
    forward: FloatArray
    """(3,) view direction, room."""


@dataclass(frozen=True)
class Reset:
    """A wish: the object where it stood at the start."""


def read_text(text: str) -> Recentre | Reset:
    """What a page asks for. Raises ``PacketError`` for anything else."""
    try:
        message = json.loads(text)
        if message["type"] == "reset":
            return Reset()
        if message["type"] != "recentre":
            raise ValueError(message["type"])
        eyes, forward = (np.array([float(x) for x in message[key]]) for key in ("position", "forward"))
    except (ValueError, TypeError, KeyError, RecursionError, OverflowError) as error:
        raise PacketError("text of a page", "a recentre or reset message", repr(error)[:80], HINT) from None
    if not (eyes.shape == forward.shape == (3,) and np.isfinite([eyes, forward]).all() and np.abs([eyes, forward]).max() <= FAR):
        raise PacketError("recentre message", "three finite numbers each", text[:80], HINT)
    return Recentre(eyes, forward)


def packed(header: dict[str, Any], arrays: dict[str, npt.NDArray[Any]]) -> bytes:
    """A message with arrays."""
    table, blocks, at = {}, [], 0
    for name, array in arrays.items():
        block = np.ascontiguousarray(array).tobytes()
        block += bytes(-len(block) % 4)
        table[name] = [array.dtype.name, at, int(array.size)]
        blocks.append(block)
        at += len(block)
    text = json.dumps(header | {"arrays": table}, allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    return b"".join([struct.pack("<I", len(text)), text, *blocks])
