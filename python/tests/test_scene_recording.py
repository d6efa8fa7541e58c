"""What is recorded of a scene comes back as it was live; a killed run loses a block at most."""

import os
import signal
import subprocess
import sys
import textwrap
import time
from dataclasses import fields
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from recorded import pinch, record_pinch

import quasirigid as qr
from quasirigid.arrays.types import FloatArray
from quasirigid.errors import InvalidShapeError, InvalidValueError, RecordingError
from quasirigid.recording import scene_recording
from quasirigid.recording.export import tables
from quasirigid.recording.reader import Column
from quasirigid.recording.recorder import Recorder
from quasirigid.recording.scene_recorder import SceneRecorder
from quasirigid.recording.scene_recording import SceneRecording
from quasirigid.scene.model import SceneState
from quasirigid.scene.world import WorldScene

NANOMETRE = 1e-9
"""A displacement of 1 mm in single precision is good for a tenth of this; what was promised is 1e-8 m."""
ROUNDED = {"points": 2.0**-24, "gaps": 2.0**-33}
"""What is recorded in single precision and then rounded to multiples of this, m."""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[SceneState]]:
    path = tmp_path_factory.mktemp("run") / "run.h5"
    return path, record_pinch(path)


def single(values: np.ndarray) -> np.ndarray:
    return np.asarray(values, "f4").astype(float)


def test_every_state_comes_back_as_it_was(run: tuple[Path, list[SceneState]]) -> None:
    path, states = run
    with SceneRecording(path) as recording:
        assert len(recording) == len(states)
        assert max(len(state.contacts) for state in states) > 30, "no grasp, no test"
        for step in [0, 1, 130, len(states) - 1]:
            live, back = states[step], recording.state(step)
            np.testing.assert_array_equal(back.positions, live.positions)
            np.testing.assert_array_equal(back.quaternions, live.quaternions)
            np.testing.assert_array_equal(back.joint_positions, live.joint_positions)
            for field in fields(live.contacts):
                before, after = getattr(live.contacts, field.name), getattr(back.contacts, field.name)
                if field.name in ROUNDED:
                    worst = float(np.abs(after - before).max())
                    single_precision = float(np.spacing(np.float32(np.abs(before).max()))) / 2
                    assert worst <= ROUNDED[field.name] / 2 + single_precision, f"{field.name} off by {worst:.1e} m"
                else:
                    np.testing.assert_array_equal(after, before if before.dtype.kind in "iu" else single(before), err_msg=field.name)
            np.testing.assert_array_equal(back.finger_forces, single(live.finger_forces))
            np.testing.assert_array_equal(back.normal_forces, single(live.normal_forces))
            assert (back.time, back.step, back.phase) == (live.time, step, live.phase)
            assert (back.step_time, back.stage_times, back.residual) == (live.step_time, live.stage_times, live.residual)
            assert back.converged == live.converged
        assert recording.state(-1).time == states[-1].time


def test_deformation_comes_back_to_a_nanometre_sixty_times_a_second(run: tuple[Path, list[SceneState]]) -> None:
    path, states = run
    worst, seen = 0.0, 0
    with SceneRecording(path) as recording:
        sources = recording.columns["moved/step"]
        assert np.diff(np.unique(sources)).min() == round(1 / 60 / 2e-3)
        for step, source in enumerate(sources.tolist()):
            if step % 10 == 0 and source >= 0:
                live, back = states[source].moved, recording.moved(step)
                assert back.keys() == live.keys()
                for body, moved in live.items():
                    np.testing.assert_array_equal(back[body].indices, moved.indices)
                    worst, seen = max(worst, float(np.abs(back[body].points - moved.points).max())), seen + len(moved.indices)
    assert seen > 1000
    assert worst < NANOMETRE, f"deformation off by {worst:.1e} m"


def test_deformation_can_be_recorded_in_every_step(tmp_path: Path) -> None:
    states = record_pinch(tmp_path / "all.h5", 150, deformation_rate=np.inf)
    with SceneRecording(tmp_path / "all.h5") as recording:
        for step in range(100, 150, 7):
            back = recording.moved(step)
            for body, moved in states[step].moved.items():
                assert np.abs(back[body].points - moved.points).max() < 3 * NANOMETRE


def test_deformation_keeps_its_rate_when_few_steps_are_recorded(tmp_path: Path) -> None:
    world, _, grip = pinch()
    with qr.record(world, tmp_path / "few.h5") as recording:
        for step in range(200):
            grip.update()
            report = world.step()
            if step % 5 == 4:
                recording.append(report, phase=grip.state)
    with SceneRecording(tmp_path / "few.h5") as back:
        written = back.times[np.unique(back.columns["moved/step"])]
    assert np.diff(written).min() == pytest.approx(0.02), "60 times a second, to the nearest of the rows that are 10 ms apart"


def test_bodies_named_as_fingertips_show_what_they_feel(tmp_path: Path) -> None:
    world = qr.World()
    rubber = qr.Material.preset("rubber")
    world.add_body(qr.Surface.box((0.05, 0.05, 0.02), points=1_000), rubber, motion="fixed")
    tip = qr.Surface.fingertip((0.009, 0.009, 0.008), points=1_200)
    pad = world.add_body(tip, rubber, mass=0.02, position=(0.0, 0.0, 0.0179), quaternion=(0.0, 1.0, 0.0, 0.0), name="left_tip")
    with qr.record(world, tmp_path / "r.h5", fingertips=[pad]) as recording:
        recording.append(world.step(20))
    with SceneRecording(tmp_path / "r.h5") as back:
        assert back.model.fingers == ("left tip",)
        assert back.model.fingertips() == [pad.index]
        assert back.peak_pressure() > 0.0
    world.remove(pad)
    with pytest.raises(qr.InvalidHandleError):
        qr.record(world, tmp_path / "other.h5", fingertips=[pad])


def test_phases_come_back_whole_or_are_refused(tmp_path: Path) -> None:
    world = qr.World()
    world.add_body(qr.Surface.sphere(0.02, points=300), qr.Material.preset("rubber"), mass=0.1)
    with qr.record(world, tmp_path / "r.h5") as recording:
        recording.append(world.step(), phase="ü" * 32)
        with pytest.raises(InvalidValueError, match="phase: expected at most 64 bytes"):
            recording.append(world.step(), phase="ü" * 32 + "!")
    with SceneRecording(tmp_path / "r.h5") as back:
        assert [back.phase(step) for step in range(len(back))] == ["ü" * 32]


def test_the_peak_pressure_is_found_piece_by_piece(run: tuple[Path, list[SceneState]], monkeypatch: pytest.MonkeyPatch) -> None:
    with SceneRecording(run[0]) as recording:
        tips = recording.model.fingertips()
        pressures = [s.contacts.pressures[np.isin(s.contacts.body_a, tips) | np.isin(s.contacts.body_b, tips)] for s in run[1]]
        monkeypatch.setattr(scene_recording, "ROWS_AT_ONCE", 1000)
        assert recording.peak_pressure() == single(np.array([p.max(initial=0.0) for p in pressures]).max()) > 0.0
        assert recording.peak_pressure(0, 150) == single(np.array([p.max(initial=0.0) for p in pressures[:151]]).max())


def test_an_object_at_rest_costs_next_to_nothing(tmp_path: Path) -> None:
    world = qr.World()
    world.add_body(qr.Surface.half_space(0.1, points=2_000), qr.Material.preset("rubber"), motion="fixed")
    ball = world.add_body(qr.Surface.sphere(0.02, points=1_000), qr.Material.preset("rubber"), mass=0.05, position=(0, 0, 0.02))
    world.step(2000)
    with qr.record(world, tmp_path / "rest.h5") as recording:
        for _ in range(400):
            recording.append(world.step())
    with SceneRecording(tmp_path / "rest.h5") as recording:
        assert len(np.unique(recording.columns["moved/step"])) == 1, "the deformation of a ball at rest is written once"
        assert recording.state(-1).moved
        np.testing.assert_array_equal(recording.state(-1).positions[1], ball.position)


def test_model_comes_back(run: tuple[Path, list[SceneState]]) -> None:
    world, _, _ = pinch()
    live = WorldScene(world).model
    with SceneRecording(run[0]) as recording:
        back = recording.model
    assert (back.fingers, back.dt, back.floor) == (live.fingers, live.dt, live.floor)
    for a, b in zip(back.bodies, live.bodies, strict=True):
        assert (a.name, a.kind, a.finger, a.frame) == (b.name, b.kind, b.finger, b.frame)
        assert a.colour == pytest.approx(b.colour)
        np.testing.assert_array_equal(a.points, b.points)
        np.testing.assert_array_equal(a.faces, b.faces)
        np.testing.assert_allclose(a.normals, b.normals, atol=1e-7)


def test_materials_masses_and_control_points_come_back(run: tuple[Path, list[SceneState]]) -> None:
    world, hand, _ = pinch()
    box, stand = world.bodies
    with SceneRecording(run[0]) as recording:
        bodies = {body.name: body for body in recording.model.bodies}
    assert (bodies["box"].mass, bodies["stand"].mass, bodies["thumb/tip"].mass) == (0.2, 0.0, None)
    assert bodies["box"].centre_of_mass == pytest.approx((0.0, 0.0, 0.0))
    tip = hand.surface(0)
    assert tip is not None
    for name, surface, material in (
        ("box", box.surface, box.material),
        ("stand", stand.surface, stand.material),
        ("thumb/tip", tip, hand.material),
    ):
        kept, control = bodies[name].material, bodies[name].control
        assert material is not None
        assert surface is not None
        assert kept is not None
        for key in ("name", "density", "friction", "young_modulus", "poisson_ratio", "layer_thickness", "relaxation_time", "compliance"):
            assert kept[key] == getattr(material, key), key
        assert kept["friction_law"]["kinetic"] == material.friction_law.kinetic
        np.testing.assert_array_equal(control.points, single(surface.control_points))
        np.testing.assert_array_equal(control.normals, single(surface.control_normals))
        np.testing.assert_array_equal(control.areas, single(surface.control_areas))
    assert bodies["palm"].material is None
    assert len(bodies["palm"].control.points) == 0


def test_a_taxel_map_made_from_a_recording_holds_the_force_of_the_finger(run: tuple[Path, list[SceneState]]) -> None:
    with SceneRecording(run[0]) as recording:
        state, model = recording.state(-1), recording.model
    pressed = 0
    for finger, tip in enumerate(model.fingertips()):
        pad, contacts = model.bodies[tip].control, state.contacts
        mine = contacts.body_a == tip
        force = np.bincount(contacts.control_point[mine], contacts.reactions[mine, 0], len(pad.points))
        x, y, _ = pad.points.T
        taxels = np.histogram2d(x, y, bins=(12, 12), weights=force)[0]
        assert taxels.sum() == pytest.approx(state.normal_forces[finger], rel=1e-6), f"finger {finger}"
        np.testing.assert_allclose(pad.areas[contacts.control_point[mine]], contacts.areas[mine], rtol=1e-6)
        pressed += int((taxels > 0.0).sum())
    assert pressed > 10, "no grasp, no test"


def test_killed_run_replays_up_to_the_last_block(tmp_path: Path) -> None:
    path = tmp_path / "killed.h5"
    program = f"""
        import sys; sys.path[:0] = {sys.path!r}
        import quasirigid as qr
        from recorded import pinch
        world, _, grip = pinch()
        recording = qr.record(world, {str(path)!r})
        for i in range(10**9):
            grip.update()
            recording.append(world.step(), phase=grip.state)
            if i == 350: print("go", flush=True)
    """
    env = {**os.environ, "PYTHONPATH": str(Path(__file__).parent)}
    with subprocess.Popen([sys.executable, "-c", textwrap.dedent(program)], stdout=subprocess.PIPE, env=env) as writer:
        assert writer.stdout is not None
        assert writer.stdout.readline() == b"go\n"
        began = time.monotonic()
        while time.monotonic() - began < 60.0:  # a block is written while the run goes on; it can be read meanwhile
            with qr.Recording(path) as so_far:
                if so_far.steps >= 300:
                    break
            time.sleep(0.01)
        writer.send_signal(signal.SIGKILL)
        writer.wait()
    with SceneRecording(path) as recording:
        assert not recording.columns.complete
        assert len(recording) >= 300
        np.testing.assert_allclose(recording.times, 2e-3 * np.arange(1, len(recording) + 1), rtol=1e-9)
        last = recording.state(-1)
        assert last.moved
        # The same run again: the file holds what happened.
        world, _, grip = pinch()
        scene = WorldScene(world)
        for _ in range(len(recording)):
            grip.update()
            world.step()
        np.testing.assert_array_equal(last.positions, scene.state().positions)
        np.testing.assert_array_equal(last.contacts.reactions, single(scene.state().contacts.reactions))


def test_worlds_without_hand_or_contact_are_recorded_too(tmp_path: Path) -> None:
    world = qr.World()
    world.add_body(qr.Surface.sphere(0.02, points=300), qr.Material.preset("rubber"), mass=0.1)
    with qr.record(world, tmp_path / "fall.h5") as recording:
        for _ in range(5):
            recording.append(world.step())
    with SceneRecording(tmp_path / "fall.h5") as back:
        state = back.state(4)
        assert (len(state.contacts), state.finger_forces.shape, state.moved) == (0, (0, 3), {})
        assert back.phases() == []
        assert back.peak_pressure() == 0.0


def test_phases_and_times(run: tuple[Path, list[SceneState]]) -> None:
    with SceneRecording(run[0]) as recording:
        spans = recording.phases()
        assert [name for _, _, name in spans][:2] == ["closing", "squeezing"]
        assert spans[0][0] == pytest.approx(0.0)
        assert [end for _, end, _ in spans[:-1]] == pytest.approx([start for start, _, _ in spans[1:]])
        assert recording.step_at(-1.0) == 0
        assert recording.step_at(float(recording.times[7])) == 7
        assert recording.step_at(float(recording.times[7]) + 1.9e-3) == 7
        assert recording.step_at(1e9) == len(recording) - 1


def test_changed_worlds_and_bad_values_are_refused(tmp_path: Path) -> None:
    world, _, _ = pinch()
    recording = qr.record(world, tmp_path / "a.h5")
    world.add_body(qr.Surface.sphere(0.02, points=300), qr.Material.preset("rubber"), mass=0.1, position=(1, 0, 0))
    with pytest.raises(InvalidValueError, match="begin another"):
        recording.append(world.step())
    recording.close()
    for rate in (0.0, -1.0, np.nan):
        with pytest.raises(InvalidValueError, match="deformation_rate"):
            qr.record(world, tmp_path / "b.h5", deformation_rate=rate)
    other = WorldScene(world)
    recorder = SceneRecorder(tmp_path / "c.h5", WorldScene(pinch()[0]).model, (3, 4))
    with pytest.raises(InvalidShapeError, match="bodies"):
        recorder.append(other.state())
    recorder.close()


def test_recordings_without_a_scene_say_so_and_stay_readable(tmp_path: Path) -> None:
    old = tmp_path / "old.h5"
    with Recorder(old, [Column("time", unit="s")]) as recorder:
        recorder.append({"time": 1.0})
    with h5py.File(old, "r+") as file:
        file.attrs["version"] = 1
    with pytest.raises(RecordingError, match=r"version 1.*record the run again"):
        SceneRecording(old)
    with qr.Recording(old) as columns:
        assert columns["time"].tolist() == [1.0]
    with h5py.File(old, "r+") as file:
        file.attrs["version"] = 99
    with pytest.raises(RecordingError, match="update quasirigid"):
        qr.Recording(old)
    empty = tmp_path / "empty.h5"
    qr.record(pinch()[0], empty).close()
    with pytest.raises(RecordingError, match="at least one step"):
        SceneRecording(empty)


class FewerJoints:
    """A hand whose fingers end one joint sooner, for whoever reads it."""

    def __init__(self, hand: qr.Hand) -> None:
        self._hand = hand

    def __getattr__(self, name: str) -> Any:
        return getattr(self._hand, name)

    @property
    def joint_positions(self) -> FloatArray:
        return self._hand.joint_positions[:, :-1]


def test_hands_with_unlike_joint_counts_keep_their_joint_positions(tmp_path: Path) -> None:
    world = qr.World()
    hands = [world.add_hand(position=(0.5 * k, 0.0, 0.3), points=300, control_points=60) for k in range(2)]
    hands[1].joint_positions = hands[1].joint_positions + 0.1
    scene = WorldScene(world, hands=[hands[0], FewerJoints(hands[1])])  # type: ignore[list-item]
    live = scene.state().joint_positions
    joints = hands[0].joint_positions.shape[1]
    assert live.shape == (6, joints)
    np.testing.assert_array_equal(live[:3], hands[0].joint_positions)
    np.testing.assert_array_equal(live[3:, :-1], hands[1].joint_positions[:, :-1])
    assert np.isnan(live[3:, -1]).all(), "a joint that is not there has no angle"
    with SceneRecorder(tmp_path / "run.h5", scene.model, (6, joints)) as recorder:
        recorder.append(scene.state(world.step()), None)
    with SceneRecording(tmp_path / "run.h5") as recording:
        np.testing.assert_array_equal(recording.state(0).joint_positions, scene.state().joint_positions)
        fingers = tables(recording)["fingers"](np.array([0]))
    last = fingers[f"joint_{joints - 1}_rad"]
    assert np.isfinite(last[:3]).all(), "the table has the joints that there are"
    assert np.isnan(last[3:]).all(), "and says of none that it is at 0"
