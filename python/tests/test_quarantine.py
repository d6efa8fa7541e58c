"""A body that is set aside: said of all steps of a call, and shown and recorded from then on."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import quasirigid as qr
from quasirigid.grasp.options import GraspOptions
from quasirigid.live.play import Play
from quasirigid.scene.world import WorldScene

ABSURD = (1e12, 0.0, 0.0)
"""A force under which a body is set aside, N."""


def two_balls() -> tuple[qr.World, qr.Body, qr.Body]:
    world, rubber = qr.World(), qr.Material.preset("rubber")
    surface = qr.Surface.sphere(0.02, points=400)
    one, other = (world.add_body(surface, rubber, mass=0.1, position=(x, 0, 1)) for x in (-0.1, 0.1))
    return world, one, other


def test_a_body_set_aside_in_any_of_the_steps_is_in_the_report() -> None:
    world, _, other = two_balls()
    assert world.report is None
    other.apply_wrench(ABSURD)
    report = world.step(50)
    assert report.quarantined == [other.index]
    assert world.report is report
    assert world.step(50).quarantined == [], "of these steps alone"
    assert world.quarantined == [other.index], "but it is set aside"
    assert WorldScene(world).state().quarantined == (1,)


def test_a_body_stays_set_aside_in_a_recording_and_is_counted_once(tmp_path: Path) -> None:
    for told in (True, False):
        world, one, _ = two_balls()
        with qr.record(world, tmp_path / "run.h5") as recording:
            for step in range(6):
                if step == 2:
                    one.apply_wrench(ABSURD)
                report = world.step()
                recording.append(report if told else None)
        with qr.SceneRecording(tmp_path / "run.h5") as back:
            aside = [back.state(step).quarantined for step in range(6)]
            assert aside == [(), (), (0,), (0,), (0,), (0,)], told
            np.testing.assert_array_equal(back.columns["report/quarantined"][:], [0, 0, 1, 0, 0, 0], str(told))


def test_the_panel_says_what_to_press_for_as_long_as_a_body_is_set_aside() -> None:
    play = Play(GraspOptions(points=2_000))
    play.object.apply_wrench(ABSURD)
    for _ in range(30):
        play.step()
    assert "set aside: press Reset" in play.phase
    play.build()
    assert play.phase == "closing"
