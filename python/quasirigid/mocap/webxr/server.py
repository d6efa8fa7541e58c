"""The server: hands the page out, takes hands in, sends the scene. It runs in a thread of its own."""

from __future__ import annotations

import asyncio
import json
import ssl
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from quasirigid._quasirigid import HandFrame
from quasirigid.errors import InvalidValueError, PacketError
from quasirigid.mocap.hand_presence import other_side
from quasirigid.mocap.webxr.joints import JOINTS, Side, hand_frame
from quasirigid.mocap.webxr.messages import HANDS_SIZE, TEXT_LIMIT, Recentre, Reset, read_hands, read_text
from quasirigid.mocap.webxr.pages import HEADERS, own_address, page_files
from quasirigid.mocap.webxr.placement import Placement
from quasirigid.mocap.webxr.wire import SceneWire
from quasirigid.net.access import LOCAL, Access
from quasirigid.net.serving import ServerThread, netloc
from quasirigid.scene.model import SceneModel, SceneState

PORT = 8082
IDLE = 60.0
"""For so long a session waits for hands that have gone: a headset is taken off, a page loaded again, s."""
STATES = 40.0
"""States sent per second, at most."""
CLIENTS = 8
"""Pages that may be open at the same time."""
SILENT = 1.0
"""Another page may take over from one that has sent no hands for so long, s: a headset that was taken off, or that fell out of the network.
"""
ASKED_EVERY, ANSWER_WITHIN = 4.0, 6.0
"""How often a page is asked whether it is still there, and how long it may take, s."""
WAITING = 2_000
"""Frames that wait to be taken, at most; the oldest go first."""
LOST = np.full((len(JOINTS), 8), np.nan)


class XrServer:
    """A source of hands (``quasirigid.mocap.source.Source``) and a viewer. Methods may be called from any thread.

    The first page that sends hands is the one that is listened to, until it goes or falls silent. Poses come out in the world, by the
    placement.
    """

    real_time = True

    def __init__(
        self,
        port: int = PORT,
        *,
        host: str = "127.0.0.1",
        side: Side = "right",
        placement: Placement | None = None,
        certificate: Path | None = None,
        key: Path | None = None,
        allow_origins: Sequence[str] = (),
    ) -> None:
        """Listen on ``port`` (0: any free one) of the address ``host``, with TLS if there is a ``certificate`` (PEM; ``key`` if it is not
        in there).

        ``allow_origins`` as of ``quasirigid.net.access.Access``: pages that may use it beside its own.

        Raises ``InvalidValueError`` for a port, side, certificate or origin that is none, ``NetworkError`` for a port in use.
        """
        if side not in ("left", "right"):
            raise InvalidValueError("hand", "left or right", side, "choose one of them")
        if not 0 <= port <= 65535:
            raise InvalidValueError("port", "0 to 65535", port, f"{PORT} is the default")
        self._side: Side = side
        self._placement = placement or Placement()
        self._host, self._files = host, page_files()
        self._begin = time.monotonic()
        self._lock = threading.Lock()
        self._frames: list[HandFrame] = []
        self._counts = dict.fromkeys(("packets", "malformed", "refused", "lost", "recentred", "resets", "connections"), 0)
        self._clients: dict[ServerConnection, asyncio.Event] = {}
        self._writer: ServerConnection | None = None
        self._heard = float("-inf")
        self._standing: dict[ServerConnection, bool] = {}
        self._reset = threading.Event()
        self._shift = self._last = 0.0
        self._wire: SceneWire | None = None
        self._news: tuple[SceneWire, SceneState] | None = None
        self._model: bytes | None = None
        self._state: bytes | None = None
        self._drawn = float("-inf")
        self._tls = None if certificate is None else _context(certificate, key)
        self._access = Access(host, allow_origins, tls=self._tls is not None)
        self._server = ServerThread(
            self._talk,
            host,
            port,
            name="webxr",
            process_request=self._answer,
            max_size=max(HANDS_SIZE, TEXT_LIMIT),
            max_queue=64,
            ssl=self._tls,
            ping_interval=ASKED_EVERY,
            ping_timeout=ANSWER_WITHIN,
        )
        self.address = self._server.address
        self.when_silent = f"no page sends hands: open {self.url} in the headset's browser and press Enter VR"

    # What a session asks for: a source of hands.

    def now(self) -> float:
        """Seconds since it was opened."""
        return time.monotonic() - self._begin

    def wait_until(self, moment: float) -> None:
        """Sleep until this moment."""
        left = moment - self.now()
        if left > 0.0:
            time.sleep(left)

    def take(self) -> Sequence[HandFrame]:
        """The frames of the chosen hand that have arrived since the last call, world. Where only the other hand was seen, its frames come,
        too.
        """
        with self._lock:
            frames, self._frames = self._frames, []
        return frames

    def ended(self) -> bool:
        """Never for certain."""
        return False

    def statistics(self) -> dict[str, Any]:
        """Messages: ``packets`` with hands, ``malformed`` ones, those ``refused`` since another page is listened to, ``lost`` for want of
        takers.
        """
        with self._lock:
            return dict(self._counts)

    def close(self) -> None:
        """Close all connections and the port."""
        self._server.close()

    def __enter__(self) -> XrServer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # What a session sends: a viewer.

    @property
    def url(self) -> str:
        """Address of the page."""
        host, port = self.address
        shown = "localhost" if host in LOCAL else own_address() if host in ("0.0.0.0", "::") else host
        return f"{'http' if self._tls is None else 'https'}://{netloc(shown, port)}"

    @property
    def placement(self) -> Placement:
        """Where the world stands in the room now."""
        with self._lock:
            return self._placement

    def begin(self, model: SceneModel) -> None:
        """Show this scene from now on."""
        wire = SceneWire(model)
        message = wire.model_message()
        with self._lock:
            self._wire, self._model, self._state, self._news, self._drawn = wire, message, None, None, float("-inf")
        self._wake()

    def wants_state(self) -> bool:
        """Whether a page is connected and the last state is old enough."""
        return bool(self._clients) and time.monotonic() - self._drawn >= 1.0 / STATES

    def draw(self, state: SceneState) -> None:
        """Show this state; a page that is slow gets the newest one when it is ready."""
        with self._lock:
            if self._wire is not None:
                self._news, self._drawn = (self._wire, state), time.monotonic()
        self._wake()

    def reset_asked(self) -> bool:
        """Whether a page has asked for the object to be put back since the last call."""
        was = self._reset.is_set()
        self._reset.clear()
        return was

    def _wake(self) -> None:
        def wake() -> None:
            for news in self._clients.values():
                news.set()

        self._server.call(wake)

    # The thread.

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """A page for who asks for one, ``None`` for a websocket that may be opened."""
        path = request.path.split("?")[0]
        why = self._access.refusal(connection, request, opens_socket=path == "/socket")
        if why is not None:
            return _response(403, "Forbidden", "text/plain", why.encode())
        if path != "/socket":
            kind, content = self._files.get(path, ("text/plain", b""))
            return _response(200, "OK", kind, content) if content else _response(404, "Not Found", "text/plain", b"no such page\n")
        if len(self._clients) >= CLIENTS:
            return _response(503, "Service Unavailable", "text/plain", b"too many pages are open\n")
        return None

    async def _talk(self, connection: ServerConnection) -> None:
        news = asyncio.Event()
        news.set()
        self._clients[connection] = news
        with self._lock:
            self._counts["connections"] += 1
        sender = asyncio.create_task(self._send(connection, news))
        try:
            async for message in connection:
                await self._hear(connection, message)
        except ConnectionClosed:
            pass
        finally:
            sender.cancel()
            del self._clients[connection]
            self._standing.pop(connection, None)
            if self._writer is connection:
                self._writer = None
                self._frame(LOST, self._last + 1e-3)

    async def _hear(self, connection: ServerConnection, message: str | bytes) -> None:
        try:
            if isinstance(message, str):
                if len(message) > TEXT_LIMIT:
                    raise PacketError("text of a page", f"{TEXT_LIMIT} characters", len(message), "is it our page?")
                self._obey(connection, read_text(message))
                return
            moment, hands = read_hands(message)
        except (PacketError, InvalidValueError):
            self._count("malformed")
            return
        now = self.now()
        if self._writer not in (None, connection) and now - self._heard > SILENT:
            self._stand(self._writer, yours=False)
            self._writer = None
            self._frame(LOST, self._last + 1e-3)
        if self._writer is None:
            # The clock of another page began elsewhere; the tracker's must go on, and come after the frame without a hand.
            self._writer, self._shift = connection, max(now, self._last + 2e-3) - moment
        self._stand(connection, yours=self._writer is connection)
        if self._writer is not connection:
            self._count("refused")
            return
        self._count("packets")
        self._heard, self._last = now, moment + self._shift
        self._frame(hands.get(self._side, LOST), self._last)
        other = other_side(self._side)
        if self._side not in hands and other in hands:
            self._frame(hands[other], self._last, other)

    def _obey(self, connection: ServerConnection, wish: Recentre | Reset) -> None:
        """What a page asks for is done if it is the one that is listened to, or if no page is."""
        if self._writer not in (None, connection):
            self._count("refused")
        elif isinstance(wish, Recentre):
            self._recentre(Placement.before(wish.eyes, wish.forward))
        else:
            self._reset.set()
            self._count("resets")

    def _stand(self, connection: ServerConnection | None, *, yours: bool) -> None:
        """Have a page informed whether its hands are listened to, if it does not know."""
        if connection in self._clients and self._standing.get(connection) is not yours:
            self._standing[connection] = yours
            self._clients[connection].set()

    def _count(self, what: str) -> None:
        with self._lock:
            self._counts[what] += 1

    def _frame(self, joints: Any, moment: float, side: Side | None = None) -> None:
        frame = hand_frame(side or self._side, joints, time=moment, arrival=self.now())
        with self._lock:
            self._frames.append(frame.transformed(self._placement.calibration()))
            if len(self._frames) > WAITING:
                del self._frames[0]
                self._counts["lost"] += 1

    def _recentre(self, placement: Placement) -> None:
        with self._lock:
            self._placement = placement
            self._counts["recentred"] += 1
        # The hand jumps with respect to the world. A frame without it makes the filter glide over.
        if self._writer is not None:
            self._frame(LOST, self._last + 1e-6)
        for news in self._clients.values():
            news.set()

    def _write(self) -> None:
        """Make a message of the newest state: once for all pages, and in this thread, while the session's goes on with its step."""
        with self._lock:
            news, self._news = self._news, None
        if news is None:
            return
        wire, state = news
        model = wire.model_message() if wire.outgrown(state) else None
        message = wire.state_message(state)
        with self._lock:
            if wire is self._wire:
                self._model, self._state = model or self._model, message

    async def _send(self, connection: ServerConnection, news: asyncio.Event) -> None:
        """Whatever this page does not know yet, the newest of each kind."""
        known: list[object] = [None] * 4
        await connection.send(json.dumps({"type": "hello", "hand": self._side, "size": HANDS_SIZE}))
        while True:
            await news.wait()
            news.clear()
            self._write()
            with self._lock:
                standing = self._standing.get(connection)
                newest: list[Any] = [self._placement, self._model, self._state, standing]
            for i, item in enumerate(newest):
                if item is not known[i] and item is not None:
                    await connection.send(_written(item))
                known[i] = item


def _written(item: Placement | bytes | bool) -> str | bytes:
    if isinstance(item, Placement):
        return json.dumps(item.message())
    return json.dumps({"type": "writer", "yours": item}) if isinstance(item, bool) else item


def _response(status: int, phrase: str, kind: str, content: bytes) -> Response:
    headers = Headers(HEADERS)
    headers["Content-Type"], headers["Content-Length"], headers["Connection"] = kind, str(len(content)), "close"
    return Response(status, phrase, headers, content)


def _context(certificate: Path, key: Path | None) -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        context.load_cert_chain(certificate, key)
    except (OSError, ssl.SSLError) as error:
        hint = "openssl req -x509 -newkey rsa:2048 -nodes -days 365 -subj /CN=NAME -keyout key.pem -out certificate.pem makes one"
        raise InvalidValueError("certificate", "a PEM file with a certificate and its key", f"{certificate}: {error}", hint) from None
    return context
