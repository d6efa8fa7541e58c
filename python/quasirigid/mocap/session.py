"""A person's tracked hand takes an object: ``quasirigid mocap grasp``.

Every step asks the tracking filter where the hand is at this moment, aims the springs there, and goes on. ``OBSERVED`` times a second
the state of the object is observed: for the recording, the outcome, the feedback to the person.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from quasirigid._quasirigid import HandDecoder, HandFrame, HandTargets, HandTracker, Packet, StepReport, __version__
from quasirigid.arrays.types import FloatArray
from quasirigid.errors import InvalidValueError, NetworkError
from quasirigid.grasp.columns import contact_sums
from quasirigid.grasp.options import GraspOptions
from quasirigid.grasp.setup import GRAVITY, Stage
from quasirigid.mocap import PARTS
from quasirigid.mocap.coupling import PALM, Coupling, TipCoupling
from quasirigid.mocap.dropouts import Dropouts
from quasirigid.mocap.hand_coupling import HandCoupling
from quasirigid.mocap.hand_presence import ABSENT, LATECOMERS, FingerPresence, HandPresence
from quasirigid.mocap.observation import Observation, Observer, Viewer, contact_wrenches, press_and_slip
from quasirigid.mocap.options import MocapOptions
from quasirigid.mocap.outcome import Outcome
from quasirigid.mocap.real_time_clock import RealTimeClock, undisturbed
from quasirigid.mocap.reset import WAITS, Reset, pose_of
from quasirigid.mocap.source import Source
from quasirigid.recording.reader import Column
from quasirigid.recording.scene_recorder import SceneRecorder
from quasirigid.scene.indentation import indentation_note
from quasirigid.scene.model import SceneState, TrackedHand
from quasirigid.scene.world import WorldScene

OBSERVED = 100.0
"""Times per second of simulated time that the session is observed: recording, outcome, feedback."""
DEFORMATION_RATE = 20.0
"""Times per second that the surfaces are recorded."""
STEP_SHARE, HURRIED_SHARE = 0.7, 0.5
"""Share of ``dt`` that a step may take, and one that begins late: with what else is done between two steps late ones catch up."""
WAITING = "waiting for the hand"


class MocapSession:
    """The scene of ``quasirigid grasp`` on its support, and the hand that ``source`` tracks."""

    def __init__(
        self, options: GraspOptions, mocap: MocapOptions, source: Source, viewer: Viewer | None = None, *, observed: float = OBSERVED
    ) -> None:
        """Build the scene, and show it to ``viewer``. ``observed``: times per second of simulated time that it is observed.

        Raises the errors of ``quasirigid.errors``.
        """
        mocap.check()
        self.options = replace(options, support=options.support or "table")
        self.mocap, self.source, self.viewer = mocap, source, viewer
        self.stage = Stage.build(self.options, step_budget=STEP_SHARE * options.dt if source.real_time else None)
        self.world, self.object = self.stage.world, self.stage.object
        self.mat = self.stage.stands_on.add_mat(self.world)
        self._decoder = HandDecoder(mocap.side, bodies=mocap.bodies)
        self.side = self._decoder.side
        """Of the tracked hand: a file that says which bodies are on the fingers says this, too."""
        self._tracker = HandTracker(self.side, calibration=mocap.calibration, delay=mocap.delay, hold=mocap.hold, fade=mocap.fade)
        self._last_arrival = source.now()
        self._every = observation_interval(observed, options.dt)
        self._finger_presence = FingerPresence(mocap.coupling)
        self._presence = HandPresence(self.side, source.now(), bodies=mocap.bodies is not None, when_silent=source.when_silent)
        self._notice = ""
        self.log: Callable[[str], None] = lambda _: None
        """Gets what a person in the terminal should know."""
        self.resets_asked: list[Callable[[], bool]] = [] if viewer is None else [viewer.reset_asked]
        """Each says whether a reset was asked for since it was last called."""
        self._reset = Reset(self.object)
        self._newest: Packet | HandFrame | None = None
        self._hand_number = 0
        self.coupling: Coupling | None = None
        self.clock: RealTimeClock | None = None
        self.outcome: Outcome | None = None
        self.dropouts = Dropouts()
        self.observers: list[Observer] = []
        self.step_times: list[float] = []
        self.unconverged = 0
        self.indentation = 0.0
        self._show(WorldScene(self.world))

    def _show(self, scene: WorldScene) -> None:
        self.scene = scene
        if self.viewer is not None:
            self.viewer.begin(scene.model)
            self.viewer.draw(scene.state(phase=WAITING))

    # What goes on beside the steps.

    def _watch(self) -> None:
        """Say whether the hand is missing, and put the object back if that was asked for. Some ten times per second and more."""
        notice = self._presence.absence(self.source.now())
        # All are asked, so that none keeps its answer for later.
        self._reset.pending |= bool(sum(asked() for asked in self.resets_asked))
        if self._reset.pending:
            if self._reset.done(None if self.coupling is None else self.coupling.ends):
                if self.coupling is not None:
                    self.outcome = Outcome(self._reset.start, self.coupling.fingers)
                self.log("the object is back where it stood")
            else:
                notice = WAITS
        if notice and notice != self._notice:
            self.log(notice)
        self._notice = notice

    # What comes in.

    def _listen(self) -> list[float]:
        """Give the filter what has come. Returns the arrivals, s."""
        arrivals = []
        for packet in self.source.take():
            self._last_arrival, self._newest = packet.arrival, packet
            frame = packet if isinstance(packet, HandFrame) else self._decoder.decode(packet)
            self._note_presence(packet, frame)
            if frame is not None and frame.side == self.side:
                self._tracker.push(frame)
                if self.coupling is None:
                    self._finger_presence.saw(frame)
                arrivals.append(packet.arrival)
        return arrivals

    def _note_presence(self, packet: Packet | HandFrame, frame: HandFrame | None) -> None:
        self._presence.heard(packet.arrival)
        if frame is not None and frame.tracked.any():
            self._presence.saw(frame.side, packet.arrival)
        if isinstance(packet, Packet):
            for _, side, fingers in packet.hands:
                if side != self.side and any(fingers):
                    self._presence.saw(side, packet.arrival)

    def _over(self) -> bool:
        """Whether the stream has ended: nothing for ``idle`` s."""
        return self.source.now() - self._last_arrival > self.mocap.idle

    def wait_for_hand(self) -> bool:
        """Wait until the tracker sees the fingers that are to be coupled, all at the same time, and couple them. False if the source ended
        before.

        ``log`` gets who is missing, if that lasts.
        """
        missing: tuple[str, ...] = ()
        since = math.inf
        while True:
            self._listen()
            now = self.source.now()
            targets = self._tracker.sample(now)
            if self.viewer is not None and self.viewer.wants_state():
                tracked = None if targets is None else self._tracked(targets)
                self.viewer.draw(replace(self.scene.state(phase=WAITING), notice=self._notice, tracked=tracked))
            self._watch()
            if targets is not None and self._finger_presence.enough(now):
                self._couple(targets)
                return True
            if self.source.ended():
                return False
            lacking = self._finger_presence.missing(now)
            if lacking != missing:
                missing, since = lacking, now
            elif missing and now - since > LATECOMERS and self._finger_presence.live(now).any():
                self.log(f"still waiting: the tracker does not see {' and '.join(missing)}")
                since = math.inf
            self.source.wait_until(now + 0.005)

    @property
    def resets(self) -> int:
        """How often the object was put back."""
        return self._reset.count

    def left_out(self) -> tuple[str, ...]:
        """Fingers that the session did not wait for any longer: they get their pads when they are seen."""
        assert self.coupling is not None
        return tuple(PARTS[row] for row in self._finger_presence.wanted if row in self.coupling.waiting)

    def _couple(self, targets: HandTargets) -> None:
        pad, side, most = self.stage.pad, self.side, self.mocap.max_force
        if self.mocap.coupling == "hand":
            self.coupling = HandCoupling(self.world, targets, pad, side=side, gains=self.mocap.gains, max_force=most)
        else:
            self.coupling = TipCoupling(self.world, targets, pad, self.mocap.springs, self._finger_presence.expected, max_force=most)
        # The middle of these is where the hand is: who comes later would shift it.
        self._guides = [row for row in self.coupling.rows if row not in self.coupling.waiting]
        pads, hands = self.coupling.pads, self.coupling.hands
        self._show(WorldScene(self.world, [self.object, self.stage.support, self.mat, *pads], hands, pads))
        self._finger_of = {place: finger for finger, place in enumerate(self.scene.model.fingertips())}
        self._reset.start = pose_of(self.object)
        self.outcome = Outcome(self._reset.start, self.coupling.fingers)

    def _tracked(self, targets: HandTargets) -> TrackedHand:
        """What a viewer shows of the tracked hand."""
        rows = () if self.coupling is None else self.coupling.rows
        aims, ends = np.zeros((0, 3)), np.zeros((0, 3))
        if self.coupling is not None:
            aims, ends = targets.pad_places()[0][list(rows)], self.coupling.ends
            # What waits is drawn nowhere.
            aside = [rows.index(row) for row in self.coupling.waiting]
            aims[aside] = ends[aside]
        fingers = tuple(rows.index(row) if row in rows else -1 for row in range(len(PARTS)))
        states = tuple(targets.states)
        dropped = self._tracker.dropped["frames"]
        return TrackedHand(PARTS, targets.positions, targets.pad_radii, targets.weights, states, fingers, aims, ends, dropped)

    # The loop.

    def run(self, recorder: SceneRecorder | None = None) -> None:
        """Step until the stream has ended. Call ``wait_for_hand`` before."""
        if self.coupling is None:
            raise InvalidValueError("session", "a hand that was seen", "none yet", "call wait_for_hand first")
        with undisturbed():
            self._listen()  # what came while the scene was made ready belongs to no step
            self.clock = RealTimeClock(self.source, self.options.dt)
            self._loop(self.coupling, self.clock, recorder)

    def _loop(self, coupling: Coupling, clock: RealTimeClock, recorder: SceneRecorder | None) -> None:
        step, hurried = 0, False
        while not self._over():
            due = clock.wait()
            clock.begin(self._listen())
            targets = self._tracker.sample(due)
            assert targets is not None  # a hand was seen
            coupling.follow(targets, clock.rate)
            if clock.hurried != hurried and self.source.real_time:
                hurried = clock.hurried
                self.world.step_budget = (HURRIED_SHARE if hurried else STEP_SHARE) * self.options.dt
            report = self.world.step()
            self.step_times.append(report.step_time)
            self.unconverged += not report.converged
            self.indentation = max(self.indentation, report.indentation)
            if step % self._every == 0:
                self._observe(report, targets, recorder)
            step += 1

    def _observe(self, report: StepReport, targets: HandTargets, recorder: SceneRecorder | None) -> None:
        assert self.coupling is not None
        assert self.outcome is not None
        self._watch()
        shown = self.viewer is not None and self.viewer.wants_state()
        wants = recorder is not None and recorder.wants_deformation(self.world.time)
        state = self.scene.state(report, self.outcome.phase, moved=wants or shown)
        if self.viewer is not None and shown:
            self.viewer.draw(replace(state, notice=self._notice or state.notice, tracked=self._tracked(targets)))
        sums = contact_sums(state.contacts, 0, self._finger_of, len(self.coupling.fingers))
        self.coupling.release.observe(sums["hand/normal_force"])
        support = _between(state, 0, 1) + _between(state, 0, 2)
        self.dropouts.update(state.time, targets, self.source.now() - self._last_arrival)
        self.outcome.update(state.time, pose_of(self.object), sums["hand/normal_force"], support, _guide(targets, self._guides))
        if recorder is not None:
            rows = list(self.coupling.rows)
            row = {
                "object/pose": pose_of(self.object),
                "tracker/position": targets.positions[rows],
                "tracker/weight": targets.weights[rows],
            }
            own = ("hand/force_on_object", "hand/normal_force", "hand/tangential_force", "hand/contacts")
            recorder.append(state, row | {name: sums[name] for name in own}, report)
        if self.observers:
            places = sorted(self._finger_of, key=self._finger_of.__getitem__)
            points, torques = contact_wrenches(state.contacts, 0, places)
            observation = Observation(
                time=state.time,
                fingers=self.coupling.fingers,
                rows=self.coupling.rows,
                force=-sums["hand/force_on_object"],
                pressing=sums["hand/normal_force"],
                slipping=self._slipping(state),
                phase=self.outcome.phase,
                torque=torques,
                contact_point=points,
                object_pose=pose_of(self.object),
                wall_time=time.time(),
                tracker_frame=self._newest.frame if isinstance(self._newest, Packet) else None,
                tracker_time=None if self._newest is None else self._newest.time,
                hand=self._number(),
            )
            for observer in self.observers:
                observer(observation)

    def _slipping(self, state: SceneState) -> FloatArray:
        assert self.coupling is not None
        shares: FloatArray = np.zeros(len(self.coupling.fingers))
        for place, finger in self._finger_of.items():
            shares[finger] = press_and_slip(state.contacts, place)[1]
        return shares

    def _number(self) -> int:
        """Number of the tracked hand in its source, as last seen."""
        if isinstance(self._newest, Packet):
            mine = (number for number, side, _ in self._newest.hands if side == self.side)
            self._hand_number = min(mine, default=self._hand_number)
        return self._hand_number

    def recorder(self, path: Path) -> SceneRecorder:
        """A recorder for ``run``, which writes to ``path``."""
        assert self.coupling is not None
        F, fingers = len(self.coupling.fingers), self.coupling.fingers
        joints = self.coupling.hands[0].joint_positions.shape if self.coupling.hands else (0, 0)
        own = [
            Column("object/pose", (7,), unit="m, 1", frame="world", what="x y z of the body frame, quaternion w x y z"),
            Column("tracker/position", (F, 3), unit="m", frame="world", what="centre of the tracked tips", labels=fingers),
            Column("tracker/weight", (F,), unit="1", what="of the spring to it", labels=fingers),
            Column("hand/force_on_object", (F, 3), unit="N", frame="world", what="sum over the contacts of a finger", labels=fingers),
            Column("hand/normal_force", (F,), unit="N", frame="contact", what="sum of the normal reactions of a finger", labels=fingers),
            Column("hand/tangential_force", (F,), unit="N", what="length of the summed friction of a finger", labels=fingers),
            Column("hand/contacts", (F,), "i4", what="loaded contacts of a finger with the object", labels=fingers),
        ]
        chosen = {key: "" if value is None else str(value) for key, value in asdict(self.options).items()}
        attributes = {
            "options": json.dumps(chosen),
            "object": self.stage.target.name,
            "object_mass_kg": self.stage.target.mass.mass,
            "gravity_m_per_s2": GRAVITY,
            "friction": self.stage.friction,
            "coupling": self.mocap.coupling,
        }
        shape = joints[0], joints[1]
        return SceneRecorder(path, self.scene.model, shape, columns=own, attributes=attributes, deformation_rate=DEFORMATION_RATE)

    def summary(self) -> dict[str, Any]:
        """Every figure of the session."""
        steps = len(self.step_times)
        ms = 1e3 * np.array(self.step_times)
        stream = self.source.statistics()
        return {
            "object": self.stage.target.name,
            "object_mass_kg": self.stage.target.mass.mass,
            "friction": self.stage.friction,
            "coupling": self.mocap.coupling,
            "hand": self.side,
            **(self.outcome.summary() if self.outcome is not None else {"held": False, "dropped": False, "phases": [], "fingers": []}),
            "resets": self.resets,
            "absence": self._presence.absence(self.source.now(), at_least=0.0 if self.outcome is None else ABSENT),
            "losses": self.dropouts.summary(),
            "implausible": self._tracker.dropped,
            "steps": steps,
            "dt_s": self.options.dt,
            "step_ms_median": float(np.median(ms)) if steps else None,
            "step_ms_p99": float(np.percentile(ms, 99)) if steps else None,
            "unconverged_steps": self.unconverged,
            "indentation_max": self.indentation,
            **(self.clock.summary() if self.clock is not None and self.source.real_time else {}),
            "filter_delay_s": self._tracker.delay,
            "stream": {key: value for key, value in stream.items() if value is None or isinstance(value, (int, float, str))},
            "warnings": [*self.stage.target.warnings, *indentation_note(self.indentation)],
            "state_hash": f"{self.world.state_hash():016x}",
            "version": __version__,
        }


def observation_interval(rate: float, dt: float) -> int:
    """After how many steps a session is observed, so that it is at least ``rate`` times per second, or in every step."""
    return max(1, math.floor(1.0 / (rate * dt) + 1e-6))


def _guide(targets: HandTargets, rows: list[int]) -> FloatArray:
    """Where the tracked hand is, (7,): the palm, or the middle of the tips ``rows`` where there is no palm. Equal springs that hold
    something have their middle where it has its own, however hard they press.
    """
    if np.isfinite(targets.positions[PALM]).all():
        return np.concatenate([targets.positions[PALM], targets.quaternions[PALM]])
    return np.concatenate([targets.positions[rows].mean(axis=0), targets.quaternions[rows[0]]])


def _between(state: SceneState, a: int, b: int) -> float:
    """Sum of the normal reactions between two bodies of the scene, N."""
    c = state.contacts
    both = ((c.body_a == a) & (c.body_b == b)) | ((c.body_a == b) & (c.body_b == a))
    return float(c.reactions[both, 0].sum())


@dataclass(frozen=True)
class MocapResult:
    """What a session left behind."""

    summary: dict[str, Any]
    summary_file: Path
    recording: Path | None


def run_mocap(
    options: GraspOptions,
    mocap: MocapOptions,
    source: Source,
    out: Path,
    *,
    record: Path | None = None,
    observers: Sequence[Observer] = (),
    observed: float = OBSERVED,
    viewer: Viewer | None = None,
    log: Callable[[str], None] | None = None,
    resets_asked: Sequence[Callable[[], bool]] = (),
) -> MocapResult:
    """Run a session until its stream has ended or Ctrl-C, and leave ``summary.json`` and ``recording.h5`` in the directory ``out``.

    ``observers`` are called with what is seen ``observed`` times per second of simulated time, ``log`` with what goes on; ``resets_asked``
    are asked as often whether the object is to be put back where it stood.
    Raises the errors of ``quasirigid.errors``; a ``NetworkError`` of a tracker that cannot be heard any more after the files were written.
    """
    session = MocapSession(options, mocap, source, viewer, observed=observed)
    session.observers += observers
    session.resets_asked += resets_asked
    if log is not None:
        session.log = log
    out.mkdir(parents=True, exist_ok=True)
    path: Path | None = None
    interrupted = False
    failure: NetworkError | None = None
    try:
        session.log(WAITING)
        if session.wait_for_hand():
            assert session.coupling is not None
            without = session.left_out()
            said = f"; not seen yet: {', '.join(without)}" if without else ""
            there = (name for name in session.coupling.fingers if name not in without)
            session.log(f"the hand is there: {', '.join(there)}{said}")
            path = out / "recording.h5" if record is None else record
            with session.recorder(path) as recorder:
                session.run(recorder)
    except KeyboardInterrupt:
        interrupted = True  # a way to end it
    except NetworkError as error:
        failure = error  # what was recorded so far is kept
    summary = {**session.summary(), "interrupted": interrupted, "failure": None if failure is None else str(failure)}
    file = out / "summary.json"
    file.write_text(json.dumps(summary, indent=2, allow_nan=False) + "\n")
    if failure is not None:
        raise failure
    return MocapResult(summary, file, path)
