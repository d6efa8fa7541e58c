"""``quasirigid grasp --mocap``: what the command line adds to a session."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import typer
from rich.console import Console, Group
from rich.markup import escape
from rich.panel import Panel
from rich.table import Table

from quasirigid.grasp_options import GraspOptions
from quasirigid.mocap import Calibration
from quasirigid.mocap.session import MocapOptions, MocapResult, run_mocap
from quasirigid.mocap.stream import NetworkSource, open_source


def grasp_mocap(
    options: GraspOptions,
    source: str,
    *,
    bind: str,
    side: str,
    coupling: str,
    calibration: Path | None,
    bodies: str | None,
    idle: float,
    out: Path,
    record: Path | None,
    as_json: bool,
) -> None:
    """Run a session and print what became of it."""
    mocap = MocapOptions(
        side=side,  # type: ignore[arg-type]  # checked by MocapOptions.check
        coupling=coupling,  # type: ignore[arg-type]
        calibration=None if calibration is None else Calibration.read(calibration),
        bodies=bodies,
        idle=idle,
    )
    mocap.check()
    stream = open_source(source, bind=bind)
    try:
        if isinstance(stream, NetworkSource):
            host, port = stream.address
            _say(f"listening on UDP {host}:{port}; Ctrl-C ends it")
        result = run_mocap(options, mocap, stream, out, record=record, told=_say)
    finally:
        stream.close()
    if as_json:
        typer.echo(json.dumps(result.summary, indent=2, allow_nan=False))
    else:
        Console().print(_panel(result))


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _panel(result: MocapResult) -> Panel:
    s = result.summary
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(style="dim", min_width=16)
    table.add_column()
    table.add_row("object", f"{escape(s['object'])}, {s['object_mass_kg']:.3g} kg, friction {s['friction']:.2g}")
    table.add_row("hand", f"{s['hand']}, coupling {s['coupling']}: {', '.join(s['fingers']) or 'never seen'}")
    if s["fingers"]:
        peaks = "  ".join(f"{name} {force:.2f}" for name, force in zip(s["fingers"], s["peak_force_n"], strict=True))
        table.add_row("pressed", f"{peaks} N at most")
        moved = f"lifted {1e3 * s['lifted_m']:.0f} mm, turned {57.29578 * s['turned_rad']:.0f} degrees, carried {s['carried_s']:.1f} s"
        table.add_row("moved", moved)
    if s.get("place_error_m") is not None:
        table.add_row("put down", f"{1e3 * s['place_error_m']:.1f} mm from where the hand put it")
    if s.get("packet_to_step_ms"):
        waits, late = s["packet_to_step_ms"], s["step_lateness_ms"]
        table.add_row(
            "packet to step", f"{waits['median']:.2f} ms median, {waits['p99']:.2f} ms p99; steps {late['p99']:.2f} ms late at p99"
        )
    if s["steps"]:
        behind = f", {s['slipped_s']:.2g} s behind the clock" if s.get("slipped_s") else ""
        table.add_row("step", f"{s['step_ms_median']:.3f} ms median, {s['step_ms_p99']:.3f} ms p99, {s['steps']} steps{behind}")
    stream: dict[str, Any] = s["stream"]
    table.add_row("stream", f"{stream['packets']} packets, {stream['lost']} lost, {stream['malformed']} refused")
    notes = [f"[yellow]note[/yellow] {escape(note)}" for note in s["warnings"]]
    verdict = (
        "[bold green]held[/bold green]" if s["held"] else "[bold red]dropped[/bold red]" if s["dropped"] else "[bold]not lifted[/bold]"
    )
    where = f"[dim]summary and recording in[/dim] {escape(str(result.summary_file.parent))}"
    colour = "green" if s["held"] else "red" if s["dropped"] else "yellow"
    return Panel(Group(verdict, "", table, "", *notes, where), title="grasp", title_align="left", border_style=colour, expand=False)


__all__ = ["grasp_mocap"]
