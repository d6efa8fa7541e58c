"""What is not seen for long goes limp and comes back smoothly, wherever it comes back; what becomes of the object is said."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

import numpy as np
import pytest
from hand_frames import Edit, FrameSource, spoilt_frames

from quasirigid import mocap
from quasirigid.arrays.types import FloatArray
from quasirigid.grasp.options import GraspOptions
from quasirigid.mocap.coupling import PALM
from quasirigid.mocap.hand_coupling import JOINT_FASTEST
from quasirigid.mocap.options import MocapOptions
from quasirigid.mocap.session import MocapSession
from quasirigid.mocap.springs import FASTEST

DT = 0.004
COARSE = GraspOptions(points=6000, dt=DT)
HAND = 0.5
"""The hand of the take moves no faster than this, m/s."""
FINGER = 0.095
"""Length of a finger of the three-finger hand, m."""
FASTEST_PAD = {"tips": HAND + 1.1 * FASTEST[0], "hand": HAND + FASTEST[0] + JOINT_FASTEST * FINGER}
"""What is promised, m/s: the hand's own motion, that with which a pad or the base is taken back, that of joints."""
CouplingName = Literal["tips", "hand"]


@dataclass
class Played:
    """Every step of a session: time (n,), apexes of the pads (n, 3, 3) m, base (n, 3) m, weights (n, 6), and its summary."""

    time: FloatArray
    ends: FloatArray
    base: FloatArray
    weights: FloatArray
    summary: dict[str, Any]

    def pad_speed(self) -> float:
        """Of the fastest pad, m/s."""
        return float(np.linalg.norm(np.diff(self.ends, axis=0), axis=2).max()) / DT

    def later_losses(self) -> list[dict[str, Any]]:
        """All but the one that is in the take."""
        first, *others = self.summary["losses"]
        assert first["part"] == "middle"
        assert first["end"] - first["start"] == pytest.approx(0.2, abs=0.06)
        return others

    def base_speed(self) -> float:
        return float(np.linalg.norm(np.diff(self.base, axis=0), axis=1).max()) / DT


def played(edit: Edit, coupling: CouplingName, side: Literal["left", "right"] = "right") -> Played:
    options = MocapOptions(coupling=coupling, side=side, idle=0.8)
    session = MocapSession(COARSE, options, FrameSource(spoilt_frames(edit, side)))
    assert session.wait_for_hand()
    linked = session.coupling
    assert linked is not None
    follow, rows = linked.follow, []

    def followed(targets: mocap.HandTargets, rate: float = 1.0) -> None:
        follow(targets, rate)
        base = linked.hands[0].position if linked.hands else np.zeros(3)
        rows.append((session.world.time, linked.ends, base, targets.weights))

    linked.follow = followed  # type: ignore[method-assign]
    session.run()
    time, ends, base, weights = (np.array(column) for column in zip(*rows, strict=True))
    return Played(time, ends, base, weights, session.summary())


@cache
def whole(coupling: CouplingName, side: Literal["left", "right"] = "right") -> Played:
    """Of a hand that is seen all the time."""
    return played(away(0.0, 0.0, []), coupling, side)


def away(start: float, end: float, rows: list[int], aside: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Edit:
    """Parts that are not seen for a while, after which the whole hand is somewhere else."""

    def edit(time: float, tracked: Any, positions: Any) -> None:
        if start <= time < end:
            tracked[rows] = False
        if time >= end:
            positions += aside

    return edit


@pytest.mark.parametrize("coupling", ["tips", "hand"])
def test_a_hand_that_is_away_for_two_seconds_comes_back_elsewhere_without_a_jump(coupling: CouplingName) -> None:
    aside = (0.06, 0.15, 0.05)
    result = played(away(4.2, 6.2, list(range(6)), aside), coupling)
    print(f"{coupling}: pads {result.pad_speed():.2f} m/s, base {result.base_speed():.2f} m/s")
    assert result.weights[:, [0, 1, 2, PALM]].min() == 0.0
    assert result.pad_speed() < FASTEST_PAD[coupling], f"{result.pad_speed()} m/s"
    assert result.base_speed() < HAND + 1.02 * FASTEST[0], f"{result.base_speed()} m/s"
    # In the end it is where the tracker sees it: the take ends with the open hand about (-30, -120, 340) mm.
    middle = 0.5 * (result.ends[-1, 0] + 0.5 * (result.ends[-1, 1] + result.ends[-1, 2]))
    assert middle == pytest.approx(np.array([-0.03, -0.12, 0.34]) + aside, abs=8e-3), middle
    summary = result.summary
    assert summary["dropped"], "nobody held the box any more"
    assert not summary["held"]
    losses = {loss["part"]: loss for loss in result.later_losses()}
    assert set(losses) == {"thumb", "index", "middle", "palm"}
    for loss in losses.values():
        assert loss["end"] - loss["start"] == pytest.approx(2.0, abs=0.06), loss
        assert loss["limp_s"] == pytest.approx(1.0, abs=0.06), loss


def test_a_palm_that_is_lost_and_seen_again_moves_the_base_without_a_jump() -> None:
    """Bodies on the fingers: the one on the back of the hand is hidden while the hand goes down with the box."""
    result = played(away(5.9, 7.9, [PALM]), "hand")
    still = np.linalg.norm(np.diff(result.base, axis=0), axis=1)[(result.time[1:] > 6.95) & (result.time[1:] < 7.6)]
    assert still.max() == 0.0, "without a palm the base stays"
    gone = float(np.abs(result.base - whole("hand").base).max())
    print(f"base {1e3 * gone:.0f} mm from the palm, taken back at {result.base_speed():.2f} m/s, pads {result.pad_speed():.2f} m/s")
    assert gone > 0.02, "or this tests nothing"
    assert result.base_speed() < HAND + 1.02 * FASTEST[0]
    assert result.pad_speed() < FASTEST_PAD["hand"]
    assert result.base[-1] == pytest.approx(whole("hand").base[-1], abs=1e-3)
    assert [loss["part"] for loss in result.later_losses()] == ["palm"]


@pytest.mark.parametrize("coupling", ["tips", "hand"])
def test_one_finger_that_is_lost_for_long_goes_limp_and_the_others_hold_on(coupling: CouplingName) -> None:
    result = played(away(4.2, 6.2, [2]), coupling)
    limp = (result.time > 5.3) & (result.time < 5.9)
    assert result.weights[limp, 2].max() == 0.0
    summary = result.summary
    assert not summary["dropped"], summary["phases"]
    (loss,) = result.later_losses()
    assert loss["part"] == "middle"
    assert loss["limp_s"] == pytest.approx(1.0, abs=0.06)
    assert result.pad_speed() < FASTEST_PAD[coupling], f"{result.pad_speed()} m/s"


@pytest.mark.parametrize("coupling", ["tips", "hand"])
def test_the_left_hand_does_the_same_in_a_mirror(coupling: CouplingName) -> None:
    right, left = (whole(coupling, side) for side in ("right", "left"))  # type: ignore[arg-type]
    for result, turn in ((right, 1.0), (left, -1.0)):
        summary = result.summary
        assert summary["held"], summary
        assert not summary["dropped"]
        assert 0.095 < summary["lifted_m"] < 0.105, summary["lifted_m"]
        assert summary["place_error_m"] < 0.005, summary["place_error_m"]
        w, z = summary["final_pose"][3], summary["final_pose"][6]
        assert turn * 2.0 * np.arctan2(z, w) == pytest.approx(np.radians(30.0), abs=np.radians(3.0))
    assert left.summary["hand"] == "left"
    # Index and middle finger stand the other way round on the mirrored three-finger hand.
    order = [0, 2, 1] if coupling == "hand" else [0, 1, 2]
    mirrored = left.ends[:, order] * [1.0, -1.0, 1.0]
    n = min(len(right.ends), len(mirrored))
    apart = np.abs(right.ends[:n] - mirrored[:n]).max()
    print(f"{coupling}: {1e3 * apart:.2f} mm from the mirror image")
    assert apart < 4e-3, f"{1e3 * apart:.2f} mm"
