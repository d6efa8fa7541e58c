"""A hand that is missing, or a hand of the other side, is said to be so within two seconds, and what to do about it."""

from __future__ import annotations

import os
import select
import subprocess
import sys
import time
from typing import Any

import pytest
from hand_frames import Kept
from pinching_hand import COARSE, frames, session_of

from quasirigid import mocap
from quasirigid.mocap.hand_presence import HandPresence
from quasirigid.mocap.options import MocapOptions
from quasirigid.mocap.session import MocapSession
from quasirigid.mocap.source import NetworkSource, TakeSource

WITHIN = 2.0
"""s"""


class Saying:
    """What a session says, and when (s since it began)."""

    def __init__(self, session: MocapSession) -> None:
        self.lines: list[tuple[float, str]] = []
        began = session.source.now()
        session.log = lambda line: self.lines.append((session.source.now() - began, line))

    def first(self, word: str) -> float:
        """When a line with this word was said."""
        times = [at for at, line in self.lines if word in line]
        assert times, self.lines
        return times[0]


def test_a_hand_of_the_other_side_is_said_to_be_one_within_two_seconds() -> None:
    """As DTrack tells of it, and as hand frames of any other source."""
    viewer = Kept()
    taken = MocapSession(COARSE, MocapOptions(side="left"), TakeSource(mocap.shipped_take()), viewer)
    for session, mine, other in ((taken, "left", "right"), (session_of(frames(3, 0.01, side="left")), "right", "left")):
        said = Saying(session)
        assert not session.wait_for_hand()
        assert said.first(f"`--hand {other}`") < WITHIN, said.lines
        assert any(f"this session is for a {mine} one" in line for _, line in said.lines)
        assert len(said.lines) == 1, f"said once: {said.lines}"
        assert session.summary()["absence"]
    assert any("--hand right" in state.notice for state in viewer.states), "the page says so, too"


def test_a_hand_that_goes_away_is_missed_within_two_seconds_and_not_after_it_has_come_back() -> None:
    away = (1.0, 4.0)
    hand = [
        frame
        if not away[0] < frame.time < away[1]
        else mocap.HandFrame(
            "right", frame.positions, frame.quaternions, frame.pad_radii, [False] * 6, time=frame.time, arrival=frame.arrival
        )
        for frame in frames(3, 0.005, before=4.0)
    ]
    session = session_of(hand)
    assert session.wait_for_hand()
    said = Saying(session)
    start = session.source.now()
    notices: list[tuple[float, str]] = []
    session.observers.append(lambda look: notices.append((start + look.time, session._notice)))
    session.run()
    assert away[0] < start + said.first("no right hand") < away[0] + WITHIN
    assert [notice for at, notice in notices if notice and not away[0] < at < away[1] + 0.1] == []


def test_a_tracker_that_sends_nothing_is_said_to_be_silent_within_two_seconds() -> None:
    source = NetworkSource("0", bind="127.0.0.1")
    session = MocapSession(COARSE, MocapOptions(idle=1.0), source)
    said = Saying(session)
    ended = time.monotonic() + 5.0
    source.ended = lambda: bool(said.lines) or time.monotonic() > ended  # type: ignore[method-assign]
    try:
        assert not session.wait_for_hand()
    finally:
        source.close()
    assert said.first("quasirigid mocap monitor") < WITHIN + 0.3, said.lines


def test_a_hand_of_bodies_is_missed_as_such() -> None:
    presence = HandPresence("right", 0.0, bodies=True, when_silent="nothing comes")
    presence.heard(1.9)
    assert "--bodies" in presence.absence(1.9)
    assert presence.absence(1.0) == "", "a hand may take a moment to come"
    presence.saw("right", 1.9)
    assert presence.absence(3.0) == ""
    assert presence.absence(9.0) == "nothing comes"


PRESSED = """
import sys, time
from quasirigid.cli.terminal_keys import reset_key
with reset_key() as keys:
    print("ready" if keys else "none", flush=True)
    end = time.monotonic() + 20.0
    while keys and time.monotonic() < end:
        if keys.pressed():
            print("pressed", flush=True)
            break
        time.sleep(0.01)
print("done", flush=True)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="terminals of POSIX")
def test_the_key_r_in_the_terminal_asks_for_a_reset_and_the_terminal_is_left_as_it_was() -> None:
    import fcntl
    import termios

    ours, theirs = os.openpty()

    def own_terminal() -> None:
        os.setsid()
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)

    before: list[Any] = termios.tcgetattr(theirs)
    with subprocess.Popen(
        [sys.executable, "-c", PRESSED], stdin=theirs, stdout=subprocess.PIPE, text=True, preexec_fn=own_terminal
    ) as program:
        try:
            assert program.stdout is not None
            assert program.stdout.readline() == "ready\n"
            os.write(ours, b"x")
            assert not select.select([program.stdout], [], [], 0.5)[0], "any other key is none"
            os.write(ours, b"r")
            assert program.stdout.readline() == "pressed\n"
            assert program.stdout.readline() == "done\n"
            assert program.wait(timeout=10.0) == 0
        finally:
            program.kill()
    assert termios.tcgetattr(theirs)[3] == before[3], "echo and lines are back"
    os.close(ours)
    os.close(theirs)


def test_without_a_terminal_there_are_no_keys() -> None:
    run = subprocess.run([sys.executable, "-c", PRESSED], stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60, check=True)
    assert run.stdout == "none\ndone\n"
