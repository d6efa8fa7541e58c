"""A page to watch, without controls: the scene, what the fingers feel, curves, and which of it is shown."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence

import numpy as np
import viser

from quasirigid.live import html
from quasirigid.live.curves import Curves
from quasirigid.live.draw import Layers, SceneDrawing
from quasirigid.live.framing import Framing, frame_of
from quasirigid.live.panel import ViewPanel
from quasirigid.live.scale_bar import set_scene
from quasirigid.live.server import LEFT_WIDTH, SLOW_RATE
from quasirigid.live.session import HISTORY
from quasirigid.live.stage import close_server, open_server
from quasirigid.live.tactile import Tactile
from quasirigid.live.tracked_hand import TrackedDrawing
from quasirigid.scene.model import SceneModel, SceneState
from quasirigid.scene.scaling import drawing_scale, scaled_model, scaled_state

BLANK = np.full((8, 8, 3), 255, np.uint8)


class PassivePage:
    """Shows states of a scene that somebody else moves. Call from one thread at a time; ``begin`` comes first."""

    def __init__(
        self,
        host: str,
        port: int,
        *,
        headroom: float | None = None,
        allow_origins: Sequence[str] = (),
        reset: Callable[[], None] | None = None,
    ) -> None:
        """``headroom``: keep so much room above the first scene in the picture, m, and the camera for those that follow. ``reset`` is
        called, from any thread, when somebody presses the button that there is then.
        """
        self._headroom = headroom
        self._scale = 1.0
        """Metres in the drawing over metres in the world; 1 where a hand is expected."""
        self._now: tuple[SceneModel, SceneState] | None = None
        """What is drawn."""
        self.server = open_server(host, port, "quasirigid", allow_origins)
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
        self._framing = Framing(self.server)
        self._framing.add_button(lambda: self._now)
        self._status = gui.add_html("")
        if reset is not None:
            button = gui.add_button("Reset", hint="Puts the object back where it stood at the start, and clears what has become of it")
            button.on_click(lambda _: reset())
        with gui.add_folder("View"):
            ViewPanel(self.server, self._layers, self._layers_changed)
        left = gui.add_panel()
        self._sensors: viser.GuiTabHandle = left.add_tab("Sensors")
        with self._sensors:
            self._legend = gui.add_html("")
            self._picture = gui.add_image(BLANK, format="jpeg", jpeg_quality=88)
        self._left = left
        self._timing: viser.GuiTabHandle | None = None
        """Only where there are pads: otherwise all curves fit below each other."""
        left.dock_left()
        left.set_width(LEFT_WIDTH)

    def close(self) -> None:
        """Ends the page."""
        close_server(self.server)

    def _layers_changed(self) -> None:
        self.changed = True

    def begin(self, model: SceneModel, state: SceneState) -> None:
        """Show this scene from now on, in place of the one before."""
        first = self.drawing is None
        if self._headroom is None:
            self._scale = drawing_scale(model, state)
        drawn, shown = scaled_model(model, self._scale), scaled_state(state, self._scale)
        self._now = drawn, shown
        if first or self._headroom is None:
            set_scene(self.server, self._framing, frame_of(drawn, shown, self._headroom or 0.0), drawn.floor, self._scale)
        if self.drawing is not None:
            self.drawing.remove()
        if self._tracked is not None:
            self._tracked.remove()
            self._tracked = None
        if self._curves is not None:
            self._curves.remove()
        if model.fingers and self._timing is None:
            self._timing = self._left.add_tab("Timing")
        elif not model.fingers and self._timing is not None:
            self._timing.remove()
            self._timing = None
        self.drawing = SceneDrawing(self.server, drawn, layers=self._layers)
        self._tactile = Tactile(model)
        if not model.fingers:
            self._picture.image = BLANK
        self._curves = Curves(self.server, model, self._sensors, self._timing)
        self._history.clear()
        self._slow_at = 0.0
        self.drawing.draw(shown)

    def draw(self, state: SceneState, status: str, *, exact: bool = False) -> None:
        """Show this state; ``status`` is HTML for the panel, which follows ``SLOW_RATE`` times a second like all figures.

        ``exact``: the state stays, so all of it is shown, as of ``SceneDrawing.draw``.
        """
        assert self.drawing is not None
        if self.changed:
            self.changed = False
            self.drawing.apply_layers()
        shown = scaled_state(state, self._scale)
        self._now = self.drawing.model, shown
        if shown.tracked is not None:
            self._tracked = self._tracked or TrackedDrawing(self.server)
            with self.server.atomic():
                self._tracked.draw(shown.tracked)
        self.drawing.draw(shown, exact=exact)
        if exact or time.perf_counter() - self._slow_at > 1.0 / SLOW_RATE:
            self._slow_at = time.perf_counter()
            self._figures(state, status, together=exact)

    def _figures(self, state: SceneState, status: str, *, together: bool) -> None:
        assert self.drawing is not None
        assert self._curves is not None
        self._framing.follow(self.drawing.model, scaled_state(state, self._scale))
        self._history.append((state.time, state.normal_forces.tolist(), state.step_time, len(state.contacts)))
        scale = self.drawing.scale.top
        self._status.content = status
        self._legend.content = html.legend(scale if self.drawing.model.fingers else None)
        if self.drawing.model.fingers:
            self._picture.image = self._tactile.picture(state, scale)
        self._curves.show(*(list(column) for column in zip(*self._history, strict=True)), together=together)
