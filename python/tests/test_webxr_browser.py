"""The page for a headset, in a real browser with a synthetic device."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from browser import NEEDED, open_page, picture, running_browser, wait_until
from xr_hand import GRIP, matrices

from quasirigid.grasp_options import GraspOptions
from quasirigid.mocap.session import MocapOptions, MocapSession
from quasirigid.webxr import XrServer

HERE = Path(__file__).parent
EMULATOR = HERE.parents[1] / "tools" / "webxr" / "node_modules" / "iwer" / "build" / "iwer.min.js"
HALF_WIDTH = 0.03
LIFT = 0.10
TABLE = (0.0, 0.75, -0.4)


@pytest.fixture(scope="module")
def emulator() -> str:
    """The WebXR emulator's script."""
    if not EMULATOR.exists():
        message = "no WebXR emulator: `make webxr-tools` installs it with npm"
        if os.environ.get(NEEDED) == "required":
            pytest.fail(message)
        pytest.skip(message)
    return str(EMULATOR)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with running_browser() as running:
        yield running


class Running:
    """A session of `grasp --mocap webxr` in a thread."""

    def __init__(self) -> None:
        self.server = XrServer(0)
        self.session = MocapSession(GraspOptions(points=9_000), MocapOptions(idle=2.0), self.server, self.server)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        if self.session.wait_for_hand():
            self.session.run()

    def finish(self) -> dict[str, Any]:
        self._thread.join(timeout=30.0)
        assert not self._thread.is_alive(), "the session goes on although its page is closed"
        return self.session.summary()


@pytest.fixture
def running() -> Iterator[Running]:
    run = Running()
    with run.server:
        yield run


def test_without_a_headset_the_page_says_so_and_shows_the_scene(browser: Any, running: Running) -> None:
    with open_page(browser, running.server.address[1]) as page:
        wait_until(lambda: page.evaluate("quasirigid.status.states > 0"), "quasirigid.status.states > 0")
        wait_until(
            lambda: page.evaluate("document.querySelector('#device').textContent.startsWith('No WebXR device')"),
            "document.querySelector('#device').textContent.startsWith('No WebXR device')",
        )
        assert not page.is_visible("#vr")
        wait_until(lambda: picture(page).std() > 0.01, "something drawn")
        at = page.evaluate("quasirigid.camera.position.toArray()")
        page.mouse.move(560, 400)
        page.mouse.down()
        page.mouse.move(700, 420, steps=4)
        page.mouse.up()
        wait_until(lambda: page.evaluate("quasirigid.camera.position.toArray()") != at, "the camera to turn")
        assert page.strangers == []


def test_synthetic_hand_joints_pinch_and_lift_the_box(browser: Any, emulator: str, running: Running) -> None:
    x, y, z = TABLE
    ready, above, held = (x, y + 0.12, z + 0.03, 0), (x, y, z, 0), (x, y, z, 1)
    raised = (x, y + LIFT, z, 1)

    def prepare(page: Any) -> None:
        page.set_viewport_size({"width": 240, "height": 160})
        page.add_init_script(path=emulator)
        page.add_init_script(path=HERE / "xr_device.js")
        poses = f"xrDevice({matrices(HALF_WIDTH, 0.03)}, {matrices(HALF_WIDTH, -GRIP)})"
        page.add_init_script(f"{poses}; device.hands.right.position.set{ready[:3]};")

    with open_page(browser, running.server.address[1], prepare) as page:
        page.click("#vr")
        wait_until(
            lambda: page.evaluate("quasirigid.status.session === 'immersive-vr' && quasirigid.status.sent > 5"),
            "quasirigid.status.session === 'immersive-vr' && quasirigid.status.sent > 5",
        )
        wait_until(lambda: running.session.coupling is not None, "the session to see the hand")
        keys = [[0.0, *ready], [1.2, *above], [2.6, *held], [3.0, *held], [5.0, *raised], [6.0, *raised]]
        page.evaluate("keys => xrMove(keys)", keys)
        wait_until(lambda: page.evaluate("window.xrDone"), "window.xrDone")
        outcome = running.session.outcome
        assert outcome is not None
        wait_until(lambda: running.session.object.position[2] > 0.04 + 0.8 * LIFT, "the box to be lifted")
        drawn = page.evaluate("quasirigid.drawing.bodies[0].position.z")
        assert drawn > 0.04 + 0.5 * LIFT, f"the headset shows the box at {drawn:.3f} m"
        page.evaluate("keys => xrMove(keys)", [[0.0, *raised], [0.5, *raised], [2.5, *held], [2.8, *held], [3.8, *above], [4.8, *ready]])
        wait_until(lambda: page.evaluate("window.xrDone"), "window.xrDone")
        page.wait_for_timeout(300)
        assert page.strangers == []
    summary = running.finish()
    assert summary["held"], summary
    assert not summary["dropped"], summary
    assert abs(summary["lifted_m"] - LIFT) < 0.01, f"lifted by {1e3 * summary['lifted_m']:.1f} mm, the hand by {1e3 * LIFT:.0f} mm"
    assert summary["put_down"], summary
    assert summary["stream"]["malformed"] == 0
