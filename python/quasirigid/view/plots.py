"""Curves of the last seconds: force of every finger, computing time of a step, number of contacts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import viser
from viser import uplot

from quasirigid.palette import FINGER_COLOURS
from quasirigid.view.scene import SceneModel

HEIGHT = 104
"""Of each plot, px: all of the panel is seen in a window of 720 px, without a scroll bar over its right edge."""
GREY = "#6b7280"
FROM_ZERO = {"min": {"pad": 0.0, "soft": 0.0, "mode": 1}, "max": {"pad": 0.1, "soft": 0.0, "mode": 1}}
"""A range (of uPlot) that always has zero in it: what hardly changes looks like that, and ticks are short numbers."""


class Curves:
    """Three plots over simulated time, two of a scene without fingers. Made inside the container that shall hold them."""

    def __init__(self, server: viser.ViserServer, model: SceneModel) -> None:
        self._fingers = len(model.fingers)
        self._turn = 0
        look = [(name, FINGER_COLOURS[i % 6]) for i, name in enumerate(model.fingers)]
        self._force = _plot(server, "Normal force (N) over time (s)", look) if look else None
        self._step = _plot(server, "Computing a step (ms) over time (s)", [("step", GREY)])
        self._contacts = _plot(server, "Contacts over time (s)", [("contacts", GREY)])

    def show(
        self,
        times: Sequence[float],
        forces: Sequence[Sequence[float]],
        steps: Sequence[float],
        contacts: Sequence[int],
        *,
        together: bool = True,
    ) -> None:
        """``times`` (n,) s, ``forces`` (n, fingers) N, ``steps`` (n,) s, ``contacts`` (n,).

        A plot that is drawn anew is the dearest thing beside the scene. With ``together`` off every call draws one of them, in turn.
        """
        if len(times) < 2:
            times, forces, steps, contacts = (0.0, 1.0), np.zeros((2, self._fingers)).tolist(), (0.0, 0.0), (0, 0)
        t = np.asarray(times, dtype=np.float64)
        self._turn = (self._turn + 1) % 3
        if self._force is not None and (together or self._turn == 0):
            by_finger = np.asarray(forces, dtype=np.float64).reshape(len(t), self._fingers)
            self._force.data = (t, *(np.ascontiguousarray(by_finger[:, i]) for i in range(self._fingers)))
        if together or self._turn == 1:
            self._step.data = (t, 1e3 * np.asarray(steps, dtype=np.float64))
        if together or self._turn == 2:
            self._contacts.data = (t, np.asarray(contacts, dtype=np.float64))

    def remove(self) -> None:
        """Takes the plots out of the page."""
        for plot in (self._force, self._step, self._contacts):
            if plot is not None:
                plot.remove()


def _plot(server: viser.ViserServer, title: str, look: Sequence[tuple[str, str]]) -> viser.GuiUplotHandle:
    nothing = np.array([0.0, 1.0])
    return server.gui.add_uplot(
        data=(nothing, *(np.zeros(2) for _ in look)),
        series=(uplot.Series(label="time, s"), *(uplot.Series(label=name, stroke=colour, width=2) for name, colour in look)),
        title=title,
        scales={"x": uplot.Scale(time=False), "y": uplot.Scale(auto=True, range=FROM_ZERO)},
        axes=(uplot.Axis(size=24, font="10px sans-serif"), uplot.Axis(size=36, font="10px sans-serif")),
        legend=uplot.Legend(show=False),
        height=HEIGHT,
        padding=(12, 10, 0, 0),
    )
