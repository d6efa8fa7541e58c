"""``quasirigid grasp --mocap``: what the command line adds to a session."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from rich.console import Console, Group
from rich.markup import escape
from rich.panel import Panel
from rich.table import Table

from quasirigid.errors import InvalidValueError
from quasirigid.grasp_options import GraspOptions
from quasirigid.mocap import Calibration
from quasirigid.mocap.feedback import RATE, Feedback, check_rate, open_feedback
from quasirigid.mocap.look import Viewer
from quasirigid.mocap.options import MocapOptions
from quasirigid.mocap.session import OBSERVED, MocapResult, run_mocap
from quasirigid.mocap.springs import Springs
from quasirigid.mocap.stream import NetworkSource, Source, open_source
from quasirigid.webxr import IDLE, PORT, Placement, XrServer
from quasirigid.webxr.pages import LOCAL

if TYPE_CHECKING:
    from quasirigid.grasp_run import Page
    from quasirigid.view.apart import PageApart

MOST_LOSSES = 4
"""Shown of the losses of fingers."""


def grasp_mocap(
    options: GraspOptions,
    source: str,
    mocap: MocapOptions,
    *,
    bind: str | None,
    calibration: Path | None,
    place: str | None,
    certificate: Path | None,
    key: Path | None,
    idle: float | None,
    out: Path,
    record: Path | None,
    feedback: Sequence[str] = (),
    feedback_rate: float | None = None,
    view: Page | None = None,
    as_json: bool,
) -> None:
    """Run a session and print what became of it."""
    kind, _, port = source.partition(":")
    patience = idle if idle is not None else IDLE if kind == "webxr" else mocap.idle
    mocap = replace(mocap, calibration=None if calibration is None else Calibration.read(calibration), idle=patience)
    mocap.check()
    rate = _feedback_rate(feedback_rate, options.dt, feedback)
    observed = max(OBSERVED, rate) if feedback else OBSERVED
    sinks: list[Feedback] = []
    with ExitStack() as opened:
        for text in feedback:
            sinks.append(open_feedback(text, rate=rate))
            opened.callback(sinks[-1].close)
        if kind == "webxr":
            if calibration is not None or mocap.bodies is not None:
                wrong = "--calibration" if mocap.bodies is None else "--bodies"
                raise InvalidValueError(
                    wrong, "none with --mocap webxr", calibration or mocap.bodies, "use --place, or recentre in the headset"
                )
            if view is not None:
                raise InvalidValueError(
                    "--view", "no --mocap webxr", "both", "the page for the headset shows the scene, open it on this machine, too"
                )
            headset = opened.enter_context(_open_page(port, bind or "127.0.0.1", mocap.side, place, certificate, key))
            stream: Source = headset
            viewer: Viewer | None = headset
        else:
            for name, value in (("--place", place), ("--certificate", certificate), ("--key", key)):
                if value is not None:
                    raise InvalidValueError(name, "--mocap webxr", source, "leave it out: it is about the page for a headset")
            stream = open_source(source, bind=bind or "0.0.0.0", watched=view is not None)
            opened.callback(stream.close)
            viewer = None
            if view is not None:
                viewer = page = _open_view(view)
                opened.callback(page.close)
            if isinstance(stream, NetworkSource):
                host, udp = stream.address
                _say(f"listening on UDP {host}:{udp}; Ctrl-C ends it")
        result = run_mocap(options, mocap, stream, out, record=record, observers=sinks, observed=observed, viewer=viewer, told=_say)
    for sink in sinks:
        _say(f"feedback: {sink.story()}")
    if as_json:
        typer.echo(json.dumps(result.summary, indent=2, allow_nan=False))
    else:
        Console().print(_panel(result))


def _feedback_rate(asked: float | None, dt: float, feedback: Sequence[str]) -> float:
    """Looks per second that are sent. Raises ``InvalidValueError`` for a rate that no target asks for, or that the steps do not give."""
    if asked is None:
        return RATE
    if not feedback:
        raise InvalidValueError("--feedback-rate", "--feedback beside it", "none", "it is about feedback: add --feedback, or leave it out")
    check_rate(asked)
    if asked * dt > 1.0 + 1e-9:
        hint = "ask for less, or make the steps shorter with --dt"
        raise InvalidValueError("--feedback-rate", f"at most one look per step, {1.0 / dt:g} Hz", f"{asked:g} Hz", hint)
    return asked


def coupled(
    coupling: str,
    spring: float | None,
    spring_rotation: float | None,
    damping: float | None,
    damping_rotation: float | None,
    joint_stiffness: float | None,
    joint_damping: float | None,
) -> tuple[Springs, tuple[float, float]]:
    """Springs and gains from the options of the command line. Raises ``InvalidValueError`` for one that the coupling has no use for."""
    of_tips = {"--spring": spring, "--spring-rotation": spring_rotation, "--damping": damping, "--damping-rotation": damping_rotation}
    of_hand = {"--joint-stiffness": joint_stiffness, "--joint-damping": joint_damping}
    idle, other, those = (of_hand, "hand", of_tips) if coupling == "tips" else (of_tips, "tips", of_hand)
    for name, value in idle.items():
        if value is not None and coupling in ("tips", "hand"):
            raise InvalidValueError(name, f"--coupling {other}", f"--coupling {coupling}", f"that has {' and '.join(those)}")
    usual = Springs()
    stiffness = _or(spring, usual.stiffness[0]), _or(spring_rotation, usual.stiffness[1])
    return Springs(stiffness, (_or(damping, usual.damping[0]), _or(damping_rotation, usual.damping[1]))), (
        _or(joint_stiffness, 1.0),
        _or(joint_damping, 1.0),
    )


def _or(value: float | None, usual: float) -> float:
    return usual if value is None else value


def _open_page(port: str, host: str, side: str, place: str | None, certificate: Path | None, key: Path | None) -> XrServer:
    if port and not (port.isascii() and port.isdigit() and int(port) <= 65535):
        raise InvalidValueError("--mocap", "webxr or webxr:PORT", f"webxr:{port}", f"port {PORT} is the default")
    page = XrServer(
        int(port or PORT),
        host=host,
        side=side,  # type: ignore[arg-type]  # checked by MocapOptions.check
        placement=None if place is None else Placement.parse(place),
        certificate=certificate,
        key=key,
    )
    _say(f"open {page.url} in the headset's browser; Ctrl-C ends it")
    if host not in LOCAL:
        _say(f"open to the network ({host}): whoever reaches this port can drive the hand")
        if certificate is None:
            _say("browsers give hands to https pages and to localhost only: add --certificate, see docs/webxr.md")
    return page


def _open_view(view: Page) -> PageApart:
    from quasirigid.view.apart import PageApart
    from quasirigid.view.server import announce, open_browser

    page = PageApart(host=view.host, port=view.port)
    announce(page.url, view.host, view.port, page="live view", can="look on", ends="Ctrl-C ends the session")
    if view.browser:
        open_browser(page.url)
    return page


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
    for loss in s["losses"][:MOST_LOSSES]:
        limp = f", limp for {loss['limp_s']:.1f} s" if loss["limp_s"] else ", held"
        table.add_row("not seen", f"{loss['part']}, {loss['start']:.1f} to {loss['end']:.1f} s{limp}")
    if len(s["losses"]) > MOST_LOSSES:
        table.add_row("", f"and {len(s['losses']) - MOST_LOSSES} times more")
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
    if not s["fingers"]:
        of = "thumb, index, middle finger and palm" if s["coupling"] == "hand" else "thumb and fingers"
        notes.append(f"[yellow]note[/yellow] the session begins when the tracker sees {of}; `quasirigid mocap monitor` shows what comes")
    where = f"[dim]summary{'' if result.recording is None else ' and recording'} in[/dim] {escape(str(result.summary_file.parent))}"
    colour = "green" if s["held"] else "red" if s["dropped"] else "yellow"
    return Panel(Group(verdict, "", table, "", *notes, where), title="grasp", title_align="left", border_style=colour, expand=False)


__all__ = ["coupled", "grasp_mocap"]
