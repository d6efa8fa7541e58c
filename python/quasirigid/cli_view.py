"""``quasirigid view``: the live view in the browser."""

from __future__ import annotations

import time
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

EXAMPLES = """[bold]Examples[/bold]

[cyan]quasirigid view[/cyan]  a box and a hand in the browser: press Run, drag things

[cyan]quasirigid view --object bunny.obj --size 0.08[/cyan]  an object of your own

[cyan]quasirigid view --no-browser --port 9000[/cyan]  over an SSH tunnel: ssh -L 9000:localhost:9000 machine

[cyan]quasirigid view --run --seconds 10 --no-browser[/cyan]  run unattended and end by itself
"""

SCENE, PAGE = "Scene", "Page"


class Model(str, Enum):
    """How surfaces yield."""

    local = "local"
    half_space = "half-space"


def view(
    object_file: Annotated[
        Path | None,
        typer.Option("--object", metavar="FILE", help="Mesh or point cloud. Default: a box of 60 x 60 x 80 mm.", rich_help_panel=SCENE),
    ] = None,
    scale: Annotated[float | None, typer.Option(help="Factor on the file's coordinates.", rich_help_panel=SCENE)] = None,
    size: Annotated[
        float | None, typer.Option(metavar="METRES", help="Largest extent that the object shall have.", rich_help_panel=SCENE)
    ] = None,
    mass: Annotated[float | None, typer.Option(metavar="KG", help="Mass of the object.", rich_help_panel=SCENE)] = None,
    points: Annotated[int | None, typer.Option(help="Points on the object's surface.", rich_help_panel=SCENE)] = None,
    friction: Annotated[float | None, typer.Option(help="Coulomb coefficient between fingers and object.", rich_help_panel=SCENE)] = None,
    material: Annotated[str, typer.Option(metavar="NAME", help="The object's material.", rich_help_panel=SCENE)] = "wood",
    squeeze: Annotated[float | None, typer.Option(metavar="NEWTON", help="Force of the thumb.", rich_help_panel=SCENE)] = None,
    compliance: Annotated[Model, typer.Option(help="How surfaces yield.", rich_help_panel=SCENE)] = Model.local,
    threads: Annotated[int, typer.Option(help="Threads of the engine.", rich_help_panel=SCENE)] = 1,
    host: Annotated[
        str, typer.Option(help="Who may look: 127.0.0.1 is this machine alone, 0.0.0.0 the whole network.", rich_help_panel=PAGE)
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port of the page; the next free one if it is in use.", rich_help_panel=PAGE)] = 8080,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.", rich_help_panel=PAGE)] = True,
    run: Annotated[
        bool, typer.Option("--run", help="Start running at once, without waiting for the Run button.", rich_help_panel=PAGE)
    ] = False,
    seconds: Annotated[float | None, typer.Option(help="End after so many seconds.", rich_help_panel=PAGE)] = None,
    record: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Record what happens, for `quasirigid replay`; Reset begins FILE-2.", rich_help_panel=SCENE),
    ] = None,
) -> None:
    """Grasp in the browser: a live view with a panel, plots, and handles to drag."""
    from quasirigid.grasp_options import GraspOptions
    from quasirigid.view.play import Play
    from quasirigid.view.server import LiveView, announce, open_browser
    from quasirigid.world_recorder import LiveRecorder

    options = GraspOptions(
        object=object_file,
        scale=scale,
        size=size,
        mass=mass,
        points=points,
        friction=friction,
        material=material,
        squeeze=squeeze,
        compliance=compliance.value,
        threads=threads,
    )
    live = LiveView(Play(options), options, host=host, port=port)
    recorder = None if record is None else LiveRecorder(record)
    if recorder is not None:
        live.session.observe(recorder)
    live.start()
    url = announce(live.server, host, port)
    if browser:
        open_browser(url)
    if run:
        live.session.run(True)
    try:
        end = None if seconds is None else time.monotonic() + seconds
        while end is None or time.monotonic() < end:
            time.sleep(0.1)
    except KeyboardInterrupt:
        pass  # the way to end it
    finally:
        live.stop()
        if recorder is not None:
            recorder.close()
            for path in recorder.paths:
                typer.echo(str(path))


def add_to(app: typer.Typer) -> None:
    """Adds the command to the program."""
    app.command(epilog=EXAMPLES)(view)
