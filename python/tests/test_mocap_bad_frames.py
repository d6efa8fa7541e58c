"""Frames that no hand can have made: they are dropped and counted, and the object stays in the hand. Pads keep to limits of force and speed
whatever comes.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from hand_frames import START, FrameSource, copied, part, spoilt_frames

from quasirigid import mocap
from quasirigid.arrays.types import FloatArray
from quasirigid.cli.app import main
from quasirigid.grasp.options import GraspOptions
from quasirigid.grasp.setup import Stage
from quasirigid.live.tracked_hand import hand_rows
from quasirigid.mocap.coupling import Coupling, TipCoupling
from quasirigid.mocap.hand_coupling import HandCoupling
from quasirigid.mocap.options import MocapOptions
from quasirigid.mocap.session import MocapSession
from quasirigid.mocap.source import TakeSource
from quasirigid.mocap.springs import FASTEST, MAX_FORCE, MAX_SPEED, Springs
from quasirigid.rotation import quaternion_product, rotate

DT = 0.004
COARSE = GraspOptions(points=6000, dt=DT)
THUMB, INDEX = 0, 1
BAD = ((3.0, 1), (4.8, 2), (6.0, 3))
"""When the frames are bad (s, on the clock of the take; the box is in the air), and how many in a row."""
Fault = Callable[[FloatArray, FloatArray], None]
"""Changes positions (6, 3) m and quaternions (6, 4) of a frame."""


def hand_aside(positions: FloatArray, _: FloatArray) -> None:
    positions += (0.0, 1.0, 0.0)


def index_along_its_pad(by: float) -> Fault:
    """``by`` m towards where the pad of the index finger faces, -z of its tip frame: into the box."""

    def fault(positions: FloatArray, quaternions: FloatArray) -> None:
        positions[INDEX] += rotate(quaternions[INDEX], np.array([0.0, 0.0, -by]))

    return fault


def exchanged(positions: FloatArray, quaternions: FloatArray) -> None:
    for rows in (positions, quaternions):
        rows[[THUMB, INDEX]] = rows[[INDEX, THUMB]]


def flipped(_: FloatArray, quaternions: FloatArray) -> None:
    """Half a turn about the outstretched finger: the nail is where the pad was."""
    quaternions[INDEX] = quaternion_product(quaternions[INDEX], np.array([0.0, 1.0, 0.0, 0.0]))


FAULTS: dict[str, Fault] = {
    "hand 1 m aside": hand_aside,
    "index 100 mm into the box": index_along_its_pad(0.1),
    "index 100 mm off it": index_along_its_pad(-0.1),
    "thumb and index exchanged": exchanged,
    "nail and pad flipped": flipped,
}


def take_with(fault: Fault, rate: float) -> list[mocap.HandFrame]:
    """The frames of the shipped motion at another rate, some of them bad."""
    frames = mocap.Take.pinch(rate=rate).frames(mocap.HandDecoder("right"))
    out = []
    for k, frame in enumerate(frames):
        positions, quaternions = frame.positions.copy(), frame.quaternions.copy()
        if any(round(start * rate) <= k < round(start * rate) + count for start, count in BAD):
            fault(positions, quaternions)
        if frame.time - START < 8.8:
            out.append(copied(frame, frame.arrival, positions=positions, quaternions=quaternions))
    return out


CouplingName = Literal["tips", "hand"]


def played(source: Any, coupling: CouplingName = "tips", **options: Any) -> MocapSession:
    """A session in simulated time, looked at in every step."""
    session = MocapSession(COARSE, MocapOptions(coupling=coupling, idle=0.4, **options), source, observed=1.0 / DT)
    assert session.wait_for_hand()
    session.run()
    return session


def tilt_of(summary: dict[str, Any]) -> float:
    """Of the object in the end, degrees."""
    return float(np.degrees(np.arccos(rotate(np.array(summary["final_pose"][3:]), np.array([0.0, 0.0, 1.0]))[2])))


@pytest.mark.parametrize("rate", [60.0, 240.0])
@pytest.mark.parametrize("name", FAULTS)
def test_bad_frames_do_not_move_the_box(name: str, rate: float) -> None:
    summary = played(FrameSource(take_with(FAULTS[name], rate))).summary()
    lifted, peak, dropped = 1e3 * summary["lifted_m"], max(summary["peak_force_n"]), summary["implausible"]["frames"]
    said = (
        f"{name}, {rate:.0f} Hz: lifted {lifted:.1f} mm, peak {peak:.1f} N, tilt {tilt_of(summary):.1f} degrees, {dropped} frames dropped"
    )
    print(said)
    assert lifted >= 80.0, said
    assert peak <= 40.0, said
    assert summary["put_down"], said
    assert tilt_of(summary) < 2.0, said
    assert dropped == sum(count for _, count in BAD), said


def test_a_hand_that_jumps_for_good_takes_the_box_along() -> None:
    """The tracker is started again while the box is in the air, and sees the hand 0.25 m aside from then on."""

    def jumps(time: float, _: Any, positions: Any) -> None:
        if time > 4.5:
            positions += (0.0, 0.25, 0.0)

    session = MocapSession(COARSE, MocapOptions(idle=0.4), FrameSource(spoilt_frames(jumps)[: 60 * 6]), observed=1.0 / DT)
    assert session.wait_for_hand()
    assert session.coupling is not None
    follow, ends = session.coupling.follow, []

    def followed(targets: mocap.HandTargets, rate: float = 1.0) -> None:
        follow(targets, rate)
        assert session.coupling is not None
        ends.append(session.coupling.ends)

    session.coupling.follow = followed  # type: ignore[method-assign]
    session.run()
    summary = session.summary()
    fastest = float(np.linalg.norm(np.diff(np.array(ends), axis=0), axis=2).max()) / DT
    print(f"pads {fastest:.2f} m/s, peak {max(summary['peak_force_n']):.1f} N, box at {summary['final_pose'][1]:.3f} m")
    assert summary["implausible"] == {"frames": 0, "parts": {}, "jumps": 0, "exchanged": 0, "flipped": 0, "relocations": 1}
    assert fastest < 0.05 + 1.1 * FASTEST[0], "the hand itself moves by less than 0.05 m/s there; the pads swing after the glide by a tenth"
    assert max(summary["peak_force_n"]) < 15.0
    assert not summary["dropped"]
    assert summary["final_pose"][1] == pytest.approx(0.25, abs=0.01)


def seen_by_a_tracker(time: float, away: FloatArray) -> mocap.HandTargets:
    """The hand of the shipped motion at ``time`` s, parts moved by ``away`` (6, 3) m."""
    frame = next(frame for frame in spoilt_frames(lambda *_: None) if frame.time - START >= time)
    tracker = mocap.HandTracker("right")
    tracker.push(copied(frame, frame.arrival, positions=frame.positions + away))
    # Its weight rises from 0 to 1 in a tenth of a second.
    samples = [tracker.sample(frame.arrival + after) for after in (0.0, 0.06, 0.12)]
    assert samples[-1] is not None
    assert samples[-1].weights[[0, 1, 2, 5]].min() == 1.0
    return samples[-1]


@pytest.mark.parametrize("way", ["closes by 1 m", "goes 1 m sideways", "goes 1 m up"])
@pytest.mark.parametrize("coupling", ["tips", "hand"])
def test_whatever_the_tracker_says_pads_keep_to_their_force_and_speed(coupling: CouplingName, way: str) -> None:
    """The filter would not let this through: here the targets of the coupling change from one step to the next."""
    away = np.zeros((6, 3))
    if way.startswith("closes"):
        away[:3, 0] = 1.0, -1.0, -1.0
    else:
        away[:, 0 if way.endswith("sideways") else 2] = 1.0
    stage = Stage.build(COARSE)
    start, goal = seen_by_a_tracker(2.0, np.zeros((6, 3))), seen_by_a_tracker(2.0, away)
    linked: Coupling = (TipCoupling if coupling == "tips" else HandCoupling)(stage.world, start, stage.pad)
    before, fastest, peak = linked.ends, 0.0, 0.0
    box, support = stage.object.index, stage.support.index
    for step in range(100):
        linked.follow(start if step < 25 else goal)
        stage.world.step()
        fastest = max(fastest, float(np.linalg.norm(linked.ends - before, axis=1).max()) / DT) if step else 0.0
        before = linked.ends
        contacts = stage.world.contacts()
        other = np.where(contacts.body_a == box, contacts.body_b, contacts.body_a)
        pressing = np.bincount(other, weights=contacts.reactions[:, 0], minlength=box + 1) if len(other) else np.zeros(1)
        pressing[support if support < len(pressing) else 0] = 0.0
        peak = max(peak, float(pressing.max()))
    print(f"{coupling}, {way}: {peak:.1f} N, {fastest:.2f} m/s")
    assert peak <= MAX_FORCE, f"{peak} N"
    assert fastest <= 1.1 * MAX_SPEED[0], f"{fastest} m/s"
    assert fastest > 0.1, "or this tests nothing"


def test_who_asks_for_a_smaller_largest_force_gets_it(tmp_path: Path) -> None:
    """Springs so stiff that the hand that has closed 10 mm into the box would press with 30 N and more. The joints of the three-finger hand
    also damp, by 2 N where the object pushes a finger back: small limits are for `tips`.
    """
    closed = part(tmp_path, until=2.7)
    tips: dict[str, Any] = {"springs": Springs(stiffness=(6000.0, 0.5))}
    cases: list[tuple[CouplingName, float, dict[str, Any]]] = [("tips", 8.0, tips), ("hand", 20.0, {"gains": (4.0, 2.0)})]
    for coupling, limit, options in cases:
        usual = max(played(TakeSource(closed), coupling, **options).summary()["peak_force_n"])
        limited = max(played(TakeSource(closed), coupling, max_force=limit, **options).summary()["peak_force_n"])
        print(f"{coupling}: {usual:.1f} N, limited to {limit:.0f} N: {limited:.1f} N")
        assert usual > 1.3 * limit, usual
        assert 0.5 * limit < limited <= limit, limited


def test_bad_frames_are_reported_in_the_summary_in_the_view_and_by_inspect(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A take of packets: three of them have the hand of the start, far away from where it is."""
    packets = mocap.shipped_take().packets[:200]
    elsewhere = packets[0].data.split(b"\r\n", 2)[2]
    with mocap.TakeWriter(tmp_path / "bad.take") as writer:
        for k, packet in enumerate(packets):
            counter, clock, hand = packet.data.split(b"\r\n", 2)
            writer.packet(packet.arrival, b"\r\n".join([counter, clock, elsewhere if k in (150, 160, 161) else hand]))
    arguments = ["mocap", "grasp", f"take:{tmp_path / 'bad.take'}", "--points", "6000", "--dt", "0.004", "--idle", "0.2"]
    assert main([*arguments, "--out", str(tmp_path)]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "bad frames 3 dropped (thumb 3, index 3, middle 3, palm 3)" in shown, shown
    assert json.loads((tmp_path / "summary.json").read_text())["implausible"]["frames"] == 3
    assert main(["mocap", "inspect", str(tmp_path / "bad.take")]) == 0
    assert "bad frames 3: no hand moves like that" in " ".join(capsys.readouterr().out.split())
    session = played(TakeSource(mocap.Take.read(tmp_path / "bad.take")))
    targets = session._tracker.sample(session.source.now())
    assert targets is not None
    hand, state = session._tracked(targets), session.scene.state()
    assert ("bad frames", "3 dropped: no hand moves like that") in hand_rows(hand, state)
    assert "bad frames" not in dict(hand_rows(replace(hand, dropped=0), state))
