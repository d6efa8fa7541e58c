"""How a command gets into the program: its help says what it does, then shows examples, then lists the options."""

from __future__ import annotations

from collections.abc import Callable
from inspect import cleandoc
from typing import Any, TypeVar

import typer

from quasirigid.cli.option_groups import expanded

Function = TypeVar("Function", bound=Callable[..., Any])


def command(app: typer.Typer, *examples: tuple[str, str], name: str | None = None) -> Callable[[Function], Function]:
    """A decorator that adds a function to ``app``. The help is the function's docstring and the ``examples``: a command line each, and what
    it does.

    ``name`` is that of the command where it is not the function's.
    """
    lines = "\n".join(f"[cyan]{line}[/cyan]  {what}" for line, what in examples)

    def add(function: Function) -> Function:
        summary = cleandoc(function.__doc__ or "")
        # What follows the first paragraph would be dimmed.
        app.command(name, help=f"{summary}\n\n[not dim][bold]Examples[/bold]\n{lines}[/not dim]" if examples else summary)(
            expanded(function)
        )
        return function

    return add
