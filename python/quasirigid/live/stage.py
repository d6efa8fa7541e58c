"""The page around a scene: server, ground, light, camera, look of the panel."""

from __future__ import annotations

import atexit
import contextlib
import socket
import threading
import weakref
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import rich
import viser

from quasirigid.errors import InvalidValueError
from quasirigid.live.page_style import STYLE
from quasirigid.live.unlit import unlit_glb
from quasirigid.net.access import Access
from quasirigid.net.checked_server import checked_server

_one_at_a_time = threading.Lock()
PORT = 8080
TRIES = 50
"""Ports that are tried, one after another, when the first is in use."""
GRID, SECTION = 0.02, 0.1
"""Width of the ground grid's cells, and of sections with stronger lines, m."""
EXTENT = 0.3
"""How far the grid goes each way, m."""
CELL_COLOUR, SECTION_COLOUR = np.array([0.50, 0.52, 0.56]), np.array([0.22, 0.24, 0.28])
"""Of the lines, linear light."""
EVERYWHERE = ("0.0.0.0", "::", "")
"""Hosts that stand for all addresses of this machine."""


def page_url(host: str, port: int) -> str:
    """Address of a page that is served on ``host``, for a browser on this machine where it can be one."""
    shown = "localhost" if host in ("127.0.0.1", "localhost", *EVERYWHERE) else f"[{host}]" if ":" in host else host
    return f"http://{shown}:{port}"


def free_port(host: str, port: int) -> int:
    """``port``, or the next one on which nobody listens. Raises ``InvalidValueError`` if all are taken, ``host`` is not ours, or the
    port is reserved for others.
    """
    if not 0 < port < 65536:
        raise InvalidValueError("port", "1 to 65535", port, f"{PORT} is the usual one")
    for candidate in range(port, min(port + TRIES, 65536)):
        try:
            with socket.create_server((host, candidate), family=socket.AF_INET6 if ":" in host else socket.AF_INET):
                return candidate
        except (socket.gaierror, OverflowError):
            raise InvalidValueError("host", "an address of this machine", host, "127.0.0.1 serves this machine alone") from None
        except PermissionError:
            raise InvalidValueError("port", "one that you may open", candidate, f"those below 1024 are reserved; {PORT} is usual") from None
        except OSError as error:
            if error.errno in (98, 48, 10048):  # in use (Linux, macOS, Windows)
                continue
            raise InvalidValueError("host", "an address of this machine", host, "127.0.0.1 serves this machine alone") from None
    raise InvalidValueError("port", f"a free one from {port} to {port + TRIES - 1}", "all in use", "choose another with --port")


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Standard output carries results: what viser prints there, with rich's own console, is dropped; the address is said on standard error.

    What other threads ``print`` meanwhile is theirs.
    """
    console = rich.get_console()
    with _one_at_a_time:
        before, console.quiet = console.quiet, True
        try:
            yield
        finally:
            console.quiet = before


def close_server(server: viser.ViserServer) -> None:
    """Ends a server of ``open_server``."""
    with _quiet():
        server.stop()
        # It waits for a second; on a busy machine the thread says that it has ended when nobody is quiet any more.
        ending: Any = server._websock_server
        if ending._server_thread is not None:
            ending._server_thread.join(timeout=10.0)


def _close_at_exit(server: weakref.ref[viser.ViserServer]) -> None:
    there = server()
    if there is not None:
        close_server(there)


def open_server(host: str, port: int, label: str, allow_origins: Sequence[str] = ()) -> viser.ViserServer:
    """A server on a free port at or after ``port``, with the page's look set. ``allow_origins`` as of ``quasirigid.net.access.Access``."""
    access = Access(host, allow_origins)
    with _quiet():
        server = checked_server(access, host, free_port(host, port), label)
    # viser ends it at exit, too, and says so on standard output: where a page is interrupted while it is made, nobody else does.
    atexit.register(_close_at_exit, weakref.ref(server))
    server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(0, 114, 178))
    server.gui.main_panel.dock_right()
    server.gui.add_html(STYLE)
    server.scene.set_up_direction("+z")
    server.scene.configure_default_lights(enabled=False)
    server.scene.configure_environment_map(None)
    # A key light from above left, and an ambient one that is sky above and warm floor below. Every light more costs a page without a
    # graphics card a frame a second.
    server.scene.add_light_hemisphere("/light/sky", sky_color=(255, 255, 255), ground_color=(176, 168, 158), intensity=1.8)
    server.scene.add_light_directional("/light/key", intensity=2.0, position=(0.6, -0.8, 1.2))
    return server


def add_ground(server: viser.ViserServer, floor: float) -> None:
    """The ground grid at height ``floor``, m: cells of 20 mm, sections of 100 mm, fading with the distance from the middle."""
    ticks = np.round(np.arange(-EXTENT, EXTENT + 0.5 * GRID, GRID), 9)
    knots = np.linspace(-EXTENT, EXTENT, 3)
    one, along = np.meshgrid(ticks, knots, indexing="ij")
    strong = np.isclose(np.round(one / SECTION) * SECTION, one)
    flat = np.zeros_like(one)
    points = np.concatenate([np.stack(axes, axis=-1).reshape(-1, 3) for axes in ((one, along, flat), (along, one, flat))])
    strong = np.concatenate([strong.ravel(), strong.ravel()])
    near = np.clip(1.2 - np.linalg.norm(points, axis=1) / EXTENT, 0.0, 1.0)
    colours = np.empty((len(points), 4), np.float32)
    colours[:, :3] = np.where(strong[:, None], SECTION_COLOUR, CELL_COLOUR)
    colours[:, 3] = near
    first = np.arange(len(points)).reshape(-1, len(knots))[:, :-1].ravel()
    lines = np.stack([first, first + 1], axis=1)
    server.scene.add_glb(
        "/ground",
        unlit_glb(points, lines, colours, see_through=True),
        cast_shadow=False,
        receive_shadow=False,
        position=(0.0, 0.0, floor + 2e-4),
    )
