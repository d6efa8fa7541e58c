"""``quasirigid view``: the live view in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from quasirigid.cli.help import command
from quasirigid.cli.option_groups import GraspChoice, PageOptions, Together
from quasirigid.cli.options import PAGE, RUN, Seconds
from quasirigid.cli.running import linger, say

if TYPE_CHECKING:
    from quasirigid.live.recorder import LiveRecorder

EXAMPLES = (
    ("quasirigid view", "a box and a hand: press Run, drag them"),
    ("quasirigid view --object bunny.obj --size 0.08", "an object of your own"),
    ('quasirigid view --object mug.glb --up y --rotate "45 about z"', "turned"),
    ("quasirigid view --no-browser --port 9000", "for `ssh -L 9000:localhost:9000`"),
    ("quasirigid view --run --seconds 10 --no-browser", "run unattended"),
)


def view(
    *,
    chosen: Annotated[GraspChoice, Together(without=("object_motion", "dt", "seed"))],
    where: Annotated[PageOptions, Together()],
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
    from quasirigid.live.play import Play
    from quasirigid.live.recorder import LiveRecorder
    from quasirigid.live.server import LiveView, announce, open_browser

    options = chosen.options()
    play = Play(options)
    recorder = None if record is None else LiveRecorder(record)
    live = LiveView(play, options, host=where.host, port=where.port, allow_origins=where.allow_origins)
    try:
        if recorder is not None:
            # Where nothing can be written, that is found out now. An older recording is replaced with the first steps.
            recorder.begin(play)
            live.session.observe(recorder)
        live.start()
        announce(live.url, where.host, where.port, page="live view", can="drive the hand and load files", ends="Ctrl-C ends it")
        if where.browser:
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
    command(app, *EXAMPLES)(view)
