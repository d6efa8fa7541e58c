"""The contact solver on a problem of your own, and problems recorded from a world.

A problem of ``n`` contacts is a matrix ``W`` (3n, 3n), a vector ``q`` (3n,) and friction coefficients ``mu`` (n,). Contact by
contact, in contact frames (normal, tangent1, tangent2), it asks for reactions ``r`` with ``u = W r + q`` and::

    0 <= u_n  perp  r_n >= 0
    |r_t| < mu r_n  =>  u_t = 0;      |r_t| = mu r_n  =>  u_t = -s r_t,  s >= 0
"""

from __future__ import annotations

import math
import time
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from quasirigid._quasirigid import ContactSolution, _solve_contacts
from quasirigid.arrays.real import finite_array, real_array
from quasirigid.arrays.sparse import block_rows, checked_csr, csr_from_arrays, is_sparse
from quasirigid.arrays.types import FloatArray
from quasirigid.errors import InvalidShapeError, InvalidValueError, ObjectFileError, QuasirigidError

__all__ = ["ContactProblem", "ContactSolution", "solve_contacts"]

SPARSE = ("data", "indices", "indptr", "shape")
"""Arrays of a sparse ``W`` in a file, after ``W_``."""


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
        InvalidValueError: NaN, infinity, masked arrays, indices of a sparse ``W`` out of range, a negative ``mu``, or a block on the
        diagonal of
            ``W`` that is not positive definite.
    """
    start = time.perf_counter()
    matrix = block_rows(W) if is_sparse(W) else W
    if isinstance(time_budget, int | float) and 0 < time_budget < 1e9:
        time_budget = max(time_budget - (time.perf_counter() - start), 1e-9)
    return _solve_contacts(matrix, q, mu, tolerance, max_sweeps, time_budget, warm_start)


def _checked(what: str, value: Any, *shape: int) -> FloatArray:
    """Finite real numbers of that shape, -1 for any length."""
    wanted = f"({shape[0] if shape[0] >= 0 else 'n'}{',' if len(shape) == 1 else f', {shape[1]}'})"
    numbers = real_array(what, value, wanted)
    if numbers.ndim != len(shape) or any(side not in (-1, found) for side, found in zip(shape, numbers.shape, strict=True)):
        hint = "W and q have three rows per contact, mu has one"
        raise InvalidShapeError(what, f"shape {wanted}", f"shape {numbers.shape}", hint)
    return finite_array(what, numbers, wanted)


@dataclass(frozen=True, eq=False)
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
        if is_sparse(self.W):
            if tuple(self.W.shape) != (rows, rows):
                raise InvalidShapeError("W", f"shape ({rows}, {rows})", f"shape {self.W.shape}", "W has three rows per contact, mu has one")
            checked_csr("W", self.W)
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
        if is_sparse(self.W):
            csr = checked_csr("W", self.W)
            arrays |= {"W_data": csr.data, "W_indices": csr.indices, "W_indptr": csr.indptr, "W_shape": np.array(csr.shape)}
        else:
            arrays["W"] = self.W
        if self.reactions is not None:
            arrays["reactions"] = self.reactions
        try:
            with Path(path).open("wb") as file:
                np.savez_compressed(file, **arrays)
        except (OSError, ValueError) as error:  # a name with a zero byte is no value that Python opens
            reason = getattr(error, "strerror", None) or error
            raise ObjectFileError(repr(str(path)), "a file that can be written", reason, "check the folder and the name") from None

    @staticmethod
    def load(path: str | Path) -> ContactProblem:
        """Read what ``save`` wrote, or any ``.npz`` with arrays of these names.

        Raises:
            ObjectFileError: no such file, or not such a file.
            InvalidShapeError, InvalidValueError: arrays that make no contact problem, such as indices of a sparse ``W`` out of range.
        """
        arrays = _read_arrays(path)
        missing = [name for name in ("q", "mu") if name not in arrays]
        if "W" not in arrays:
            missing += [f"W_{name}" for name in SPARSE if f"W_{name}" not in arrays]
        if missing:
            expected = "an .npz with arrays W, q and mu"
            raise ObjectFileError(str(path), expected, f"none named {', '.join(missing)}", "write it with ContactProblem.save")
        if "W" in arrays:
            W: Any = arrays["W"]
        else:
            data, indices, indptr, shape = (arrays[f"W_{name}"] for name in SPARSE)
            if shape.shape != (2,) or shape.dtype.kind not in "iu" or min(shape) < 0:
                raise InvalidShapeError("W_shape", "two whole numbers >= 0", f"{shape!r:.60}", "write it with ContactProblem.save")
            W = csr_from_arrays("W", data, indices, indptr, (int(shape[0]), int(shape[1])))
        return ContactProblem(W, arrays["q"], arrays["mu"], arrays.get("reactions"))


def _read_arrays(path: str | Path) -> dict[str, npt.NDArray[Any]]:
    """The arrays of a problem that an ``.npz`` holds, by name. Raises ``ObjectFileError``."""
    wanted = {"W", "q", "mu", "reactions", *(f"W_{name}" for name in SPARSE)}
    try:
        with zipfile.ZipFile(path) as archive:
            arrays = {}
            for member in archive.infolist():
                name = member.filename.removesuffix(".npy")
                if name in wanted and name != member.filename:
                    with archive.open(member) as file:
                        arrays[name] = _read_array(name, file, member.file_size)
            return arrays
    except QuasirigidError:
        raise
    except (
        Exception
    ) as error:  # readers of damaged archives raise whatever they stumble on: zlib.error, struct.error, NotImplementedError ...
        got = error.strerror if isinstance(error, OSError) and error.strerror else f"{type(error).__name__}: {error}"
        raise ObjectFileError(str(path), "an .npz with arrays W, q and mu", got, "write it with ContactProblem.save") from None


def _read_array(name: str, file: IO[bytes], size: int) -> npt.NDArray[Any]:
    """An array of numbers in NumPy's format; no more memory is taken than the ``size`` of the file, bytes."""
    version = np.lib.format.read_magic(file)
    if version not in ((1, 0), (2, 0)):  # 3.0 is for names of columns, which these arrays do not have
        raise ValueError(f"{name}: version {version} of NumPy's format")
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, by_columns, dtype = read_header(file)
    if dtype.kind not in "biufc" or min(shape, default=0) < 0:
        raise ValueError(f"{name}: an array of {dtype}, not of numbers")
    count = math.prod(shape)
    if count * dtype.itemsize > size:
        raise ValueError(f"{name}: {count} numbers of {dtype.itemsize} bytes in a file of {size}")
    data = file.read(count * dtype.itemsize)
    array = np.frombuffer(data, dtype, count).reshape(shape, order="F" if by_columns else "C")
    return array.astype(dtype.newbyteorder("="))
