"""The finite elements that pads are held against: right where there is a closed form, and the stored figures are theirs."""

from __future__ import annotations

import importlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
E = 1e6  # Pa
DEEP = 1000.0
"""Thickness over contact radius of what stands for a half-space: a stamp on it is 0.09 % stiffer."""


@pytest.fixture
def fem(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Imports a module of the finite elements by name."""
    monkeypatch.syspath_prepend(ROOT / "benchmarks" / "finite_elements")
    return importlib.import_module


def shear_modulus(nu: float) -> float:
    return E / (2 * (1 + nu))


@pytest.mark.parametrize("nu", [0.3, 0.45, 0.49, 0.4999])
def test_flat_stamps_on_a_deep_layer_have_the_stiffness_of_those_on_a_half_space(fem: Any, nu: float) -> None:
    meshes, contact = fem("meshes"), fem("contact")
    a, G, soft = 1e-3, shear_modulus(nu), contact.Soft(E, nu)
    mesh = meshes.layer(DEEP * a, a, meshes.COARSE)
    # K. L. Johnson, Contact Mechanics, 3.4: P = 4 G a/(1 - nu) d; 3.7 (no normal traction): Q = 8 G a/(2 - nu) s.
    k_n = contact.stamped(mesh, soft, a, [])[0][0] / (4 * G * a / (1 - nu)) - 1
    k_t = contact.shear_stiffness(mesh, soft, a, level=False) / (8 * G * a / (2 - nu)) - 1
    print(f"nu {nu}: flat stamp on a deep layer, normal {k_n:+.2%}, tangential {k_t:+.2%}")
    assert abs(k_n) < 0.005, k_n
    assert abs(k_t) < 0.005, k_t


@pytest.mark.parametrize("nu", [0.3, 0.49])
def test_a_ball_on_a_deep_layer_is_that_of_hertz(fem: Any, nu: float) -> None:
    meshes, contact = fem("meshes"), fem("contact")
    R, d, soft = 1.0, 1e-6, contact.Soft(E, nu)
    a = np.sqrt(R * d)
    mesh = lambda rim: meshes.layer(DEEP * a, rim, meshes.COARSE)  # noqa: E731
    found = contact.Curve(mesh, soft, contact.ball(R), 0.7 * a, 1.5 * a, 6).press(d)
    touch = contact.checked(mesh(found.radius), soft, contact.ball(R), d, found.radius)
    modulus = E / (1 - nu**2)
    hertz = 4 / 3 * modulus * np.sqrt(R) * d**1.5, a, 2 * modulus * a / (np.pi * R), 2 * modulus * a, 2 * modulus * a
    off = np.array([found.force, found.radius, touch.peak, found.stiffness, touch.flat_stiffness]) / hertz - 1
    print(f"nu {nu}: Hertz, off by", ", ".join(f"{what} {x:+.2%}" for what, x in zip(("F", "a", "p0", "dF/dd", "k_n"), off, strict=True)))
    assert abs(off).max() < 0.005, off
    assert max(touch.tension, touch.overlap) < 1e-3, touch


def thin(stiffness: Any) -> float:
    """Limit for h/a to 0 of a stiffness over its thin-layer form: what the rim adds is as h/a and (h/a)^2."""
    x = np.array([0.2, 0.1, 0.05, 0.025])
    return float(np.polyfit(x, [stiffness(ratio) for ratio in x], 2)[-1])


@pytest.mark.parametrize(("nu", "what"), [(0.3, "squeezed"), (0.5 - 1e-7, "flowing"), (0.3, "sheared"), (0.5 - 1e-7, "sheared")])
def test_stamps_on_a_thin_layer_squeeze_it_make_it_flow_and_shear_it(fem: Any, nu: float, what: str) -> None:
    meshes, contact = fem("meshes"), fem("contact")
    a, G, soft = 1e-2, shear_modulus(nu), contact.Soft(E, nu)
    modulus = 2 * G * (1 - nu) / (1 - 2 * nu)  # where nothing can go sideways, Pa

    def over_limit(ratio: float) -> float:
        h = ratio * a
        mesh = meshes.layer(h, a, meshes.COARSE)
        if what == "sheared":
            return float(contact.shear_stiffness(mesh, soft, a, level=False) / (G * np.pi * a**2 / h))
        # Incompressible: what the stamp displaces flows out along the layer, bonded below and free to slide above: -h^3/(3 G) dp/dr = r/2,
        # so that p = 3 G (a^2 - r^2)/(4 h^3) under a stamp pushed in by 1.
        limit = modulus * np.pi * a**2 / h if what == "squeezed" else 3 * np.pi * G * a**4 / (8 * h**3)
        return float(contact.stamped(mesh, soft, a, [])[0][0] / limit)

    off = thin(over_limit) - 1
    print(f"nu {nu:.7g}: thin layer, {what}, off in the limit by {off:+.2%} (at h/a = 1/40 by {over_limit(0.025) - 1:+.1%})")
    assert abs(off) < 0.01, off


def test_a_ball_on_a_thin_incompressible_layer_touches_within_twice_hertz(fem: Any) -> None:
    meshes, contact = fem("meshes"), fem("contact")
    nu, a, R = 0.5 - 1e-7, 1e-2, 1e3
    d = a**2 / (4 * R)

    def over_limit(ratio: float) -> tuple[float, float]:
        # As above, with what the ball displaces: -h^3/(3 G) dp/dr = (d r/2 - r^3/(8 R)), which is 0 at a = 2 sqrt(R d); F = 2 pi G R^2
        # d^3/h^3.
        h = ratio * a
        mesh = lambda rim: meshes.layer(h, rim, meshes.COARSE)  # noqa: E731
        found = contact.Curve(mesh, contact.Soft(E, nu), contact.ball(R), 0.6 * a, 1.5 * a, 8).press(d)
        return found.force / (2 * np.pi * shear_modulus(nu) * R**2 * d**3 / h**3), found.radius / a

    force, radius = (thin(lambda ratio, k=k: over_limit(ratio)[k]) - 1 for k in (0, 1))
    print(f"ball on a thin incompressible layer: force off in the limit by {force:+.2%}, radius by {radius:+.2%}")
    assert abs(force) < 0.02, force
    assert abs(radius) < 0.01, radius


def test_rings_that_open_and_close_find_the_same_contact_as_the_greatest_force(fem: Any) -> None:
    elements, meshes, contact = fem("elements"), fem("meshes"), fem("contact")
    R, d, h, soft = 0.05, 2e-4, 3e-3, contact.Soft(E, 0.45)
    a = np.sqrt(R * d)
    best = contact.Curve(lambda rim: meshes.layer(h, rim, meshes.COARSE), soft, contact.ball(R), 0.8 * a, 2.1 * a, 6).press(d)
    reach, count = 1.5 * a, 40
    r = np.concatenate([np.linspace(0, reach, count + 1), reach + meshes.steps(10 * h, reach / count, 1.5, h / 2)[1:]])
    z = -meshes.steps(h, reach / count, 1.3, h / 8)[::-1]
    mesh = elements.Mesh(*np.meshgrid(meshes.with_middles(r), meshes.with_middles(z), indexing="ij"))
    pressure, area = contact.active_set(mesh, soft, contact.ball(R), d, count)
    force, radius = pressure @ area, np.sqrt(area[pressure > 0].sum() / np.pi)
    off = (radius - best.radius) / (reach / count)
    print(f"rings: force {force / best.force - 1:+.2%}, radius {off:+.2f} of them beside the greatest force")
    assert force == pytest.approx(best.force, rel=0.005)
    assert radius == pytest.approx(best.radius, abs=reach / count)


def test_moving_and_tilting_a_tip_as_a_whole_takes_no_force(fem: Any) -> None:
    elements, meshes = fem("elements"), fem("meshes")
    mesh = meshes.tip(10e-3, 7e-3, 2e-3, meshes.COARSE)
    r, z, zero = mesh.r.ravel(), mesh.z.ravel(), np.zeros(mesh.r.size)
    one = zero + 1
    # Along z; along x; about y, where u_x = z and u_z = -x. The stretch u_r = r, u_z = z is no motion as a whole, and does take some.
    motions = {0: [(zero, zero, one)], 1: [(one, -one, zero), (z, -z, -r)]}
    for harmonic, fields in motions.items():
        K = elements.stiffness(mesh, E, 0.49, harmonic)
        for field in fields:
            u = np.stack(field, axis=1).ravel()
            off = abs(K @ u).max() / (abs(K).max() * abs(u).max())
            print(f"harmonic {harmonic}: force of a motion as a whole {off:.1e} of the largest entry")
            assert off < 1e-12, off
    stretch = np.stack([r, zero, z], axis=1).ravel()
    volume = 2 * np.pi / 3 * 10e-3**2 * 7e-3
    energy = stretch @ elements.stiffness(mesh, E, 0.3, 0) @ stretch / 2
    expected = 4.5 * E / (3 * (1 - 0.6)) * volume  # 9 K/2 times the volume, for the strain 1 in all directions
    assert energy == pytest.approx(expected, rel=1e-4), energy / expected - 1


def test_the_stored_figures_are_those_of_the_program(fem: Any) -> None:
    stored = json.loads((Path(__file__).parent / "references" / "pads.json").read_text())
    reference, coarse = fem("reference"), fem("meshes").COARSE
    assert len(stored["layers"]) == 18
    assert len(stored["tips"]) == 45
    layer = next(
        case for case in stored["layers"] if (case["ball_radius"], case["thickness"], case["poisson_ratio"]) == (0.05, 0.003, 0.49)
    )
    tip = next(
        case
        for case in stored["tips"]
        if (case["radius"], case["height"], case["depth"], case["poisson_ratio"]) == (0.01, 0.007, 0.0006, 0.45)
    )
    again = [
        (layer, reference.pressed_layer(layer["ball_radius"], layer["depth"], layer["thickness"], 0.49, coarse)),
        (tip, reference.pressed_tip(tip["radius"], tip["height"], [tip["depth"]], 0.45, coarse)[0]),
    ]
    for then, now in again:
        off = {name: now[name] / then[name] - 1 for name in stored["meaning"]}
        print("coarser mesh:", ", ".join(f"{name} {x:+.2%}" for name, x in off.items()))
        assert max(map(abs, off.values())) < 0.01, off
