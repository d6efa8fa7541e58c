"""The picture of the grasp: made from a recording alone, with every figure in it; and the renderer below it."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

from quasirigid._quasirigid import Hand, HandModel, Surface, World
from quasirigid.grasp.figures.plots import friction_of
from quasirigid.grasp.figures.scene import HEIGHT, WIDTH, save_scene, scene
from quasirigid.grasp.figures.scene_data import read_shot
from quasirigid.grasp.options import GraspOptions
from quasirigid.grasp.run import run_grasp
from quasirigid.recording.reader import Recording
from quasirigid.render.camera import Camera
from quasirigid.render.ground import view_of
from quasirigid.render.layer import creases, halved, outline, shade
from quasirigid.render.triangles import rasterise
from quasirigid.scene.meshes import Mesh, tapered_capsule, triangulate
from quasirigid.scene.sharp_edges import sharpened
from quasirigid.units import force_words

RED = np.array([1.0, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short grasp of a coarse box."""
    out = tmp_path_factory.mktemp("grasp")
    result = run_grasp(GraspOptions(points=3_000, hold=0.2, dt=2e-3), out)
    assert out / "scene.png" in result.plots
    return out


def words(figure: Figure) -> str:
    return " | ".join(text.get_text() for text in [*figure.texts, *(t for axes in figure.axes for t in [*axes.texts, axes.xaxis.label])])


def test_picture_can_be_made_again_from_the_recording(run: Path, tmp_path: Path) -> None:
    with Recording(run / "recording.h5") as recording:
        assert save_scene(recording, tmp_path / "again") == [tmp_path / "again" / "scene.png"]
    again = (tmp_path / "again" / "scene.png").read_bytes()
    assert again == (run / "scene.png").read_bytes()
    assert len(again) < 500_000


@pytest.fixture(scope="module")
def figure(run: Path) -> Figure:
    with Recording(run / "recording.h5") as recording:
        shot = read_shot(recording)
    assert shot is not None
    drawn = scene(shot)
    drawn.canvas.draw()
    return drawn


def test_picture_says_mass_squeeze_forces_and_units(run: Path, figure: Figure) -> None:
    with Recording(run / "recording.h5") as recording:
        shot = read_shot(recording)
    assert shot is not None
    picture = np.asarray(figure.canvas.buffer_rgba())[..., :3]  # type: ignore[attr-defined]
    assert picture.shape == (HEIGHT, WIDTH, 3)
    assert (picture < 245).any(axis=2).mean() > 0.15
    said = words(figure)
    expected = ["Box", "200 g", "squeezed with 4 N", "m/s in the hand", "weight 1.96 N", "20 mm", "pressure (kPa)", "thumb"]
    for text in [*expected, "End of the first hold"]:
        assert text in said, said
    # Of each finger the figures of the other pictures: at that step the columns of the recording, which are the sums over its patch.
    for finger, (normal, friction) in enumerate(zip(shot.normal, shot.friction, strict=True)):
        assert f"presses {force_words(normal)}\nfriction {force_words(friction)}" in said, said
        mine = shot.patch(finger)
        push, along = friction_of(shot.contacts["force"][mine].astype(float), shot.contacts["normal"][mine].astype(float))
        assert abs(push.sum() - normal) < 1e-4 * normal
        assert abs(np.linalg.norm(along.sum(axis=0)) - friction) < 1e-4 * normal


@pytest.mark.parametrize("scale", [1.0, 1e-5, 27.3, 1.1e4])
def test_no_text_lies_over_another_or_beyond_the_picture_at_any_scale(run: Path, scale: float) -> None:
    with Recording(run / "recording.h5") as recording:
        shot = read_shot(recording)
    assert shot is not None
    contacts = shot.contacts | {name: scale * shot.contacts[name] for name in ("force", "reaction", "pressure")}
    sums = {name: scale * getattr(shot, name) for name in ("forces", "normal", "friction")}
    figures = {name: scale * float(shot.attributes[name]) for name in ("object_mass_kg", "squeeze_n")}
    attributes = shot.attributes | figures | {"object": f"a {'very ' * 20}long name of a $file$.obj"}
    figure = scene(replace(shot, contacts=contacts, attributes=attributes, **sums))
    figure.canvas.draw()
    for text in figure.findobj(Text):
        assert not re.search(r"\de[+-]\d", text.get_text()), text.get_text()
    drawn = [*figure.texts, *(t for axes in figure.axes for t in [*axes.texts, axes.xaxis.label, axes.yaxis.label])]
    boxes = [(t.get_text(), t.get_window_extent()) for t in drawn if t.get_text()]
    for i, (text, box) in enumerate(boxes):
        assert box.x0 >= 0
        assert box.x1 <= WIDTH, text
        assert box.y0 >= 0
        assert box.y1 <= HEIGHT, text
        for other, beside in boxes[:i]:
            assert not (box.x0 < beside.x1 and beside.x0 < box.x1 and box.y0 < beside.y1 and beside.y0 < box.y1), f"{text!r} over {other!r}"


def test_stills_say_units_and_frames_and_agree_with_the_columns(run: Path) -> None:
    with Recording(run / "recording.h5") as recording:
        stills = recording.stills("scene")
        step = int(stills["step"])
        np.testing.assert_allclose(stills["hand/pose"], recording["hand/pose"][step], atol=1e-12)
        assert recording.unit("scene/tips/points") == "m"
        assert recording.column("scene/object/points").frame == "world"
        phase = recording.labels("phase")[recording["phase"][step]]
        assert phase == "hold"
        assert recording["phase"][step + 1] != recording["phase"][step]
    assert np.abs(np.linalg.norm(stills["tips/normals"], axis=2) - 1.0).max() < 1e-5


def test_no_picture_of_an_object_that_was_dropped(tmp_path: Path) -> None:
    result = run_grasp(GraspOptions(points=3_000, hold=0.2, dt=2e-3, friction=0.02), tmp_path)
    assert not result.summary["held"]
    assert tmp_path / "scene.png" not in result.plots
    assert all(plot.exists() for plot in result.plots)


def test_link_poses_are_phalanges_apart_and_lead_to_the_tip() -> None:
    hand: Hand = World().add_hand(HandModel.three_finger(), position=(0.1, 0.2, 0.3), quaternion=(0.8, 0.0, 0.6, 0.0))
    hand.joint_positions = np.tile([0.1, 0.3, 0.5, 0.2], (3, 1))
    links = hand.link_poses
    assert links.shape == (3, 4, 7)
    np.testing.assert_allclose(np.linalg.norm(links[..., 3:], axis=2), 1.0, atol=1e-12)
    between = np.linalg.norm(np.diff(links[..., :3], axis=1), axis=2)
    np.testing.assert_allclose(between, np.tile([0.0, 0.045, 0.028], (3, 1)), atol=1e-12)
    # The tip is fixed to the last link: the same distance whatever the joints do.
    apart = np.linalg.norm(hand.tip_poses()[0] - links[:, 3, :3], axis=1)
    hand.joint_positions = np.zeros((3, 4))
    np.testing.assert_allclose(np.linalg.norm(hand.tip_poses()[0] - hand.link_poses[:, 3, :3], axis=1), apart, atol=1e-12)


@pytest.mark.parametrize("turn", [(1.0, 0, 0, 0), (0.5**0.5, 0, 0, 0.5**0.5), (0.5**0.5, 0, 0.5**0.5, 0), (0.5**0.5, 0.5**0.5, 0, 0)])
def test_palm_is_never_in_front_of_the_object(turn: tuple[float, ...]) -> None:
    w, x, y, z = turn
    up = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    view = view_of(np.array([*(0.085 * up), *turn]), np.zeros(3))
    assert abs(np.linalg.norm(view) - 1.0) < 1e-12
    assert view[2] > 0.2
    assert view @ up < 0.8, f"seen from behind the palm: {view @ up:.2f}"


def ball(radius: float = 0.02) -> Mesh:
    """A sphere about the origin as points, normals and triangles."""
    return tapered_capsule(np.zeros(3), np.zeros(3), radius, radius, around=96, caps=48)


CAMERA = Camera.towards(np.array([1.0, -1.0, 0.5]), np.array([0.0, 0.0, 1.0]), np.zeros(3), 3000.0, (160, 140))


def test_drawn_ball_is_a_disc_with_the_ball_s_depth_and_normals() -> None:
    points, normals, faces = ball()
    layer = rasterise(CAMERA, points, normals, RED, faces)
    x, y = (np.arange(160) + 0.5 - 80) / 3000, (70 - np.arange(140) - 0.5) / 3000
    r = np.hypot(*np.meshgrid(x, y))
    area = layer.drawn.sum() / 3000**2
    assert abs(area / (np.pi * 0.02**2) - 1.0) < 0.005, area
    inner = r < 0.015
    depth = np.sqrt(np.clip(0.02**2 - r**2, 0, None))
    assert np.abs(layer.depth - depth)[inner].max() < 1e-4
    assert np.abs(layer.normal[..., 0] - x[None, :] / 0.02)[inner].max() < 0.03
    np.testing.assert_allclose(layer.colour[inner], np.broadcast_to(RED, (inner.sum(), 4)), atol=1e-6)
    lit = shade(layer, 3000.0)
    assert lit.min() >= 0.0
    assert lit.max() <= 1.0
    assert lit[40, 60, 0] > lit[100, 100, 0], "lit from above, on the left"
    assert outline(layer, 2e-3)[inner].max() == 0.0
    assert halved(lit).shape == (70, 80, 3)


def test_nearer_layer_wins() -> None:
    points, normals, faces = ball()
    near = rasterise(CAMERA, points + 0.05 * CAMERA.axes[:, 2], normals, RED, faces)
    far = rasterise(CAMERA, 1.3 * points, normals, RED[[1, 0, 2, 3]], faces)
    for both in (near.over(far), far.over(near)):
        assert np.abs(both.colour[near.drawn][:, 0] - 1.0).max() < 1e-6
        assert both.drawn.sum() == (near.drawn | far.drawn).sum()


def test_a_sharpened_box_has_the_silhouette_and_the_edges_of_the_box() -> None:
    surface = Surface.box((0.03, 0.03, 0.03), points=2_000)
    points, normals, faces = sharpened(surface.points, surface.normals, triangulate(surface.points, surface.normals))
    layer = rasterise(CAMERA, points, normals, RED, faces)
    shown = np.abs(CAMERA.axes[:, 2]).sum() * 0.03**2
    share = layer.drawn.sum() / 3000**2 / shown
    assert abs(share - 1.0) < 0.01, f"{share:.4f} of the box's silhouette"
    assert 0 < creases(layer).sum() < 0.15 * layer.drawn.sum()


def test_tube_is_as_long_and_as_thick_as_asked() -> None:
    points, normals, _ = tapered_capsule(np.zeros(3), np.array([0.0, 0.0, 0.04]), 0.006, 0.004)
    assert abs(points[:, 2].min() + 0.006) < 1e-12
    assert abs(points[:, 2].max() - 0.044) < 1e-12
    assert np.hypot(points[:, 0], points[:, 1]).max() < 0.006 + 1e-12
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-12)
