"""Random calls of everything public: functions, constructors, methods, properties, operators.

A case is a row of ``CALLS`` calls among the same few objects, which the calls add to and change. What is public is found by introspection,
so that what is added to the package is called too.
"""

from __future__ import annotations

import contextlib
import copy
import inspect
import os
import pickle
import tempfile
from collections.abc import Callable
from typing import Any

import numpy as np
from odd_values import OddError, Random, any_value, array, unit_rows

import quasirigid as qr
from quasirigid import mocap

CALLS = 20
"""Calls of a case."""
SKIPPED = {"view", "record", "Recorder", "SceneRecording", "Recording", "load_object", "shipped_take"}
"""Pages of a browser and files: tested by the file."""
USUAL: dict[str, list[Any]] = {
    "points": [60, 300, 400], "control_points": [None, 20, 40], "radius": [0.01, 0.02], "length": [0.01, 0.05], "size": [(0.02, 0.03,
    0.04)], "side": [0.1, "left", "right"],
    "mass": [0.1, None], "density": [1000.0, None], "motion": ["inertial", "quasi-static", "fixed"], "position": [(0, 0, 0.01), None],
    "quaternion": [(1, 0, 0, 0), None],
    "finger": [0, 1, 2], "n": [1, 2, 5], "name": ["rubber", "wood", "thing"], "a": ["rubber", "wood"], "b": ["rubber", "wood"],
    "friction": [0.5, None], "W": [np.eye(3), np.eye(6)],
    "q": [(-1.0, 0.2, 0.0), np.zeros(6)], "mu": [(0.5,), (0.5, 0.3)], "timeout": [0.0, 0.01], "bind": ["127.0.0.1"], "connection": ["0"],
    "targets": [()], "source_port": [0],
    "iterations": [0, 5], "tolerance": [1e-6], "max_sweeps": [10], "normal": [(0, 0, 1)], "normals": [None], "areas": [None],
    "semi_axes": [(0.012, 0.0085, 0.007)], "threads": [1, 2],
    "dt": [1e-3], "gravity": [(0, 0, -9.81)], "compliance": ["local", "layer", "half-space", "gaussian"], "speed": [1.0, 0.1], "now": [0.0, 0.1], "time": [0.0],
    "arrival": [0.0], "rate": [20.0],
    "stiffness": [1.0, (100.0, 1.0)], "damping": [1.0, (1.0, 0.1)], "direction": [None, (1, 0, 0)], "ratio": [None, 2.0],
    "time_budget": [None, 0.01], "step_budget": [None, 0.01],
}  # fmt: skip
"""Arguments by the name of a parameter, that get a call behind its first checks."""


def public_callables() -> dict[str, Any]:
    """Functions and classes by their full names."""
    found = {}
    for module in (qr, mocap):
        for name in module.__all__:
            thing = getattr(module, name)
            if callable(thing) and not (inspect.isclass(thing) and issubclass(thing, BaseException)) and name not in SKIPPED:
                found[f"{module.__name__}.{name}"] = thing
    return found


PUBLIC = public_callables()
CLASSES = tuple(thing for thing in PUBLIC.values() if inspect.isclass(thing))
OPERATORS: list[Callable[[Any, Any], Any]] = [
    lambda a, b: a == b, lambda a, b: a != b, lambda a, _: a in [a], lambda a, _: hash(a), lambda a, _: repr(a), lambda a, _: str(a),
    lambda a, _: copy.copy(a),
    lambda a, _: pickle.loads(pickle.dumps(a)), lambda a, _: copy.deepcopy(a), lambda a, b: {a: b}, lambda a, _: dir(a),
]  # fmt: skip


@contextlib.contextmanager
def _quiet_folder() -> Any:
    """A folder of its own for calls that write files by relative names."""
    home = os.getcwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            yield
        finally:
            os.chdir(home)


_FIXED: list[Any] = []


def _constants() -> list[Any]:
    """Values that never change, made once by a process."""
    if not _FIXED:
        box = qr.Surface.box((0.02, 0.03, 0.04), points=300, control_points=40)
        take = mocap.Take.pinch(rate=10.0)
        frames = take.frames(mocap.HandDecoder("right"))
        _FIXED.extend([
            box, qr.Surface.half_space(0.1, points=300, control_points=40), qr.Material.preset("rubber"), qr.Friction(0.5, 0.4),
            qr.MassProperties.sphere(0.02, mass=0.1),
            qr.HandModel.three_finger(), qr.ComplianceMatrix(np.eye(120) * 1e-6), qr.ContactProblem(np.eye(3), [-1.0, 0.2, 0.0], [0.5]),
            take, frames[3],
            take.packets[0], mocap.Calibration((0, 0, 1)),
        ])  # fmt: skip
    return list(_FIXED)


def _objects() -> list[Any]:
    """The objects of a case: a world with a body on a floor, a hand, and what else there is."""
    values = _constants()
    box, floor, rubber = values[:3]
    world = qr.World()
    ground = world.add_body(floor, rubber, motion="fixed")
    body = world.add_body(box, rubber, mass=0.1, position=(0, 0, 0.0199))
    hand = world.add_hand(position=(0, 0, 0.3), points=300, control_points=20)
    tracker = mocap.HandTracker("right")
    tracker.push(values[9])
    return [*values, world, ground, body, hand, world.step(), world.contacts(), tracker, tracker.sample(0.0), mocap.HandDecoder("right")]


def _argument(rng: Random, name: str, things: Callable[[Random], Any], usual: float) -> Any:
    if rng.random() < usual:
        if name in USUAL:
            return USUAL[name][rng.integers(len(USUAL[name]))]
        return things(rng) if rng.random() < 0.5 else unit_rows(rng)
    return any_value(rng, things)


def _arguments(rng: Random, function: Any, things: Callable[[Random], Any]) -> tuple[list[Any], dict[str, Any]]:
    """For the parameters of a function; now and then too many or too few."""
    usual = float(rng.choice([0.0, 0.5, 0.8, 0.9]))
    try:
        parameters = list(inspect.signature(function).parameters.values())
    except (TypeError, ValueError):
        parameters = []
    places, named = [], {}
    for parameter in parameters:
        if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD) or parameter.name == "self":
            continue
        if parameter.default is not parameter.empty and rng.random() < 0.6:
            continue
        value = _argument(rng, parameter.name, things, usual)
        if parameter.kind is parameter.KEYWORD_ONLY or named or parameter.default is not parameter.empty:
            named[parameter.name] = value
        else:
            places.append(value)
    if rng.random() < 0.03:
        places = places[:-1] if places and rng.random() < 0.5 else [*places, any_value(rng, things)]
    return places, named


def _members(thing: Any) -> list[str]:
    return [name for name in dir(type(thing)) if not name.startswith("_") or name in ("__len__",)]


def _call(rng: Random, objects: list[Any]) -> Any:
    """One call; what it returns."""

    def things(random: Random) -> Any:
        return objects[random.integers(len(objects))]

    draw = rng.random()
    if draw < 0.25:
        function = PUBLIC[sorted(PUBLIC)[rng.integers(len(PUBLIC))]]
        if inspect.isclass(function) and rng.random() < 0.7:
            makers = [
                name
                for name in vars(function)
                if not name.startswith("_") and isinstance(inspect.getattr_static(function, name), staticmethod | classmethod)
            ]
            if makers:
                function = getattr(function, makers[rng.integers(len(makers))])
    elif draw < 0.35:
        return OPERATORS[rng.integers(len(OPERATORS))](things(rng), any_value(rng, things))
    else:
        owner = things(rng)
        names = _members(owner)
        if not names:
            return None
        name = names[rng.integers(len(names))]
        descriptor = inspect.getattr_static(type(owner), name, None)
        if not callable(getattr(type(owner), name)) or inspect.isdatadescriptor(descriptor):
            if rng.random() < 0.5:
                value = getattr(owner, name)
                return value if rng.random() < 0.7 or not isinstance(value, np.ndarray) else _write(value)
            if getattr(type(owner), name, None) is None:
                return None
            with contextlib.suppress(AttributeError):  # of Python, for a property without a setter
                setattr(owner, name, _argument(rng, name, things, 0.3) if rng.random() < 0.5 else array(rng))
            return None
        function = getattr(owner, name)
    places, named = _arguments(rng, function, things)
    return function(*places, **named)


def _write(value: np.ndarray[Any, Any]) -> None:
    """Writes into an array that a property has returned: it is the caller's own, or it refuses with a typed error."""
    if value.flags.writeable or type(value) is not np.ndarray:
        value[...] = 1


def run_calls(context: dict[str, Any], number: int) -> str:
    """Case ``number``: how many of its calls returned a value, in tenths. Raises what a call raised, if it was neither typed nor a
    ``TypeError``.
    """
    rng = np.random.default_rng([int(context["seed"]), number])
    values = 0
    with _quiet_folder():
        objects = _objects()
        closing: list[Any] = []
        for _ in range(CALLS):
            try:
                made = _call(rng, objects)
            except (qr.QuasirigidError, TypeError, OddError):
                continue
            values += 1
            if isinstance(made, mocap.Receiver | mocap.Replay | mocap.TakeWriter):
                closing.append(made)
            if isinstance(made, CLASSES) and len(objects) < 60:
                objects.append(made)
            _check_finite(made)
        for opened in closing:
            opened.__exit__(None, None, None)
    return f"{values // 5 * 5} to {values // 5 * 5 + 4} values"


def _check_finite(made: Any) -> None:
    """A world that was given finite numbers has none that are not."""
    if isinstance(made, qr.World):
        for body in made.bodies:
            assert np.isfinite(body.position).all(), "a body is nowhere"
