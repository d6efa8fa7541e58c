"""``quasirigid grasp``: the experiment of the paper, on the box or an object of your own."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from quasirigid.cli.grasp_panel import grasp_panel
from quasirigid.cli.help import command
from quasirigid.cli.option_groups import GraspChoice, PageOptions, Together
from quasirigid.cli.options import PAGE, RUN, AsJson, Record
from quasirigid.cli.running import exit_code, placed, progress_bar, refuse_unheard, say

if TYPE_CHECKING:
    from quasirigid.live.grasp_page import Page

EXAMPLES = (
    ("quasirigid grasp", "a box of 0.2 kg, held by three soft fingers"),
    ("quasirigid grasp --friction 0.05", "too slippery: see it fall"),
    ("quasirigid grasp --object bunny.obj --size 0.08", "an object of your own"),
    ("quasirigid grasp --object mug.glb --up y", "its y axis points up"),
    ("quasirigid grasp --object-motion quasi-static", "the model of the paper"),
    ("quasirigid grasp --json | jq .drift_m_per_s", "one figure for a script"),
    ("quasirigid mocap grasp dtrack", "with your own hand, tracked"),
)


def grasp(
    context: typer.Context,
    *,
    chosen: Annotated[GraspChoice, Together()],
    hold: Annotated[float, typer.Option(metavar="SECONDS", help="Length of the first hold.", rich_help_panel=RUN)] = 2.0,
    as_json: AsJson = False,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where the files go.", rich_help_panel=RUN)] = Path("out/grasp"),
    view: Annotated[bool, typer.Option("--view", help="Watch it run, in real time.", rich_help_panel=PAGE)] = False,
    where: Annotated[PageOptions, Together()],
    record: Record = None,
) -> None:
    """Grasp an object, hold it, lift it, shake it, put it down; report how well it was held."""
    from quasirigid.grasp.run import run_grasp

    options = chosen.options(hold=hold)
    page: Page | None = None
    if view:
        from quasirigid.live.grasp_page import Page  # the server takes half a second to import: only with a page

        page = Page(where.host, where.port, where.browser, where.allow_origins)
    else:
        refuse_unheard(context, PAGE, "--view", "it is about the page")
    try:
        with placed("--out"), progress_bar(quiet=as_json) as progress:
            result = run_grasp(options, out, record=record, progress=progress, show=None if page is None else page.open)
    except KeyboardInterrupt as stop:
        say(f"interrupted; what was recorded so far is in {out}")
        raise typer.Exit(exit_code(stop)) from None
    if as_json:
        typer.echo(json.dumps(result.summary, indent=2, allow_nan=False))
    else:
        Console().print(grasp_panel(result))


def add_to(app: typer.Typer) -> None:
    """Adds the command to the program."""
    command(app, *EXAMPLES)(grasp)
