"""A page to watch, without controls, in a process of its own: of the time of the steps it takes the copying of a state,
some tenths of a millisecond.

A thread would not do. Steps of a millisecond that are done in Python between two calls of the engine wait for the interpreter's lock, which
a thread that draws holds for milliseconds.
"""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from collections.abc import Sequence
from multiprocessing import get_context
from multiprocessing.connection import Connection

from quasirigid.errors import NetworkError
from quasirigid.live import html
from quasirigid.live.error_log import ErrorLog
from quasirigid.live.real_time_factor import RealTimeFactor
from quasirigid.live.stage import PORT, free_port, page_url
from quasirigid.net.access import Access
from quasirigid.scene.model import SceneModel, SceneState
from quasirigid.system.child_process import leave_signals_to_parent

STATES = 30.0
"""States sent to the page per second, at most."""
RESET = "reset"
"""What the page sends back when its button is pressed."""
HEADROOM = 0.2
"""Room for a hand above what is there at the start, m."""
PATIENCE = 60.0
"""Seconds that a busy machine may take to start the page."""


class ViewerProcess:
    """A viewer of a session (``quasirigid.mocap.session.Viewer``). The newest state wins: a slow page misses some, the
    session never waits.
    """

    def __init__(self, *, host: str = "127.0.0.1", port: int = PORT, allow_origins: Sequence[str] = ()) -> None:
        """Serve the page on ``port`` or the next free one of the address ``host``. ``allow_origins`` as of
        ``quasirigid.net.access.Access``.

        Raises ``InvalidValueError`` for an address that is not this machine's, ``NetworkError`` if the page does not start.
        """
        Access(host, allow_origins)  # what is wrong with them is said here, not by the other process
        self.host, self.port = host, free_port(host, port)
        context = get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(
            target=_serve, args=(theirs, host, self.port, tuple(allow_origins)), name="quasirigid-view", daemon=True
        )
        self._process.start()
        theirs.close()
        try:
            if not self._pipe.poll(PATIENCE):
                raise EOFError
            self.port = int(self._pipe.recv())
        except (EOFError, OSError):
            self._process.terminate()
            raise NetworkError("page of the view", "to start", "it did not", "try another port") from None
        self._news = threading.Condition()
        self._model: SceneModel | None = None
        self._state: SceneState | None = None
        self._ending = False
        self._drawn = float("-inf")
        self._thread = threading.Thread(target=self._send, name="quasirigid-view-sender", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """Address of the page."""
        return page_url(self.host, self.port)

    @property
    def alive(self) -> bool:
        """Whether the page is there."""
        return self._thread.is_alive()

    def begin(self, model: SceneModel) -> None:
        """Show this scene from now on."""
        with self._news:
            self._model, self._state, self._drawn = model, None, float("-inf")

    def wants_state(self) -> bool:
        """Whether the last state is old enough, and on its way."""
        return self._state is None and time.monotonic() - self._drawn >= 1.0 / STATES and self.alive

    def draw(self, state: SceneState) -> None:
        """Show this state, unless a newer one comes before the page is ready for it."""
        with self._news:
            self._state, self._drawn = state, time.monotonic()
            self._news.notify()

    def reset_asked(self) -> bool:
        """Whether Reset was pressed in the page since the last call."""
        pressed = False
        try:
            while self._pipe.poll():
                pressed = self._pipe.recv() == RESET or pressed
        except (EOFError, OSError):
            pass  # the page has ended, which the sender says
        return pressed

    def close(self) -> None:
        """End the page."""
        with self._news:
            self._ending = True
            self._news.notify()
        self._thread.join(timeout=2.0)
        if self._thread.is_alive():
            self._process.terminate()  # it hangs: so whoever waits to send to it gives up
        self._pipe.close()
        self._process.join(timeout=5.0)
        if self._process.is_alive():
            self._process.terminate()

    def __enter__(self) -> ViewerProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _send(self) -> None:
        try:
            while True:
                with self._news:
                    self._news.wait_for(lambda: self._state is not None or self._ending)
                    if self._ending:
                        return
                    model, state, self._model, self._state = self._model, self._state, None, None
                self._pipe.send((model, state))
        except OSError:
            if not self._ending:
                print("quasirigid: the page of the view has ended; the session goes on", file=sys.stderr, flush=True)


def _serve(pipe: Connection, host: str, port: int, allow_origins: Sequence[str]) -> None:
    """The process: draws what comes through ``pipe`` until it is closed."""
    leave_signals_to_parent()  # the session, which then closes the pipe
    from quasirigid.live.passive_page import PassivePage  # the server takes half a second to import

    def reset() -> None:
        with contextlib.suppress(OSError):  # the session has ended
            pipe.send(RESET)

    page = PassivePage(host, port, headroom=HEADROOM, allow_origins=allow_origins, reset=reset)
    pipe.send(page.server.get_port())
    real_time_factor, errors = RealTimeFactor(), ErrorLog()
    state: SceneState | None = None
    settled = False
    try:
        while True:
            if pipe.poll(0.1):
                settled = False
                model, state = _newest(pipe)
                if model is not None:
                    page.begin(model, state)
                    real_time_factor.clear()
                real_time_factor.update(state.time)
            elif state is None or (settled and not page.changed):
                continue
            else:
                settled = True  # nothing new has come: what is on show stays for a while
            try:
                page.draw(state, _status(state, real_time_factor), exact=settled)
            except Exception as error:
                errors.log(error)
    except (EOFError, OSError):
        pass  # the session has ended
    finally:
        page.close()


def _newest(pipe: Connection) -> tuple[SceneModel | None, SceneState]:
    """What has come last, and the last model that came with it."""
    model: SceneModel | None = None
    while True:
        new_model, state = pipe.recv()
        model = model if new_model is None else new_model
        if not pipe.poll():
            return model, state


def _status(state: SceneState, real_time_factor: RealTimeFactor) -> str:
    from quasirigid.live.tracked_hand import hand_rows

    text = html.figures(
        state.phase, state.time, real_time_factor.value(1.0), 1.0, state.step_time, len(state.contacts), running=state.time > 0.0
    )
    text += html.complaint(state.notice)
    return text if state.tracked is None else text + html.table(hand_rows(state.tracked, state))
