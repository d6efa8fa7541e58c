"""The command line: ``quasirigid grasp``, ``quasirigid view``, ``quasirigid replay``, ``quasirigid render``, ``quasirigid export``,
``quasirigid bench``, ``quasirigid materials``.

Standard output carries the result, standard error everything else. Exit code 0 is a finished run (a dropped object is a
result too), 2 bad input, 130 an interrupt, 143 a SIGTERM, 129 a terminal that has gone, 141 a reader of standard output who left, 1 a bug.
What lasts until Ctrl-C (a page, a recorder of packets) ends with 0 by it.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Annotated

import typer

from quasirigid.cli import bench, grasp, materials, recordings, view
from quasirigid.cli.mocap import app as mocap_commands
from quasirigid.cli.mocap_grasp import as_mocap_grasp
from quasirigid.cli.running import exit_code, say, terminable
from quasirigid.cli.streams import OutputLostError, standard_streams
from quasirigid.errors import QuasirigidError
from quasirigid.render.fonts import quiet_fonts

# What the commands need is imported when they run: `--help` must not wait for Matplotlib.

app = typer.Typer(no_args_is_help=True, add_completion=False, rich_markup_mode="rich", pretty_exceptions_enable=False)


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


grasp.add_to(app)
view.add_to(app)
recordings.add_to(app)
app.add_typer(mocap_commands, name="mocap")
bench.add_to(app)
materials.add_to(app)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit code."""
    quiet_fonts()
    with standard_streams(), terminable() as ending:
        code = _run(list(sys.argv[1:] if arguments is None else arguments))
    return code if ending.stop is None else exit_code(ending.stop)


def _run(arguments: list[str]) -> int:
    command = typer.main.get_command(app)
    try:
        code = command.main(args=as_mocap_grasp(arguments), prog_name="quasirigid", standalone_mode=False)
        sys.stdout.flush()
    except OutputLostError as lost:
        if lost.left:  # and has seen enough, like `head`
            return 141
        say(f"standard output: expected a place to write to, got {lost.reason}; send it elsewhere")
        return 2
    except KeyboardInterrupt as stop:
        return exit_code(stop)
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
