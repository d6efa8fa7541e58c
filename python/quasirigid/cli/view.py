"""``quasirigid view``: the live view in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from quasirigid.cli.help import command
from quasirigid.cli.options import (
    HOST,
    PAGE,
    PORT,
    RUN,
    AllowOrigin,
    Browser,
    Compliance,
    ComplianceModel,
    Friction,
    Host,
    Mass,
    MaterialName,
    ObjectFile,
    Points,
    Port,
    Rotate,
    Scale,
    Seconds,
    Size,
    Squeeze,
    Support,
    Threads,
    Up,
)
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
    object_file: ObjectFile = None,
    scale: Scale = None,
    size: Size = None,
    up: Up = "z",
    rotate: Rotate = None,
    mass: Mass = None,
    points: Points = None,
    friction: Friction = None,
    material: MaterialName = "wood",
    squeeze: Squeeze = None,
    compliance: ComplianceModel = Compliance.local,
    support: Support = None,
    threads: Threads = 1,
    host: Host = HOST,
    port: Port = PORT,
    allow_origin: AllowOrigin = None,
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
    from quasirigid.grasp.options import GraspOptions
    from quasirigid.live.play import Play
    from quasirigid.live.recorder import LiveRecorder
    from quasirigid.live.server import LiveView, announce, open_browser

    options = GraspOptions(
        object=object_file,
        scale=scale,
        size=size,
        up=up,
        rotate=rotate,
        mass=mass,
        points=points,
        friction=friction,
        material=material,
        squeeze=squeeze,
        compliance=compliance.value,
        support=support,  # type: ignore[arg-type]  # checked by GraspOptions.check
        threads=threads,
    )
    play = Play(options)
    recorder = None if record is None else LiveRecorder(record)
    live = LiveView(play, options, host=host, port=port, allow_origins=allow_origin or ())
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
    command(app, *EXAMPLES)(view)
