"""What the fingers feel, sent to the person: contact forces and slip, for vibrotactile or force devices.

``udp:HOST:PORT`` sends one JSON object per datagram; ``tfb:HOST[:PORT][/HAND]`` the line ``tfb`` that drives the tactile thimbles of ART's
fingertracking, to the controller's UDP port 50110; ``ws:PORT`` the JSON object to whoever connects by websocket
(``quasirigid.mocap.feedback_server``).
"""

from __future__ import annotations

import ipaddress
import json
import math
import socket
import time
from typing import Any, Protocol

from quasirigid.errors import InvalidValueError
from quasirigid.mocap import PARTS
from quasirigid.mocap.look import Look

TFB_PORT = 50_110
FULL_FORCE = 5.0
"""Pressing force at which a thimble is told its full strength, N."""
RATE = 60.0
"""Times per second, unless told otherwise."""
TARGETS = "udp:HOST:PORT, ws:PORT, ws:HOST:PORT or tfb:HOST[:PORT][/HAND]"
FAREWELLS, APART = 3, 0.02
"""How often thimbles are told that it is over, since datagrams get lost, and how far apart, s."""


class Sink(Protocol):
    """Something that a look is made into bytes for."""

    def encode(self, look: Look) -> bytes:
        """One datagram."""

    def farewell(self, last: Look) -> bytes | None:
        """What ends it after ``last``; ``None`` if nothing does."""


class JsonSink:
    """A JSON object: ``time`` s, ``phase``, and for each finger ``force`` (3) N on it, world, ``pressing`` N, ``slip`` 0 to 1, ``state``."""

    def encode(self, look: Look) -> bytes:
        """One datagram."""
        return json.dumps(as_json(look), allow_nan=False).encode()

    def farewell(self, last: Look) -> None:
        """Nothing: who listens has the time of every look."""


class TfbSink:
    """DTrack's tactile feedback: strengths 0 to 1 of the fingers of one hand."""

    def __init__(self, hand: int | None = None, full_force: float = FULL_FORCE) -> None:
        """``hand`` is DTrack's number of the hand, from 0; ``None`` for that of the tracked one. ``full_force`` N."""
        self._hand, self._full = hand, full_force

    def encode(self, look: Look) -> bytes:
        """``tfb n`` and for each finger ``[hand finger 1.0 strength]``, with a NUL at the end."""
        return self._line(look, [min(1.0, max(0.0, float(force) / self._full)) for force in look.pressing])

    def farewell(self, last: Look) -> bytes:
        """All fingers off: thimbles would go on for some seconds."""
        return self._line(last, [0.0] * len(last.rows))

    def _line(self, look: Look, strengths: list[float]) -> bytes:
        hand = look.hand if self._hand is None else self._hand
        blocks = "".join(f"[{hand} {row} 1.0 {strength:.3f}]" for row, strength in zip(look.rows, strengths, strict=True))
        return f"tfb {len(look.rows)} {blocks}".encode("ascii") + b"\0"


def as_json(look: Look) -> dict[str, Any]:
    """What ``JsonSink`` and the websocket send. ``state`` is ``open``, ``stick`` or ``slip``: slip if most of the force slips."""
    fingers = {
        PARTS[row]: {
            "force": [round(float(x), 6) for x in force],
            "pressing": round(float(press), 6),
            "slip": round(float(slip), 4),
            "state": "open" if press <= 0.0 else "slip" if slip > 0.5 else "stick",
        }
        for row, force, press, slip in zip(look.rows, look.force, look.pressing, look.slipping, strict=True)
    }
    return {"time": round(look.time, 6), "phase": look.phase, "fingers": fingers}


def check_rate(rate: float) -> None:
    """Raises ``InvalidValueError`` for a rate that is none."""
    if not (math.isfinite(rate) and 0.0 < rate <= 1000.0):
        raise InvalidValueError("--feedback-rate", "a number from 0 to 1000 (Hz)", rate, f"{RATE:g} is the default")


class Raster:
    """Says when it is time: ``rate`` times per second of simulated time, right on average."""

    def __init__(self, rate: float) -> None:
        """Raises ``InvalidValueError`` for a rate that is none."""
        check_rate(rate)
        self._period, self._next = 1.0 / rate, 0.0

    def due(self, time: float) -> bool:
        """Whether it is time at ``time`` s; then it has been."""
        if time < self._next:
            return False
        # The tolerance is for sums of time steps.
        self._next = (math.floor(time / self._period + 1e-6) + 1) * self._period - 1e-9
        return True


class Feedback(Protocol):
    """Takes looks of a session, and passes some of them on. Never waits, never fails."""

    def __call__(self, look: Look) -> None:
        """Pass it on if it is time."""

    def story(self) -> str:
        """What became of it, in a line."""

    def close(self) -> None:
        """Let go of the network."""


class UdpFeedback:
    """Sends looks of a session to one address, ``rate`` times per second of simulated time. What cannot be sent is counted."""

    def __init__(self, text: str, *, rate: float = RATE) -> None:
        """``text`` is ``udp:HOST:PORT`` or ``tfb:HOST[:PORT][/HAND]``. Raises ``InvalidValueError``."""
        self._raster = Raster(rate)
        kind, _, rest = text.partition(":")
        rest, slash, hand = rest.partition("/") if kind == "tfb" else (rest, "", "")
        host, _, port = rest.rpartition(":") if kind == "udp" or rest.count(":") == 1 else (rest, "", str(TFB_PORT))
        if kind not in ("udp", "tfb") or not host or not is_port(port) or (slash and not is_hand(hand)):
            raise InvalidValueError("--feedback", TARGETS, text, "udp:127.0.0.1:9000 sends JSON to this machine")
        try:
            address = socket.gethostbyname(host)
            ipaddress.IPv4Address(address)
        except (OSError, ValueError, UnicodeError):
            raise InvalidValueError("--feedback", "a host that is known", host, "give its address, such as 192.168.0.7") from None
        self.address = (address, int(port))
        self.sink: Sink = JsonSink() if kind == "udp" else TfbSink(int(hand) if hand else None)
        self.sent = self.failed = 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._last: Look | None = None

    def __call__(self, look: Look) -> None:
        """Send it if it is time."""
        if not self._raster.due(look.time):
            return
        self._last = look
        try:
            data = self.sink.encode(look)
        except ValueError:  # a force that is no number cannot be written
            self.failed += 1
        else:
            self._send(data)

    def _send(self, data: bytes) -> None:
        try:
            self._socket.sendto(data, self.address)
            self.sent += 1
        except OSError:
            self.failed += 1

    def story(self) -> str:
        """What became of it."""
        return f"{self.sent} datagrams to {self.address[0]}:{self.address[1]}, {self.failed} could not be sent"

    def close(self) -> None:
        """Say farewell, and close the socket."""
        farewell = None if self._last is None else self.sink.farewell(self._last)
        if farewell is not None:
            for again in range(FAREWELLS):
                time.sleep(APART if again else 0.0)
                self._send(farewell)
        self._last = None
        self._socket.close()


def is_port(text: str) -> bool:
    """Whether this is the number of a port that can be named."""
    return text.isascii() and text.isdecimal() and 0 < int(text) < 65_536


def is_hand(text: str) -> bool:
    """Whether this is a number that DTrack gives to a hand."""
    return text.isascii() and text.isdecimal() and int(text) < 10_000


def open_feedback(text: str, *, rate: float = RATE) -> Feedback:
    """What ``--feedback`` names. Raises ``InvalidValueError``, or ``NetworkError`` for a port in use."""
    if text.partition(":")[0] == "ws":
        from quasirigid.mocap.feedback_server import WebsocketFeedback

        return WebsocketFeedback(text, rate=rate)
    return UdpFeedback(text, rate=rate)
