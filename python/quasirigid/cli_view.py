"""``quasirigid view``: the live view in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from quasirigid.cli_options import (
    HOST,
    PAGE,
    PORT,
    RUN,
    Browser,
    Compliance,
    Friction,
    Host,
    Mass,
    MaterialName,
    ObjectFile,
    Points,
    Port,
    Scale,
    Seconds,
    Size,
    Squeeze,
    Threads,
    Yielding,
)
from quasirigid.cli_run import linger, say, terminable

if TYPE_CHECKING:
    from quasirigid.world_recorder import LiveRecorder

EXAMPLES = """[bold]Examples[/bold]

[cyan]quasirigid view[/cyan]  a box and a hand in the browser: press Run, drag things

[cyan]quasirigid view --object bunny.obj --size 0.08[/cyan]  an object of your own

[cyan]quasirigid view --no-browser --port 9000[/cyan]  over an SSH tunnel: ssh -L 9000:localhost:9000 machine

[cyan]quasirigid view --run --seconds 10 --no-browser[/cyan]  run unattended and end by itself
"""


def view(
    object_file: ObjectFile = None,
    scale: Scale = None,
    size: Size = None,
    mass: Mass = None,
    points: Points = None,
    friction: Friction = None,
    material: MaterialName = "wood",
    squeeze: Squeeze = None,
    compliance: Yielding = Compliance.local,
    threads: Threads = 1,
    host: Host = HOST,
    port: Port = PORT,
    browser: Browser = True,
    run: Annotated[
        bool, typer.Option("--run", help="Start running at once, without waiting for the Run button.", rich_help_panel=PAGE)
    ] = False,
    seconds: Seconds = None,
    record: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Record what happens, for `quasirigid replay`; Reset begins FILE-2.", rich_help_panel=RUN),
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
    play = Play(options)
    recorder = None if record is None else LiveRecorder(record)
    with terminable():
        live = LiveView(play, options, host=host, port=port)
        try:
            if recorder is not None:
                # Where nothing can be written, that is found out now. An older recording is replaced with the first steps.
                recorder.begin(play)
                live.session.observe(recorder)
            live.start()
            announce(live.url, host, port, page="live view", can="drive the hand and load files", ends="Ctrl-C ends it")
            if browser:
                open_browser(live.url)
            if run:
                live.session.run(True)
            linger(seconds)
        finally:
            live.stop()
            if recorder is not None:
                _finish(recorder)


def _finish(recorder: LiveRecorder) -> None:
    """Closes the recordings and says where they are."""
    try:
        recorder.close()
    finally:
        for path in recorder.paths:
            typer.echo(str(path))
    if recorder.waited > 0.0:
        say(f"the disk could not follow: the simulation waited {recorder.waited:.2g} s for it")


def add_to(app: typer.Typer) -> None:
    """Adds the command to the program."""
    app.command(epilog=EXAMPLES)(view)
