"""What there is to draw of the bodies and hands of a world: a view of every collider, and the palm and the links of a hand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from quasirigid._quasirigid import Body, Collider, Hand, Material
from quasirigid.errors import InvalidValueError
from quasirigid.rotation import conjugate, rotate
from quasirigid.scene.meshes import Mesh, joined, mirrored, tapered_capsule, triangulate
from quasirigid.scene.model import BodyView, Colour, ControlPoints, Kind
from quasirigid.scene.palette import BONE, FINGER_COLOURS, GLASS, LINK_RADII, PAD, PALM

OBJECT_COLOURS: tuple[Colour, ...] = (GLASS, (0.62, 0.50, 0.36), (0.42, 0.55, 0.40))
SUPPORT: Colour = (0.90, 0.91, 0.93)
KNUCKLE = 0.42
"""Radius of the axle at a joint, as a share of the link's."""


def colour_of(text: str) -> Colour:
    """The colour of ``"#0072B2"``."""
    red, green, blue = (int(text[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return red, green, blue


class Carrier(NamedTuple):
    """What gives a view its pose."""

    owner: Body | Hand
    finger: int | None = None
    """Of a hand; ``None`` for its palm."""
    link: int = 0
    """Of the finger."""


class Placed(NamedTuple):
    """A view, where it is, and the collider whose surface it is; none for what cannot touch."""

    view: BodyView
    carrier: Carrier
    collider: Collider | None = None


def body_views(body: Body, name: str, kind: Kind, colour: Colour, finger: int | None = None) -> list[Placed]:
    """A rigid body with its first collider, and a view of each further one; ``finger`` is that of a body that is a fingertip."""
    colliders = body.colliders
    x, y, z = rotate(conjugate(body.quaternion), body.centre_of_mass - body.position).tolist()
    weight: dict[str, Any] = {"mass": body.mass, "centre_of_mass": (x, y, z)}
    first = colliders[0] if colliders else None
    nothing = {"points": np.zeros((0, 3)), "normals": np.zeros((0, 3)), "faces": np.zeros((0, 3), dtype=np.int64)}
    skin = nothing if first is None else _skin(first)
    views = [Placed(BodyView(name, kind, colour=colour, finger=finger, **skin, **weight), Carrier(body), first)]
    # Of a finger only the first is the fingertip.
    further: Kind = "link" if kind == "fingertip" else kind
    for number, collider in enumerate(colliders[1:], start=1):
        view = BodyView(f"{name}/collider {number}", further, colour=colour, finger=finger, frame=name, **_skin(collider))
        views.append(Placed(view, Carrier(body), collider))
    return views


def finger_views(hand: Hand, finger: int, name: str, number: int) -> list[Placed]:
    """The fingertip of a finger of a hand, which is its pad, and a view of each further collider on one of its links.

    Raises ``InvalidValueError`` if the finger has no collider.
    """
    colliders, last = hand.colliders(finger), hand.link_poses.shape[1] - 1
    if not colliders:
        hint = "add one with World.add_collider, or leave the hand out"
        raise InvalidValueError("hand", "a collider on every finger", f"finger {name!r} without one", hint)
    pad = next((collider for collider in colliders if collider.link == last), colliders[0])
    views = []
    for i, collider in enumerate(colliders):
        link = collider.link
        kind: Kind = "fingertip" if collider == pad else "link"
        what = "tip" if collider == pad else f"collider {i}"
        view = BodyView(f"{name}/{what}", kind, colour=PAD, finger=number, frame=f"{name} {link}", link=link, **_skin(collider))
        views.append(Placed(view, Carrier(hand, finger, link), collider))
    views.sort(key=lambda placed: placed.view.kind != "fingertip")
    return views


def hand_views(hand: Hand, prefix: str, first: int) -> list[Placed]:
    """Palm, links, joints and nails of a hand; ``first`` is the number of its first finger in the scene."""
    views = [Placed(BodyView(f"{prefix}palm", "link", *_palm(hand), PALM), Carrier(hand))]
    for finger, name in enumerate(hand.finger_names):
        number = first + finger
        for link, mesh, colour, part in _link_meshes(hand, finger, colour_of(FINGER_COLOURS[number % 6])):
            frame = f"{prefix}{name} {link}"
            view = BodyView(f"{prefix}{name}/{part} {link}", "link", *mesh, colour, finger=number, frame=frame, link=link)
            views.append(Placed(view, Carrier(hand, finger, link)))
    return views


def part_of(placed: Placed, body: int) -> Placed:
    """The view of a further collider of the body with this number in the scene."""
    return placed._replace(view=replace(placed.view, part_of=body))


def unique_name(name: str, names: dict[str, int]) -> str:
    """A name that no earlier one has; ``names`` counts those that were asked for."""
    names[name] = names.get(name, 0) + 1
    return name if names[name] == 1 else f"{name} {names[name]}"


def _skin(collider: Collider) -> dict[str, Any]:
    """The fields of ``BodyView`` that come from a collider."""
    surface = collider.surface
    points, normals = surface.points, surface.normals
    control = ControlPoints(surface.control_points, surface.control_normals, surface.control_areas)
    faces = triangulate(points, normals)
    return {"points": points, "normals": normals, "faces": faces, "control": control, "material": _figures_of(collider.material)}


def _figures_of(material: Material) -> dict[str, Any]:
    """A material as plain values, for ``BodyView.material``."""
    names = ("name", "density", "friction", "young_modulus", "poisson_ratio", "layer_thickness", "relaxation_time", "compliance")
    law = material.friction_law
    direction = None if law.direction is None else law.direction.tolist()
    friction = {name: getattr(law, name) for name in ("static", "kinetic", "stribeck_velocity", "viscous", "ratio")}
    return {**{name: getattr(material, name) for name in names}, "friction_law": {**friction, "direction": direction}}


def _palm(hand: Hand) -> Mesh:
    """The palm, hand frame: a stem, and an arm to every knuckle, a little thinner than the link there, so that the two do not flicker."""
    links, turn, origin = hand.link_poses, conjugate(hand.quaternion), hand.position
    zero = np.zeros(3)
    arms = [tapered_capsule(zero, rotate(turn, knuckle - origin), 0.0115, 0.9 * LINK_RADII[0]) for knuckle in links[:, 0, :3]]
    return joined([*arms, tapered_capsule(zero, np.array([0.0, 0.0, 0.018]), 0.0122, 0.0095)])


def _link_meshes(hand: Hand, finger: int, own: Colour) -> list[tuple[int, Mesh, Colour, str]]:
    """The links of a finger that have a length, each in its own frame: number, mesh, colour, what it is."""
    links = hand.link_poses[finger]
    tip_positions, tip_quaternions = hand.tip_poses()
    surface = hand.surface(finger)
    assert surface is not None
    last = conjugate(links[-1, 3:])
    outwards = rotate(last, rotate(tip_quaternions[finger], np.array([0.0, 0.0, 1.0])))
    apex = rotate(last, tip_positions[finger] - links[-1, :3])
    depth = float(np.ptp(surface.points @ outwards))
    parts: list[tuple[int, Mesh, Colour, str]] = []
    sizes = iter(range(len(LINK_RADII)))
    for link in range(len(links)):
        here = conjugate(links[link, 3:])
        end = rotate(here, links[link + 1, :3] - links[link, :3]) if link + 1 < len(links) else apex - depth * outwards
        if np.linalg.norm(end) < 1e-6:
            continue
        i = min(next(sizes, len(LINK_RADII) - 1), len(LINK_RADII) - 2)
        start_radius, end_radius = LINK_RADII[i], LINK_RADII[i + 1]
        parts.append((link, tapered_capsule(np.zeros(3), end, start_radius, end_radius), BONE, "link"))
        axle = np.array([0.0, 1.04 * start_radius, 0.0])
        parts.append((link, tapered_capsule(-axle, axle, KNUCKLE * start_radius, KNUCKLE * start_radius, around=12, caps=2), own, "joint"))
    points, normals = surface.points, surface.normals
    parts.append((len(links) - 1, mirrored(points, normals, triangulate(points, normals), outwards), PAD, "nail"))
    return parts
