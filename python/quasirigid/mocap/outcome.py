"""What became of the object in a session: taken, lifted, turned, dropped, put down, fallen over."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from quasirigid.arrays.types import FloatArray
from quasirigid.rotation import conjugate, matrix_of, pose_in, quaternion_product, rotate

LOADED = 1e-3
"""A finger or the support that presses with less does not touch, N."""
DROPPED_AFTER = 0.04
"""The object is dropped when nothing has touched it for so long, s: a box that is knocked only hops."""
LIFTED_FROM = 0.002
"""Higher than this above its start the object is in the hand, m."""
UPRIGHT = math.radians(20.0)
"""An object whose vertical axis of the start is tilted by more has fallen over, rad: less than a box of any shape that stands on an edge.
"""
PICKED_UP_AFTER = 0.1
"""An object that was dropped is in the hand again when it is carried for so long, s."""
PHASES = ("reach", "touch", "carry", "put down", "rest", "fallen over", "fall")


class Outcome:
    """Follows the object; ``update`` is called some hundred times per second."""

    def __init__(self, pose: FloatArray, fingers: tuple[str, ...]) -> None:
        """``pose`` (7,) m and (w, x, y, z): where the object stands at the start."""
        self._start = pose.copy()
        self._fingers = fingers
        self._pose = pose.copy()
        self._guide: FloatArray | None = None
        self._grasped: tuple[FloatArray, FloatArray] | None = None
        self._released: tuple[FloatArray, FloatArray] | None = None
        self._untouched = 0.0
        self._carrying = 0.0
        """For how long it has been carried without a break, s."""
        self._time: float | None = None
        self.phase = "reach"
        self.dropped = False
        """Whether it was dropped, and not picked up again."""
        self.drops = 0
        """How often it was dropped."""
        self.carried_s = 0.0
        self.lifted = 0.0
        self.turned = 0.0
        self.peaks: FloatArray = np.zeros(len(fingers))
        self._log: list[dict[str, Any]] = []

    def update(self, time: float, pose: FloatArray, pressing: FloatArray, support: float, guide: FloatArray) -> str:
        """``pose`` (7,) of the object; ``pressing`` (fingers,) N; ``support`` N that the support presses with; ``guide`` (7,): where the
        tracked hand is. Returns the phase.
        """
        elapsed = 0.0 if self._time is None else time - self._time
        self._time, self._pose = time, pose
        touched, stands = bool(pressing.max(initial=0.0) > LOADED), support > LOADED
        height = float(pose[2] - self._start[2])
        self.peaks = np.maximum(self.peaks, pressing)
        self.lifted = max(self.lifted, height)
        self.turned = max(self.turned, abs(heading(self._start[3:], pose[3:])))
        self._untouched = 0.0 if touched or stands else self._untouched + elapsed
        carried = touched and not stands and height > LIFTED_FROM
        if carried:
            self.carried_s += elapsed
        elif not self.carried_s:
            self._grasped = (guide.copy(), pose.copy())
        if touched:
            self._released = (guide.copy(), pose.copy())
        self._carrying = self._carrying + elapsed if carried else 0.0
        if self.dropped and self._carrying > PICKED_UP_AFTER:
            self.dropped = False
        if self._untouched > DROPPED_AFTER and not self.dropped:
            self.dropped = True
            self.drops += 1
        self._enter(time, self._phase_of(touched, carried))
        return self.phase

    def _phase_of(self, touched: bool, carried: bool) -> str:
        if self.dropped:
            return "fall"
        if carried:
            return "carry"
        if touched:
            return "put down" if self.carried_s else "touch"
        if not self.upright:
            return "fallen over"
        return "rest" if self.carried_s else "reach"

    @property
    def tilt(self) -> float:
        """Angle between the object's vertical axis of the start and the vertical, rad."""
        # Third row of the rotation since the start: the height of each of its axes.
        return math.acos(min(1.0, max(-1.0, float(matrix_of(quaternion_product(self._pose[3:], conjugate(self._start[3:])))[2, 2]))))

    @property
    def upright(self) -> bool:
        """Whether the object stands, or is carried, as it stood at the start."""
        return self.tilt < UPRIGHT

    def _enter(self, time: float, phase: str) -> None:
        if not self._log or self._log[-1]["name"] != phase:
            self._log.append({"name": phase, "start": round(time, 6), "end": round(time, 6)})
        self._log[-1]["end"] = round(time, 6)
        self.phase = phase

    def summary(self) -> dict[str, Any]:
        """Figures for ``summary.json``."""
        place = None
        if self._grasped is not None and self._released is not None and self.carried_s and not self.dropped and self.phase == "rest":
            (hand, object_pose), (hand_at_release, _) = self._grasped, self._released
            # The hand's motion from taking to letting go, applied to the object.
            relative = pose_in(hand, object_pose)
            there = hand_at_release[:3] + rotate(hand_at_release[3:], relative[:3])
            place = float(np.linalg.norm(self._pose[:3] - there))
        return {
            "held": self.carried_s > 0.1 and not self.dropped,
            "dropped": self.dropped,
            "drops": self.drops,
            "carried_s": self.carried_s,
            "lifted_m": self.lifted,
            "turned_rad": self.turned,
            "put_down": self.phase == "rest" and not self.dropped,
            "upright": self.upright,
            "tilt_rad": self.tilt,
            "place_error_m": place,
            "final_pose": [float(x) for x in self._pose],
            "moved_m": [float(x) for x in self._pose[:3] - self._start[:3]],
            "peak_force_n": [float(x) for x in self.peaks],
            "fingers": list(self._fingers),
            "phases": self._log,
        }


def heading(before: FloatArray, after: FloatArray) -> float:
    """Angle about the vertical by which ``after`` (4,) is turned from ``before`` (4,), rad."""
    x = matrix_of(quaternion_product(after, conjugate(before)))[:, 0]
    return math.atan2(float(x[1]), float(x[0]))
