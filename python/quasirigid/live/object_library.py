"""Objects to choose from in the panel, and files that come from the page."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

from quasirigid._quasirigid import MassProperties, Surface
from quasirigid.errors import ObjectFileError
from quasirigid.grasp.options import GraspOptions
from quasirigid.grasp.setup import GraspTarget, take_box, take_file, take_surface
from quasirigid.live.uploads import too_large
from quasirigid.objects import FORMATS

LARGEST_UPLOAD = 20 * 1024 * 1024
"""Bytes."""
UPLOAD_SIZE = 0.08
"""Largest extent of an uploaded object whose own size a hand cannot take, m."""
POINTS = 12_000
"""On a built-in shape other than the box, and on an uploaded one."""
SHAPES = ("box", "ball", "can", "capsule")


def built_in(name: str, options: GraspOptions, friction: float) -> GraspTarget:
    """One of ``SHAPES``."""
    mass = options.mass or 0.2
    if name == "ball":
        return take_surface(name, Surface.sphere(0.03, points=POINTS), MassProperties.sphere(0.03, mass=mass), options, friction)
    if name == "can":
        return take_surface(
            name, Surface.cylinder(0.03, 0.09, points=POINTS), MassProperties.cylinder(0.03, 0.09, mass=mass), options, friction
        )
    if name == "capsule":
        return take_surface(
            name, Surface.capsule(0.025, 0.05, points=POINTS), MassProperties.capsule(0.025, 0.05, mass=mass), options, friction
        )
    return take_box(options)


def from_upload(name: str, content: bytes, options: GraspOptions, friction: float, density: float) -> GraspTarget:
    """An object from the bytes of a file called ``name``. Its own size is kept if it is one that a hand can take, else it is made 8 cm.

    Raises ``ObjectFileError`` for a file that is too large or of an unknown format, and whatever ``load_object`` raises.
    """
    suffix = Path(name).suffix.lower()
    if suffix not in FORMATS:
        raise ObjectFileError(
            Path(name).name, f"one of {', '.join(FORMATS)}", suffix or "no extension", "export the object in one of these"
        )
    if len(content) > LARGEST_UPLOAD:
        raise too_large(Path(name).name, len(content), LARGEST_UPLOAD)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / (Path(name).stem[:60].replace("/", "_") + suffix)
        path.write_bytes(content)
        wanted = replace(options, object=path, scale=None, points=options.points or POINTS)
        try:
            return take_file(replace(wanted, size=None), friction, density)
        except ValueError:
            # Of another unit, or too large or too small for the hand: it is shown at a size that suits.
            return take_file(replace(wanted, size=UPLOAD_SIZE), friction, density)
