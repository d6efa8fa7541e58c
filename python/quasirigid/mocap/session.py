"""A person's tracked hand takes an object: ``quasirigid grasp --mocap``.

Every step asks the tracking filter where the hand is at this moment, aims the springs there, and goes on; now and then somebody looks at what has
become of the object (``OBSERVED`` times a second): the recording, the outcome, the feedback to the person.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from quasirigid._quasirigid import HandDecoder, HandFrame, HandTargets, HandTracker, Material, Packet, StepReport, Surface, __version__
from quasirigid.errors import InvalidValueError, NetworkError
from quasirigid.grasp import GRAVITY, Stage
from quasirigid.grasp_columns import contact_sums
from quasirigid.grasp_options import GraspOptions
from quasirigid.mocap import PARTS
from quasirigid.mocap.coupling import PALM, Coupling, TipCoupling
from quasirigid.mocap.hand_coupling import HandCoupling
from quasirigid.mocap.look import Look, Observer, Viewer, press_and_slip
from quasirigid.mocap.losses import Losses
from quasirigid.mocap.options import MocapOptions
from quasirigid.mocap.outcome import Outcome
from quasirigid.mocap.pace import Pace, undisturbed
from quasirigid.mocap.sighting import LATECOMERS, Sighting
from quasirigid.mocap.stream import Source
from quasirigid.recording import Column
from quasirigid.scene_recording import SceneRecorder
from quasirigid.view.play import MAT, PEDESTAL
from quasirigid.view.scene import SceneState, TrackedHand
from quasirigid.view.world_scene import WorldScene

FloatArray = npt.NDArray[np.float64]
OBSERVED = 100.0
"""Times per second of simulated time that the session is looked at: recording, outcome, feedback."""
DEFORMATION_RATE = 20.0
"""Times per second that the surfaces are recorded."""
STEP_SHARE, HURRIED_SHARE = 0.7, 0.5
"""Share of ``dt`` that a step may take, and one that begins late: with what else is done between two steps late ones catch up."""
WAITING = "waiting for the hand"


class MocapSession:
    """The scene of ``quasirigid grasp`` on its support, and the hand that ``source`` tells of."""

    def __init__(
        self, options: GraspOptions, mocap: MocapOptions, source: Source, viewer: Viewer | None = None, *, observed: float = OBSERVED
    ) -> None:
        """Build the scene, and show it to ``viewer``. ``observed``: times per second of simulated time that it is looked at.

        Raises the errors of ``quasirigid.errors``.
        """
        mocap.check()
        self.options, self.mocap, self.source, self.viewer = options, mocap, source, viewer
        self.stage = Stage.build(options, pedestal=PEDESTAL, step_budget=STEP_SHARE * options.dt if source.paced else None)
        self.world, self.object = self.stage.world, self.stage.object
        # As in the live view: soft things to stand and to fall on.
        soft = Material.preset("silicone")
        self.stage.support.material = soft
        floor = -PEDESTAL[2] if self.stage.taken.flat else -1e-3
        self.mat = self.world.add_body(Surface.half_space(MAT, points=2_500), soft, motion="fixed", position=(0.0, 0.0, floor), name="mat")
        self._decoder = HandDecoder(mocap.side, bodies=mocap.bodies)
        self.side = self._decoder.side
        """Of the tracked hand: a file that says which bodies are on the fingers says this, too."""
        self._tracker = HandTracker(self.side, calibration=mocap.calibration, delay=mocap.delay, hold=mocap.hold, fade=mocap.fade)
        self._last_arrival = source.now()
        self._every = look_every(observed, options.dt)
        self._sighting = Sighting(mocap.coupling)
        self._newest: Packet | HandFrame | None = None
        self._hand_number = 0
        self.coupling: Coupling | None = None
        self.pace: Pace | None = None
        self.outcome: Outcome | None = None
        self.losses = Losses()
        self.observers: list[Observer] = []
        self.step_times: list[float] = []
        self.unconverged = 0
        self._show(WorldScene(self.world))

    def _show(self, scene: WorldScene) -> None:
        self.scene = scene
        if self.viewer is not None:
            self.viewer.begin(scene.model)
            self.viewer.draw(scene.state(phase=WAITING))

    # What comes in.

    def _listen(self) -> list[float]:
        """Give the filter what has come. Returns the arrivals, s."""
        arrivals = []
        for packet in self.source.take():
            self._last_arrival, self._newest = packet.arrival, packet
            frame = packet if isinstance(packet, HandFrame) else self._decoder.decode(packet)
            if frame is not None:
                self._tracker.push(frame)
                if self.coupling is None:
                    self._sighting.saw(frame)
                arrivals.append(packet.arrival)
        return arrivals

    def _over(self) -> bool:
        """Whether the stream has ended: nothing for ``idle`` s."""
        return self.source.now() - self._last_arrival > self.mocap.idle

    def wait_for_hand(self, told: Callable[[str], None] | None = None) -> bool:
        """Wait until the tracker sees the fingers that are to be coupled, all at the same time, and couple them. False if the source ended before.

        ``told`` is called with who is missing, if that lasts.
        """
        missing: tuple[str, ...] = ()
        since = math.inf
        while True:
            self._listen()
            now = self.source.now()
            targets = self._tracker.sample(now)
            if self.viewer is not None and self.viewer.wants_state():
                self.viewer.draw(replace(self.scene.state(phase=WAITING), tracked=None if targets is None else self._tracked(targets)))
            if targets is not None and self._sighting.enough(now):
                self._couple(targets)
                return True
            if self.source.ended():
                return False
            lacking = self._sighting.missing(now)
            if lacking != missing:
                missing, since = lacking, now
            elif told is not None and missing and now - since > LATECOMERS and self._sighting.live(now).any():
                told(f"still waiting: the tracker does not see {' and '.join(missing)}")
                since = math.inf
            self.source.wait_until(now + 0.005)

    def left_out(self) -> tuple[str, ...]:
        """Fingers that the session did not wait for any longer: they get their pads when they are seen."""
        assert self.coupling is not None
        return tuple(PARTS[row] for row in self._sighting.wanted if row in self.coupling.waiting)

    def _couple(self, targets: HandTargets) -> None:
        pad, side = self.stage.pad, self.side
        if self.mocap.coupling == "hand":
            self.coupling = HandCoupling(self.world, targets, pad, side=side, gains=self.mocap.gains)
        else:
            self.coupling = TipCoupling(self.world, targets, pad, self.mocap.springs, self._sighting.expected)
        # The middle of these is where the hand is: who comes later would shift it.
        self._guides = [row for row in self.coupling.rows if row not in self.coupling.waiting]
        pads, hands = self.coupling.pads, self.coupling.hands
        self._show(WorldScene(self.world, [self.object, self.stage.support, self.mat, *pads], hands, pads))
        self._finger_of = {place: finger for finger, place in enumerate(self.scene.model.fingertips())}
        self.outcome = Outcome(self._object_pose(), self.coupling.fingers)

    def _object_pose(self) -> FloatArray:
        return np.concatenate([self.object.position, self.object.quaternion])

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
        return TrackedHand(PARTS, targets.positions, targets.pad_radii, targets.weights, states, fingers, aims, ends)

    # The loop.

    def run(self, recorder: SceneRecorder | None = None) -> None:
        """Step until the stream has ended. Call ``wait_for_hand`` before."""
        if self.coupling is None:
            raise InvalidValueError("session", "a hand that was seen", "none yet", "call wait_for_hand first")
        with undisturbed():
            self._listen()  # what came while the scene was made ready belongs to no step
            self.pace = Pace(self.source, self.options.dt)
            self._loop(self.coupling, self.pace, recorder)

    def _loop(self, coupling: Coupling, pace: Pace, recorder: SceneRecorder | None) -> None:
        step, hurried = 0, False
        while not self._over():
            due = pace.wait()
            pace.begin(self._listen())
            targets = self._tracker.sample(due)
            assert targets is not None  # a hand was seen
            coupling.follow(targets, pace.rate)
            if pace.hurried != hurried and self.source.paced:
                hurried = pace.hurried
                self.world.step_budget = (HURRIED_SHARE if hurried else STEP_SHARE) * self.options.dt
            report = self.world.step()
            self.step_times.append(report.step_time)
            self.unconverged += not report.converged
            if step % self._every == 0:
                self._observe(report, targets, recorder)
            step += 1

    def _observe(self, report: StepReport, targets: HandTargets, recorder: SceneRecorder | None) -> None:
        assert self.coupling is not None
        assert self.outcome is not None
        shown = self.viewer is not None and self.viewer.wants_state()
        wants = recorder is not None and recorder.wants_deformation(self.world.time)
        state = self.scene.state(report, self.outcome.phase, moved=wants or shown)
        if self.viewer is not None and shown:
            self.viewer.draw(replace(state, tracked=self._tracked(targets)))
        sums = contact_sums(state.contacts, 0, self._finger_of, len(self.coupling.fingers))
        support = _between(state, 0, 1) + _between(state, 0, 2)
        self.losses.update(state.time, targets, self.source.now() - self._last_arrival)
        self.outcome.update(state.time, self._object_pose(), sums["hand/normal_force"], support, _guide(targets, self._guides))
        if recorder is not None:
            rows = list(self.coupling.rows)
            row = {"object/pose": self._object_pose(), "tracker/position": targets.positions[rows], "tracker/weight": targets.weights[rows]}
            own = ("hand/force_on_object", "hand/normal_force", "hand/tangential_force", "hand/contacts")
            recorder.append(state, row | {name: sums[name] for name in own}, report)
        if self.observers:
            look = Look(
                time=state.time,
                fingers=self.coupling.fingers,
                rows=self.coupling.rows,
                force=-sums["hand/force_on_object"],
                pressing=sums["hand/normal_force"],
                slipping=self._slipping(state),
                phase=self.outcome.phase,
                hand=self._number(),
            )
            for observer in self.observers:
                observer(look)

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
            "object": self.stage.taken.name,
            "object_mass_kg": self.stage.taken.mass.mass,
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
            "object": self.stage.taken.name,
            "object_mass_kg": self.stage.taken.mass.mass,
            "friction": self.stage.friction,
            "coupling": self.mocap.coupling,
            "hand": self.side,
            **(self.outcome.summary() if self.outcome is not None else {"held": False, "dropped": False, "phases": [], "fingers": []}),
            "losses": self.losses.summary(),
            "steps": steps,
            "dt_s": self.options.dt,
            "step_ms_median": float(np.median(ms)) if steps else None,
            "step_ms_p99": float(np.percentile(ms, 99)) if steps else None,
            "unconverged_steps": self.unconverged,
            **(self.pace.summary() if self.pace is not None and self.source.paced else {}),
            "filter_delay_s": self._tracker.delay,
            "stream": {key: value for key, value in stream.items() if value is None or isinstance(value, (int, float, str))},
            "warnings": list(self.stage.taken.warnings),
            "state_hash": f"{self.world.state_hash():016x}",
            "version": __version__,
        }


def look_every(rate: float, dt: float) -> int:
    """After how many steps a session is looked at, so that it is at least ``rate`` times per second, or in every step."""
    return max(1, math.floor(1.0 / (rate * dt) + 1e-6))


def _guide(targets: HandTargets, rows: list[int]) -> FloatArray:
    """Where the tracked hand is, (7,): the palm, or the middle of the tips ``rows`` where there is no palm. Equal springs that hold something
    have their middle where it has its own, however hard they press.
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
    told: Callable[[str], None] | None = None,
) -> MocapResult:
    """Run a session until its stream has ended or Ctrl-C, and leave ``summary.json`` and ``recording.h5`` in the directory ``out``.

    ``observers`` are called with what is seen ``observed`` times per second of simulated time, ``told`` with what goes on.
    Raises the errors of ``quasirigid.errors``; a ``NetworkError`` of a tracker that cannot be heard any more after the files were written.
    """
    session = MocapSession(options, mocap, source, viewer, observed=observed)
    session.observers += observers
    out.mkdir(parents=True, exist_ok=True)
    path: Path | None = None
    say = told or (lambda _: None)
    interrupted = False
    failure: NetworkError | None = None
    try:
        say("waiting for the hand")
        if session.wait_for_hand(say):
            assert session.coupling is not None
            without = session.left_out()
            said = f"; not seen yet: {', '.join(without)}" if without else ""
            there = (name for name in session.coupling.fingers if name not in without)
            say(f"the hand is there: {', '.join(there)}{said}")
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
