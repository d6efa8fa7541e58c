"""The hand that a tracker sees, beside the fingers that follow it: a sphere for every tip, and a line for the spring to the pad."""

from __future__ import annotations

import numpy as np
import viser

from quasirigid.live.batched_nodes import LinePool
from quasirigid.scene.model import SceneState, TrackedHand
from quasirigid.scene.palette import FINGER_COLOURS
from quasirigid.scene.pressure import rgb

NOBODY = "#6b7280"
"""A tip that no simulated finger follows."""
PALM_RADIUS = 0.005
"""Of the mark of the palm, m."""
FAINT, STRONG = 0.12, 0.45
"""Opacity of a tip whose spring has no strength, and of one whose spring has all."""
SHORT = 2e-4
"""A spring that is stretched by less is not drawn, m."""
STEP = 0.05
"""Weights that differ by less are drawn alike."""
WORDS = {"held": "not seen, held", "fading": "not seen, letting go", "lost": "lost, limp"}


Shape = tuple[float, bool]
"""Of a mark: its radius, m, and whether it is hollow."""
Style = tuple[tuple[int, int, int], float]
"""Colour and opacity."""


class TrackedDrawing:
    """The tips of one hand in the page."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._marks: dict[str, tuple[viser.IcosphereHandle, Shape, Style]] = {}
        self._springs = LinePool(server, "/tracked/springs", 2.0)

    def remove(self) -> None:
        """Takes it out of the page."""
        self._marks.clear()
        self._server.scene.remove_by_name("/tracked")

    def draw(self, hand: TrackedHand) -> None:
        """Shows where the hand is. Tips that were never seen are not there."""
        for i, name in enumerate(hand.names):
            if not np.isfinite(hand.positions[i]).all():
                continue
            finger = hand.fingers[i]
            r, g, b = rgb(NOBODY if finger < 0 else FINGER_COLOURS[finger % 6]).tolist()
            radius, hollow = float(hand.radii[i]) or PALM_RADIUS, hand.states[i] != "live"
            opacity = FAINT + STEP * round(float(hand.weights[i]) / STEP) * (STRONG - FAINT)
            shape, style = (radius, hollow), ((r, g, b), opacity)
            handle, before_shape, before_style = self._marks.get(name, (None, None, None))
            if handle is None or shape != before_shape:
                # Hollow where it is not seen: there it is only taken to be.
                handle = self._server.scene.add_icosphere(
                    f"/tracked/{name}",
                    radius,
                    (r, g, b),
                    subdivisions=2,
                    opacity=opacity,
                    wireframe=hollow,
                    cast_shadow=False,
                    receive_shadow=False,
                    position=hand.positions[i],
                )
            elif style != before_style:
                handle.color, handle.opacity = style
            handle.position = hand.positions[i]
            self._marks[name] = (handle, shape, style)
        stretch = hand.aims - hand.ends
        drawn = [f for f in range(len(stretch)) if np.linalg.norm(stretch[f]) > SHORT]
        colours = np.array([rgb(FINGER_COLOURS[f % 6]) for f in drawn], dtype=np.uint8).reshape(-1, 3)
        self._springs.show(np.stack([hand.ends[drawn], hand.aims[drawn]], axis=1), colours)


def hand_rows(hand: TrackedHand, state: SceneState) -> list[tuple[str, str]]:
    """Rows of the panel for every finger that follows the hand, and for the palm: its force, how far it is from the hand, whether that is
    seen; and how many frames were dropped, if any were.
    """
    rows = []
    for i, name in enumerate(hand.names):
        finger, lost = hand.fingers[i], WORDS.get(hand.states[i])
        if finger >= 0:
            away = f"{1e3 * float(np.linalg.norm(hand.aims[finger] - hand.ends[finger])):.1f} mm from the hand"
            rows.append((name, f"{float(state.normal_forces[finger]):.1f} N, {lost or away}"))
        elif hand.radii[i] == 0.0 and hand.states[i] != "absent":
            rows.append((name, lost or "seen"))
    if hand.dropped:
        rows.append(("bad frames", f"{hand.dropped} dropped: no hand moves like that"))
    return rows
