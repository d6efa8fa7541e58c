"""What ``quasirigid mocap grasp`` adds to a session: the viewer, where forces go, keys, and what is printed."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer
from rich.console import Console

from quasirigid.cli.mocap_panel import session_panel
from quasirigid.cli.terminal_keys import RESET_KEY, reset_key
from quasirigid.errors import InvalidValueError
from quasirigid.grasp.options import GraspOptions
from quasirigid.mocap import Calibration
from quasirigid.mocap.feedback import RATE, Feedback, check_rate
from quasirigid.mocap.feedback_targets import open_feedback
from quasirigid.mocap.observation import Viewer
from quasirigid.mocap.options import MocapOptions
from quasirigid.mocap.session import OBSERVED, run_mocap
from quasirigid.mocap.source import NetworkSource, Source, open_source
from quasirigid.mocap.springs import Springs
from quasirigid.mocap.webxr import IDLE, PORT, Placement, XrServer
from quasirigid.net.access import warn_if_open

if TYPE_CHECKING:
    from quasirigid.live.grasp_page import Page
    from quasirigid.live.viewer_process import ViewerProcess


def run_session(
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
    allow_origins: Sequence[str] = (),
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
            sinks.append(open_feedback(text, rate=rate, allow_origins=allow_origins))
            opened.callback(sinks[-1].close)
            if text.startswith("ws:"):
                warn_if_open(text[len("ws:") :].rpartition(":")[0] or "127.0.0.1", "listen", _say)
        if kind == "webxr":
            if calibration is not None or mocap.bodies is not None:
                wrong = "--calibration" if mocap.bodies is None else "--bodies"
                raise InvalidValueError(
                    wrong, "none with the source webxr", calibration or mocap.bodies, "use --place, or recentre in the headset"
                )
            if view is not None:
                raise InvalidValueError(
                    "--view", "another source than webxr", "webxr", "the page for the headset shows the scene, open it on this machine, too"
                )
            headset = opened.enter_context(_open_page(port, bind or "127.0.0.1", mocap.side, place, certificate, key, allow_origins))
            stream: Source = headset
            viewer: Viewer | None = headset
        else:
            for name, value in (("--place", place), ("--certificate", certificate), ("--key", key)):
                if value is not None:
                    raise InvalidValueError(name, "the source webxr", source, "leave it out: it is about the page for a headset")
            stream = open_source(source, bind=bind or "0.0.0.0", watched=view is not None)
            opened.callback(stream.close)
            viewer = None
            if view is not None:
                viewer = page = _open_view(view)
                opened.callback(page.close)
            if isinstance(stream, NetworkSource):
                host, udp = stream.address
                _say(f"listening on UDP {host}:{udp}; Ctrl-C ends it")
                warn_if_open(host, "move the hand; --bind 127.0.0.1 hears this machine alone", _say)
        keys = opened.enter_context(reset_key())
        if keys is not None:
            _say(f"press {RESET_KEY} to put the object back where it stood")
        result = run_mocap(
            options,
            mocap,
            stream,
            out,
            record=record,
            observers=sinks,
            observed=observed,
            viewer=viewer,
            log=_say,
            resets_asked=() if keys is None else (keys.pressed,),
        )
    for sink in sinks:
        _say(f"feedback: {sink.story()}")
    if as_json:
        typer.echo(json.dumps(result.summary, indent=2, allow_nan=False))
    else:
        Console().print(session_panel(result))


def _feedback_rate(asked: float | None, dt: float, feedback: Sequence[str]) -> float:
    """Observations per second that are sent.

    Raises ``InvalidValueError`` for a rate that no target asks for, or that is above that of the steps.
    """
    if asked is None:
        return RATE
    if not feedback:
        raise InvalidValueError("--feedback-rate", "--feedback beside it", "none", "it is about feedback: add --feedback, or leave it out")
    check_rate(asked)
    if asked * dt > 1.0 + 1e-9:
        hint = "ask for less, or make the steps shorter with --dt"
        raise InvalidValueError("--feedback-rate", f"at most one observation per step, {1.0 / dt:g} Hz", f"{asked:g} Hz", hint)
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


def _open_page(
    port: str, host: str, side: str, place: str | None, certificate: Path | None, key: Path | None, allow_origins: Sequence[str]
) -> XrServer:
    if port and not (port.isascii() and port.isdigit() and int(port) <= 65535):
        raise InvalidValueError("source", "webxr or webxr:PORT", f"webxr:{port}", f"port {PORT} is the default")
    page = XrServer(
        int(port or PORT),
        host=host,
        side=side,  # type: ignore[arg-type]  # checked by MocapOptions.check
        placement=None if place is None else Placement.parse(place),
        certificate=certificate,
        key=key,
        allow_origins=allow_origins,
    )
    _say(f"open {page.url} in the headset's browser; Ctrl-C ends it")
    if warn_if_open(host, "drive the hand", _say) and certificate is None:
        _say("browsers give hands to https pages and to localhost only: add --certificate FILE")
    return page


def _open_view(view: Page) -> ViewerProcess:
    from quasirigid.live.server import announce, open_browser
    from quasirigid.live.viewer_process import ViewerProcess

    page = ViewerProcess(host=view.host, port=view.port, allow_origins=view.allow_origins)
    announce(page.url, view.host, view.port, page="live view", can="look on", ends="Ctrl-C ends the session")
    if view.browser:
        open_browser(page.url)
    return page


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


__all__ = ["coupled", "run_session"]
