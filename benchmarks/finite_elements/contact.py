"""Something rigid pressed on a soft body without friction, and the stiffness of the patch where they touch.

Two ways to the contact radius. `Curve` finds it as the one that makes the force greatest: of all discs that could be pressed by the shape
of the indenter to a given depth, the one without tension and without overlap does (J. R. Barber, Determining the contact area in elastic
indentation problems, Journal of Strain Analysis 9, 1974). The rim of the mesh is then at the rim of the contact, so errors are small.
`active_set` takes pressures that are constant on each ring of a mesh, and closes and opens rings until none pulls and none overlaps;
coarser, and with no theorem in it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from elements import Array, Mesh, rings, stiffness, supported
from scipy import sparse
from scipy.optimize import minimize_scalar
from scipy.sparse import linalg

Gap = Callable[[Array], Array]
"""Distance (m) of the indenter from the surface at the distance r (m) from the axis, where they touch in one point."""


@dataclass(frozen=True)
class Soft:
    """Linear elastic."""

    young_modulus: float
    """Pa."""
    poisson_ratio: float


def ball(radius: float) -> Gap:
    """A rigid ball on a flat surface."""
    return lambda r: radius - np.sqrt(radius**2 - r**2)


def plane_on_tip(radius: float, height: float) -> Gap:
    """A rigid plane on half an ellipsoid about the axis."""
    return lambda r: height * (1 - np.sqrt(1 - (r / radius) ** 2))


def _moved(K: sparse.csc_matrix, held: npt.NDArray[np.bool_], u: Array) -> Array:
    """Displacements in equilibrium: those of ``u`` (unknowns, k) where ``held``, no force elsewhere."""
    free = ~held
    u = np.where(held[:, None], u, 0.0)
    u[free] = linalg.spsolve(K[free][:, free], -(K @ u)[free].reshape(free.sum(), -1)).reshape(free.sum(), -1)
    return u


def _rim(mesh: Mesh, a: float) -> int:
    """Number of elements of the surface within r = a."""
    k = int(np.argmin(abs(mesh.surface_r[::2] - a)))
    if abs(mesh.surface_r[2 * k] - a) > 1e-9 * a:
        raise ValueError(f"the mesh has no node at the rim, r = {a:g} m, but at {mesh.surface_r[2 * k]:g} m")
    return k


def stamped(mesh: Mesh, soft: Soft, a: float, shapes: list[Gap]) -> tuple[Array, Array, Array]:
    """The disc r <= a of the surface pushed along the axis, free to slide: by 1 m (flat), and by each of ``shapes``.

    Returns forces (1 + shapes,) N, the pressures (nodes within a, 1 + shapes) Pa, and the displacements of the whole surface (nodes, 1 +
    shapes) m into the body.
    """
    K = stiffness(mesh, soft.young_modulus, soft.poisson_ratio, 0)
    edges = _rim(mesh, a)
    nodes = mesh.surface[: 2 * edges + 1]
    r = mesh.surface_r[: 2 * edges + 1]
    held, u = supported(mesh, 0).ravel(), np.zeros((K.shape[0], 1 + len(shapes)))
    held[3 * nodes + 2] = True
    u[3 * nodes + 2] = -np.stack([np.ones_like(r), *(shape(r) for shape in shapes)], axis=1)
    u = _moved(K, held, u)
    force = -(K[3 * nodes + 2] @ u)
    pressure = np.linalg.solve(rings(mesh, edges)[0], force)
    return force.sum(axis=0), pressure, -u[3 * mesh.surface + 2]


def shear_stiffness(mesh: Mesh, soft: Soft, a: float, *, level: bool) -> float:
    """Force (N) along x that moves the disc r <= a of the surface by 1 m along x. ``level``: its points stay in their plane, as if bonded
    to a stamp that is not to tilt; else they are free to rise and sink.
    """
    K = stiffness(mesh, soft.young_modulus, soft.poisson_ratio, 1)
    nodes = mesh.surface[: 2 * _rim(mesh, a) + 1]
    held, u = supported(mesh, 1).ravel(), np.zeros((K.shape[0], 1))
    held[3 * nodes] = held[3 * nodes + 1] = True
    u[3 * nodes], u[3 * nodes + 1] = 1.0, -1.0  # u_x = 1: u_r = cos phi, u_phi = -sin phi
    if level:
        held[3 * nodes + 2] = True
    u = _moved(K, held, u)
    return float((u * (K @ u)).sum())


@dataclass(frozen=True)
class Press:
    """An indenter pressed to a depth."""

    force: float
    """F, N."""
    radius: float
    """Of the contact, a, m."""
    stiffness: float
    """dF/dd, N/m: by how much the force grows with the depth, the contact growing along."""


class Curve:
    """Force over depth of one indenter, from stamps of radii between ``smallest`` and ``largest`` (m), on a mesh each.

    At a depth d a disc of radius a that is pressed to the shape of the indenter carries F(a) = d k(a) - G(a), with k the stiffness of the
    flat stamp and G the force of a stamp of the shape of the gap. Both are smooth in a, so Chebyshev polynomials through ``count`` radii
    give them (of their logarithms, in that of a).
    """

    def __init__(self, mesh: Callable[[float], Mesh], soft: Soft, gap: Gap, smallest: float, largest: float, count: int) -> None:
        x = np.cos(np.pi * (np.arange(count) + 0.5) / count)
        self.range = np.log([smallest, largest])
        radii = np.exp(self.range.mean() + x * np.ptp(self.range) / 2)
        forces = np.array([stamped(mesh(a), soft, a, [gap])[0] for a in radii])
        self._fit = np.polynomial.chebyshev.chebfit(x, np.log(forces), count - 1)

    def stamps(self, log_a: float) -> Array:
        """k (N/m) and G (N) at a radius, given by its logarithm."""
        x = (log_a - self.range.mean()) / (np.ptp(self.range) / 2)
        return np.exp(np.polynomial.chebyshev.chebval(x, self._fit))

    def press(self, depth: float) -> Press:
        """At a depth (m). Raises ``ValueError`` where the contact radius is not between the smallest and the largest."""
        found = minimize_scalar(lambda x: -(self.stamps(x) @ (depth, -1.0)), bounds=self.range, method="bounded", options={"xatol": 1e-9})
        if min(abs(found.x - self.range)) < 1e-3:
            raise ValueError(
                f"no contact radius between {np.exp(self.range[0]):g} and {np.exp(self.range[1]):g} m at a depth of {depth:g} m"
            )
        return Press(-float(found.fun), float(np.exp(found.x)), float(self.stamps(found.x)[0]))


@dataclass(frozen=True)
class Touch:
    """What a contact is like, and how far it is from what contact without friction and adhesion asks for (Signorini's conditions)."""

    peak: float
    """Pressure on the axis, p0, Pa."""
    flat_stiffness: float
    """Of the disc within the contact radius, as a flat stamp that is free to slide, k_n, N/m. It is dF/dd too."""

    tension: float
    """Largest pull on the disc, within 0.98 a, as a share of the largest pressure."""
    overlap: float
    """Deepest overlap beyond the disc, as a share of the depth."""


def checked(mesh: Mesh, soft: Soft, gap: Gap, depth: float, a: float) -> Touch:
    """Pressures and gaps of an indenter at ``depth`` that touches within ``a``, on a mesh with its rim there."""
    force, pressure, sunk = stamped(mesh, soft, a, [gap])
    p, w, r = pressure @ (depth, -1.0), sunk @ (depth, -1.0), mesh.surface_r
    inner = r[: len(p)] < 0.98 * a
    # The node on the axis has next to no area. A contact has p = sqrt(1 - r^2/a^2) times something smooth and even, whose value on the axis
    # is asked for.
    x = np.minimum(r[: len(p)] / a, 1) ** 2
    even = np.sqrt(1 - x)[:, None] * x[:, None] ** np.arange(5)
    mass = rings(mesh, len(p) // 2)[0]
    peak = float(np.linalg.solve(even.T @ mass @ even, even.T @ mass @ p)[0])
    beyond = (r > a) & (r < 3 * a) & (gap(np.minimum(r, 3 * a)) < 2 * depth)
    overlap = float(np.max(depth - gap(r[beyond]) - w[beyond], initial=0.0))
    return Touch(peak, float(force[0]), max(0.0, -float(p[inner].min())) / peak, overlap / depth)


def active_set(mesh: Mesh, soft: Soft, gap: Gap, depth: float, edges: int) -> tuple[Array, Array]:
    """Pressures (edges,) Pa on the first ``edges`` elements of the surface, each constant on its ring, and the areas (edges,) m^2 of the
    rings.

    On every ring either the pressure is 0 and the indenter does not overlap on average, or it is positive and they touch on average.
    """
    K = stiffness(mesh, soft.young_modulus, soft.poisson_ratio, 0)
    nodes, loads = 3 * mesh.surface[: 2 * edges + 1] + 2, rings(mesh, edges)[1]
    free = ~supported(mesh, 0).ravel()
    force = np.zeros((K.shape[0], edges))
    force[nodes] = loads
    u = np.zeros_like(force)
    u[free] = linalg.splu(K[free][:, free]).solve(force[free])
    area = loads.sum(axis=0)
    sinking = (loads.T @ u[nodes]) / area[:, None]  # mean over a ring, m/Pa
    apart = loads.T @ gap(mesh.surface_r[: 2 * edges + 1]) / area
    closed = apart < depth
    for _ in range(100):
        pressure = np.zeros(edges)
        pressure[closed] = np.linalg.solve(sinking[np.ix_(closed, closed)], depth - apart[closed])
        overlap = depth - apart - sinking @ pressure
        change = np.where(closed, pressure > 0, overlap > 1e-12 * depth)
        if (change == closed).all():
            return pressure, area
        closed = change
    raise RuntimeError("the rings that touch do not settle after 100 rounds")
