"""Tables of the commands: what is in a take, what comes in live."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.panel import Panel
from rich.table import Table

from quasirigid._quasirigid import HandFrame, Packet
from quasirigid.mocap import PARTS
from quasirigid.mocap.contents import other_targets


def _figures() -> Table:
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(style="dim", min_width=12)
    table.add_column()
    return table


def contents_panel(name: str, c: dict[str, Any]) -> Panel:
    """What ``contents`` found."""
    table = _figures()
    rate = "" if c["rate_hz"] is None else f", {c['rate_hz']:.1f} Hz"
    table.add_row("packets", f"{c['packets']} in {c['duration_s']:.2f} s{rate}, {c['bytes_per_packet']:.0f} bytes each")
    if c["tracker_rate_hz"]:
        late = f", 95 % at most {1e3 * c['lateness_s']:.1f} ms late" if c["lateness_s"] else ""
        table.add_row("tracker", f"{c['tracker_rate_hz']:.1f} Hz{late}")
    table.add_row("frames lost", f"{c['lost']}; {c['late']} late, {c['duplicates']} twice, {c['restarts']} restarts")
    for hand in c["hands"]:
        table.add_row(f"{hand['side']} hand {hand['id']}", f"{', '.join(hand['fingers'])}; seen {100 * hand['seen']:.1f} % of the time")
        for part, gaps in hand["losses_s"].items():
            table.add_row("", f"[yellow]{part} not seen[/yellow] {_spans(gaps)}")
        if hand["bad_frames"]:
            table.add_row("", f"[yellow]bad frames[/yellow] {hand['bad_frames']}: no hand moves like that")
    for body in c["bodies"]:
        lost = f", not seen {_spans(body['losses_s'])}" if body["losses_s"] else ""
        table.add_row(f"body {body['id']}", f"seen {100 * body['seen']:.1f} % of the time{lost}")
    if not c["hands"] and not c["bodies"]:
        table.add_row("hands", "[yellow]none, and no bodies[/yellow]")
    for kind, count in c["other"].items():
        table.add_row(kind.replace("_", " "), str(count))
    if c["damaged"]:
        table.add_row("damaged", f"[yellow]{c['damaged']} packets cut or spoilt, left out[/yellow]")
    notes = [f"[dim]{escape(note)}[/dim]" for note in c["notes"]]
    return Panel(Group(table, *([""] if notes else []), *notes), title=escape(name), title_align="left", expand=False)


def _spans(gaps: Sequence[Sequence[float]]) -> str:
    shown = ", ".join(f"{start:.2f} to {end:.2f} s" for start, end in gaps[:4])
    return shown if len(gaps) <= 4 else f"{shown} and {len(gaps) - 4} times more"


def live_panel(where: str, s: dict[str, Any], packet: Packet | None, hands: Sequence[HandFrame], age: float) -> Panel:
    """What comes in: figures of the stream, hands and bodies of the newest packet, ``age`` s old."""
    table = _figures()
    if packet is None:
        table.add_row("stream", "[yellow]nothing has come yet[/yellow]")
    else:
        silent = f"  [red]silent for {age:.1f} s[/red]" if age > 1.0 else ""
        table.add_row("stream", f"{s['rate']:.1f} Hz of {s['tracker_rate']:.1f} Hz, frame {packet.frame}{silent}")
        latency = "" if s["tracker_latency"] is None else f", tracker {1e3 * s['tracker_latency']:.1f} ms"
        table.add_row("timing", f"jitter {1e3 * s['jitter']:.2f} ms, 95 % at most {1e3 * s['lateness']:.1f} ms late{latency}")
    table.add_row("packets", f"{s['packets']}, lost {s['lost']}, late {s['late']}, twice {s['duplicates']}")
    refused = {name: s[name] for name in ("malformed", "oversize", "empty", "foreign") if s[name]}
    if refused:
        why = f" ({escape(s['last_refusal'])})" if s["last_refusal"] else ""
        table.add_row("refused", "[yellow]" + ", ".join(f"{count} {name}" for name, count in refused.items()) + f"[/yellow]{why}")
    if packet is not None:
        if not any(hand.tracked.any() for hand in hands) and not packet.bodies:
            table.add_row("hands", "[yellow]none seen, and no bodies[/yellow]")
        for kind, count in other_targets([packet]).items():
            table.add_row(kind.replace("_", " "), f"{count}, not used")
    parts = Table(box=None, header_style="bold", pad_edge=False)
    for heading in ("part", "x mm", "y mm", "z mm", "radius mm"):
        parts.add_column(heading, justify="left" if heading == "part" else "right")
    for hand in hands:
        for k, part in enumerate(PARTS):
            if hand.tracked[k]:
                radius = f"{1e3 * hand.pad_radii[k]:.1f}" if part != "palm" else ""
                parts.add_row(f"{hand.side} {part}", *(f"{1e3 * x:.1f}" for x in hand.positions[k]), radius)
            elif hand.present[k]:
                parts.add_row(f"{hand.side} {part}", "[yellow]not seen[/yellow]")
    for number, position in packet.bodies.items() if packet is not None else ():
        parts.add_row(f"body {number}", *(f"{1e3 * x:.1f}" for x in np.asarray(position)))
    shown: list[RenderableType] = [table, "", parts] if parts.row_count else [table]
    return Panel(Group(*shown), title=escape(where), title_align="left", expand=False)
