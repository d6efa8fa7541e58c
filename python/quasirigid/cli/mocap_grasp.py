"""``quasirigid mocap grasp``: a tracked hand takes the object."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from quasirigid.cli.help import command
from quasirigid.cli.option_groups import GraspChoice, PageOptions, Together
from quasirigid.cli.options import PAGE, RUN, AsJson, Record
from quasirigid.cli.running import placed, refuse_unheard, say

if TYPE_CHECKING:
    from quasirigid.live.grasp_page import Page

HAND, SPRINGS, HEADSET, FEEDBACK = "Tracked hand", "Springs", "Headset (webxr)", "Feedback"
"""Headings of the help."""
EXAMPLES = (
    ("quasirigid mocap grasp dtrack", "your hand; `mocap replay` sends one"),
    ("quasirigid mocap grasp take --view", "a recorded hand, in the browser"),
    ("quasirigid mocap grasp dtrack --coupling hand", "the three-finger hand"),
    ("quasirigid mocap grasp dtrack:192.168.0.7:5000:fw", "through a firewall"),
    ("quasirigid mocap grasp dtrack --calibration lab.toml", "in the room of the lab"),
    ("quasirigid mocap grasp webxr --hand left", "the left hand, seen by a headset"),
    ("quasirigid mocap grasp take --json | jq .lifted_m", "one figure for a script"),
)
NO_EFFECT = ("--hold", "--squeeze")
"""Options of ``grasp`` that ``grasp --mocap`` took and that do nothing for a tracked hand."""


def mocap_grasp(
    context: typer.Context,
    *,
    source: Annotated[
        str,
        typer.Argument(metavar="SOURCE", help="dtrack[:PORT], dtrack:HOST:PORT:fw, webxr[:PORT], take[:FILE]"),
    ],
    hand: Annotated[str, typer.Option(metavar="SIDE", help="left or right.", rich_help_panel=HAND)] = "right",
    coupling: Annotated[str, typer.Option(metavar="KIND", help="tips: single pads; or hand.", rich_help_panel=HAND)] = "tips",
    calibration: Annotated[
        Path | None, typer.Option(metavar="FILE", help="From `quasirigid mocap calibrate`.", rich_help_panel=HAND)
    ] = None,
    tracked_bodies: Annotated[
        str | None,
        typer.Option("--bodies", metavar="MAP", help="On the fingers: thumb=0,index=1,middle=2.", rich_help_panel=HAND),
    ] = None,
    bind: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Listen on. Default: 0.0.0.0, webxr 127.0.0.1.", rich_help_panel=HAND),
    ] = None,
    delay: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="The hand's lag. Default: fits the stream.",
            rich_help_panel=HAND,
        ),
    ] = None,
    loss_hold: Annotated[float, typer.Option(metavar="SECONDS", help="A lost finger keeps its force.", rich_help_panel=HAND)] = 0.5,
    loss_fade: Annotated[float, typer.Option(metavar="SECONDS", help="Then it goes limp.", rich_help_panel=HAND)] = 0.5,
    idle: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="End if nothing comes. Default: 3, webxr 60.",
            rich_help_panel=HAND,
        ),
    ] = None,
    max_force: Annotated[
        float,
        typer.Option(metavar="NEWTON", help="Limit of a fingertip.", rich_help_panel=SPRINGS),
    ] = 40.0,
    spring: Annotated[
        float | None, typer.Option(metavar="N/m", help="From tracked tip to pad. Default: 600.", rich_help_panel=SPRINGS)
    ] = None,
    damping: Annotated[
        float | None, typer.Option(metavar="N*s/m", help="Damping of that spring. Default: 8.", rich_help_panel=SPRINGS)
    ] = None,
    spring_rotation: Annotated[
        float | None, typer.Option(metavar="N*m/rad", help="The same for rotation. Default: 0.5.", rich_help_panel=SPRINGS)
    ] = None,
    damping_rotation: Annotated[
        float | None, typer.Option(metavar="N*m*s/rad", help="Damping of rotation. Default: 0.01.", rich_help_panel=SPRINGS)
    ] = None,
    joint_stiffness: Annotated[
        float | None,
        typer.Option(metavar="FACTOR", help="Of --coupling hand. Default: 1.", rich_help_panel=SPRINGS),
    ] = None,
    joint_damping: Annotated[
        float | None, typer.Option(metavar="FACTOR", help="Of --coupling hand. Default: 1.", rich_help_panel=SPRINGS)
    ] = None,
    place: Annotated[
        str | None,
        typer.Option(metavar="X,Y,Z[,DEG]", help="In the room, m, y up. Default: 0,0.75,-0.4", rich_help_panel=HEADSET),
    ] = None,
    certificate: Annotated[Path | None, typer.Option(metavar="FILE", help="Serve https with it (PEM).", rich_help_panel=HEADSET)] = None,
    key: Annotated[Path | None, typer.Option(metavar="FILE", help="Its key, if in a file of its own.", rich_help_panel=HEADSET)] = None,
    feedback: Annotated[
        list[str] | None,
        typer.Option(
            metavar="TARGET",
            help="udp:HOST:PORT, ws:PORT, tfb:HOST; repeatable.",
            rich_help_panel=FEEDBACK,
        ),
    ] = None,
    feedback_rate: Annotated[
        float | None, typer.Option(metavar="HERTZ", help="Of --feedback. Default: 60.", rich_help_panel=FEEDBACK)
    ] = None,
    chosen: Annotated[GraspChoice, Together(without=("squeeze",))],
    as_json: AsJson = False,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where the files go.", rich_help_panel=RUN)] = Path("out/grasp"),
    record: Record = None,
    view: Annotated[bool, typer.Option("--view", help="Watch it in the browser.", rich_help_panel=PAGE)] = False,
    where: Annotated[PageOptions, Together()],
) -> None:
    """A tracked hand takes the object: from a tracker on the network, a headset, or a take in simulated time."""
    from quasirigid.cli.mocap_session import coupled, run_session
    from quasirigid.mocap.options import MocapOptions

    page: Page | None = None
    if view:
        from quasirigid.live.grasp_page import Page  # the server takes half a second to import: only with a page

        page = Page(where.host, where.port, where.browser, where.allow_origins)
    else:
        others_serve = source.startswith("webxr") or any(target.startswith("ws:") for target in feedback or ())
        refuse_unheard(context, PAGE, "--view", "it is about the page", but=("allow_origin",) if others_serve else ())
    springs, gains = coupled(coupling, spring, spring_rotation, damping, damping_rotation, joint_stiffness, joint_damping)
    tracked = MocapOptions(
        side=hand,  # type: ignore[arg-type]  # checked by MocapOptions.check
        coupling=coupling,  # type: ignore[arg-type]
        bodies=tracked_bodies,
        springs=springs,
        gains=gains,
        max_force=max_force,
        delay=delay,
        hold=loss_hold,
        fade=loss_fade,
    )
    with placed("--out"):
        run_session(
            chosen.options(),
            source,
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
            allow_origins=where.allow_origins,
            view=page,
            as_json=as_json,
        )


def as_mocap_grasp(arguments: list[str]) -> list[str]:
    """The arguments of ``grasp --mocap SOURCE`` as those of ``mocap grasp SOURCE``, for one release and with a warning;
    others as they are.
    """
    if not arguments or arguments[0] != "grasp":
        return arguments
    words = _separated(arguments[1:])
    if "--mocap" not in words[:-1]:
        return arguments
    at = words.index("--mocap")
    source = words[at + 1]
    say(f"`grasp --mocap {source}` is now `mocap grasp {source}`; the old form goes with the next release")
    kept, rest = list[str](), iter([*words[:at], *words[at + 2 :]])
    for word in rest:
        if word in NO_EFFECT:
            say(f"{word} {next(rest, '')} does nothing for a tracked hand: left out")
        else:
            kept.append(word)
    return ["mocap", "grasp", source, *kept]


def _separated(words: list[str]) -> list[str]:
    """``--mocap=take`` as two words, and so the options without effect."""

    def split() -> Iterator[str]:
        for word in words:
            name, equals, value = word.partition("=")
            yield from (name, value) if equals and name in ("--mocap", *NO_EFFECT) else (word,)

    return list(split())


def add_to(app: typer.Typer) -> None:
    """Adds the command to those of ``quasirigid mocap``."""
    command(app, *EXAMPLES, name="grasp")(mocap_grasp)
