"""Who may talk to a server of ours: the names that it answers to, and the pages that may use it.

A browser lets every page in the world send requests to this machine, and opens a websocket for it without asking anybody. Two headers that
a page cannot forge tell what is going on: ``Host`` is the name that the browser looked up, ``Origin`` is where the page that asks came
from. A foreign name in ``Host`` that leads here is an attack (DNS rebinding): the page would count as one of ours. Source: RFC 6454,
section 7, and RFC 6455, section 10.2.
"""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from urllib.parse import SplitResult, urlsplit

from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request

from quasirigid.errors import InvalidValueError

LOCAL = ("127.0.0.1", "localhost", "::1")
"""Names of this machine that no other machine can use for it."""
_PORTS = {"http": 80, "https": 443}
_HEADERS = {"Cross-Origin-Resource-Policy": "same-origin", "X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer"}


@dataclass(frozen=True)
class Origin:
    """Where a page came from."""

    scheme: str
    host: str
    port: int

    def __str__(self) -> str:
        return f"{self.scheme}://{f'[{self.host}]' if ':' in self.host else self.host}:{self.port}"


class Access:
    """The rule of one server. ``refusal`` asks it about a request."""

    def __init__(
        self,
        bound: str,
        allow_origins: Sequence[str] = (),
        *,
        tls: bool = False,
        programs: bool = False,
        local_pages: bool = False,
    ) -> None:
        """The server listens on the address or name ``bound``. ``allow_origins`` are pages that may use it beside its own, such as
        ``https://hub.example.org``; it answers to their names, too.

        ``tls``: the browser checks the name by the certificate, so any name will do. ``programs``: a socket may be opened without an
        ``Origin``. Every browser sends one, so whoever sends none is a program: let in where data are meant for programs, and not where
        only our own page has something to say. ``local_pages``: every page of this machine may use the sockets, also one that another
        server serves.

        Raises ``InvalidValueError`` for an origin that is none.
        """
        self.allowed = _read_all(allow_origins)
        self._any_name, self._programs, self._local_pages = tls, programs, local_pages
        names = {*LOCAL, bound.lower().strip("[]"), *(origin.host for origin in self.allowed)}
        if not is_local(bound):
            own = socket.gethostname().lower()
            names |= {own, f"{own}.local"}
        self._names = names - {""}

    def refusal(self, connection: ServerConnection, request: Request, *, opens_socket: bool) -> str | None:
        """Why the request is refused, for the answer with status 403; ``None`` if it is let in."""
        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        host = _split(f"//{hosts[0]}") if len(hosts) == 1 else None
        if host is None or not (self._any_name or host.hostname in self._names or host.hostname == _address_of(connection)):
            return "this server answers to localhost and to the addresses of its machine; --allow-origin URL adds a name\n"
        if not origins:
            # To ask for a page is no use of it, and a browser that follows a link or an address sends no origin.
            return "only the page of this server may connect\n" if opens_socket and not self._programs else None
        origin = _read(origins[0]) if len(origins) == 1 else None
        if origin is not None:
            ours = (origin.host, origin.port) == (host.hostname, host.port or _PORTS[origin.scheme])
            if ours or origin in self.allowed or (self._local_pages and origin.host in LOCAL):
                return None
        return "only pages of this server may connect; --allow-origin URL lets in those of another\n"

    def headers(self) -> dict[str, str]:
        """Of every answer: other pages may neither show a page of this server in a frame, where clicks could be stolen, nor
        load its parts.
        """
        ancestors = " ".join(["'self'", *(str(origin) for origin in self.allowed)])
        return {**_HEADERS, "Content-Security-Policy": f"frame-ancestors {ancestors}"}


def is_local(bound: str) -> bool:
    """Whether a server on this address or name can be reached from this machine alone."""
    try:
        return ipaddress.ip_address(bound.strip("[]")).is_loopback
    except ValueError:
        return bound.lower() == "localhost"


def warn_if_open(bound: str, can: str, say: Callable[[str], object]) -> bool:
    """Has ``say`` warn of a socket on the address ``bound`` that the network can reach: whoever does ``can`` do this. Returns whether it is
    one.
    """
    if is_local(bound):
        return False
    say(f"open to the network ({bound}): whoever reaches this port can {can}")
    return True


def opens_socket(request: Request) -> bool:
    """Whether a websocket is asked for, and not a page."""
    return any("websocket" in value.lower() for value in request.headers.get_all("Upgrade"))


def _read_all(texts: Iterable[str]) -> tuple[Origin, ...]:
    if isinstance(texts, str):
        raise InvalidValueError("allow_origins", "a list of origins", repr(texts), f"write [{texts!r}]")
    found = []
    for text in texts:
        origin = _read(str(text).rstrip("/"))
        if origin is None:
            hint = "name each one as the browser's address bar begins, such as http://192.168.0.7:8080"
            raise InvalidValueError("--allow-origin", "http://NAME[:PORT] or https://NAME[:PORT]", text, hint)
        found.append(origin)
    return tuple(found)


def _read(text: str) -> Origin | None:
    """An origin as browsers write it; ``None`` for anything else, such as ``null``, or for a page that is no page of the web."""
    parts = _split(text)
    if parts is None or parts.scheme not in _PORTS or parts.path or parts.query or parts.fragment or parts.netloc.endswith(":"):
        return None
    return Origin(parts.scheme, str(parts.hostname), parts.port or _PORTS[parts.scheme])


def _split(text: str) -> SplitResult | None:
    """The parts of a URL, unless it names no host or has more to it than a host and a port."""
    try:
        parts = urlsplit(text)
        named = parts.hostname and parts.port != 0 and "@" not in parts.netloc and not any(sign in text for sign in "*;, \\")
    except ValueError:
        return None
    return parts if named else None


def _address_of(connection: ServerConnection) -> str:
    """The address of this machine that the browser connected to: one of our own, whichever way the request came in."""
    bound = connection.local_address
    if not isinstance(bound, tuple):
        return ""
    address = ipaddress.ip_address(str(bound[0]).partition("%")[0])
    return str(getattr(address, "ipv4_mapped", None) or address)


__all__ = ["LOCAL", "Access", "Origin", "is_local", "opens_socket", "warn_if_open"]
