"""``quasirigid.view(world)``: shows a world that somebody else steps."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from math import nan
from types import TracebackType

from quasirigid._quasirigid import Body, World
from quasirigid.errors import InvalidHandleError, QuasirigidError
from quasirigid.live import html
from quasirigid.live.error_log import ErrorLog
from quasirigid.live.passive_page import PassivePage
from quasirigid.live.real_time_factor import RealTimeFactor
from quasirigid.live.server import announce, open_browser
from quasirigid.live.stage import page_url
from quasirigid.scene.model import SceneState
from quasirigid.scene.world import WorldScene
from quasirigid.system.forks import Owner

RATE = 30.0
"""States of the world read per second, at most."""
TRIES = 4
"""Reading a state during which the world was stepped is repeated so often."""
RESTS = 0.5
"""A world without a step for so long is said to rest, s."""


class WorldView:
    """A page that shows a world while you step it. It never changes the world.

    Use it as a context manager, or call ``close``; it also ends with the program.
    """

    def __init__(
        self,
        world: World,
        *,
        host: str,
        port: int,
        allow_origins: Sequence[str] = (),
        fingertips: Sequence[Body] = (),
        phase: Callable[[], str] | None = None,
        speed: float | None = None,
    ) -> None:
        """``fingertips`` are those of its bodies that show what they feel. ``phase`` says what is going on, ``speed`` is the
        real-time factor that the program that steps the world aims at; ``None``: it aims at none.
        """
        self.world = world
        self._owner = Owner("view of a world", "close it before the fork, or open another one here")
        self._fingertips = list(fingertips)
        self._phase, self._speed = phase, speed
        self._real_time_factor = RealTimeFactor()
        self._scene = WorldScene(world, pads=self._fingertips)
        self._page = PassivePage(host, port, allow_origins=allow_origins)
        self.url = page_url(host, self._page.server.get_port())
        """Address of the page."""
        self._ended = threading.Event()
        self._page.begin(self._scene.model, self._state())
        self._thread = threading.Thread(target=self._run, name="quasirigid-view", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Ends the page; the world stays as it is. Raises ``ForkError`` in a forked child."""
        self._owner.check()
        self._ended.set()
        self._thread.join(timeout=5.0)
        self._page.close()

    def __enter__(self) -> WorldView:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._owner.here:  # else a forked child leaves the block, and the page stays open in the parent
            self.close()

    def _state(self) -> SceneState:
        return self._scene.state(self.world.report, "" if self._phase is None else self._phase())

    def _consistent_state(self) -> SceneState | None:
        """The world between two steps; ``None`` while bodies come and go."""
        for _ in range(TRIES):
            before = self.world.steps
            try:
                state = self._state()
            except QuasirigidError:
                return None  # a body was removed: the model is built again
            if self.world.steps == before:
                return state
        return state

    def _run(self) -> None:
        last, settled, moved_at, rested, errors = self.world.steps, False, 0.0, False, ErrorLog()
        while not self._ended.wait(1.0 / RATE):
            try:
                if not self._scene.unchanged():
                    self._fingertips = [body for body in self._fingertips if _is_there(body)]
                    self._scene = WorldScene(self.world, pads=self._fingertips)
                    self._page.begin(self._scene.model, self._state())
                state = self._consistent_state()
                if state is None:
                    continue
                if state.step != last:
                    moved_at = time.monotonic()
                    self._real_time_factor.update(state.time)
                rests = time.monotonic() - moved_at > RESTS
                if state.step == last and settled and rests == rested and not self._page.changed:
                    continue
                last, settled, rested = state.step, state.step == last, rests
                self._page.draw(state, self._figures(state, running=not rests), exact=settled)
            except Exception as error:
                if not self._ended.is_set():
                    errors.log(error)

    def _figures(self, state: SceneState, *, running: bool) -> str:
        real_time = self._real_time_factor.value(nan if self._speed is None else self._speed)
        return html.figures(state.phase, state.time, real_time, self._speed, state.step_time, len(state.contacts), running=running)


def _is_there(body: Body) -> bool:
    try:
        return body.index >= 0
    except InvalidHandleError:
        return False


def watch(
    world: World,
    host: str,
    port: int,
    browser: bool,
    *,
    allow_origins: Sequence[str] = (),
    fingertips: Sequence[Body] = (),
    phase: Callable[[], str] | None = None,
    speed: float | None = None,
    ends: str = "",
) -> WorldView:
    """What ``quasirigid.view`` does; ``fingertips``, ``phase`` and ``speed`` are those of ``WorldView``, ``ends`` that of ``announce``."""
    shown = WorldView(world, host=host, port=port, allow_origins=allow_origins, fingertips=fingertips, phase=phase, speed=speed)
    announce(shown.url, host, port, page="view of the world", can="look on", ends=ends)
    if browser:
        open_browser(shown.url)
    return shown
