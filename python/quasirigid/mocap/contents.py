"""What is in a take: hands, bodies, rates, dropouts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

from quasirigid._quasirigid import HandDecoder, HandTracker, Packet, Take
from quasirigid.mocap import PARTS


def contents(take: Take) -> dict[str, Any]:
    """Figures of a take, ready for JSON; times in s from its start, rates in Hz."""
    packets = take.packets
    start = packets[0].arrival
    statistics = take.statistics()
    steps = max(1, len(packets) - 1)
    kept = ("lost", "late", "duplicates", "restarts", "tracker_rate", "lateness", "tracker_latency")
    return {
        "packets": len(packets),
        "damaged": take.damaged,
        "duration_s": take.duration,
        "rate_hz": steps / take.duration if take.duration > 0.0 else None,
        "tracker_rate_hz": statistics["tracker_rate"] or None,
        **{name: statistics[name] for name in kept if name not in ("tracker_rate", "lateness", "tracker_latency")},
        "lateness_s": statistics["lateness"],
        "tracker_latency_s": statistics["tracker_latency"],
        "bytes_per_packet": statistics["bytes"] / len(packets),
        "hands": [hand | {"bad_frames": _bad_frames(take, hand["side"])} for hand in _hands(packets, start)],
        "bodies": _bodies(packets, start),
        "other": other_targets(packets),
        "notes": take.notes,
    }


def _gaps(times: Sequence[float], seen: Sequence[bool]) -> list[list[float]]:
    """From and to of every stretch in which something was not seen."""
    gaps: list[list[float]] = []
    open_since: float | None = None
    for time, is_seen in zip(times, seen, strict=True):
        if is_seen and open_since is not None:
            gaps.append([round(open_since, 6), round(time, 6)])
            open_since = None
        elif not is_seen and open_since is None:
            open_since = time
    if open_since is not None:
        gaps.append([round(open_since, 6), round(times[-1], 6)])
    return gaps


def _hands(packets: Sequence[Packet], start: float) -> list[dict[str, Any]]:
    times = [packet.arrival - start for packet in packets]
    rows = [{(number, side): fingers for number, side, fingers in packet.hands} for packet in packets]
    found = sorted({key for row in rows for key in row})
    hands = []
    for key in found:
        count = max(len(row[key]) for row in rows if key in row)
        seen = [key in row for row in rows]
        dropouts = {"hand": _gaps(times, seen)}
        for finger in range(count):
            of_finger = [key in row and finger < len(row[key]) and row[key][finger] for row in rows]
            dropouts[PARTS[finger]] = _gaps(times, of_finger)
        dropouts = {name: gaps for name, gaps in dropouts.items() if gaps}
        hands.append({"id": key[0], "side": key[1], "fingers": list(PARTS[:count]), "seen": sum(seen) / len(seen), "losses_s": dropouts})
    return hands


def _bad_frames(take: Take, side: Literal["left", "right"]) -> int:
    """Frames of a hand of which a pose would be dropped, because no hand can have come there. Of two hands of one side it is the one that
    is followed.
    """
    tracker = HandTracker(side)
    for frame in take.frames(HandDecoder(side)):
        tracker.push(frame)
        tracker.sample(frame.arrival)
    frames: int = tracker.dropped["frames"]
    return frames


def _bodies(packets: Sequence[Packet], start: float) -> list[dict[str, Any]]:
    times = [packet.arrival - start for packet in packets]
    rows = [set(packet.bodies) for packet in packets]
    bodies = []
    for number in sorted(set().union(*rows)):
        seen = [number in row for row in rows]
        bodies.append({"id": number, "seen": sum(seen) / len(seen), "losses_s": _gaps(times, seen)})
    return bodies


def other_targets(packets: Sequence[Packet]) -> dict[str, int]:
    """Most of each other kind of target in one packet."""
    most: dict[str, int] = {}
    for packet in packets:
        for name, count in packet.counts().items():
            if count and name not in ("hands", "bodies", "calibrated_hands", "calibrated_bodies"):
                most[name] = max(most.get(name, 0), count)
    return most
