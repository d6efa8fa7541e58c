"""quasirigid, MuJoCo and Drake on the same scenes in one run.

    pip install -r benchmarks/peers/requirements.txt      into an environment that has quasirigid
    python benchmarks/peers/compare.py                    everything, with a hold of 60 s
    python benchmarks/peers/compare.py --quick            one setting of each engine, a minute
    python benchmarks/peers/compare.py --hold 10 --only quasirigid --only mujoco --json peers.json

A peer that is not installed gets rows that say so. Tables go to standard output as Markdown, progress to standard error; `--json FILE` keeps the figures,
`--write docs/peers.md` puts the tables between the markers of that page.
"""

from __future__ import annotations

import argparse
import dataclasses
import importlib
import json
import multiprocessing
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from types import ModuleType
from typing import Any

import measures
import tables
from scene import Configuration

ELLIPTIC = {"cone": "elliptic"}
BEST = ELLIPTIC | {"condim": 4, "noslip_iterations": 10}
FLEXIBLE = ELLIPTIC | {"integrator": "discrete", "young": 1e6}
START, END = "<!-- compare.py -->\n", "\n<!-- end -->"


def _ours(control_points: int, dt: float, compliance: str = "local") -> Configuration:
    options = {"control_points": control_points, "compliance": compliance}
    return Configuration(
        "quasirigid",
        f"quasirigid, {compliance}",
        dt,
        options,
        "yes: pressure and friction at every contact",
        costly=compliance == "half-space" and dt < 5e-3,
    )


def _mujoco(name: str, dt: float, options: dict[str, Any]) -> Configuration:
    return Configuration("mujoco", f"MuJoCo {name}", dt, options, "no: one force per pad")


def _drake_point(dt: float) -> Configuration:
    return Configuration("drake", "Drake point, SAP", dt, {"model": "point"}, "no: one force per pad")


def _drake(dt: float, hint: float, modulus: float) -> Configuration:
    options = {"model": "hydroelastic", "resolution_hint": hint, "modulus": modulus}
    return Configuration("drake", "Drake hydroelastic, SAP", dt, options, "yes: pressure and traction on every polygon", costly=dt < 5e-3)


HYDROELASTIC = ((0.006, 1e6), (0.006, 2.4e5), (0.003, 1e6))
"""Resolution hint (m) and modulus (Pa) for about 60, 110 and 160 polygons."""
CONFIGURATIONS = [
    *(_ours(n, dt) for dt in (1e-3, 1e-2) for n in (160, 280, 410)),
    _ours(240, 1e-3, "half-space"),
    _mujoco("defaults (pyramidal, condim 3)", 2e-3, {}),
    _mujoco("defaults", 1e-3, {}),
    _mujoco("elliptic, impratio 10", 1e-3, ELLIPTIC | {"impratio": 10}),
    _mujoco("elliptic, condim 4, noslip 10", 1e-3, BEST),
    _mujoco("elliptic, condim 4, noslip 10", 1e-2, BEST),
    Configuration("mujoco", "MuJoCo flexible pads, elliptic, impratio 10", 1e-3, FLEXIBLE | {"impratio": 10}, "no: forces at vertices"),
    Configuration("mujoco", "MuJoCo flexible pads, elliptic, impratio 100", 1e-3, FLEXIBLE | {"impratio": 100}, "no: forces at vertices"),
    _drake_point(1e-3),
    _drake_point(1e-2),
    *(_drake(dt, *setting) for dt in (1e-3, 1e-2) for setting in HYDROELASTIC),
]
QUICK = [_ours(160, 1e-3), _mujoco("elliptic, condim 4, noslip 10", 1e-3, BEST), _drake_point(1e-3)]
CAPSULE = [
    *(Configuration("quasirigid", "quasirigid, local", dt, {}, "") for dt in (1e-3, 1e-2)),
    *(
        Configuration("mujoco", f"MuJoCo {name}", dt, options, "")
        for name, options in (
            ("defaults", {}),
            ("elliptic", ELLIPTIC),
            ("elliptic, impratio 10", ELLIPTIC | {"impratio": 10}),
            ("elliptic, condim 4, noslip 10", BEST),
        )
        for dt in (1e-3, 2e-3)
    ),
]
ENGINES = {
    "quasirigid": ("ours", "Ours", "OurCapsule"),
    "mujoco": ("mujoco_peer", "MuJoCo", "MuJoCoCapsule"),
    "drake": ("drake_peer", "Drake", ""),
}


def say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def load(only: list[str] | None) -> dict[str, ModuleType]:
    """The engines that are wanted and there."""
    installed = {}
    for engine in only or ENGINES:
        try:
            installed[engine] = importlib.import_module(ENGINES[engine][0])
        except ImportError as missing:
            say(f"{engine} is left out: {missing}")
    return installed


def measure_one(configuration: Configuration, effort: measures.Effort) -> dict[str, Any]:
    """The row of one configuration, but for its cost; in a process of its own if there are several."""
    row = measures.measure(_make(configuration), configuration, effort)
    return row | {"options": configuration.options, "short_hold": row["hold_s"] < effort.hold}


def _make(configuration: Configuration) -> measures.Make:
    module, scene_class, _ = ENGINES[configuration.engine]
    return getattr(importlib.import_module(module), scene_class)


def run(configurations: list[Configuration], installed: dict[str, ModuleType], effort: measures.Effort, jobs: int) -> list[dict[str, Any]]:
    """The rows of the large table."""
    there = [c for c in configurations if c.engine in installed]
    measured = []
    with ExitStack() as stack:
        spread = map
        if jobs > 1:
            spread = stack.enter_context(ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn"))).map
        for c, row in zip(there, spread(measure_one, there, [effort] * len(there)), strict=True):
            say(f"{len(measured) + 1}/{len(there)} {c.name}, dt {1e3 * c.dt:g} ms: {json.dumps(row)}")
            measured.append(row)
    say("cost of a step, by turns")
    for row, figures in zip(measured, measures.cost([(_make(c), c) for c in there], effort.cost_rounds), strict=True):
        row.update(figures)
        say(f"    {row['name']}, dt {row['dt_ms']:g} ms, {row['contacts']} contacts: {figures}")
    rows = iter(measured)
    return [
        next(rows) if c.engine in installed else {"name": c.name, "dt_ms": 1e3 * c.dt, "missing": tables.MISSING} for c in configurations
    ]


def run_capsule(installed: dict[str, ModuleType], effort: measures.Effort, cases: list[Configuration]) -> list[dict[str, Any]]:
    """The rows of the capsule's table."""
    rows = []
    for c in cases:
        row: dict[str, Any] = {"name": c.name, "dt_ms": 1e3 * c.dt}
        if c.engine in installed:
            say(f"capsule: {c.name}, dt {1e3 * c.dt:g} ms")
            simulation = getattr(installed[c.engine], ENGINES[c.engine][2])(c.dt, c.options)
            rows.append(row | measures.capsule(simulation, effort.capsule))
        else:
            rows.append(row | {"missing": tables.MISSING})
    return rows


def around(page: Path) -> tuple[str, str]:
    """What stands before and after the tables of a page."""
    try:
        text = page.read_text()
    except OSError as error:
        raise SystemExit(f"{page} cannot be read: {error.strerror}") from None
    if START not in text or END not in text:
        raise SystemExit(f"{page} lacks the markers {START.strip()} and {END.strip()}")
    head, rest = text.split(START, 1)
    return head + START, END + rest.split(END, 1)[1]


def write(page: Path, text: str) -> None:
    """Puts the tables between the markers of a page."""
    page.write_text(text.join(around(page)))


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hold", type=float, metavar="SECONDS", help="length of the hold (default 60)")
    parser.add_argument("--hold-costly", type=float, metavar="SECONDS", help="the same where a step takes over 0.3 ms (default: as --hold)")
    parser.add_argument("--quick", action="store_true", help="one setting of each engine, a hold of 1 s")
    parser.add_argument("--only", action="append", choices=ENGINES, help="leave the others out; may be given several times")
    parser.add_argument(
        "--jobs", type=int, default=1, metavar="N", help="processes for all but the cost, which is always taken alone (default 1)"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="keep all figures")
    parser.add_argument("--write", type=Path, metavar="FILE", help="put the tables between the markers of this page")
    options = parser.parse_args(arguments)
    effort = measures.QUICK if options.quick else measures.Effort()
    hold = effort.hold if options.hold is None else options.hold
    hold_costly = hold if options.hold_costly is None else options.hold_costly
    if not (0.0 < hold < float("inf") and 0.0 < hold_costly < float("inf")):
        parser.error("a hold must be a positive number of seconds")
    effort = dataclasses.replace(effort, hold=hold, hold_costly=hold_costly)
    if options.jobs < 1:
        parser.error(f"--jobs must be 1 or more, not {options.jobs}")
    if options.json and not options.json.parent.is_dir():
        parser.error(f"--json: there is no folder {options.json.parent}")
    if options.write:
        around(options.write)
    installed = load(options.only)
    wanted = [c for c in (QUICK if options.quick else CONFIGURATIONS) if not options.only or c.engine in options.only]
    capsules = [c for c in CAPSULE if (not options.only or c.engine in options.only) and (not options.quick or c.dt == 1e-3)]
    capsule = run_capsule(installed, effort, capsules)
    results = run(wanted, installed, effort, options.jobs)
    versions = ", ".join(module.VERSION for module in installed.values())
    about = f"{versions}; Python {sys.version.split()[0]}; hold of {effort.hold:g} s; one thread of {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} at the end."
    text = tables.markdown(results, capsule, about)
    print(text)
    if options.json:
        options.json.write_text(json.dumps({"about": about, "results": results, "capsule": capsule}, indent=2) + "\n")
    if options.write:
        write(options.write, text)


if __name__ == "__main__":
    main()
