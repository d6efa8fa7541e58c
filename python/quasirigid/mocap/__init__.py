"""Motion capture: packets of a tracker in, hands out.

>>> from quasirigid import mocap
>>> take = mocap.shipped_take()
>>> hand = take.frames(mocap.HandDecoder("right"))[0]
>>> hand.positions.shape, bool(hand.tracked[0])
((6, 3), True)

Live, with ``mocap.Receiver("5000")`` and ``mocap.HandTracker("right")``: push what ``take()`` brings, ask ``sample(receiver.now())`` in
every step. ``docs/mocap.md`` goes through it step by step.
"""

from importlib.resources import as_file, files

from quasirigid._quasirigid import (
    Calibration,
    HandDecoder,
    HandFrame,
    HandTargets,
    HandTracker,
    Packet,
    Receiver,
    Replay,
    Take,
    TakeWriter,
)

PARTS = ("thumb", "index", "middle", "ring", "little", "palm")
"""Names of the rows of hand arrays."""

__all__ = [
    "PARTS",
    "Calibration",
    "HandDecoder",
    "HandFrame",
    "HandTargets",
    "HandTracker",
    "Packet",
    "Receiver",
    "Replay",
    "Take",
    "TakeWriter",
    "shipped_take",
]


def shipped_take() -> Take:
    """The take that comes with the package: a right hand pinches the box of the scene ``grasp``, lifts it, turns it, puts it down.

    ``Take.pinch()`` makes the same, and others with other seeds.
    """
    with as_file(files(__name__) / "pinch.take.gz") as path:
        return Take.read(path)
