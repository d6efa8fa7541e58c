"""Websocket servers that run in a thread of their own beside a session."""

from __future__ import annotations

import asyncio
import errno
import logging
import socket
import threading
from collections.abc import Awaitable, Callable
from concurrent.futures import Future
from contextlib import suppress
from typing import Any

from websockets.asyncio.server import ServerConnection, serve

from quasirigid.errors import InvalidValueError, NetworkError, QuasirigidError


class ServerThread:
    """A websocket server in a thread of its own: open once it is made, until ``close``. Methods may be called from any thread."""

    def __init__(self, handler: Callable[[ServerConnection], Awaitable[None]], host: str, port: int, *, name: str, **options: Any) -> None:
        """Have ``handler`` talk to whoever connects to ``port`` (0: any free one) of the address ``host``. ``name`` is that of the thread.

        ``options`` as of ``websockets.asyncio.server.serve``. Raises ``InvalidValueError`` for an address that is not one of this machine,
        ``NetworkError`` for a port that cannot be had.
        """
        self._loop = asyncio.new_event_loop()
        self._ended = asyncio.Event()
        quiet = logging.getLogger(f"quasirigid.{name}")
        quiet.setLevel(logging.CRITICAL)  # who goes away in the middle of a message is no news
        usual = {"compression": None, "logger": quiet, "open_timeout": 10.0, "close_timeout": 1.0}
        opened: Future[tuple[str, int]] = Future()

        async def served() -> None:
            async with serve(handler, host, port, **(usual | options)) as server:
                bound = server.sockets[0].getsockname()
                opened.set_result((str(bound[0]), int(bound[1])))
                await self._ended.wait()

        def run() -> None:
            asyncio.set_event_loop(self._loop)
            try:
                self._loop.run_until_complete(served())
            except BaseException as error:
                # Whatever it is, who waits for the address must hear of it.
                if opened.done():
                    raise
                opened.set_exception(error)
            finally:
                self._loop.close()

        self._thread = threading.Thread(target=run, name=f"quasirigid-{name}", daemon=True)
        self._thread.start()
        try:
            self.address = opened.result()
            """Address and port that it listens on."""
        except (OSError, ValueError) as error:
            self._thread.join()
            raise _refused(error, host, port) from None

    @property
    def alive(self) -> bool:
        """Whether it still serves."""
        return self._thread.is_alive()

    def call(self, function: Callable[[], object]) -> None:
        """Have its thread call this soon; nothing happens if the server has ended."""
        with suppress(RuntimeError):  # the loop is closed; to ask before would be a race
            self._loop.call_soon_threadsafe(function)

    def close(self) -> None:
        """End all connections and close the port."""
        if self.alive:
            self.call(self._ended.set)
            self._thread.join(timeout=10.0)


def netloc(host: str, port: int) -> str:
    """Address and port as they are written in a URL: IPv6 has brackets."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def _refused(error: OSError | ValueError, host: str, port: int) -> QuasirigidError:
    """The error if the server could not be opened."""
    # Python looks a name up (gaierror; UnicodeError for one that cannot be written in an address), and has no number for an address of no
    # interface.
    if isinstance(error, (ValueError, socket.gaierror)) or error.errno in (None, errno.EADDRNOTAVAIL):
        return InvalidValueError("address to listen on", "one of this machine's", host, "127.0.0.1, or 0.0.0.0 for all")
    found = "one in use" if error.errno == errno.EADDRINUSE else error.strerror or str(error)
    return NetworkError(f"port {port} of {host}", "one that is free", found, "choose another port")
