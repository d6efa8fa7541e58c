"""Pictures into files: PNG frames in a directory, one PNG, an animated GIF, an MP4.

A writer takes frames (height, width, 3) of ``uint8`` one at a time and holds none of them back, so that a film may be of any length.
Nothing is on disk before the first frame, and an older film stays until the new one is finished.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Protocol

import numpy as np
import numpy.typing as npt
from PIL import GifImagePlugin, Image

from quasirigid.errors import InvalidShapeError, InvalidValueError, MissingPackageError

Frame = npt.NDArray[np.uint8]
IndexArray = npt.NDArray[np.uint8]
"""Numbers of colours, (height, width)."""
Box = tuple[int, int, int, int]
"""Left, top, width, height, px."""
TRANSPARENT = 255
"""Number of the colour of what stays as it is in a GIF; the 255 before it are colours."""
MOST_FRAMES = 1_000_000
"""Of a film: nine hours. What has more has times that no run had."""
KINDS = (".png", ".gif", ".mp4")
QUALITY = 8.0
"""Of MP4, 0 to 10."""


class Writer(Protocol):
    """Where frames go."""

    paths: list[Path]
    """What was written."""

    def prepare(self, frames: Sequence[Frame], accents: Frame) -> None:
        """Some frames of the film, before its first, and colours (1, n, 3) that matter though they cover little: for what all frames have
        in common.
        """

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

    def prepare(self, frames: Sequence[Frame], accents: Frame) -> None:
        """Every picture is by itself."""

    def add(self, frame: Frame) -> None:
        """Write the next frame."""
        path = self._out if self._one else self._out / f"frame-{len(self.paths):06d}.png"
        if not self.paths:
            path.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(frame).save(path)
        self.paths.append(path)

    def close(self) -> None:
        """Take away what is left of a longer film that was here before: its frames would follow on these."""
        if not self._one and self.paths:
            for path in self._out.iterdir():
                if re.fullmatch(r"frame-\d{6}\.png", path.name) and path.name > self.paths[-1].name:
                    path.unlink()

    def discard(self) -> None:
        """Every frame is a whole file: they stay."""


class Gif:
    """An animated GIF that repeats for ever. Its clock ticks in 1/100 s, so frames last a tick more or less to keep time.

    A frame is in the file as soon as it is known how long it lasts: when the next one comes. Written is what differs from the frame before.
    """

    def __init__(self, path: Path, fps: float) -> None:
        """Write to ``path``, ``fps`` frames a second."""
        if fps > 50.0:
            raise InvalidValueError("fps", "at most 50 for a GIF", f"{fps:g}", "give --fps 25, or write an MP4")
        self.paths = [path]
        self._draft = _draft(path)
        self._fps = fps
        self._file: BinaryIO | None = None
        self._palette: Image.Image | None = None
        self._shown: IndexArray | None = None
        self._next: tuple[IndexArray, Box] | None = None
        self._began, self._count = 0, 0

    def prepare(self, frames: Sequence[Frame], accents: Frame) -> None:
        """Choose the colours, from some frames of the film. One palette serves all: colours do not flicker, and frames that differ little
        are small.

        The octree is ten times faster than the median cut, and half as far off: smooth greys need their steps.
        """
        chosen = Image.fromarray(np.concatenate(frames)).quantize(TRANSPARENT - accents.size // 3, Image.Quantize.FASTOCTREE)
        colours, own = np.reshape(np.array(chosen.getpalette()), (-1, 3)), accents[0].astype(int)
        # Pillow finds the nearest colour but to four parts in 256: what is that near to an accent would take its place.
        near = np.abs(colours[:, None] - own).max(axis=2).min(axis=1) < 4
        self._palette = Image.new("P", (1, 1))
        self._palette.putpalette(np.concatenate([colours[~near], own]).reshape(-1).tolist())

    def add(self, frame: Frame) -> None:
        """Write the next frame, reduced to 255 colours."""
        if self._palette is None:
            self.prepare([frame], np.zeros((1, 1, 3), np.uint8))
        assert self._palette is not None
        image = np.asarray(Image.fromarray(frame).quantize(palette=self._palette, dither=Image.Dither.NONE))
        if self._shown is None:
            self._next = image, (0, 0, image.shape[1], image.shape[0])
        else:
            changed = image != self._shown
            if changed.any():  # else the one before lasts longer
                self._write()
                self._next = _difference(image, changed)
        self._shown = image
        self._count += 1

    def _write(self) -> None:
        """Write the frame that waits: it is known now how long it lasts."""
        if self._next is None:
            return
        assert self._palette is not None
        pixels, (left, top, _, _) = self._next
        image = Image.fromarray(pixels, "P")
        image.putpalette(self._palette.getpalette() or [])
        if self._file is None:
            self._draft.parent.mkdir(parents=True, exist_ok=True)
            self._file = self._draft.open("wb")
            for part in GifImagePlugin.getheader(image, info={"loop": 0, "optimize": False})[0]:
                self._file.write(part)
        end = round(100.0 * self._count / self._fps)
        lasts, self._began = end - self._began, end
        for part in GifImagePlugin.getdata(image, (left, top), duration=10 * lasts, transparency=TRANSPARENT, disposal=1):
            self._file.write(part)

    def close(self) -> None:
        """Finish the file."""
        self._write()
        self._next = None
        if self._file is not None:
            self._file.write(b";")
            self._file.close()
            os.replace(self._draft, self.paths[0])

    def discard(self) -> None:
        """Leave no half of a film."""
        if self._file is not None:
            self._file.close()
            self._draft.unlink(missing_ok=True)


def _draft(path: Path) -> Path:
    """Where a film is written until it is finished: beside ``path``, with its ending."""
    return path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")


def _difference(image: IndexArray, changed: npt.NDArray[np.bool_]) -> tuple[IndexArray, Box]:
    """The part of an image in which something ``changed``, what did not being transparent; and where it is."""
    rows, columns = np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0))
    top, bottom, left, right = int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1
    window = (slice(top, bottom), slice(left, right))
    part: IndexArray = np.where(changed[window], image[window], np.uint8(TRANSPARENT))
    return part, (left, top, right - left, bottom - top)


class Mp4:
    """An MP4 (H.264) written by ffmpeg, which the package ``imageio-ffmpeg`` brings along."""

    def __init__(self, path: Path, fps: float, size: tuple[int, int]) -> None:
        """Write to ``path``, ``fps`` frames a second of ``size`` (width, height) px, both even."""
        try:
            import imageio_ffmpeg  # noqa: F401
        except ImportError:
            raise MissingPackageError.of("imageio-ffmpeg", "to write MP4", "video") from None
        if size[0] % 2 or size[1] % 2:
            raise InvalidShapeError("size", "an even width and height for an MP4", f"{size[0]}x{size[1]}", "give --size 1280x720")
        self.paths = [path]
        self._draft = _draft(path)
        self._fps, self._size = fps, size
        self._pipe: Any = None

    def prepare(self, frames: Sequence[Frame], accents: Frame) -> None:
        """Nothing depends on what comes."""

    def add(self, frame: Frame) -> None:
        """Encode the next frame."""
        if self._pipe is None:
            import imageio_ffmpeg

            self._draft.parent.mkdir(parents=True, exist_ok=True)
            self._pipe = imageio_ffmpeg.write_frames(
                str(self._draft), self._size, fps=self._fps, quality=QUALITY, macro_block_size=2, output_params=["-movflags", "+faststart"]
            )
            self._pipe.send(None)
        self._pipe.send(np.ascontiguousarray(frame))

    def close(self) -> None:
        """Finish the file."""
        if self._pipe is not None:
            self._pipe.close()
            os.replace(self._draft, self.paths[0])

    def discard(self) -> None:
        """An MP4 that broke off still plays once it is finished properly, but nobody asked for a part."""
        if self._pipe is not None:
            self._pipe.close()
            self._draft.unlink(missing_ok=True)


def open_writer(out: Path, *, fps: float, size: tuple[int, int]) -> Writer:
    """The writer for ``out``: by its ending ``.png``, ``.gif`` or ``.mp4``, or a directory if it has none."""
    if not (np.isfinite(fps) and 0.0 < fps <= 1000.0):
        raise InvalidValueError("fps", "frames per second, above 0 and up to 1000", fps, "give --fps 30")
    kind = out.suffix.lower()
    if kind in KINDS and out.exists() and not out.is_file():
        found = f"{out.name}, which is a directory" if out.is_dir() else out.name
        raise InvalidValueError("out", f"a file that ends in {', '.join(KINDS)}, or a directory without", found, "choose another name")
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
        if kind is not None:
            self.writer.discard()
            return
        try:
            self.writer.close()
        except BaseException:
            self.writer.discard()
            raise


def frame_steps(times: npt.NDArray[np.float64], fps: float, start: float, end: float, speed: float) -> Iterator[int]:
    """The step to show in each frame: the last one that had ended by the frame's time, from ``start`` to ``end`` s."""
    frames = (end - start) * fps / speed
    if not frames < MOST_FRAMES:
        hint = "choose a part with --from and --to, or fewer frames with --fps and --speed"
        raise InvalidValueError("film", f"fewer than {MOST_FRAMES:,} frames", f"{frames:.3g}, {end - start:.3g} s of the recording", hint)
    count = int(np.floor(frames + 1e-9)) + 1
    moments = start + np.arange(count) * speed / fps
    steps = np.searchsorted(times, moments + 1e-9 * max(1.0, end), side="right") - 1
    yield from (int(step) for step in np.maximum(steps, 0))


__all__ = ["KINDS", "Film", "Frame", "Writer", "frame_steps", "open_writer"]
