"""A real browser for the tests of the view: finds Chromium, opens pages, looks at what they show."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import BytesIO
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt
import pytest
import zstandard
from PIL import Image

from quasirigid.rotation import rotate

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
NEEDED = "QUASIRIGID_BROWSER_TESTS"
"""Set to ``required``, a missing browser is an error; otherwise these tests are skipped."""
ARGUMENTS = ["--no-sandbox", "--enable-unsafe-swiftshader"]
"""Chromium as it starts for anybody on a computer without a graphics card: it draws the scene in software, and puts the page together
without one.
"""
WIDTH, HEIGHT = 1120, 640
PATIENCE = 45.0
"""Seconds that anything in the page may take on a busy machine with two cores and no GPU."""


def chromium() -> str:
    """Path of the browser: that of the environment variable ``CHROMIUM``, or one of the usual names; skips where there is none."""
    wanted = os.environ.get("CHROMIUM")
    found = (shutil.which(wanted) if wanted else None) or next(filter(None, map(shutil.which, NAMES)), None)
    if found is None:
        message = "no Chromium found: apt-get install chromium, or set CHROMIUM to its path"
        if os.environ.get(NEEDED) == "required":
            pytest.fail(message)
        pytest.skip(message)
    return found


@contextmanager
def running_browser() -> Iterator[Any]:
    """A headless browser with software rendering."""
    path = chromium()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=ARGUMENTS)
        try:
            yield browser
        finally:
            browser.close()


@contextmanager
def open_page(
    browser: Any, port: int, prepare: Callable[[Any], None] | None = None, *, size: tuple[int, int] = (WIDTH, HEIGHT)
) -> Iterator[Any]:
    """A page of ``size``, px, that is connected and shows a canvas; requests that leave this machine are refused and fail the test."""
    page = browser.new_page(viewport={"width": size[0], "height": size[1]})
    page.set_default_timeout(1e3 * PATIENCE)
    page.strangers = []

    def only_local(route: Any) -> None:
        if route.request.url.startswith((f"http://127.0.0.1:{port}", "data:", "blob:")):
            route.continue_()
        else:
            page.strangers.append(route.request.url)
            route.abort()

    page.route("**/*", only_local)
    if prepare is not None:
        prepare(page)
    page.goto(f"http://127.0.0.1:{port}")
    page.wait_for_selector("canvas", state="attached")
    # The notice that rendering is in software lies over the scene.
    page.evaluate(
        "const sheet = new CSSStyleSheet();"
        "sheet.replaceSync('[class*=Notifications-root] { display: none }');"
        "document.adoptedStyleSheets.push(sheet);"
    )
    try:
        yield page
    finally:
        page.close()


def canvas_box(page: Any) -> dict[str, float]:
    """Where the scene lies in the page: x, y, width, height, px."""
    boxes: list[dict[str, float]] = page.evaluate(
        "[...document.querySelectorAll('canvas')].map(c => { const r = c.getBoundingClientRect();"
        " return {x: r.x, y: r.y, width: r.width, height: r.height} })"
    )
    return max(boxes, key=lambda b: b["width"] * b["height"])


def on_screen(camera: Any, page: Any, points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Where ``points`` (n, 3) of the drawing are in the page with this ``camera`` of its server, (n, 2) px."""
    x, y, z = rotate(np.array(camera.wxyz) * [1, -1, -1, -1], points - camera.position).T
    box = canvas_box(page)
    scale = 0.5 * box["height"] / np.tan(0.5 * camera.fov) / z
    return np.column_stack([box["x"] + 0.5 * box["width"] + scale * x, box["y"] + 0.5 * box["height"] + scale * y])


def received(page: Any) -> list[dict[str, Any]]:
    """A list that fills with the messages that the page receives from now on, arrays as NumPy arrays. Call before ``goto``."""
    messages: list[dict[str, Any]] = []

    def unpack(frame: bytes | str) -> None:
        if isinstance(frame, str):
            return
        packed = int.from_bytes(frame[8:16], "little")
        inner = msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(frame[16 : 16 + packed]))
        buffers, at = [], 16 + packed
        for size in inner["binaryBufferLengths"]:
            at += -at % 8
            buffers.append(frame[at : at + size])
            at += size
        messages.extend(_filled(message, buffers) for message in inner["messages"])

    page.on("websocket", lambda socket: socket.on("framereceived", unpack))
    return messages


def _filled(value: Any, buffers: list[bytes]) -> Any:
    if isinstance(value, dict):
        if "__binary_index" in value:
            return np.frombuffer(buffers[value["__binary_index"]], dtype=value["dtype"])
        return {key: _filled(item, buffers) for key, item in value.items()}
    return [_filled(item, buffers) for item in value] if isinstance(value, list | tuple) else value


def picture(page: Any) -> npt.NDArray[np.float64]:
    """What the scene shows, (height, width, 3) from 0 to 1."""
    box = canvas_box(page)
    image = Image.open(BytesIO(page.screenshot(clip=box))).convert("RGB")
    return np.asarray(image, dtype=np.float64) / 255.0


def wait_until(true: Callable[[], bool], what: str | Callable[[], str], timeout: float = PATIENCE) -> None:
    """Waits until ``true()``; fails with ``what`` if it takes too long; a function that says it is asked then."""
    end = time.monotonic() + timeout
    while not true():
        if time.monotonic() > end:
            pytest.fail(f"waited {timeout:g} s for: {what() if callable(what) else what}")
        time.sleep(0.05)
