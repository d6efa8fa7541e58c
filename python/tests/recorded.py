"""A short recorded grasp that the tests of recordings share."""

from pathlib import Path

import quasirigid as qr
from quasirigid.scene.model import SceneState
from quasirigid.scene.world import WorldScene


def pinch() -> tuple[qr.World, qr.Hand, qr.Grip]:
    """A coarse box on a stand, and a hand about to take it."""
    world = qr.World(dt=2e-3)
    box = qr.Surface.box((0.06, 0.06, 0.08), points=3_000)
    rubber = qr.Material.preset("rubber")
    world.add_body(box, qr.Material.preset("wood"), mass=0.2, position=(0.0, 0.0, 0.04), name="box")
    world.add_body(qr.Surface.box((0.03, 0.03, 0.01), points=500), rubber, motion="fixed", position=(0.0, 0.0, -0.005), name="stand")
    hand = world.add_hand(position=(0.0, 0.0, 0.125), points=800, control_points=110)
    starts = [(-0.033, 0.0, -0.085), (0.033, 0.012, -0.085), (0.033, -0.012, -0.085)]
    return world, hand, hand.grip(starts, [(1, 0, 0), (-1, 0, 0), (-1, 0, 0)], squeeze=4.0)


def record_pinch(path: Path, steps: int = 260, *, deformation_rate: float = 60.0) -> list[SceneState]:
    """Record a closing hand; the live states come back."""
    world, _, grip = pinch()
    scene = WorldScene(world)
    states = []
    with qr.record(world, path, deformation_rate=deformation_rate, attributes={"object": "box"}) as recording:
        for _ in range(steps):
            grip.update()
            report = world.step()
            recording.append(report, phase=grip.state)
            states.append(scene.state(report, grip.state))
    return states
