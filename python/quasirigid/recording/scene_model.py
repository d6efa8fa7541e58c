"""The model of a recorded scene in its file: arrays by name, and the rest as JSON in the attribute ``scene``."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, get_args

import numpy as np
import numpy.typing as npt

from quasirigid.arrays.types import FloatArray, IntArray
from quasirigid.errors import RecordingError
from quasirigid.recording.file import damaged
from quasirigid.recording.reader import Column, Recording
from quasirigid.recording.schema import ANY, check_columns
from quasirigid.scene.model import BodyView, ControlPoints, Kind, SceneModel

WITH_COLLIDERS = 4
"""The version of the format since which every collider of a body is recorded, not the first alone."""
WITH_CONTROL_POINTS = 3
"""The version of the format since which control points, materials and masses are recorded, and units of constants."""


def model_columns(control_points: Sequence[int], version: int) -> list[Column]:
    """The constants of a model, in a recording of this version of the format; ``control_points`` is how many each body has."""
    columns = []
    for i, m in enumerate(control_points):
        columns += [
            Column(f"model/{i}/points", (ANY, 3), "f8", "m", "body", "of the surface at rest", constant=True),
            Column(f"model/{i}/normals", (ANY, 3), "f4", "1", "body", "outward", constant=True),
            Column(f"model/{i}/faces", (ANY, 3), "u4", "1", "body", "triangles of points, counter-clockwise from outside", constant=True),
        ]
        if m:
            what = "of the surface that each control point stands for"
            columns += [
                Column(f"model/{i}/control_points", (m, 3), "f4", "m", "body", "where contacts act, at rest", constant=True),
                Column(f"model/{i}/control_normals", (m, 3), "f4", "1", "body", "outward", constant=True),
                Column(f"model/{i}/control_areas", (m,), "f4", "m^2", "body", what, constant=True),
            ]
    # Before, nothing was said of the unit and the frame of a constant.
    return columns if version >= WITH_CONTROL_POINTS else [replace(column, unit="1", frame="-") for column in columns]


def model_constants(model: SceneModel) -> tuple[dict[str, npt.NDArray[Any]], str]:
    """What is written of a model: its arrays by name, and the rest as JSON."""
    arrays: dict[str, npt.NDArray[Any]] = {}
    bodies, materials = [], []
    for i, body in enumerate(model.bodies):
        arrays |= {
            f"model/{i}/points": body.points,
            f"model/{i}/normals": body.normals.astype("f4"),
            f"model/{i}/faces": body.faces.astype("u4"),
        }
        if len(body.control.points):
            arrays |= {
                f"model/{i}/control_points": body.control.points.astype("f4"),
                f"model/{i}/control_normals": body.control.normals.astype("f4"),
                f"model/{i}/control_areas": body.control.areas.astype("f4"),
            }
        if body.material is not None and body.material not in materials:
            materials.append(body.material)
        bodies.append(
            {
                "name": body.name,
                "kind": body.kind,
                "colour": list(body.colour),
                "finger": body.finger,
                "frame": body.frame,
                "material": None if body.material is None else materials.index(body.material),
                "control_points": len(body.control.points),
                "mass_kg": body.mass,
                "centre_of_mass_m": None if body.centre_of_mass is None else list(body.centre_of_mass),
                "part_of": body.part_of,
                "link": body.link,
            }
        )
    described = {"bodies": bodies, "materials": materials, "fingers": list(model.fingers), "dt": model.dt, "floor": model.floor}
    return arrays, json.dumps(described)


class _Fields:
    """What a JSON object holds, each value checked when it is read."""

    def __init__(self, recording: Recording, values: Any, where: str) -> None:
        self._recording, self._where = recording, where
        if not isinstance(values, dict):
            raise damaged(recording.path, where, "fields with names", values)
        self._values = values

    def get(self, name: str, right: Callable[[Any], bool], expected: str) -> Any:
        """A value that is ``right``. Raises ``RecordingError`` for another."""
        value = self._values.get(name)
        if not right(value):
            raise damaged(self._recording.path, f"{self._where}, {name}", expected, "nothing" if value is None else value)
        return value


def _finite(value: Any) -> bool:
    return type(value) in (int, float) and math.isfinite(value)


def _three(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 3 and all(map(_finite, value))


def _below(count: int, value: Any) -> bool:
    return value is None or (type(value) is int and 0 <= value < count)


def _text(value: Any) -> bool:
    return isinstance(value, str)


def described_scene(recording: Recording) -> dict[str, Any]:
    """The attribute ``scene``: ``bodies`` (the fields of ``BodyView`` that are no arrays), ``fingers``, ``dt`` and ``floor``.

    Raises ``RecordingError`` if there is none, or if it is not as ``model_constants`` writes it.
    """
    text = recording.attributes.get("scene")
    if text is None:
        got = f"a recording of version {recording.version}, without the shapes of its bodies"
        hint = "record the run again; its columns are still readable with quasirigid.Recording"
        raise RecordingError(str(recording.path), "a recording that holds a scene", got, hint)
    try:
        values = json.loads(text)
    except (TypeError, ValueError, RecursionError) as error:
        raise damaged(recording.path, "attribute scene", "JSON", error) from error
    scene = _Fields(recording, values, "attribute scene")
    fingers = scene.get("fingers", lambda v: isinstance(v, list) and all(map(_text, v)), "the names of the fingers")
    materials: list[dict[str, Any]] = []
    if recording.version >= WITH_CONTROL_POINTS:
        materials = scene.get("materials", lambda v: isinstance(v, list) and all(isinstance(m, dict) for m in v), "a list of materials")
    bodies = []
    listed = scene.get("bodies", lambda v: isinstance(v, list), "a list of bodies")
    for i, body in enumerate(listed):
        fields = _Fields(recording, body, f"attribute scene, body {i}")
        bodies.append(
            {
                "name": fields.get("name", _text, "a name"),
                "kind": fields.get("kind", lambda v: v in get_args(Kind), f"one of {', '.join(get_args(Kind))}"),
                "colour": tuple(fields.get("colour", lambda v: _three(v) and min(v) >= 0.0 and max(v) <= 1.0, "three numbers from 0 to 1")),
                "finger": fields.get("finger", partial(_below, len(fingers)), f"a number below {len(fingers)}, or none"),
                "frame": fields.get("frame", _text, "a name, or an empty one"),
            }
        )
        if recording.version >= WITH_CONTROL_POINTS:
            material = fields.get("material", partial(_below, len(materials)), f"a number below {len(materials)}, or none")
            centre = fields.get("centre_of_mass_m", lambda v: v is None or _three(v), "three numbers, or none")
            bodies[-1] |= {
                "control_points": fields.get("control_points", lambda v: type(v) is int and v >= 0, "how many there are"),
                "material": None if material is None else materials[material],
                "mass": fields.get("mass_kg", lambda v: v is None or (_finite(v) and v >= 0.0), "0 kg or more, or none"),
                "centre_of_mass": None if centre is None else tuple(centre),
            }
        if recording.version >= WITH_COLLIDERS:
            bodies[-1] |= {
                "part_of": fields.get("part_of", partial(_below, len(listed)), f"a number below {len(listed)}, or none"),
                "link": fields.get("link", lambda v: type(v) is int and v >= 0, "a number from 0"),
            }
    return {
        "bodies": bodies,
        "fingers": tuple(fingers),
        "dt": float(scene.get("dt", lambda v: _finite(v) and v > 0.0, "a time step above 0 s")),
        "floor": float(scene.get("floor", _finite, "a height in m")),
    }


def read_model(recording: Recording, *, shapes: bool = True) -> SceneModel:
    """The model of a recording; without ``shapes``, what is said of its bodies alone.

    Raises ``RecordingError`` if there is none, or if it is not as ``model_constants`` writes it.
    """
    scene = described_scene(recording)
    counts = [body.pop("control_points", 0) for body in scene["bodies"]]
    check_columns(recording, model_columns(counts, recording.version))
    bodies = []
    for i, body in enumerate(scene["bodies"]):
        none, control = np.zeros((0, 3)), ControlPoints()
        points, normals, faces = none, none, none.astype(np.int64)
        if shapes:
            points, normals, faces = _shape(recording, i)
            if counts[i]:
                control = ControlPoints(*(recording[f"model/{i}/control_{name}"].astype(float) for name in ("points", "normals", "areas")))
        bodies.append(BodyView(points=points, normals=normals, faces=faces, control=control, **body))
    return SceneModel(bodies=tuple(bodies), fingers=scene["fingers"], dt=scene["dt"], floor=scene["floor"])


def _shape(recording: Recording, body: int) -> tuple[FloatArray, FloatArray, IntArray]:
    """Points, normals and faces of a body."""
    points, normals, faces = (recording[f"model/{body}/{name}"] for name in ("points", "normals", "faces"))
    _check_rows(recording, f"model/{body}/normals", normals, len(points))
    for name, values in (("points", points), ("normals", normals)):
        if not np.isfinite(values).all():
            raise damaged(recording.path, f"column model/{body}/{name}", "finite numbers", "some that are not")
    if faces.size and faces.max() >= len(points):
        raise damaged(recording.path, f"column model/{body}/faces", f"points below {len(points)}", int(faces.max()))
    return points, normals.astype(float), faces.astype(np.int64)


def _check_rows(recording: Recording, name: str, values: npt.NDArray[Any], count: int) -> None:
    if len(values) != count:
        raise damaged(recording.path, f"column {name}", f"{count} rows, as the points that it belongs to", len(values))


__all__ = ["described_scene", "model_columns", "model_constants", "read_model"]
