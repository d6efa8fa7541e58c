"""Letting go: what one side of a grip has let go of, the other side does not push with.

A tracked fingertip that closes on an object goes on into it, by 10 to 45 mm, and the spring to its pad makes that into force. When the hand
opens again, fingers do not let go at the same moment. With plain springs the finger that is late then pushes the object away, by half of
the way that the others are ahead, though nobody wants to push: it is only deeper inside. (M. Prachyabrued, C. W. Borst, Virtual grasp
release method and evaluation, Int. J. Human-Computer Studies 70, 2012, describe the difficulty, and that people want the object released
when the first finger opens.)

Here the sides of a grip yield together. Lengths in m along the axis of the grip, a unit vector from side A to side B:

- ``s_i`` stretch of finger i: how far its tracked pad is deeper inside the object than the simulated one
- ``m = mean_A s + mean_B s``: closing of the hand; it does not change when the hand moves as a whole, only when it opens or closes
- ``r_i, m_r`` the same before the hand began to open
- ``G_X = sum_X s_i / sum_X r_i``: what is left of the squeeze of side X; ``g = min(G_A, G_B, 1)``
- ``w`` from 0 to 1 while ``(m_r - m) / 2`` goes from ``BEGINS`` to ``FULLY`` of the mean ``r_i`` of the shallower side

Then ``s_i' = s_i (1 - w (1 - g / G_X))``: the stronger side is brought down to the weaker one, and the sides stay in balance. Neither side
is made weaker than the weaker one, so that no object is held less firmly by this. Who is left inside the object alone begins again from
there: a finger that then goes deeper pushes.
"""

from __future__ import annotations

import numpy as np

from quasirigid.arrays.types import FloatArray

BEGINS, FULLY = 0.05, 0.2
"""Share of its closing by which the hand must have opened for the sides to begin to be kept in balance, and by which they are so wholly."""
FOLLOWS = 0.05
"""Time constant with which ``r_i`` follow the stretches while the hand does not open, s: some frames of a tracker."""
FORGETS = 1.0
"""Time constant with which the closing from which the opening is counted is forgotten, s."""
TOUCHES = 1e-3
"""A finger that presses with more than this is in the grip, N."""
COMPRESSES = 0.008
"""By which the pads of two fingers that meet are flattened at most, m."""
LEAST = 5e-4
"""A closing smaller than this is none, m."""


class Release:
    """How far the aims of the pads are moved out of the object. One row for each simulated finger."""

    def __init__(self, fingers: int, dt: float) -> None:
        """``dt`` s is the time between two calls of ``update``."""
        self._dt = dt
        self._pressing = np.zeros(fingers, dtype=bool)
        self._side = np.zeros(fingers)
        """+1 and -1 for the sides A and B of a grip, 0 for who is not in it."""
        self._means: FloatArray = np.zeros((2, fingers))
        """What makes the means of the two sides."""
        self._axis: FloatArray = np.zeros(3)
        self._gripped = False
        """Whether there is a grip: then both sides have fingers."""
        self._before: FloatArray = np.zeros(fingers)
        self._closing = 0.0
        self._slack: FloatArray = np.zeros(fingers)
        """Stretch that does not count, since the opponents have gone."""
        self._slackened = False
        self.shift: FloatArray = np.zeros((fingers, 3))
        """m, world: to be added to the aims of the pads."""
        self.velocity: FloatArray = np.zeros((fingers, 3))
        """With which it changes, m/s."""

    def observe(self, pressing: FloatArray) -> None:
        """Say with which normal force each finger presses on the object now, (fingers,) N."""
        self._pressing = pressing > TOUCHES

    def update(self, aims: FloatArray, ends: FloatArray, facing: FloatArray) -> None:
        """Find ``shift`` for the next step.

        ``aims`` and ``ends`` (fingers, 3) m, world: tracked apex and simulated apex of each pad; ``facing`` (fingers, 3): unit vectors out
        of the tracked pads; NaN for fingers that were never seen.
        """
        if not (self._gripped or self._slackened or self._pressing.any()):
            return
        aims, facing = np.where(np.isnan(aims), ends, aims), np.nan_to_num(facing)
        self._join(facing)
        if not (self._gripped or self._slackened):
            return
        side, before = self._side, self.shift
        ways = np.where(side[:, None] == 0.0, facing, side[:, None] * self._axis)
        stretch = ((aims - ends) * ways).sum(axis=1)
        if self._slackened:
            self._slack = np.minimum(self._slack, np.maximum(stretch, 0.0))
        relaxed = self._slack
        if self._gripped:
            counted = stretch - self._slack
            relaxed = relaxed + counted * (1.0 - self._kept(counted) * self._possible(counted, ends))
            if not (self._pressing[side > 0.0].any() and self._pressing[side < 0.0].any()):
                # Whoever is left inside alone has its stretch taken as it is.
                self._slack = relaxed = np.where(stretch > 0.0, np.maximum(relaxed, 0.0), 0.0)
                self._gripped, self._side = False, np.zeros_like(side)
        self._slackened = bool(self._slack.any())
        self.shift = -relaxed[:, None] * ways
        self.velocity = (self.shift - before) / self._dt

    def _join(self, facing: FloatArray) -> None:
        """Take fingers that press into the grip; make one where two press against each other."""
        new = self._pressing & (self._side == 0.0)
        if not new.any():
            return
        if not self._gripped:
            towards = facing @ facing[int(np.argmax(new))]
            a, b = new & (towards > 0.0), new & (towards < 0.0)
            if not b.any():
                return
            axis = facing[a].mean(axis=0) - facing[b].mean(axis=0)
            self._axis = axis / np.sqrt(axis @ axis)
            self._gripped, self._closing, self._before = True, 0.0, np.zeros_like(self._before)
        self._side = np.where(new, np.sign(facing @ self._axis), self._side)
        sides = np.array([self._side > 0.0, self._side < 0.0], dtype=float)
        self._means = sides / np.maximum(sides.sum(axis=1, keepdims=True), 1.0)

    def _possible(self, stretch: FloatArray, ends: FloatArray) -> float:
        """The share of the stretch at which the tracked pads meet: they cannot pass through each other, however far inside they seem to be.

        Springs that end beyond each other make a grip of two fingers unstable: turned by half a turn, both would be relaxed.
        """
        a, b = self._means
        closing = float((a + b) @ stretch)
        distance = float((b - a) @ ends @ self._axis)
        return min(1.0, (max(distance, 0.0) + COMPRESSES) / max(closing, LEAST))

    def _kept(self, stretch: FloatArray) -> FloatArray | float:
        """The share of its stretch that each finger keeps, 0 to 1; one number if it is the same for all."""
        a, b = self._means
        closing = float((a + b) @ stretch)
        self._closing = max(closing, self._closing + (closing - self._closing) * self._dt / FORGETS)
        if self._closing < LEAST:
            return 1.0
        shallow = max(LEAST, min(float(a @ self._before), float(b @ self._before)))
        opened = (self._closing - closing) / (2.0 * shallow)
        if opened <= BEGINS:
            self._before = self._before + (stretch - self._before) * min(1.0, self._dt / FOLLOWS)
            return 1.0
        weight = min(1.0, (opened - BEGINS) / (FULLY - BEGINS))
        now, before = np.maximum(stretch, 0.0), np.maximum(self._before, LEAST)
        left = [float(x @ now) / float(x @ before) for x in (a, b)]
        least = min(*left, 1.0)
        kept = np.ones_like(stretch)
        for x, share in zip((a, b), left, strict=True):
            if share > least:
                kept[x > 0.0] = 1.0 - weight * (1.0 - least / share)
        return kept
