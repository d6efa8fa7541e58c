"""Meshes of soft bodies bonded to something rigid at their back: layers, and tips that are halves of ellipsoids. Lengths in m.

A disc of radius a on the surface is what is pressed. Under its rim the stress is infinite where the disc is a stamp, so elements shrink
towards it, by a constant ratio, down to a thousandth of a: then what the last element misses of the energy is of that order.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from elements import Array, Mesh


@dataclass(frozen=True)
class Fineness:
    """How fine a mesh is."""

    smallest: float = 1e-3
    """Size of the elements at the rim of the disc, of its radius."""
    ratio: float = 1.7
    """Of the sizes of one element and the next."""
    across: int = 6
    """Elements across the radius of the disc, or the depth of the body, where they are largest."""
    reach: float = 10.0
    """A layer ends so many thicknesses beyond the disc, where its edge is left free: what is pressed decays as exp(-0.74 r/h) or faster."""


COARSE = Fineness(4e-3, 2.0, 4, 8.0)


def steps(length: float, smallest: float, ratio: float, largest: float) -> Array:
    """Coordinates from 0 to ``length``: steps that grow by ``ratio`` from ``smallest`` to ``largest``, all scaled to end there."""
    sizes = [smallest]
    while sum(sizes) < length:
        sizes.append(min(sizes[-1] * ratio, largest))
    ends = np.concatenate([[0.0], np.cumsum(sizes)])
    return np.asarray(ends * (length / ends[-1]))


def with_middles(ends: Array) -> Array:
    """Ends of elements and their middles."""
    both = np.empty(2 * len(ends) - 1)
    both[::2] = ends
    both[1::2] = (ends[1:] + ends[:-1]) / 2
    return both


def about(rim: float, end: float, smallest: float, ratio: float, within: float, beyond: float) -> Array:
    """Coordinates from 0 to ``end`` that close up at ``rim``, from steps of at most ``within`` inside and ``beyond`` outside."""
    inside = rim - steps(rim, smallest, ratio, within)[::-1]
    return np.concatenate([inside, rim + steps(end - rim, smallest, ratio, beyond)[1:]])


def layer(thickness: float, a: float, fine: Fineness) -> Mesh:
    """A layer from z = -thickness (bonded) to z = 0, with a rim at r = a. Its outer edge is free."""
    first = fine.smallest * min(a, thickness)
    largest = thickness / fine.across
    r = about(a, a + fine.reach * thickness, first, fine.ratio, min(a / fine.across, 2 * largest), 4 * largest)
    z = -steps(thickness, first, fine.ratio, largest)[::-1]
    return Mesh(*np.meshgrid(with_middles(r), with_middles(z), indexing="ij"))


def tip(radius: float, height: float, a: float, fine: Fineness) -> Mesh:
    """Half an ellipsoid about the axis, r^2/radius^2 + z^2/height^2 <= 1 and z >= 0, bonded at z = 0.

    It has a rim at r = a < radius / sqrt 2.

    The square 0 <= s, t <= 1 goes to the quarter of the ellipse by r = radius s sqrt(1 - t^2/2), z = height t sqrt(1 - s^2/2), its upper
    and right side both to the surface. Only the upper one is the last column of nodes; nothing touches the other.
    """
    rim = np.sqrt(2) * a / radius
    first = fine.smallest * rim
    s = with_middles(about(rim, 1.0, first, fine.ratio, rim / fine.across, 1 / fine.across))
    t = with_middles(1 - steps(1.0, first * radius / (np.sqrt(2) * height), fine.ratio, 1 / fine.across)[::-1])
    s, t = np.meshgrid(s, t, indexing="ij")
    return Mesh(radius * s * np.sqrt(1 - t**2 / 2), height * t * np.sqrt(1 - s**2 / 2))
