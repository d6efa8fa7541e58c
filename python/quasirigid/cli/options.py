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
    """How surfaces deform."""

    local = "local"
    layer = "layer"
    half_space = "half-space"
    gaussian = "gaussian"


class ObjectMotion(str, Enum):
    """Whether bodies have inertia."""

    inertial = "inertial"
    quasi_static = "quasi-static"


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
        help="Mesh or point cloud. Default: a box, 60x60x80 mm.",
        rich_help_panel=OBJECT,
    ),
]
Scale = Annotated[
    float | None, typer.Option(metavar="FACTOR", help="On the file's coordinates: 0.001 for millimetres.", rich_help_panel=OBJECT)
]
Size = Annotated[
    float | None,
    typer.Option(metavar="METRES", help="Largest extent, in place of --scale.", rich_help_panel=OBJECT),
]
Up = Annotated[
    str,
    typer.Option(
        metavar="AXIS",
        help="Axis that is up: x, y, z, -x, -y, -z.",
        rich_help_panel=OBJECT,
    ),
]
Rotate = Annotated[
    str | None,
    typer.Option(
        metavar="WORDS",
        help='Then turn it, degrees: "90 about x, 45 about z".',
        rich_help_panel=OBJECT,
    ),
]
Mass = Annotated[
    float | None,
    typer.Option(metavar="KG", help="Default: 0.2 for the box, else from the density.", rich_help_panel=OBJECT),
]
Points = Annotated[
    int | None, typer.Option(metavar="NUMBER", help="On its surface. Default: 36,000 (box) or 20,000.", rich_help_panel=OBJECT)
]
Friction = Annotated[
    float | None,
    typer.Option(metavar="MU", help="Coefficient. Default: of the materials.", rich_help_panel=PHYSICS),
]
MaterialName = Annotated[str, typer.Option(metavar="NAME", help="See `quasirigid materials`.", rich_help_panel=PHYSICS)]
Squeeze = Annotated[
    float | None,
    typer.Option(metavar="NEWTON", help="Of the thumb. Default: 4, more if heavy.", rich_help_panel=PHYSICS),
]
ComplianceModel = Annotated[
    Compliance, typer.Option(metavar="MODEL", help="local, layer, half-space or gaussian.", rich_help_panel=PHYSICS)
]
Support = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Under the box: table, post. Default: a pedestal, where a person acts the table.",
        rich_help_panel=PHYSICS,
    ),
]
Motion = Annotated[ObjectMotion, typer.Option("--object-motion", metavar="KIND", help="inertial or quasi-static.", rich_help_panel=PHYSICS)]
TimeStep = Annotated[float, typer.Option(metavar="SECONDS", help="Time step.", rich_help_panel=RUN)]
Seed = Annotated[int, typer.Option(metavar="NUMBER", help="Of the sampling of the surface.", rich_help_panel=RUN)]
AsJson = Annotated[bool, typer.Option("--json", help="Print the summary as JSON and nothing else.", rich_help_panel=RUN)]
Record = Annotated[Path | None, typer.Option(metavar="FILE", help="The recording. Default: recording.h5 in --out.", rich_help_panel=RUN)]
Threads = Annotated[int, typer.Option(metavar="NUMBER", help="Any number gives the same result.", rich_help_panel=RUN)]

Host = Annotated[str, typer.Option(metavar="ADDRESS", help="0.0.0.0: the network may look.", rich_help_panel=PAGE)]
Port = Annotated[int, typer.Option(metavar="NUMBER", help="The next free one if in use.", rich_help_panel=PAGE)]
AllowOrigin = Annotated[
    list[str] | None,
    typer.Option(
        "--allow-origin",
        metavar="URL",
        help="Pages to trust; repeatable.",
        rich_help_panel=PAGE,
    ),
]
Browser = Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page.", rich_help_panel=PAGE)]
Seconds = Annotated[
    float | None, typer.Option(metavar="SECONDS", help="End after so many seconds.", rich_help_panel=PAGE, min=0.0, callback=_finite)
]
HOST, PORT = "127.0.0.1", 8080
