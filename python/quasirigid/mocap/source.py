"""Where the hands of a session come from: a tracker on the network, or a take played in simulated time."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol

from quasirigid._quasirigid import HandFrame, Packet, Receiver, Take
from quasirigid.errors import InvalidValueError
from quasirigid.mocap import shipped_take

DTRACK_PORT = "5000"
BEHIND = 0.05
"""A take that is watched makes up for so much, s; what is later than that stays late."""
NAMES = "dtrack, dtrack:PORT, dtrack:HOST:PORT:fw, webxr, webxr:PORT, take or take:FILE"


SPIN = 1.5e-4
"""The last bit of a wait is spent awake, s: a sleep ends 0.05 to 0.1 ms late."""


def sleep_until(now: Callable[[], float], moment: float) -> None:
    """Return when the clock ``now`` (s) has come to ``moment``, to some microseconds."""
    left = moment - now()
    if left > SPIN:
        time.sleep(left - SPIN)
    while now() < moment:
        pass


class Source(Protocol):
    """Packets, or hands that need no decoding, with their arrivals, on one clock."""

    real_time: bool
    """Whether its clock runs by itself; otherwise it is where ``wait_until`` has put it."""
    when_silent: str
    """What to tell a person when nothing comes."""

    def now(self) -> float:
        """Its clock, s."""

    def wait_until(self, moment: float) -> None:
        """Return at this moment, or at once if it has passed."""

    def take(self) -> Sequence[Packet | HandFrame]:
        """What has arrived since the last call."""

    def ended(self) -> bool:
        """Whether nothing will ever come any more, for certain."""

    def statistics(self) -> dict[str, Any]:
        """As of ``Receiver.statistics``."""

    def close(self) -> None:
        """Let go of the network."""


class NetworkSource:
    """DTrack over UDP."""

    real_time = True
    when_silent = (
        "nothing comes from the tracker: is the controller told to send to this machine and port? "
        "`quasirigid mocap monitor` shows what comes"
    )

    def __init__(self, connection: str = DTRACK_PORT, *, bind: str = "0.0.0.0") -> None:
        """``connection`` and ``bind`` as of ``Receiver``. Raises ``InvalidValueError`` or ``NetworkError``."""
        self._receiver = Receiver(connection, bind=bind)
        self.address = self._receiver.address

    def now(self) -> float:
        """Seconds since it was opened."""
        return self._receiver.now()

    def wait_until(self, moment: float) -> None:
        """Sleep until this moment."""
        sleep_until(self._receiver.now, moment)

    def take(self) -> Sequence[Packet]:
        """What has arrived since the last call. Raises ``NetworkError`` if nothing can arrive any more."""
        packets = self._receiver.take()
        if not packets:
            self._receiver.wait(0.0)  # it is this that raises
        return packets

    def ended(self) -> bool:
        """Never for certain."""
        return False

    def statistics(self) -> dict[str, Any]:
        """As of ``Receiver.statistics``."""
        return self._receiver.statistics()

    def close(self) -> None:
        """Close the port."""
        self._receiver.close()


class TakeSource:
    """A take in simulated time: the same every time. As fast as the computer goes, or no faster than the clock on the wall.

    The clock that it shows is that of the take in both cases, so that a computer which is too slow for the one on the wall plays the take
    in slow motion, with the same result.
    """

    real_time = False
    when_silent = "the take has no more of it: `quasirigid mocap inspect FILE` lists what is in one"

    def __init__(self, take: Take, *, watched: bool = False) -> None:
        """``watched``: no faster than the clock on the wall, for somebody who looks on."""
        self._take, self._watched = take, watched
        self._packets = take.packets
        self._next = 0
        self._now = self._packets[0].arrival if self._packets else 0.0
        self._wall = time.monotonic() - self._now

    def now(self) -> float:
        """Where ``wait_until`` has put it."""
        return self._now

    def wait_until(self, moment: float) -> None:
        """Put the clock there."""
        self._now = max(self._now, moment)
        if self._watched:
            early = self._now - (time.monotonic() - self._wall)
            if early > 0.0:
                time.sleep(early)
            elif early < -BEHIND:
                self._wall = time.monotonic() - self._now - BEHIND  # slow motion: what is lost is lost

    def take(self) -> Sequence[Packet]:
        """What has arrived since the last call."""
        first = self._next
        while self._next < len(self._packets) and self._packets[self._next].arrival <= self._now:
            self._next += 1
        return self._packets[first : self._next]

    def ended(self) -> bool:
        """Whether the last packet was taken."""
        return self._next == len(self._packets)

    def statistics(self) -> dict[str, Any]:
        """As of ``Take.statistics``."""
        return self._take.statistics()

    def close(self) -> None:
        """Nothing to close."""


def open_source(text: str, *, bind: str = "0.0.0.0", watched: bool = False) -> Source:
    """The source that ``quasirigid mocap grasp`` names: ``dtrack[:CONNECTION]`` or ``take[:FILE]``; a take that is ``watched`` keeps to the
    clock on the wall.

    Raises ``InvalidValueError`` for anything else, ``NetworkError`` or ``CaptureFileError`` where it cannot be opened.
    """
    kind, _, rest = text.partition(":")
    if kind == "dtrack":
        return NetworkSource(rest or DTRACK_PORT, bind=bind)
    if kind == "take":
        return TakeSource(Take.read(Path(rest)) if rest else shipped_take(), watched=watched)
    raise InvalidValueError("source", NAMES, text, "`dtrack` listens on UDP port 5000")
