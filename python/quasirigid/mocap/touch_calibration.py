"""Calibration by touch: where the tracked finger rests while somebody keeps it on a known point."""

from __future__ import annotations

import time

import numpy as np
import numpy.typing as npt

from quasirigid._quasirigid import Calibration, HandDecoder, Receiver
from quasirigid.arrays.types import FloatArray
from quasirigid.errors import InvalidValueError
from quasirigid.mocap import PARTS

STILL = 0.005
"""How much a finger that rests may move meanwhile (m)."""
LEAST = 5
"""Frames that make a mean."""


def resting_tip(
    receiver: Receiver, decoder: HandDecoder, finger: str, *, seconds: float = 0.5, patience: float = 3.0
) -> tuple[FloatArray, float]:
    """Mean position (3,) m of a fingertip's sphere in the tracker's room and its radius, over ``seconds``.

    Raises ``InvalidValueError`` if the finger is not seen, or moves.
    """
    row = PARTS.index(finger)
    receiver.take()  # what came before does not count
    places: list[FloatArray] = []
    radius = 0.0
    end, give_up = time.monotonic() + seconds, time.monotonic() + seconds + patience
    while time.monotonic() < end or (len(places) < LEAST and time.monotonic() < give_up):
        receiver.wait(0.1)
        for packet in receiver.take():
            hand = decoder.decode(packet)
            if hand is not None and hand.tracked[row]:
                places.append(hand.positions[row])
                radius = float(hand.pad_radii[row])
    hint = "keep the hand in sight of the cameras and the finger on the point"
    if len(places) < LEAST:
        raise InvalidValueError(f"{decoder.side} {finger}", f"at least {LEAST} frames in which it is seen", len(places), hint)
    cloud = np.array(places)
    spread = float(np.linalg.norm(cloud - cloud.mean(axis=0), axis=1).max())
    if spread > STILL:
        raise InvalidValueError(f"{decoder.side} {finger}", f"at rest within {1e3 * STILL:.0f} mm", f"{1e3 * spread:.1f} mm", hint)
    return cloud.mean(axis=0), radius


def calibration_from_touches(origin: npt.ArrayLike, on_x: npt.ArrayLike, in_plane: npt.ArrayLike, radius: float) -> Calibration:
    """From the centres (3,) m of a sphere of ``radius`` m that rested on three points of the plane z = 0."""
    flat = Calibration.from_three_points(origin, on_x, in_plane)
    # All three centres were above the table by the radius.
    return Calibration(flat.position + [0.0, 0.0, radius], flat.quaternion)
