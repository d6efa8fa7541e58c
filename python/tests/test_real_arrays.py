"""Arrays from outside are real numbers, all of them known: complex and masked ones are refused everywhere, never cast."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

import quasirigid as qr
from quasirigid import mocap

EYE, ZEROS = np.eye(3), np.zeros(3)
BALL = qr.Surface.sphere(0.02, points=200)
BOX = qr.Surface.box((0.04, 0.06, 0.08), points=1_500)


def body(motion: Literal["inertial", "fixed"] = "inertial") -> tuple[qr.World, qr.Body]:
    world = qr.World()
    return world, world.add_body(BALL, qr.Material.preset("wood"), mass=None if motion == "fixed" else 0.1, motion=motion)


TAKERS: dict[str, tuple[Callable[[Any], Any], Any]] = {
    "solve W": (lambda a: qr.solve_contacts(a, ZEROS - 1.0, [0.5]), EYE),
    "solve q": (lambda a: qr.solve_contacts(EYE, a, [0.5]), ZEROS - 1.0),
    "solve mu": (lambda a: qr.solve_contacts(EYE, ZEROS - 1.0, a), np.ones(1)),
    "solve warm_start": (lambda a: qr.solve_contacts(EYE, ZEROS - 1.0, [0.5], warm_start=a), ZEROS),
    "problem W": (lambda a: qr.ContactProblem(a, ZEROS, np.ones(1)), EYE),
    "problem q": (lambda a: qr.ContactProblem(EYE, a, np.ones(1)), ZEROS),
    "problem reactions": (lambda a: qr.ContactProblem(EYE, ZEROS, np.ones(1), a), ZEROS),
    "gravity": (lambda a: qr.World(gravity=a), ZEROS),
    "points": (qr.Surface.from_points, np.array(BALL.points)),
    "normals": (lambda a: qr.Surface.from_points(BALL.points, a), np.array(BALL.normals)),
    "areas": (lambda a: qr.Surface.from_points(BALL.points, BALL.normals, a), np.array(BALL.areas)),
    "box": (lambda a: qr.Surface.box(a, points=200), np.full(3, 0.05)),
    "position": (lambda a: qr.World().add_body(BALL, qr.Material.preset("wood"), mass=0.1, position=a), ZEROS),
    "move_to": (lambda a: body("fixed")[1].move_to(a), ZEROS),
    "force": (lambda a: body()[1].apply_wrench(a), ZEROS),
    "plan points": (lambda a: qr.plan_grasp(a, BOX.normals), np.array(BOX.points)),
    "plan normals": (lambda a: qr.plan_grasp(BOX.points, a), np.array(BOX.normals)),
    "plan centre": (lambda a: qr.plan_grasp(BOX.points, BOX.normals, a), ZEROS),
    "calibration": (mocap.Calibration, ZEROS),
}


def masked(array: Any) -> Any:
    return np.ma.masked_array(array, mask=np.arange(array.size).reshape(array.shape) == 0)


WRONG: dict[str, Callable[[Any], Any]] = {
    "complex": lambda array: array + 0j,
    "imaginary": lambda array: array + 1e-3j,
    "complex numbers in lists": lambda array: (array + 1j).tolist(),
    "masked": masked,
    "masked, none of it": np.ma.masked_array,
    "masked rows in a list": lambda array: list(masked(array)) if array.ndim > 1 else [np.ma.masked, *array[1:].tolist()],
    "dates": lambda array: array.astype("M8[s]"),
    "texts": lambda array: array.astype(str),
}


@pytest.mark.parametrize("what", TAKERS)
def test_complex_and_masked_input_is_refused_wherever_an_array_is_taken(what: str) -> None:
    take, good = TAKERS[what]
    take(good)
    take(good.tolist())
    accepted = []
    for name, spoil in WRONG.items():
        try:
            take(spoil(good))
        except (qr.InvalidValueError, qr.InvalidShapeError):
            continue
        accepted.append(name)
    assert not accepted, f"{what} takes {', '.join(accepted)}"


def test_a_list_that_holds_itself_is_refused() -> None:
    endless: list[Any] = []
    endless.append(endless)
    with pytest.raises(qr.InvalidShapeError):
        qr.Surface.from_points(endless)
    with pytest.raises(qr.QuasirigidError):
        qr.plan_grasp(endless, endless, endless)


def test_a_recorder_takes_no_masked_or_complex_values(tmp_path: Path) -> None:
    columns = [qr.Column("time"), qr.Column("place", (3,)), qr.Column("end", (3,), still=True)]
    with qr.Recorder(tmp_path / "r.h5", columns) as recorder:
        for spoil in (masked, lambda array: array + 1j):
            with pytest.raises((qr.InvalidValueError, qr.InvalidShapeError), match="place"):
                recorder.append({"time": 0.0, "place": spoil(ZEROS)})
            with pytest.raises((qr.InvalidValueError, qr.InvalidShapeError), match="end"):
                recorder.still({"end": spoil(ZEROS)})
        recorder.append({"time": 0.0, "place": ZEROS})
