"""Films show what the pictures show: frame by frame, in the colours of the pictures, and none is kept in memory."""

import subprocess
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence
from recorded import record_pinch

from quasirigid.errors import InvalidValueError
from quasirigid.recording.scene_recording import SceneRecording
from quasirigid.render.media import Frame, Gif, frame_steps
from quasirigid.render.pictures import Renderer, RenderOptions, accents, render

OPTIONS = RenderOptions(size=(768, 432), fps=10.0, start=0.02, end=0.52)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run") / "run.h5"
    record_pinch(path)
    return path


@pytest.fixture(scope="module")
def pictures(run: Path) -> list[Frame]:
    with SceneRecording(run) as recording:
        renderer = Renderer(recording, OPTIONS)
        return [renderer.frame(step) for step in renderer.steps()]


def frames_of_gif(path: Path) -> list[Frame]:
    with Image.open(path) as film:
        return [np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(film)]


def off(a: Frame, b: Frame) -> float:
    """Mean difference of two pictures, of 255."""
    return float(np.abs(a.astype(float) - b).mean())


def is_film_of(frames: list[Frame], pictures: list[Frame], bound: float) -> None:
    """Every frame looks like its picture, and more like it than like any other that is not nearly the same."""
    assert len(frames) == len(pictures)
    for i, frame in enumerate(frames):
        assert off(frame, pictures[i]) < bound, f"frame {i} is off by {off(frame, pictures[i]):.2f} of 255"
        for j, other in enumerate(pictures):
            if off(pictures[i], other) > 2 * bound:
                assert off(frame, pictures[i]) < off(frame, other), f"frame {i} looks like picture {j}"
    assert off(pictures[0], pictures[-1]) > 2 * bound, "something has moved, or this shows nothing"


def test_gif_shows_the_pictures(run: Path, pictures: list[Frame], tmp_path: Path) -> None:
    (path,) = render(run, tmp_path / "film.gif", OPTIONS)
    frames = frames_of_gif(path)
    is_film_of(frames, pictures, 1.0)
    (last,) = render(run, tmp_path / "last.png", OPTIONS)
    assert off(frames[-1], np.asarray(Image.open(last))) < 1.0
    # Yellow, of which there is none in the first frame, is there in the last: the colours were chosen for the whole film.
    for colour in ((253, 231, 37), (33, 145, 140)):
        near = [(np.abs(picture.astype(int) - colour).max(axis=2) < 24).sum() for picture in (pictures[-1], frames[-1])]
        assert near[0] > 20, "full pressure is seen"
        assert near[1] > 0.6 * near[0], f"{near[1]} of {near[0]} pixels have kept the colour {colour}"


def test_mp4_shows_the_pictures(run: Path, pictures: list[Frame], tmp_path: Path) -> None:
    ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed")
    (path,) = render(run, tmp_path / "film.mp4", OPTIONS)
    command = [ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", str(path), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    raw = subprocess.run(command, capture_output=True, check=True, timeout=120).stdout
    width, height = OPTIONS.size
    frames = list(np.frombuffer(raw, np.uint8).reshape(-1, height, width, 3))
    is_film_of(frames, pictures, 1.5)


def test_gif_writes_frames_as_they_come_and_keeps_none(tmp_path: Path) -> None:
    film = Gif(tmp_path / "long.gif", 25.0)
    frame = np.full((200, 300, 3), 250, np.uint8)
    film.prepare([frame], accents())
    sizes, memory = [], []
    tracemalloc.start()
    for i in range(60):
        frame[:] = 250
        frame[50:150, 2 * i : 2 * i + 100] = (0, 114, 178)
        film.add(frame)
        if i in (19, 39, 59):
            (growing,) = tmp_path.iterdir()
            sizes.append(growing.stat().st_size)
            memory.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    film.close()
    assert sizes[0] < sizes[1] < sizes[2], "on disk while the film goes on"
    assert memory[2] - memory[0] < 2 * frame.size / 3, f"{memory}: less than two frames of one byte a pixel"
    assert len(frames_of_gif(tmp_path / "long.gif")) == 60


def test_gif_frames_that_are_alike_are_one_that_lasts_longer(tmp_path: Path) -> None:
    film = Gif(tmp_path / "still.gif", 30.0)
    dark, light = np.zeros((10, 12, 3), np.uint8), np.zeros((10, 12, 3), np.uint8)
    light[3, 4:9] = 200
    film.prepare([dark, light], accents())
    for frame in (dark, dark, dark, light, light, dark):
        film.add(frame)
    film.close()
    with Image.open(tmp_path / "still.gif") as back:
        lasts = [frame.info["duration"] for frame in ImageSequence.Iterator(back)]
    assert lasts == [100, 70, 30], "3, 2 and 1 thirtieth of a second, to a tick of 10 ms"
    for frame, expected in zip(frames_of_gif(tmp_path / "still.gif"), (dark, light, dark), strict=True):
        np.testing.assert_allclose(frame, expected, atol=8)


def test_gif_that_breaks_off_leaves_nothing(tmp_path: Path) -> None:
    film = Gif(tmp_path / "half.gif", 25.0)
    for shade in (0, 100, 200):
        film.add(np.full((10, 10, 3), shade, np.uint8))
    film.discard()
    assert list(tmp_path.iterdir()) == []


def test_a_film_of_times_that_no_run_had_is_refused() -> None:
    for end in (1e30, 1e300, float("inf")):
        with pytest.raises(InvalidValueError, match="fewer than 1,000,000 frames"):
            list(frame_steps(np.array([0.0, end]), 30.0, 0.0, end, 1e-3))
