"""The live view in a real browser: what a person sees and does."""

from __future__ import annotations

from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import browser as browser_tools
import numpy as np
import pytest
import trimesh
from browser import canvas_box, open_page, picture, received, running_browser, wait_until
from live_page import (
    assert_inside,
    bodies_on_screen,
    body,
    camera_of,
    colours_of_the_hand,
    drag,
    enter,
    figure_of,
    frame,
    height,
    hold,
    is_in_sight,
    keep,
    on_screen,
    press,
)
from PIL import Image

import quasirigid as qr
from quasirigid.grasp.options import GraspOptions
from quasirigid.live.dragging import BASE_SCALE, FINGER_SCALE
from quasirigid.live.object_library import LARGEST_UPLOAD
from quasirigid.live.play import Play
from quasirigid.live.server import LiveView
from quasirigid.rotation import rotate

pytestmark = pytest.mark.realtime

OPTIONS = GraspOptions(points=6_000)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with running_browser() as running:
        yield running


@pytest.fixture
def page(browser: Any, live: LiveView) -> Iterator[Any]:
    with open_page(browser, live.server.get_port()) as opened:
        yield opened


@pytest.fixture
def live() -> Iterator[LiveView]:
    view = LiveView(Play(OPTIONS), OPTIONS, port=8310)
    view.start()
    yield view
    view.stop()


def test_the_page_shows_box_and_fingers_and_run_makes_them_move(live: LiveView, page: Any) -> None:
    wait_until(lambda: colours_of_the_hand(picture(page)) > 100, "the hand is drawn")
    page.wait_for_timeout(1000)
    before = picture(page)
    # The joints have the colours of their fingers; the glass of the box is bluish grey: its share of blue is above that of red.
    green = (before[..., 1] - before[..., 0] > 0.25).sum()
    box = ((before[..., 2] - before[..., 0] > 0.04) & (before.mean(axis=2) < 0.93)).sum()
    assert green > 100, green
    assert box > 0.03 * before[..., 0].size, box
    assert page.get_by_text("paused").count() == 1
    press(page, "Run")
    wait_until(lambda: frame(live).state.phase in ("squeezing", "holding"), "the hand closes")
    page.wait_for_timeout(1000)
    changed = float((np.abs(picture(page) - before).max(axis=2) > 0.1).mean())
    assert changed > 0.005, changed
    press(page, "Pause")
    wait_until(lambda: not frame(live).running, "Pause")
    step = frame(live).state.step
    press(page, "Step")
    wait_until(lambda: frame(live).state.step == step + 1, "one step")
    assert page.strangers == []
    keep(page, "view")


@pytest.mark.parametrize("size", [(390, 844), (1280, 720)])
def test_hand_sensors_and_controls_are_in_sight_on_a_phone_and_on_a_small_screen(
    live: LiveView, browser: Any, size: tuple[int, int]
) -> None:
    phone = size[0] < 576
    with open_page(browser, live.server.get_port(), size=size) as page:
        run = page.get_by_role("button", name="Run", exact=True)
        run.wait_for()

        def sheet() -> float:
            """Where the sheet of a phone begins, px from above; elsewhere nothing lies over the scene."""
            header = page.get_by_text("quasirigid", exact=True).locator("xpath=ancestor::*[contains(@class, 'Paper-root')][1]")
            return float(header.bounding_box()["y"]) if phone else float(size[1])

        def in_sight() -> bool:
            state, model = frame(live).state, frame(live).model
            return is_in_sight(bodies_on_screen(live.server, page, model, state), page, sheet())

        wait_until(in_sight, f"hand and box are in the picture of {size} px, above the sheet")
        if phone:
            assert size[1] - sheet() <= 0.46 * size[1], f"the sheet covers {size[1] - sheet():.0f} of {size[1]} px"
        # What is pressed most is there without scrolling, and so are the sensors, or the row that opens them.
        sensors = page.get_by_role("button", name="Expand panel Sensors") if phone else page.get_by_role("tab", name="Sensors")
        for what in (run, page.get_by_role("button", name="Fit the view"), page.get_by_role("button", name="Close", exact=True), sensors):
            assert_inside(what, (0.0, sheet() if phone else 0.0, *size))
        if phone:
            sensors.click()
        picture_of_pads, legend = page.locator("img:visible").first, page.locator(".curve-legend")
        for what in (picture_of_pads, legend, page.get_by_text("Normal force (N): no data yet")):
            assert_inside(what, (0.0, 0.0, *size), scroll=True)
        for name in frame(live).model.fingers:
            assert name in legend.inner_text()
        keep(page, f"view-{size[0]}")
        if phone:  # the panel folds, by a touch on its header
            open_at = sheet()
            page.get_by_text("quasirigid", exact=True).click()
            wait_until(lambda: sheet() > size[1] - 70, f"the sheet is folded, from {open_at:.0f} px")
            keep(page, "view-folded")
        else:
            press(page, "Run")
            page.get_by_text("Normal force (N) over time (s)").wait_for()  # there are data now, and nothing else is said

            def curve_of_the_thumb() -> int:
                image = np.asarray(Image.open(BytesIO(page.locator(".uplot:visible").first.screenshot())).convert("RGB")).astype(int)
                return int((np.abs(image - [0x00, 0x72, 0xB2]).max(axis=2) < 40).sum())

            wait_until(lambda: curve_of_the_thumb() > 50, "the curve of the thumb is drawn, in its colour")


def test_fit_the_view_brings_everything_back_into_the_picture(live: LiveView, page: Any) -> None:
    def in_sight() -> bool:
        state, model = frame(live).state, frame(live).model
        return is_in_sight(bodies_on_screen(live.server, page, model, state), page, page.viewport_size["height"])

    wait_until(in_sight, "everything is in the picture at the start")
    camera = camera_of(live.server)
    sideways = np.cross(camera.look_at - camera.position, [0.0, 0.0, 1.0])
    camera.position = camera.position + 0.3 * (camera.look_at - camera.position) + 0.3 * sideways
    wait_until(lambda: not in_sight(), "a part has left it")
    towards = camera_of(live.server).look_at - camera_of(live.server).position
    press(page, "Fit the view")
    wait_until(in_sight, "everything is in the picture again")
    after = camera_of(live.server).look_at - camera_of(live.server).position
    cosine = float(after @ towards / np.linalg.norm(after) / np.linalg.norm(towards))
    assert cosine > 0.999, f"seen from where one was: {cosine}"


@pytest.mark.parametrize("size", [0.01, 10.0])
def test_a_world_of_one_s_own_is_in_the_picture_whatever_its_size_and_stays_there(browser: Any, size: float) -> None:
    world, rubber = qr.World(), qr.Material.preset("rubber")
    world.add_body(qr.Surface.half_space(6 * size, points=400), rubber, motion="fixed")
    ball = world.add_body(qr.Surface.sphere(0.5 * size, points=600), rubber, mass=500 * size**3, position=(0.0, 0.0, 2.0 * size))
    with (
        qr.view(world, browser=False, port=8330) as shown,
        open_page(browser, int(shown.url.rsplit(":", 1)[1]), size=(1280, 720)) as page,
    ):
        server, scale = shown._page.server, shown._page._scale

        def in_sight() -> bool:
            places = browser_tools.on_screen(camera_of(server), page, scale * (ball.position + ball.surface.points))  # type: ignore[union-attr]
            box = canvas_box(page)
            large = np.ptp(places, axis=0).max() > 0.15 * box["height"]
            return large and is_in_sight(places, page, box["y"] + box["height"])

        def coloured() -> float:
            image = picture(page)
            return float(((image[..., 2] - image[..., 0] > 0.04) & (image.mean(axis=2) < 0.93)).mean())

        wait_until(in_sight, "the ball is in the picture")
        wait_until(lambda: coloured() > 0.02, "the ball is drawn")
        world.step(round(1.5 * (2.0 * size / 9.81) ** 0.5 / world.dt))
        wait_until(in_sight, "the ball has fallen to the floor and is in the picture")
        thrown = np.array([3.0 * size, 0.0, 0.5 * size])
        ball.set_pose(thrown)
        world.step()
        wait_until(in_sight, "the picture follows the ball")
        keep(page, f"own-{size:g}")


def test_less_friction_drops_the_box_and_reset_brings_it_back(live: LiveView, page: Any) -> None:
    hold(live, page)
    up = height(live)
    enter(page, "Friction", 0.05)
    wait_until(lambda: height(live) < up - 0.03, "the box slips out of the hand")
    keep(page, "dropped")
    press(page, "Reset")
    wait_until(lambda: frame(live).state.time == 0.0, "Reset")
    assert height(live) == pytest.approx(0.04, abs=1e-9)
    wait_until(lambda: figure_of(page, "Friction") == "0.71", "the slider is back")


def test_dragging_the_base_carries_the_held_box_along(live: LiveView, page: Any) -> None:
    hold(live, page)
    wait_until(lambda: abs(height(live) - 0.09) < 0.01, "the lift is done")
    page.wait_for_timeout(1500)
    before = frame(live).state.positions[body(live, "object")].copy()
    aim = frame(live).base[0][0]
    axis = np.array([1.0, 0.0, 0.0])
    for _ in range(5):  # a page that draws two frames a second may not have seen the pointer arrive
        assert live._touch is not None
        origin = np.array(live._touch._base.position)
        start = on_screen(live, page, origin + 0.8 * BASE_SCALE * axis)
        end = on_screen(live, page, origin + (0.8 * BASE_SCALE + 0.05) * axis)
        drag(page, start, end, pause=0.8)
        page.wait_for_timeout(1000)
        if frame(live).base[0][0] - aim > 0.02:
            break
    wait_until(lambda: frame(live).state.positions[body(live, "object")][0] - before[0] > 0.02, "the box follows the hand")
    page.wait_for_timeout(500)
    state = frame(live).state
    assert state.phase == "holding"
    assert abs(state.positions[body(live, "object")][2] - before[2]) < 0.005
    keep(page, "carried")


def test_dragging_a_fingertip_moves_its_joints_and_close_gives_it_back(live: LiveView, page: Any) -> None:
    press(page, "Run")
    wait_until(lambda: frame(live).state.phase == "holding", "the grip holds")
    page.get_by_role("tab", name="View").click()
    page.get_by_label("Handles of the fingertips").check()
    thumb, hand = 0, live.session._play.hand
    assert live._touch is not None
    gizmo = live._touch._fingers[thumb]
    wait_until(lambda: gizmo.visible and np.linalg.norm(gizmo.position - frame(live).finger_aims[thumb]) < 0.05, "the handle is at the pad")
    page.wait_for_timeout(1500)
    targets, force = hand.joint_targets.copy(), frame(live).state.normal_forces.copy()
    assert force[thumb] > 1.0
    aim = frame(live).finger_aims[thumb].copy()
    axis = np.array([1.0, 0.0, 0.0])  # the thumb is at -x and presses towards +x
    for _ in range(5):  # a page that draws two frames a second may not have seen the pointer arrive
        origin = np.array(gizmo.position)
        start, end = (on_screen(live, page, origin + x * axis) for x in (0.8 * FINGER_SCALE, 0.8 * FINGER_SCALE - 0.02))
        drag(page, start, end, pause=0.8)
        page.wait_for_timeout(1000)
        if aim[0] - frame(live).finger_aims[thumb][0] > 0.008:
            break
    keep(page, "fingertip")
    wait_until(lambda: frame(live).state.phase == "fingers by hand", "the grip has let go")
    moved = np.abs(hand.joint_targets - targets).max(axis=1)
    assert moved[thumb] > 0.05, moved
    wait_until(lambda: frame(live).state.normal_forces[thumb] < 0.5 * force[thumb], "the thumb lets go")
    assert np.linalg.norm(frame(live).finger_aims[thumb] - aim) > 0.008
    page.get_by_role("tab", name="Control").click()
    press(page, "Close")
    wait_until(lambda: frame(live).state.phase == "holding", "the grip has it again")
    wait_until(lambda: frame(live).state.normal_forces[thumb] > 0.7 * force[thumb], "the thumb presses again")


def test_what_a_person_flings_away_reset_brings_back(live: LiveView, page: Any) -> None:
    press(page, "Run")
    wait_until(lambda: frame(live).state.phase == "holding", "the grip holds")
    live.session.do(lambda play: play.pull(np.zeros(3), np.array([3.0, 3.0, 3.0])))
    wait_until(lambda: "out of reach: press Reset" in page.content(), "the page says what to press")
    keep(page, "flung")
    live.session.do(lambda play: play.pull(None, None))
    # A fingertip through the box, or where it was.
    live.session.do(lambda play: play.aim_finger(0, np.array([0.2, 0.0, 0.04])))
    page.wait_for_timeout(1500)
    assert np.isfinite(frame(live).state.positions).all()
    press(page, "Reset")
    wait_until(lambda: frame(live).state.time == 0.0, "Reset")
    assert height(live) == pytest.approx(0.04, abs=1e-9)
    press(page, "Run")
    wait_until(lambda: frame(live).state.phase == "holding", "and it can be taken again")


def test_the_box_can_be_pulled_with_the_mouse(live: LiveView, page: Any) -> None:
    press(page, "Open")
    press(page, "Run")
    page.wait_for_timeout(500)
    at = frame(live).state.positions[body(live, "object")].copy()
    x, y = on_screen(live, page, at + [0.0, 0.0, 0.02])
    page.mouse.move(x, y)
    page.wait_for_timeout(300)
    page.mouse.down()
    for k in range(6):
        page.mouse.move(x + 12 * k, y - 6 * k)
        page.wait_for_timeout(80)
    wait_until(lambda: frame(live).pulled is not None, "the pull is felt")
    wait_until(lambda: "you pull with" in page.content(), "the force is shown")
    keep(page, "pulled")
    wait_until(lambda: np.linalg.norm(frame(live).state.positions[body(live, "object")] - at) > 0.004, "the box follows")
    page.mouse.up()
    wait_until(lambda: frame(live).pulled is None, "it lets go")


def test_an_uploaded_mesh_appears_and_a_bad_file_is_refused_in_the_page(live: LiveView, page: Any, tmp_path: Path) -> None:
    good = tmp_path / "egg.stl"
    egg = trimesh.creation.icosphere(subdivisions=3)
    egg.apply_scale([26.0, 26.0, 34.0])  # in millimetres, as most files are
    egg.export(good)
    bad = tmp_path / "bad.obj"
    bad.write_text("v 0 0 nonsense\n")
    chooser = page.locator("input[type=file]").first
    chooser.set_input_files(str(bad))
    wait_until(lambda: "bad.obj" in page.content(), "the error is in the page")
    assert frame(live).model.bodies[body(live, "object")].name == "box"
    large = tmp_path / "large.stl"
    large.write_bytes(b"0" * (LARGEST_UPLOAD + 1))
    chooser.set_input_files(str(large))
    wait_until(lambda: "large.stl: expected at most 20 MB" in page.content(), "the file is refused in the page")
    assert live.server.gui._current_file_upload_states == {}, "nothing of it is kept"
    for name in ("bad.obj", "large.stl"):
        page.get_by_text(f"{name} is refused").wait_for(state="attached")
    wait_until(lambda: page.get_by_role("button", name="Load a file").is_enabled(), "the button waits for another file")
    chooser.set_input_files(str(good))
    wait_until(lambda: frame(live).model.bodies[body(live, "object")].name == "egg", "the egg is in the scene")
    page.wait_for_timeout(1500)
    keep(page, "egg")
    press(page, "Run")
    wait_until(lambda: frame(live).state.phase == "holding", "the egg is held")


def test_the_simulation_goes_on_without_pages_and_is_right_on_return(live: LiveView, browser: Any) -> None:
    port = live.server.get_port()
    with open_page(browser, port) as first:
        press(first, "Run")
        first.wait_for_timeout(300)
        first.reload()
        first.wait_for_selector("canvas", state="attached")
    step = frame(live).state.step
    wait_until(lambda: frame(live).state.step > step + 100, "it goes on without a page")
    wait_until(lambda: frame(live).state.phase == "holding", "the grip holds")
    with open_page(browser, port) as one, open_page(browser, port) as two:
        press(one, "Pause")
        for page in (one, two):
            wait_until(
                lambda page=page: page.get_by_text("holding").count() == 1 and page.get_by_text("paused").count() == 1, "it is said so"
            )
            wait_until(lambda page=page: colours_of_the_hand(picture(page)) > 100, "the hand is drawn")
            page.wait_for_timeout(1000)
        difference = float(np.abs(picture(one) - picture(two)).mean())
        assert difference < 0.01, difference


def test_pads_in_the_page_are_deformed_as_in_the_engine_to_a_hundredth_of_a_millimetre(live: LiveView, browser: Any) -> None:
    messages: list[dict[str, Any]] = []
    with open_page(browser, live.server.get_port(), lambda page: messages.append({"all": received(page)})) as page:
        press(page, "Run")
        wait_until(lambda: frame(live).state.phase == "holding", "the grip holds")
        press(page, "Pause")
        wait_until(lambda: not frame(live).running, "Pause")
        page.wait_for_timeout(1000)
    last = {}
    for message in messages[0]["all"]:
        if message["type"] == "SceneNodeUpdateMessage" and "vertices" in message["updates"]:
            last[message["name"]] = message["updates"]["vertices"].reshape(-1, 3)
    state, model = frame(live).state, frame(live).model
    play = live.session._play
    worst, deepest = 0.0, 0.0
    pads = last["/hand/pads"].astype(float)  # of all fingers, in world axes
    assert live._drawing is not None
    assert live._drawing._pads is not None
    joined = live._drawing._pads
    for finger, tip in enumerate(model.fingertips()):
        rest = rotate(state.quaternions[tip], model.bodies[tip].points) + state.positions[tip]
        truth = play.hand.deformed_points(finger)
        sent = np.isin(joined.rows[finger], joined.sent)
        shown = rest.copy()  # what is not sent is drawn at rest
        shown[sent] = pads[np.searchsorted(joined.sent, joined.rows[finger][sent])]
        worst = max(worst, float(np.abs(shown - truth).max()))
        deepest = max(deepest, float(np.abs(shown - rest).max()))
    assert deepest > 5e-4, deepest  # the pads are pressed in by half a millimetre at least
    assert worst < 1e-5, worst
