"""When a session begins, and with which fingers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hand_frames import Edit, FrameSource, spoilt_frames

from quasirigid import mocap
from quasirigid.grasp_options import GraspOptions
from quasirigid.mocap.options import MocapOptions
from quasirigid.mocap.session import MocapSession
from quasirigid.mocap.sighting import LATECOMERS, SETTLE, Sighting

COARSE = GraspOptions(points=6000, dt=0.004)


def waited_for(edit: Edit, coupling: str = "tips") -> tuple[MocapSession, list[str], float]:
    """The session once it begins, what it said meanwhile, and how long after the start of the take, s."""
    source, said = FrameSource(spoilt_frames(edit)), list[str]()
    start = source.now()
    session = MocapSession(COARSE, MocapOptions(coupling=coupling), source)  # type: ignore[arg-type]
    assert session.wait_for_hand(said.append)
    return session, said, source.now() - start


def unseen(row: int, start: float, end: float) -> Edit:
    def edit(time: float, tracked: Any, _: Any) -> None:
        if start <= time < end:
            tracked[row] = False

    return edit


def test_without_a_thumb_no_session_begins() -> None:
    session, said, after = waited_for(unseen(0, 0.0, 3.0))
    assert session.coupling is not None
    assert session.coupling.fingers == ("thumb", "index", "middle")
    assert session.left_out() == ()
    assert 2.99 < after < 3.1, f"{after} s"
    assert said == ["still waiting: the tracker does not see thumb"]


def test_a_finger_that_does_not_come_is_left_out_and_that_is_said() -> None:
    session, _, after = waited_for(unseen(2, 0.0, 9.0))
    assert session.coupling is not None
    assert session.coupling.fingers == ("thumb", "index")
    assert session.left_out() == ("middle",)
    assert LATECOMERS < after < LATECOMERS + 0.1, f"{after} s"
    with pytest.raises(AssertionError):
        waited_for(unseen(2, 0.0, 20.0), "hand")  # that needs all three


def test_a_hand_that_was_seen_for_a_moment_and_has_gone_begins_nothing() -> None:
    """All of it for five frames, and nothing for a second and a half; the index finger does not come back, and gets no pad."""

    def edit(time: float, tracked: Any, _: Any) -> None:
        if 0.08 < time < 1.6:
            tracked[:] = False
        if time >= 1.6:
            tracked[1] = False

    session, _, after = waited_for(edit)
    assert session.coupling is not None
    assert session.coupling.fingers == ("thumb", "middle"), "the index finger was seen at the start only"
    assert after > 1.6 + LATECOMERS, f"{after} s"


def test_only_fingers_with_bodies_are_waited_for() -> None:
    sighting = Sighting("tips")
    positions, quaternions = np.zeros((6, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (6, 1))
    for k in range(20):
        tracked = [False, True, False, True, False, False]
        frame = mocap.HandFrame(
            "right", positions, quaternions, np.full(6, 0.008), tracked, time=0.02 * k, arrival=0.02 * k, source="dtrack-bodies"
        )
        sighting.saw(frame)
        assert sighting.enough(0.02 * k) == (0.02 * k > SETTLE)
    assert sighting.missing(0.4) == ()
    assert sighting.missing(1.0) == ("index",)
    assert not sighting.enough(1.0)
