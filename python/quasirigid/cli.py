"""The command line: ``quasirigid grasp``, ``quasirigid view``, ``quasirigid replay``, ``quasirigid render``, ``quasirigid export``,
``quasirigid bench``, ``quasirigid materials``.

Standard output carries the result, standard error everything else. Exit code 0 is a finished run (a dropped object is a
result too), 2 bad input, 130 an interrupt, 143 a SIGTERM, 141 a reader of standard output who left, 1 a bug.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from quasirigid import cli_recordings, cli_view
from quasirigid.cli_options import (
    HOST,
    PAGE,
    PHYSICS,
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
    Size,
    Squeeze,
    Threads,
    Yielding,
)
from quasirigid.cli_run import exit_code, placed, progress_bar, say, terminable, working
from quasirigid.errors import InvalidValueError, QuasirigidError
from quasirigid.grasp_panel import grasp_panel
from quasirigid.mocap.commands import app as mocap_commands
from quasirigid.quiet import quiet_fonts

# What the commands need is imported when they run: `--help` must not wait for matplotlib.

app = typer.Typer(no_args_is_help=True, add_completion=False, rich_markup_mode="rich", pretty_exceptions_enable=False)

EXAMPLES = """[bold]Examples[/bold]

[cyan]quasirigid grasp[/cyan]  a box of 0.2 kg, held by three soft fingers

[cyan]quasirigid grasp --friction 0.05[/cyan]  too slippery: see it fall

[cyan]quasirigid grasp --object bunny.obj --size 0.08[/cyan]  an object of your own, scaled to 8 cm

[cyan]quasirigid grasp --object-motion quasi-static --compliance local[/cyan]  the model of the paper

[cyan]quasirigid grasp --json | jq .drift_m_per_s[/cyan]  one figure for a script

[cyan]quasirigid grasp --mocap dtrack[/cyan]  your own hand, tracked; `quasirigid mocap replay` sends a recorded one

[cyan]quasirigid grasp --mocap take --view[/cyan]  that one in the browser, without a network
"""


class ObjectMotion(str, Enum):
    """Whether bodies have inertia."""

    inertial = "inertial"
    quasi_static = "quasi-static"


def _show_version(wanted: bool) -> None:
    if wanted:
        from quasirigid._quasirigid import __version__

        typer.echo(f"quasirigid {__version__}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit.")] = False,
) -> None:
    """Real-time grasping with soft fingertips: contact patches and exact Coulomb friction."""


app.add_typer(mocap_commands, name="mocap")

MOCAP = "Motion capture"


@app.command(epilog=EXAMPLES)
def grasp(
    context: typer.Context,
    object_file: ObjectFile = None,
    scale: Scale = None,
    size: Size = None,
    mass: Mass = None,
    points: Points = None,
    friction: Friction = None,
    material: MaterialName = "wood",
    squeeze: Squeeze = None,
    compliance: Yielding = Compliance.local,
    object_motion: Annotated[
        ObjectMotion, typer.Option(help="Bodies with inertia, or the paper's without.", rich_help_panel=PHYSICS)
    ] = ObjectMotion.inertial,
    dt: Annotated[float, typer.Option(metavar="SECONDS", help="Time step.", rich_help_panel=RUN)] = 1e-3,
    hold: Annotated[float, typer.Option(metavar="SECONDS", help="Length of the first hold.", rich_help_panel=RUN)] = 2.0,
    threads: Threads = 1,
    seed: Annotated[int, typer.Option(help="Seed of the sampling of the object's surface.", rich_help_panel=RUN)] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON and nothing else.", rich_help_panel=RUN)] = False,
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Where summary.json, recording.h5 and the plots go.", rich_help_panel=RUN)
    ] = Path("out/grasp"),
    view: Annotated[bool, typer.Option("--view", help="Watch it in the browser, at the pace of the clock.", rich_help_panel=PAGE)] = False,
    host: Host = HOST,
    port: Port = PORT,
    browser: Browser = True,
    record: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Where the recording goes. Default: recording.h5 in --out.", rich_help_panel=RUN)
    ] = None,
    mocap: Annotated[
        str | None,
        typer.Option(
            metavar="SOURCE",
            help="A tracked hand takes the object: dtrack, dtrack:PORT, dtrack:HOST:PORT:fw, webxr, webxr:PORT, or take:FILE in simulated time.",
            rich_help_panel=MOCAP,
        ),
    ] = None,
    hand: Annotated[str, typer.Option(help="left or right.", rich_help_panel=MOCAP)] = "right",
    coupling: Annotated[
        str, typer.Option(help="tips: a pad on springs for each tracked finger; hand: the three-finger hand.", rich_help_panel=MOCAP)
    ] = "tips",
    spring: Annotated[
        float | None, typer.Option(metavar="N_PER_M", help="Stiffness from tracked tip to pad. Default: 600.", rich_help_panel=MOCAP)
    ] = None,
    damping: Annotated[
        float | None, typer.Option(metavar="N_S_PER_M", help="Damping of that spring. Default: 8.", rich_help_panel=MOCAP)
    ] = None,
    spring_rotation: Annotated[
        float | None, typer.Option(metavar="N_M_PER_RAD", help="The same for rotation. Default: 0.5.", rich_help_panel=MOCAP)
    ] = None,
    damping_rotation: Annotated[
        float | None, typer.Option(metavar="N_M_S_PER_RAD", help="Damping of rotation. Default: 0.01.", rich_help_panel=MOCAP)
    ] = None,
    joint_stiffness: Annotated[
        float | None,
        typer.Option(
            metavar="FACTOR", help="--coupling hand: on the stiffness of the joint controllers. Default: 1.", rich_help_panel=MOCAP
        ),
    ] = None,
    joint_damping: Annotated[
        float | None, typer.Option(metavar="FACTOR", help="--coupling hand: on their damping. Default: 1.", rich_help_panel=MOCAP)
    ] = None,
    delay: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="How far in the past the hand is shown; 0 predicts. Default: fits the stream, at most 0.1.",
            rich_help_panel=MOCAP,
        ),
    ] = None,
    loss_hold: Annotated[
        float, typer.Option(metavar="SECONDS", help="How long a finger that is not seen keeps its force.", rich_help_panel=MOCAP)
    ] = 0.5,
    loss_fade: Annotated[float, typer.Option(metavar="SECONDS", help="How long it then takes to go limp.", rich_help_panel=MOCAP)] = 0.5,
    calibration: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Where the tracker is; see `quasirigid mocap calibrate`.", rich_help_panel=MOCAP)
    ] = None,
    tracked_bodies: Annotated[
        str | None,
        typer.Option("--bodies", metavar="MAP", help="Bodies on the fingers, such as thumb=0,index=1,middle=2.", rich_help_panel=MOCAP),
    ] = None,
    place: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z[,DEG]", help="webxr: where the world stands in the room, m, y up. Default: 0,0.75,-0.4", rich_help_panel=MOCAP
        ),
    ] = None,
    certificate: Annotated[
        Path | None, typer.Option(metavar="FILE", help="webxr: serve https with this certificate (PEM).", rich_help_panel=MOCAP)
    ] = None,
    key: Annotated[
        Path | None, typer.Option(metavar="FILE", help="webxr: the certificate's key, if it is not in its file.", rich_help_panel=MOCAP)
    ] = None,
    bind: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS", help="Address of this machine to listen on. Default: 0.0.0.0, for webxr 127.0.0.1.", rich_help_panel=MOCAP
        ),
    ] = None,
    idle: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="The session ends when nothing has come for so long. Default: 3, for webxr 60: one may take the headset off.",
            rich_help_panel=MOCAP,
        ),
    ] = None,
    feedback: Annotated[
        list[str] | None,
        typer.Option(
            metavar="TARGET",
            help="Send what the fingers feel: udp:HOST:PORT (JSON), ws:PORT (JSON to websockets that connect) or tfb:HOST, tfb:HOST/HAND (tactile thimbles); may be given several times.",
            rich_help_panel=MOCAP,
        ),
    ] = None,
    feedback_rate: Annotated[float | None, typer.Option(metavar="HERTZ", help="How often. Default: 60.", rich_help_panel=MOCAP)] = None,
) -> None:
    """Grasp an object, hold it, lift it, shake it, put it down; report how well it was held."""
    from quasirigid.grasp_options import GraspOptions
    from quasirigid.grasp_run import Page, run_grasp

    options = GraspOptions(
        object=object_file,
        scale=scale,
        size=size,
        mass=mass,
        points=points,
        friction=friction,
        material=material,
        dt=dt,
        hold=hold,
        squeeze=squeeze,
        compliance=compliance.value,
        object_motion=object_motion.value,
        threads=threads,
        seed=seed,
    )
    page = Page(host, port, browser) if view else None
    if page is None:
        _refuse_unheard(context, PAGE, "--view", "it is about the page")
    if mocap is None:
        _refuse_unheard(context, MOCAP, "--mocap", "it is about a tracked hand")
    else:
        from quasirigid.mocap.grasp_command import coupled, grasp_mocap
        from quasirigid.mocap.options import MocapOptions

        springs, gains = coupled(coupling, spring, spring_rotation, damping, damping_rotation, joint_stiffness, joint_damping)
        tracked = MocapOptions(
            side=hand,  # type: ignore[arg-type]  # checked by MocapOptions.check
            coupling=coupling,  # type: ignore[arg-type]
            bodies=tracked_bodies,
            springs=springs,
            gains=gains,
            delay=delay,
            hold=loss_hold,
            fade=loss_fade,
        )
        with terminable(), placed("--out"):
            grasp_mocap(
                options,
                mocap,
                tracked,
                bind=bind,
                calibration=calibration,
                place=place,
                certificate=certificate,
                key=key,
                idle=idle,
                out=out,
                record=record,
                feedback=feedback or (),
                feedback_rate=feedback_rate,
                view=page,
                as_json=as_json,
            )
        return
    try:
        with terminable(), placed("--out"), progress_bar(quiet=as_json) as progress:
            result = run_grasp(options, out, record=record, progress=progress, view=page)
    except KeyboardInterrupt as stop:
        say(f"interrupted; what was recorded so far is in {out}")
        raise typer.Exit(exit_code(stop)) from None
    if as_json:
        typer.echo(json.dumps(result.summary, indent=2, allow_nan=False))
    else:
        Console().print(grasp_panel(result))


def _refuse_unheard(context: typer.Context, panel: str, without: str, about: str) -> None:
    """Refuses options of a ``panel`` of the help that would do nothing ``without`` another option."""
    for option in context.command.params:
        given = getattr(context.get_parameter_source(option.name or ""), "name", "") == "COMMANDLINE"
        if given and getattr(option, "rich_help_panel", None) == panel:
            name = (option.secondary_opts if context.params.get(option.name or "") is False else option.opts)[0]
            raise InvalidValueError(name, f"{without} beside it", "none", f"{about}: add {without}, or leave it out")


@app.command()
def bench(
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write all figures to this file, or to standard output if it is -.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer steps and sizes: a look in half a minute.")] = False,
) -> None:
    """Time the step: the paper's two tables beside ours, and how cost grows with contacts, points and threads."""
    from quasirigid.bench import run_bench
    from quasirigid.bench_tables import tables

    if json_file is not None and str(json_file) != "-":
        with placed("--json"):
            json_file.open("a", encoding="utf-8").close()  # a file that cannot be written is found out before, not after
    with working(quiet=False) as progress:
        results = run_bench(quick=quick, progress=progress)
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


@app.command()
def materials() -> None:
    """List the materials that --material knows."""
    from quasirigid._quasirigid import Material

    table = Table(title="Materials", title_justify="left", header_style="bold", box=None, pad_edge=False)
    table.add_column("name", style="cyan", no_wrap=True)
    for heading in (
        "density\nkg/m³",
        "friction\non itself",
        "Young's\nMPa",
        "Poisson's\nratio",
        "layer\nmm",
        "relaxation\nms",
    ):
        table.add_column(heading, justify="right")
    for name in Material.preset_names():
        m = Material.preset(name)
        figures = (m.density, m.friction, 1e-6 * m.young_modulus, m.poisson_ratio, 1e3 * m.layer_thickness, 1e3 * m.relaxation_time)
        table.add_row(name, *(f"{figure:,.4g}" if figure < 1e4 else f"{figure:,.0f}" for figure in figures))
    Console().print(table)
    Console().print("[dim]Two materials have the geometric mean of their frictions. The fingers are of fingertip_pulp.[/dim]")


cli_view.add_to(app)
cli_recordings.add_to(app)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit code."""
    quiet_fonts()
    command = typer.main.get_command(app)
    try:
        code = command.main(args=list(sys.argv[1:] if arguments is None else arguments), prog_name="quasirigid", standalone_mode=False)
        sys.stdout.flush()
    except (BrokenPipeError, SystemExit):
        # Whoever read standard output has seen enough, like `head`: rich and the parser then end the program. Nothing is left to be written at exit.
        with open(os.devnull, "w") as nowhere:
            os.dup2(nowhere.fileno(), 1)
        return 141
    except QuasirigidError as error:
        say(str(error))
        return 2
    except Exception as error:
        # Usage errors of the command line parser; they know their own exit code (2).
        if hasattr(error, "format_message"):
            if error.format_message():  # empty when the help was shown for want of arguments
                command_path = getattr(getattr(error, "ctx", None), "command_path", "quasirigid")
                say(f"{error.format_message().rstrip('.')}; see `{command_path} --help`")
            return int(getattr(error, "exit_code", 2))
        if type(error).__name__ == "Abort":
            return 130
        if isinstance(error, OSError):
            say(f"{error.filename or 'a file'}: {error.strerror or error}; check the path, its permissions, and the room on the disk")
            return 2
        raise
    return code if isinstance(code, int) else 0


if __name__ == "__main__":
    sys.exit(main())
