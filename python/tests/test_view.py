"""The live view without a browser: what it shows, the clock, what is changed between steps, what is refused."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from viser._messages import FileTransferPart, FileTransferStartUpload, RemoveNotificationMessage

import quasirigid as qr
from quasirigid.cli.app import main
from quasirigid.grasp.options import GraspOptions
from quasirigid.live import html
from quasirigid.live.draw import Layers, SceneDrawing
from quasirigid.live.object_library import LARGEST_UPLOAD, SHAPES, built_in, from_upload
from quasirigid.live.play import BASE_SPEED, Figures, Play
from quasirigid.live.recorder import LiveRecorder
from quasirigid.live.session import Session
from quasirigid.live.stage import close_server, free_port, open_server, page_url
from quasirigid.live.tactile import HEADING, SIDE, Tactile
from quasirigid.live.uploads import UploadGate
from quasirigid.rotation import rotate
from quasirigid.scene.pressure import STICK, Scale, nice_above, patch_of, pressure_at, spread

OPTIONS = GraspOptions(points=4_000)


@pytest.fixture(scope="module")
def held() -> Play:
    """A box that the hand holds, the hand lifted."""
    play = Play(OPTIONS)
    for _ in range(3000):
        play.step()
        if play.phase == "holding":
            break
    play.lift(True)
    for _ in range(800):
        play.step()
    return play


def test_vertices_of_the_scene_are_the_deformed_points_of_the_engine(held: Play) -> None:
    state, model = held.state(), held.scene.model
    for finger, tip in enumerate(model.fingertips()):
        points = model.bodies[tip].points.copy()
        moved = state.moved[tip]
        points[moved.indices] = moved.points
        world = rotate(state.quaternions[tip], points) + state.positions[tip]
        off = np.abs(world - held.hand.deformed_points(finger)).max()
        assert off < 1e-12, off
        assert np.abs(moved.points - model.bodies[tip].points[moved.indices]).max() > 3e-4
    assert state.finger_forces.sum(axis=0)[2] == pytest.approx(0.2 * 9.81, rel=1e-3)


def test_the_pressure_shown_carries_the_force_of_the_finger(held: Play) -> None:
    state, model = held.state(), held.scene.model
    for finger, tip in enumerate(model.fingertips()):
        patch = patch_of(state, tip)
        surface = held.hand.surface(finger)
        assert surface is not None
        points = model.bodies[tip].points.copy()
        points[state.moved[tip].indices] = state.moved[tip].points
        shown = float(pressure_at(points, patch) @ surface.areas)
        assert shown == pytest.approx(state.normal_forces[finger], rel=0.1), finger
    assert (patch.status[patch.pressures > 0] == STICK).mean() > 0.5


def test_a_sensor_shows_pressure_where_it_is_and_nothing_elsewhere(held: Play) -> None:
    state = held.state()
    picture = Tactile(held.scene.model).picture(state, 50e3)
    assert picture.shape == (2 * (HEADING + SIDE), 3 * SIDE + 16, 3)
    middle, rim = picture[HEADING + SIDE // 2, SIDE // 2].astype(int), picture[HEADING + SIDE // 2, 22].astype(int)
    assert middle[1] > rim[1] + 30, (middle, rim)  # viridis grows greener
    assert (picture[HEADING + 1, 1] > 250).all()  # beside the pad
    for row in (HEADING, HEADING + SIDE - 1):
        assert (picture[row] > 250).all(), "the whole rim of every pad is in the picture"


def test_a_sensor_shows_shear_below_pressure_and_arrows_point_where_the_pad_is_drawn(held: Play) -> None:
    state = held.state()
    picture = Tactile(held.scene.model).picture(state, 50e3).astype(int)
    below = picture[2 * HEADING + SIDE :, :SIDE]
    white = (below > 250).all(axis=2)
    pad = (picture[HEADING : HEADING + SIDE, :SIDE] <= 250).any(axis=2)  # the same shape above, where there are no arrows
    arrows = white & pad
    assert arrows.sum() > 40, f"{arrows.sum()} px of arrows of shear"
    assert not (white & pad)[: SIDE // 8].any(), "where nothing presses there are none"
    # The box hangs from the pads by friction: their skin is drawn down. An arrow's head is wider than its shaft, and below.
    rows, columns = np.nonzero(arrows)
    lonely = {(r, c) for r, c in zip(rows, columns, strict=True)}
    tips = [(r, c) for r, c in lonely if {(r - 1, c - 1), (r - 1, c + 1)} <= lonely and (r + 1, c) not in lonely]
    upward = [(r, c) for r, c in lonely if {(r + 1, c - 1), (r + 1, c + 1)} <= lonely and (r - 1, c) not in lonely]
    assert len(tips) > len(upward), f"{len(tips)} arrows point down, {len(upward)} up"


def test_a_vector_field_is_spread_component_by_component() -> None:
    rng = np.random.default_rng(5)
    points, spots, areas = rng.random((50, 3)), rng.random((12, 3)), np.full(12, 0.02)
    field = rng.standard_normal((12, 2))
    both = spread(points, spots, np.abs(field), areas)
    for column in (0, 1):
        np.testing.assert_allclose(both[:, column], spread(points, spots, np.abs(field[:, column]), areas), rtol=1e-5)
    assert spread(points, spots, -np.abs(field), areas).max() < 0.0, "a field may be negative"


def test_arrows_of_fingers_have_a_fixed_scale_but_none_leaves_the_picture(held: Play) -> None:
    state, server = held.state(), open_server("127.0.0.1", 8440, "test")
    try:
        drawing = SceneDrawing(server, held.scene.model, layers=Layers())
        for share in (1.0, 10.0):
            forces = share * state.finger_forces
            drawing.apply_layers()  # all of it anew: the contacts are the same
            drawing.draw(replace(state, finger_forces=forces))
            lines: Any = drawing._sum_lines._handle
            lengths = np.linalg.norm(lines.points[:3, 1] - lines.points[:3, 0], axis=1)  # the shafts come first
            sizes = np.linalg.norm(forces, axis=1)
            assert lengths == pytest.approx(sizes * min(0.012, 0.09 / sizes.max()), rel=1e-4)
    finally:
        close_server(server)
    assert sizes.max() > 0.09 / 0.012, "the second time it is about the limit"


def test_the_scale_grows_at_once_and_shrinks_late() -> None:
    scale = Scale(top=50e3)
    assert not scale.follow(40e3)
    assert scale.follow(120e3)
    assert scale.top == 200e3
    assert not scale.follow(90e3)
    assert scale.follow(20e3)
    assert scale.top == 20e3
    assert [nice_above(x) for x in (1.0, 1.1, 2.1, 5.1, 0.3)] == [1.0, 2.0, 5.0, 10.0, 0.5]


def test_a_slider_changes_the_physics_and_a_rebuild_brings_all_back() -> None:
    play = Play(OPTIONS)
    first = play.world.state_hash()
    for _ in range(1000):
        play.step()
        if play.phase == "holding":
            break
    play.lift(True)
    for _ in range(600):
        play.step()
    play.set_mass(0.25)
    for _ in range(400):
        play.step()
    assert play.state().finger_forces.sum(axis=0)[2] == pytest.approx(0.25 * 9.81, rel=0.01)
    up = play.object.position[2]
    play.set_friction(0.05)
    for _ in range(400):
        play.step()
    assert play.object.position[2] < up - 0.02
    play.build()
    assert play.world.state_hash() == first
    friction = float(np.sqrt(qr.Material.preset("wood").friction * qr.Material.preset("fingertip_pulp").friction))
    assert play.figures == Figures(4.0, pytest.approx(friction), 0.2, 9.81, "fingertip_pulp")
    # What the figures say is what the bodies are made of.
    stuff = [thing.material for thing in (play.hand, play.object)]
    assert np.prod([material.friction for material in stuff if material is not None]) == pytest.approx(friction**2)


def test_what_is_thrown_and_pushed_through_is_survived() -> None:
    play = Play(OPTIONS)
    play.aim_base(np.array([0.0, 0.0, -5.0]), np.array([0.0, 1.0, 0.0, 0.0]))
    play.pull(np.zeros(3), np.array([100.0, 0.0, 100.0]))
    start = play.hand.position
    for k in range(600):
        play.step()
        if k == 300:
            play.aim_finger(0, np.array([0.0, 0.0, 3.0]))
    travelled = float(np.linalg.norm(play.hand.position - start))
    assert travelled <= BASE_SPEED * 0.6 * 1.001, travelled
    state = play.state()
    assert np.isfinite(state.positions).all()
    assert "Reset" in play.phase
    play.build()
    assert play.hand.position == pytest.approx(start)
    assert play.phase == "closing"


def wait_for(true: Any, what: str, seconds: float = 30.0) -> None:
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, what
        time.sleep(0.01)


@pytest.fixture
def session() -> Iterator[Session]:
    running = Session(Play(OPTIONS))
    running.start()
    yield running
    running.stop()


def test_the_simulation_never_runs_ahead_of_the_clock(session: Session) -> None:
    session.set_speed(0.1)
    session.run(True)
    began = time.perf_counter()
    time.sleep(1.0)
    _, frame = session.newest()
    elapsed = time.perf_counter() - began
    assert 0.0 < frame.state.time <= 0.1 * elapsed + 0.01, (frame.state.time, elapsed)


def test_a_machine_that_is_too_slow_gives_slow_motion_and_says_so(session: Session) -> None:
    def said() -> str:
        frame = session.newest()[1]
        return html.figures("closing", frame.state.time, frame.real_time, frame.speed, 0.01, 3, running=frame.running)

    hindered, speed = [True], 0.2  # a fifth of real time: any machine can do that
    session.observe(lambda play: time.sleep(0.02 if hindered[0] else 0.0))
    session.set_speed(speed)
    session.run(True)
    wait_for(lambda: session.newest()[1].real_time < 0.5 * speed, "slow motion")
    assert "slow motion" in said()
    time.sleep(0.5)  # so much to catch up
    hindered[0] = False
    began, simulated = time.perf_counter(), session.newest()[1].state.time
    wait_for(lambda: "slow motion" not in said(), "time goes on at its pace once the hindrance is gone")
    made = session.newest()[1].state.time - simulated
    due = speed * (time.perf_counter() - began)
    assert made < due + speed * 0.1, f"{made:.3f} s of simulated time where {due:.3f} s were due: it caught up"


def test_nobody_looking_and_nobody_drawing_holds_nothing_up(session: Session) -> None:
    session.run(True)
    first = session.newest()[1].state.step
    time.sleep(0.3)
    wait_for(lambda: session.newest()[1].state.step > first + 50, "steps without a reader")


def test_a_refused_command_is_a_complaint_and_the_session_lives_on(session: Session) -> None:
    session.do(lambda play: play.set_friction(-1.0))
    session.do(lambda play: play.set_pad("no such stuff"))
    assert "friction" in session.complaints.get(timeout=10)
    assert "material" in session.complaints.get(timeout=10)
    session.single()
    wait_for(lambda: session.newest()[1].state.step == 1, "a step after all")


def test_a_recorder_that_fails_is_a_complaint_and_the_session_lives_on(session: Session) -> None:
    calls = []

    def full(_: Play) -> None:
        calls.append(1)
        raise qr.RecordingError("live.h5", "a file that can be written", "No space left on device", "free some space")

    session.observe(full)
    session.run(True)
    assert "No space left" in session.complaints.get(timeout=10)
    wait_for(lambda: session.newest()[1].state.step > 20, "steps after all")
    assert len(calls) == 1


def test_what_happens_live_is_recorded_and_a_reset_begins_another_file(tmp_path: Path) -> None:
    play, recorder = Play(OPTIONS), LiveRecorder(tmp_path / "live.h5")
    recorder.begin(play)
    for steps in (130, 20):
        for _ in range(steps):
            play.step()
            recorder(play)
        last = play.state().positions
        play.build()
    (tmp_path / "live-3.h5").write_text("of yesterday")
    recorder.begin(play)  # nothing comes of it
    recorder.close()
    assert [path.name for path in recorder.paths] == ["live.h5", "live-2.h5"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["live-2.h5", "live-3.h5", "live.h5"]
    assert (tmp_path / "live-3.h5").read_text() == "of yesterday"
    assert recorder.waited == 0.0
    for name, steps in (("live.h5", 130), ("live-2.h5", 20)):
        with qr.SceneRecording(tmp_path / name) as back:
            assert (len(back), back.columns.complete) == (steps, True)
    with qr.SceneRecording(tmp_path / "live-2.h5") as back:
        np.testing.assert_array_equal(back.state(-1).positions, last)


@pytest.mark.parametrize("name", SHAPES)
def test_built_in_shapes_can_be_held(name: str) -> None:
    play = Play(OPTIONS, lambda options, friction, _: built_in(name, options, friction))
    for _ in range(2500):
        play.step()
        if play.phase == "holding":
            break
    assert play.phase == "holding"
    play.lift(True)
    for _ in range(1500):
        play.step()
    state = play.state()
    assert state.finger_forces.sum(axis=0)[2] == pytest.approx(0.2 * 9.81, rel=0.02)


def test_uploads_are_refused_for_what_is_wrong_with_them() -> None:
    with pytest.raises(qr.ObjectFileError, match="at most"):
        from_upload("big.stl", b"0" * (LARGEST_UPLOAD + 1), OPTIONS, 0.7, 600.0)
    with pytest.raises(qr.ObjectFileError, match="expected one of"):
        from_upload("notes.docx", b"hello", OPTIONS, 0.7, 600.0)
    with pytest.raises(qr.QuasirigidError):
        from_upload("../../etc/egg.stl", b"solid nothing", OPTIONS, 0.7, 600.0)


def test_uploads_that_are_too_large_are_refused_when_they_are_announced(monkeypatch: pytest.MonkeyPatch) -> None:
    server = open_server("127.0.0.1", 8440, "test")
    told: list[str] = []
    notices: list[str] = []
    sent: list[Any] = []
    page = SimpleNamespace(
        client_id=0,
        add_notification=lambda title, *_, **__: notices.append(title),
        _websock_connection=SimpleNamespace(queue_message=sent.append),
    )
    monkeypatch.setattr(server, "get_clients", lambda: {0: page})
    try:
        gate = UploadGate(server, 1000, told.append)
        button = server.gui.add_upload_button("Load")
        link, waiting = server.gui._websock_interface, server.gui._current_file_upload_states

        def send(message: Any) -> None:
            for handler in link._incoming_handlers[type(message)]:
                handler(0, message)

        def announce(name: str, size: int, parts: int = 2) -> None:
            send(FileTransferStartUpload(button._impl.uuid, name, f"{name}.stl", "", parts, size))

        announce("large", 1001)
        assert told.pop().startswith("large.stl: expected at most 0 MB")
        # The page's own notice says "uploaded successfully".
        assert notices == ["large.stl is refused"]
        assert (type(sent[0]), sent[0].uuid) == (RemoveNotificationMessage, "upload-large")
        send(FileTransferPart(button._impl.uuid, "large", 0, b"0" * 500))
        assert waiting == {}, "its parts are dropped"
        for name in ("a", "b", "c"):
            announce(name, 1000)
        announce("d", 1000)
        assert "d.stl" in told.pop()
        assert set(waiting) == {"a", "b", "c"}
        send(FileTransferPart(button._impl.uuid, "a", 0, b"0" * 1001))
        assert "a" not in waiting, "it was to be of 1000 bytes"
        send(FileTransferPart(button._impl.uuid, "b", 0, b"0" * 600))
        send(FileTransferPart(button._impl.uuid, "b", 1, b"1" * 400))
        assert button.value.content == b"0" * 600 + b"1" * 400, "a file of the size that was said arrives"
        assert told == []
        announce("bad", 10, 1)
        gate.tell_refused(0, "bad.stl", "it is bad")
        assert notices[-1] == "bad.stl is refused"
        assert "upload-bad" in [message.uuid for message in sent]
    finally:
        close_server(server)


def test_the_next_free_port_is_taken_and_a_strange_host_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert free_port("127.0.0.1", port) > port
    with pytest.raises(qr.InvalidValueError, match="host"):
        free_port("192.0.2.1", 8080)
    for bad in (0, -1, 65536):
        with pytest.raises(qr.InvalidValueError, match="port"):
            free_port("127.0.0.1", bad)

    def reserved(*_: Any, **__: Any) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(socket, "create_server", reserved)
    with pytest.raises(qr.InvalidValueError, match="reserved"):
        free_port("127.0.0.1", 80)


@pytest.mark.parametrize(
    ("host", "url"),
    [
        ("127.0.0.1", "http://localhost:1"),
        ("0.0.0.0", "http://localhost:1"),
        ("::", "http://localhost:1"),
        ("::1", "http://[::1]:1"),
        ("fe80::2", "http://[fe80::2]:1"),
        ("10.0.0.7", "http://10.0.0.7:1"),
    ],
)
def test_addresses_can_be_opened_in_a_browser(host: str, url: str) -> None:
    assert page_url(host, 1) == url


def test_what_others_print_while_a_server_is_closed_is_not_lost(capsys: pytest.CaptureFixture[str]) -> None:
    server = open_server("127.0.0.1", 8450, "test")
    stop = server.stop

    def slowly() -> None:
        stop()
        print("mine")

    server.stop = slowly  # type: ignore[method-assign]
    close_server(server)
    assert capsys.readouterr().out == "mine\n", "and nothing of viser's"


def test_a_world_is_shown_while_its_owner_steps_it(capsys: pytest.CaptureFixture[str]) -> None:
    world = qr.World()
    ball = world.add_body(qr.Surface.sphere(0.02, points=800), qr.Material.preset("rubber"), mass=0.1, position=(0, 0, 1))
    with qr.view(world, browser=False, port=8420) as shown:
        said = capsys.readouterr().err
        assert "view of the world on http://localhost" in said
        assert "load files" not in said
        assert shown.url in said
        for _ in range(20):
            world.step(10)
            time.sleep(0.01)
        drawing = shown._page.drawing
        assert drawing is not None
        wait_for(lambda: drawing._frames[next(iter(drawing._frames))][1].position[2] < 0.9, "the fall is drawn")
        wait_for(lambda: "paused" in shown._page._status.content, "it rests")
        report = world.report
        assert report is not None
        assert shown._page._history[-1][2] == report.step_time > 0.0, "the time that a step takes"
        world.remove(ball)
        world.add_body(qr.Surface.box((0.02, 0.02, 0.02), points=800), qr.Material.preset("rubber"), mass=0.1, name="cube")
        wait_for(lambda: [b.name for b in shown._scene.model.bodies] == ["cube"], "the new body is drawn")
        assert world.steps == 200  # looking is all it does


def test_the_command_says_where_the_page_is_and_that_it_is_open_to_the_network(capfd: pytest.CaptureFixture[str]) -> None:
    command = ["view", "--no-browser", "--seconds", "0.2", "--points", "2000", "--port", "8430"]
    assert main(command) == 0
    local = capfd.readouterr()
    assert local.out == ""
    assert "http://localhost:843" in local.err
    assert "open to the network" not in local.err
    assert main([*command, "--host", "0.0.0.0", "--run"]) == 0
    assert "open to the network" in capfd.readouterr().err
