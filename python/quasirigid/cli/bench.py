"""``quasirigid bench``: how long a step takes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from quasirigid.cli.running import placed, working


def bench(
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write all figures to this file, or to standard output if it is -.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer steps and sizes: half a minute.")] = False,
) -> None:
    """Time the step: the paper's two tables beside ours, and how cost grows with contacts, points and threads."""
    from quasirigid.benchmark.tables import tables
    from quasirigid.benchmark.timings import run_bench

    made: Path | None = None
    if json_file is not None and str(json_file) != "-":
        made = None if json_file.exists() else json_file
        with placed("--json"):
            json_file.open("a", encoding="utf-8").close()  # a file that cannot be written is found out before, not after
    try:
        with working(quiet=False) as progress:
            results = run_bench(quick=quick, progress=progress)
    except BaseException:
        if made is not None:
            made.unlink(missing_ok=True)  # nothing is in there
        raise
    text = json.dumps(results, indent=2, allow_nan=False)
    if str(json_file) == "-":
        typer.echo(text)
        return
    if json_file is not None:
        with placed("--json"):
            json_file.write_text(text + "\n", encoding="utf-8")
    console = Console()
    if not console.is_terminal:  # into a file or a pipe, which have no width
        console = Console(width=100)
    console.print(tables(results))


def add_to(app: typer.Typer) -> None:
    """Adds the command to the program."""
    app.command()(bench)
