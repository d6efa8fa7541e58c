"""Feedback for any number of listeners: a websocket server that sends each of them the newest observation when it is ready for it."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Sequence

from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from quasirigid.errors import InvalidValueError
from quasirigid.mocap.feedback import RATE, TARGETS, JsonSink, Raster, is_port
from quasirigid.mocap.observation import Observation
from quasirigid.net.access import Access
from quasirigid.net.serving import ServerThread, netloc

LISTENERS = 32
"""At the same time, at most."""
GOODBYE = 1.0
"""How long listeners may take to hear that it is over, s."""
LONGEST = 1024
"""Bytes that a listener may send at once; what it says is not heard."""


class WebsocketFeedback:
    """Sends observations of a session to whoever listens, ``rate`` times per second of simulated time.

    It runs in a thread of its own: a listener that is slow misses observations, the session and other listeners do not wait for it.
    """

    def __init__(self, text: str, *, rate: float = RATE, allow_origins: Sequence[str] = ()) -> None:
        """``text`` is ``ws:PORT``, for listeners of this machine, or ``ws:HOST:PORT`` with an address of this machine.

        Programs may listen, and pages of this machine, whoever serves them: what listeners say is not heard. ``allow_origins`` are other
        pages that may, as of ``quasirigid.net.access.Access``.

        Raises ``InvalidValueError``, or ``NetworkError`` for a port in use.
        """
        self._raster = Raster(rate)
        kind, _, rest = text.partition(":")
        host, _, port = rest.rpartition(":") if ":" in rest else ("127.0.0.1", "", rest)
        if kind != "ws" or not host or not is_port(port):
            raise InvalidValueError("--feedback", TARGETS, text, "ws:9001 serves ws://127.0.0.1:9001")
        self._access = Access(host, allow_origins, programs=True, local_pages=True)
        self._sink = JsonSink()
        self._newest, self._end = "", ""
        self._last: Observation | None = None
        self._deaf: set[ServerConnection] = set()
        """Who has not heard of the end yet."""
        self._all_heard = threading.Event()
        self._listeners: dict[ServerConnection, asyncio.Event] = {}
        self.sent = 0
        """Observations that were offered to the listeners."""
        self.failed = 0
        """Observations that could not be."""
        self.listeners = 0
        """Who has listened so far."""
        self._server = ServerThread(
            self._talk,
            host,
            int(port),
            name="feedback",
            process_request=self._answer,
            max_size=LONGEST,
            # A listener that takes nothing for half a minute has gone.
            ping_interval=15.0,
            ping_timeout=15.0,
        )
        self.address = self._server.address

    def __call__(self, observation: Observation) -> None:
        """Send it if it is time."""
        if not self._raster.due(observation.time):
            return
        try:
            self._newest = self._sink.encode(observation).decode()
        except ValueError:  # a force that is no number cannot be written
            self.failed += 1
            return
        self._last = observation
        self.sent += 1
        self._server.call(self._wake)

    def story(self) -> str:
        """What became of it."""
        return f"{self.sent} observations on ws://{netloc(*self.address)}, {self.listeners} listeners"

    def close(self) -> None:
        """Tell the listeners that it is over, end all connections and close the port."""
        if self._last is not None:
            self._end = self._sink.farewell(self._last).decode()
            self._last = None
            self._server.call(self._part)
            self._all_heard.wait(GOODBYE)
        self._server.close()

    def _part(self) -> None:
        self._deaf = set(self._listeners)
        self._hear_end(None)
        self._wake()

    def _hear_end(self, connection: ServerConnection | None) -> None:
        self._deaf.discard(connection)
        if not self._deaf:
            self._all_heard.set()

    # The thread.

    def _wake(self) -> None:
        for news in self._listeners.values():
            news.set()

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """``None`` for who may listen."""
        why = self._access.refusal(connection, request, opens_socket=True)
        if why is not None:
            return connection.respond(403, why)
        if len(self._listeners) >= LISTENERS:
            return connection.respond(503, "too many listeners\n")
        return None

    async def _talk(self, connection: ServerConnection) -> None:
        news = asyncio.Event()
        self._listeners[connection] = news
        self.listeners += 1
        sender = asyncio.create_task(self._send(connection, news))
        try:
            async for _ in connection:
                pass
        except ConnectionClosed:
            pass
        finally:
            sender.cancel()
            del self._listeners[connection]
            if self._end:
                self._hear_end(connection)

    async def _send(self, connection: ServerConnection, news: asyncio.Event) -> None:
        known: str | None = None
        while True:
            await news.wait()
            news.clear()
            newest = self._newest
            if newest is not known:  # it may have been sent while the news of it were on their way
                known = newest
                await connection.send(newest)
            if self._end:
                await connection.send(self._end)
                self._hear_end(connection)
                return
