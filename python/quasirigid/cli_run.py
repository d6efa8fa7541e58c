"""What the commands have in common while they run: progress, a good end, where results go."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from quasirigid.errors import QuasirigidError


class Terminated(KeyboardInterrupt):
    """The process was asked to end (SIGTERM): handled like Ctrl-C, so that the files stay readable."""


def exit_code(stop: KeyboardInterrupt) -> int:
    """Of a run that was interrupted."""
    return 143 if isinstance(stop, Terminated) else 130


@contextmanager
def terminable() -> Iterator[None]:
    """Turns SIGTERM into an exception, so that files are closed on the way out."""

    def stop(_number: int, _frame: FrameType | None) -> NoReturn:
        raise Terminated

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


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
        with terminable(), progress_bar(quiet=quiet) as progress:
            yield progress
    except KeyboardInterrupt as stop:
        say("interrupted")
        raise typer.Exit(exit_code(stop)) from None


def linger(seconds: float | None) -> None:
    """Waits for so long, or for ever. Ctrl-C is the way to end it; SIGTERM ends the program with its exit code."""
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
    except (QuasirigidError, BrokenPipeError):
        raise
    except OSError as error:
        reason = error.strerror or " ".join(str(error).split())
        raise QuasirigidError(str(error.filename or "results"), "a place to write to", reason, f"choose another with {option}") from error


def say(text: str) -> None:
    """One line on standard error."""
    print(f"quasirigid: {' '.join(text.split())}", file=sys.stderr)
