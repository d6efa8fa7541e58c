"""Where the built-in three-finger hand takes an object: opposing sides, near the centre of mass, at a width that fits.

Two stages. A coarse one looks at every hand orientation (from above, from the sides, turned about the approach axis): the object is seen
along the closing direction as two height maps, thumb side and finger side, and every cell of the map is scored as a grasp centre. A fine
one places the three pads of the best candidates on the surface and asks a linear program how much weight they can carry per newton of
squeeze.

The hand frame: fingers hang from the palm along -z and close along x. The thumb is at -x and its pad faces +x; the two fingers are at +x,
at y = -spacing/2 and +spacing/2, and their pads face -x. The grasp centre is the middle between the pads.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linprog

from quasirigid.arrays.real import real_array
from quasirigid.arrays.types import FloatArray
from quasirigid.errors import GraspPlanError, InvalidShapeError, InvalidValueError, UnknownNameError
from quasirigid.grasp.search import HandGeometry, Search, check_positive, width_error
from quasirigid.objects.orientation import SIDES, Up, rotation_of

__all__ = ["GraspPlan", "HandGeometry", "plan_grasp", "side_up_that_fits"]


INDENTATION = 0.7e-3  # m, how deep a soft pad is thought to deform when its patch is worked out
PATCH_RADIUS = 4e-3  # m, contact radius that goes into the torsional friction
MISSES = ((-2e-3, 0.0), (2e-3, 0.0), (0.0, -2e-3), (0.0, 2e-3))  # m, in y and z of the hand: how far off a hand may close
SUGGESTION_POINTS = 4000  # that another side up is tried with first
CONE_SIDES = 8  # of the pyramid inside the friction cone in the linear program


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
        weight_per_squeeze: newtons of weight that friction can carry per newton of thumb force; 2 x friction for a
            perfect level pinch, more where fingers carry from below.
        score: 0 (barely possible) to 1 (as good as can be).
        approach: in words, such as "from above, closing at 30 degrees".
    """

    rotation: FloatArray
    centre: FloatArray
    width: float
    thumb_point: FloatArray
    thumb_normal: FloatArray
    finger_points: FloatArray
    finger_normals: FloatArray
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
    approach: Literal["any", "above", "side"] = "any",
) -> GraspPlan:
    """Chooses how the hand takes an object that keeps its orientation, z up.

    Deterministic: the same points give the same plan.

    Args:
        points: (n, 3) surface points, m.
        normals: (n, 3) outward normals.
        centre_of_mass: (3,) m.
        friction: Coulomb coefficient between pads and object, > 0.
        hand: figures of the hand; default `HandGeometry()`.
        approach: restrict the hand to come from above or from the sides.
        resting: the object stands with its lowest point on a flat support that the hand must not touch.

    Raises:
        GraspPlanError: too large, too small, no opposing sides, or none that the hand can reach.
        InvalidShapeError, InvalidValueError: bad arrays or figures.
    """
    hand = HandGeometry() if hand is None else hand
    cloud, directions, middle = _check_input(points, normals, centre_of_mass)
    check_positive("friction", friction, "-")
    if approach not in ("any", "above", "side"):
        raise UnknownNameError("approach", "any, above or side", repr(approach), "any lets the better one win")
    cloud = cloud - middle
    _check_size(cloud, hand)

    search = Search(cloud, directions, friction, hand, resting, approach)
    candidates = search.candidates()
    if not candidates:
        raise search.explain()
    best: GraspPlan | None = None
    for coarse, rotation, y, z, words in candidates:
        if best is not None and coarse <= best.score:
            break  # sorted, and the fine stage only ever lowers a score
        plan = _place(cloud, directions, rotation, y, z, friction, hand, coarse, words)
        # Rounded, so that noise in the last bits does not choose between equals: the first in a fixed order wins.
        if plan is not None and (best is None or round(plan.score, 6) > round(best.score, 6)):
            best = plan
    if best is None:
        raise GraspPlanError(
            "grasp",
            "three contacts that carry the object's weight by friction",
            f"none among {len(candidates)} candidates",
            "raise the friction, or turn the object (up or rotate of load_object, --up or --rotate)",
        )
    return replace(best, centre=best.centre + middle, thumb_point=best.thumb_point + middle, finger_points=best.finger_points + middle)


def side_up_that_fits(
    points: ArrayLike, normals: ArrayLike, centre_of_mass: ArrayLike = (0.0, 0.0, 0.0), *, friction: float = 0.8
) -> Up | None:
    """Which axis (of the frame of the points) would have to point up for `plan_grasp` to find a grasp, other than z; None if there is none.

    Looked for on some of the points first, which is quick; the one found is tried on all.
    """
    cloud, directions, middle = _check_input(points, normals, centre_of_mass)
    some = slice(None, None, max(1, len(cloud) // SUGGESTION_POINTS))
    for side in SIDES[1:]:
        turn = rotation_of(side).T
        try:
            for chosen in (some, slice(None)):
                plan_grasp(cloud[chosen] @ turn, directions[chosen] @ turn, middle @ turn, friction=friction)
        except GraspPlanError:
            continue
        return side
    return None


def _check_input(points: ArrayLike, normals: ArrayLike, centre_of_mass: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
    checked: list[FloatArray] = []
    for what, value, shape in (("points", points, "(n, 3)"), ("normals", normals, "(n, 3)"), ("centre_of_mass", centre_of_mass, "(3,)")):
        array = real_array(what, value, shape)
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


def _check_size(cloud: FloatArray, hand: HandGeometry) -> None:
    extents = np.ptp(cloud, axis=0)
    if float(np.linalg.norm(extents)) < hand.min_width:
        raise width_error(float(extents.max()), hand)


def _place(
    cloud: FloatArray,
    directions: FloatArray,
    rotation: FloatArray,
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
    touches = _touches(local, facing, y, z, hand)
    if touches is None:
        return None
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
    # A hand never closes quite where it was commanded to: beside the place it must hold too, which edges and rims do not.
    for aside_y, aside_z in MISSES:
        missed = _touches(local, facing, y + aside_y, z + aside_z, hand)
        if missed is None or least <= 0.1 * friction:
            return None
        places, ways = np.stack([touch[1] for touch in missed]), np.stack([touch[2] for touch in missed])
        least = min(least, _carried(places @ rotation.T, ways @ rotation.T, friction, down))
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


def _touches(
    local: FloatArray, facing: FloatArray, y: float, z: float, hand: HandGeometry
) -> list[tuple[float, FloatArray, FloatArray]] | None:
    """`_touch` for the thumb and the two fingers; None if one of them meets nothing."""
    half = 0.5 * hand.finger_spacing
    places = ((-1.0, y), (1.0, y - half), (1.0, y + half))
    touches = [_touch(local, facing, sign, pad_y, z, hand.pad_radius) for sign, pad_y in places]
    found = [touch for touch in touches if touch is not None]
    return found if len(found) == len(places) else None


def _touch(
    local: FloatArray, facing: FloatArray, sign: float, y: float, z: float, radius: float
) -> tuple[float, FloatArray, FloatArray] | None:
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


def _carried(points: FloatArray, normals: FloatArray, friction: float, load: FloatArray) -> float:
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
