"""Where the built-in three-finger hand takes an object: opposing sides, near the centre of mass, at a width that fits.

Two stages. A coarse one looks at every hand orientation (from above, from the sides, turned about the approach axis): the object is seen along
the closing direction as two height maps, thumb side and finger side, and every cell of the map is scored as a grasp centre. A fine one places
the three pads of the best candidates on the surface and asks a linear program how much weight they can carry per newton of squeeze.

The hand frame: fingers hang from the palm along -z and close along x. The thumb is at -x and its pad faces +x; the two fingers are at +x, at
y = -spacing/2 and +spacing/2, and their pads face -x. The grasp centre is the middle between the pads.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import maximum_filter1d
from scipy.optimize import linprog
from scipy.spatial import cKDTree

from quasirigid.errors import GraspPlanError, InvalidShapeError, InvalidValueError

__all__ = ["GraspPlan", "HandGeometry", "plan_grasp"]

Array = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

COARSE_POINTS = 10_000  # enough for height maps of 2 mm cells on objects that fit the hand
FINE_CANDIDATES = 40  # how many go through the linear program
TURN_STEP = math.radians(7.5)  # between hand orientations about the approach axis, from above
SIDE_STEP = math.radians(15.0)  # between approach directions, from the sides
SIDE_WEIGHT = 0.75  # a grasp from above needs less room, so that one from the side must be this much better
CONE_SHARE = 0.6  # part of the friction cone that the surface may be tilted by at a pad
INDENTATION = 0.7e-3  # m, how deep a soft pad is thought to yield when its patch is worked out
COARSE_INDENTATION = 1.2e-3  # m, the same for the coarse cells
PATCH_RADIUS = 4e-3  # m, contact radius that goes into the torsional friction
FINGER_SLOPE = 0.3  # how much a finger leans outward on its way from pad to palm
FINGER_ROOM = 5e-3  # m, how much the object may bulge beyond a pad, beside the finger
CONE_SIDES = 8  # of the pyramid inside the friction cone in the linear program


@dataclass(frozen=True)
class HandGeometry:
    """Figures of the hand that decide what it can take. All in m.

    Attributes:
        finger_spacing: between the centres of the two finger pads, along y.
        pad_radius: of the ellipsoid cap that is the pad.
        footprint: radius of the region on the object that has to be fairly flat under a pad.
        finger_radius: of the finger behind the pad.
        min_width: least distance between thumb pad and finger pads.
        max_width: largest distance between thumb pad and finger pads.
        reach: how far the object may extend beyond the pads' centre towards the palm.
        tip_below: how far a fingertip extends beyond its pad's centre, away from the palm.
        palm_half_width: of the palm and the finger bases, along y.
    """

    finger_spacing: float = 0.025
    pad_radius: float = 0.008
    footprint: float = 0.005
    finger_radius: float = 0.009
    min_width: float = 0.008
    max_width: float = 0.080
    reach: float = 0.070
    tip_below: float = 0.010
    palm_half_width: float = 0.040

    def __post_init__(self) -> None:
        for field in fields(self):
            _check_positive(f"hand {field.name}", getattr(self, field.name), "m")
        if self.min_width >= self.max_width:
            got = f"min_width {self.min_width} and max_width {self.max_width}"
            raise InvalidValueError("hand widths", "min_width < max_width (m)", got, "swap or correct them")


@dataclass(frozen=True, eq=False)
class GraspPlan:
    """A grasp, in the frame of the points it was planned on.

    Attributes:
        rotation: (3, 3), hand frame to object frame: its columns are the hand's x (closing), y and z (away from the object) axes.
        centre: (3,) the middle between the pads, m.
        width: distance between thumb pad and finger pads along x when they touch, mean of the two fingers, m.
        thumb_point: (3,) middle of the thumb's contact, m.
        thumb_normal: (3,) outward unit normal there.
        finger_points: (2, 3), at y = -spacing/2 and +spacing/2, m.
        finger_normals: (2, 3).
        weight_per_squeeze: newtons of weight that friction can carry per newton of thumb force; 2 x friction for a perfect pinch.
        score: 0 (barely possible) to 1 (as good as can be).
        approach: in words, such as "from above, closing at 30 degrees".
    """

    rotation: Array
    centre: Array
    width: float
    thumb_point: Array
    thumb_normal: Array
    finger_points: Array
    finger_normals: Array
    weight_per_squeeze: float
    score: float
    approach: str


def plan_grasp(
    points: ArrayLike,
    normals: ArrayLike,
    centre_of_mass: ArrayLike = (0.0, 0.0, 0.0),
    *,
    friction: float = 0.8,
    hand: HandGeometry | None = None,
    resting: bool = True,
) -> GraspPlan:
    """Chooses how the hand takes an object that keeps its orientation, z up.

    Deterministic: the same points give the same plan.

    Args:
        points: (n, 3) surface points, m.
        normals: (n, 3) outward normals.
        centre_of_mass: (3,) m.
        friction: Coulomb coefficient between pads and object, > 0.
        hand: figures of the hand; default `HandGeometry()`.
        resting: the object stands with its lowest point on a flat support that the hand must not touch.

    Raises:
        GraspPlanError: too large, too small, no opposing sides, or none that the hand can reach.
        InvalidShapeError, InvalidValueError: bad arrays or figures.
    """
    hand = HandGeometry() if hand is None else hand
    cloud, directions, middle = _check_input(points, normals, centre_of_mass)
    _check_positive("friction", friction, "-")
    cloud = cloud - middle
    _check_size(cloud, hand)

    search = _Search(cloud, directions, friction, hand, resting)
    candidates = search.candidates()
    if not candidates:
        raise search.explain()
    best: tuple[float, GraspPlan] | None = None
    for coarse, rotation, y, z, approach in candidates:
        plan = _place(cloud, directions, rotation, y, z, friction, hand, coarse, approach)
        # Rounded, so that noise in the last bits does not choose between equals: the first in a fixed order wins.
        if plan is not None and (best is None or round(plan.score, 6) > round(best[0], 6)):
            best = (plan.score, plan)
    if best is None:
        raise GraspPlanError(
            "grasp",
            "three contacts that carry the object's weight by friction",
            f"none among {len(candidates)} candidates",
            "raise the friction, or turn the object in its file",
        )
    plan = best[1]
    return GraspPlan(
        rotation=plan.rotation,
        centre=plan.centre + middle,
        width=plan.width,
        thumb_point=plan.thumb_point + middle,
        thumb_normal=plan.thumb_normal,
        finger_points=plan.finger_points + middle,
        finger_normals=plan.finger_normals,
        weight_per_squeeze=plan.weight_per_squeeze,
        score=plan.score,
        approach=plan.approach,
    )


def _check_positive(what: str, value: object, unit: str) -> None:
    good = isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool) and math.isfinite(value) and value > 0
    if not good:
        raise InvalidValueError(what, f"a finite number > 0 ({unit})", repr(value), "give a positive value in SI units")


def _check_input(points: ArrayLike, normals: ArrayLike, centre_of_mass: ArrayLike) -> tuple[Array, Array, Array]:
    checked: list[Array] = []
    for what, value, shape in (("points", points, "(n, 3)"), ("normals", normals, "(n, 3)"), ("centre_of_mass", centre_of_mass, "(3,)")):
        try:
            array = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise InvalidShapeError(what, f"numbers in an array of shape {shape}", type(value).__name__, "give a NumPy array") from error
        if array.shape[-1:] != (3,) or array.ndim != (1 if shape == "(3,)" else 2):
            raise InvalidShapeError(what, f"shape {shape}", f"shape {array.shape}", "one row per point, columns x y z")
        if not np.isfinite(array).all():
            got = f"{int((~np.isfinite(array)).sum())} numbers that are NaN or infinite"
            raise InvalidValueError(what, "finite numbers only", got, "remove or repair them")
        checked.append(array)
    cloud, directions, middle = checked
    if len(cloud) != len(directions):
        raise InvalidShapeError("normals", f"{len(cloud)} rows, one per point", f"{len(directions)}", "give one normal per point")
    if len(cloud) < 50:
        raise InvalidShapeError("points", "at least 50 rows", f"{len(cloud)}", "sample the surface more densely")
    lengths = np.linalg.norm(directions, axis=1)
    if (lengths < 1e-9).any():
        raise InvalidValueError("normals", "vectors of length 1", f"{int((lengths < 1e-9).sum())} of length 0", "remove these points")
    return cloud, directions / lengths[:, None], middle


def _check_size(cloud: Array, hand: HandGeometry) -> None:
    extents = np.ptp(cloud, axis=0)
    if float(np.linalg.norm(extents)) < hand.min_width:
        raise _width_error(float(extents.max()), hand, "scale it up")


def _width_error(width: float, hand: HandGeometry, hint: str) -> GraspPlanError:
    size = "too large" if width > hand.max_width else "too small"
    expected = f"a width between {1e3 * hand.min_width:g} and {1e3 * hand.max_width:g} mm between opposing sides"
    return GraspPlanError(f"object {size} for the hand", expected, f"{1e3 * width:.3g} mm", hint)


Candidate = tuple[float, Array, float, float, str]
"""Coarse score, rotation (hand to object), grasp centre y and z in the hand frame about the centre of mass, approach in words."""


class _Search:
    """The coarse stage, and what it learned about an object that cannot be taken."""

    def __init__(self, cloud: Array, directions: Array, friction: float, hand: HandGeometry, resting: bool) -> None:
        stride = max(1, len(cloud) // COARSE_POINTS)
        self.cloud, self.directions = cloud[::stride], directions[::stride]
        self.friction, self.hand, self.resting = friction, hand, resting
        self.floor = float(cloud[:, 2].min())
        gaps, _ = cKDTree(self.cloud).query(self.cloud, k=2)
        spacing = float(np.median(gaps[:, 1]))
        # The finger offset must be a whole number of cells, and a cell must hold a point or two.
        self.half = max(1, int(0.5 * hand.finger_spacing / max(2e-3, 1.5 * spacing)))
        self.cell = 0.5 * hand.finger_spacing / self.half
        # The cells under a pad, and how far the spherical pad stands back there from its middle.
        reach = int(0.95 * hand.pad_radius / self.cell)
        span = np.arange(-reach, reach + 1)
        rows, columns = (grid.reshape(-1) for grid in np.meshgrid(span, span, indexing="ij"))
        squared = (rows**2 + columns**2) * self.cell**2
        under = squared <= (0.95 * hand.pad_radius) ** 2
        self.under = list(zip(rows[under].tolist(), columns[under].tolist(), strict=True))
        self.recess = hand.pad_radius - np.sqrt(hand.pad_radius**2 - squared[under])
        self.widths: list[float] = []  # between sides that oppose each other, whatever else is wrong there

    def candidates(self) -> list[Candidate]:
        """The best grasp centre of every orientation, best first, at most FINE_CANDIDATES."""
        found: list[Candidate] = []
        for rotation, weight, approach in _orientations(self.resting):
            best = self._best_centre(rotation)
            if best is not None:
                found.append((weight * best[0], rotation, best[1], best[2], approach))
        found.sort(key=lambda candidate: -round(candidate[0], 9))  # stable: equals stay in the order of the orientations
        return found[:FINE_CANDIDATES]

    def explain(self) -> GraspPlanError:
        """Why there is no candidate."""
        hand = self.hand
        if self.widths:
            if min(self.widths) > hand.max_width:
                return _width_error(min(self.widths), hand, "scale it down")
            if max(self.widths) < hand.min_width:
                return _width_error(max(self.widths), hand, "scale it up")
            hint = "the palm, a finger or the support is in the way: turn the object in its file, scale it, or hold it without a support"
            return GraspPlanError("grasp", "opposing sides that the hand can reach", "opposing sides, all out of reach", hint)
        least = float(np.ptp(self.cloud, axis=0).min())
        if least > hand.max_width:
            return _width_error(least, hand, "scale it down")
        hint = "raise the friction, sample the surface more densely, or turn the object in its file"
        return GraspPlanError("grasp", "two opposing sides within the friction cone", "none found", hint)

    def _best_centre(self, rotation: Array) -> tuple[float, float, float] | None:
        hand, cell, half = self.hand, self.cell, self.half
        local, facing = self.cloud @ rotation, self.directions @ rotation
        # The map has room around the object for the two fingers and the filters: nothing that is rolled over an edge matters.
        margin = half + math.ceil(hand.palm_half_width / cell) + 2
        index = np.floor(local[:, 1:] / cell + 0.5).astype(np.int64)
        first = index.min(axis=0) - margin
        shape = tuple(int(n) for n in index.max(axis=0) + margin + 1 - first)
        flat = (index[:, 0] - first[0]) * shape[1] + index[:, 1] - first[1]
        y = (first[0] + np.arange(shape[0])) * cell
        z = (first[1] + np.arange(shape[1])) * cell

        thumb = self._side(local, facing, flat, shape, z, -1.0)
        finger = self._side(local, facing, flat, shape, z, 1.0)
        low, high = _shift(finger, half), _shift(finger, -half)  # fingers at y - spacing/2 and y + spacing/2

        widths = np.stack([thumb.depth + low.depth, thumb.depth + high.depth])
        sound = thumb.sound & low.sound & high.sound
        with np.errstate(invalid="ignore", over="ignore"):
            uneven = np.abs(widths[0] - widths[1])
            sound &= uneven < 0.012
        if not sound.any():
            return None
        mean_width = np.where(sound, widths.mean(axis=0), 0.0)
        self.widths += [float(mean_width[sound].min()), float(mean_width[sound].max())]
        fits = sound & (widths.min(axis=0) >= hand.min_width) & (widths.max(axis=0) <= hand.max_width)
        fits &= ~(thumb.blocked | low.blocked | high.blocked)

        # Palm: nothing of the object within its width may stand higher above the pads than the reach.
        top = np.full(shape[0], -np.inf)
        np.maximum.at(top, index[:, 0] - first[0], local[:, 2])
        top = maximum_filter1d(top, 2 * math.ceil(hand.palm_half_width / cell) + 1, mode="constant", cval=-np.inf)
        fits &= top[:, None] - z[None, :] <= hand.reach
        # World height of the grasp centre over the centre of mass, and the horizontal distance from it, both seen in the hand's y-z plane.
        height = y[:, None] * rotation[2, 1] + z[None, :] * rotation[2, 2]
        beside = np.sqrt(np.maximum(y[:, None] ** 2 + z[None, :] ** 2 - height**2, 0.0))
        if self.resting:
            tip = hand.tip_below * max(rotation[2, 2], 0.0)
            across = 0.5 * mean_width * abs(rotation[2, 0])
            sideways = max(0.5 * hand.finger_spacing + hand.finger_radius, hand.palm_half_width) * abs(rotation[2, 1])
            fits &= height - self.floor - across - sideways - tip >= 0.0
        if not fits.any():
            return None

        lengthwise = np.where(height >= 0.0, 0.060, 0.025)  # a grasp above the centre of mass lets it hang, one below makes it top-heavy
        with np.errstate(invalid="ignore", over="ignore"):
            score = np.minimum(np.minimum(low.quality, high.quality), thumb.quality) * np.exp(-((uneven / 0.008) ** 2))
            score *= np.exp(-((beside / 0.020) ** 2) - (height / lengthwise) ** 2) * _width_comfort(mean_width, hand)
        score = np.where(fits, score, -1.0)
        place = int(np.argmax(np.round(score, 9)))
        row, column = divmod(place, shape[1])
        return float(score[row, column]), float(y[row]), float(z[column])

    def _side(self, local: Array, facing: Array, flat: NDArray[np.int64], shape: tuple[int, ...], z: Array, sign: float) -> _Side:
        """The object seen from one side of the hand: `sign` -1 from the thumb's, +1 from the fingers'."""
        hand, cell = self.hand, self.cell
        out = sign * local[:, 0]
        size = shape[0] * shape[1]
        depth = np.full(size, -np.inf)
        np.maximum.at(depth, flat, out)
        front = (out > depth[flat] - 3e-3) & (sign * facing[:, 0] > 0.0)
        count = np.bincount(flat[front], minlength=size).reshape(shape).astype(np.float64)
        sums = [np.bincount(flat[front], facing[front, k], size).reshape(shape) for k in range(3)]
        depth = depth.reshape(shape)
        with np.errstate(invalid="ignore", divide="ignore"):
            unit = np.stack(sums) / np.where(count > 0, count, 1.0)
            nearest = np.full(shape, -np.inf)
            for (i, j), recess in zip(self.under, self.recess, strict=True):
                np.maximum(nearest, np.roll(depth, (-i, -j), axis=(0, 1)) - recess, out=nearest)
            # The patch of a pad pressed in a little: pressure grows with the depth, as in `_touch`.
            press_sum, normal, shift = np.zeros(shape), np.zeros((3, *shape)), np.zeros((2, *shape))
            for (i, j), recess in zip(self.under, self.recess, strict=True):
                there = np.roll(depth, (-i, -j), axis=(0, 1)) - recess
                press = np.maximum(there - (nearest - COARSE_INDENTATION), 0.0)
                press[~np.isfinite(press)] = 0.0
                press_sum += press
                normal += press * np.roll(unit, (-i, -j), axis=(1, 2))
                shift[0] += i * press
                shift[1] += j * press
            length = np.linalg.norm(normal, axis=0)
            cosine = sign * normal[0] / length
            tangent = np.sqrt(np.maximum(1.0 - cosine**2, 0.0)) / np.maximum(cosine, 1e-9)
            covered = np.minimum(press_sum / np.maximum(COARSE_INDENTATION - self.recess, 0.0).sum(), 1.0)  # 1 on a flat face
            aside = self.cell * np.hypot(shift[0], shift[1]) / press_sum
            dispersion = length / press_sum  # 1 where all normals agree
            sound = (cosine > 0.0) & (tangent < CONE_SHARE * self.friction) & (covered > 0.35) & (dispersion > 0.8) & (aside < 4e-3)
            quality = (1.0 - tangent / self.friction) * np.sqrt(covered) * dispersion * np.exp(-((aside / 6e-3) ** 2))
        blocked = self._blocked(depth, np.where(np.isfinite(nearest), nearest, 0.0), z, max(1, round(hand.finger_radius / cell)))
        return _Side(nearest, sound, np.where(sound, quality, 0.0), blocked)

    def _blocked(self, depth: Array, pad: Array, z: Array, radius: int) -> BoolArray:
        """Where the object stands in the way of the finger behind a pad, above it (towards the palm) or below it (the fingertip)."""
        strip = maximum_filter1d(depth, 2 * radius + 1, axis=0, mode="constant", cval=-np.inf)
        leaning = strip - FINGER_SLOPE * z[None, :]
        above = np.maximum.accumulate(leaning[:, ::-1], axis=1)[:, ::-1] + FINGER_SLOPE * z[None, :]
        tip = max(1, round(self.hand.tip_below / self.cell))
        padded = np.pad(strip, ((0, 0), (tip, 0)), constant_values=-np.inf)
        below = np.stack([padded[:, k : k + depth.shape[1]] for k in range(tip + 1)]).max(axis=0)
        result: BoolArray = (above > pad + FINGER_ROOM) | (below > pad + FINGER_ROOM)
        return result


@dataclass(frozen=True, eq=False)
class _Side:
    """Height map of one side: all arrays by y and z cell of the pad's centre."""

    depth: Array  # m, where a pad coming from outside meets the surface
    sound: BoolArray  # flat enough, covered, and within the friction cone
    quality: Array  # 0 to 1
    blocked: BoolArray  # the finger behind the pad would run into the object


def _shift(side: _Side, cells: int) -> _Side:
    """The map seen from a pad that sits `cells` lower in y; the margin around the object makes the wrap harmless."""
    return _Side(
        depth=np.roll(side.depth, cells, axis=0),
        sound=np.roll(side.sound, cells, axis=0),
        quality=np.roll(side.quality, cells, axis=0),
        blocked=np.roll(side.blocked, cells, axis=0),
    )


def _width_comfort(width: Array, hand: HandGeometry) -> Array:
    """1 in the middle of the range of widths, down to 0.6 at both ends: an object held at the limit leaves the controller no room."""
    room = np.minimum((width - hand.min_width) / 0.010, (hand.max_width - width) / 0.015)
    comfort: Array = 0.6 + 0.4 * np.clip(room, 0.0, 1.0)
    return comfort


def _orientations(resting: bool) -> list[tuple[Array, float, str]]:
    """Rotations hand to object with a weight and words: from above all round, then from the sides, rolled about the approach axis."""
    up = np.array([0.0, 0.0, 1.0])
    found: list[tuple[Array, float, str]] = []
    for k in range(round(2.0 * math.pi / TURN_STEP)):
        turn = k * TURN_STEP
        x = np.array([math.cos(turn), math.sin(turn), 0.0])
        found.append((np.column_stack([x, np.cross(up, x), up]), 1.0, f"from above, closing at {math.degrees(turn):g} degrees"))
    rolls = [math.radians(r) for r in ((0, 180, -20, 20, 160, 200) if resting else range(0, 360, 30))]
    for k in range(round(2.0 * math.pi / SIDE_STEP)):
        azimuth = k * SIDE_STEP
        z = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
        level = np.cross(up, z)
        for roll in rolls:
            x = math.cos(roll) * level + math.sin(roll) * up
            words = f"from the side at {math.degrees(azimuth):g} degrees, rolled by {math.degrees(roll):g}"
            found.append((np.column_stack([x, np.cross(z, x), z]), SIDE_WEIGHT, words))
    return found


def _place(
    cloud: Array,
    directions: Array,
    rotation: Array,
    y: float,
    z: float,
    friction: float,
    hand: HandGeometry,
    coarse: float,
    approach: str,
) -> GraspPlan | None:
    """The fine stage for one candidate: where the three pads touch, and what they can carry. None if they cannot."""
    local, facing = cloud @ rotation, directions @ rotation
    half = 0.5 * hand.finger_spacing
    touches = []
    for sign, pad_y in ((-1.0, y), (1.0, y - half), (1.0, y + half)):
        touch = _touch(local, facing, sign, pad_y, z, hand.pad_radius)
        if touch is None:
            return None
        touches.append(touch)
    pads = np.array([touch[0] for touch in touches])
    widths = pads[0] + pads[1:]
    if widths.min() < hand.min_width or widths.max() > hand.max_width:
        return None
    contact = np.stack([touch[1] for touch in touches])
    normal = np.stack([touch[2] for touch in touches])
    offset = np.hypot(contact[:, 1] - np.array([y, y - half, y + half]), contact[:, 2] - z)
    centre = np.array([0.5 * (0.5 * float(pads[1:].sum()) - pads[0]), y, z])
    points, normals = contact @ rotation.T, normal @ rotation.T
    down = np.array([0.0, 0.0, -1.0])
    straight = _carried(points, normals, friction, down)
    # A hand that moves and shakes tilts the load: what counts is the least over the directions.
    tilted = [0.5 * np.array([c, s, 0.0]) + down for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1))]
    least = min([straight] + [_carried(points, normals, friction, load / float(np.linalg.norm(load))) for load in tilted])
    if least <= 0.1 * friction:
        return None
    score = coarse * min(least / (2.0 * friction), 1.0) * float(np.exp(-((offset.max() / 6e-3) ** 2)))
    return GraspPlan(
        rotation=rotation,
        centre=rotation @ centre,
        width=float(widths.mean()),
        thumb_point=points[0],
        thumb_normal=normals[0],
        finger_points=points[1:],
        finger_normals=normals[1:],
        weight_per_squeeze=straight,
        score=score,
        approach=approach,
    )


def _touch(local: Array, facing: Array, sign: float, y: float, z: float, radius: float) -> tuple[float, Array, Array] | None:
    """Moves a spherical pad inward until it touches: pad position along the outward direction (m), middle of the patch, mean normal."""
    squared = (local[:, 1] - y) ** 2 + (local[:, 2] - z) ** 2
    near = np.flatnonzero((squared < (0.95 * radius) ** 2) & (sign * facing[:, 0] > 0.0))
    if len(near) < 3:
        return None
    met = sign * local[near, 0] - (radius - np.sqrt(radius**2 - squared[near]))
    pad = float(met.max())
    press = np.maximum(met - (pad - INDENTATION), 0.0)  # pressure of the patch grows with the depth
    total = float(press.sum())
    normal = press @ facing[near]
    return pad, (press @ local[near]) / total, normal / float(np.linalg.norm(normal))


def _carried(points: Array, normals: Array, friction: float, load: Array) -> float:
    """Largest force along `load` at the origin (the centre of mass) that the contacts balance with a thumb normal force of at most 1.

    Linear program. Unknowns: for each contact the weights of CONE_SIDES edges of its friction pyramid (inside the cone) and a torsional
    moment of either sign, at most (3 pi / 16) mu a f_n; and the load.
    """
    contacts, sides = len(points), CONE_SIDES
    columns = contacts * (sides + 2) + 1
    balance = np.zeros((6, columns))
    limits = np.zeros((contacts + 1, columns))
    torsion = 3.0 * math.pi / 16.0 * friction * PATCH_RADIUS
    unit = 0.02  # m, brings moments to the size of forces
    angles = 2.0 * math.pi / sides * np.arange(sides)
    for k in range(contacts):
        inward = -normals[k]
        first = np.cross(inward, np.eye(3)[int(np.argmin(np.abs(inward)))])
        first /= float(np.linalg.norm(first))
        second = np.cross(inward, first)
        edges = inward + friction * (np.cos(angles)[:, None] * first + np.sin(angles)[:, None] * second)
        at = k * (sides + 2)
        balance[:3, at : at + sides] = edges.T
        balance[3:, at : at + sides] = np.cross(points[k], edges).T / unit
        balance[3:, at + sides] = inward * torsion / unit
        balance[3:, at + sides + 1] = -inward * torsion / unit
        limits[k, at + sides : at + sides + 2] = 1.0
        limits[k, at : at + sides] = -1.0
    limits[contacts, :sides] = 1.0
    balance[:3, -1] = load
    cost = np.zeros(columns)
    cost[-1] = -1.0
    bound = np.zeros(contacts + 1)
    bound[contacts] = 1.0
    result = linprog(cost, A_ub=limits, b_ub=bound, A_eq=balance, b_eq=np.zeros(6), method="highs")
    return float(result.x[-1]) if result.status == 0 else 0.0
