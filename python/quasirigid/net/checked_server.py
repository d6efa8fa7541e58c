"""viser's server, but for requests that ``quasirigid.net.access`` refuses: page, files and websocket (and with it uploads)."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import viser
import websockets
import websockets.asyncio.server
from viser.infra import _infra
from websockets.asyncio.server import ServerConnection, serve
from websockets.http11 import Request, Response

from quasirigid.net.access import Access, opens_socket


def checked_server(access: Access, host: str, port: int, label: str) -> viser.ViserServer:
    """A server on a free ``port`` of ``host``. Call from one thread at a time.

    viser 1.1 has no hook for requests (pyproject.toml holds it below 1.2), and the library that it serves with has one: while the server
    is opened, viser finds there a ``serve`` that puts our check before its own answers.
    """
    checked: list[int] = []

    def serve_checked(handler: Any, bound: str, at: int, *, process_request: Any, **options: Any) -> serve:
        if bound != host or at < port:  # somebody else's, opened at the same moment
            return serve(handler, bound, at, process_request=process_request, **options)
        checked.append(at)

        def answer(connection: ServerConnection, request: Request) -> Response | None:
            why = access.refusal(connection, request, opens_socket=opens_socket(request))
            response: Response | None = process_request(connection, request) if why is None else connection.respond(403, why)
            if response is not None:
                for name, value in access.headers().items():
                    response.headers.setdefault(name, value)
            return response

        async def talk(connection: ServerConnection) -> None:
            # viser would say so on standard output, which carries results: a page that was left open and is of another version asks again
            # and again.
            if connection.subprotocol != f"viser-v{viser.__version__}":
                await connection.close(1002, f"Version mismatch. Client: {connection.subprotocol}, Server: {viser.__version__}")
                return
            await handler(connection)

        return serve(talk, bound, at, process_request=answer, **options)

    names = SimpleNamespace(**{**vars(websockets.asyncio.server), "serve": serve_checked})
    theirs: Any = _infra
    before = theirs.websockets
    theirs.websockets = SimpleNamespace(
        asyncio=SimpleNamespace(server=names), datastructures=websockets.datastructures, exceptions=websockets.exceptions
    )
    try:
        server = viser.ViserServer(host=host, port=port, label=label, verbose=False)
    finally:
        theirs.websockets = before
    if not checked:
        server.stop()
        raise RuntimeError(f"viser {viser.__version__} opens its server in another way: no request would be checked")
    return server


__all__ = ["checked_server"]
