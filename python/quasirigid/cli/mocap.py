"""``quasirigid mocap``: record, replay, inspect, monitor, calibrate."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime, timezone
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.live import Live

from quasirigid._quasirigid import HandDecoder, Packet, Receiver, Replay, Take, TakeWriter
from quasirigid.arrays.types import FloatArray
from quasirigid.cli import mocap_grasp
from quasirigid.cli.help import command
from quasirigid.errors import InvalidValueError
from quasirigid.mocap import PARTS, shipped_take
from quasirigid.mocap.touch_calibration import calibration_from_touches, resting_tip
from quasirigid.net.access import warn_if_open

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="rich",
    help="Motion capture: grasp with a tracked hand; record, replay, inspect and watch what a tracker sends.",
)
mocap_grasp.add_to(app)

CONNECTION = typer.Option(
    "--connection", "-c", metavar="CONNECTION", help="PORT, GROUP:PORT (multicast), HOST:PORT, or HOST:PORT:fw (greets through a firewall)."
)
BIND = typer.Option(
    metavar="ADDRESS", help="Address of this machine to listen on; 127.0.0.1 hears this machine only. For a multicast group: the interface."
)
SECONDS = typer.Option("--seconds", metavar="SECONDS", help="Stop after so long. Default: until Ctrl-C.")
JSON = typer.Option("--json", help="Print figures as JSON and nothing else.")
SHIPPED = "the shipped pinch"


def _say(text: str) -> None:
    print(text, file=sys.stderr)


@contextmanager
def _until_stopped() -> Iterator[None]:
    """Ctrl-C and other signals end what is listened to or sent, and leave its figures to be printed."""
    try:
        yield
    except KeyboardInterrupt:
        _say("stopped")


def _open(connection: str, bind: str) -> Receiver:
    receiver = Receiver(connection, bind=bind)
    host, port = receiver.address
    _say(f"listening on UDP {host}:{port}; Ctrl-C ends it")
    warn_if_open(host, "send packets; --bind 127.0.0.1 hears this machine alone", _say)
    return receiver


def _clock(seconds: float | None) -> float:
    """When to stop, on the monotonic clock."""
    if seconds is None:
        return float("inf")
    if not 0.0 < seconds <= 1e6:
        raise InvalidValueError("--seconds", "a number from 0 to 1e6 (s)", seconds, "leave it out to go on until Ctrl-C")
    return time.monotonic() + seconds


def _load(file: Path | None) -> tuple[str, Take]:
    return (SHIPPED, shipped_take()) if file is None else (str(file), Take.read(file))


@command(
    app,
    ("quasirigid mocap record reach.take", "whatever comes to port 5000"),
    ("quasirigid mocap record reach.take -c 192.168.0.7:5000:fw --seconds 30", "half a minute of one controller, through a firewall"),
    ("quasirigid mocap record reach.take -c 225.1.1.1:5000 --append", "a multicast group, behind what is in the file"),
    ("quasirigid mocap record reach.take --force", "over what is in the file"),
)
def record(
    file: Annotated[Path, typer.Argument(help="Where the packets go: a text file, each packet behind its arrival.")],
    connection: Annotated[str, CONNECTION] = "5000",
    bind: Annotated[str, BIND] = "0.0.0.0",
    seconds: Annotated[float | None, SECONDS] = None,
    append: Annotated[bool, typer.Option("--append", help="Go on behind what is in the file.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace a file that is there.")] = False,
    as_json: Annotated[bool, JSON] = False,
) -> None:
    """Record packets with their arrivals. What is no packet is counted, not recorded."""
    if append and force:
        raise InvalidValueError("--force", "no --append", "both", "one replaces the file, the other goes on behind it")
    if not (append or force) and file.is_file() and file.stat().st_size:
        raise InvalidValueError(str(file), "a new file", "one that is there", "--append goes on behind it, --force replaces it")
    end = _clock(seconds)
    with _open(connection, bind) as receiver, TakeWriter(file, append=append) as writer:
        count, first = 0, 0.0
        with _until_stopped():
            while time.monotonic() < end:
                receiver.wait(min(0.2, max(0.0, end - time.monotonic())))
                for packet in receiver.take():
                    if count == 0:
                        first = packet.arrival
                        writer.note(f"recorded {datetime.now(timezone.utc):%Y-%m-%d %H:%M} UTC from {connection}")
                    writer.packet(packet.arrival - first, packet.data)
                    count += 1
        statistics = receiver.statistics()
    if as_json:
        typer.echo(json.dumps({"file": str(file), "recorded": count, **statistics}, indent=2, allow_nan=False))
    elif count:
        typer.echo(f"{file}: {count} packets, {statistics['lost']} frames lost, {statistics['malformed']} refused")
    else:
        typer.echo(f"{file}: nothing came; is the controller told to send to this machine and port?")


@command(
    app,
    ("quasirigid mocap replay", "the shipped pinch, to port 5000 of this machine"),
    ("quasirigid mocap replay reach.take --to 192.168.0.5:5000 --rounds 0", "again and again, to another machine"),
    ("quasirigid mocap replay --hand left", "the same by a left hand"),
    ("quasirigid mocap replay --bodies", "each fingertip as a 6d body, too"),
    ("quasirigid mocap replay --greeted", "to whoever greets port 50107, as behind a firewall"),
)
def replay(
    file: Annotated[Path | None, typer.Argument(help="A take. Default: the one that is shipped.")] = None,
    to: Annotated[
        list[str] | None, typer.Option(metavar="HOST:PORT", help="Where to; may be given several times. Default: port 5000 here.")
    ] = None,
    speed: Annotated[float, typer.Option(help="2 is twice as fast.")] = 1.0,
    rounds: Annotated[int, typer.Option(min=0, help="How often; 0 is until Ctrl-C.")] = 1,
    bodies: Annotated[bool, typer.Option("--bodies", help="Send each fingertip as a 6d body, too.")] = False,
    greeted: Annotated[bool, typer.Option("--greeted", help="Wait for a greeting, and send to whoever greets.")] = False,
    hand: Annotated[str, typer.Option(help="left: the shipped take in a mirror.")] = "right",
    source_port: Annotated[int, typer.Option(min=0, max=65_535, help="Port to send from; a controller has 50107. 0 is any.")] = 50_107,
    as_json: Annotated[bool, JSON] = False,
) -> None:
    """Send a take as a controller would: in time, from port 50107, hearing greetings of firewalls."""
    if file is not None and hand != "right":
        raise InvalidValueError("--hand", "no FILE: it mirrors the shipped take", f"{hand} with {file}", "leave one of the two out")
    name, take = _load(file) if hand == "right" else (SHIPPED, Take.pinch(side=hand))  # type: ignore[arg-type]  # checked there
    targets = to or ([] if greeted else ["127.0.0.1:5000"])
    with Replay(take, targets, speed=speed, rounds=rounds, source_port=source_port, bodies=bodies) as sender:
        host, port = sender.address
        if source_port and port != source_port:
            _say(f"port {source_port} is taken: sending from {port}, which a firewall may not let in")
        where = " and ".join(targets) if targets else f"whoever greets {host}:{port}"
        _say(f"{name}: {len(take)} packets, {take.duration:.1f} s, to {where}; Ctrl-C ends it")
        warn_if_open(host, "greet and is sent the take", _say)
        with _until_stopped():
            while not sender.wait(0.2):
                pass
        sender.stop()
        state = sender.state()
    if as_json:
        typer.echo(json.dumps({"take": name, "source_port": port, **state}, indent=2, allow_nan=False))
    else:
        typer.echo(f"{state['sent']} packets sent, at most {1e3 * state['latest']:.1f} ms behind time")


@command(
    app,
    ("quasirigid mocap inspect reach.take", "hands, bodies, rate, dropouts"),
    ("quasirigid mocap inspect reach.take --json | jq .hands", "for a script"),
)
def inspect(
    file: Annotated[Path | None, typer.Argument(help="A take. Default: the one that is shipped.")] = None,
    as_json: Annotated[bool, JSON] = False,
) -> None:
    """Say what is in a take: hands, bodies, rate, dropouts."""
    from quasirigid.cli.mocap_tables import contents_panel
    from quasirigid.mocap.contents import contents

    name, take = _load(file)
    found = contents(take)
    if as_json:
        typer.echo(json.dumps({"file": name, **found}, indent=2, allow_nan=False))
    else:
        Console().print(contents_panel(name, found))


@command(
    app,
    ("quasirigid mocap monitor", "a live table of port 5000"),
    ("quasirigid mocap monitor -c 192.168.0.7:5000:fw", "one controller, through a firewall"),
    ("quasirigid mocap monitor --json --every 1", "one line of JSON each second"),
)
def monitor(
    connection: Annotated[str, CONNECTION] = "5000",
    bind: Annotated[str, BIND] = "0.0.0.0",
    seconds: Annotated[float | None, SECONDS] = None,
    every: Annotated[float, typer.Option(metavar="SECONDS", min=0.02, max=60.0, help="Time between two readings.")] = 0.1,
    as_json: Annotated[bool, typer.Option("--json", help="One line of JSON for each reading.")] = False,
) -> None:
    """Watch what comes in: rate, jitter, dropouts, hands and bodies."""
    from quasirigid.cli.mocap_tables import live_panel

    end = _clock(seconds)
    decoders = {"left": HandDecoder("left"), "right": HandDecoder("right")}
    with _open(connection, bind) as receiver, _until_stopped():
        host, port = receiver.address

        def read() -> tuple[dict[str, Any], Packet | None, list[Any], float]:
            if not receiver.take():
                receiver.wait(0.0)  # raises if nothing can come any more
            packet = receiver.latest
            hands = [decoders[side].decode(packet) for side in sorted({side for _, side, _ in packet.hands})] if packet else []
            return receiver.statistics(), packet, hands, receiver.now() - packet.arrival if packet else 0.0

        def pause() -> bool:
            time.sleep(max(0.0, min(every, end - time.monotonic())))
            return time.monotonic() < end

        if as_json:
            going = True
            while going:
                going = pause()
                statistics, packet, hands, _ = read()
                seen = {hand.side: [part for part, tracked in zip(PARTS, hand.tracked, strict=True) if tracked] for hand in hands}
                line = {"frame": packet.frame if packet else None, "hands": seen, "bodies": list(packet.bodies) if packet else []}
                print(json.dumps({**line, **statistics}, allow_nan=False), flush=True)
            return
        where = f"{host}:{port}"
        with Live(live_panel(where, *read()), console=Console(), auto_refresh=False) as live:
            while pause():
                live.update(live_panel(where, *read()), refresh=True)


@command(
    app,
    ("quasirigid mocap calibrate lab.toml", "touch three points with the right index finger"),
    ("quasirigid mocap grasp dtrack --calibration lab.toml", "use it"),
)
def calibrate(
    file: Annotated[Path, typer.Argument(help="Where the calibration goes: a TOML file.")],
    connection: Annotated[str, CONNECTION] = "5000",
    bind: Annotated[str, BIND] = "0.0.0.0",
    hand: Annotated[str, typer.Option(help="left or right.")] = "right",
    finger: Annotated[str, typer.Option(help="The finger that touches: thumb, index, middle, ring or little.")] = "index",
    bodies: Annotated[
        str | None, typer.Option(metavar="MAP", help="Bodies on the fingers, such as thumb=0,index=1, or a TOML file.")
    ] = None,
) -> None:
    """Find where the tracker's room is in the world, by touching three points of the table.

    The world's origin, a point on its x axis, and a point beside it on the side of +y; all on the plane z = 0, the wider apart the better.
    """
    if finger not in PARTS[:5]:
        raise InvalidValueError("--finger", ", ".join(PARTS[:5]), finger, "index is the default")
    decoder = HandDecoder(hand, bodies=bodies)  # type: ignore[arg-type]  # checked there
    with _open(connection, bind) as receiver:
        places, radius = list[FloatArray](), 0.0
        for point in ("the origin of the world", "a point on its x axis", "a point on the side of +y"):
            place, radius = _touch(point, receiver, decoder, finger, len(places))
            _say("  at " + ", ".join(f"{1e3 * x:.1f}" for x in place) + " mm")
            places.append(place)
    calibration = calibration_from_touches(places[0], places[1], places[2], radius)
    calibration.write(file)
    typer.echo(f"{file}: written")


def _touch(point: str, receiver: Receiver, decoder: HandDecoder, finger: str, done: int) -> tuple[FloatArray, float]:
    """Place (3,) m and radius of a fingertip that somebody keeps on ``point``; asks again where it was not seen or moved."""
    while True:
        _say(f"touch {point} with the {decoder.side} {finger}, keep still, and press Enter")
        if not sys.stdin.readline():
            raise InvalidValueError("calibration", "three touches", done, "run it in a terminal and press Enter at each point")
        try:
            return resting_tip(receiver, decoder, finger)
        except InvalidValueError as error:
            _say(f"  {error}; once more")
