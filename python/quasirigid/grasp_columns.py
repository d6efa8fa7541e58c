"""What a grasp records in every step."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from quasirigid._quasirigid import Body, Hand
from quasirigid.recording import Column, Recording
from quasirigid.summary import PHASES, FloatArray
from quasirigid.view.scene import ContactsState

IntArray = npt.NDArray[np.integer]


def columns(fingers: tuple[str, ...], joints: int) -> list[Column]:
    """The columns of a grasp's recording beyond those of any scene (``scene_recording.scene_columns``)."""
    F = len(fingers)
    return [
        Column("object/pose", (7,), unit="m, 1", frame="world", what="x y z of the body frame, quaternion w x y z"),
        Column("object/velocity", (6,), unit="m/s, rad/s", frame="world", what="of the centre of mass; angular"),
        Column("hand/pose", (7,), unit="m, 1", frame="world", what="x y z of the palm, quaternion w x y z"),
        Column("hand/joint_targets", (F, joints), unit="rad", frame="joint", labels=fingers),
        Column("hand/joint_torques", (F, joints), unit="N m", frame="joint", what="of the motors", labels=fingers),
        Column("hand/force_on_object", (F, 3), unit="N", frame="world", what="sum over the contacts of a finger", labels=fingers),
        Column("hand/normal_force", (F,), unit="N", frame="contact", what="sum of the normal reactions of a finger", labels=fingers),
        Column("hand/tangential_force", (F,), unit="N", what="length of the summed friction of a finger", labels=fingers),
        Column("hand/contacts", (F,), "i4", what="loaded contacts of a finger with the object", labels=fingers),
        Column("hand/overlap", unit="m", what="deepest overlap left at a finger's contact with the object"),
        Column("phase", (), "u1", labels=PHASES),
    ]


SCENE_POINTS = 20_000
"""Most points of the object that the picture of the scene is given."""


def still_columns(fingers: tuple[str, ...], joints: int, object_points: int, tip_points: int) -> list[Column]:
    """The stills of a grasp's recording: what stands where at the end of the first hold, enough to draw it again."""
    F, n, m = len(fingers), min(object_points, SCENE_POINTS), tip_points
    deformed = "of the surface as deformed"
    return [
        Column("scene/object/points", (n, 3), "f4", "m", "world", f"{deformed}, an even choice of them", still=True),
        Column("scene/object/normals", (n, 3), "f4", "1", "world", "outward", still=True),
        Column("scene/object/centre_of_mass", (3,), unit="m", frame="world", still=True),
        Column("scene/tips/points", (F, m, 3), "f4", "m", "world", deformed, still=True, labels=fingers),
        Column("scene/tips/normals", (F, m, 3), "f4", "1", "world", "outward", still=True, labels=fingers),
        Column("scene/tips/pose", (F, 7), unit="m, 1", frame="world", what="middle of the pad, +z outwards", still=True, labels=fingers),
        Column("scene/tips/semi_axes", (3,), unit="m", frame="pad", what="of the pad's ellipsoid", still=True),
        Column("scene/hand/pose", (7,), unit="m, 1", frame="world", what="x y z of the palm, quaternion w x y z", still=True),
        Column("scene/hand/link_poses", (F, joints, 7), unit="m, 1", frame="world", what="link frames", still=True, labels=fingers),
        Column("scene/step", (), "i8", what="step of the recording that was drawn, from 0", still=True),
    ]


def still_rows(thing: Body, hand: Hand, semi_axes: FloatArray, step: int) -> dict[str, Any]:
    """The stills of ``still_columns`` as the world is now, after the recorded ``step``."""
    points, normals = thing.deformed_points(), thing.deformed_normals()
    chosen = np.linspace(0, len(points) - 1, min(len(points), SCENE_POINTS)).round().astype(int)
    fingers = range(hand.finger_count)
    return {
        "scene/object/points": points[chosen],
        "scene/object/normals": normals[chosen],
        "scene/object/centre_of_mass": thing.centre_of_mass,
        "scene/tips/points": np.stack([hand.deformed_points(f) for f in fingers]),
        "scene/tips/normals": np.stack([hand.deformed_normals(f) for f in fingers]),
        "scene/tips/pose": np.concatenate(hand.tip_poses(), axis=1),
        "scene/tips/semi_axes": semi_axes,
        "scene/hand/pose": np.concatenate([hand.position, hand.quaternion]),
        "scene/hand/link_poses": hand.link_poses,
        "scene/step": step,
    }


def contacts_on_object(recording: Recording, step: int) -> dict[str, Any]:
    """The contacts of a step as the object feels them: ``force`` on it, ``normal`` into it, and ``finger``: the one that touches it, or -1."""
    bodies = json.loads(recording.attributes["scene"])["bodies"]
    thing = next(i for i, body in enumerate(bodies) if body["kind"] == "object")
    tips = {i: body["finger"] for i, body in enumerate(bodies) if body["kind"] == "fingertip"}
    rows = recording.rows("contacts", step)
    finger, sign = _seen_from(rows["body_a"], rows["body_b"], thing, tips)
    return {**rows, "finger": finger, "force": sign[:, None] * rows["force"], "normal": sign[:, None] * rows["normal"]}


def _seen_from(a: IntArray, b: IntArray, thing: int, finger_of: Mapping[int, int]) -> tuple[IntArray, FloatArray]:
    """Which finger touches the ``thing`` in each contact of bodies ``a`` and ``b`` (-1: none), and the sign that turns
    what acts on body a into what acts on the thing.
    """
    finger = np.full(len(a), -1, dtype=np.int8)
    for body, f in finger_of.items():
        finger[((a == body) & (b == thing)) | ((a == thing) & (b == body))] = f
    return finger, np.where(a == thing, 1.0, -1.0)


def contact_sums(contacts: ContactsState, thing: int, finger_of: Mapping[int, int], fingers: int) -> dict[str, Any]:
    """What the fingers do to the object in one step: the sums over their contacts with it.

    ``thing`` is the object's place in the scene, ``finger_of`` gives the finger of a fingertip's place, ``fingers`` their number.
    """
    finger, sign = _seen_from(contacts.body_a, contacts.body_b, thing, finger_of)
    touching = finger >= 0
    sign = sign[touching, None]
    force, normal = sign * contacts.forces[touching], sign * contacts.normals[touching]
    mine, press = finger[touching], contacts.reactions[touching, 0]
    totals, pressing = np.zeros((fingers, 3)), np.zeros((fingers, 3))
    np.add.at(totals, mine, force)
    np.add.at(pressing, mine, press[:, None] * normal)
    return {
        "hand/force_on_object": totals,
        "hand/normal_force": np.bincount(mine, press, fingers),
        "hand/tangential_force": np.linalg.norm(totals - pressing, axis=1),
        "hand/contacts": np.bincount(mine[press > 0.0], minlength=fingers),
        "hand/overlap": max(0.0, -float(contacts.gaps[touching].min(initial=0.0))),
    }
