"""Steps of a session keep up with the clock, and what comes late is made up for without a jump."""

from __future__ import annotations

import gc
from collections import deque

import numpy as np
import pytest

from quasirigid import mocap
from quasirigid.mocap.real_time_clock import CATCH_UP, LATE, SLACK, RealTimeClock, undisturbed


class Clock:
    """A clock that goes on only when it is told to: all that ``RealTimeClock`` asks of a source."""

    time = 0.0

    def now(self) -> float:
        return self.time

    def wait_until(self, moment: float) -> None:
        self.time = max(self.time, moment)


def run_clock(*, listens_late: bool) -> RealTimeClock:
    """Five seconds on a computer that is fast enough: 1500 packets at any moment, steps of 1 ms that take 0.6 ms."""
    clock, arrivals = Clock(), deque(np.sort(np.random.default_rng(1).uniform(0.0, 5.0, 1500)).tolist())
    clock_under_test = RealTimeClock(clock, 1e-3)  # type: ignore[arg-type]

    def come() -> list[float]:
        return [arrivals.popleft() for _ in range(len(arrivals)) if arrivals[0] <= clock.time]

    for step in range(5000):
        before = come() if listens_late and step % 4 == 0 else []
        clock_under_test.wait()
        clock_under_test.begin(before if listens_late else come())
        clock.time += 6e-4
    return clock_under_test


def test_a_packet_waits_for_one_step_at_most() -> None:
    clock_under_test = run_clock(listens_late=False)
    assert len(clock_under_test.waits) == 1500
    assert max(clock_under_test.waits) <= 1e-3 + 1e-9, f"{1e3 * max(clock_under_test.waits):.3f} ms"
    assert clock_under_test.slipped == 0.0
    assert clock_under_test.passed_over == 0


def test_packets_that_a_step_passed_over_are_counted() -> None:
    """Three of four steps do not listen: what comes more than a millisecond before the last of them is late by its own fault."""
    assert run_clock(listens_late=True).passed_over > 500


def test_steps_that_are_late_hurry_and_so_catch_up() -> None:
    """For half a second steps of 1 ms take 1.1 ms, unless they hurry: then 0.8 ms. They are late by one such step at most."""
    clock = Clock()
    clock_under_test = RealTimeClock(clock, 1e-3)  # type: ignore[arg-type]
    hurried = []
    for step in range(1000):
        clock_under_test.wait()
        clock_under_test.begin([])
        hurried.append(clock_under_test.hurried)
        clock.time += 5e-4 if step >= 500 else 8e-4 if clock_under_test.hurried else 1.1e-3
    assert max(clock_under_test.lateness) <= LATE + 1e-4 + 1e-9, f"{1e3 * max(clock_under_test.lateness):.3f} ms late"
    assert 0.2 < np.mean(hurried[:500]) < 0.5, f"{np.mean(hurried[:500])} of the steps hurried"
    assert not any(hurried[510:]), "none has to when there is time"


def test_a_slow_computer_shows_the_hand_late_but_never_in_jumps() -> None:
    """Steps of 1 ms that take 2 ms, and one stop of half a second."""

    clock = Clock()
    clock_under_test = RealTimeClock(clock, 1e-3)  # type: ignore[arg-type]
    shown, behind = [], []
    for step in range(6000):
        shown.append(clock_under_test.wait())
        behind.append(clock.time - shown[-1])
        clock.time += 0.5 if step == 3000 else 2e-3
    assert np.diff(shown).max() < 5e-3, "a jump"
    assert abs(behind[-1] - (SLACK + CATCH_UP)) < 0.01, f"{behind[-1]} s behind: twice as fast keeps up with a computer half as fast"


def test_after_a_stop_of_the_program_the_hand_glides_to_where_it_is() -> None:
    """The program is stopped for 2.5 s, in which the hand goes on by 0.3 m: its clock is set forward, the target is not."""
    clock, speed, dt, glide = Clock(), 0.12, 1e-3, 0.5
    clock_under_test, tracker = RealTimeClock(clock, dt), mocap.HandTracker("right")  # type: ignore[arg-type]
    turns, seen = np.tile([1.0, 0.0, 0.0, 0.0], (6, 1)), [True] * 6
    shown, sent = [], 0
    for step in range(4000):
        due = clock_under_test.wait()
        while sent / 60.0 <= clock.time:
            places = np.tile([speed * sent / 60.0, 0.0, 0.0], (6, 1))
            tracker.push(mocap.HandFrame("right", places, turns, np.full(6, 0.008), seen, time=sent / 60.0, arrival=sent / 60.0))
            sent += 1
        targets = tracker.sample(due)
        assert targets is not None
        assert targets.weights[0] == 1.0 or step < 200
        shown.append(float(targets.positions[0, 0]))
        clock.time += 2.5 if step == 2000 else 5e-4
    steps = np.abs(np.diff(shown[500:]))
    stop = int(steps.argmax())
    # What is made up for in the one step after a stop is that of 0.1 s.
    assert steps[stop] < 0.1 * (speed + glide), f"{1e3 * steps[stop]:.0f} mm at once"
    assert np.delete(steps, stop).max() < 1.2 * dt * (speed + glide), f"{1e3 * np.delete(steps, stop).max():.2f} mm in a step"
    assert shown[-1] == pytest.approx(speed * clock.time, abs=0.02), "it is there in the end"


def test_what_the_program_around_a_session_has_frozen_stays_frozen() -> None:
    assert gc.get_freeze_count() == 0
    with undisturbed():
        assert gc.get_freeze_count() > 0
    assert gc.get_freeze_count() == 0
    gc.freeze()
    try:
        with undisturbed():
            pass
        assert gc.get_freeze_count() > 0
    finally:
        gc.unfreeze()
