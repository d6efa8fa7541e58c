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

from quasirigid.arrays.types import FloatArray
from quasirigid.errors import InvalidValueError
from quasirigid.mocap import PARTS
from quasirigid.mocap.observation import Observation

TFB_PORT = 50_110
FULL_FORCE = 5.0
"""Pressing force at which a thimble is sent its full strength, N."""
RATE = 60.0
"""Times per second, unless the session says otherwise."""
TARGETS = "udp:HOST:PORT, ws:PORT, ws:HOST:PORT or tfb:HOST[:PORT][/HAND]"
FAREWELLS, INTERVAL = 3, 0.02
"""How often it is sent that it is over, since datagrams get lost, and how far apart, s."""


class Sink(Protocol):
    """Something that an observation is made into bytes for."""

    def encode(self, observation: Observation) -> bytes:
        """One datagram."""

    def farewell(self, last: Observation) -> bytes | None:
        """What ends it after ``last``; ``None`` if nothing does."""


class JsonSink:
    """One JSON object per observation, as ``as_json`` makes it, numbered; and one that says that it is over."""

    def __init__(self) -> None:
        self._sequence = 0

    def encode(self, observation: Observation) -> bytes:
        """One datagram."""
        data = json.dumps(as_json(observation, self._sequence), allow_nan=False).encode()
        self._sequence += 1
        return data

    def farewell(self, last: Observation) -> bytes:
        """``type`` ``end`` with the next number: after it nothing comes."""
        end = {
            "type": "end",
            "sequence": self._sequence,
            "time": round(last.time, 6),
            "wall_time": round(last.wall_time, 6),
            "phase": last.phase,
        }
        return json.dumps(end, allow_nan=False).encode()


class TfbSink:
    """DTrack's tactile feedback: strengths 0 to 1 of the fingers of one hand."""

    def __init__(self, hand: int | None = None, full_force: float = FULL_FORCE) -> None:
        """``hand`` is DTrack's number of the hand, from 0; ``None`` for that of the tracked one. ``full_force`` N."""
        self._hand, self._full = hand, full_force

    def encode(self, observation: Observation) -> bytes:
        """``tfb n`` and for each finger ``[hand finger 1.0 strength]``, with a NUL at the end."""
        return self._line(observation, [min(1.0, max(0.0, float(force) / self._full)) for force in observation.pressing])

    def farewell(self, last: Observation) -> bytes:
        """All fingers off: thimbles would go on for some seconds."""
        return self._line(last, [0.0] * len(last.rows))

    def _line(self, observation: Observation, strengths: list[float]) -> bytes:
        hand = observation.hand if self._hand is None else self._hand
        blocks = "".join(f"[{hand} {row} 1.0 {strength:.3f}]" for row, strength in zip(observation.rows, strengths, strict=True))
        return f"tfb {len(observation.rows)} {blocks}".encode("ascii") + b"\0"


def as_json(observation: Observation, sequence: int) -> dict[str, Any]:
    """What ``JsonSink`` and the websocket send; docs/mocap.md has every field with its unit and frame.

    ``state`` of a finger is ``open``, ``stick`` or ``slip``: slip if most of the force slips.
    """
    fingers = {
        PARTS[row]: {
            "force": _rounded(observation.force[i]),
            "torque": _rounded(observation.torque[i], 9),
            "point": None if math.isnan(observation.contact_point[i, 0]) else _rounded(observation.contact_point[i]),
            "pressing": round(float(observation.pressing[i]), 6),
            "slip": round(float(observation.slipping[i]), 4),
            "state": "open" if observation.pressing[i] <= 0.0 else "slip" if observation.slipping[i] > 0.5 else "stick",
        }
        for i, row in enumerate(observation.rows)
    }
    return {
        "type": "observation",
        "sequence": sequence,
        "time": round(observation.time, 6),
        "wall_time": round(observation.wall_time, 6),
        "tracker": {"frame": observation.tracker_frame, "time": observation.tracker_time},
        "phase": observation.phase,
        "object": {"position": _rounded(observation.object_pose[:3]), "quaternion": _rounded(observation.object_pose[3:], 9)},
        "fingers": fingers,
    }


def _rounded(vector: FloatArray, digits: int = 6) -> list[float]:
    return [round(float(x), digits) for x in vector]


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
    """Takes observations of a session, and passes some of them on. Never waits, never fails."""

    def __call__(self, observation: Observation) -> None:
        """Pass it on if it is time."""

    def story(self) -> str:
        """What became of it, in a line."""

    def close(self) -> None:
        """Let go of the network."""


def is_port(text: str) -> bool:
    """Whether this is the number of a port that can be named."""
    return text.isascii() and text.isdecimal() and 0 < int(text) < 65_536


def is_hand(text: str) -> bool:
    """Whether this is a number that DTrack gives to a hand."""
    return text.isascii() and text.isdecimal() and int(text) < 10_000


class UdpFeedback:
    """Sends observations of a session to one address, ``rate`` times per second of simulated time. What cannot be sent is counted."""

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
        self._last: Observation | None = None

    def __call__(self, observation: Observation) -> None:
        """Send it if it is time."""
        if not self._raster.due(observation.time):
            return
        self._last = observation
        try:
            data = self.sink.encode(observation)
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
                time.sleep(INTERVAL if again else 0.0)
                self._send(farewell)
        self._last = None
        self._socket.close()
