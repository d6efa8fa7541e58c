"""``quasirigid replay``, ``render`` and ``export``: what can be done with a recording."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from quasirigid.cli.help import command
from quasirigid.cli.option_groups import PageOptions, Together
from quasirigid.cli.options import PAGE, Seconds
from quasirigid.cli.running import linger, placed, working

REPLAY_EXAMPLES = (
    ("quasirigid replay out/grasp/recording.h5", "the last grasp in the browser, with a timeline"),
    ("quasirigid replay run.h5 --no-browser --port 9000", "over an SSH tunnel: ssh -L 9000:localhost:9000 machine"),
)
RENDER_EXAMPLES = (
    ("quasirigid render out/grasp/recording.h5 --out grasp.mp4", "a film of the whole run"),
    ("quasirigid render run.h5 --out hold.png --at 3", "one picture, 3 s after the start"),
    ("quasirigid render run.h5 --out slip.gif --from 1 --to 1.5 --speed 0.1 --fps 20 --size 640x360", "half a second, ten times slower"),
    ("quasirigid render run.h5 --out frames --camera 120,15", "PNG frames, seen from the right and behind"),
)
EXPORT_EXAMPLES = (
    ("quasirigid export run.h5 --csv tables", "steps.csv, poses.csv, fingers.csv, contacts.csv"),
    ("quasirigid export run.h5 --parquet tables", "the same as Parquet: smaller, and faster to read"),
    ("quasirigid export run.h5 --rerun run.rrd && rerun run.rrd", "for the Rerun viewer"),
)

RECORDING = Annotated[Path, typer.Argument(metavar="FILE", help="A recording, such as out/grasp/recording.h5.")]
AS_JSON = Annotated[bool, typer.Option("--json", help="Print what was written as JSON and nothing else.")]
FROM = Annotated[float | None, typer.Option("--from", metavar="SECONDS", help="Start, in simulated time. Default: that of the recording.")]
TO = Annotated[float | None, typer.Option("--to", metavar="SECONDS", help="End, in simulated time. Default: that of the recording.")]


def replay(
    file: RECORDING,
    *,
    where: Annotated[PageOptions, Together()],
    play: Annotated[bool, typer.Option("--play", help="Play at once, without waiting for the button.", rich_help_panel=PAGE)] = False,
    seconds: Seconds = None,
) -> None:
    """Show a recording in the browser: the view of `quasirigid view`, with a timeline."""
    from quasirigid.live.replay import ReplayView
    from quasirigid.live.server import announce, open_browser

    with ReplayView(file, host=where.host, port=where.port, allow_origins=where.allow_origins) as view:
        announce(view.url, where.host, where.port, page="replay", can="watch the recording", ends="Ctrl-C ends it")
        if where.browser:
            open_browser(view.url)
        view.timeline.play(play)
        linger(seconds)


def render(
    file: RECORDING,
    out: Annotated[
        Path, typer.Option(metavar="PATH", help="A file that ends in .png, .gif or .mp4, or a directory for PNG frames.")
    ] = Path("out/render"),
    fps: Annotated[float, typer.Option(help="Frames per second of the film.")] = 30.0,
    size: Annotated[str, typer.Option(metavar="WIDTHxHEIGHT", help="Size in pixels.")] = "1280x720",
    camera: Annotated[
        str, typer.Option(help="auto, front, right, back, left, top, or azimuth,height in degrees (0,0 is the front, 90,0 the right).")
    ] = "auto",
    start: FROM = None,
    end: TO = None,
    at: Annotated[float | None, typer.Option(metavar="SECONDS", help="The moment of a single picture. Default: the last.")] = None,
    speed: Annotated[float, typer.Option(help="Simulated seconds per second of film; 0.1 is ten times slower.")] = 1.0,
    labels: Annotated[bool, typer.Option("--labels/--no-labels", help="Time, forces and scale beside the scene.")] = True,
    jobs: Annotated[int | None, typer.Option(help="Processes that draw. Default: one per core.")] = None,
    as_json: AS_JSON = False,
) -> None:
    """Draw a recording without a browser: a picture, a film, or frames."""
    from quasirigid.render.pictures import RenderOptions
    from quasirigid.render.pictures import render as draw

    options = RenderOptions(
        fps=fps,
        size=parse_size(size),
        camera=camera,
        start=start if at is None else at,
        end=end if at is None else at,
        speed=speed,
        labels=labels,
        single=at is not None,
    )
    with working(quiet=as_json) as progress, placed("--out"):
        paths = draw(file, out, options, jobs=jobs, progress=progress)
    print_paths(paths, as_json=as_json)


def export(
    file: RECORDING,
    csv: Annotated[Path | None, typer.Option(metavar="DIR", help="Write CSV tables to this directory.")] = None,
    parquet: Annotated[Path | None, typer.Option(metavar="DIR", help="Write Parquet tables to this directory (needs pyarrow).")] = None,
    rerun: Annotated[Path | None, typer.Option(metavar="FILE", help="Write a recording for the Rerun viewer (needs rerun-sdk).")] = None,
    every: Annotated[int, typer.Option(metavar="STEPS", help="Take every n-th step.")] = 1,
    start: FROM = None,
    end: TO = None,
    as_json: AS_JSON = False,
) -> None:
    """Write contacts, forces and poses as tables, or for the Rerun viewer."""
    from quasirigid.recording.export import export_tables
    from quasirigid.recording.export_rerun import export_rerun

    if csv is None and parquet is None and rerun is None:
        raise typer.BadParameter("say where to: --csv DIR, --parquet DIR or --rerun FILE")
    paths: list[Path] = []
    with working(quiet=as_json) as progress:
        chosen: dict[str, Any] = {"every": every, "start": start, "end": end, "progress": progress}
        if csv is not None:
            with placed("--csv"):
                paths += export_tables(file, csv, "csv", **chosen)
        if parquet is not None:
            with placed("--parquet"):
                paths += export_tables(file, parquet, "parquet", **chosen)
        if rerun is not None:
            with placed("--rerun"):
                paths += export_rerun(file, rerun, **chosen)
    print_paths(paths, as_json=as_json)


def parse_size(text: str) -> tuple[int, int]:
    """``"1280x720"`` as two numbers. Raises ``InvalidShapeError`` for anything else."""
    from quasirigid.errors import InvalidShapeError

    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise InvalidShapeError("size", "width x height in pixels", text, "give --size 1280x720")
    return int(width), int(height)


def print_paths(paths: list[Path], *, as_json: bool) -> None:
    """What was written, on standard output: one path a line, or JSON."""
    if as_json:
        typer.echo(json.dumps({"files": [str(path) for path in paths], "bytes": sum(path.stat().st_size for path in paths)}, indent=2))
    elif len(paths) > 20:
        typer.echo(str(paths[0].parent))
        print(f"quasirigid: {len(paths)} files, {paths[0].name} to {paths[-1].name}", file=sys.stderr)
    else:
        for path in paths:
            typer.echo(str(path))


def add_to(app: typer.Typer) -> None:
    """Adds the commands to the program."""
    command(app, *REPLAY_EXAMPLES)(replay)
    command(app, *RENDER_EXAMPLES)(render)
    command(app, *EXPORT_EXAMPLES)(export)
