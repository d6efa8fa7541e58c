"""When a session begins, and with which fingers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hand_frames import Edit, FrameSource, spoilt_frames

from quasirigid import mocap
from quasirigid.grasp.options import GraspOptions
from quasirigid.mocap.hand_presence import LATECOMERS, SETTLE, FingerPresence
from quasirigid.mocap.observation import Observation
from quasirigid.mocap.options import MocapOptions
from quasirigid.mocap.session import MocapSession
from quasirigid.recording.scene_recording import SceneRecording
from quasirigid.render.pictures import waits

COARSE = GraspOptions(points=6000, dt=0.004)


def waited_for(edit: Edit, coupling: str = "tips") -> tuple[MocapSession, list[str], float]:
    """The session once it begins, what it said meanwhile, and how long after the start of the take, s."""
    source, said = FrameSource(spoilt_frames(edit)), list[str]()
    start = source.now()
    session = MocapSession(COARSE, MocapOptions(coupling=coupling), source)  # type: ignore[arg-type]
    session.log = said.append
    assert session.wait_for_hand()
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


def test_a_finger_that_comes_late_is_not_waited_for_and_gets_its_pad_when_it_comes(tmp_path: Path) -> None:
    """The middle finger is seen from 4.2 s on, in the middle of the lift: where it presses on the box that the two others hold."""
    session, _, after = waited_for(unseen(2, 0.0, 4.2))
    assert session.coupling is not None
    assert session.coupling.fingers == ("thumb", "index", "middle")
    assert session.left_out() == ("middle",)
    assert LATECOMERS < after < LATECOMERS + 0.1, f"{after} s"
    pads = session.coupling.pads
    heights, presses = [], []

    def looked(look: Observation) -> None:
        heights.append(float(pads[2].position[2]))
        presses.append(look.pressing[2])

    session.observers.append(looked)
    with session.recorder(tmp_path / "late.h5") as recorder:
        session.run(recorder)
    assert session.left_out() == ()
    assert heights[0] < -1.0, "it waits aside"
    assert heights[-1] == pytest.approx(float(pads[1].position[2]), abs=0.01), "and is in the hand in the end"
    assert max(presses) > 0.5, f"the middle finger presses with {max(presses)} N at most"
    summary = session.summary()
    assert summary["held"], summary["phases"]
    assert summary["peak_force_n"][2] == pytest.approx(max(presses))
    # In a picture what waits is not to be seen, nor does it make the rest small.
    with SceneRecording(tmp_path / "late.h5") as recording:
        names = [body.name for body in recording.model.bodies]
        begin, caught = (recording.state(recording.step_at(moment)) for moment in (0.1, 3.5))
        assert [waits(recording, begin, i) for i in range(len(names))] == [name == "middle" for name in names]
        assert not any(waits(recording, caught, i) for i in range(len(names)))


def test_a_whole_hand_waits_for_all_of_it() -> None:
    with pytest.raises(AssertionError):
        waited_for(unseen(2, 0.0, 20.0), "hand")


def test_a_hand_that_was_seen_for_a_moment_and_has_gone_begins_nothing() -> None:
    """All of it for five frames, and nothing for a second and a half; the index finger does not come back, and its pad waits."""

    def edit(time: float, tracked: Any, _: Any) -> None:
        if 0.08 < time < 1.6:
            tracked[:] = False
        if time >= 1.6:
            tracked[1] = False

    session, _, after = waited_for(edit)
    assert session.coupling is not None
    assert session.left_out() == ("index",), "the index finger was seen at the start only"
    assert after > 1.6 + LATECOMERS, f"{after} s"


def test_only_fingers_with_bodies_are_waited_for() -> None:
    presence = FingerPresence("tips")
    positions, quaternions = np.zeros((6, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (6, 1))
    for k in range(20):
        tracked = [False, True, False, True, False, False]
        frame = mocap.HandFrame(
            "right", positions, quaternions, np.full(6, 0.008), tracked, time=0.02 * k, arrival=0.02 * k, source="dtrack-bodies"
        )
        presence.saw(frame)
        assert presence.enough(0.02 * k) == (0.02 * k > SETTLE)
    assert presence.missing(0.4) == ()
    assert presence.missing(1.0) == ("index",)
    assert not presence.enough(1.0)
