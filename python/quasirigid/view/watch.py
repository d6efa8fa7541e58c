"""``quasirigid.view(world)``: looks at a world that somebody else steps."""

from __future__ import annotations

import sys
import threading
from types import TracebackType

from quasirigid._quasirigid import World
from quasirigid.errors import QuasirigidError
from quasirigid.view import words
from quasirigid.view.onlook import OnlookPage
from quasirigid.view.scene import SceneState
from quasirigid.view.server import announce, open_browser
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
        self._page = OnlookPage(host, port)
        self._server = self._page.server
        self._host = host
        self._ended = threading.Event()
        self._page.begin(self._scene.model, self._scene.state())
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
        self._page.close()

    def __enter__(self) -> WorldView:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

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
        last, settled = -1, False
        while not self._ended.wait(1.0 / LOOKS):
            try:
                if not self._scene.unchanged():
                    self._scene = WorldScene(self.world)
                    self._page.begin(self._scene.model, self._scene.state())
                state = self._look()
                if state is None or (state.step == last and settled and not self._page.changed):
                    continue
                last, settled = state.step, state.step == last
                figures = f"time {state.time:.3f} s, {len(state.contacts)} contacts, {state.step} steps"
                self._page.draw(state, words.note(figures), exact=settled)
            except (RuntimeError, QuasirigidError) as error:
                if not self._ended.is_set():
                    print(f"quasirigid: view: {error}", file=sys.stderr)


def watch(world: World, host: str, port: int, browser: bool) -> WorldView:
    """What ``quasirigid.view`` does."""
    shown = WorldView(world, host=host, port=port)
    url = announce(shown._server, host, port)
    if browser:
        open_browser(url)
    return shown
