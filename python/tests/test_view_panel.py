"""The panel of the live view and what it commands, without a browser: figures, objects to choose from, hands, and bugs that
are survived.
"""

from __future__ import annotations

import queue
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from browser import wait_until

import quasirigid as qr
from quasirigid.arrays.types import FloatArray
from quasirigid.grasp.experiment import LIFT, Grasp
from quasirigid.grasp.options import GraspOptions
from quasirigid.grasp.setup import take_box
from quasirigid.live.grasp_page import Page
from quasirigid.live.panel import show_value
from quasirigid.live.play import PULL_LIMIT, Play
from quasirigid.live.server import LiveView
from quasirigid.live.session import Session
from quasirigid.scene.world import WorldScene

OPTIONS = GraspOptions(points=2_000)


def served(options: GraspOptions) -> LiveView:
    return LiveView(Play(options), options, port=8460)


@pytest.fixture(scope="module")
def play() -> Play:
    return Play(OPTIONS)


def choose(live: LiveView, name: str) -> None:
    """A person chooses from the list of shapes."""
    shape: Any = live._control._shape
    shape.value = name
    for callback in shape._impl.update_cb:
        callback(SimpleNamespace(client=object(), client_id=0, target=shape))


def test_objects_from_files_can_be_chosen_again_and_the_list_says_what_is_there(tmp_path: Path) -> None:
    heavy = Play(OPTIONS, lambda options, *_: take_box(replace(options, mass=0.3)), "box.stl")  # a file called like a built-in shape
    live = LiveView(heavy, OPTIONS, port=8460)
    live.start()
    try:
        shape: Any = live._control._shape

        def there() -> tuple[str, str, float]:
            frame = live.session.newest()[1]
            return shape.value, frame.choice, frame.figures.mass

        assert there() == ("box.stl", "box.stl", 0.3)
        choose(live, "box")
        wait_until(lambda: there() == ("box", "box", 0.2), "the box")
        choose(live, "box.stl")
        wait_until(lambda: there() == ("box.stl", "box.stl", 0.3), "the file once more")
        live._control._files["other.stl"] = lambda: Play(GraspOptions(object=tmp_path / "gone.stl"))
        choose(live, "other.stl")
        assert shape.value == "box.stl", "what is refused is not shown"
        assert "gone.stl" in live._control._complaint.content
    finally:
        live.stop()


def test_sliders_show_the_figures_of_the_simulation_however_large_or_small() -> None:
    live = served(GraspOptions(points=2_000, mass=5.0, squeeze=20.0, friction=2.0))
    figures, sliders = live.session.newest()[1].figures, live._control._sliders
    shown: Any
    try:
        for name, shown in sliders.items():
            assert shown.value == pytest.approx(getattr(figures, name)), name
            assert shown.min <= shown.value <= shown.max, name
        show_value(sliders["squeeze"], 21.922128)
        assert (sliders["squeeze"].value, sliders["squeeze"].max) == (21.922128, 22.0), "what stands below a slider is short"
        shown = sliders["mass"]
        show_value(shown, 0.004)
        assert shown.min == shown.value == round(shown.value, shown.precision) == 0.004
    finally:
        live.stop()


def test_lift_and_lower_move_the_hand_from_where_it_was_dragged(play: Play) -> None:
    place, turn = play.base
    aside = place + np.array([0.1, -0.05, 0.0])
    tilted = np.array([0.0, np.cos(0.1), np.sin(0.1), 0.0]) if abs(turn[1]) > 0.5 else np.array([np.cos(0.1), 0.0, 0.0, np.sin(0.1)])
    play.aim_base(aside, tilted)
    for up, height in ((True, LIFT), (True, 2 * LIFT), (False, LIFT), (False, 0.0), (False, 0.0)):
        play.lift(up)
        assert play.base_aim[0] == pytest.approx(aside + [0.0, 0.0, height])
        assert play.base_aim[1] == pytest.approx(tilted)


def test_the_pull_that_is_shown_is_what_acts_and_at_most_its_limit(play: Play) -> None:
    play.set_gravity(0.0)
    play.object.set_velocity((0.0, 0.0, 1.0))  # away from where it is pulled to: spring and damper add up
    play.pull(np.zeros(3), play.object.position - np.array([0.0, 0.0, 0.5]))
    play.step()
    before = play.object.linear_velocity
    pulled = play.pulled
    assert pulled is not None
    play.step()
    force = float(np.linalg.norm(play.object.linear_velocity - before)) * play.object.mass / play.world.dt
    assert pulled[2] == pytest.approx(PULL_LIMIT, rel=1e-9)
    assert force == pytest.approx(pulled[2], rel=1e-3), f"{force:.2f} N act, {pulled[2]:.2f} N are shown"


@pytest.mark.parametrize(("force", "says"), [(2.0, "holding, with less than was asked for"), (0.0, "nothing in the hand")])
def test_a_grip_at_the_limit_of_its_motors_is_holding(play: Play, monkeypatch: pytest.MonkeyPatch, force: float, says: str) -> None:
    monkeypatch.setattr(play, "grip", SimpleNamespace(state="weak", forces=lambda: np.full(3, force)))
    assert play.phase.startswith(says)


@pytest.mark.parametrize("bad", [[np.nan, 0.0, 0.0], [np.inf, 0.0, 0.0], [0.0, 0.0]], ids=str)
def test_what_is_no_place_is_refused(play: Play, bad: list[float]) -> None:
    place: FloatArray = np.array(bad)
    with pytest.raises(qr.InvalidValueError, match="finite"):
        play.pull(np.zeros(3), place)
    with pytest.raises(qr.InvalidValueError, match="finite"):
        play.aim_finger(0, place)
    with pytest.raises(qr.InvalidValueError, match="finite"):
        play.aim_base(place, np.array([1.0, 0.0, 0.0, 0.0]))
    with pytest.raises(qr.InvalidValueError, match="quaternion"):
        play.aim_base(np.zeros(3), np.array([0.0, 0.0, 0.0, np.nan]))
    play.step()


def test_a_step_that_fails_is_a_complaint_and_reset_brings_all_back(play: Play, capsys: pytest.CaptureFixture[str]) -> None:
    session = Session(play)
    session.start()

    def broken() -> None:
        raise ZeroDivisionError("a bug")

    session.do(lambda play: setattr(play, "step", broken))
    session.run(True)
    assert "a bug" in session.complaints.get(timeout=10)
    wait_until(lambda: not session.newest()[1].running, "it is paused")
    with pytest.raises(queue.Empty):  # once, not in every step
        session.complaints.get(timeout=0.1)
    assert "ZeroDivisionError" in capsys.readouterr().err, "the traceback is on the console"
    session.do(lambda play: delattr(play, "step"))
    session.reset()
    session.run(True)
    wait_until(lambda: session.newest()[1].state.step > 20, "it runs again")
    session.stop()


def test_a_drawing_that_fails_is_told_once_and_the_next_state_is_drawn(capsys: pytest.CaptureFixture[str]) -> None:
    live = served(OPTIONS)
    drawing, failed = live._drawing, []
    assert drawing is not None
    draw = drawing.draw

    def broken(*arguments: Any, **named: Any) -> None:
        if len(failed) < 3:
            failed.append(1)
            raise IndexError("a bug")
        draw(*arguments, **named)

    drawing.draw = broken  # type: ignore[method-assign]
    live.start()
    try:
        live.session.run(True)
        wait_until(lambda: len(failed) == 3 and live.updates > 5, "it goes on")
        assert live._thread.is_alive()
    finally:
        live.stop()
    assert capsys.readouterr().err.count("IndexError: a bug") == 1


def test_a_grasp_is_watched_with_its_phase_and_pace_and_slow_motion_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    grasp = Grasp(OPTIONS)
    page: Any
    with Page(port=8470, browser=False).open(grasp) as page:
        assert grasp.real_time
        assert "http://localhost:84" in capsys.readouterr().err
        grasp.phase = "squeeze"

        def text() -> str:
            grasp.world.step()
            said: str = page._figures(page._state(), running=True)
            return said

        wait_until(lambda: "slow motion" in text(), "a step now and then is slow motion")
        assert "squeeze" in text()
        assert "too slow for 1 ×" in text()


@pytest.mark.parametrize(("control_points", "finer"), [(100, "pad"), (2_500, "ball")])
def test_the_forces_drawn_point_from_the_pad_into_the_object(control_points: int, finer: str) -> None:
    world, turn = qr.World(gravity=(0.0, 0.0, 0.0)), 0.5**0.5
    ball = world.add_body(qr.Surface.sphere(0.012, points=6_000, control_points=control_points), qr.Material.preset("wood"), mass=0.1)
    tip = world.add_body(
        qr.Surface.fingertip((0.009, 0.009, 0.008)), qr.Material.preset("fingertip_pulp"), motion="fixed",
        position=(-0.0195, 0.0, 0.0), quaternion=(turn, 0.0, turn, 0.0),
    )  # fmt: skip
    world.step()
    scene = WorldScene(world, pads=[tip])
    contacts = scene.state().contacts
    loaded = contacts.reactions[:, 0] > 0.0
    assert loaded.any()
    assert set(contacts.body_a[loaded]) == {[ball.index, tip.index][finer == "pad"]}, "the finer surface is side a"
    assert (scene.model.pushes(contacts)[loaded][:, 0] > 0.0).all()


def test_the_package_can_be_called_and_its_modules_imported() -> None:
    import quasirigid.live.html as by_name

    assert by_name.force(0.0, 1.0) == ""
    assert callable(qr.view)
    with pytest.raises(qr.InvalidValueError, match="host"):
        qr.view(qr.World(), host="192.0.2.1", browser=False)
