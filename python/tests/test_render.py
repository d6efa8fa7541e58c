"""Pictures and films of a recording: they show box and pads, have the frames asked for, and need no browser."""

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from recorded import record_pinch

from quasirigid.cli.app import main
from quasirigid.errors import InvalidShapeError, InvalidValueError, MissingPackageError, QuasirigidError, UnknownNameError
from quasirigid.recording.scene_recording import SceneRecording
from quasirigid.recording.window import span
from quasirigid.render.camera import Camera
from quasirigid.render.layer import NOTHING
from quasirigid.render.media import Film, Frame, frame_steps, open_writer
from quasirigid.render.pictures import Renderer, RenderOptions, render, towards
from quasirigid.render.triangles import rasterise
from quasirigid.scene.meshes import outward
from quasirigid.scene.palette import PAD

SMALL = RenderOptions(size=(480, 270), fps=20.0)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run") / "run.h5"
    record_pinch(path)
    return path


def share_near(picture: np.ndarray, colour: tuple[float, ...], tolerance: float = 40.0) -> float:
    """Share of the pixels that have about this colour (0 to 255)."""
    return float((np.abs(picture[..., :3].astype(float) - colour).max(axis=-1) < tolerance).mean())


def test_triangles_are_drawn_where_they_are() -> None:
    camera = Camera.towards(np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0]), np.zeros(3), 100.0, (200, 100))
    points = np.array([[-0.5, -0.2, 0.0], [0.5, -0.2, 0.0], [0.5, 0.2, 0.4], [-0.5, 0.2, 0.4]])
    normals, red = np.tile([0.0, 0.0, 1.0], (4, 1)), np.array([1.0, 0.0, 0.0, 0.0])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    layer = rasterise(camera, points, normals, red, faces)
    assert layer.drawn.sum() == 100 * 40, "the square covers its pixels once, the diagonal included"
    assert layer.drawn[30:70, 50:150].all()
    rows = np.arange(30, 70)
    np.testing.assert_allclose(layer.depth[30:70, 100], (50 - rows - 0.5) / 100 + 0.2, atol=1e-6)
    np.testing.assert_allclose(layer.colour[50, 100], red, atol=1e-6)
    assert (layer.depth[~layer.drawn] == NOTHING).all()
    assert not rasterise(camera, points, normals, red, faces[:, ::-1]).drawn.any(), "seen from behind"
    np.testing.assert_array_equal(rasterise(camera, points, normals, red, faces[:, ::-1], back=True).drawn, layer.drawn)
    turned = outward(points, normals, faces[:, ::-1])
    np.testing.assert_array_equal(rasterise(camera, points, normals, red, turned).drawn, layer.drawn)


def test_nearer_triangle_hides_the_other_and_the_edge_of_the_picture_cuts() -> None:
    camera = Camera.towards(np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0]), np.zeros(3), 10.0, (20, 20))
    big = np.array([[-9.0, -9.0, 0.0], [9.0, -9.0, 0.0], [0.0, 20.0, 0.0]])
    small = np.array([[-0.5, -0.5, 1.0], [0.5, -0.5, 1.0], [0.0, 0.6, 1.0]])
    colours = np.repeat([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]], 3, axis=0)
    up = np.tile([0.0, 0.0, 1.0], (6, 1))
    layer = rasterise(camera, np.concatenate([big, small]), up, colours, np.array([[0, 1, 2], [3, 4, 5]]))
    assert layer.drawn.all()
    assert layer.colour[10, 10].tolist() == [0.0, 1.0, 0.0, 0.0]
    assert layer.colour[0, 0].tolist() == [1.0, 0.0, 0.0, 0.0]


def test_picture_shows_box_pads_and_forces(run: Path, tmp_path: Path) -> None:
    assert render(run, tmp_path / "end.png", RenderOptions(size=(960, 540))) == [tmp_path / "end.png"]
    picture = np.asarray(Image.open(tmp_path / "end.png"))
    assert picture.shape == (540, 960, 3)
    scene = picture[: 540 - 105, : 960 - 198]
    assert (scene < 245).any(axis=2).mean() > 0.12, "not blank"
    glass = scene.astype(int)
    assert ((glass[..., 2] - glass[..., 0] > 8) & (glass[..., 2] > 150)).mean() > 0.02, "the box is of bluish glass"
    assert share_near(scene, (225, 200, 185)) > 0.002, "pads"
    assert share_near(scene, (0, 114, 178)) > 0.001, "the thumb's arrow and joints"
    assert share_near(scene, (213, 94, 0)) > 0.0005, "the first finger's"
    pads = picture[: 540 - 105, 960 - 198 :]
    assert share_near(pads, tuple(255 * c for c in PAD)) > 0.02
    assert share_near(pads, (33, 145, 140), 45) > 0.005, "pressure in viridis"


def test_picture_follows_the_recording(run: Path) -> None:
    with SceneRecording(run) as recording:
        renderer = Renderer(recording, SMALL)
        first, last, again = renderer.frame(0), renderer.frame(len(recording) - 1), renderer.frame(0)
        np.testing.assert_array_equal(first, again)
        assert (np.abs(first.astype(int) - last).max(axis=2) > 30).mean() > 0.01, "fingers have moved"


def test_camera_sees_the_fingers_in_every_frame(run: Path) -> None:
    with SceneRecording(run) as recording:
        for name in ("auto", "front", "top", "-30,60"):
            renderer = Renderer(recording, RenderOptions(size=(480, 270), camera=name))
            width, height = renderer.camera.size
            for step in (0, len(recording) - 1):
                state = recording.state(step)
                seen = renderer.camera.project(state.positions[recording.model.fingertips()]) * renderer.camera.scale
                assert (np.abs(seen[:, :2]) < [width / 2, height / 2]).all()
        np.testing.assert_allclose(towards("right", recording, state), [1.0, 0.0, 0.0], atol=1e-12)
        np.testing.assert_allclose(towards("front", recording, state), [0.0, -1.0, 0.0], atol=1e-12)


def test_gif_and_frames_have_the_length_asked_for(run: Path, tmp_path: Path) -> None:
    options = RenderOptions(size=(320, 180), fps=20.0, start=0.05, end=0.45, labels=True)
    told: list[float] = []
    (gif,) = render(run, tmp_path / "film.gif", options, progress=lambda _, done: told.append(done))
    assert told == sorted(told)
    assert told[-1] == 1.0
    with Image.open(gif) as film:
        assert film.n_frames == 9  # 0.4 s at 20 a second, both ends
        durations = []
        for i in range(film.n_frames):
            film.seek(i)
            durations.append(film.info["duration"])
        assert sum(durations) == 450
        assert film.size == (320, 180)
    frames = render(run, tmp_path / "frames", options)
    assert [path.name for path in frames] == [f"frame-{i:06d}.png" for i in range(9)]


def test_several_processes_draw_the_same(run: Path, tmp_path: Path) -> None:
    options = RenderOptions(size=(320, 180), fps=30.0, start=0.1, end=0.5)
    one, two = (render(run, tmp_path / str(jobs), options, jobs=jobs) for jobs in (1, 2))
    assert len(one) == len(two) == 13
    assert all(a.read_bytes() == b.read_bytes() for a, b in zip(one, two, strict=True))


def test_slow_motion_shows_steps_again() -> None:
    times = 1e-3 * np.arange(1, 101)
    assert list(frame_steps(times, 10.0, 0.001, 0.1, 0.001))[:12] == [0] * 10 + [1] * 2
    assert len(list(frame_steps(times, 50.0, 0.001, 0.1, 1.0))) == 5
    assert list(frame_steps(times, 50.0, 0.05, 0.05, 1.0)) == [49]


def test_mp4_has_the_length_asked_for(run: Path, tmp_path: Path) -> None:
    ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed")
    (path,) = render(run, tmp_path / "film.mp4", RenderOptions(size=(320, 180), fps=25.0, start=0.1, end=0.5))
    frames, seconds = ffmpeg.count_frames_and_secs(str(path))
    assert frames == 11
    assert seconds == pytest.approx(11 / 25, abs=0.03)
    with pytest.raises(InvalidShapeError, match="even"):
        open_writer(tmp_path / "odd.mp4", fps=25.0, size=(321, 180))


def test_mp4_without_ffmpeg_says_what_to_install(run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "imageio_ffmpeg", None)
    with pytest.raises(MissingPackageError, match="pip install imageio-ffmpeg"):
        render(run, tmp_path / "film.mp4", SMALL)
    assert not (tmp_path / "film.mp4").exists()


@pytest.mark.parametrize(
    ("options", "error"),
    [
        (RenderOptions(size=(10, 10)), InvalidShapeError),
        (RenderOptions(fps=0.0), InvalidValueError),
        (RenderOptions(fps=float("nan")), InvalidValueError),
        (RenderOptions(speed=-1.0), InvalidValueError),
        (RenderOptions(start=5.0, end=6.0), InvalidValueError),
        (RenderOptions(start=float("nan")), InvalidValueError),
        (RenderOptions(camera="above"), UnknownNameError),
        (RenderOptions(camera="10,100"), InvalidValueError),
    ],
)
def test_what_cannot_be_drawn_is_refused(run: Path, tmp_path: Path, options: RenderOptions, error: type[QuasirigidError]) -> None:
    with pytest.raises(error):
        render(run, tmp_path / "x.gif", options)
    assert not (tmp_path / "x.gif").exists()


@pytest.mark.parametrize("name", ["film.gif", "film.mp4"])
def test_an_older_film_stays_until_the_new_one_is_finished(run: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], name: str) -> None:
    if name.endswith("mp4"):
        pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed")
    film = tmp_path / name
    film.write_text("of yesterday")
    assert main(["render", str(run), "--out", str(film), "--camera", "fornt"]) == 2
    assert capfd.readouterr().err.count("\n") == 1

    def frames() -> Iterator[Frame]:
        yield from (np.full((180, 320, 3), shade, np.uint8) for shade in (0, 100, 200))
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), Film(open_writer(film, fps=20.0, size=(320, 180))) as writer:
        for frame in frames():
            writer.add(frame)
    assert film.read_text() == "of yesterday"
    with Film(open_writer(film, fps=20.0, size=(320, 180))) as writer, suppress(KeyboardInterrupt):
        for frame in frames():
            writer.add(frame)
    assert film.read_bytes() != b"of yesterday"
    assert list(tmp_path.iterdir()) == [film]
    assert capfd.readouterr().err == ""


def test_frames_of_a_longer_film_do_not_stay_behind_the_last(tmp_path: Path) -> None:
    for name in ("frame-000001.png", "frame-000002.png", "frame-000003.png", "frame-000009 copy.png", "notes.txt"):
        (tmp_path / name).write_text("of yesterday")
    with Film(open_writer(tmp_path, fps=20.0, size=(32, 18))) as writer:
        for shade in (0, 100):
            writer.add(np.full((18, 32, 3), shade, np.uint8))
    assert [path.name for path in writer.paths] == ["frame-000000.png", "frame-000001.png"]
    assert sorted(file.name for file in tmp_path.iterdir()) == [
        "frame-000000.png",
        "frame-000001.png",
        "frame-000009 copy.png",
        "notes.txt",
    ]


def test_command_line(run: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "x.png"
    assert main(["render", str(run), "--out", str(out), "--at", "0.3", "--size", "320x180", "--no-labels"]) == 0
    assert capfd.readouterr().out == f"{out}\n"
    assert np.asarray(Image.open(out)).shape == (180, 320, 3)
    with SceneRecording(run) as recording:
        assert span(recording, 0.0, 0.0, single=True) == (0.002, 0.002), "a recording begins at 0"
    for at in ("-1", "99", "nan"):
        assert main(["render", str(run), "--out", str(out), "--at", at]) == 2
        assert "another --at" in (err := capfd.readouterr().err) or "leave --at out" in err
    for wrong in (["--size", "big"], ["--camera", "x"], ["--out", "film.avi"], ["--jobs", "0"], ["--fps", "0"]):
        assert main(["render", str(run), "--out", str(out), *wrong]) == 2
        err = capfd.readouterr().err
        assert err.startswith("quasirigid: ")
        assert err.count("\n") == 1
    assert main(["render", str(tmp_path / "none.h5")]) == 2
    assert "no such file" in capfd.readouterr().err
    assert main(["render", "--help"]) == 0
    assert "grasp.mp4" in capfd.readouterr().out
