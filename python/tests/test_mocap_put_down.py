"""What a tracked hand puts down stands where it was put, and what does not stand is not said to be put down."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pinching_hand import LIFTS, LOWERS, OPENS, during, frames, session_of, tilt

from quasirigid.mocap.hand_presence import LATECOMERS
from quasirigid.mocap.outcome import Outcome
from quasirigid.mocap.release import Release

STANDS = np.array([0.0, 0.0, 0.04, 1.0, 0.0, 0.0, 0.0])
HAND = np.array([0.0, 0.0, 0.1, 1.0, 0.0, 0.0, 0.0])
ALL_CLOSINGS = [(fingers, closing, 1) for fingers in (2, 3, 5) for closing in (0.005, 0.015, 0.03, 0.045)]
THUMB_LATE = [(fingers, 0.045, 0) for fingers in (2, 3, 5)]


@pytest.mark.parametrize(("fingers", "closing", "late"), ALL_CLOSINGS + THUMB_LATE)
def test_the_box_stands_where_it_was_put_although_a_finger_lets_go_late(fingers: int, closing: float, late: int) -> None:
    # Two fingers begin a session when no third has come.
    before = LATECOMERS + 0.2 if fingers == 2 else 0.0
    session = session_of(frames(fingers, closing, late, before=before))
    assert session.wait_for_hand()
    began = session.source.now() - before
    put = []
    session.observers.append(lambda look: put.append(session.object.position) if began + look.time < OPENS[0] else None)
    session.run()
    summary = session.summary()
    moved = float(np.linalg.norm(session.object.position - put[-1]))
    tilted = math.degrees(tilt(session.object.quaternion))
    print(
        f"{fingers} fingers, {1e3 * closing:.0f} mm: moved by {1e3 * moved:.2f} mm, "
        f"tilted by {tilted:.2f} degrees, {summary['peak_force_n']}"
    )
    assert summary["lifted_m"] > 0.08, f"lifted by {1e3 * summary['lifted_m']:.0f} mm"
    assert summary["put_down"], summary["phases"]
    assert summary["upright"]
    assert moved < 0.005, f"{1e3 * moved:.1f} mm from where it was put"
    assert tilted < 2.0, f"tilted by {tilted:.1f} degrees"


AXIS = np.array([1.0, 0.0, 0.0])
FACING = np.stack([AXIS, -AXIS, -AXIS])
ENDS = np.array([[-0.03, 0.0, 0.0], [0.03, 0.01, 0.0], [0.03, -0.01, 0.0]])
DT = 1e-3


def gripping(stretch: tuple[float, ...], *, steps: int = 400) -> Release:
    """A grip of the thumb and two fingers whose aims have been so deep inside, m, for a while."""
    release = Release(3, DT)
    release.observe(np.ones(3))
    for _ in range(steps):
        release.update(ENDS + np.array(stretch)[:, None] * FACING, ENDS, FACING)
    return release


def left_of(release: Release, stretch: tuple[float, ...]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """The stretches that the springs have when the aims are so deep, m."""
    aims = ENDS + np.array(stretch)[:, None] * FACING
    release.update(aims, ENDS, FACING)
    left: np.ndarray[tuple[int], np.dtype[np.float64]] = ((aims + release.shift - ENDS) * FACING).sum(axis=1)
    return left


def test_the_sides_of_a_grip_let_go_together_and_neither_is_made_weaker_than_the_weaker_one() -> None:
    release = gripping((0.02, 0.01, 0.01))
    # The fingers have let go of six tenths, the thumb of nothing.
    left = left_of(release, (0.02, 0.004, 0.004))
    assert left == pytest.approx([0.008, 0.004, 0.004], abs=1e-4), left
    # And the other way round; whatever is left of the weaker side is not touched.
    left = left_of(gripping((0.02, 0.01, 0.01)), (0.005, 0.01, 0.01))
    assert left == pytest.approx([0.005, 0.0025, 0.0025], abs=1e-4), left
    # Closed again, all is as before.
    assert left_of(release, (0.02, 0.01, 0.01)) == pytest.approx([0.02, 0.01, 0.01], abs=1e-4)


def test_a_hand_that_moves_as_a_whole_keeps_all_of_its_force() -> None:
    """5 mm to the side against the resistance of what it holds: the force on the object is that of the springs, 5 mm of each."""
    left = left_of(gripping((0.02, 0.01, 0.01)), (0.015, 0.015, 0.015))
    assert left == pytest.approx([0.015, 0.015, 0.015], abs=1e-6), left


def test_a_finger_that_is_left_inside_alone_pushes_when_it_goes_deeper() -> None:
    release = gripping((0.02, 0.01, 0.01))
    left_of(release, (0.02, -0.001, -0.001))
    release.observe(np.array([1.0, 0.0, 0.0]))
    assert left_of(release, (0.02, -0.01, -0.01))[0] == pytest.approx(0.0, abs=1e-6), "no push for being late"
    assert left_of(release, (0.025, -0.01, -0.01))[0] == pytest.approx(0.005, abs=1e-6), "5 mm deeper are 5 mm of the spring"
    assert left_of(release, (0.005, -0.01, -0.01))[0] == pytest.approx(0.0, abs=1e-6)
    left_of(release, (-0.001, -0.01, -0.01))
    assert left_of(release, (0.005, -0.01, -0.01))[0] == pytest.approx(0.005, abs=1e-6), "it has been outside: all is new"


def test_tracked_pads_that_have_passed_through_each_other_press_as_if_they_met() -> None:
    left = left_of(gripping((0.045, 0.045, 0.045)), (0.045, 0.045, 0.045))
    assert left == pytest.approx(np.full(3, 0.5 * (0.06 + 0.008)), abs=1e-4), left


def tilted(degrees: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    half = math.radians(degrees) / 2.0
    return np.array([0.0, 0.0, 0.04, math.cos(half), 0.0, math.sin(half), 0.0])


def followed(
    outcome: Outcome, time: float, seconds: float, pose: np.ndarray[tuple[int], np.dtype[np.float64]], press: float, support: float
) -> float:
    for _ in range(round(100.0 * seconds)):
        time += 0.01
        outcome.update(time, pose, np.array([press, press]), support, HAND)
    return time


def test_what_fell_over_is_not_put_down() -> None:
    raised = STANDS + np.array([0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0])
    for degrees, stands in ((5.0, True), (90.0, False)):
        outcome = Outcome(STANDS, ("thumb", "index"))
        time = followed(outcome, 0.0, 0.3, STANDS, 0.0, 2.0)
        time = followed(outcome, time, 0.5, raised, 3.0, 0.0)
        followed(outcome, time, 0.5, tilted(degrees), 0.0, 2.0)
        summary = outcome.summary()
        assert summary["upright"] is stands
        assert summary["put_down"] is stands
        assert summary["phases"][-1]["name"] == ("rest" if stands else "fallen over")
        assert summary["tilt_rad"] == pytest.approx(math.radians(degrees))
        assert (summary["place_error_m"] is not None) is stands


def test_what_was_dropped_is_so_until_it_is_picked_up_again() -> None:
    raised = STANDS + np.array([0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0])
    outcome = Outcome(STANDS, ("thumb", "index"))
    time = followed(outcome, 0.0, 0.5, raised, 3.0, 0.0)
    time = followed(outcome, time, 0.1, raised, 0.0, 0.0)
    assert outcome.phase == "fall"
    time = followed(outcome, time, 0.5, STANDS, 0.0, 2.0)
    assert outcome.phase == "fall", "it lies where it fell"
    assert outcome.summary()["dropped"]
    time = followed(outcome, time, 0.5, raised, 3.0, 0.0)
    assert outcome.phase == "carry"
    followed(outcome, time, 0.5, STANDS, 0.0, 2.0)
    summary = outcome.summary()
    assert summary["put_down"], summary["phases"]
    assert not summary["dropped"]
    assert summary["drops"] == 1


def test_a_reset_puts_the_object_back_at_rest_and_nothing_has_become_of_it() -> None:
    session = session_of(frames(3, 0.015, height=lambda time: 0.1 * during(time, LIFTS)))
    said: list[str] = []
    session.log = said.append
    asked = [False]
    session.resets_asked.append(lambda: asked[0] and not asked.__setitem__(0, False))
    phases: list[str] = []
    at: list[float] = []
    assert session.wait_for_hand()
    start = session.object.position
    began = session.source.now()

    def watch(look: object) -> None:
        time = began + session.world.time
        if session.resets == 0 and LIFTS[1] < time:
            asked[0] = True  # in the air
        if session.resets == 1 and not at:
            at.append(float(np.linalg.norm(session.object.position - start)))
        phases.append(session.outcome.phase if session.outcome is not None else "")

    session.observers.append(watch)
    session.run()
    assert session.resets == 1
    assert at[0] < 1e-3, f"{1e3 * at[0]:.2f} mm from where it stood"
    assert np.linalg.norm(session.object.position - start) < 1e-3
    assert np.linalg.norm(session.object.linear_velocity) < 1e-3
    summary = session.summary()
    assert "carry" in phases, "or this tests nothing"
    assert summary["carried_s"] == 0.0, "nothing has become of it"
    assert summary["lifted_m"] < 1e-3
    assert summary["resets"] == 1
    assert any("back where it stood" in line for line in said)


def test_a_reset_waits_until_the_hand_is_out_of_the_way() -> None:
    """The hand holds the box where it stood: put back between the pads, it would be inside them."""
    session = session_of(frames(3, 0.015, height=lambda _: 0.0))
    pending = [True]
    done_at: list[float] = []
    notices: list[str] = []
    assert session.wait_for_hand()
    began = session.source.now()
    session.resets_asked.append(lambda: bool(pending) and began + session.world.time > LOWERS[0] and pending.pop())

    def watch(look: object) -> None:
        notices.append(session._notice)
        if session.resets and not done_at:
            done_at.append(began + session.world.time)

    session.observers.append(watch)
    session.run()
    assert any("take the hand away" in notice for notice in notices)
    assert OPENS[0] < done_at[0] < OPENS[1] + 0.1, done_at
    assert notices[-1] == ""
