"""What the commands have in common while they run: progress, a good end, where results go."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from quasirigid.errors import InvalidValueError, QuasirigidError


class Terminated(KeyboardInterrupt):
    """The process was asked to end (SIGTERM), or its terminal has gone (SIGHUP): handled like Ctrl-C, so that files are closed."""

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.number = number
        """Of the signal."""


def exit_code(stop: KeyboardInterrupt) -> int:
    """Of a run that was interrupted: as a shell says it of a program that was ended by the signal."""
    return 128 + (stop.number if isinstance(stop, Terminated) else signal.SIGINT)


@dataclass
class Ending:
    """Whether the program was asked to end."""

    stop: Terminated | None = None
    lost: bool = False
    """Whether Python has dropped the exception."""


@contextmanager
def terminable() -> Iterator[Ending]:
    """Turns SIGTERM and SIGHUP into an exception, once: files are closed on the way out, and a second signal does not disturb that. A
    terminal that is closed sends two.

    A signal that the program was started to ignore (``nohup``) stays ignored.
    """
    ending = Ending()
    if threading.current_thread() is not threading.main_thread():  # signals are for that one
        yield ending
        return

    def end(number: int, _frame: FrameType | None) -> None:
        if ending.stop is None or ending.lost:
            ending.stop, ending.lost = Terminated(number), False
            raise ending.stop

    # A handler runs between any two instructions, also in the callback of a weak reference or in `__del__`, where Python drops exceptions.
    repeats: list[threading.Timer] = []
    usual = sys.unraisablehook

    def dropped(what: sys.UnraisableHookArgs) -> None:
        if not isinstance(what.exc_value, KeyboardInterrupt):
            usual(what)
            return
        ending.lost = True
        number = what.exc_value.number if isinstance(what.exc_value, Terminated) else signal.SIGINT
        repeats.append(threading.Timer(0.02, os.kill, (os.getpid(), number)))
        repeats[-1].start()

    numbers = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]  # Windows has no terminals that hang up
    before = {number: signal.signal(number, end) for number in numbers if signal.getsignal(number) is not signal.SIG_IGN}
    sys.unraisablehook = dropped
    try:
        yield ending
    finally:
        sys.unraisablehook = usual
        for timer in repeats:
            timer.cancel()
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def progress_bar(*, quiet: bool) -> Iterator[Callable[[str, float], None] | None]:
    """A progress bar on standard error, if somebody is there to see it."""
    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield None
        return
    parts = (TextColumn("{task.description:<14}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    with Progress(*parts, console=console, transient=True) as bar:
        task = bar.add_task("setting up", total=1.0)
        yield lambda phase, done: bar.update(task, description=phase, completed=done)


@contextmanager
def working(*, quiet: bool) -> Iterator[Callable[[str, float], None] | None]:
    """A progress bar; an interrupt ends the program with its exit code, in one line."""
    try:
        with progress_bar(quiet=quiet) as progress:
            yield progress
    except KeyboardInterrupt as stop:
        say("interrupted")
        raise typer.Exit(exit_code(stop)) from None


def linger(seconds: float | None) -> None:
    """Waits for so long, or for ever. Ctrl-C is the way to end it; other signals end the program with their exit code."""
    end = None if seconds is None else time.monotonic() + seconds
    try:
        while end is None or time.monotonic() < end:
            time.sleep(0.1)
    except Terminated as stop:
        raise typer.Exit(exit_code(stop)) from None
    except KeyboardInterrupt:
        pass


@contextmanager
def placed(option: str) -> Iterator[None]:
    """Says of a result that cannot be written with which option it can be put elsewhere."""
    try:
        yield
    except QuasirigidError:
        raise
    except OSError as error:
        reason = error.strerror or " ".join(str(error).split())
        raise QuasirigidError(str(error.filename or "results"), "a place to write to", reason, f"choose another with {option}") from error


def say(text: str) -> None:
    """One line on standard error."""
    print(f"quasirigid: {' '.join(text.split())}", file=sys.stderr)


def refuse_unheard(context: typer.Context, panel: str, without: str, about: str, *, but: Sequence[str] = ()) -> None:
    """Refuses options of a ``panel`` of the help, all ``but`` these, that would do nothing ``without`` another option."""
    for option in context.command.params:
        given = getattr(context.get_parameter_source(option.name or ""), "name", "") == "COMMANDLINE"
        if given and option.name not in but and getattr(option, "rich_help_panel", None) == panel:
            name = (option.secondary_opts if context.params.get(option.name or "") is False else option.opts)[0]
            raise InvalidValueError(name, f"{without} beside it", "none", f"{about}: add {without}, or leave it out")
