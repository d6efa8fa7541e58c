"""A malformed sparse `W` is a typed error that names the array, from arrays and from a file, and a right one is what it says in every
format.
"""

import io
import subprocess
import sys
import textwrap
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

import quasirigid as qr
from quasirigid.arrays.sparse import checked_csr

HALF = np.random.default_rng(3).normal(size=(6, 6))
W = HALF @ HALF.T + np.eye(6)
W[0, 3] = W[3, 0] = 0.0
Q, MU = [-1.0, 0.2, 0.0, -1.0, 0.0, 0.1], [0.5, 0.5]
FORMATS: list[Callable[[Any], Any]] = [sp.csr_array, sp.csr_matrix, sp.csc_array, sp.csc_matrix, sp.coo_array, sp.coo_matrix]
FORMATS += [sp.dia_array, sp.dia_matrix, sp.lil_array, sp.lil_matrix, sp.dok_array, sp.dok_matrix]
FORMATS += [lambda w, size=size: sp.bsr_array(w, blocksize=size) for size in ((3, 3), (2, 2), (1, 1), (6, 2))]


def spoilt(make: Callable[[Any], Any], name: str, change: Callable[[Any], Any]) -> Any:
    """A matrix with one of its arrays changed, or replaced by what `change` returns."""
    matrix = make(W)
    changed = change(getattr(matrix, name))
    if changed is not None:
        setattr(matrix, name, changed)
    return matrix


def entry(at: int, value: Any) -> Callable[[Any], None]:
    """Sets one entry."""
    return lambda array: array.__setitem__(at, value)


BSR = FORMATS[-4]
BAD: dict[str, tuple[Callable[[], Any], str]] = {
    **{f"{make.__name__} indices {bad}": (lambda make=make, bad=bad: spoilt(make, "indices", entry(2, bad)), "W indices")
       for make in (sp.csr_array, sp.csc_matrix) for bad in (6, 99, -1, 2**31 - 1, -(2**31))},
    **{f"{make.__name__} indptr {at} {bad}": (lambda make=make, at=at, bad=bad: spoilt(make, "indptr", entry(at, bad)), "W indptr")
       for make in (sp.csr_matrix, sp.csc_array) for at, bad in ((0, 1), (0, -1), (1, 10**9), (3, -5), (6, 10**9), (6, 0), (6, -(2**31)))},
    "bsr indices": (lambda: spoilt(BSR, "indices", entry(0, 2)), "W indices"),
    "bsr negative": (lambda: spoilt(BSR, "indices", entry(0, -1)), "W indices"),
    "bsr indptr": (lambda: spoilt(BSR, "indptr", entry(1, 10**9)), "W indptr"),
    "short indptr": (lambda: spoilt(sp.csr_array, "indptr", lambda a: a[:-1].copy()), "W indptr"),
    "short indices": (lambda: spoilt(sp.csr_array, "indices", lambda a: a[:-1].copy()), "W indptr"),
    "short data": (lambda: spoilt(sp.csr_array, "data", lambda a: a[:-1].copy()), "W indptr"),
    "indices of floats": (lambda: spoilt(sp.csr_array, "indices", lambda a: a.astype(float)), "W indices"),
    "flat data": (lambda: spoilt(sp.csr_array, "data", lambda a: a[None]), "W data"),
    "complex": (lambda: sp.csr_array(W * (1 + 0j)), "W"),
    "complex bsr": (lambda: BSR(W * 1j), "W"),
    "masked": (lambda: spoilt(sp.csr_array, "data", lambda a: np.ma.masked_less(a, 0.0)), "W"),
    "nan": (lambda: spoilt(sp.coo_array, "data", entry(1, np.nan)), "W"),
    "coo col": (lambda: spoilt(sp.coo_matrix, "col", entry(0, 6)), "W col"),
    "coo row": (lambda: spoilt(sp.coo_matrix, "row", entry(0, -1)), "W row"),
    "coo lengths": (lambda: spoilt(sp.coo_matrix, "data", lambda a: a[:-1].copy()), "W"),
    "dia offsets": (lambda: spoilt(sp.dia_array, "offsets", lambda a: a[:-1].copy()), "W offsets"),
    "dia twice": (lambda: spoilt(sp.dia_array, "offsets", entry(0, 1)), "W offsets"),
    "lil column": (lambda: spoilt(sp.lil_array, "rows", lambda rows: rows[0].__setitem__(0, 77)), "W col"),
    "lil lengths": (lambda: spoilt(sp.lil_array, "rows", lambda rows: rows[0].pop() and None), "W"),
    "one dimension": (lambda: sp.coo_array(np.arange(6.0)), "W"),
    "not square": (lambda: sp.csr_array(W[:, :3]), "W"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_a_malformed_matrix_is_refused_by_a_message_that_names_the_array(case: str) -> None:
    make, what = BAD[case]
    for use in (lambda: qr.solve_contacts(make(), Q, MU), lambda: qr.ContactProblem(make(), np.array(Q), np.array(MU))):
        with pytest.raises((qr.InvalidValueError, qr.InvalidShapeError), match=rf"^({what})\b"):
            use()


def test_a_matrix_that_is_spoilt_after_the_problem_was_made_is_refused_as_well(tmp_path: Path) -> None:
    problem = qr.ContactProblem(sp.csr_array(W), np.array(Q), np.array(MU))
    problem.W.indices[0] = 99
    with pytest.raises(qr.InvalidValueError, match="W indices"):
        problem.solve()
    with pytest.raises(qr.InvalidValueError, match="W indices"):
        problem.save(tmp_path / "w.npz")
    assert not (tmp_path / "w.npz").exists()


def test_every_format_is_the_matrix_that_it_says_unsorted_with_duplicates_and_with_flags_that_lie() -> None:
    expected = qr.solve_contacts(W, Q, MU).reactions.tolist()
    for make in FORMATS:
        assert qr.solve_contacts(make(W), Q, MU).reactions.tolist() == expected, make
    unsorted = sp.csr_array(W)
    assert unsorted.has_canonical_format
    for row in range(6):  # SciPy still takes it for sorted
        part = slice(unsorted.indptr[row], unsorted.indptr[row + 1])
        unsorted.indices[part], unsorted.data[part] = unsorted.indices[part][::-1].copy(), unsorted.data[part][::-1].copy()
    assert qr.solve_contacts(unsorted, Q, MU).reactions.tolist() == expected
    before = unsorted.indices.copy()
    twice = sp.csr_array((np.repeat(unsorted.data / 2, 2), np.repeat(unsorted.indices, 2), 2 * unsorted.indptr), shape=(6, 6))
    assert qr.solve_contacts(twice, Q, MU).reactions.tolist() == expected
    assert (unsorted.indices == before).all(), "what is given is left as it is"
    longer = sp.csr_array(
        (np.append(sp.csr_array(W).data, 7.0), np.append(sp.csr_array(W).indices, 0), sp.csr_array(W).indptr), shape=(6, 6)
    )
    assert qr.solve_contacts(longer, Q, MU).reactions.tolist() == expected
    assert (checked_csr("W", sp.csr_array((4, 4))).toarray() == 0).all()
    beside = sp.dia_array((np.vstack([np.diag(W), np.ones(6)]), [0, 2**20]), shape=(6, 6))
    assert (checked_csr("W", beside).toarray() == np.diag(np.diag(W))).all()


SPOIL = {
    "out of range": ("W_indices", lambda a: np.full_like(a, 99), qr.InvalidValueError, "W indices"),
    "negative": ("W_indices", lambda a: -a - 1, qr.InvalidValueError, "W indices"),
    "beyond what differences hold": ("W_indptr", lambda a: np.append(a[:-1].astype(np.int64), -(2**63)), qr.InvalidValueError, "W indptr"),
    "not monotone": ("W_indptr", lambda a: a[::-1].copy(), qr.InvalidValueError, "W indptr"),
    "beyond the end": ("W_indptr", lambda a: a * 10**6, qr.InvalidShapeError, "W indptr"),
    "floats": ("W_indices", lambda a: a + 0.5, qr.InvalidValueError, "W indices"),
    "complex": ("W_data", lambda a: a + 1j, qr.InvalidShapeError, "W"),
    "complex q": ("q", lambda a: a + 1j, qr.InvalidShapeError, "q"),
    "shape": ("W_shape", lambda a: np.array([6.0, 6.0]), qr.InvalidShapeError, "W_shape"),
    "huge shape": ("W_shape", lambda a: np.array([2**62, 2**62]), qr.InvalidShapeError, "W"),
    "objects": ("mu", lambda a: a.astype(object), qr.ObjectFileError, "mu"),
    "short mu": ("mu", lambda a: a[:1], qr.InvalidShapeError, "W"),
}


@pytest.mark.parametrize("case", SPOIL)
def test_a_file_with_a_malformed_problem_is_refused_by_a_message_that_names_the_array(case: str, tmp_path: Path) -> None:
    name, change, error, what = SPOIL[case]
    path = tmp_path / "w.npz"
    qr.ContactProblem(sp.csr_array(W), np.array(Q), np.array(MU)).save(path)
    with np.load(path) as file:
        arrays = {key: file[key] for key in file.files}
    arrays[name] = change(arrays[name])
    np.savez(path, **arrays)
    with pytest.raises(error, match=what):
        qr.ContactProblem.load(path)


def test_a_file_cannot_claim_more_memory_than_it_holds(tmp_path: Path) -> None:
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": (2**40,)})
    with zipfile.ZipFile(tmp_path / "huge.npz", "w") as archive:
        archive.writestr("q.npy", file.getvalue())
    with pytest.raises(qr.ObjectFileError, match="q: 1099511627776 numbers of 8 bytes"):
        qr.ContactProblem.load(tmp_path / "huge.npz")


def test_no_malformed_matrix_ends_the_process() -> None:
    program = """
        import sys; sys.path.insert(0, sys.argv[1])
        import quasirigid as qr
        from test_sparse_matrix import BAD, MU, Q
        for make, _ in BAD.values():
            try:
                qr.solve_contacts(make(), Q, MU)
            except qr.QuasirigidError:
                print("refused")
    """
    folder = str(Path(__file__).parent)
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program), folder], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, (done.returncode, done.stderr[-500:])
    assert done.stdout.count("refused") == len(BAD)
