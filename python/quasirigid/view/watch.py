"""``quasirigid.view(world)``: looks at a world that somebody else steps."""

from __future__ import annotations

import sys
import threading
import time
from types import TracebackType

import numpy as np

from quasirigid._quasirigid import World
from quasirigid.errors import QuasirigidError
from quasirigid.view import words
from quasirigid.view.draw import Layers, SceneDrawing
from quasirigid.view.panel import ViewPanel
from quasirigid.view.plots import Curves
from quasirigid.view.scene import SceneState
from quasirigid.view.server import LEFT_WIDTH, SLOW_RATE, announce, open_browser
from quasirigid.view.session import HISTORY
from quasirigid.view.stage import add_ground, close_server, open_server, place_camera
from quasirigid.view.tactile import Tactile
from quasirigid.view.world_scene import WorldScene

LOOKS = 30.0
"""Looks at the world per second, at most."""
TRIES = 4
"""A look during which the world went on is repeated so often."""


class WorldView:
    """A page that shows a world while you step it. It only looks: it never changes the world.

    Use it as a context manager, or call ``close``; it also ends with the program.
    """

    def __init__(self, world: World, *, host: str, port: int) -> None:
        self.world = world
        self._scene = WorldScene(world)
        self._server = open_server(host, port, "quasirigid")
        self._asked, self._host = port, host
        self._layers = Layers()
        self._redraw = True
        self._ended = threading.Event()
        self._history: list[tuple[float, list[float], float, int]] = []
        gui = self._server.gui
        gui.set_panel_label("quasirigid")
        self._status = gui.add_html("")
        with gui.add_folder("View"):
            ViewPanel(self._server, self._layers, self._layers_changed)
        left = gui.add_panel()
        with left.add_tab("Sensors"):
            self._legend = gui.add_html("")
            self._picture = gui.add_image(np.full((8, 8, 3), 255, np.uint8), format="jpeg", jpeg_quality=88)
            self._curves = Curves(self._server, self._scene.model)
        left.dock_left()
        left.set_width(LEFT_WIDTH)
        self._begin()
        self._thread = threading.Thread(target=self._look_on, name="quasirigid-view", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{'localhost' if self._host in ('127.0.0.1', '0.0.0.0', '::') else self._host}:{self._server.get_port()}"

    def close(self) -> None:
        """Ends the page; the world stays as it is."""
        self._ended.set()
        self._thread.join(timeout=5.0)
        close_server(self._server)

    def __enter__(self) -> WorldView:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def _layers_changed(self) -> None:
        self._redraw = True

    def _begin(self) -> None:
        state = self._scene.state()
        add_ground(self._server, self._scene.model.floor)
        place_camera(self._server, self._scene.model, state.positions, state.quaternions)
        self._drawing = SceneDrawing(self._server, self._scene.model, layers=self._layers)
        self._tactile = Tactile(self._scene.model)
        self._drawing.draw(state)

    def _look(self) -> SceneState | None:
        """The world between two steps; ``None`` while bodies come and go."""
        for _ in range(TRIES):
            before = self.world.steps
            try:
                state = self._scene.state()
            except QuasirigidError:
                return None  # a body was removed: the model is made anew
            if self.world.steps == before:
                return state
        return state

    def _look_on(self) -> None:
        last, slow, settled = -1, 0.0, False
        while not self._ended.wait(1.0 / LOOKS):
            try:
                if not self._scene.unchanged():
                    self._drawing.remove()
                    self._scene = WorldScene(self.world)
                    self._begin()
                state = self._look()
                if state is None or (state.step == last and settled and not self._redraw):
                    continue
                last, settled = state.step, state.step == last
                if self._redraw:
                    self._redraw = False
                    self._drawing.apply_layers()
                self._drawing.draw(state, exact=settled)
                if time.perf_counter() - slow > 1.0 / SLOW_RATE:
                    slow = time.perf_counter()
                    self._show(state)
            except (RuntimeError, QuasirigidError) as error:
                if not self._ended.is_set():
                    print(f"quasirigid: view: {error}", file=sys.stderr)

    def _show(self, state: SceneState) -> None:
        self._history = [*self._history[-HISTORY:], (state.time, state.normal_forces.tolist(), 0.0, len(state.contacts))]
        scale = self._drawing.scale.top
        self._status.content = words.note(f"time {state.time:.3f} s, {len(state.contacts)} contacts, {state.step} steps")
        self._legend.content = words.legend(scale)
        if self._scene.model.fingers:
            self._picture.image = self._tactile.picture(state, scale)
        self._curves.show(*(list(column) for column in zip(*self._history, strict=True)))


def watch(world: World, host: str, port: int, browser: bool) -> WorldView:
    """What ``quasirigid.view`` does."""
    shown = WorldView(world, host=host, port=port)
    url = announce(shown._server, host, port)
    if browser:
        open_browser(url)
    return shown
