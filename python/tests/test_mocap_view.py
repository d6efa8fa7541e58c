"""`quasirigid mocap grasp ... --view`: the session in the page, drawn by a process that never holds it up."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import open_page, picture, received, running_browser, wait_until
from hand_frames import FrameSource, Kept, part
from pinching_hand import LIFTS, during, frames

from quasirigid import mocap
from quasirigid.cli.app import main
from quasirigid.grasp.options import GraspOptions
from quasirigid.live.viewer_process import ViewerProcess
from quasirigid.mocap.observation import Observation
from quasirigid.mocap.options import MocapOptions
from quasirigid.mocap.session import MocapSession
from quasirigid.mocap.source import TakeSource

pytestmark = pytest.mark.realtime

SHOTS = os.environ.get("QUASIRIGID_SCREENSHOTS")
COARSE = GraspOptions(points=6000, dt=0.004)


@pytest.fixture
def apart() -> Iterator[ViewerProcess]:
    with ViewerProcess(port=8350) as page:
        yield page


def kept_session(until: float, directory: Path, coupling: str = "tips") -> tuple[MocapSession, Kept]:
    viewer = Kept()
    options = MocapOptions(idle=0.1, coupling=coupling)  # type: ignore[arg-type]
    session = MocapSession(COARSE, options, TakeSource(part(directory, until=until)), viewer)
    assert session.wait_for_hand()
    session.run()
    return session, viewer


@pytest.mark.parametrize("coupling", ["tips", "hand"])
def test_a_viewer_is_shown_the_hand_and_where_it_draws_the_pads(coupling: str, tmp_path: Path) -> None:
    _, viewer = kept_session(3.0, tmp_path, coupling)
    assert [len(model.fingers) for model in viewer.models] == [0, 3]
    assert viewer.states[0].phase == "waiting for the hand"
    last = viewer.states[-1]
    hand = last.tracked
    assert hand is not None
    assert hand.fingers == (0, 1, 2, -1, -1, -1)
    assert hand.states[:3] == ("live", "live", "live")
    # The pads lie on the faces of the box, the hand is 10 and 5 mm inside (the take's own figures): the springs of `tips` hold their force.
    inside = np.abs(hand.ends[:, 0]) - np.abs(hand.aims[:, 0])
    deep = (4e-3, 2e-3) if coupling == "tips" else (1e-3, 0.0)
    assert deep[0] < inside[0] < 11e-3, inside
    assert deep[1] < inside[1] < 6e-3, inside
    yields = 3e-3 if coupling == "tips" else 5e-3  # the pads; joints press harder than those springs
    assert np.abs(np.abs(hand.ends[:, 0]) - 0.03).max() < yields, hand.ends
    if coupling == "tips":
        pull = 600.0 * np.linalg.norm(hand.aims - hand.ends, axis=1)
        assert pull == pytest.approx(last.normal_forces, rel=0.25), "forces are those of the springs that are drawn"


def test_a_take_that_is_watched_keeps_to_the_clock_and_has_the_same_result(tmp_path: Path) -> None:
    take = part(tmp_path, until=1.0)
    hashes = []
    for watched in (False, True):
        source = TakeSource(take, watched=watched)
        session = MocapSession(COARSE, MocapOptions(idle=0.1), source)
        assert session.wait_for_hand()
        began, start = time.monotonic(), source.now()
        session.run()
        if watched:
            assert time.monotonic() - began >= source.now() - start - 0.06, "faster than the clock"
        hashes.append(session.world.state_hash())
    assert hashes[0] == hashes[1]


def test_a_page_that_hangs_or_dies_never_holds_the_session_up(
    apart: ViewerProcess, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    session, viewer = kept_session(3.0, tmp_path)
    process = apart._process.pid
    assert process is not None
    apart.begin(session.scene.model)
    os.kill(process, signal.SIGSTOP)

    def show() -> None:
        for k in range(200):
            apart.draw(replace(viewer.states[-1], step=k))
            time.sleep(1e-3)  # else the newest replaces the others before they are sent, and the pipe is never full

    # Far more than a pipe holds: whoever waited for the page would wait for ever.
    showing = threading.Thread(target=show, daemon=True)
    showing.start()
    showing.join(timeout=60.0)
    held_up = showing.is_alive()
    if held_up:
        os.kill(process, signal.SIGKILL)
    assert not held_up, "the session waits for the page"
    wait_until(lambda: apart._state is not None, "states wait for the page")
    assert apart._state is not None
    assert apart._state.step == 199, "the newest state wins"
    assert not apart.wants_state(), "no more states are made for a page that takes none"
    os.kill(process, signal.SIGCONT)
    wait_until(lambda: apart._state is None, "the page goes on")
    os.kill(process, signal.SIGKILL)
    wait_until(lambda: apart.draw(viewer.states[-1]) is None and not apart.alive, "the end is noticed")
    assert not apart.wants_state()
    assert "the session goes on" in capfd.readouterr().err


def test_the_page_shows_hand_forces_and_figures(apart: ViewerProcess, tmp_path: Path) -> None:
    messages: list[list[dict[str, Any]]] = []
    with running_browser() as browser:
        viewer: Any = apart
        session = MocapSession(COARSE, MocapOptions(idle=0.1), TakeSource(mocap.shipped_take(), watched=True), viewer)
        with open_page(browser, apart.port, lambda page: messages.append(received(page))) as page:
            wait_until(lambda: "waiting for the hand" in page.content(), "it waits")
            assert session.wait_for_hand()
            end = session._over
            shot: list[Any] = []

            def over() -> bool:
                # In the middle of the lift, while the middle finger is not seen.
                if session.world.time < 3.25:
                    return end()
                targets = session._tracker.sample(session.source.now())
                assert targets is not None
                state = replace(session.scene.state(phase="carry"), tracked=session._tracked(targets))
                wait_until(lambda: apart.draw(state) or "not seen, held" in page.content(), "the middle finger is lost just then")
                page.wait_for_timeout(1000)
                shot.append(picture(page))
                if SHOTS:
                    page.screenshot(path=str(Path(SHOTS) / "mocap.png"))
                return True

            session._over = over  # type: ignore[method-assign]
            session.run()
            text = page.content()
        assert shot, "the lift was never seen"
        assert page.strangers == []
    assert "mm from the hand" in text
    assert "carry" in text
    names = {message.get("name") for message in messages[0]}
    assert {"/tracked/thumb", "/tracked/index", "/tracked/middle", "/tracked/palm"} <= names
    assert "/tracked/ring" not in names, "never seen"
    image = shot[0]
    assert (image[..., 2] - image[..., 0] > 0.25).sum() > 50, "the blue arrow of the thumb's force"


def test_view_and_headset_are_one_or_the_other(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["mocap", "grasp", "webxr:0", "--view", "--out", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert "--view" in said
    assert len(said.splitlines()) == 1


def test_the_button_of_the_page_puts_the_object_back(apart: ViewerProcess) -> None:
    """From a browser to the session in the other process: the box has been lifted, and stands where it stood."""
    hand = frames(3, 0.015, height=lambda time: 0.1 * during(time, LIFTS))
    session = MocapSession(COARSE, MocapOptions(idle=0.1), FrameSource(hand), apart)
    assert session.wait_for_hand()
    pressed = []

    with running_browser() as browser, open_page(browser, apart.port) as page:

        def press(look: Observation) -> None:
            if look.phase == "carry" and look.object_pose[2] > 0.12 and not pressed:
                pressed.append(look.object_pose[2])
                wait_until(lambda: page.get_by_role("button", name="Reset").count() > 0, "the button")
                page.get_by_role("button", name="Reset").click()
                wait_until(apart._pipe.poll, "the press to come to the session")

        session.observers.append(press)
        session.run()
    assert pressed, "or this tests nothing"
    assert session.resets == 1
    assert abs(session.object.position[2] - 0.04) < 1e-3
    assert session.summary()["carried_s"] == 0.0
