"""Record contact problems from scenes of our own: supports, stacks, wedges and the hand, from 1 to 1,000 contacts.

    python benchmarks/solver/record.py out/problems

Every scene runs a while; a step in so many is written as an ``.npz`` (``quasirigid.ContactProblem``).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import quasirigid as qr


def table(world: qr.World, material: qr.Material, size: float = 0.3, points: int = 2500) -> None:
    """A fixed table at height 0."""
    world.add_body(qr.Surface.half_space(size, points=points), material, motion="fixed")


def resting_ball(material: str) -> qr.World:
    """A ball on a table: few contacts."""
    world = qr.World()
    table(world, qr.Material.preset(material))
    world.add_body(qr.Surface.sphere(0.02, points=1500), qr.Material.preset(material), mass=0.05, position=(0, 0, 0.02))
    return world


def box_on_table(material: str, control_points: int, tilt: float = 0.0) -> qr.World:
    """A box with many redundant supports, on a level or a tilted table (gravity is turned)."""
    world = qr.World(gravity=(9.81 * np.sin(tilt), 0, -9.81 * np.cos(tilt)))
    kind = qr.Material.preset(material)
    table(world, kind)
    size = (0.08, 0.08, 0.04)
    surface = qr.Surface.box(size, points=8 * control_points, control_points=control_points)
    world.add_body(surface, kind, mass=qr.MassProperties.box(size, mass=0.5), position=(0, 0, 0.02))
    return world


def stack(material: str, levels: int, control_points: int = 120) -> qr.World:
    """Boxes one on another, each turned a little."""
    world = qr.World()
    kind = qr.Material.preset(material)
    table(world, kind)
    size = (0.05, 0.05, 0.03)
    for level in range(levels):
        angle = 0.15 * level
        world.add_body(
            qr.Surface.box(size, points=6 * control_points, control_points=control_points),
            kind,
            mass=qr.MassProperties.box(size, mass=0.2),
            position=(0, 0, 0.015 + 0.03 * level),
            quaternion=(np.cos(angle / 2), 0, 0, np.sin(angle / 2)),
        )
    return world


def pile(material: str, balls: int) -> qr.World:
    """Balls that fall on each other in a heap."""
    world = qr.World()
    kind = qr.Material.preset(material)
    table(world, kind)
    rng = np.random.default_rng(balls)
    for k in range(balls):
        x, y = rng.uniform(-0.012, 0.012, 2)
        world.add_body(qr.Surface.sphere(0.012, points=800), kind, mass=0.02, position=(x, y, 0.013 + 0.024 * k))
    return world


def scenes() -> Iterator[tuple[str, qr.World, int, int]]:
    """Name, world, steps, record every so many."""
    for material in ("rubber", "wood", "aluminium"):
        yield f"ball-{material}", resting_ball(material), 120, 12
        for count in (100, 400):
            yield f"box-{count}-{material}", box_on_table(material, count), 60, 6
        for degrees in (10, 25, 40):
            yield f"tilted-{degrees}-{material}", box_on_table(material, 200, np.radians(degrees)), 60, 6
        for levels in (2, 3, 5):
            yield f"stack-{levels}-{material}", stack(material, levels), 60, 6
        yield f"pile-{material}", pile(material, 8), 300, 20
    yield "large", box_on_table("rubber", 3600), 20, 5
    yield "large-stiff", box_on_table("wood", 3600, np.radians(20)), 20, 5


def main() -> None:
    """Write the files."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    written, sizes = 0, []
    for name, world, steps, every in scenes():
        most = 0
        for step in range(0, steps, every):
            world.step(every)
            problem = world.contact_problem()
            most = max(most, len(problem))
            if len(problem):
                problem.save(folder / f"{name}-{step + every:04d}.npz")
                written += 1
                sizes.append(len(problem))
        print(f"{name:24s} {most:5d} contacts", flush=True)
    print(f"{written} problems, {min(sizes)} to {max(sizes)} contacts")


if __name__ == "__main__":
    main()
