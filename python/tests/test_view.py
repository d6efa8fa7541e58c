"""The live view without a browser: meshes through the points, the clock, what is changed between steps, what is refused."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from viser._messages import FileTransferPart, FileTransferStartUpload

import quasirigid as qr
from quasirigid.grasp_options import GraspOptions
from quasirigid.objects.sampling import sample_mesh
from quasirigid.summary import rotate
from quasirigid.view import words
from quasirigid.view.detail import FAR, PadDetail
from quasirigid.view.meshes import SAGITTA, in_drawing_order, is_convex, mirrored, tapered_capsule, thinned, triangulate
from quasirigid.view.parts import OUT_OF_SIGHT, Joined, LinePool, PatchPool
from quasirigid.view.play import BASE_SPEED, Play
from quasirigid.view.pressure import STICK, Scale, matrix_of, nice_above, patch_of, pressure_at
from quasirigid.view.scene import Moved
from quasirigid.view.session import Session
from quasirigid.view.stage import close_server, free_port, open_server
from quasirigid.view.tactile import HEADING, SIDE, Tactile
from quasirigid.view.things import LARGEST_UPLOAD, SHAPES, built_in, from_upload
from quasirigid.view.unlit import unlit_glb
from quasirigid.view.uploads import UploadGate
from quasirigid.world_recorder import LiveRecorder

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


def enclosed(points: Any, faces: Any) -> Any:
    return trimesh.Trimesh(points, faces, process=False)


@settings(max_examples=15, deadline=None, suppress_health_check=list(HealthCheck))
@given(size=st.tuples(*[st.floats(0.01, 0.2)] * 3), n=st.integers(400, 3000))
def test_a_box_is_closed_and_encloses_nearly_its_volume(size: tuple[float, float, float], n: int) -> None:
    surface = qr.Surface.box(size, points=n)
    faces = triangulate(surface.points, surface.normals)
    mesh = enclosed(surface.points, faces)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert len(np.unique(faces)) == n
    # What is missing is the bevel along the edges, half a spacing wide.
    lost = sum(size) * 4 * surface.spacing**2
    assert np.prod(size) - lost <= mesh.volume <= np.prod(size) * (1 + 1e-9), (mesh.volume, np.prod(size))


@pytest.mark.parametrize(
    ("surface", "volume"),
    [
        (qr.Surface.sphere(0.03, points=12_000), 4 / 3 * np.pi * 0.03**3),
        (qr.Surface.capsule(0.02, 0.05, points=12_000), np.pi * 0.02**2 * (0.05 + 4 / 3 * 0.02)),
        (qr.Surface.cylinder(0.03, 0.08, points=12_000), np.pi * 0.03**2 * 0.08),
    ],
    ids=["sphere", "capsule", "cylinder"],
)
def test_round_shapes_are_closed_and_enclose_their_volume_with_fewer_triangles_too(surface: qr.Surface, volume: float) -> None:
    mesh = enclosed(surface.points, triangulate(surface.points, surface.normals))
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(volume, rel=0.01)
    few = thinned(surface.points, surface.normals)
    assert few is not None
    coarse = enclosed(surface.points[few[0]], few[1])
    assert coarse.is_watertight
    assert len(few[0]) < 0.8 * len(surface.points)
    # A shell of the thickness that is promised is the most that may be missing.
    assert abs(mesh.volume - coarse.volume) < SAGITTA * mesh.area, (mesh.volume, coarse.volume)


@settings(max_examples=10, deadline=None, suppress_health_check=list(HealthCheck))
@given(size=st.tuples(*[st.floats(0.01, 0.2)] * 3), n=st.integers(2000, 8000))
def test_of_a_box_the_corners_are_enough(size: tuple[float, float, float], n: int) -> None:
    surface = qr.Surface.box(size, points=n)
    few = thinned(surface.points, surface.normals)
    assert few is not None
    kept, faces = few
    mesh = enclosed(surface.points[kept], faces)
    assert mesh.is_watertight
    assert len(kept) < 0.05 * n, len(kept)
    # Convex: how deep a point is, is its distance to the nearest of the planes.
    broad = mesh.area_faces > 1e-6 * mesh.area  # the hull of points in a row has triangles without area, which have no plane
    normals, corners = mesh.face_normals[broad], mesh.triangles[broad, 0]
    depth = -(normals @ surface.points.T - np.einsum("ij,ij->i", normals, corners)[:, None]).max(axis=0)
    assert depth.max() <= SAGITTA * (1 + 1e-9), depth.max()
    assert depth.min() > -1e-7, depth.min()


@pytest.mark.parametrize("n", [300, 3000])
def test_the_drawing_order_has_the_same_triangles_and_computes_few_vertices_twice(n: int) -> None:
    surface = qr.Surface.sphere(0.03, points=n)
    faces = triangulate(surface.points, surface.normals)
    ordered = in_drawing_order(faces, n)
    assert sorted(map(tuple, ordered.tolist())) == sorted(map(tuple, faces.tolist()))
    recent: list[int] = []
    computed = 0
    for vertex in ordered.ravel().tolist():
        if vertex not in recent:
            computed += 1
            recent = [vertex, *recent[:31]]
    assert computed < 0.85 * len(faces), computed / len(faces)  # in the order of the hull nearly three for each triangle
    assert len(in_drawing_order(np.zeros((0, 3), np.int64), n)) == 0


def test_a_body_with_dents_is_told_from_one_without() -> None:
    torus = trimesh.creation.torus(0.04, 0.015)
    assert not is_convex(np.asarray(torus.vertices), np.asarray(torus.faces))
    for surface in (qr.Surface.box((0.06, 0.06, 0.08), points=3000), qr.Surface.sphere(0.03, points=1000)):
        assert is_convex(surface.points, triangulate(surface.points, surface.normals))


class Recorder:
    """Stands for a server: keeps what nodes were made with and what was assigned to them."""

    def __init__(self) -> None:
        self.scene = self
        self.made: list[Any] = []

    def __getattr__(self, name: str) -> Any:
        def make(_path: str, *given: Any, **named: Any) -> Any:
            self.made.append(SimpleNamespace(kind=name, given=[np.array(g) for g in given], visible=True, **named))
            return self.made[-1]

        return make


def test_joined_bodies_are_where_their_poses_and_the_deformed_points_say() -> None:
    rng = np.random.default_rng(5)
    tip = qr.Surface.fingertip((0.009, 0.009, 0.008))
    faces = triangulate(tip.points, tip.normals)
    server: Any = Recorder()
    group = Joined(server, "/pads", [(2, tip.points, faces), (0, tip.points, faces)], (1.0, 1.0, 1.0))
    quaternions = rng.normal(size=(3, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1)[:, None]
    positions = rng.normal(size=(3, 3))
    moved = Moved(np.array([3, 5, 8]), tip.points[[3, 5, 8]] * 0.9)
    group.deform(0, moved)
    assert group.place(positions, matrix_of(quaternions), np.zeros(3, bool))
    assert not group.place(positions, matrix_of(quaternions), np.zeros(3, bool))  # nothing has changed
    yielded = tip.points.copy()
    yielded[moved.indices] = moved.points
    for part, (body, points) in enumerate([(2, yielded), (0, tip.points)]):
        wanted = rotate(quaternions[body], points) + positions[body]
        off = np.abs(group.handle.vertices[group.rows[part]] - wanted).max()
        assert off < 1e-6, off
    # Triangles are those of the surface.
    drawn = server.made[0].given[1]
    back = np.argsort(group.rows[0])
    assert sorted(map(tuple, back[drawn[: len(faces)]].tolist())) == sorted(map(tuple, faces.tolist()))


def test_coloured_points_move_without_new_colours() -> None:
    server: Any = Recorder()
    pool = PatchPool(server, "/patches", 1e-3)
    table = np.arange(12, dtype=np.uint8).reshape(4, 3)
    rng = np.random.default_rng(3)
    for n in (10, 12, 0, 9):
        levels, points = rng.integers(0, 4, n), rng.normal(size=(n, 3)).astype(np.float32)
        pool.arrange(levels, table)
        pool.move(points)
        cloud = server.made[-1]
        places = getattr(cloud, "points", cloud.given[0])
        seen = (places != np.float32(OUT_OF_SIGHT)).any(axis=1)
        shown = sorted((*p, *c) for p, c in zip(places[seen].tolist(), cloud.given[1][seen].tolist(), strict=True))
        assert shown == sorted((*p, *c) for p, c in zip(points.tolist(), table[levels].tolist(), strict=True))
    assert len(server.made) == 1
    pool.arrange(np.zeros(100, np.int64), table)
    pool.move(np.ones((100, 3), np.float32))
    assert len(server.made) == 2  # more of one colour than there was room for


def test_lines_keep_little_room() -> None:
    server: Any = Recorder()
    pool = LinePool(server, "/lines", 1.0)
    for n, room in ((100, 128), (120, 128), (3, 16), (0, 16)):
        pool.show(np.ones((n, 2, 3)), np.zeros((n, 3), np.uint8))
        assert len(server.made[-1].given[0]) == room
    assert not server.made[-1].visible


def test_flat_colour_is_a_file_that_others_read() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.5]])
    file = unlit_glb(points, np.array([[0, 1, 2], [0, 2, 3]]), np.array([0.2, 0.4, 0.6], np.float32))
    mesh = trimesh.load(BytesIO(file), file_type="glb", force="mesh")
    assert mesh.area == pytest.approx(trimesh.Trimesh(points, [[0, 1, 2], [0, 2, 3]]).area)
    assert np.abs(mesh.bounds - [[0, 0, 0], [1, 1, 0.5]]).max() < 1e-6
    lines = unlit_glb(points, np.array([[0, 1], [2, 3], [1, 2]]), np.ones((4, 4), np.float32), see_through=True)
    paths = trimesh.load(BytesIO(lines), file_type="glb")
    assert sum(path.length for path in paths.geometry.values()) == pytest.approx(1.0 + np.sqrt(1.25) + 1.0)


def test_a_surface_that_is_not_seen_from_within_is_triangulated_by_its_cocone() -> None:
    torus = trimesh.creation.torus(0.04, 0.015, major_sections=80, minor_sections=36)
    points, face, _ = sample_mesh(torus.vertices, torus.faces, 4000, np.random.default_rng(0))
    surface = qr.Surface.from_points(points, torus.face_normals[face])
    assert thinned(surface.points, surface.normals) is None
    faces = triangulate(surface.points, surface.normals)
    mesh = enclosed(surface.points, faces)
    assert len(np.unique(faces)) > 0.99 * len(points)
    assert mesh.area == pytest.approx(4 * np.pi**2 * 0.04 * 0.015, rel=0.02)
    # All look outwards.
    centres = mesh.triangles_center
    ring = 0.04 * centres[:, :2] / np.linalg.norm(centres[:, :2], axis=1)[:, None]
    outward = centres - np.column_stack([ring, np.zeros(len(ring))])
    assert (np.einsum("ij,ij->i", outward, mesh.face_normals) > 0).all()


def test_a_pad_stays_open_and_its_back_closes_it() -> None:
    tip = qr.Surface.fingertip((0.009, 0.009, 0.008))
    faces = triangulate(tip.points, tip.normals)
    mesh = enclosed(tip.points, faces)
    assert not mesh.is_watertight
    assert (np.einsum("ij,ikj->ik", mesh.face_normals, tip.normals[faces]) > 0.5).all()
    up = np.array([0.0, 0.0, 1.0])
    back, _, back_faces = mirrored(tip.points, tip.normals, faces, up, thickness=1.0)
    assert back[:, 2].max() <= tip.points[:, 2].min() + 1e-9
    assert len(back_faces) < 0.5 * len(faces)


def test_a_tapered_capsule_is_closed() -> None:
    points, normals, faces = tapered_capsule(np.zeros(3), np.array([0.0, 0.0, 0.05]), 0.01, 0.006)
    mesh = trimesh.Trimesh(points, faces)  # ends are merged
    assert mesh.volume == pytest.approx(np.pi * 0.05 / 3 * (1e-4 + 6e-5 + 3.6e-5) + 2 / 3 * np.pi * (1e-6 + 2.16e-7), rel=0.06)
    assert np.linalg.norm(normals, axis=1) == pytest.approx(np.ones(len(points)))


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
    assert picture.shape == (HEADING + SIDE, 3 * SIDE + 16, 3)
    middle, rim = picture[HEADING + SIDE // 2, SIDE // 2].astype(int), picture[HEADING + SIDE // 2, 22].astype(int)
    assert middle[1] > rim[1] + 30, (middle, rim)  # viridis grows greener
    assert (picture[HEADING + 1, 1] > 250).all()  # beside the pad


def test_the_scale_grows_at_once_and_shrinks_late() -> None:
    scale = Scale(top=50e3)
    assert not scale.follow(40e3)
    assert scale.follow(120e3)
    assert scale.top == 200e3
    assert not scale.follow(90e3)
    assert scale.follow(20e3)
    assert scale.top == 20e3
    assert [nice_above(x) for x in (1.0, 1.1, 2.1, 5.1, 0.3)] == [1.0, 2.0, 5.0, 10.0, 0.5]


def test_a_slider_changes_the_physics_and_a_rebuild_brings_all_back(held: Play) -> None:
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
    assert play.figures == held.figures.__class__(4.0, play.figures.friction, 0.2, 9.81, "fingertip_pulp")


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
    session.observe(lambda _: time.sleep(0.01))
    session.run(True)
    wait_for(lambda: session.newest()[1].real_time < 0.5, "slow motion")
    text = words.figures("closing", 1.0, session.newest()[1].real_time, 1.0, 0.01, 3, running=True)
    assert "slow motion" in text
    # It does not try to catch up: once the hindrance is gone, time goes on at its pace.
    assert "slow motion" not in words.figures("closing", 1.0, 1.0, 1.0, 0.01, 3, running=True)


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
    recorder.begin(play)  # nothing comes of it
    recorder.close()
    assert [path.name for path in recorder.paths] == ["live.h5", "live-2.h5"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["live-2.h5", "live.h5"]
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


def test_uploads_that_are_too_large_are_refused_when_they_are_announced() -> None:
    server = open_server("127.0.0.1", 8440, "test")
    told: list[str] = []
    try:
        UploadGate(server, 1000, told.append)
        button = server.gui.add_upload_button("Load")
        link, waiting = server.gui._websock_interface, server.gui._current_file_upload_states

        def send(message: Any) -> None:
            for handler in link._incoming_handlers[type(message)]:
                handler(0, message)

        def announce(name: str, size: int, parts: int = 2) -> None:
            send(FileTransferStartUpload(button._impl.uuid, name, f"{name}.stl", "", parts, size))

        announce("large", 1001)
        assert told.pop().startswith("large.stl: expected at most 0 MB")
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
    finally:
        close_server(server)


def test_the_next_free_port_is_taken_and_a_strange_host_is_refused() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert free_port("127.0.0.1", port) > port
    with pytest.raises(qr.InvalidValueError, match="host"):
        free_port("192.0.2.1", 8080)
    for bad in (0, -1, 65536):
        with pytest.raises(qr.InvalidValueError, match="port"):
            free_port("127.0.0.1", bad)


def test_a_world_is_shown_while_its_owner_steps_it(capsys: pytest.CaptureFixture[str]) -> None:
    world = qr.World()
    ball = world.add_body(qr.Surface.sphere(0.02, points=800), qr.Material.preset("rubber"), mass=0.1, position=(0, 0, 1))
    with qr.view(world, browser=False, port=8420) as shown:
        assert "live view on http://localhost" in capsys.readouterr().err
        for _ in range(20):
            world.step(10)
            time.sleep(0.01)
        drawing = shown._page.drawing
        assert drawing is not None
        wait_for(lambda: drawing._frames[next(iter(drawing._frames))][1].position[2] < 0.9, "the fall is drawn")
        world.remove(ball)
        world.add_body(qr.Surface.box((0.02, 0.02, 0.02), points=800), qr.Material.preset("rubber"), mass=0.1, name="cube")
        wait_for(lambda: [b.name for b in shown._scene.model.bodies] == ["cube"], "the new body is drawn")
        assert world.steps == 200  # looking is all it does


def test_the_command_says_where_the_page_is_and_that_it_is_open_to_the_network(tmp_path: Path) -> None:
    environment = {**os.environ, "BROWSER": "true"}
    command = [sys.executable, "-m", "quasirigid.cli", "view", "--no-browser", "--seconds", "0.2", "--points", "2000", "--port", "8430"]
    local = subprocess.run(command, capture_output=True, text=True, timeout=120, env=environment)
    assert local.returncode == 0, local.stderr
    assert local.stdout == ""
    assert "http://localhost:843" in local.stderr
    assert "open to the network" not in local.stderr
    wide = subprocess.run([*command, "--host", "0.0.0.0", "--run"], capture_output=True, text=True, timeout=120, env=environment)
    assert wide.returncode == 0, wide.stderr
    assert "open to the network" in wide.stderr
    wrong = subprocess.run([*command[:-1], "0"], capture_output=True, text=True, timeout=120, env=environment)
    assert wrong.returncode == 2
    assert wrong.stderr.count("\n") == 1, wrong.stderr


def test_pads_have_all_their_triangles_where_they_yield_and_few_elsewhere() -> None:
    play = Play(OPTIONS)
    model = play.scene.model
    body = model.bodies[model.fingertips()[0]]
    detail = PadDetail(body)
    at_rest = len(detail.faces)
    assert at_rest < 0.3 * len(body.faces), f"{at_rest} of {len(body.faces)} triangles at rest"
    mesh = trimesh.Trimesh(body.points, detail.faces, process=False)
    # A pad is convex: how deep a point is, is its distance to the nearest of the planes.
    depth = -(mesh.face_normals @ body.points.T - np.einsum("ij,ij->i", mesh.face_normals, mesh.triangles[:, 0])[:, None]).max(axis=0)
    assert depth.max() < 1.2 * FAR, f"{1e3 * depth.max():.3f} mm from the triangles"
    top = body.points[(body.points @ body.normals.mean(axis=0)).argmax()]
    for radius in (1e-3, 2e-3, 4e-3):
        near = np.flatnonzero(np.linalg.norm(body.points - top, axis=1) < radius)
        moved = Moved(near, body.points[near] - 2e-4 * body.normals[near])
        detail.follow(moved)
        yielded = body.points.copy()
        yielded[near] = moved.points
        # Every point that yields is a corner of a triangle, so the page shows it where it is.
        missing = np.setdiff1d(near, detail.faces)
        assert len(missing) == 0, f"{len(missing)} of {len(near)} points that yield have no triangle"
        assert len(detail.faces) < len(body.faces)
    assert not detail.follow(moved), "nothing has changed"
    assert detail.follow(None)
    assert len(detail.faces) == at_rest
