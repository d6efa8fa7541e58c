"""The engine's compliance models beside the reference figures of soft layers: a rigid ball pressed into a layer, and moved sideways.

    python benchmarks/finite_elements/beside_the_engine.py                      every model, every case of python/tests/references/pads.json
    python benchmarks/finite_elements/beside_the_engine.py --models half-space

Prints a table: by how much the force at the given depth, and the tangential stiffness at full stick (``k_t_level``), are off.
"""

from __future__ import annotations

import argparse
import json
from typing import Any

import numpy as np
from reference import PLACE

import quasirigid as qr

MODELS = ("gaussian", "half-space", "layer", "local")
APIECE = 6  # control points in a contact radius


def scene(case: dict[str, float], model: Any, young_modulus: float, friction: float) -> tuple[qr.World, qr.Body]:
    """A rigid ball above a soft layer, which carries the control points."""
    a, R, depth = case["a"], case["ball_radius"], case["depth"]
    half, count = 1.3 * a, round(1.3 * APIECE)
    soft = qr.Material.preset("silicone").replace(
        young_modulus=young_modulus,
        poisson_ratio=case["poisson_ratio"],
        layer_thickness=case["thickness"],
        relaxation_time=0.0,
        friction=friction,
        compliance=model,
    )
    at = half * ((np.arange(4 * count) + 0.5) / (2 * count) - 1)
    x, y = (axis.ravel() for axis in np.meshgrid(at, at, indexing="ij"))
    surface = qr.Surface.from_points(
        np.stack([x, y, 0 * x], axis=1),
        np.tile((0.0, 0.0, 1.0), (len(x), 1)),
        np.full(len(x), (half / 2 / count) ** 2),
        control_points=4 * count**2,
    )
    # A cap of the ball on a Fibonacci spiral, its pole down, with fewer control points than the layer.
    n = 16 * count**2
    cosine = 1 - (1 - np.sqrt(1 - (1.5 * half / R) ** 2)) * (np.arange(n) + 0.5) / n
    sine, angle = np.sqrt(1 - cosine**2), np.pi * (3 - np.sqrt(5)) * np.arange(n)
    normals = np.stack([sine * np.cos(angle), -sine * np.sin(angle), -cosine], axis=1)
    cap = qr.Surface.from_points(R * normals, normals, np.full(n, 2 * np.pi * R**2 * (1 - cosine[-1]) / n), control_points=count**2)
    world = qr.World(gravity=(0, 0, 0), contact_margin=0.1 * depth)
    ball = world.add_body(cap, soft.replace(young_modulus=1e13, compliance="half-space"), motion="fixed", position=(0, 0, R))
    # Two fixed bodies do not meet: the layer is held by a spring that gives by nothing to speak of.
    layer = world.add_body(surface, soft, mass=qr.MassProperties.sphere(a, mass=1.0))
    layer.set_drive((0, 0, 0), stiffness=(1e12, 1e10), damping=(0, 0))
    return world, ball


def force(world: qr.World, ball: qr.Body, place: tuple[float, float, float]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """(3,) N between ball and layer, with the ball moved to ``place`` m and left there for a step."""
    ball.move_to(place)
    report = world.step(2)
    if not report.converged:
        raise RuntimeError(f"the solver stopped at a residual of {report.residual:.1e}")
    contacts = world.contacts()
    return np.asarray(contacts.forces.sum(axis=0) * (1 if contacts.body_a[0] == ball.index else -1))


def found(case: dict[str, float], model: Any, young_modulus: float) -> tuple[float, float]:
    """Force (N) without friction, and tangential stiffness (N/m) where nothing slips."""
    down = case["ball_radius"] - case["depth"]
    pressed = abs(force(*scene(case, model, young_modulus, 0.0), (0.0, 0.0, down))[2])
    sticking = scene(case, model, young_modulus, 3.0)
    shift = 2e-2 * case["depth"]
    before, after = (force(*sticking, (x, 0.0, down))[0] for x in (0.0, shift))
    return float(pressed), float(abs(after - before) / shift)


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--models", nargs="+", default=MODELS, help=f"compliance models ({' '.join(MODELS)})")
    models = parser.parse_args().models
    reference = json.loads(PLACE.read_text())
    print("| R, depth, h (mm) | nu | a/h |", " | ".join(f"{model}: F, k_t" for model in models), "|")
    print("|" + " --- |" * (3 + len(models)))
    for case in reference["layers"]:
        lengths = ", ".join(f"{1e3 * case[name]:g}" for name in ("ball_radius", "depth", "thickness"))
        row = []
        for model in models:
            F, k_t = found(case, model, reference["young_modulus"])
            row.append(f"{F / case['F'] - 1:+.0%}, {k_t / case['k_t_level'] - 1:+.0%}")
        print(f"| {lengths} | {case['poisson_ratio']:g} | {case['a'] / case['thickness']:.2f} |", " | ".join(row), "|", flush=True)


if __name__ == "__main__":
    main()
