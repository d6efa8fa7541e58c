"""The contact solver on a problem of your own, and problems recorded from a world.

A problem of ``n`` contacts is a matrix ``W`` (3n, 3n), a vector ``q`` (3n,) and friction coefficients ``mu`` (n,). Contact by
contact, in contact frames (normal, tangent1, tangent2), it asks for reactions ``r`` with ``u = W r + q`` and::

    0 <= u_n  perp  r_n >= 0
    |r_t| < mu r_n  =>  u_t = 0;      |r_t| = mu r_n  =>  u_t = -s r_t,  s >= 0
"""

from __future__ import annotations

import time
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from quasirigid._quasirigid import ContactSolution, _solve_contacts
from quasirigid.errors import InvalidShapeError, InvalidValueError, ObjectFileError

__all__ = ["ContactProblem", "ContactSolution", "solve_contacts"]

FloatArray = npt.NDArray[np.float64]


def solve_contacts(
    W: Any,
    q: npt.ArrayLike,
    mu: npt.ArrayLike,
    *,
    tolerance: float = 1e-8,
    max_sweeps: int = 2000,
    time_budget: float | None = None,
    warm_start: npt.ArrayLike | None = None,
) -> ContactSolution:
    """Solve a contact problem with exact Coulomb friction.

    >>> import numpy as np
    >>> solution = solve_contacts(np.eye(3), [-1.0, 0.2, 0.0], [0.5])
    >>> solution.converged, solution.reactions.tolist()
    (True, [1.0, -0.2, 0.0])

    Args:
        W: (3n, 3n), a dense array or any SciPy sparse matrix; positive semidefinite, with positive definite 3x3 blocks on
            the diagonal. It is solved as it is given, never made symmetric; ``ContactSolution.asymmetry`` says how far off it is.
        q: (3n,), relative velocities (or displacements) at the contacts without reactions.
        mu: (n,), friction coefficients, >= 0.
        tolerance: residual asked for: the natural map with De Saxce's shift and rho = 1, divided by the largest of |q|, |r|, |u|.
        max_sweeps: cap on Gauss-Seidel sweeps, Newton steps counted as one each.
        time_budget: seconds after which to stop; ``None``: never. With a budget the result depends on the machine. Kept within some
            milliseconds; Ctrl-C ends a call too.
        warm_start: (3n,), reactions to begin with; ``None``: zero.

    Returns:
        The solution, or the best iterate if ``converged`` is false: ``stop_reason`` then says why. A problem without a
        solution ends like that.

    Raises:
        InvalidShapeError: arrays that do not fit together.
        InvalidValueError: NaN, infinity, a negative ``mu``, or a block on the diagonal of ``W`` that is not positive definite.
    """
    start = time.perf_counter()
    matrix = _block_rows(W) if hasattr(W, "tobsr") else W
    if isinstance(time_budget, int | float) and time_budget > 0:
        time_budget = max(time_budget - (time.perf_counter() - start), 1e-9)
    return _solve_contacts(matrix, q, mu, tolerance, max_sweeps, time_budget, warm_start)


def _block_rows(W: Any) -> tuple[Any, Any, Any]:
    """Row pointers, block columns and 3x3 blocks of a SciPy sparse matrix, in order and without duplicates."""
    if len(W.shape) != 2 or W.shape[0] != W.shape[1] or W.shape[0] % 3 != 0:
        raise InvalidShapeError("W", "shape (3n, 3n)", f"shape {W.shape}", "give three rows and columns per contact")
    blocks = W if W.format == "bsr" and W.blocksize == (3, 3) else W.tocsr().tobsr(blocksize=(3, 3))
    if not blocks.has_canonical_format:
        blocks = blocks.copy()
        blocks.sum_duplicates()
    return blocks.indptr, blocks.indices, blocks.data


def _from_block_rows(starts: Any, columns: Any, blocks: Any) -> Any:
    """A SciPy sparse array (3n, 3n) from its block rows."""
    from scipy.sparse import bsr_array

    width = 3 * (len(starts) - 1)
    return bsr_array((blocks, columns, starts), shape=(width, width))


def _checked(what: str, value: Any, *shape: int) -> FloatArray:
    """Finite real numbers of that shape, -1 for any length."""
    wanted = f"({shape[0] if shape[0] >= 0 else 'n'}{',' if len(shape) == 1 else f', {shape[1]}'})"
    try:
        array = np.asarray(value)
        numbers: FloatArray | None = array.astype(np.float64, copy=False) if array.dtype.kind in "biufO" and array.ndim else None
    except (TypeError, ValueError, OverflowError):
        numbers = None
    if numbers is None:
        raise InvalidShapeError(what, f"numbers of shape {wanted}", type(value).__name__, "give an array of real numbers")
    if numbers.ndim != len(shape) or any(side not in (-1, found) for side, found in zip(shape, numbers.shape, strict=True)):
        hint = "W and q have three rows per contact, mu has one"
        raise InvalidShapeError(what, f"shape {wanted}", f"shape {numbers.shape}", hint)
    if not np.isfinite(numbers).all():
        got = f"{np.count_nonzero(~np.isfinite(numbers))} of {numbers.size} NaN or infinite"
        raise InvalidValueError(what, "finite numbers only", got, "look at where they come from")
    return numbers


@dataclass(frozen=True)
class ContactProblem:
    """A contact problem, with the reactions that were found for it.

    From ``World.contact_problem()``: the problem of the last step, in displacements over the step instead of velocities.
    ``W`` is in m/N and ``q`` in m, and ``reactions`` in N are those of the step; what was the warm start is not kept.

    Raises ``InvalidShapeError`` for arrays that do not fit together, and ``InvalidValueError`` for NaN, infinity or a negative ``mu``.
    """

    W: Any
    """(3n, 3n), dense array or SciPy sparse array."""
    q: FloatArray
    """(3n,)"""
    mu: FloatArray
    """(n,)"""
    reactions: FloatArray | None = None
    """(3n,), or ``None`` if the problem came without."""

    def __post_init__(self) -> None:
        mu = _checked("mu", self.mu, -1)
        if mu.min(initial=0.0) < 0.0:
            raise InvalidValueError("mu", "friction coefficients >= 0", mu.min(), "0 is without friction")
        rows = 3 * len(mu)
        if hasattr(self.W, "tocsr"):
            if tuple(self.W.shape) != (rows, rows):
                raise InvalidShapeError("W", f"shape ({rows}, {rows})", f"shape {self.W.shape}", "W has three rows per contact, mu has one")
            _checked("W", self.W.tocsr().data, -1)
            W = self.W
        else:
            W = _checked("W", self.W, rows, rows)
        reactions = None if self.reactions is None else _checked("reactions", self.reactions, rows)
        for name, value in (("W", W), ("q", _checked("q", self.q, rows)), ("mu", mu), ("reactions", reactions)):
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.mu)

    def solve(
        self,
        *,
        tolerance: float = 1e-8,
        max_sweeps: int = 2000,
        time_budget: float | None = None,
        warm_start: npt.ArrayLike | None = None,
    ) -> ContactSolution:
        """``solve_contacts`` on this problem; from zero unless you give ``warm_start=problem.reactions``."""
        return solve_contacts(
            self.W, self.q, self.mu, tolerance=tolerance, max_sweeps=max_sweeps, time_budget=time_budget, warm_start=warm_start
        )

    def save(self, path: str | Path) -> None:
        """Write a compressed ``.npz`` with arrays ``W``, ``q``, ``mu`` and ``reactions``.

        A sparse ``W`` is written in CSR form as ``W_data``, ``W_indices``, ``W_indptr`` and ``W_shape``.
        """
        arrays: dict[str, Any] = {"q": self.q, "mu": self.mu}
        if hasattr(self.W, "tocsr"):
            csr = self.W.tocsr()
            arrays |= {"W_data": csr.data, "W_indices": csr.indices, "W_indptr": csr.indptr, "W_shape": np.array(csr.shape)}
        else:
            arrays["W"] = self.W
        if self.reactions is not None:
            arrays["reactions"] = self.reactions
        try:
            with Path(path).open("wb") as file:
                np.savez_compressed(file, **arrays)
        except OSError as error:
            raise ObjectFileError(str(path), "a file that can be written", error.strerror or error, "check the folder") from None

    @staticmethod
    def load(path: str | Path) -> ContactProblem:
        """Read what ``save`` wrote, or any ``.npz`` with arrays of these names.

        Raises:
            ObjectFileError: no such file, or not such a file.
        """
        try:
            with np.load(path) as file:
                arrays = {name: file[name] for name in file.files}
            if "W" in arrays:
                W: Any = arrays["W"]
            else:
                from scipy.sparse import csr_array

                shape = tuple(int(side) for side in arrays["W_shape"])
                W = csr_array((arrays["W_data"], arrays["W_indices"], arrays["W_indptr"]), shape=shape)
            return ContactProblem(W, arrays["q"], arrays["mu"], arrays.get("reactions"))
        except KeyError as error:
            raise ObjectFileError(
                str(path), "an .npz with arrays W, q and mu", f"no {error}", "write it with ContactProblem.save"
            ) from None
        except (OSError, ValueError, AttributeError, TypeError, zipfile.BadZipFile) as error:
            raise ObjectFileError(str(path), "an .npz with arrays W, q and mu", error, "write it with ContactProblem.save") from None
