"""The static files of the page, and where it can be reached."""

from __future__ import annotations

import socket
from importlib.resources import files

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


def page_files() -> dict[str, tuple[str, bytes]]:
    """Kind and content of every file by its path in the address. Nothing else is ever served."""
    found = {
        f"/{file.name}": (KINDS[file.name.rsplit(".", 1)[-1]], file.read_bytes()) for file in (files(__package__) / "static").iterdir()
    }
    found["/"] = found["/index.html"]
    return found


def own_address() -> str:
    """The address under which others in the network reach this machine, or its name if it is in none. Nothing is sent."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as way:
        try:
            way.connect(("192.0.2.1", 9))  # of no machine (RFC 5737): which way would it go?
        except OSError:
            return socket.gethostname()
        return str(way.getsockname()[0])
