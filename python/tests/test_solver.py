"""`solve_contacts` against closed forms, an independent residual, and problems from elsewhere; problems recorded from a world."""

import os
import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from elsewhere import DATA, missing

import quasirigid as qr
from quasirigid.arrays.types import FloatArray

RECORDED = sorted((Path(__file__).parent / "contact_problems").glob("*.npz"))
PUBLIC = DATA / "fc3d"
PUBLIC_FILES = sorted(PUBLIC.glob("*.npz"))
NAN = float("nan")


def project(x: FloatArray, mu: float) -> FloatArray:
    """Nearest point of the cone, by cases; slow and plain."""
    tangent = float(np.hypot(x[1], x[2]))
    if tangent <= mu * x[0]:
        return x
    if mu * tangent <= -x[0]:
        return np.zeros(3)
    normal = (x[0] + mu * tangent) / (1 + mu**2)
    return np.array([normal, *(mu * normal * x[1:] / tangent)])


def residual(W: Any, q: FloatArray, mu: FloatArray, r: FloatArray) -> float:
    """What `tolerance` means, written out once more."""
    u = W @ r + q
    error = 0.0
    for i, m in enumerate(mu):
        ui, ri = u[3 * i : 3 * i + 3], r[3 * i : 3 * i + 3]
        shifted = ui + np.array([m * np.hypot(ui[1], ui[2]), 0, 0])
        error += float(np.sum((ri - project(ri - shifted, m)) ** 2))
    return np.sqrt(error) / max(np.linalg.norm(q), np.linalg.norm(r), np.linalg.norm(u))


def assert_solved(W: Any, q: FloatArray, mu: FloatArray, solution: qr.ContactSolution, tolerance: float = 1e-8) -> None:
    assert solution.converged, solution
    found = residual(W, q, mu, solution.reactions)
    assert found <= tolerance * 1.001, f"{found:.2e} for {solution}"
    assert solution.residual == pytest.approx(found, rel=1e-3, abs=1e-14)
    np.testing.assert_allclose(
        solution.velocities, W @ solution.reactions + q, atol=1e-12 * np.abs(W).max() * np.abs(solution.reactions).max()
    )
    r = solution.reactions.reshape(-1, 3)
    assert (r[:, 0] >= 0).all()
    assert (np.hypot(r[:, 1], r[:, 2]) <= mu * r[:, 0] * (1 + 1e-12)).all()


def turned(W: FloatArray, q: FloatArray, mu: FloatArray, seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The same problem with other tangents and another order of contacts."""
    rng, n = np.random.default_rng(seed), len(mu)
    blocks = []
    for angle in rng.uniform(0, 2 * np.pi, n):
        c, s = np.cos(angle), np.sin(angle)
        blocks.append(np.array([[1, 0, 0], [0, c, -s], [0, s, c]]))
    turn = sp.block_diag(blocks).toarray()
    order = rng.permutation(n)
    rows = (3 * order[:, None] + np.arange(3)).ravel()
    return (turn @ W @ turn.T)[np.ix_(rows, rows)], (turn @ q)[rows], mu[order]


def rigid_stack(levels: int, side: int, mu: float, push: float, seed: int = 0) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Rigid boxes on a table, `side**2` contacts between each two: many more forces than coordinates, and nothing gives.

    The topmost box is pushed sideways; each has some spin besides, so that some contacts slide.
    """
    rng, half, mass = np.random.default_rng(seed), 0.5, 1.0
    inverse = np.diag(np.tile([1 / mass] * 3 + [6 / (mass * 4 * half**2)] * 3, levels))
    velocity = np.tile([0, 0, -0.1, 0, 0, 0], levels) + 0.02 * rng.normal(size=6 * levels)
    velocity[-6] += push
    rows = []
    for level in range(levels):
        for k in range(side**2):
            place = np.array([2 * half * (k % side) / (side - 1) - half, 2 * half * (k // side) / (side - 1) - half])
            upper, lower = np.zeros((3, 6 * levels)), np.zeros((3, 6 * levels))
            for box, z, rows_of in ((level, -half, upper), (level - 1, half, lower)):
                if box >= 0:
                    x, y = place
                    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
                    rows_of[:, 6 * box : 6 * box + 6] = np.hstack([np.eye(3), -skew])
            rows.append((upper - lower)[[2, 0, 1]])
    H = np.vstack(rows)
    return H @ inverse @ H.T, H @ velocity, np.full(levels * side**2, mu)


# --- one contact, in closed form --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("q", "reactions", "status"),
    [
        ([0.1, 1.0, 0.0], [0.0, 0.0, 0.0], qr.ContactStatus.Open),
        ([-2.0, 0.6, 0.8], [1.0, -0.3, -0.4], qr.ContactStatus.Stick),
        ([-2.0, 3.0, 4.0], [1.0, -0.36, -0.48], qr.ContactStatus.Slip),
    ],
)
def test_one_contact_has_the_reaction_of_the_closed_form(q: list[float], reactions: list[float], status: int) -> None:
    solution = qr.solve_contacts(2 * np.eye(3), q, [0.6])
    np.testing.assert_allclose(solution.reactions, reactions, atol=1e-15)
    assert solution.status.tolist() == [status]
    assert solution.converged
    assert solution.stop_reason == "converged"
    assert solution.asymmetry == 0
    assert len(solution) == 1


def test_no_contact_is_a_problem_too() -> None:
    solution = qr.solve_contacts(np.zeros((0, 0)), [], [])
    assert solution.converged
    assert solution.reactions.shape == (0,)


# --- problems recorded from worlds, stacks without any give, problems from elsewhere ----------------------------------------


@pytest.mark.parametrize("path", RECORDED, ids=lambda path: path.stem)
def test_recorded_problems_are_solved(path: Path) -> None:
    problem = qr.ContactProblem.load(path)
    W, q, mu = problem.W, problem.q, problem.mu
    assert_solved(W, q, mu, problem.solve())
    # In units in which forces and velocities are of one size the residual is as strict for both.
    W, q = W / (np.trace(W) / len(W)), q / np.linalg.norm(q)
    assert_solved(W, q, mu, qr.solve_contacts(W, q, mu))
    W, q, mu = turned(W, q, mu, seed=1)
    assert_solved(W, q, mu, qr.solve_contacts(W, q, mu))


@pytest.mark.parametrize("levels", [1, 2, 4])
@pytest.mark.parametrize("side", [2, 4])
@pytest.mark.parametrize("push", [0.0, 0.05, 0.3])
def test_rigid_stacks_are_solved(levels: int, side: int, push: float) -> None:
    for seed in range(4):
        W, q, mu = rigid_stack(levels, side, mu=0.2 + 0.2 * seed, push=push, seed=seed)
        assert np.linalg.matrix_rank(W) <= 6 * levels < len(q)
        assert_solved(W, q, mu, qr.solve_contacts(W, q, mu))


@pytest.mark.parametrize("scene", ["stack", "wall", "tower", "bridge", "heap"])
@pytest.mark.parametrize("seed", [0, 1])
def test_rigid_scenes_are_solved(scene: str, seed: int) -> None:
    folder = str(Path(__file__).resolve().parents[2] / "benchmarks" / "solver")
    sys.path.insert(0, folder)
    try:
        from families import rigid
    finally:
        sys.path.remove(folder)
    W, q, mu = rigid(scene, seed)
    assert_solved(W, q, mu, qr.solve_contacts(W, q, mu))


@pytest.fixture(scope="module")
def public() -> ModuleType:
    """The residual that comes with the public problems."""
    if not PUBLIC_FILES:
        pytest.skip(missing("fc3d/*.npz, the public problems"))
    sys.path.insert(0, str(PUBLIC))
    import residual as module

    return module


@pytest.mark.skipif(not PUBLIC_FILES, reason=missing("fc3d/*.npz, the public problems"))
@pytest.mark.parametrize("path", PUBLIC_FILES or [Path("missing")], ids=lambda path: path.stem)
def test_public_problems_are_solved(path: Path, public: ModuleType) -> None:
    W, q, mu = public.load(path)
    solution = qr.solve_contacts(W, q, mu)
    found = public.natural_map_error(W, q, mu, solution.reactions)
    assert solution.converged, solution
    assert found <= 1e-8, f"{found:.2e}"
    assert solution.residual == pytest.approx(found, rel=1e-3, abs=1e-13)
    dense = W.toarray() if sp.issparse(W) else W
    if len(mu) <= 100:
        for seed in range(3):
            other = turned(dense, q, mu, seed)
            assert public.natural_map_error(*other, qr.solve_contacts(*other).reactions) <= 1e-8


# --- the form of W ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "form", [sp.csr_array, sp.csc_matrix, sp.coo_array, sp.bsr_array, lambda W: sp.bsr_array(W, blocksize=(3, 3)), np.asfortranarray]
)
def test_sparse_and_dense_give_the_same_bits(form: Callable[[FloatArray], Any]) -> None:
    W, q, mu = rigid_stack(3, 2, mu=0.5, push=0.1)
    expected, got = qr.solve_contacts(W, q, mu), qr.solve_contacts(form(W), q, mu)
    assert got.reactions.tolist() == expected.reactions.tolist()
    assert (got.sweeps, got.residual) == (expected.sweeps, expected.residual)


def test_unordered_and_repeated_entries_of_a_sparse_matrix_are_added_up() -> None:
    blocks = np.array([np.eye(3), 0.1 * np.eye(3), 2 * np.eye(3), 0.1 * np.eye(3)])
    W = sp.bsr_array((blocks, [1, 0, 0, 1], [0, 3, 4]), shape=(6, 6))
    W.has_canonical_format = False
    before = W.toarray()
    q, mu = np.array([-1.0, 0.1, 0, -1, 0, 0.1]), np.array([0.5, 0.5])
    with pytest.raises(qr.InvalidValueError):
        qr.solve_contacts(sp.bsr_array((blocks[:1], [1], [0, 1, 1]), shape=(6, 6)), q, mu)
    assert qr.solve_contacts(W, q, mu).reactions.tolist() == qr.solve_contacts(before, q, mu).reactions.tolist()
    assert (W.toarray() == before).all()


def test_numbers_of_any_kind_and_layout_are_read_alike() -> None:
    W, q, mu = rigid_stack(2, 2, mu=0.5, push=0.1)
    W, q = np.round(64 * W) / 64 + np.eye(len(W)), np.round(64 * q) / 64  # exact in single precision
    expected = qr.solve_contacts(W, q, mu).reactions.tolist()
    wide = np.zeros((2 * len(W), 2 * len(W)))
    wide[::2, ::2] = W
    for same in (W.astype(np.float32), wide[::2, ::2], W.tolist(), sp.csc_array(W.astype(np.float32)), np.asfortranarray(W)):
        assert qr.solve_contacts(same, q, mu).reactions.tolist() == expected, type(same)
    twice = np.repeat(q, 2)
    for same in (q.astype(np.float32), twice[::2], q.tolist()):
        assert qr.solve_contacts(W, same, mu).reactions.tolist() == expected
    coo = sp.coo_array(W)
    doubled = sp.coo_array((np.tile(coo.data / 2, 2), (np.tile(coo.row, 2), np.tile(coo.col, 2))), shape=W.shape)
    assert qr.solve_contacts(doubled, q, mu).reactions.tolist() == expected


def test_a_solution_says_in_a_line_what_it_is() -> None:
    W, q, mu = rigid_stack(2, 2, mu=0.5, push=0.1)
    solution = qr.solve_contacts(W, q, mu)
    assert repr(solution).startswith("ContactSolution(8 contacts, converged, residual=")
    assert f"sweeps={solution.sweeps})" in repr(solution)


def test_asymmetry_is_measured_and_left_alone() -> None:
    W, q, mu = rigid_stack(2, 2, mu=0.5, push=0.1)
    W += 0.1 * np.eye(len(W))
    W[0, 5] += 1e-3 * np.abs(W).max()
    solution = qr.solve_contacts(W, q, mu)
    assert solution.asymmetry == pytest.approx(1e-3, rel=1e-6)
    assert_solved(W, q, mu, solution)


# --- what may be asked for --------------------------------------------------------------------------------------------------


def test_caps_and_budgets_are_kept_and_reported() -> None:
    W, q, mu = rigid_stack(4, 4, mu=0.5, push=0.1)
    # Below what rounding allows: it never converges.
    for cap in (1, 5, 50, 80, 300):
        capped = qr.solve_contacts(W, q, mu, tolerance=1e-18, max_sweeps=cap)
        assert capped.sweeps <= cap + 1
        assert not capped.converged
        assert capped.stop_reason == "sweep-cap"
        assert capped.residual == pytest.approx(residual(W, q, mu, capped.reactions), rel=1e-3, abs=1e-15)
    late = qr.solve_contacts(W, q, mu, tolerance=1e-18, max_sweeps=10**9, time_budget=0.02)
    assert late.stop_reason == "time-budget"
    assert late.time < 0.5


def test_the_cap_is_named_where_it_was_reached_and_stagnation_where_it_was_not() -> None:
    seen = set()
    for levels in (1, 2):
        W, q, mu = rigid_stack(levels, 3, mu=0.5, push=0.1)
        for tolerance in (1e-8, 1e-18):  # the second is below what rounding allows
            for cap in (2, 41, 300, 2000):
                solution = qr.solve_contacts(W, q, mu, tolerance=tolerance, max_sweeps=cap)
                if not solution.converged:
                    reached = solution.sweeps >= cap
                    assert solution.stop_reason == ("sweep-cap" if reached else "stagnated"), f"{solution} with a cap of {cap}"
                seen.add(solution.stop_reason)
    assert seen == {"converged", "sweep-cap", "stagnated"}


def test_ctrl_c_ends_a_call() -> None:
    W, q, mu = rigid_stack(4, 4, mu=0.5, push=0.1)
    timer = threading.Timer(0.1, lambda: os.kill(os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        qr.solve_contacts(W, q, mu, tolerance=1e-18, max_sweeps=10**9, time_budget=60)
        timer.join()
    timer.join()


@pytest.mark.parametrize("unit", [1e-9, 1e-6, 1e-3, 1e3, 1e6])
def test_reactions_scale_with_the_unit_of_force(unit: float) -> None:
    W, q, mu = rigid_stack(2, 2, mu=0.4, push=0.1)
    W += 0.1 * np.eye(len(W))  # or the reactions are not unique
    expected = qr.solve_contacts(W, q, mu, tolerance=1e-12).reactions
    solution = qr.solve_contacts(unit * W, q, mu)
    assert_solved(unit * W, q, mu, solution)
    error = np.linalg.norm(unit * solution.reactions - expected) / np.linalg.norm(expected)
    assert error < 1e-4, f"{error:.2e} for {solution}"


@pytest.mark.parametrize("unit", [1e-9, 1e-3, 1e6])
def test_reactions_scale_with_the_velocities(unit: float) -> None:
    W, q, mu = rigid_stack(2, 2, mu=0.4, push=0.1)
    W += 0.1 * np.eye(len(W))
    expected = qr.solve_contacts(W, q, mu, tolerance=1e-12).reactions
    solution = qr.solve_contacts(W, unit * q, mu)
    assert_solved(W, unit * q, mu, solution)
    error = np.linalg.norm(solution.reactions / unit - expected) / np.linalg.norm(expected)
    assert error < 1e-6, f"{error:.2e} for {solution}"


def test_without_friction_only_normal_forces_are_left() -> None:
    W, q, mu = rigid_stack(3, 2, mu=0.0, push=0.3)
    solution = qr.solve_contacts(W, q, mu)
    assert_solved(W, q, mu, solution)
    assert (solution.reactions.reshape(-1, 3)[:, 1:] == 0).all()
    # The same as the linear complementarity problem of the normal rows.
    u = solution.velocities[::3]
    assert (u >= -1e-8).all()
    assert abs(solution.reactions[::3] @ u) < 1e-8


def test_nothing_to_do_is_done_at_once() -> None:
    W, _, mu = rigid_stack(2, 2, mu=0.4, push=0.1)
    still = qr.solve_contacts(W, np.zeros(len(W)), mu)
    assert still.converged
    assert (still.reactions == 0).all()


def test_a_warm_start_from_the_solution_costs_one_sweep() -> None:
    W, q, mu = rigid_stack(2, 3, mu=0.5, push=0.05)
    cold = qr.solve_contacts(W, q, mu, tolerance=1e-10)
    warm = qr.solve_contacts(W, q, mu, warm_start=cold.reactions)
    assert cold.sweeps > 1
    assert warm.sweeps == 1
    assert warm.converged


def test_a_problem_without_a_solution_is_not_called_converged() -> None:
    # The same reaction opens one contact and closes the other, and both must open.
    d, opposed = np.eye(3), np.diag([-1.0, 1, 1])
    W = np.block([[d, opposed], [opposed, d]])
    solution = qr.solve_contacts(W, [-1.0, 0, 0, -1, 0, 0], [0.5, 0.5], max_sweeps=500)
    assert not solution.converged
    assert np.isfinite(solution.reactions).all()


EYE = np.eye(6)


@pytest.mark.parametrize(
    ("error", "W", "q", "mu", "options"),
    [
        (qr.InvalidShapeError, np.eye(5), np.zeros(6), [0.5, 0.5], {}),
        (qr.InvalidShapeError, np.ones((6, 3)), np.zeros(6), [0.5, 0.5], {}),
        (qr.InvalidShapeError, sp.csr_array(np.eye(5)), np.zeros(6), [0.5, 0.5], {}),
        (qr.InvalidShapeError, sp.csr_array(np.eye(9)), np.zeros(6), [0.5, 0.5], {}),
        (qr.InvalidShapeError, EYE, np.zeros(5), [0.5, 0.5], {}),
        (qr.InvalidShapeError, EYE, np.zeros(6), [0.5], {}),
        (qr.InvalidShapeError, "W", np.zeros(6), [0.5, 0.5], {}),
        (qr.InvalidShapeError, None, np.zeros(6), [0.5, 0.5], {}),
        (qr.InvalidShapeError, EYE, "q", [0.5, 0.5], {}),
        (qr.InvalidShapeError, 1j * EYE, np.zeros(6), [0.5, 0.5], {}),
        (qr.InvalidValueError, EYE * NAN, np.zeros(6), [0.5, 0.5], {}),
        (qr.InvalidValueError, sp.csr_array(np.full((6, 6), np.inf)), np.zeros(6), [0.5, 0.5], {}),
        (qr.InvalidValueError, EYE, np.full(6, NAN), [0.5, 0.5], {}),
        (qr.InvalidValueError, EYE, np.zeros(6), [0.5, NAN], {}),
        (qr.InvalidValueError, EYE, np.zeros(6), [0.5, -0.1], {}),
        (qr.InvalidValueError, np.diag([1.0, 1, 1, 1, 1, 0]), np.zeros(6), [0.5, 0.5], {}),
        (qr.InvalidValueError, np.diag([1.0, 1, 1, 0, 0, 0]), np.zeros(6), [0.5, 0.5], {}),
        (qr.InvalidValueError, np.diag([1.0, 1, 1, -1, 1, 1]), np.zeros(6), [0.5, 0.5], {}),
        (qr.InvalidValueError, EYE, np.zeros(6), [0.5, 0.5], {"tolerance": 0.0}),
        (qr.InvalidValueError, EYE, np.zeros(6), [0.5, 0.5], {"tolerance": NAN}),
        (qr.InvalidValueError, EYE, np.zeros(6), [0.5, 0.5], {"max_sweeps": 0}),
        (qr.InvalidValueError, EYE, np.zeros(6), [0.5, 0.5], {"max_sweeps": -1}),
        (qr.InvalidValueError, EYE, np.zeros(6), [0.5, 0.5], {"time_budget": -1.0}),
        (qr.InvalidValueError, EYE, np.zeros(6), [0.5, 0.5], {"warm_start": np.full(6, NAN)}),
        (qr.InvalidShapeError, EYE, np.zeros(6), [0.5, 0.5], {"warm_start": np.zeros(7)}),
    ],
)
def test_ill_posed_input_is_a_typed_error(error: type[Exception], W: Any, q: Any, mu: Any, options: dict[str, Any]) -> None:
    with pytest.raises(error) as caught:
        qr.solve_contacts(W, q, mu, **options)
    assert "expected" in str(caught.value)


# --- problems of a world ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def resting() -> qr.World:
    """A box that rests on a table."""
    world = qr.World()
    rubber = qr.Material.preset("rubber")
    world.add_body(qr.Surface.half_space(0.2, points=900), rubber, motion="fixed")
    world.add_body(qr.Surface.box((0.06, 0.06, 0.08), points=600, control_points=80), rubber, mass=0.2, position=(0, 0, 0.04))
    world.step(50)
    return world


def test_the_problem_of_a_step_has_the_reactions_of_the_step(resting: qr.World) -> None:
    problem, contacts = resting.contact_problem(), resting.contacts()
    n = len(contacts)
    assert len(problem) == n > 3
    assert problem.W.shape == (3 * n, 3 * n)
    assert problem.reactions is not None
    assert problem.reactions.tolist() == contacts.reactions.ravel().tolist()
    np.testing.assert_allclose((problem.W @ problem.reactions + problem.q)[::3], contacts.gaps, atol=1e-15)
    assert np.abs(problem.W - problem.W.T).max() < 1e-12 * np.abs(problem.W).max()
    # The compliance makes the reactions unique. As given, the residual is loose on velocities; it is tight enough at 1e-14.
    again = problem.solve(tolerance=1e-14)
    np.testing.assert_allclose(again.reactions, problem.reactions, atol=1e-5 * problem.reactions.max())
    sparse = resting.contact_problem(sparse=True)
    assert sp.issparse(sparse.W)
    assert (sparse.W.toarray() == problem.W).all()


@pytest.mark.parametrize("sparse", [False, True])
def test_a_problem_survives_a_file(resting: qr.World, tmp_path: Path, sparse: bool) -> None:
    problem, path = resting.contact_problem(sparse=sparse), tmp_path / "step.npz"
    problem.save(path)
    read = qr.ContactProblem.load(path)
    assert sp.issparse(read.W) == sparse
    assert abs(read.W - problem.W).max() == 0
    assert problem.reactions is not None
    assert read.reactions is not None
    for a, b in ((read.q, problem.q), (read.mu, problem.mu), (read.reactions, problem.reactions)):
        assert a.tolist() == b.tolist()
    assert read.solve().reactions.tolist() == problem.solve().reactions.tolist()


def test_a_world_without_contacts_has_an_empty_problem() -> None:
    for sparse in (False, True):
        problem = qr.World().contact_problem(sparse=sparse)
        assert len(problem) == 0
        assert problem.solve().converged


def test_files_that_hold_no_problem_are_refused(tmp_path: Path) -> None:
    (tmp_path / "text.npz").write_text("nothing of the kind")
    np.savez(tmp_path / "other.npz", q=np.zeros(3))
    for name in ("missing.npz", "text.npz", "other.npz"):
        with pytest.raises(qr.ObjectFileError):
            qr.ContactProblem.load(tmp_path / name)
    with pytest.raises(qr.ObjectFileError):
        qr.ContactProblem(np.eye(3), np.zeros(3), np.zeros(1)).save(tmp_path / "no" / "such" / "folder.npz")
