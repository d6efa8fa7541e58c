"""Pictures into files: PNG frames in a directory, one PNG, an animated GIF, an MP4.

A writer takes frames (height, width, 3) of ``uint8`` one at a time and holds none of them back, so that a film may be of any length.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from PIL import Image

from quasirigid.errors import InvalidShapeError, InvalidValueError, MissingPackageError

Frame = npt.NDArray[np.uint8]
KINDS = (".png", ".gif", ".mp4")
QUALITY = 8.0
"""Of MP4, 0 to 10."""


class Writer(Protocol):
    """Where frames go."""

    paths: list[Path]
    """What was written."""

    def add(self, frame: Frame) -> None:
        """Write the next frame."""

    def close(self) -> None:
        """Finish the file."""

    def discard(self) -> None:
        """Leave nothing half done behind: called in place of ``close`` if the frames broke off."""


class PngFrames:
    """``frame-000000.png`` and so on in a directory, or one picture at a path that ends in ``.png``."""

    def __init__(self, out: Path) -> None:
        """Write to ``out``, a directory or a path that ends in ``.png``."""
        self._one = out.suffix.lower() == ".png"
        self._out = out
        self.paths: list[Path] = []
        (out.parent if self._one else out).mkdir(parents=True, exist_ok=True)

    def add(self, frame: Frame) -> None:
        """Write the next frame."""
        path = self._out if self._one else self._out / f"frame-{len(self.paths):06d}.png"
        Image.fromarray(frame).save(path)
        self.paths.append(path)

    def close(self) -> None:
        """Nothing is left to do."""

    def discard(self) -> None:
        """Every frame is a whole file: they stay."""


class Gif:
    """An animated GIF that repeats for ever. Its clock ticks in 1/100 s, so frames last a tick more or less to keep time."""

    def __init__(self, path: Path, fps: float) -> None:
        """Write to ``path``, ``fps`` frames a second."""
        if fps > 50.0:
            raise InvalidValueError("fps", "at most 50 for a GIF", f"{fps:g}", "give --fps 25, or write an MP4")
        path.parent.mkdir(parents=True, exist_ok=True)
        self.paths = [path]
        self._fps = fps
        # The palette of the first frame serves all: colours do not flicker, and frames that differ little are small.
        self._palette: Image.Image | None = None
        self._frames: list[Image.Image] = []

    def add(self, frame: Frame) -> None:
        """Keep the next frame, reduced to 256 colours."""
        image = Image.fromarray(frame)
        if self._palette is None:
            self._palette = image.quantize(255, dither=Image.Dither.NONE)
        self._frames.append(image.quantize(palette=self._palette, dither=Image.Dither.NONE))

    def close(self) -> None:
        """Write the file."""
        if not self._frames:
            return
        ends = [round(100.0 * (i + 1) / self._fps) for i in range(len(self._frames))]
        lasts = [10 * (end - start) for start, end in zip([0, *ends], ends, strict=False)]
        first, rest = self._frames[0], self._frames[1:]
        first.save(self.paths[0], save_all=True, append_images=rest, duration=lasts, loop=0, optimize=False)
        self._frames = []

    def discard(self) -> None:
        """Nothing was written yet."""
        self._frames = []


class Mp4:
    """An MP4 (H.264) written by ffmpeg, which the package ``imageio-ffmpeg`` brings along."""

    def __init__(self, path: Path, fps: float, size: tuple[int, int]) -> None:
        """Write to ``path``, ``fps`` frames a second of ``size`` (width, height) px, both even."""
        try:
            import imageio_ffmpeg
        except ImportError:
            raise MissingPackageError.of("imageio-ffmpeg", "to write MP4", "video") from None
        if size[0] % 2 or size[1] % 2:
            raise InvalidShapeError("size", "an even width and height for an MP4", f"{size[0]}x{size[1]}", "give --size 1280x720")
        path.parent.mkdir(parents=True, exist_ok=True)
        self.paths = [path]
        self._size = size
        self._pipe: Any = imageio_ffmpeg.write_frames(
            str(path), size, fps=fps, quality=QUALITY, macro_block_size=2, output_params=["-movflags", "+faststart"]
        )
        self._pipe.send(None)

    def add(self, frame: Frame) -> None:
        """Encode the next frame."""
        self._pipe.send(np.ascontiguousarray(frame))

    def close(self) -> None:
        """Finish the file."""
        self._pipe.close()

    def discard(self) -> None:
        """An MP4 that broke off still plays once it is finished properly, but nobody asked for a part."""
        self._pipe.close()
        self.paths[0].unlink(missing_ok=True)


def open_writer(out: Path, *, fps: float, size: tuple[int, int]) -> Writer:
    """The writer for ``out``: by its ending ``.png``, ``.gif`` or ``.mp4``, or a directory if it has none."""
    if not (np.isfinite(fps) and 0.0 < fps <= 1000.0):
        raise InvalidValueError("fps", "frames per second, above 0 and up to 1000", fps, "give --fps 30")
    kind = out.suffix.lower()
    if kind == ".gif":
        return Gif(out, fps)
    if kind == ".mp4":
        return Mp4(out, fps, size)
    if kind not in ("", ".png") and not out.is_dir():
        raise InvalidValueError("out", f"a directory or a file that ends in {', '.join(KINDS)}", out.name, "choose one of these endings")
    return PngFrames(out)


class Film:
    """A writer in a ``with`` block: finished at the end, discarded if an error came."""

    def __init__(self, writer: Writer) -> None:
        self.writer = writer

    def __enter__(self) -> Writer:
        return self.writer

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if kind is None:
            self.writer.close()
        else:
            self.writer.discard()


def frame_steps(times: npt.NDArray[np.float64], fps: float, start: float, end: float, speed: float) -> Iterator[int]:
    """The step to show in each frame: the last one that had ended by the frame's time, from ``start`` to ``end`` s."""
    count = int(np.floor((end - start) * fps / speed + 1e-9)) + 1
    moments = start + np.arange(count) * speed / fps
    steps = np.searchsorted(times, moments + 1e-9 * max(1.0, end), side="right") - 1
    yield from (int(step) for step in np.maximum(steps, 0))


__all__ = ["KINDS", "Film", "Frame", "Writer", "frame_steps", "open_writer"]
