"""How a session with a tracked hand went, as the command line shows it."""

from __future__ import annotations

from typing import Any

from rich.console import Group
from rich.markup import escape
from rich.panel import Panel
from rich.table import Table

from quasirigid.mocap.session import MocapResult

MOST_DROPOUTS = 4
"""Dropouts of fingers that are shown, at most."""


def _implausible(dropped: dict[str, Any]) -> list[tuple[str, str]]:
    """Rows about frames that were not believed, ``HandTracker.dropped``; none if there were none."""
    rows = []
    if dropped["frames"]:
        faults = (("jumps", "no hand comes there so soon"), ("exchanged", "fingers exchanged"), ("flipped", "nail and pad flipped"))
        why = ", ".join(text for fault, text in faults if dropped[fault])
        parts = ", ".join(f"{part} {count}" for part, count in dropped["parts"].items())
        rows.append(("bad frames", f"{dropped['frames']} dropped ({parts}): {why}"))
    if dropped["relocations"]:
        rows.append(("elsewhere", f"{dropped['relocations']} times the hand or a finger jumped for good, and was glided to"))
    return rows


def session_panel(result: MocapResult) -> Panel:
    """The figures of a session, under one word that says what became of the object."""
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
    for dropout in s["losses"][:MOST_DROPOUTS]:
        limp = f", limp for {dropout['limp_s']:.1f} s" if dropout["limp_s"] else ", held"
        table.add_row("not seen", f"{dropout['part']}, {dropout['start']:.1f} to {dropout['end']:.1f} s{limp}")
    if len(s["losses"]) > MOST_DROPOUTS:
        table.add_row("", f"and {len(s['losses']) - MOST_DROPOUTS} times more")
    for row in _implausible(s["implausible"]):
        table.add_row(*row)
    if s.get("place_error_m") is not None:
        table.add_row("put down", f"{1e3 * s['place_error_m']:.1f} mm from where the hand put it")
    elif s["fingers"] and not s["upright"]:
        table.add_row("put down", f"no: it has fallen over, tilted by {57.29578 * s['tilt_rad']:.0f} degrees")
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
    verdict, colour = _verdict(s)
    if not s["fingers"]:
        of = "thumb, index, middle finger and palm" if s["coupling"] == "hand" else "thumb and fingers"
        notes.append(f"[yellow]note[/yellow] the session begins when {of} are seen")
        if s["absence"]:
            notes.append(f"[yellow]note[/yellow] {escape(s['absence'])}")
    where = f"[dim]summary{'' if result.recording is None else ' and recording'} in[/dim] {escape(str(result.summary_file.parent))}"
    return Panel(Group(verdict, "", table, "", *notes, where), title="grasp", title_align="left", border_style=colour, expand=False)


def _verdict(summary: dict[str, Any]) -> tuple[str, str]:
    """What became of the object, in a word or two, and the colour of it."""
    if summary["dropped"]:
        word, colour = "dropped", "red"
    elif summary["fingers"] and not summary["upright"]:
        word, colour = "held, then fallen over" if summary["held"] else "fallen over", "red"
    else:
        word, colour = ("held", "green") if summary["held"] else ("not lifted", "yellow")
    return f"[bold {colour}]{word}[/bold {colour}]", colour
