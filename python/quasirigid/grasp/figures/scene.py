"""The picture of a grasp: hand, object and forces at the end of the first hold, and one contact patch close by.

Drawn from nothing but a recording, so that it can be made again: ``save_scene(Recording("recording.h5"), Path("."))``.
The object is drawn as if of glass, so that the soft pads and the pressure on them show through it.
"""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.ticker import MaxNLocator

from quasirigid.arrays.types import AnyArray
from quasirigid.grasp.figures.plots import friction_of, patch_plane
from quasirigid.grasp.figures.scene_data import Shot, pressure_on, read_shot
from quasirigid.recording.reader import Recording
from quasirigid.render.camera import Camera
from quasirigid.render.ground import CELL, GRID, compose, floor_lines, soft_shadow, tinted, view_of
from quasirigid.render.layer import halved, shade
from quasirigid.render.posed import Part, joined
from quasirigid.rotation import rotate
from quasirigid.scene.meshes import Mesh, tapered_capsule, triangulate
from quasirigid.scene.palette import BONE, FINGER_COLOURS, GLASS, INK, LINK_RADII, MUTED, NAIL, PALM, SLIP_COLOUR
from quasirigid.scene.pressure import SLIP, pad_colours
from quasirigid.scene.sharp_edges import divided, sharpened
from quasirigid.units import force_words, in_small_units, mass_words, plain, pressure_unit, short_name

WIDTH, HEIGHT, DPI = 1200, 800, 150
FINE = 2
"""Drawn this many times larger, then reduced: smooth edges."""
SCENE = (0, 0, 745, 745)
"""Place of the scene in the picture: left, bottom, width, height, px."""
CLOSE = (812, 312, 360, 360)
"""Place of the close-up."""
ROUND = 48
"""Sides of a link: round, however large the picture is looked at."""
INSIDE, OVERLAP = 0.995, 0.2
"""A nail is so much smaller than the ellipsoid of its fingertip, and reaches under the pad up to this share of its height."""
LETTER, CAPTION = 11.6, 68
"""Width of a letter and height of the three lines beside a finger, px."""
HALO: list[patheffects.AbstractPathEffect] = [patheffects.withStroke(linewidth=3.0, foreground="white")]


def _part(mesh: Mesh, colour: AnyArray | tuple[float, ...]) -> Part:
    """A mesh in world axes in one colour (3,), or in that of every point (n, 4)."""
    points, normals, faces = mesh
    colour = np.asarray(colour, float)
    return Part(points, normals, np.tile([*colour, 0.0], (len(points), 1)) if colour.ndim == 1 else colour, faces)


def _tip(shot: Shot, finger: int) -> list[Part]:
    """A fingertip: its pad as deformed, coloured by pressure, on a nail that does not deform: the other half of the ellipsoid."""
    points, normals = (shot.scene[f"tips/{name}"][finger].astype(float) for name in ("points", "normals"))
    axes, pose = shot.scene["tips/semi_axes"], shot.scene["tips/pose"][finger]
    unit, _, around = tapered_capsule(np.zeros(3), np.zeros(3), 1.0, 1.0, around=ROUND, caps=ROUND // 2)
    back = pose[:3] + rotate(pose[3:], INSIDE * unit * axes - np.array([0.0, 0.0, axes[2]]))
    outward = rotate(pose[3:], unit / axes)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    nail = back, outward, around[unit[around, 2].max(axis=1) < OVERLAP]
    # Pressure has its colour at the vertices: so many that the rim of a patch is no row of triangles.
    pad = divided(*divided(points, normals, triangulate(points, normals)))
    return [_part(pad, pad_colours(pressure_on(pad[0], shot, finger), shot.peak)), _part(nail, NAIL)]


def _links(shot: Shot) -> list[Part]:
    """Palm, links and joints; the joints in the colour of their finger."""
    parts: list[Part] = []
    palm, links = shot.scene["hand/pose"], shot.scene["hand/link_poses"]
    z = np.array([0.0, 0.0, 1.0])

    def add(a: AnyArray, b: AnyArray, start: float, end: float, colour: tuple[float, ...]) -> None:
        parts.append(_part(tapered_capsule(a, b, start, end, around=ROUND, caps=ROUND // 4), colour))

    for f in range(len(shot.fingers)):
        tip = shot.scene["tips/pose"][f]
        chain = [*links[f, 1:, :3], tip[:3] - shot.scene["tips/semi_axes"][2] * rotate(tip[3:], z)]
        add(palm[:3], chain[0], 0.0115, 0.9 * LINK_RADII[0], PALM)
        own = to_rgb(FINGER_COLOURS[f % 6])
        for i, (a, b) in enumerate(itertools.pairwise(chain)):
            radius = LINK_RADII[min(i, 3)], LINK_RADII[min(i + 1, 3)]
            add(a, b, *radius, BONE)
            axle = 1.04 * radius[0] * rotate(links[f, min(i + 1, links.shape[1] - 1), 3:], np.array([0.0, 1.0, 0.0]))
            add(a - axle, a + axle, 0.42 * radius[0], 0.42 * radius[0], own)
    add(palm[:3], palm[:3] + 0.018 * rotate(palm[3:], z), 0.0122, 0.0095, PALM)
    return parts


def _covered(parts: list[Part], middle: AnyArray, reach: float) -> AnyArray:
    """Which cells of the floor are straight under some of the ``parts``, as ``soft_shadow`` has them."""
    cells = int(2 * reach / CELL)
    above = Camera(np.eye(3), np.array([*middle[:2], 0.0]), 1.0 / CELL, (cells, cells))
    # Rows of a picture run down, against the world's y.
    covered: AnyArray = joined(parts).drawn_by(above).drawn[::-1].T.astype(float)
    return covered


def _ground(camera: Camera, z: float, shadows: list[tuple[list[Part], float]], middle: AnyArray, reach: float) -> AnyArray:
    """The floor (height, width, 3): a grid that fades out at ``reach`` m from the ``middle``, and soft shadows from straight above
    of ``shadows``: parts and how dark they make it.
    """
    x, y, _ = camera.plane(z)
    dark = np.zeros(x.shape)
    for parts, strength in shadows:
        shadow = soft_shadow(_covered(parts, middle, reach), x - middle[0], y - middle[1], reach)
        dark = np.maximum(dark, strength * shadow)
    return tinted((1.0 - 0.13 * floor_lines(x, y, middle, reach)) * (1.0 - dark))


def _caption(shot: Shot, finger: int) -> str:
    """What stands beside a finger: the figures of ``forces.png`` and ``patches.png`` at that instant."""
    name = short_name(shot.fingers[finger].replace("_", " "), 16)
    return f"{name}\npresses {force_words(shot.normal[finger])}\nfriction {force_words(shot.friction[finger])}"


def _longest_line(text: str) -> int:
    return max(len(line) for line in text.split("\n"))


def _camera(shot: Shot, floor: float) -> Camera:
    """The camera that has hand and object in the picture, with room for words."""
    points = shot.scene["object/points"].astype(float)
    palm = shot.scene["hand/pose"]
    back = view_of(palm, points.mean(axis=0))
    size = (FINE * SCENE[2], FINE * SCENE[3])
    camera = Camera.towards(back, np.array([0.0, 0.0, 1.0]), points.mean(axis=0), 1.0, size)
    up = rotate(palm[3:], np.array([0.0, 0.0, 1.0]))
    ground = np.column_stack([points[:, :2], np.full(len(points), floor)])
    whole = camera.project(np.concatenate([points, ground, shot.scene["hand/link_poses"][..., :3].reshape(-1, 3), [palm[:3] + 0.02 * up]]))
    low, high = whole[:, :2].min(axis=0) - 0.012, whole[:, :2].max(axis=0) + 0.012
    # Room in px for the names of the fingers beside them, below for the scale bar.
    knuckles = camera.project(shot.scene["hand/link_poses"][:, 2, :3])[:, 0]
    right = knuckles > knuckles.mean()
    left_room, right_room = (
        max((LETTER * _longest_line(_caption(shot, f)) for f, there in enumerate(right) if there == side), default=10.0) for side in (0, 1)
    )
    scale = FINE * float(min((SCENE[2] - left_room - right_room) / (high - low)[0], (SCENE[3] - 60.0) / (high - low)[1]))
    middle = 0.5 * (low + high) + 0.5 * np.array([right_room - left_room, -40.0]) * FINE / scale
    centre = camera.centre + camera.axes[:, :2] @ middle
    return Camera(camera.axes, centre, scale, size)


def _place(figure: Figure, box: tuple[int, int, int, int]) -> Axes:
    left, bottom, width, height = box
    return figure.add_axes((left / WIDTH, bottom / HEIGHT, width / WIDTH, height / HEIGHT))


def _arrow(axes: Axes, start: AnyArray, end: AnyArray, colour: str) -> None:
    """A flat arrow, px; the head of a short one is smaller."""
    along = np.asarray(end, float) - start
    length = float(np.linalg.norm(along))
    if length < 3.0:
        return
    along /= length
    across = np.array([-along[1], along[0]])
    head = min(19.0, 0.62 * length)
    wide, thin = 0.5 * head, 0.15 * head
    outline_of = [(0.0, thin), (length - head, thin), (length - head, wide), (length, 0.0)]
    outline_of += [(s, -w) for s, w in reversed(outline_of[:-1])]
    shape = Polygon(
        [start + s * along + w * across for s, w in outline_of], closed=True, facecolor=colour, edgecolor="white", linewidth=1.1
    )
    axes.add_patch(shape)


def _draw_scene(axes: Axes, shot: Shot) -> None:
    """Hand, object, floor, forces, names, scale bar."""
    points, normals = (shot.scene[f"object/{name}"].astype(float) for name in ("points", "normals"))
    tall = np.ptp(points[:, 2])
    floor = points[:, 2].min() - max(0.012, 0.16 * tall)
    camera = _camera(shot, floor)
    links = _links(shot)
    tips = [part for f in range(len(shot.fingers)) for part in _tip(shot, f)]
    solid = joined(links + tips).drawn_by(camera)
    glass = _part(sharpened(points, normals, triangulate(points, normals)), GLASS)
    walls = [glass.drawn_by(camera, back=True), glass.drawn_by(camera)]
    middle = np.array([*points[:, :2].mean(axis=0), 0.0])
    background = _ground(camera, floor, [([glass], 0.20), (links + tips, 0.11)], middle, 0.125)
    image = halved(compose(background, solid, walls, camera.scale), FINE)
    axes.imshow(image, extent=(0, SCENE[2], 0, SCENE[3]), interpolation="none", aspect="auto")
    axes.set(xlim=(0, SCENE[2]), ylim=(0, SCENE[3]))
    axes.set_axis_off()

    def at(point: AnyArray) -> AnyArray:
        place: AnyArray = camera.project(point)[..., :2] * camera.scale / FINE + np.array(SCENE[2:]) / 2
        return place

    weight = float(shot.attributes["object_mass_kg"]) * float(shot.attributes["gravity_m_per_s2"])
    centres = [shot.centre(f) for f in range(len(shot.fingers))]
    reached = np.array([c for c in centres if c is not None])
    size = max(float(np.ptp(reached, axis=0).max()) if len(reached) else 0.0, 0.02)
    longest = max(float(np.linalg.norm(shot.forces, axis=1).max()), weight, 1e-9)
    metres = 0.5 * size / longest
    names: list[tuple[AnyArray, str, str]] = []
    for f, centre in enumerate(centres):
        colour = FINGER_COLOURS[f % 6]
        knuckle = at(shot.scene["hand/link_poses"][f, 2, :3])
        names.append((knuckle, _caption(shot, f), colour))
        if centre is not None:
            _arrow(axes, at(centre), at(centre + metres * shot.forces[f]), colour)
    mass = shot.scene["object/centre_of_mass"]
    end = mass - [0.0, 0.0, metres * weight]
    _arrow(axes, at(mass), at(end), INK)
    axes.plot(*at(mass), "o", color=INK, markersize=3.8, markeredgecolor="white", markeredgewidth=1.0)
    below = at(end)
    if at(mass)[1] - below[1] < 30.0:  # too short to write beside it: under the object
        outlines = at(points)
        above = outlines[np.abs(outlines[:, 0] - below[0]) < 60.0, 1]
        foot = np.array([below[0], min(above.min(initial=below[1]) - 10.0, below[1])])
        axes.plot(*np.stack([below, foot]).T, color=INK, linewidth=0.8, linestyle=(0, (2, 2)))
        below = foot
    text = axes.text(below[0], below[1] - 5, f"weight {force_words(weight)}", fontsize=9, color=INK, ha="center", va="top")
    text.set_path_effects(HALO)
    _name(axes, names, at(np.concatenate([part.points for part in links])))
    _scale_bar(axes, camera.scale / FINE)


def _name(axes: Axes, names: list[tuple[AnyArray, str, str]], links: AnyArray) -> None:
    """The fingers' names beside them, outside the hand (``links`` (n, 2) px), no two over each other."""
    middle = float(np.mean([place[0] for place, _, _ in names]))
    for right in (False, True):
        last = np.inf
        for place, text, colour in sorted((n for n in names if (n[0][0] > middle) == right), key=lambda n: -n[0][1]):
            y = min(float(place[1]), last - CAPTION)
            last = y
            level = links[np.abs(links[:, 1] - y) < 0.5 * CAPTION, 0]
            x = max(level.max(initial=place[0]) + 10, place[0]) if right else min(level.min(initial=place[0]) - 10, place[0])
            style: dict[str, Any] = {"ha": "left" if right else "right", "va": "center", "linespacing": 1.15}
            words = axes.text(x, y, text, color=colour, fontsize=9, fontweight="bold", parse_math=False, **style)
            words.set_path_effects(HALO)
            box = words.get_window_extent()
            words.set_x(x - max(box.x1 - SCENE[2], 0.0) - min(box.x0, 0.0))  # what would end beyond the scene comes nearer


def _scale_bar(axes: Axes, scale: float) -> None:
    """20 mm, in the plane of the picture."""
    left, y, length = 22, 22, 0.02 * scale
    axes.plot([left, left + length], [y, y], color=INK, linewidth=2.2, solid_capstyle="butt")
    axes.text(left + length / 2, y + 7, "20 mm", ha="center", va="bottom", fontsize=8.5, color=INK).set_path_effects(HALO)
    words = f"floor grid {1e3 * GRID:.0f} mm; arrows: whole force of each finger, and the weight"
    axes.text(left + length + 12, y, words, va="center", fontsize=8.5, color=MUTED).set_path_effects(HALO)


def _draw_patch(figure: Figure, shot: Shot, finger: int) -> None:
    """The pad of a finger as the object feels it: deformed, pressure in colour, friction as arrows."""
    axes = _place(figure, CLOSE)
    mine = shot.patch(finger)
    points, normals, force = (shot.contacts[name][mine].astype(float) for name in ("point", "normal", "force"))
    push, along = friction_of(force, normals)
    centre, plane = patch_plane(points, normals, push)
    flat = 1e3 * (points - centre) @ plane
    radius = float(np.abs(flat).max()) + 2.8
    back = np.cross(plane[:, 0], plane[:, 1])
    size = (FINE * CLOSE[2], FINE * CLOSE[3])
    camera = Camera.towards(back, plane[:, 1], centre, size[0] / (2e-3 * radius), size)
    pad = joined(_tip(shot, finger)).drawn_by(camera)
    image = np.where(pad.drawn[..., None], shade(pad, camera.scale, gloss=0.0), 1.0)
    axes.imshow(halved(image, FINE), extent=(-radius, radius, -radius, radius), interpolation="none")
    friction, longest = along @ plane, max(float(np.linalg.norm(along, axis=1).max()), 1e-12)
    style: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "minlength": 0.1, "width": 0.0085, "linewidth": 0.6}
    style |= {"headwidth": 4.0, "headlength": 4.5, "headaxislength": 4.2}
    seen = np.linalg.norm(friction, axis=1) > 0.06 * longest
    arrows = 0.27 * radius / longest * friction[seen]
    axes.quiver(*flat[seen].T, *arrows.T, color="white", edgecolor=INK, zorder=3, **style)
    slips = shot.contacts["status"][mine] == SLIP
    axes.scatter(flat[slips, 0], flat[slips, 1], s=70, facecolors="none", edgecolors=SLIP_COLOUR, linewidths=1.4, zorder=4)
    axes.set(xlim=(-radius, radius), ylim=(-radius, radius))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(5, integer=True, steps=[1, 2, 4, 5, 10]))
    axes.tick_params(labelsize=8.5, colors=MUTED, length=3)
    axes.set_ylabel("up (mm)", fontsize=9, color=INK, labelpad=1)
    axes.set_xlabel("across (mm)", fontsize=9, color=INK, labelpad=2)
    axes.spines[:].set_color("#BBBBBB")
    name = shot.fingers[finger].replace("_", " ")
    axes.set_title(f"patch of the {name}", loc="left", fontsize=10.5, fontweight="bold", color=FINGER_COLOURS[finger % 6])
    say = f"{len(flat)} contacts, {int(slips.sum())} slip" if slips.any() else f"{len(flat)} contacts, all stick"
    note = f"{say}\narrows: friction on the object,\nlongest {in_small_units(longest, 'N', 2)}"
    figure.text(CLOSE[0] / WIDTH, 142 / HEIGHT, note, fontsize=8.5, color=MUTED, va="top", linespacing=1.5)

    bar_axes = _place(figure, (CLOSE[0], 218, CLOSE[2], 15))
    unit, unit_name = pressure_unit(shot.peak)
    bar = figure.colorbar(ScalarMappable(Normalize(0.0, shot.peak / unit), "viridis"), cax=bar_axes, orientation="horizontal")
    bar.set_label(f"pressure ({unit_name})", fontsize=9, color=INK, labelpad=2)
    bar.ax.tick_params(labelsize=8.5, colors=MUTED, length=3)
    bar.outline.set_visible(False)


def scene(shot: Shot) -> Figure:
    """The picture of a grasp, 1200 x 800 px."""
    figure = Figure(figsize=(WIDTH / DPI, HEIGHT / DPI), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    _draw_scene(_place(figure, SCENE), shot)
    a = shot.attributes
    mass, object_name = float(a["object_mass_kg"]), str(a["object"])
    title: dict[str, Any] = {"fontsize": 13, "fontweight": "bold", "color": INK, "va": "top", "parse_math": False}
    figure.text(22 / WIDTH, 1 - 20 / HEIGHT, f"{_title(object_name)}, held by friction alone", **title)
    words = f"{mass_words(mass)}, squeezed with {in_small_units(float(a['squeeze_n']), 'N')}, friction {plain(float(a['friction']), 2)}"
    if shot.drift is not None:
        words += f"; moves {in_small_units(shot.drift, 'm/s')} in the hand"
    words += f". End of the first hold, {shot.time:.3f} s"
    figure.text(22 / WIDTH, 1 - 54 / HEIGHT, words, fontsize=9.5, color=MUTED, va="top")
    pressing = [float(shot.contacts["reaction"][shot.patch(f), 0].sum()) for f in range(len(shot.fingers))]
    if max(pressing) > 0.0:
        _draw_patch(figure, shot, int(np.argmax(pressing)))
    return figure


def _title(object_name: str) -> str:
    name = Path(object_name).stem.replace("-", " ").replace("_", " ")
    return short_name(name[:1].upper() + name[1:])


def save_scene(recording: Recording, out: Path) -> list[Path]:
    """Write ``scene.png`` to the directory ``out`` and return its path; nothing if the run ended before the hold did."""
    shot = read_shot(recording)
    if shot is None:
        return []
    out.mkdir(parents=True, exist_ok=True)
    scene(shot).savefig(out / "scene.png", pil_kwargs={"optimize": True})
    return [out / "scene.png"]


__all__ = ["save_scene", "scene"]
