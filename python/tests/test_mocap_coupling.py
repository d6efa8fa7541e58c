"""Springs to a tracker of any rate, with loss, jitter, duplicates and overtaking: no jump, no energy out of nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from hand_frames import START, copied

from quasirigid import HandModel, World, mocap
from quasirigid.arrays.types import FloatArray
from quasirigid.errors import InvalidShapeError, InvalidValueError
from quasirigid.grasp.options import GraspOptions
from quasirigid.grasp.setup import GRAVITY, Stage
from quasirigid.mocap.coupling import PAD_MASS, Coupling, TipCoupling
from quasirigid.mocap.hand_coupling import HandCoupling
from quasirigid.mocap.springs import Offset
from quasirigid.rotation import conjugate, quaternion_product, rotate, rotation_vector

FROM, TO = 1.6, 5.9
"""The part of the take that closes, lifts by 10 cm and turns, s."""
DT = 4e-3


def disturbed(rate: float, seed: int) -> tuple[list[mocap.HandFrame], float]:
    """Frames of the shipped motion as a bad network brings them, by arrival, and the largest speed of a tip of the hand, m/s."""
    random = np.random.default_rng(seed)
    frames = mocap.Take.pinch(rate=rate, noise=0.0, tremor=0.0).frames(mocap.HandDecoder("right"))
    frames = [frame for frame in frames if FROM - 0.5 <= frame.time - START <= TO]
    tips = np.array([frame.positions[:3] for frame in frames if frame.time - START >= FROM])
    steps = np.linalg.norm(np.diff(tips, axis=0), axis=2)
    out = []
    for frame in frames:
        if random.random() < 0.2:
            continue
        for _ in range(2 if random.random() < 0.1 else 1):
            out.append(copied(frame, frame.time - START + random.uniform(0.0, 0.01)))
    return sorted(out, key=lambda frame: frame.arrival), float(np.nanmax(steps)) * rate


RATES = pytest.mark.parametrize("rate", [30.0, 60.0, 120.0, 240.0, 500.0])


def steps(rate: float, stage: Stage, couple: Callable[[mocap.HandTargets], Coupling]) -> Iterator[tuple[Coupling, mocap.HandTargets]]:
    """Every step of a session on a bad stream, between aiming and stepping."""
    frames, _ = disturbed(rate, seed=int(rate))
    tracker = mocap.HandTracker("right")
    coupling: Coupling | None = None
    for step in range(round((TO - FROM + 0.4) / DT)):
        now = FROM - 0.4 + step * DT
        while frames and frames[0].arrival <= now:
            tracker.push(frames.pop(0))
        targets = tracker.sample(now)
        if targets is None or now < FROM:
            continue
        coupling = coupling or couple(targets)
        coupling.follow(targets)
        yield coupling, targets
        stage.world.step()


@RATES
def test_springs_to_a_bad_stream_neither_jump_nor_make_energy(rate: float) -> None:
    _, fastest = disturbed(rate, seed=int(rate))
    stage = Stage.build(GraspOptions(points=6000, dt=DT))
    step_max, worst, work, started = 0.0, -np.inf, 0.0, 0.0
    before: tuple[FloatArray, FloatArray] | None = None
    places: FloatArray | None = None
    last: mocap.HandTargets | None = None

    def look(coupling: TipCoupling) -> None:
        """After a step."""
        nonlocal step_max, worst, work, started, places, before
        now = np.array([pad.position for pad in coupling.pads])
        if last is not None and places is not None:
            step_max = max(step_max, float(np.linalg.norm(now - places, axis=1).max()))
            aims = aimed_at(coupling, last)
            # The hand moves the targets against the pull of the springs at the end of the step.
            if before is not None:
                work += hand_work(coupling, last, before, aims)
            before = aims
            energy = energy_of(stage, coupling, aims)
            started = started or energy
            worst = max(worst, energy - started - work)
        places = now

    coupling: TipCoupling | None = None
    for coupled, targets in steps(rate, stage, lambda targets: TipCoupling(stage.world, targets, stage.pad)):
        assert isinstance(coupled, TipCoupling)
        coupling = coupled
        look(coupling)
        last = targets
    assert coupling is not None
    look(coupling)
    lift = float(stage.object.position[2] - stage.start[2])
    print(
        f"{rate:.0f} Hz: largest step {step_max / (fastest * DT):.2f} of the hand's, "
        f"energy made {1e3 * worst:.3f} mJ of {1e3 * work:.1f}, lift {lift:.4f}"
    )
    assert step_max < 1.3 * fastest * DT, f"{1e3 * step_max:.2f} mm in a step; the hand itself {1e3 * fastest * DT:.2f} mm"
    assert worst < 2e-4, f"{1e3 * worst:.3f} mJ out of nothing; the hand did {1e3 * work:.1f} mJ"
    assert 0.095 < lift < 0.105, f"lifted by {1e3 * lift:.1f} mm"


@RATES
def test_the_three_finger_hand_does_not_jump_on_a_bad_stream(rate: float) -> None:
    """Energy is not asked for: who moves the base of a hand puts in whatever it takes."""
    _, fastest = disturbed(rate, seed=int(rate))
    stage = Stage.build(GraspOptions(points=6000, dt=DT))
    ends, bases = [], []
    for coupling, _ in steps(rate, stage, lambda targets: HandCoupling(stage.world, targets, stage.pad)):
        ends.append(coupling.ends)
        bases.append(coupling.hands[0].position)
    step_max, base_max = (float(np.linalg.norm(np.diff(rows, axis=0), axis=-1).max()) for rows in (np.array(ends), np.array(bases)))
    lift = float(stage.object.position[2] - stage.start[2])
    print(
        f"{rate:.0f} Hz: largest step of a pad {step_max / (fastest * DT):.2f} of the hand's, "
        f"of the base {base_max / (fastest * DT):.2f}, lift {lift:.4f}"
    )
    assert step_max < 1.3 * fastest * DT, f"{1e3 * step_max:.2f} mm in a step; the hand itself {1e3 * fastest * DT:.2f} mm"
    assert base_max < 1.3 * fastest * DT, f"{1e3 * base_max:.2f} mm in a step; the hand itself {1e3 * fastest * DT:.2f} mm"
    assert 0.095 < lift < 0.105, f"lifted by {1e3 * lift:.1f} mm"


def aimed_at(coupling: TipCoupling, targets: mocap.HandTargets) -> tuple[FloatArray, FloatArray]:
    """Where the springs of the step pull: places (n, 3) and quaternions (n, 4)."""
    places, turns, _ = coupling._pads(targets)
    rows = list(coupling.rows)
    return places[rows], turns[rows]


def pulls(coupling: TipCoupling, aims: tuple[FloatArray, FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Stretches of the springs now, (n, 3) m and rad."""
    linear = aims[0] - np.array([pad.position for pad in coupling.pads])
    turns = zip(aims[1], coupling.pads, strict=True)
    return linear, np.array([rotation_vector(quaternion_product(turn, conjugate(pad.quaternion))) for turn, pad in turns])


def hand_work(
    coupling: TipCoupling, targets: mocap.HandTargets, before: tuple[FloatArray, FloatArray], aims: tuple[FloatArray, FloatArray]
) -> float:
    """What the person has done in this step, J: pull of springs and dampers times the way of their ends."""
    (k, kr), (d, dr) = coupling.springs.stiffness, coupling.springs.damping
    rows = list(coupling.rows)
    linear, angular = pulls(coupling, aims)
    omega = targets.angular_velocities[rows]
    _, _, arms = coupling._pads(targets)
    v = targets.linear_velocities[rows] + np.cross(omega, arms[rows])
    slip = v - np.array([pad.linear_velocity for pad in coupling.pads])
    twist = omega - np.array([pad.angular_velocity for pad in coupling.pads])
    turned = np.array([rotation_vector(quaternion_product(b, conjugate(a))) for a, b in zip(before[1], aims[1], strict=True)])
    springs = k * np.sum(linear * (aims[0] - before[0])) + kr * np.sum(angular * turned)
    return float(springs + d * DT * np.sum(slip * v) + dr * DT * np.sum(twist * omega))


def energy_of(stage: Stage, coupling: TipCoupling, aims: tuple[FloatArray, FloatArray]) -> float:
    """Kinetic energy of box and pads, height of the box, springs, J. What the soft surfaces hold comes on top and is never negative."""
    (k, kr), thing = coupling.springs.stiffness, stage.object
    linear, angular = pulls(coupling, aims)
    inertia = stage.target.mass.inertia
    turn = conjugate(thing.quaternion)
    spin = rotate(turn, thing.angular_velocity)
    mass = thing.mass
    kinetic = 0.5 * mass * np.sum(thing.linear_velocity**2) + 0.5 * spin @ inertia @ spin
    kinetic += sum(0.5 * PAD_MASS * np.sum(pad.linear_velocity**2) for pad in coupling.pads)
    return float(kinetic + mass * GRAVITY * thing.position[2] + 0.5 * k * np.sum(linear**2) + 0.5 * kr * np.sum(angular**2))


def test_a_finger_that_is_lost_is_caught_again_where_it_is() -> None:
    offset = Offset((2, 0.5))
    stretch = np.array([0.03, -0.01])
    offset.update(0.0, None, 1e-3)
    energy, worst = 0.0, 0.0
    for weight in np.linspace(0.0, 1.0, 101)[1:]:
        offset.update(float(weight), stretch, 0.0)
        energy = float(weight * np.sum((stretch + offset.value) ** 2))
        worst = max(worst, energy)
    assert worst < 1e-12, f"the spring holds {worst} of k m^2 that nobody has put in"
    fastest = 0.0
    for _ in range(1500):
        before = offset.value
        offset.update(1.0, None, 1e-3)
        fastest = max(fastest, float(np.linalg.norm(offset.value - before)) / 1e-3)
    assert fastest < 0.5, f"taken back at {fastest} m/s"
    assert offset.zero


def test_a_finger_comes_as_near_as_it_can() -> None:
    hand = World().add_hand()
    start, normal = np.array([-0.03, 0.0, -0.085]), np.array([1.0, 0.0, 0.0])
    exact = hand.inverse_kinematics(0, start, normal)
    joints, miss = hand.reach(0, start + [0.001, 0.0, 0.0], normal, start=exact)
    assert miss < 1e-3, f"{1e3 * miss:.2f} mm off at 1 mm from where it was"
    assert np.abs(joints - exact).max() < 0.2
    far, miss = hand.reach(0, [0.0, 0.0, -1.0], normal, start=exact)
    model = HandModel.three_finger()
    assert 0.5 < miss < 1.0, "a metre is out of reach"
    assert np.all((model.lower_limits[0] - 1e-12 <= far) & (far <= model.upper_limits[0] + 1e-12))
    starts = np.tile(exact, (3, 1))
    goals = np.array([start, start + [0.06, 0.0, 0.0], [0.0, 0.0, -1.0]])
    ways = np.array([normal, -normal, normal])
    together, errors = hand.reach_all(goals, ways, starts)
    for finger in range(3):
        alone, error = hand.reach(finger, goals[finger], ways[finger], start=starts[finger])
        assert np.array_equal(together[finger], alone)
        assert errors[finger] == error
    ends = [hand.reach_all(goals, ways, starts, iterations=500, step_tolerance=tolerance)[0] for tolerance in (1e-8, 1e-12)]
    assert np.abs(ends[0] - ends[1]).max() < 1e-6, "where joints move no more, the search is at its end"
    with pytest.raises(InvalidShapeError, match="start"):
        hand.reach_all(goals, ways, exact)
    with pytest.raises(InvalidValueError, match="step tolerance"):
        hand.reach_all(goals, ways, starts, step_tolerance=-1.0)
    with pytest.raises(InvalidValueError):
        hand.reach(0, [np.nan, 0.0, 0.0], normal)
    with pytest.raises(InvalidValueError, match="iterations: expected a whole number"):
        hand.reach(0, start, normal, iterations=-1)
