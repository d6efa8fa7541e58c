"""Colours and shapes that plots, pictures and the live view share. They can be distinguished with any colour vision."""

from quasirigid._quasirigid import HandModel

FINGER_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""One per finger (Okabe and Ito), hex sRGB."""
STICK_COLOUR, SLIP_COLOUR = "#0072B2", "#E69F00"
"""Of contacts that stick and that slip; what slips has a mark as well."""
PAD, NAIL, BONE, PALM = (0.95, 0.86, 0.79), (0.86, 0.83, 0.81), (0.80, 0.83, 0.86), (0.62, 0.66, 0.71)
GLASS = (0.30, 0.45, 0.62)
_PROXIMAL, _MIDDLE, _DISTAL = HandModel.three_finger_link_radii()
LINK_RADII = (_PROXIMAL, (_PROXIMAL + _MIDDLE) / 2, (_MIDDLE + _DISTAL) / 2, 0.0055)
"""Of the tubes at the joints of a finger, as wide as the phalanges of the built-in hand, and at its narrow end, m."""
INK, MUTED, BAND = "#222222", "#666666", "#F1F1EF"
"""Of letters, of lesser ones, and of every other phase behind a curve."""
