"""The static files of the page, and who may ask for them."""

from __future__ import annotations

import ipaddress
import socket
from importlib.resources import files
from urllib.parse import urlsplit

KINDS = {
    "html": "text/html; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "LICENSE": "text/plain",
}
HEADERS = {
    # Nothing from outside, and no framing by other pages.
    "Content-Security-Policy": "default-src 'self'; connect-src 'self' ws: wss:; img-src 'self' data: blob:; frame-ancestors 'none'",
    "Permissions-Policy": "xr-spatial-tracking=(self)",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-cache",
    "Referrer-Policy": "no-referrer",
}
LOCAL = ("127.0.0.1", "localhost", "::1")


def page_files() -> dict[str, tuple[str, bytes]]:
    """Kind and content of every file by its path in the address. Nothing else is ever served."""
    found = {
        f"/{file.name}": (KINDS[file.name.rsplit(".", 1)[-1]], file.read_bytes()) for file in (files(__package__) / "static").iterdir()
    }
    found["/"] = found["/index.html"]
    return found


def same_origin(host: str | None, origin: str | None) -> bool:
    """Whether a websocket was opened by a page of this server: otherwise any page in the world could drive the hand of who visits it."""
    return bool(host) and origin is not None and urlsplit(origin).netloc.lower() == str(host).lower()


def named_locally(host: str | None) -> bool:
    """Whether the browser was told this machine's own name: a foreign name that resolves to 127.0.0.1 is an attack (DNS rebinding)."""
    return _name_in(host) in LOCAL


def named_as_ours(host: str | None, bound: str) -> bool:
    """Whether the browser was told an address, the name of this machine or ``bound``, and no foreign name that leads here (DNS rebinding)."""
    name, own = _name_in(host), socket.gethostname().lower()
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return name in (*LOCAL, bound.lower(), own, f"{own}.local")
    return True


def _name_in(host: str | None) -> str:
    """The name or address in the header ``Host``, in small letters; empty for none."""
    try:
        return urlsplit(f"//{host or ''}").hostname or ""
    except ValueError:
        return ""


def own_address() -> str:
    """The address under which others in the network reach this machine, or its name if it is in none. Nothing is sent."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as way:
        try:
            way.connect(("192.0.2.1", 9))  # of no machine (RFC 5737): which way would it go?
        except OSError:
            return socket.gethostname()
        return str(way.getsockname()[0])
