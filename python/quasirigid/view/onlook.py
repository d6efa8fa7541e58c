"""A page that only looks: the scene, what the fingers feel, curves, and which of it is shown."""

from __future__ import annotations

import time
from collections import deque

import numpy as np
import viser

from quasirigid.view import words
from quasirigid.view.draw import Layers, SceneDrawing
from quasirigid.view.panel import ViewPanel
from quasirigid.view.plots import Curves
from quasirigid.view.scene import SceneModel, SceneState
from quasirigid.view.server import LEFT_WIDTH, SLOW_RATE
from quasirigid.view.session import HISTORY
from quasirigid.view.stage import add_ground, close_server, open_server, place_camera
from quasirigid.view.tactile import Tactile
from quasirigid.view.tracked import TrackedDrawing

BLANK = np.full((8, 8, 3), 255, np.uint8)


class OnlookPage:
    """Shows states of a scene that somebody else moves. Call from one thread at a time; ``begin`` comes first."""

    def __init__(self, host: str, port: int, *, headroom: float | None = None) -> None:
        """``headroom``: keep so much room above the first scene in the picture, m, and the camera for those that follow."""
        self._headroom = headroom
        self.server = open_server(host, port, "quasirigid")
        self.changed = True
        """What is shown was changed in the page since the last ``draw``."""
        self._layers = Layers()
        self.drawing: SceneDrawing | None = None
        """Of the scene that is shown."""
        self._curves: Curves | None = None
        self._tracked: TrackedDrawing | None = None
        self._history: deque[tuple[float, list[float], float, int]] = deque(maxlen=HISTORY)
        self._slow_at = 0.0
        gui = self.server.gui
        gui.set_panel_label("quasirigid")
        self._status = gui.add_html("")
        with gui.add_folder("View"):
            ViewPanel(self.server, self._layers, self._layers_changed)
        left = gui.add_panel()
        self._sensors: viser.GuiTabHandle = left.add_tab("Sensors")
        with self._sensors:
            self._legend = gui.add_html("")
            self._picture = gui.add_image(BLANK, format="jpeg", jpeg_quality=88)
        left.dock_left()
        left.set_width(LEFT_WIDTH)

    def close(self) -> None:
        """Ends the page."""
        close_server(self.server)

    def _layers_changed(self) -> None:
        self.changed = True

    def begin(self, model: SceneModel, state: SceneState) -> None:
        """Show this scene from now on, in place of the one before."""
        if self._headroom is None:
            place_camera(self.server, model, state.positions, state.quaternions)
        elif self.drawing is None:
            place_camera(self.server, model, state.positions, state.quaternions, self._headroom)
        if self.drawing is not None:
            self.drawing.remove()
        if self._tracked is not None:
            self._tracked.remove()
            self._tracked = None
        if self._curves is not None:
            self._curves.remove()
        add_ground(self.server, model.floor)
        self.drawing = SceneDrawing(self.server, model, layers=self._layers)
        self._tactile = Tactile(model)
        if not model.fingers:
            self._picture.image = BLANK
        with self._sensors:
            self._curves = Curves(self.server, model)
        self._history.clear()
        self._slow_at = 0.0
        self.drawing.draw(state)

    def draw(self, state: SceneState, status: str, *, exact: bool = False) -> None:
        """Show this state; ``status`` is HTML for the panel, which follows ``SLOW_RATE`` times a second like all figures.

        ``exact``: the state stays, so all of it is shown, as of ``SceneDrawing.draw``.
        """
        assert self.drawing is not None
        if self.changed:
            self.changed = False
            self.drawing.apply_layers()
        if state.tracked is not None:
            self._tracked = self._tracked or TrackedDrawing(self.server)
            with self.server.atomic():
                self._tracked.draw(state.tracked)
        self.drawing.draw(state, exact=exact)
        if exact or time.perf_counter() - self._slow_at > 1.0 / SLOW_RATE:
            self._slow_at = time.perf_counter()
            self._figures(state, status, together=exact)

    def _figures(self, state: SceneState, status: str, *, together: bool) -> None:
        assert self.drawing is not None
        assert self._curves is not None
        self._history.append((state.time, state.normal_forces.tolist(), state.step_time, len(state.contacts)))
        scale = self.drawing.scale.top
        self._status.content = status
        self._legend.content = words.legend(scale if self.drawing.model.fingers else None)
        if self.drawing.model.fingers:
            self._picture.image = self._tactile.picture(state, scale)
        self._curves.show(*(list(column) for column in zip(*self._history, strict=True)), together=together)
