"""Replay: the timeline keeps time, and the page shows the recording's state at the time asked for."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import open_page, picture, received, running_browser, wait_until
from recorded import record_pinch

from quasirigid.cli.app import main
from quasirigid.live import replay
from quasirigid.live.replay import ReplayView, Timeline
from quasirigid.rotation import rotate
from quasirigid.scene.model import SceneState

PORT = 8360


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[SceneState]]:
    path = tmp_path_factory.mktemp("run") / "run.h5"
    return path, record_pinch(path, deformation_rate=np.inf)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with running_browser() as running:
        yield running


def test_timeline_plays_loops_stops_and_seeks(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [100.0]
    monkeypatch.setattr(replay.time, "perf_counter", lambda: clock[0])
    line = Timeline(np.arange(1.0, 5.0))
    assert (line.now(), line.playing) == (1.0, False)
    clock[0] += 5.0
    assert line.now() == 1.0, "paused"
    line.play(True)
    clock[0] += 0.5
    assert line.now() == pytest.approx(1.5)
    line.set_speed(4.0)
    clock[0] += 0.25
    assert line.now() == pytest.approx(2.5)
    clock[0] += 0.5
    assert line.now() == pytest.approx(1.5), "starts again after the end"
    line.loop = False
    clock[0] += 10.0
    assert (line.now(), line.playing) == (4.0, False)
    line.play(True)
    assert line.now() == pytest.approx(1.0), "from the end it plays anew"
    for to, there in ((2.25, 2.25), (-1.0, 1.0), (99.0, 4.0)):
        line.play(False)
        line.seek(to)
        assert line.now() == there


def test_page_shows_the_state_of_the_recording(run: tuple[Path, list[SceneState]], browser: Any) -> None:
    path, states = run
    with ReplayView(path, port=PORT) as view:
        messages: list[dict[str, Any]] = []
        with open_page(browser, view.server.get_port(), lambda page: messages.append({"all": received(page)})) as page:
            page.get_by_text("0.002 s of 0.520 s").wait_for()
            before = picture(page)
            # The slider: to the last step.
            field = (
                page.locator("label:has-text('Time (s)')").first.locator("xpath=ancestor::*[.//input][1]").locator("input[type=text]").first
            )
            field.fill("0.5")
            field.press("Enter")
            wait_until(lambda: view.step == 249, "the slider goes to 0.5 s")
            page.get_by_text("0.500 s of 0.520 s").wait_for()
            page.get_by_text(f"whole force {np.linalg.norm(states[249].finger_forces[0]):.2f} N").wait_for()
            page.wait_for_timeout(1500)
            changed = (np.abs(picture(page) - before).max(axis=2) > 0.1).mean()
            assert changed > 0.003, f"{100 * changed:.2f} % of the picture changed"
            # What the page has been sent last is the live state of that step.
            worst = 0.0
            sent = [
                m["updates"]["vertices"]
                for m in messages[0]["all"]
                if m.get("type") == "SceneNodeUpdateMessage" and m["name"] == "/hand/pads" and "vertices" in m["updates"]
            ]
            assert sent, "no vertices of the pads were sent"
            pads = view._drawing._pads
            assert pads is not None
            for part, tip in enumerate(view.recording.model.fingertips()):
                body, moved = view.recording.model.bodies[tip], states[249].moved[tip]
                expected = body.points.copy()
                expected[moved.indices] = moved.points
                world = rotate(states[249].quaternions[tip], expected) + states[249].positions[tip]
                rest = rotate(states[249].quaternions[tip], body.points) + states[249].positions[tip]
                drawn = np.isin(pads.rows[part], pads.sent)
                rest[drawn] = sent[-1].reshape(-1, 3)[np.searchsorted(pads.sent, pads.rows[part][drawn])]
                worst = max(worst, float(np.abs(rest - world).max()))
            assert worst < 1e-5, f"deformation in the page off by {1e3 * worst:.4f} mm"
            page.get_by_role("button", name="›", exact=True).click()
            wait_until(lambda: view.step == 250, "one step on")
            page.get_by_role("button", name="‹", exact=True).click()
            wait_until(lambda: view.step == 249, "one step back")
            page.get_by_role("button", name="Play", exact=True).click()
            wait_until(lambda: view.timeline.playing and view.step not in (249, 250), "it plays")
            page.get_by_role("button", name="Pause", exact=True).click()
            wait_until(lambda: not view.timeline.playing, "it pauses")
            assert page.strangers == []


def test_command_ends_by_itself_and_refuses_what_is_no_recording(
    run: tuple[Path, list[SceneState]], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", str(run[0]), "--no-browser", "--port", str(PORT + 10), "--seconds", "0.5", "--play"]) == 0
    out, err = capfd.readouterr()
    assert out == ""
    assert "replay on http://localhost:" in err
    (tmp_path / "text.h5").write_text("hello")
    assert main(["replay", str(tmp_path / "text.h5"), "--no-browser"]) == 2
    assert "expected a recording" in capfd.readouterr().err
