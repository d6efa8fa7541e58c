"""The live view: a page, a simulation thread, and a thread that draws the newest state."""

from __future__ import annotations

import sys
import threading
import time
import webbrowser
from collections.abc import Sequence
from typing import Any

import numpy as np
import viser

from quasirigid.grasp.options import GraspOptions
from quasirigid.live import html
from quasirigid.live.curves import Curves
from quasirigid.live.dragging import HANDLES, Touch
from quasirigid.live.draw import Layers, SceneDrawing
from quasirigid.live.error_log import ErrorLog
from quasirigid.live.framing import Framing, frame_of
from quasirigid.live.panel import ControlPanel, ViewPanel
from quasirigid.live.play import Play
from quasirigid.live.scale_bar import set_scene
from quasirigid.live.session import Frame, Session
from quasirigid.live.stage import PORT, close_server, open_server, page_url
from quasirigid.live.tactile import Tactile
from quasirigid.net.access import warn_if_open
from quasirigid.scene.model import SceneModel, SceneState
from quasirigid.scene.pressure import alike

RATE = 34.0
"""Updates of the page per second, at most."""
SLOW_RATE = 4.0
"""Per second, the picture of the sensors or, in turn with it, figures and one of the plots: in a page without a graphics card each costs as
much as the whole scene.
"""
HANDLE = 0.11
"""Room in the picture for the gizmo above the palm, and for a lift, m."""
LEFT_WIDTH = 300
"""Of the panel with the plots, px."""


def announce(url: str, host: str, asked: int, *, page: str, can: str, ends: str = "") -> None:
    """Says on standard error where the ``page`` (a name for it) is, what whoever reaches it ``can`` do if it is open to the network, and
    what ``ends`` it.
    """
    if not url.endswith(f":{asked}"):
        print(f"quasirigid: port {asked} is in use; the page is on the next free one", file=sys.stderr)
    print(f"quasirigid: {page} on {url}{ends and f'  ({ends})'}", file=sys.stderr)
    warn_if_open(host, can, lambda warning: print(f"quasirigid: {warning}", file=sys.stderr))


def open_browser(url: str) -> None:
    """Opens the page, without waiting; where there is no browser nothing happens."""
    threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()


class LiveView:
    """Serves a ``Play``."""

    def __init__(
        self, play: Play, options: GraspOptions, *, host: str = "127.0.0.1", port: int = PORT, allow_origins: Sequence[str] = ()
    ) -> None:
        self.session = Session(play)
        self.server = open_server(host, port, "quasirigid", allow_origins)
        self.url = page_url(host, self.server.get_port())
        """Address of the page."""
        self.updates = 0
        """Updates of the page so far."""
        self.update_time = 0.0
        """CPU time of the drawing thread in them, s."""
        _, frame = self.session.newest()
        self._layers = Layers()
        self._base_handle, self._finger_handles = HANDLES[0], False
        self._redraw = True
        self._drawing: SceneDrawing | None = None
        self._touch: Touch | None = None
        self._generation = -1
        self._scale_shown = -1.0
        self._slow_at = 0.0
        self._turn = False
        self._drawn = -1
        gui = self.server.gui
        gui.set_panel_label("quasirigid")
        self._framing = Framing(self.server)
        self._framing.add_button(self._shown)
        tabs = gui.add_tab_group()
        with tabs.add_tab("Control"):
            self._control = ControlPanel(self.server, self.session, options, play)
        with tabs.add_tab("View"):
            ViewPanel(self.server, self._layers, self._layers_changed)
            hand = gui.add_dropdown("Handle of the hand", HANDLES, initial_value=self._base_handle)
            fingers = gui.add_checkbox("Handles of the fingertips", self._finger_handles)

            def choose(_: viser.GuiEvent[Any]) -> None:
                self._base_handle, self._finger_handles = hand.value, fingers.value
                self._show_handles()

            hand.on_update(choose)
            fingers.on_update(choose)
        left = gui.add_panel()
        with left.add_tab("Sensors") as sensors:
            self._legend = gui.add_html("")
            self._picture = gui.add_image(np.full((8, 8, 3), 255, np.uint8), format="jpeg", jpeg_quality=88)
        self._curves = Curves(self.server, frame.model, sensors, left.add_tab("Timing"))
        left.dock_left()
        left.set_width(LEFT_WIDTH)
        self._thread = threading.Thread(target=self._draw_loop, name="quasirigid-drawing", daemon=True)
        self._build(frame)

    def start(self) -> None:
        """Starts simulation and drawing."""
        self.session.start()
        self._thread.start()

    def stop(self) -> None:
        """Ends both, and the server."""
        self.session.stop()
        if self._thread.is_alive():
            self._thread.join(timeout=5.0)
        close_server(self.server)

    def _show_handles(self) -> None:
        if self._touch is not None:
            self._touch.show(self._base_handle, self._finger_handles)

    def _layers_changed(self) -> None:
        self._redraw = True

    def _shown(self) -> tuple[SceneModel, SceneState]:
        frame = self.session.newest()[1]
        return frame.model, frame.state

    def _build(self, frame: Frame) -> None:
        """Draws another model."""
        if self._touch is not None and self._drawing is not None:
            self._touch.remove()
            self._drawing.remove()
        self._generation = frame.generation
        set_scene(self.server, self._framing, frame_of(frame.model, frame.state, HANDLE), frame.model.floor)
        self._drawing = SceneDrawing(self.server, frame.model, layers=self._layers)
        self._drawing.hurried = True
        self._touch = Touch(self.server, self.session, self._drawing, frame)
        self._show_handles()
        self._tactile = Tactile(frame.model)
        self._pictured: tuple[SceneState, float] | None = None
        self._drawing.draw(frame.state)
        self._slow(frame)

    def _draw_loop(self) -> None:
        errors = ErrorLog()
        while self.session.alive:
            number, frame = self.session.newest(self._drawn, timeout=0.2)
            began, cpu = time.perf_counter(), time.thread_time()
            if number != self._drawn or self._redraw:
                self._drawn = number
                try:
                    self._draw(frame)
                except Exception as error:
                    if self.session.alive:  # else the server was stopped meanwhile
                        errors.log(error)
                self.updates += 1
                self.update_time += time.thread_time() - cpu
            time.sleep(max(0.0, 1.0 / RATE - (time.perf_counter() - began)))

    def _draw(self, frame: Frame) -> None:
        if frame.generation != self._generation:
            self._build(frame)
        assert self._drawing is not None
        assert self._touch is not None
        if self._redraw:
            self._redraw = False
            self._drawing.apply_layers()
        pull = None if frame.pulled is None else frame.pulled[:2]
        self._drawing.draw(frame.state, pull, exact=not frame.running)
        self._touch.follow(frame)
        now = time.perf_counter()
        if now - self._slow_at > 1.0 / SLOW_RATE or not frame.running:
            self._slow_at = now
            self._slow(frame)

    def _slow(self, frame: Frame) -> None:
        """What need not be shown at every update: the picture and the rest in turn, all of it of a state that stays."""
        assert self._drawing is not None
        scale = self._drawing.scale.top
        self._turn = not self._turn
        if scale != self._scale_shown:
            self._scale_shown = scale
            self._legend.content = html.legend(scale)
        if self._turn or not frame.running:
            self._show_picture(frame.state, scale)
        if not self._turn or not frame.running:
            self._show_figures(frame)

    def _show_picture(self, state: SceneState, scale: float) -> None:
        if self._pictured is None or self._pictured[1] != scale or not alike(self._pictured[0], state):
            self._pictured = (state, scale)
            self._picture.image = self._tactile.picture(state, scale)

    def _show_figures(self, frame: Frame) -> None:
        self._control.show(frame)
        samples = list(self.session.samples)
        self._curves.show(
            [s.time for s in samples],
            [s.forces for s in samples],
            [s.step_time for s in samples],
            [s.contacts for s in samples],
            together=not frame.running,
        )
