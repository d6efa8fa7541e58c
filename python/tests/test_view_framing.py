"""What the page's camera has in its picture, and that worlds of any size are drawn alike."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import quasirigid as qr
from quasirigid.grasp.options import GraspOptions
from quasirigid.live.framing import FOV, SHEET, VIEW, Frame, Framing, frame_of, pads_in_sight
from quasirigid.live.play import Play
from quasirigid.live.stage import close_server, open_server
from quasirigid.recording.scene_recording import SceneRecording
from quasirigid.render.camera import Camera
from quasirigid.render.pictures import Renderer, RenderOptions
from quasirigid.render.triangles import rasterise
from quasirigid.rotation import rotate
from quasirigid.scene.model import SceneModel, SceneState
from quasirigid.scene.scaling import drawing_scale, scaled_model, scaled_state
from quasirigid.scene.world import WorldScene


def seen(points: np.ndarray, frame: Frame, aspect: float, towards: np.ndarray | None = None) -> np.ndarray:
    """Places (n, 2) in the picture, -1 to 1 from its left and lower rim."""
    position, look_at = frame.camera(aspect, towards)
    back = (position - look_at) / np.linalg.norm(position - look_at)
    right = np.cross([0.0, 0.0, 1.0], back)
    right = right / np.linalg.norm(right) if np.linalg.norm(right) > 1e-6 else np.array([1.0, 0.0, 0.0])
    x, y, z = ((points - position) @ np.column_stack([right, np.cross(back, right), -back])).T
    assert (z > 0.0).all(), "all points are in front of the camera"
    half = np.tan(0.5 * FOV)
    return np.column_stack([x / (half * aspect * z), y / (half * z)])


@pytest.mark.parametrize("aspect", [390 / 844, 652 / 720, 1.3, 2.4])
@pytest.mark.parametrize("towards", [VIEW, np.array([0.0, -1.0, 0.0]), np.array([0.0, 0.0, 1.0])])
def test_all_that_shall_be_seen_is_in_the_picture_of_any_window_and_above_the_sheet_of_a_phone(aspect: float, towards: np.ndarray) -> None:
    rng = np.random.default_rng(7)
    for size in ([0.2, 0.2, 0.2], [0.6, 0.02, 0.05], [0.02, 0.7, 0.03], [0.05, 0.05, 0.5]):
        points = (rng.random((300, 3)) - 0.3) * size
        places = seen(points, Frame(points, VIEW), aspect, towards)
        lowest = -1.0 + 2.0 * (SHEET if aspect < 0.65 else 0.0)
        where = f"{places.min(axis=0)} to {places.max(axis=0)} of a picture from (-1, {lowest:.2f}) to (1, 1)"
        assert np.abs(places[:, 0]).max() <= 1.0, where
        assert places[:, 1].max() <= 1.0, where
        assert places[:, 1].min() >= lowest - 0.02, where
        filled = np.ptp(places, axis=0) / [2.0, 1.0 - lowest]
        assert filled.max() > 0.5, f"only {100 * filled.max():.0f} % of the picture are used"


def shares_of_pads(model: SceneModel, state: SceneState, towards: np.ndarray) -> list[float]:
    """Of each pad, its pixels among those that it would have if nothing were in front and it were seen straight on."""
    tips = model.fingertips()
    opaque = [*tips, *(i for i, body in enumerate(model.bodies) if body.kind == "link" and len(body.faces))]
    points, normals, colours, faces, first = [], [], [], [], 0
    for i in opaque:
        body = model.bodies[i]
        points.append(rotate(state.quaternions[i], body.points) + state.positions[i])
        normals.append(rotate(state.quaternions[i], body.normals))
        colours.append(np.tile(np.eye(4)[tips.index(i)] if i in tips else np.zeros(4), (len(body.points), 1)))
        faces.append(body.faces + first)
        first += len(body.points)
    centre = np.concatenate(points).mean(axis=0)
    camera = Camera.towards(towards, np.array([0.0, 0.0, 1.0]), centre, 1000.0, (400, 400))
    layer = rasterise(camera, np.concatenate(points), np.concatenate(normals), np.concatenate(colours), np.concatenate(faces))
    shares = []
    for k, tip in enumerate(tips):
        body = model.bodies[tip]
        corner = body.points[body.faces]
        flat = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]).sum(axis=0)) / 2.0
        shares.append(float((layer.colour[..., k] > 0.5).sum() / 1000.0**2 / flat))
    return shares


def test_the_camera_starts_with_every_pad_in_sight() -> None:
    play = Play(GraspOptions(points=2_000))
    model, state = play.scene.model, play.state()
    shares = shares_of_pads(model, state, pads_in_sight(model, state))
    assert min(shares) > 0.2, f"of the pads {[f'{100 * share:.0f} %' for share in shares]} are seen"


def own_world(size: float) -> qr.World:
    """A ball that falls beside a box, both about as large as ``size`` m."""
    world, rubber = qr.World(), qr.Material.preset("rubber")
    world.add_body(qr.Surface.half_space(6 * size, points=400), rubber, motion="fixed")
    mass = 500.0 * size**3
    world.add_body(qr.Surface.sphere(0.5 * size, points=400), rubber, mass=mass, position=(0.0, 0.0, 0.9 * size))
    world.add_body(qr.Surface.box((size, 0.6 * size, 0.5 * size), points=500), rubber, mass=mass, position=(1.4 * size, 0.0, 0.26 * size))
    return world


def test_worlds_of_a_centimetre_and_of_ten_metres_are_drawn_alike_and_on_the_same_bits_where_a_hand_fits(tmp_path: Path) -> None:
    pictures = {}
    for size in (0.01, 0.1, 10.0):
        world = own_world(size)
        scene = WorldScene(world)
        state = scene.state()
        scale = drawing_scale(scene.model, state)
        assert scale * size == pytest.approx(0.1), f"a world of {size} m is drawn as one of {scale * size} m"
        drawn, shown = scaled_model(scene.model, scale), scaled_state(state, scale)
        if size == 0.1:
            assert drawn is scene.model
            assert shown is state
        points = frame_of(drawn, shown).points
        assert 0.05 < np.ptp(points, axis=0).max() < 0.5
        path = tmp_path / f"{size}.h5"
        with qr.record(world, path) as recording:
            world.step()
            recording.append()
        with SceneRecording(path) as recorded:
            pictures[size] = Renderer(recorded, RenderOptions(size=(320, 180), labels=False)).frame(0).astype(float)
    for size in (0.01, 10.0):
        off = np.abs(pictures[size] - pictures[0.1]).mean()
        assert off < 1.0, f"the picture of a world of {size} m differs by {off:.2f} of 255 on average"


def test_the_picture_follows_bodies_that_leave_it_but_not_beyond_the_neighbourhood() -> None:
    world = own_world(0.1)
    scene = WorldScene(world)
    state = scene.state()
    server = open_server("127.0.0.1", 8447, "test")
    try:
        framing = Framing(server)
        framing.show(frame_of(scene.model, state))
        before = framing._frame.points
        framing.follow(scene.model, state)
        assert framing._frame.points is before, "all is in the picture"
        for away, followed in ((0.3, True), (50.0, False)):
            framing.show(Frame(before, VIEW))
            positions = state.positions.copy()
            positions[1] += [away, 0.0, 0.0]
            framing.follow(scene.model, replace(state, positions=positions))
            reach = framing._frame.points[:, 0].max()
            for _ in range(20):  # one that flies on is not followed for ever
                positions[1] += [0.1, 0.0, 0.0]
                framing.follow(scene.model, replace(state, positions=positions))
            assert np.ptp(framing._frame.points, axis=0).max() < 5.0 * np.linalg.norm(np.ptp(before, axis=0))
            positions[1] -= [2.0, 0.0, 0.0]
            assert (reach > positions[1, 0]) == followed, f"the ball is {away} m away, the picture reaches {reach:.2f} m"
    finally:
        close_server(server)
