"""What a person does on the page of the live view, and sees there."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import browser as browser_tools
import numpy as np
from browser import canvas_box, wait_until

from quasirigid.live.server import LiveView
from quasirigid.live.session import Frame
from quasirigid.rotation import rotate
from quasirigid.scene.model import SceneModel, SceneState

SHOTS = os.environ.get("QUASIRIGID_SCREENSHOTS")
"""A directory: pictures of the page are left there."""


def frame(live: LiveView) -> Frame:
    return live.session.newest()[1]


def height(live: LiveView) -> float:
    return float(frame(live).state.positions[body(live, "object")][2])


def body(live: LiveView, kind: str) -> int:
    return next(i for i, b in enumerate(frame(live).model.bodies) if b.kind == kind)


def press(page: Any, name: str) -> None:
    page.get_by_role("button", name=name, exact=True).click()


def slider_field(page: Any, label: str) -> Any:
    row = page.locator(f"label:has-text('{label}')").first.locator("xpath=ancestor::*[.//input][1]")
    return row.locator("input[type=text]").first


def enter(page: Any, label: str, value: float) -> None:
    """Types a figure into the field of a slider."""
    field = slider_field(page, label)
    field.fill(str(value))
    field.press("Enter")


def on_screen(live: LiveView, page: Any, point: np.ndarray[Any, Any]) -> tuple[float, float]:
    """Where a point of the world is in the page, px."""
    x, y = browser_tools.on_screen(camera_of(live.server), page, point[None])[0]
    return float(x), float(y)


def camera_of(server: Any) -> Any:
    wait_until(server.get_clients, "the page has connected")
    return next(iter(server.get_clients().values())).camera


def bodies_on_screen(server: Any, page: Any, model: SceneModel, state: SceneState) -> np.ndarray[Any, Any]:
    """Where all bodies but supports are in the page, (n, 2) px."""
    points = [
        state.positions[i] + rotate(state.quaternions[i], body.points[::20])
        for i, body in enumerate(model.bodies)
        if body.kind != "support"
    ]
    return browser_tools.on_screen(camera_of(server), page, np.concatenate(points))


def assert_inside(what: Any, room: tuple[float, float, float, float], *, scroll: bool = False) -> None:
    """Asserts that an element comes to lie in a part of the page: left, upper, right, lower, px.

    A fold that opens and a picture that loads move what is below them, so it is looked at (and scrolled to, with ``scroll``) until it rests
    there.
    """
    corners = (0.0, 0.0, 0.0, 0.0)

    def inside() -> bool:
        nonlocal corners
        if scroll:
            what.scroll_into_view_if_needed()
        box = what.bounding_box()
        corners = (box["x"], box["y"], box["x"] + box["width"], box["y"] + box["height"])
        return max(room[0] - corners[0], room[1] - corners[1], corners[2] - room[2], corners[3] - room[3]) <= 1.0

    wait_until(inside, lambda: f"{what} at {corners} px is inside {room}")


def is_in_sight(places: np.ndarray[Any, Any], page: Any, lowest: float) -> bool:
    """Whether ``places`` (n, 2) px are in the canvas, and above ``lowest`` px."""
    box = canvas_box(page)
    inside = (places[:, 0] >= box["x"]) & (places[:, 0] <= box["x"] + box["width"]) & (places[:, 1] >= box["y"]) & (places[:, 1] <= lowest)
    return bool(inside.all())


def drag(page: Any, start: tuple[float, float], end: tuple[float, float], *, pause: float) -> None:
    """Drags, with a ``pause`` (s) on arrival and before letting go."""
    page.mouse.move(start[0] - 2, start[1])
    page.mouse.move(*start)
    page.wait_for_timeout(1e3 * pause)
    page.mouse.down()
    for share in np.linspace(0.1, 1.0, 8):
        page.mouse.move(*(a + share * (b - a) for a, b in zip(start, end, strict=True)))
        page.wait_for_timeout(100)
    page.wait_for_timeout(1e3 * pause)
    page.mouse.up()


def keep(page: Any, name: str) -> None:
    if SHOTS:
        page.screenshot(path=str(Path(SHOTS) / f"{name}.png"))


def hold(live: LiveView, page: Any) -> None:
    """Lets the hand take the box and lift it."""
    press(page, "Run")
    wait_until(lambda: frame(live).state.phase == "holding", "the grip holds")
    press(page, "Lift")
    wait_until(lambda: height(live) > 0.08, "the box is lifted")


def colours_of_the_hand(image: np.ndarray[Any, Any]) -> int:
    """Pixels as blue as the thumb's joints."""
    return int((image[..., 2] - image[..., 0] > 0.25).sum())


def figure_of(page: Any, label: str) -> str:
    return str(slider_field(page, label).input_value())
