"""The coarse stage of grasp planning: every hand orientation, every grasp centre, scored on height maps of the object's two sides.

Frames and words are those of ``grasp.plan``.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d
from scipy.spatial import cKDTree

from quasirigid.arrays.types import BoolArray, FloatArray
from quasirigid.errors import GraspPlanError, InvalidValueError
from quasirigid.scene.built_in_hand import FINGER_SPACING

COARSE_POINTS = 20_000  # enough for height maps of 2 mm cells on objects that fit the hand
FINE_CANDIDATES = 40  # how many go through the linear program
TURN_STEP = math.radians(7.5)  # between hand orientations about the approach axis, from above
SIDE_STEP = math.radians(15.0)  # between approach directions, from the sides
SIDE_WEIGHT = 0.75  # a grasp from above needs less room, so that one from the side must be this much better
CONE_SHARE = 0.6  # part of the friction cone that the surface may be tilted by at a pad
COARSE_INDENTATION = 1.2e-3  # m, how deep a soft pad is thought to deform; more than in the fine stage, for cells are coarse
MAX_BESIDE, MAX_BELOW, MAX_ABOVE = 0.040, 0.040, 0.090  # m, how far from the centre of mass a grasp centre is looked for
FINGER_SLOPE = 0.3  # how much a finger leans outward on its way from pad to palm
FINGER_ROOM = 5e-3  # m, how much the object may bulge beyond a pad, beside the finger


@dataclass(frozen=True)
class HandGeometry:
    """Figures of the hand that decide what it can take. All in m.

    Attributes:
        finger_spacing: between the centres of the two finger pads, along y.
        pad_radius: of the ellipsoid cap that is the pad.
        finger_radius: of the finger behind the pad.
        min_width: least distance between thumb pad and finger pads.
        max_width: largest distance between thumb pad and finger pads.
        reach: how far the object may extend beyond the pads' centre towards the palm.
        tip_below: how far a fingertip extends beyond its pad's centre, away from the palm.
        palm_half_width: of the palm and the finger bases, along y.
    """

    finger_spacing: float = FINGER_SPACING
    pad_radius: float = 0.008
    finger_radius: float = 0.009
    min_width: float = 0.008
    max_width: float = 0.080
    reach: float = 0.070
    tip_below: float = 0.010
    palm_half_width: float = 0.040

    def __post_init__(self) -> None:
        for field in fields(self):
            check_positive(f"hand {field.name}", getattr(self, field.name), "m")
        if self.min_width >= self.max_width:
            got = f"min_width {self.min_width} and max_width {self.max_width}"
            raise InvalidValueError("hand widths", "min_width < max_width (m)", got, "swap or correct them")


def check_positive(what: str, value: object, unit: str) -> None:
    """Raises ``InvalidValueError`` for a ``value`` that is not a finite number above 0."""
    good = isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool) and 0 < value <= sys.float_info.max
    if not good:
        raise InvalidValueError(what, f"a finite number > 0 ({unit})", repr(value), "give a positive value in SI units")


def _expected_width(hand: HandGeometry) -> str:
    return f"a width between {1e3 * hand.min_width:g} and {1e3 * hand.max_width:g} mm between opposing sides"


def width_error(width: float, hand: HandGeometry) -> GraspPlanError:
    """The object is too large or too small: `width` (m) is what it measures."""
    size, hint = ("too large", "scale it down") if width > hand.max_width else ("too small", "scale it up")
    return GraspPlanError(f"object {size} for the hand", _expected_width(hand), f"{1e3 * width:.3g} mm", hint)


Candidate = tuple[float, FloatArray, float, float, str]
"""Coarse score, rotation (hand to object), grasp centre y and z in the hand frame about the centre of mass, approach in words."""


class Search:
    """The coarse stage, and what it learned about an object that cannot be taken."""

    def __init__(
        self, cloud: FloatArray, directions: FloatArray, friction: float, hand: HandGeometry, resting: bool, approach: str
    ) -> None:
        stride = -(-len(cloud) // COARSE_POINTS)
        self.cloud, self.directions = cloud[::stride], directions[::stride]
        self.friction, self.hand, self.resting = friction, hand, resting
        self.orientations = _orientations(resting, approach)
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
        self.under = np.column_stack([rows[under], columns[under]])
        self.recess = hand.pad_radius - np.sqrt(hand.pad_radius**2 - squared[under])
        # Widths between sides that oppose each other, whatever else is wrong there: the least below the range and the least above it.
        self.below, self.above = math.inf, math.inf
        self.fitting = False  # some were in the range

    def candidates(self) -> list[Candidate]:
        """The best grasp centre of every orientation, best first, at most FINE_CANDIDATES."""
        found: list[Candidate] = []
        for rotation, weight, approach in self.orientations:
            best = self._best_centre(rotation)
            if best is not None:
                found.append((weight * best[0], rotation, best[1], best[2], approach))
        found.sort(key=lambda candidate: -round(candidate[0], 9))  # stable: equals stay in the order of the orientations
        return found[:FINE_CANDIDATES]

    def explain(self) -> GraspPlanError:
        """Why there is no candidate."""
        hand = self.hand
        if self.fitting:
            hint = "the palm, a finger or the support is in the way: turn the object (--up, --rotate), or scale it"
            return GraspPlanError("grasp", "opposing sides that the hand can reach", "opposing sides, all out of reach", hint)
        if math.isfinite(self.below) and math.isfinite(self.above):
            got = f"{1e3 * self.below:.3g} mm one way and {1e3 * self.above:.3g} mm another"
            return GraspPlanError("object for the hand", _expected_width(hand), got, "scale it, up or down")
        if math.isfinite(self.above):
            return width_error(self.above, hand)
        if math.isfinite(self.below):
            return width_error(self.below, hand)
        least = float(np.ptp(self.cloud, axis=0).min())
        if least > hand.max_width:
            return width_error(least, hand)
        remedy = "scale the object up, turn it (--up, --rotate), or raise the friction"
        hint = f"both fingers, {1e3 * hand.finger_spacing:g} mm apart, must oppose the thumb: {remedy}"
        return GraspPlanError("grasp", "two opposing sides within the friction cone", "none found", hint)

    def _best_centre(self, rotation: FloatArray) -> tuple[float, float, float] | None:
        hand, cell, half = self.hand, self.cell, self.half
        local, facing = self.cloud @ rotation, self.directions @ rotation
        # The map has room around the object for the two fingers and the filters: nothing that is rolled over an edge matters.
        margin = half + 2 + max(math.ceil(hand.finger_radius / cell), math.ceil(hand.pad_radius / cell))
        index = np.floor(local[:, 1:] / cell + 0.5).astype(np.int64)
        first = index.min(axis=0) - margin
        shape = tuple(int(n) for n in index.max(axis=0) + margin + 1 - first)
        flat = (index[:, 0] - first[0]) * shape[1] + index[:, 1] - first[1]
        y = (first[0] + np.arange(shape[0])) * cell
        z = (first[1] + np.arange(shape[1])) * cell

        # World height of the grasp centre over the centre of mass, and the horizontal distance from it, both seen in the hand's y-z plane.
        height = y[:, None] * rotation[2, 1] + z[None, :] * rotation[2, 2]
        beside = np.sqrt(np.maximum(y[:, None] ** 2 + z[None, :] ** 2 - height**2, 0.0))
        near = (beside < MAX_BESIDE) & (height > -MAX_BELOW) & (height < MAX_ABOVE)

        thumb = self._side(local, facing, flat, near, z, -1.0)
        wanted = np.roll(thumb.sound, half, axis=0) | np.roll(thumb.sound, -half, axis=0)
        if not wanted.any():
            return None
        finger = self._side(local, facing, flat, wanted, z, 1.0)
        low, high = _shift(finger, half), _shift(finger, -half)  # fingers at y - spacing/2 and y + spacing/2

        widths = np.stack([thumb.depth + low.depth, thumb.depth + high.depth])
        sound = thumb.sound & low.sound & high.sound
        with np.errstate(invalid="ignore", over="ignore"):
            uneven = np.abs(widths[0] - widths[1])
            sound &= uneven < 0.012
        if not sound.any():
            return None
        mean_width = np.where(sound, widths.mean(axis=0), 0.0)
        found = mean_width[sound]
        small, large = found[found < hand.min_width], found[found > hand.max_width]
        self.below = min(self.below, float(small.min(initial=math.inf)))
        self.above = min(self.above, float(large.min(initial=math.inf)))
        self.fitting |= len(small) + len(large) < len(found)
        fits = sound & (widths.min(axis=0) >= hand.min_width) & (widths.max(axis=0) <= hand.max_width)
        fits &= ~(thumb.blocked | low.blocked | high.blocked)

        # Palm: nothing of the object within its width may stand higher above the pads than the reach.
        top = np.full(shape[0], -np.inf)
        np.maximum.at(top, index[:, 0] - first[0], local[:, 2])
        top = maximum_filter1d(top, 2 * math.ceil(hand.palm_half_width / cell) + 1, mode="constant", cval=-np.inf)
        fits &= top[:, None] - z[None, :] <= hand.reach
        if self.resting:
            tip = hand.tip_below * max(rotation[2, 2], 0.0)
            across = 0.5 * mean_width * abs(rotation[2, 0])
            sideways = max(0.5 * hand.finger_spacing + hand.finger_radius, hand.palm_half_width) * abs(rotation[2, 1])
            fits &= height - self.floor - across - sideways - tip >= 0.0
        if not fits.any():
            return None

        lengthwise = np.where(height >= 0.0, 0.060, 0.020)  # a grasp above the centre of mass lets it hang, one below makes it top-heavy
        with np.errstate(invalid="ignore", over="ignore"):
            score = np.minimum(np.minimum(low.quality, high.quality), thumb.quality) * np.exp(-((uneven / 0.008) ** 2))
            score *= np.exp(-((beside / 0.020) ** 2) - (height / lengthwise) ** 2) * _width_comfort(mean_width, hand)
        score = np.where(fits, score, -1.0)
        place = int(np.argmax(np.round(score, 9)))
        row, column = divmod(place, shape[1])
        return float(score[row, column]), float(y[row]), float(z[column])

    def _side(self, local: FloatArray, facing: FloatArray, flat: NDArray[np.int64], wanted: BoolArray, z: FloatArray, sign: float) -> _Side:
        """The object seen from one side of the hand: `sign` -1 from the thumb's, +1 from the fingers'. Only `wanted` cells are judged."""
        shape, size = wanted.shape, wanted.size
        out = sign * local[:, 0]
        depth = np.full(size, -np.inf)
        np.maximum.at(depth, flat, out)
        front = (out > depth[flat] - 3e-3) & (sign * facing[:, 0] > 0.0)
        count = np.maximum(np.bincount(flat[front], minlength=size), 1)
        unit = np.stack([np.bincount(flat[front], facing[front, k], size) / count for k in range(3)], axis=1)

        # (cells, offsets under the pad): the spherical pad comes in until it touches, then deforms a little; pressure grows with the depth.
        rim = int(self.under.max())
        inner = np.zeros_like(wanted)
        inner[rim : shape[0] - rim, rim : shape[1] - rim] = wanted[rim : shape[0] - rim, rim : shape[1] - rim]
        cells = np.flatnonzero(inner)
        around = cells[:, None] + (self.under[:, 0] * shape[1] + self.under[:, 1])[None, :]
        met = depth[around] - self.recess
        pad = met.max(axis=1)
        hit = np.isfinite(pad)
        cells, around, met, pad = cells[hit], around[hit], met[hit], pad[hit]
        press = np.maximum(met - (pad - COARSE_INDENTATION)[:, None], 0.0)
        total = press.sum(axis=1)
        normal = np.einsum("co,cok->ck", press, unit[around])
        length = np.linalg.norm(normal, axis=1)
        cosine = sign * normal[:, 0] / np.maximum(length, 1e-12)
        tangent = np.sqrt(np.maximum(1.0 - cosine**2, 0.0)) / np.maximum(cosine, 1e-9)
        covered = np.minimum(total / np.maximum(COARSE_INDENTATION - self.recess, 0.0).sum(), 1.0)  # 1 on a flat face
        aside = self.cell * np.linalg.norm(press @ self.under, axis=1) / total
        dispersion = length / total  # 1 where all normals agree
        sound = (cosine > 0.0) & (tangent < CONE_SHARE * self.friction) & (covered > 0.35) & (dispersion > 0.8) & (aside < 4e-3)
        quality = (1.0 - tangent / self.friction) * covered * dispersion * np.exp(-((aside / 6e-3) ** 2))

        maps = np.zeros((3, size))
        maps[0, cells], maps[1, cells], maps[2, cells] = pad, sound, np.where(sound, quality, 0.0)
        maps = maps.reshape(3, *shape)
        blocked = self._blocked(depth.reshape(shape), maps[0], z, max(1, round(self.hand.finger_radius / self.cell)))
        return _Side(maps[0], maps[1] > 0.0, maps[2], blocked)

    def _blocked(self, depth: FloatArray, pad: FloatArray, z: FloatArray, radius: int) -> BoolArray:
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

    depth: FloatArray  # m, where a pad coming from outside meets the surface
    sound: BoolArray  # flat enough, covered, and within the friction cone
    quality: FloatArray  # 0 to 1
    blocked: BoolArray  # the finger behind the pad would run into the object


def _shift(side: _Side, cells: int) -> _Side:
    """The map seen from a pad that sits `cells` lower in y; the margin around the object makes the wrap harmless."""
    return _Side(
        depth=np.roll(side.depth, cells, axis=0),
        sound=np.roll(side.sound, cells, axis=0),
        quality=np.roll(side.quality, cells, axis=0),
        blocked=np.roll(side.blocked, cells, axis=0),
    )


def _width_comfort(width: FloatArray, hand: HandGeometry) -> FloatArray:
    """1 in the middle of the range of widths, down to 0.6 at both ends: an object held at the limit leaves the controller no room."""
    room = np.minimum((width - hand.min_width) / 0.010, (hand.max_width - width) / 0.015)
    comfort: FloatArray = 0.6 + 0.4 * np.clip(room, 0.0, 1.0)
    return comfort


def _orientations(resting: bool, approach: str) -> list[tuple[FloatArray, float, str]]:
    """Rotations hand to object with a weight and words: from above all round, then from the sides, rolled about the approach axis."""
    up = np.array([0.0, 0.0, 1.0])
    found: list[tuple[FloatArray, float, str]] = []
    for k in range(round(2.0 * math.pi / TURN_STEP) if approach != "side" else 0):
        turn = k * TURN_STEP
        x = np.array([math.cos(turn), math.sin(turn), 0.0])
        found.append((np.column_stack([x, np.cross(up, x), up]), 1.0, f"from above, closing at {math.degrees(turn):g} degrees"))
    rolls = [math.radians(r) for r in ((0, 180, -20, 20, 160, 200) if resting else range(0, 360, 30))]
    for k in range(round(2.0 * math.pi / SIDE_STEP) if approach != "above" else 0):
        azimuth = k * SIDE_STEP
        z = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
        level = np.cross(up, z)
        for roll in rolls:
            x = math.cos(roll) * level + math.sin(roll) * up
            words = f"from the side at {math.degrees(azimuth):g} degrees" + (f", rolled by {math.degrees(roll):g}" if roll else "")
            found.append((np.column_stack([x, np.cross(z, x), z]), SIDE_WEIGHT, words))
    return found
