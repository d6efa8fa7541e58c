"""Curves of the last seconds: force of every finger, computing time of a step, number of contacts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import viser
from viser import uplot

from quasirigid.arrays.types import FloatArray
from quasirigid.live import html
from quasirigid.scene.model import SceneModel
from quasirigid.scene.palette import FINGER_COLOURS

HEIGHT = 150
"""Of each plot, px: all of the panel is seen in a window of 720 px, without a scroll bar over its right edge."""
DASH = (7, 5)
"""Of every other finger after the first two, px: fingers that share a squeeze press alike, and the line below is seen."""
GREY = "#6b7280"
FROM_ZERO = {"min": {"pad": 0.0, "soft": 0.0, "mode": 1}, "max": {"pad": 0.1, "soft": 0.0, "mode": 1}}
"""A range (of uPlot) that always has zero in it: what hardly changes looks like that, and ticks are short numbers."""


class Curves:
    """Three plots over simulated time, two of a scene without fingers."""

    def __init__(
        self, server: viser.ViserServer, model: SceneModel, sensors: viser.GuiTabHandle, timing: viser.GuiTabHandle | None
    ) -> None:
        """Forces with their legend go into the tab of the ``sensors``, the rest into that of the ``timing``, if there is one."""
        self._fingers = len(model.fingers)
        self._turn = 0
        self._legend: viser.GuiHtmlHandle | None = None
        self._force: _Plot | None = None
        styles = [(name, FINGER_COLOURS[i % 6], is_dashed(i)) for i, name in enumerate(model.fingers)]
        if styles:
            with sensors:
                self._legend = server.gui.add_html(html.curve_legend(styles))
                self._force = _Plot(server, "Normal force (N) over time (s)", styles)
        with timing or sensors:
            self._step = _Plot(server, "Computing a step (ms) over time (s)", [("step", GREY, False)])
            self._contacts = _Plot(server, "Contacts over time (s)", [("contacts", GREY, False)])

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

        A plot that is drawn again costs most, after the scene. With ``together`` off every call draws one of them, in turn.
        """
        t = np.asarray(times, dtype=np.float64)
        self._turn = (self._turn + 1) % 3
        if self._force is not None and (together or self._turn == 0):
            by_finger = np.asarray(forces, dtype=np.float64).reshape(len(t), self._fingers)
            self._force.show(t, *(np.ascontiguousarray(by_finger[:, i]) for i in range(self._fingers)))
        if together or self._turn == 1:
            self._step.show(t, 1e3 * np.asarray(steps, dtype=np.float64))
        if together or self._turn == 2:
            self._contacts.show(t, np.asarray(contacts, dtype=np.float64))

    def remove(self) -> None:
        """Takes the plots out of the page."""
        if self._legend is not None and self._force is not None:
            self._legend.remove()
            self._force.remove()
        for plot in (self._step, self._contacts):
            plot.remove()


def is_dashed(finger: int) -> bool:
    """Whether the curve of a finger is dashed."""
    return finger >= 2 and finger % 2 == 0


class _Plot:
    """A plot, and words in its place while it has no data: an axis is there when there is something to be read from it."""

    def __init__(self, server: viser.ViserServer, title: str, styles: Sequence[tuple[str, str, bool]]) -> None:
        """``styles``: name, colour, and whether it is dashed, of every curve."""
        self._words = server.gui.add_html(html.no_data(title.split(" over")[0]))
        series = (uplot.Series(label=name, stroke=colour, width=2, dash=DASH if dashed else ()) for name, colour, dashed in styles)
        self._plot = server.gui.add_uplot(
            data=(np.array([0.0, 1.0]), *(np.zeros(2) for _ in styles)),  # never shown; the page takes no empty arrays
            series=(uplot.Series(label="time, s"), *series),
            title=title,
            scales={"x": uplot.Scale(time=False), "y": uplot.Scale(auto=True, range=FROM_ZERO)},
            axes=(uplot.Axis(size=24, font="10px sans-serif"), uplot.Axis(size=36, font="10px sans-serif")),
            legend=uplot.Legend(show=False),
            height=HEIGHT,
            padding=(12, 10, 0, 0),
            visible=False,
        )

    def show(self, *columns: FloatArray) -> None:
        """Shows times (n,) and values (n,); of one instant there is no curve."""
        there = len(columns[0]) > 1 and bool(columns[0][-1] > columns[0][0])
        if there:
            self._plot.data = columns
        if there != self._plot.visible:
            self._plot.visible, self._words.visible = there, not there

    def remove(self) -> None:
        """Takes it out of the page."""
        self._plot.remove()
        self._words.remove()
