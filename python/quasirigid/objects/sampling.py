"""Even (blue-noise) samples of a surface: exactly as many points as asked for, none close to another.

C. Yuksel, Sample Elimination for Generating Poisson Disk Sample Sets, Computer Graphics Forum 34(2), 2015. The greedy loop of the paper
(take out the sample of the largest weight, one at a time) is replaced by rounds that take out every sample whose weight is the largest
in its neighbourhood, the heaviest part of them first. Those do not touch each other, so a round does what the loop would do to them, and a
round is a few array operations.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import cKDTree

from quasirigid.arrays.types import FloatArray, IntArray

OVERSAMPLING = 5
"""Dense samples per wanted point. Fewer than 4 shows as uneven spacing; more costs time for little."""

ROUND_SHARE = 0.3
"""Part of the local maxima that a round takes out, the heaviest. With 1 close pairs in thin places survive (least distance / mean distance
0.007 instead of 0.87 on a sphere); below 0.3 only time is lost."""

OPPOSED = -0.5
"""Samples whose normals have a dot product below this lie on opposite sides of a thin part and do not push each other away."""


def sample_mesh(vertices: FloatArray, faces: IntArray, count: int, rng: np.random.Generator) -> tuple[FloatArray, IntArray, FloatArray]:
    """Samples a triangle mesh evenly.

    Args:
        vertices: (n, 3), m.
        faces: (m, 3).
        count: how many points to return.
        rng: source of chance.

    Returns:
        points (count, 3) in m, the face of each (count,), and its barycentric coordinates there (count, 3).
    """
    triangles = vertices[faces]
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    doubled = np.linalg.norm(cross, axis=1)
    face_normals = cross / np.maximum(doubled, np.finfo(float).tiny)[:, None]
    area = 0.5 * float(doubled.sum())
    dense = OVERSAMPLING * count
    # Stratified along the running sum of areas: every face gets its share to within one sample, which plain chance does not give.
    cumulative = np.cumsum(doubled)
    picks = (np.arange(dense) + rng.random(dense)) / dense * cumulative[-1]
    face = np.minimum(np.searchsorted(cumulative, picks, side="right"), len(faces) - 1)
    # The same numbers, folded, place the sample in its triangle uniformly.
    root, second = np.sqrt(rng.random(dense)), rng.random(dense)
    barycentric = np.stack([1.0 - root, root * (1.0 - second), root * second], axis=1)
    points = np.einsum("ij,ijk->ik", barycentric, triangles[face])
    keep = eliminate(points, face_normals[face], count, area)
    return points[keep], face[keep], barycentric[keep]


def thin_out(points: FloatArray, normals: FloatArray | None, count: int) -> IntArray:
    """Chooses `count` points of a cloud, evenly spread, and returns their positions in the cloud in rising order."""
    area = _area_of_cloud(points)
    if len(points) <= 2 * OVERSAMPLING * count:
        return eliminate(points, normals, count, area)
    dense = _one_per_cell(points, normals, OVERSAMPLING * count, area)
    return dense[eliminate(points[dense], None if normals is None else normals[dense], count, area)]


def has_duplicates(points: FloatArray) -> bool:
    """Whether some of the points (n, 3) are equal. Two different ones are taken for equal with a chance of n^2 / 2^65: then there is
    nothing lost but time.
    """
    bits = np.ascontiguousarray(points + 0.0).view(np.uint64)  # + 0.0: the bits of -0.0 are others
    mixed = bits[:, 0].copy()
    for column in (1, 2):
        mixed *= np.uint64(0x9E3779B97F4A7C15)
        mixed ^= mixed >> np.uint64(29)
        mixed += bits[:, column] * np.uint64(0xBF58476D1CE4E5B9)
    mixed ^= mixed >> np.uint64(32)
    mixed.sort()
    return bool((mixed[1:] == mixed[:-1]).any())


def _area_of_cloud(points: FloatArray) -> float:
    """Area of the surface that a cloud covers evenly, m^2, from the distance to the eighth neighbour of some of its points."""
    some = points[:: max(1, len(points) // AREA_SAMPLE)]
    distances, _ = cKDTree(points).query(some, k=9)
    return len(points) * float(np.median(distances[:, -1])) ** 2 * math.pi / 8.5


def _one_per_cell(points: FloatArray, normals: FloatArray | None, count: int, area: float) -> IntArray:
    """About `count` points or more of a much denser cloud, in rising order: one for each cell of a grid, and for each way that its normals
    look.
    """
    low = points.min(axis=0)
    # A surface at an angle cuts 1.5 times as many cells as one along the grid.
    edge = math.sqrt(1.5 * area / count)
    while True:
        key = np.zeros(len(points), dtype=np.int64)
        for axis in range(3):
            key = (key << 20) | ((points[:, axis] - low[axis]) / edge).astype(np.int64)
        if normals is not None:
            # Both sides of a thin wall stay.
            key = (key << 3) | ((normals > 0.0) @ np.array([1, 2, 4]))
        first = np.sort(np.unique(key, return_index=True)[1])
        if len(first) >= count or len(first) == len(points):
            return first
        edge *= 0.8


AREA_SAMPLE = 4096
"""Points that the area of a cloud is estimated from."""


def eliminate(points: FloatArray, normals: FloatArray | None, count: int, area: float) -> IntArray:
    """Takes out samples until `count` are left, the most crowded first.

    Args:
        points: (m, 3) dense samples, m.
        normals: (m, 3) or None; used only to keep the two sides of thin parts apart.
        count: how many to keep.
        area: of the sampled surface, m^2.

    Returns:
        positions of the kept samples, in rising order, (count,).
    """
    total = len(points)
    if count >= total:
        return np.arange(total)
    # Eq. 4 and 5: r_max is the largest radius at which `count` discs cover the area (hexagonal packing); distances below r_min weigh no
    # more.
    r_max = math.sqrt(area / (2.0 * math.sqrt(3.0) * count))
    r_min = r_max * (1.0 - (count / total) ** 1.5) * 0.65
    pairs = cKDTree(points).query_pairs(2.0 * r_max, output_type="ndarray")
    if normals is not None:
        pairs = pairs[np.einsum("ij,ij->i", normals[pairs[:, 0]], normals[pairs[:, 1]]) > OPPOSED]
    distance = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    # Eq. 3: w_ij = (1 - d_ij / (2 r_max))^8
    share = np.maximum(1.0 - np.maximum(distance, 2.0 * r_min) / (2.0 * r_max), 0.0) ** 8
    first, second = np.ascontiguousarray(pairs[:, 0]), np.ascontiguousarray(pairs[:, 1])

    alive = np.ones(total, dtype=bool)
    left = total
    weight = np.bincount(first, share, total) + np.bincount(second, share, total)
    while left > count:
        # Ties are broken by position, so that exactly one of two equal neighbours goes.
        beaten = np.zeros(total, dtype=bool)
        first_wins = (weight[first] > weight[second]) | ((weight[first] == weight[second]) & (first < second))
        beaten[second[first_wins]] = True
        beaten[first[~first_wins]] = True
        out = np.flatnonzero(alive & ~beaten)
        quota = min(max(int(len(out) * ROUND_SHARE), 1), left - count)
        if len(out) > quota:
            out = out[np.argsort(-weight[out], kind="stable")[:quota]]
        alive[out] = False
        left -= len(out)
        stays = alive[first] & alive[second]
        gone = ~stays
        weight -= np.bincount(first[gone], share[gone], total) + np.bincount(second[gone], share[gone], total)
        first, second, share = first[stays], second[stays], share[stays]
    return np.flatnonzero(alive)
