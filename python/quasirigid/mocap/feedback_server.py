"""Feedback for any number of listeners: a websocket server that sends each of them the newest look when it is ready for it."""

from __future__ import annotations

import asyncio
from urllib.parse import urlsplit

from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from quasirigid.errors import InvalidValueError
from quasirigid.mocap.feedback import RATE, TARGETS, JsonSink, Raster, is_port
from quasirigid.mocap.look import Look
from quasirigid.serving import ServerThread, netloc
from quasirigid.webxr.pages import named_locally

LISTENERS = 32
"""At the same time, at most."""
LONGEST = 1024
"""Bytes that a listener may send at once; what it says is not heard."""


class WebsocketFeedback:
    """Tells looks of a session to whoever listens, ``rate`` times per second of simulated time.

    It runs in a thread of its own: a listener that is slow misses looks, the session and other listeners do not wait for it.
    """

    def __init__(self, text: str, *, rate: float = RATE) -> None:
        """``text`` is ``ws:PORT``, for listeners of this machine, or ``ws:HOST:PORT`` with an address of this machine.

        Raises ``InvalidValueError``, or ``NetworkError`` for a port in use.
        """
        self._raster = Raster(rate)
        kind, _, rest = text.partition(":")
        host, _, port = rest.rpartition(":") if ":" in rest else ("127.0.0.1", "", rest)
        if kind != "ws" or not host or not is_port(port):
            raise InvalidValueError("--feedback", TARGETS, text, "ws:9001 serves ws://127.0.0.1:9001")
        self._sink = JsonSink()
        self._newest = ""
        self._listeners: dict[ServerConnection, asyncio.Event] = {}
        self.told = 0
        """Looks that were offered to the listeners."""
        self.failed = 0
        """Looks that could not be."""
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

    def __call__(self, look: Look) -> None:
        """Tell it if it is time."""
        if not self._raster.due(look.time):
            return
        try:
            self._newest = self._sink.encode(look).decode()
        except ValueError:  # a force that is no number cannot be written
            self.failed += 1
            return
        self.told += 1
        self._server.call(self._wake)

    def story(self) -> str:
        """What became of it."""
        return f"{self.told} looks on ws://{netloc(*self.address)}, {self.listeners} listeners"

    def close(self) -> None:
        """End all connections and close the port."""
        self._server.close()

    # The thread.

    def _wake(self) -> None:
        for news in self._listeners.values():
            news.set()

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """``None`` for who may listen. Programs may, and pages of this machine: not just any page that its user visits."""
        origin = request.headers.get("Origin")
        if origin is not None and not named_locally(urlsplit(origin).netloc):
            return connection.respond(403, "only programs and pages of this machine may listen\n")
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

    async def _send(self, connection: ServerConnection, news: asyncio.Event) -> None:
        known: str | None = None
        while True:
            await news.wait()
            news.clear()
            newest = self._newest
            if newest is not known:  # it may have been sent while the news of it were on their way
                known = newest
                await connection.send(newest)
