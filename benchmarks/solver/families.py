"""Contact problems made up on the spot, with fixed seeds: problems that exist, changed at random, and rigid scenes in which nothing gives.

What is made here has not been seen when the solver was built: ``holdout.py`` solves it.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

Array = np.ndarray[Any, np.dtype[np.float64]]


class Problem(NamedTuple):
    """``u = W r + q`` in contact frames (normal, tangent1, tangent2), friction ``mu``."""

    W: Any
    q: Array
    mu: Array


# --- problems that exist, changed ---------------------------------------------------------------------------------------------


def rows_of(contacts: Array) -> Array:
    """Rows of these contacts, three each."""
    return np.asarray((3 * np.asarray(contacts)[:, None] + np.arange(3)).ravel())


def other_friction(p: Problem, rng: np.random.Generator) -> Problem:
    """All coefficients by one factor, or each by its own."""
    factor = np.exp(rng.uniform(-1.5, 0.8)) if rng.random() < 0.5 else np.exp(rng.uniform(-1, 0.5, len(p.mu)))
    return p._replace(mu=np.minimum(p.mu * factor, 1.5))


def other_velocities(p: Problem, rng: np.random.Generator) -> Problem:
    """What random forces at the contacts would add to ``q``: a change that the bodies can make, in the range of ``W``."""
    push = p.W @ rng.normal(size=len(p.q))
    share = 10 ** rng.uniform(-3, 0)
    return p._replace(q=p.q + share * push * np.linalg.norm(p.q) / max(np.linalg.norm(push), 1e-300))


def fewer_contacts(p: Problem, rng: np.random.Generator) -> Problem:
    """Some contacts gone."""
    n = len(p.mu)
    kept = np.sort(rng.permutation(n)[: max(1, int(n * rng.uniform(0.5, 0.95)))])
    return Problem(p.W[rows_of(kept)][:, rows_of(kept)], p.q[rows_of(kept)], p.mu[kept])


def repeated_contacts(p: Problem, rng: np.random.Generator) -> Problem:
    """Some contacts twice: forces that nothing tells apart."""
    n = len(p.mu)
    all_ = np.concatenate([np.arange(n), rng.integers(0, n, max(1, n // 10))])
    return Problem(p.W[rows_of(all_)][:, rows_of(all_)], p.q[rows_of(all_)], p.mu[all_])


def turned(p: Problem, rng: np.random.Generator) -> Problem:
    """Other tangents and another order."""
    n = len(p.mu)
    angle = rng.uniform(0, 2 * np.pi, n)
    blocks = np.zeros((n, 3, 3))
    blocks[:, 0, 0] = 1
    blocks[:, 1, 1] = blocks[:, 2, 2] = np.cos(angle)
    blocks[:, 2, 1] = np.sin(angle)
    blocks[:, 1, 2] = -blocks[:, 2, 1]
    turn = sp.bsr_array((blocks, np.arange(n), np.arange(n + 1)), shape=(3 * n, 3 * n)).tocsr()
    order = rng.permutation(n)
    return Problem((turn @ p.W @ turn.T).tocsr()[rows_of(order)][:, rows_of(order)], (turn @ p.q)[rows_of(order)], p.mu[order])


def other_units(p: Problem, rng: np.random.Generator) -> Problem:
    """Forces in another unit, by at most a thousand."""
    return p._replace(W=p.W * 10 ** rng.uniform(-3, 3))


CHANGES = (other_friction, other_velocities, fewer_contacts, repeated_contacts, turned, other_units)


def changed(p: Problem, seed: int) -> Problem:
    """One to three changes, drawn by the seed."""
    rng = np.random.default_rng(seed)
    p = p._replace(W=sp.csr_array(p.W))
    for k in rng.permutation(len(CHANGES))[: rng.integers(1, 4)]:
        p = CHANGES[k](p, rng)
    return p


# --- rigid scenes ---------------------------------------------------------------------------------------------------------------


class Boxes:
    """Boxes with sides along the axes: centres and half sides, (n, 3). Contacts are the corners of the faces that two of them share; the ground is z = 0."""

    def __init__(self, centres: Any, halves: Any) -> None:
        self.centres = np.asarray(centres, dtype=float)
        self.halves = np.broadcast_to(np.asarray(halves, dtype=float), self.centres.shape)

    def contacts(self) -> Iterator[tuple[int, int, Array, Array]]:
        """First body, second (-1: the ground), point, normal from the second to the first."""
        low, high = self.centres - self.halves, self.centres + self.halves
        for i in np.flatnonzero(np.abs(low[:, 2]) < 1e-9):
            for x in (low[i, 0], high[i, 0]):
                for y in (low[i, 1], high[i, 1]):
                    yield i, -1, np.array([x, y, 0.0]), np.array([0, 0, 1.0])
        for i, j in combinations(range(len(low)), 2):
            begin, end = np.maximum(low[i], low[j]), np.minimum(high[i], high[j])
            thin = np.abs(end - begin) < 1e-9
            if thin.sum() != 1 or (end - begin)[~thin].min() < 1e-6:
                continue
            axis = int(np.argmax(thin))
            normal = np.zeros(3)
            normal[axis] = np.sign(self.centres[i, axis] - self.centres[j, axis])
            one, two = (k for k in range(3) if k != axis)
            for a in (begin[one], end[one]):
                for b in (begin[two], end[two]):
                    point = begin.copy()
                    point[one], point[two] = a, b
                    yield i, j, point, normal

    def masses(self) -> tuple[Array, Array]:
        """Masses and principal moments, density 1."""
        mass = 8 * self.halves.prod(axis=1)
        squares = self.halves**2
        return mass, mass[:, None] / 3 * (squares.sum(axis=1, keepdims=True) - squares)


class Balls:
    """Balls: centres (n, 3) and radii (n,). Those that nearly touch are in contact; the ground is z = 0."""

    def __init__(self, centres: Array, radii: Array) -> None:
        self.centres, self.radii = centres, radii

    def contacts(self) -> Iterator[tuple[int, int, Array, Array]]:
        """As for ``Boxes``."""
        for i in np.flatnonzero(self.centres[:, 2] - self.radii < 1e-3):
            yield i, -1, self.centres[i] * [1, 1, 0], np.array([0, 0, 1.0])
        for i, j in combinations(range(len(self.radii)), 2):
            apart = self.centres[i] - self.centres[j]
            distance = float(np.linalg.norm(apart))
            if 0 < distance < self.radii[i] + self.radii[j] + 1e-3:
                yield i, j, self.centres[j] + apart * self.radii[j] / (self.radii[i] + self.radii[j]), apart / distance

    def masses(self) -> tuple[Array, Array]:
        """Masses and principal moments, density 1."""
        mass = 4 / 3 * np.pi * self.radii**3
        return mass, np.repeat((0.4 * mass * self.radii**2)[:, None], 3, axis=1)


def assemble(bodies: Boxes | Balls, velocities: Array, mu: float, rng: np.random.Generator) -> Problem:
    """``W = H M^-1 H^T`` and ``q = H v`` for free velocities ``v`` (n, 6)."""
    mass, moments = bodies.masses()
    inverse = np.hstack([np.repeat(1 / mass[:, None], 3, axis=1), 1 / moments]).ravel()
    entries: list[Array] = []
    rows: list[Array] = []
    columns: list[Array] = []
    count = 0
    for i, j, point, normal in bodies.contacts():
        helper = rng.normal(size=3)
        first = np.cross(normal, helper) / np.linalg.norm(np.cross(normal, helper))
        frame = np.array([normal, first, np.cross(normal, first)])
        for body, sign in ((i, 1.0), (j, -1.0)):
            if body >= 0:
                x, y, z = point - bodies.centres[body]
                entries.append(sign * frame @ np.hstack([np.eye(3), [[0, z, -y], [-z, 0, x], [y, -x, 0]]]))
                rows.append(np.repeat(3 * count + np.arange(3), 6))
                columns.append(np.tile(6 * body + np.arange(6), 3))
        count += 1
    places = (np.concatenate(rows), np.concatenate(columns))
    H = sp.coo_array((np.concatenate([e.ravel() for e in entries]), places), shape=(3 * count, velocities.size)).tocsr()
    return Problem((H @ sp.diags_array(inverse) @ H.T).tocsr(), H @ velocities.ravel(), np.full(count, mu))


def free_velocities(count: int, rng: np.random.Generator) -> Array:
    """Falling, with some motion of each body and a blow on one of them."""
    v = 10 ** rng.uniform(-4, -1) * rng.normal(size=(count, 6))
    v[:, 2] -= 0.05
    v[rng.integers(count), :2] += rng.choice([0, 0.05, 0.5]) * rng.normal(size=2)
    return np.asarray(v)


def stack(rng: np.random.Generator) -> Boxes:
    """Boxes one on another, of sizes of their own."""
    levels = rng.integers(2, 16)
    halves = rng.uniform(0.3, 1, (levels, 3))
    z = np.cumsum(2 * halves[:, 2]) - halves[:, 2]
    return Boxes(np.column_stack([0.1 * rng.normal(size=(levels, 2)), z]), halves)


def wall(rng: np.random.Generator) -> Boxes:
    """Bricks in courses, each over the joint of two."""
    courses, bricks = rng.integers(2, 9), rng.integers(2, 9)
    centres = [(2 * k + (level % 2), 0, 0.5 + level) for level in range(courses) for k in range(bricks)]
    return Boxes(centres, (1, 0.5, 0.5))


def tower(rng: np.random.Generator) -> Boxes:
    """Planks in layers crosswise: three supports where two would do."""
    layers, planks = rng.integers(2, 16), rng.integers(2, 5)
    centres, halves = [], []
    for layer in range(layers):
        for place in np.linspace(-1.2, 1.2, planks):
            along = layer % 2 == 0
            centres.append((0 if along else place, place if along else 0, 0.1 + 0.2 * layer))
            halves.append((1.5, 0.2, 0.1) if along else (0.2, 1.5, 0.1))
    return Boxes(centres, halves)


def bridge(rng: np.random.Generator) -> Boxes:
    """Two piers, a beam across, a load on it, and blocks wedged between."""
    height, between = rng.integers(1, 6), rng.integers(1, 6)
    centres = [(side, 0, 0.5 + level) for side in (-2.5 - 0.5 * between, 2.5 + 0.5 * between) for level in range(height)]
    halves = [(0.5, 0.5, 0.5)] * len(centres)
    span = 3 + 0.5 * between
    centres += [(0, 0, height + 0.25), (0, 0, height + 1)]
    halves += [(span, 0.5, 0.25), (0.5, 0.5, 0.5)]
    width = (2 * span - 2) / (2 * between)
    for k in range(between):
        centres.append((-span + 1 + width * (2 * k + 1), 0, 0.5))
        halves.append((width, 0.5, 0.5))
    return Boxes(centres, halves)


def heap(rng: np.random.Generator) -> Balls:
    """Balls in close layers, some missing."""
    side, layers = rng.integers(2, 7), rng.integers(1, 6)
    step = 2 / np.sqrt(2)
    centres = [
        (2 * a + layer % 2, 2 * b + layer % 2, 1 + step * layer) for layer in range(layers) for a in range(side) for b in range(side)
    ]
    kept = np.array(centres)[rng.random(len(centres)) < 0.9]
    return Balls(kept if len(kept) else np.array(centres), np.ones(max(len(kept), 1) if len(kept) else len(centres)))


SCENES = {"stack": stack, "wall": wall, "tower": tower, "bridge": bridge, "heap": heap}


def rigid(kind: str, seed: int) -> Problem:
    """A rigid scene of this kind."""
    rng = np.random.default_rng([seed, list(SCENES).index(kind)])
    bodies = SCENES[kind](rng)
    return assemble(bodies, free_velocities(len(bodies.centres), rng), float(rng.choice([0.1, 0.3, 0.5, 0.8])), rng)
