"""quasirigid, MuJoCo and Drake on the same scenes in one run.

    pip install quasirigid mujoco drake
    python benchmarks/peers/compare.py                    everything, with a hold of 60 s
    python benchmarks/peers/compare.py --hold 10 --only quasirigid --only mujoco

A peer that is not installed is left out, and said to be. Results go to standard output as Markdown, progress to standard error; `--json FILE` keeps the
figures, `--write docs/peers.md` puts the tables between the markers of that page.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import scene
from scene import Configuration

ELLIPTIC = {"cone": "elliptic"}
BEST = ELLIPTIC | {"condim": 4, "noslip_iterations": 10}


def _ours(control_points: int, dt: float, compliance: str = "local") -> Configuration:
    options = {"control_points": control_points, "compliance": compliance}
    return Configuration("quasirigid", f"quasirigid, {compliance}", dt, options, "yes: pressure and friction at every contact")


def _mujoco(name: str, dt: float, options: dict[str, Any]) -> Configuration:
    return Configuration("mujoco", f"MuJoCo {name}", dt, options, "no: one force per pad")


def _drake(dt: float, hint: float, modulus: float) -> Configuration:
    options = {"model": "hydroelastic", "resolution_hint": hint, "modulus": modulus}
    return Configuration("drake", "Drake hydroelastic, SAP", dt, options, "yes: pressure on every polygon")


CONFIGURATIONS = [
    *(_ours(n, dt) for n in (155, 280, 410) for dt in (1e-3, 1e-2)),
    _ours(280, 1e-3, "half-space"),
    _mujoco("defaults (pyramidal, condim 3)", 2e-3, {}),
    _mujoco("defaults", 1e-3, {}),
    _mujoco("elliptic, impratio 10", 1e-3, ELLIPTIC | {"impratio": 10}),
    _mujoco("elliptic, condim 4, noslip 10", 1e-3, BEST),
    _mujoco("elliptic, condim 4, noslip 10", 1e-2, BEST),
    Configuration("drake", "Drake point, SAP", 1e-3, {"model": "point"}, "no: one force per pad"),
    Configuration("drake", "Drake point, SAP", 1e-2, {"model": "point"}, "no: one force per pad"),
    *(_drake(dt, hint, modulus) for dt in (1e-3, 1e-2) for hint, modulus in ((0.006, 1e6), (0.006, 2.4e5), (0.003, 1e6))),
]
CAPSULE = [("defaults", {}), ("elliptic, impratio 10", ELLIPTIC | {"impratio": 10}), ("elliptic, condim 4, noslip 10", BEST)]
ENGINES = {"quasirigid": ("ours", "Ours"), "mujoco": ("mujoco_peer", "MuJoCo"), "drake": ("drake_peer", "Drake")}

FALLEN = 0.03
"""m: the box has left the pads."""
SLIDING = 0.01
"""m/s: the box slips."""
RAMP = 2.0
"""N/s, of the pull that makes it slip."""
OFFSETS = (0.003, 0.01)
"""Of the centre of mass from the axis of two pads, m."""


def measure(make: Callable[..., scene.Simulation], configuration: Configuration, hold: float) -> dict[str, Any]:
    """All figures of one configuration."""
    return {
        "name": configuration.name,
        "dt_ms": 1e3 * configuration.dt,
        **measure_hold(make(configuration), configuration.dt, hold),
        **measure_slip(make(configuration), configuration.dt),
        "twist": [measure_twist(make(configuration, 2, offset), configuration.dt) | {"offset_mm": 1e3 * offset} for offset in OFFSETS],
        "pressure_field": configuration.pressure_field,
    }


def measure_hold(simulation: scene.Simulation, dt: float, hold: float) -> dict[str, Any]:
    """Sink rate over the last five sixths of the hold (+ is down), and CPU time of a step."""
    steps = round(hold / dt)
    start = simulation.height()
    heights, times, fell = [], [], None
    for k in range(steps):
        before = time.thread_time_ns()
        simulation.step()
        times.append(time.thread_time_ns() - before)
        heights.append(simulation.height())
        if start - heights[-1] > FALLEN:
            fell = (k + 1) * dt
            break
    since = len(heights) // 6
    seconds = (len(heights) - 1 - since) * dt
    return {
        "contacts": simulation.contacts(),
        "creep_um_per_s": 1e6 * (heights[since] - heights[-1]) / seconds,
        "sink_um": 1e6 * (start - heights[-1]),
        "fell_at_s": fell,
        "hold_s": hold,
        "cpu_ms": float(np.median(times)) * 1e-6,
        "cpu_p99_ms": float(np.quantile(times, 0.99)) * 1e-6,
        "squeeze_n": simulation.squeeze(),
    }


def measure_slip(simulation: scene.Simulation, dt: float) -> dict[str, Any]:
    """Friction over twice the squeeze when the box slides at 10 mm/s under a growing pull; exactly mu if Coulomb holds."""
    window = max(round(0.01 / dt), 1)
    heights = [simulation.height()]
    pull, squeeze = 0.0, simulation.squeeze()
    for k in range(round(6.0 / dt)):
        pull = RAMP * k * dt
        simulation.pull(pull)
        simulation.step()
        heights.append(simulation.height())
        if len(heights) <= 2 * window:
            continue
        if k % window == 0:
            squeeze = simulation.squeeze() or squeeze
        speed = (heights[-1 - window] - heights[-1]) / (window * dt)
        if speed > SLIDING:
            # What friction carries is weight and pull less what accelerates the box.
            earlier = (heights[-1 - 2 * window] - heights[-1 - window]) / (window * dt)
            acceleration = (speed - earlier) / (window * dt)
            carried = scene.WEIGHT + pull - RAMP * window * dt - scene.BOX_MASS * acceleration
            # Point contacts may be apart for a step: the last that was there.
            ratio = carried / (2.0 * (simulation.squeeze() or squeeze))
            return {"slip_ratio": ratio, "slip_error": ratio / scene.FRICTION - 1.0, "slips_under_its_weight": pull < 0.05 * scene.WEIGHT}
    return {"slip_ratio": None, "slip_error": None, "slips_under_its_weight": False}


def measure_twist(simulation: scene.Simulation, dt: float) -> dict[str, Any]:
    """Angle of the box after 5 s with its centre of mass off the axis of the pads, and how fast it turned in the last second."""
    angles = [simulation.angle()]
    for _ in range(round(5.0 / dt)):
        simulation.step()
        angles.append(simulation.angle())
    turned = np.degrees(np.unwrap(angles))
    last = round(1.0 / dt)
    return {
        "angle_deg": float(turned[-1]),
        "peak_deg": float(np.abs(turned).max()),
        "rate_deg_per_s": float(turned[-1] - turned[-1 - last]),
    }


def measure_capsule(installed: dict[str, Any], seconds: float = 5.0) -> list[dict[str, Any]]:
    """Sink rate of the capsule of google-deepmind/mujoco issue 3328, over 5 s after one second to settle."""
    cases: list[tuple[str, Callable[[], Any]]] = []
    if "quasirigid" in installed:
        cases += [(f"quasirigid, dt {1e3 * dt:g} ms", lambda dt=dt: installed["quasirigid"].OurCapsule(dt)) for dt in (1e-3, 2e-3)]
    if "mujoco" in installed:
        cases += [
            (f"MuJoCo {name}, dt {1e3 * dt:g} ms", lambda dt=dt, options=options: installed["mujoco"].MuJoCoCapsule(dt, options))
            for name, options in CAPSULE
            for dt in (1e-3, 2e-3)
        ]
    rows = []
    for name, make in cases:
        say(f"capsule: {name}")
        simulation = make()
        simulation.run(1.0)
        start = simulation.height()
        simulation.run(seconds)
        rows.append({"name": name, "squeeze_n": simulation.squeeze(), "drift_m_per_s": (start - simulation.height()) / seconds})
    return rows


def markdown(results: list[dict[str, Any]], capsule: list[dict[str, Any]], about: str) -> str:
    """The tables."""
    lines = [
        about,
        "",
        "| | dt | hold | slips at load/2N = 0.8 | 3 mm off centre | 10 mm off centre | contacts | CPU ms a step | pressure field |",
    ]
    lines.append("| --- " * 9 + "|")
    for r in results:
        held = f"fell at {r['fell_at_s']:.1f} s" if r["fell_at_s"] else f"creeps {_rate(r['creep_um_per_s'] * 1e-6, 'm/s')}"
        slip = "never" if r["slip_ratio"] is None else f"{r['slip_ratio']:.3f} ({100 * r['slip_error']:+.1f} %)"
        if r["slips_under_its_weight"]:
            slip = "slides under its weight"
        twist = [_twist(t) for t in r["twist"]]
        cells = [r["name"], f"{r['dt_ms']:g} ms", held, slip, *twist, str(r["contacts"]), f"{r['cpu_ms']:.3f}", r["pressure_field"]]
        lines.append("| " + " | ".join(cells) + " |")
    if capsule:
        weight = scene.CAPSULE_MASS * scene.GRAVITY
        lines += ["", "| pinched capsule | squeeze | friction over weight | drift |", "| --- | --- | --- | --- |"]
        for r in capsule:
            margin = 2.0 * scene.CAPSULE_FRICTION * r["squeeze_n"] / weight
            lines.append(f"| {r['name']} | {r['squeeze_n']:.1f} N | {margin:.0f} x | {_rate(r['drift_m_per_s'], 'm/s')} |")
    return "\n".join(lines)


def _twist(figures: dict[str, Any]) -> str:
    if figures["peak_deg"] > 150.0:
        return "swings free"
    if abs(figures["rate_deg_per_s"]) < 1e-6:
        return f"holds, {figures['angle_deg']:.2f}°"
    rate = figures["rate_deg_per_s"]
    return f"{figures['angle_deg']:.2f}°, " + (f"{rate:.2g}°/s" if abs(rate) >= 0.01 else f"{rate:.1e}°/s")


def _rate(value: float, unit: str) -> str:
    """Such as ``3.1 µm/s``."""
    size = abs(value)
    for prefix, factor in (("m", 1e3), ("µ", 1e6), ("n", 1e9), ("p", 1e12)):
        if size * factor >= 1.0:
            return f"{value * factor:.3g} {prefix}{unit}"
    return f"under 1 p{unit}"


def say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hold", type=float, default=60.0, metavar="SECONDS", help="length of the hold (default 60)")
    parser.add_argument("--only", action="append", choices=ENGINES, help="leave the others out; may be given several times")
    parser.add_argument("--json", type=Path, metavar="FILE", help="keep all figures")
    parser.add_argument("--write", type=Path, metavar="FILE", help="put the tables between the markers of this page")
    arguments = parser.parse_args()
    installed = {}
    for engine, (module, _) in ENGINES.items():
        if arguments.only and engine not in arguments.only:
            continue
        try:
            installed[engine] = importlib.import_module(module)
        except ImportError as missing:
            say(f"{engine} is left out: {missing}")
    configurations = [c for c in CONFIGURATIONS if c.engine in installed]
    results = []
    for k, configuration in enumerate(configurations):
        say(f"{k + 1}/{len(configurations)} {configuration.name}, dt {1e3 * configuration.dt:g} ms {configuration.options}")
        make = getattr(installed[configuration.engine], ENGINES[configuration.engine][1])
        results.append(measure(make, configuration, arguments.hold))
        say(f"    {json.dumps(results[-1], default=str)}")
    capsule = measure_capsule(installed)
    versions = ", ".join(module.VERSION for module in installed.values())
    load = os.getloadavg()[0]
    about = f"{versions}; Python {sys.version.split()[0]}; hold of {arguments.hold:g} s; one thread of {os.cpu_count()} cores, load {load:.1f} at the end."
    text = markdown(results, capsule, about)
    print(text)
    if arguments.json:
        arguments.json.write_text(json.dumps({"about": about, "results": results, "capsule": capsule}, indent=2))
    if arguments.write:
        page = arguments.write.read_text()
        start, end = "<!-- compare.py -->\n", "\n<!-- end -->"
        head, rest = page.split(start, 1)
        arguments.write.write_text(head + start + text + end + rest.split(end, 1)[1])


if __name__ == "__main__":
    main()
