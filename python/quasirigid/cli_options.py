"""Options that several commands share, said once."""

from __future__ import annotations

from enum import Enum
from math import isfinite
from pathlib import Path
from typing import Annotated

import typer

OBJECT, PHYSICS, RUN, PAGE = "Object", "Physics", "Run and output", "Page"
"""Headings of the help."""


class Compliance(str, Enum):
    """How surfaces yield."""

    local = "local"
    half_space = "half-space"


def _finite(seconds: float | None) -> float | None:
    """The option, unless it is no number."""
    if seconds is not None and not isfinite(seconds):
        raise typer.BadParameter(f"{seconds} is not a number of seconds; leave it out to go on until Ctrl-C")
    return seconds


ObjectFile = Annotated[
    Path | None,
    typer.Option(
        "--object",
        metavar="FILE",
        help="Mesh or point cloud (OBJ, PLY, STL, OFF, GLB, XYZ, NPY). Default: a box of 60 x 60 x 80 mm.",
        rich_help_panel=OBJECT,
    ),
]
Scale = Annotated[
    float | None, typer.Option(help="Factor on the file's coordinates, such as 0.001 for millimetres.", rich_help_panel=OBJECT)
]
Size = Annotated[
    float | None,
    typer.Option(metavar="METRES", help="Largest extent that the object shall have, in place of --scale.", rich_help_panel=OBJECT),
]
Mass = Annotated[
    float | None,
    typer.Option(
        metavar="KG", help="Mass of the object. Default: 0.2 for the box, else from the material's density.", rich_help_panel=OBJECT
    ),
]
Points = Annotated[
    int | None, typer.Option(help="Points on the object's surface. Default: 36,000 on the box, 20,000 on others.", rich_help_panel=OBJECT)
]
Friction = Annotated[
    float | None,
    typer.Option(help="Coulomb coefficient between fingers and object. Default: that of the materials.", rich_help_panel=PHYSICS),
]
MaterialName = Annotated[
    str, typer.Option(metavar="NAME", help="The object's material; see `quasirigid materials`.", rich_help_panel=PHYSICS)
]
Squeeze = Annotated[
    float | None,
    typer.Option(
        metavar="NEWTON", help="Force of the thumb. Default: 4, and more for a heavy object from a file.", rich_help_panel=PHYSICS
    ),
]
Yielding = Annotated[
    Compliance, typer.Option(help="How surfaces yield: the paper's local model or an elastic half-space.", rich_help_panel=PHYSICS)
]
Threads = Annotated[int, typer.Option(help="Threads of the engine; the result is the same for any number.", rich_help_panel=RUN)]

Host = Annotated[str, typer.Option(help="Who may look: 127.0.0.1 is this machine alone, 0.0.0.0 the whole network.", rich_help_panel=PAGE)]
Port = Annotated[int, typer.Option(help="Port of the page; the next free one if it is in use.", rich_help_panel=PAGE)]
Browser = Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.", rich_help_panel=PAGE)]
Seconds = Annotated[float | None, typer.Option(help="End after so many seconds.", rich_help_panel=PAGE, min=0.0, callback=_finite)]
HOST, PORT = "127.0.0.1", 8080
