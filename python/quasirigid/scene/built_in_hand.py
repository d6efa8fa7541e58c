"""Figures of the built-in hand, as its model has them: nobody else writes them down."""

import numpy as np

from quasirigid._quasirigid import HandModel

FINGER_SPACING = float(np.ptp(HandModel.three_finger().knuckles[1:, 1]))
"""Distance of the two fingers, and of their pads, along the hand's y, m."""
