"""A hand for the tests of putting down: as many fingers as wanted, closing as deep as wanted, one of them late in letting go. In simulated
time.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from hand_frames import FrameSource

from quasirigid import mocap
from quasirigid.grasp.experiment import minimum_jerk
from quasirigid.grasp.options import GraspOptions
from quasirigid.mocap.options import MocapOptions
from quasirigid.mocap.session import MocapSession
from quasirigid.rotation import quaternion_of

COARSE = GraspOptions(points=6000, dt=0.004)
HALF_BOX, HEIGHT, RADIUS = 0.03, 0.04, 0.008
CLEARANCE = 0.02
"""Between pads and box before the hand closes and after it has opened, m."""
CLOSES, LIFTS, LOWERS, OPENS, ENDS = (0.3, 0.9), (1.0, 1.5), (1.6, 2.1), (2.3, 2.9), 3.5
"""When the hand does what, s."""
ALONG = {1: (0.0,), 2: (0.012, -0.012), 4: (0.027, 0.009, -0.009, -0.027)}
"""Where the fingers that oppose the thumb stand along the box, m, by their number."""
Timing = Callable[[float, int], float]


def during(time: float, span: tuple[float, float]) -> float:
    """0 before a span of time, 1 after it, minimum jerk between."""
    return minimum_jerk((time - span[0]) / (span[1] - span[0]))


def frames(
    fingers: int,
    closing: float,
    late: int | None = None,
    *,
    lag: float = 0.1,
    side: Literal["left", "right"] = "right",
    before: float = 0.0,
    height: Callable[[float], float] | None = None,
) -> list[mocap.HandFrame]:
    """60 frames per second of a hand that closes on the box, lifts it by 100 mm, puts it down again, and opens.

    The thumb's tracked pad goes ``closing`` m into the box, the others share that between them, so that all press in balance. The finger
    ``late`` lets go ``lag`` s after the others. ``before`` s: how long the open hand is held still at first. ``height``: how high the hand
    is, in place of lift and descent.
    """
    rows = range(fingers)
    out = []
    for k in range(round(60.0 * (before + ENDS))):
        time = k / 60.0 - before
        up = 0.1 * (during(time, LIFTS) - during(time, LOWERS)) if height is None else height(time)
        positions, quaternions, radii = np.full((6, 3), np.nan), np.full((6, 4), np.nan), np.zeros(6)
        for row in rows:
            sign, depth = (-1.0, closing) if row == 0 else (1.0, closing / (fingers - 1))
            begins, ends = OPENS
            wait = lag if row == late else 0.0
            closed = during(time, CLOSES) - during(time, (begins + wait, ends + wait))
            along = 0.0 if row == 0 else ALONG[fingers - 1][row - 1]
            positions[row] = sign * (HALF_BOX + RADIUS + CLEARANCE - (CLEARANCE + depth) * closed), along, HEIGHT + up
            down, nail = np.array([0.0, 0.0, -1.0]), np.array([sign, 0.0, 0.0])
            quaternions[row] = quaternion_of(np.stack([down, np.cross(nail, down), nail], axis=1))
            radii[row] = RADIUS
        positions[5], quaternions[5] = (-0.014, 0.012, HEIGHT + 0.067 + up), (1.0, 0.0, 0.0, 0.0)
        tracked = [row in rows or row == 5 for row in range(6)]
        out.append(mocap.HandFrame(side, positions, quaternions, radii, tracked, time=time + before, arrival=time + before))
    return out


def session_of(hand: list[mocap.HandFrame], options: GraspOptions = COARSE, **mocap_options: Any) -> MocapSession:
    """A session that is to follow this hand, in simulated time."""
    return MocapSession(options, MocapOptions(idle=0.1, **mocap_options), FrameSource(hand))


def tilt(quaternion: npt.NDArray[np.float64]) -> float:
    """Angle between the body's z axis and the vertical, rad."""
    return float(np.arccos(np.clip(1.0 - 2.0 * (quaternion[1] ** 2 + quaternion[2] ** 2), -1.0, 1.0)))
