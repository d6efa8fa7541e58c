"""Sparse matrices from outside, checked before compiled code of SciPy sees them: it trusts the indices, and a wrong one ends the process.

SciPy checks a matrix when it is made; its arrays can be changed afterwards, and a file can hold anything.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from quasirigid.arrays.real import finite_array, refuse_masked
from quasirigid.arrays.types import IntArray
from quasirigid.errors import InvalidShapeError, InvalidValueError

__all__ = ["block_rows", "checked_csr", "csr_from_arrays", "from_block_rows", "is_sparse"]

HINT = "build the matrix again from its entries, such as scipy.sparse.csr_array(dense)"


def is_sparse(W: object) -> bool:
    """Whether it is a sparse matrix or array of SciPy."""
    if not hasattr(W, "tocsr"):  # so that those who have none need not import SciPy
        return False
    from scipy.sparse import issparse

    return bool(issparse(W))


def block_rows(W: Any) -> tuple[Any, Any, Any]:
    """Row pointers, block columns and 3x3 blocks of a sparse matrix (3n, 3n), in order and without duplicates.

    Raises ``InvalidShapeError`` and ``InvalidValueError`` as ``checked_csr``, and for another shape.
    """
    if len(W.shape) != 2 or W.shape[0] != W.shape[1] or W.shape[0] % 3 != 0:
        raise InvalidShapeError("W", "shape (3n, 3n)", f"shape {W.shape}", "give three rows and columns per contact")
    blocks = checked_csr("W", W).tobsr(blocksize=(3, 3))
    return blocks.indptr, blocks.indices, blocks.data


def from_block_rows(starts: Any, columns: Any, blocks: Any) -> Any:
    """A SciPy sparse array (3n, 3n) from its block rows."""
    from scipy.sparse import bsr_array

    width = 3 * (len(starts) - 1)
    return bsr_array((blocks, columns, starts), shape=(width, width))


def checked_csr(what: str, W: Any) -> Any:
    """A sparse matrix of any format as a new ``csr_array`` of finite real numbers, columns rising, entries of the same place added up.

    Raises ``InvalidShapeError`` for arrays whose lengths do not fit together, and ``InvalidValueError`` for indices out of range, row
    pointers that fall, complex or masked entries, NaN and infinity; the message names the array.
    """
    if len(W.shape) != 2:
        raise InvalidShapeError(what, "a matrix", f"shape {W.shape}", HINT)
    match W.format:
        case "csr" | "csc" | "bsr":
            csr = _from_compressed(what, W)
        case "coo":
            csr = _from_places(what, W.row, W.col, W.data, W.shape)
        case "dia":
            csr = _from_diagonals(what, W)
        case "lil":
            csr = _from_lists(what, W)
        case "dok":
            items = list(W.items())
            places = _whole(f"{what} keys", [place for place, _ in items]).reshape(-1, 2)
            csr = _from_places(what, places[:, 0], places[:, 1], [value for _, value in items], W.shape)
        case other:
            raise InvalidValueError(what, "a sparse matrix of SciPy (csr, csc, bsr, coo, dia, lil, dok)", f"format {other!r}", HINT)
    csr.sum_duplicates()
    return csr


def csr_from_arrays(what: str, data: Any, indices: Any, indptr: Any, shape: tuple[int, int]) -> Any:
    """A ``csr_array`` from its three arrays, checked first. Raises as ``checked_csr``."""
    starts, columns = _whole(f"{what} indptr", indptr), _whole(f"{what} indices", indices)
    values = _checked_parts(what, starts, columns, _numbers(what, data, 1), shape)
    return _csr(values, columns[: len(values)], starts, shape)


def _from_compressed(what: str, W: Any) -> Any:
    starts, indices = _whole(f"{what} indptr", W.indptr), _whole(f"{what} indices", W.indices)
    rows, columns = W.shape
    if W.format == "csr":
        return csr_from_arrays(what, W.data, indices, starts, (rows, columns))
    if W.format == "csc":
        return csr_from_arrays(what, W.data, indices, starts, (columns, rows)).T.tocsr()
    from scipy.sparse import bsr_array

    blocks = _numbers(what, W.data, 3)
    height, width = blocks.shape[1:]
    if height == 0 or width == 0 or rows % height or columns % width:
        raise InvalidShapeError(f"{what} data", f"blocks that divide a matrix of shape {W.shape}", f"blocks of {height} x {width}", HINT)
    blocks = _checked_parts(what, starts, indices, blocks, (rows // height, columns // width))
    return bsr_array((blocks, indices[: len(blocks)], starts), shape=W.shape).tocsr()


def _checked_parts(what: str, starts: IntArray, indices: IntArray, data: Any, shape: tuple[int, int]) -> Any:
    """``data`` without what lies behind the last row, if the arrays of a compressed matrix with ``shape`` fit together."""
    if len(starts) != shape[0] + 1:
        raise InvalidShapeError(f"{what} indptr", f"{shape[0] + 1} row pointers, one more than rows", f"{len(starts)}", HINT)
    falls = starts[1:] < starts[:-1]  # not by their differences, which overflow
    if starts[0] != 0 or falls.any():
        at = 1 + int(np.argmax(falls)) if starts[0] == 0 else 0
        raise InvalidValueError(f"{what} indptr", "row pointers that begin with 0 and never fall", f"{starts[at]} at position {at}", HINT)
    count = int(starts[-1])
    if count > min(len(indices), len(data)):
        got = f"{count}, with {len(indices)} indices and {len(data)} entries"
        raise InvalidShapeError(f"{what} indptr", "a last row pointer within indices and data", got, HINT)
    _check_range(f"{what} indices", indices[:count], shape[1])
    return data[:count]


def _from_places(what: str, rows: Any, columns: Any, data: Any, shape: tuple[int, int]) -> Any:
    from scipy.sparse import coo_array

    i, j, values = _whole(f"{what} row", rows), _whole(f"{what} col", columns), _numbers(what, data, 1)
    if not len(i) == len(j) == len(values):
        got = f"{len(i)} rows, {len(j)} columns, {len(values)} entries"
        raise InvalidShapeError(what, "as many row as column indices and entries", got, HINT)
    _check_range(f"{what} row", i, shape[0])
    _check_range(f"{what} col", j, shape[1])
    return coo_array((values, (i, j)), shape=shape).tocsr()


def _from_diagonals(what: str, W: Any) -> Any:
    from scipy.sparse import dia_array

    offsets, values = _whole(f"{what} offsets", W.offsets), _numbers(what, W.data, 2)
    if len(offsets) != len(values):
        raise InvalidShapeError(f"{what} offsets", f"{len(values)}, one for each diagonal", f"{len(offsets)}", HINT)
    if len(np.unique(offsets)) != len(offsets):
        raise InvalidValueError(f"{what} offsets", "every diagonal once", "some twice", HINT)
    inside = (offsets > -W.shape[0]) & (offsets < W.shape[1])  # others lie beside the matrix
    return dia_array((values[inside], offsets[inside]), shape=W.shape).tocsr()


def _from_lists(what: str, W: Any) -> Any:
    if not len(W.rows) == len(W.data) == W.shape[0] or any(len(a) != len(b) for a, b in zip(W.rows, W.data, strict=True)):
        raise InvalidShapeError(what, f"{W.shape[0]} rows with as many columns as entries", f"{len(W.rows)} of another kind", HINT)
    rows = np.repeat(np.arange(W.shape[0]), [len(row) for row in W.rows])
    columns, values = ([item for row in lists for item in row] for lists in (W.rows, W.data))
    return _from_places(what, rows, columns, values, W.shape)


def _csr(values: Any, columns: IntArray, starts: IntArray, shape: tuple[int, int]) -> Any:
    from scipy.sparse import csr_array

    return csr_array((values, columns, starts), shape=shape)


def _whole(what: str, indices: Any) -> IntArray:
    refuse_masked(what, indices)
    array = np.asarray(indices)
    if array.size == 0:
        return np.zeros(0, np.int64)
    if array.dtype.kind not in "iu" or array.dtype.itemsize > 8:
        raise InvalidValueError(what, "whole numbers", f"an array of {array.dtype}", HINT)
    if array.ndim != 1 and what.rpartition(" ")[2] != "keys":
        raise InvalidShapeError(what, "one index after the other", f"shape {array.shape}", HINT)
    if array.dtype == np.uint64 and array.max() > np.iinfo(np.int64).max:
        raise InvalidValueError(what, "indices of a matrix", f"{array.max()}", HINT)
    return array.astype(np.int64)


def _numbers(what: str, data: Any, dimensions: int) -> npt.NDArray[np.float64]:
    """A copy: adding up entries of the same place is done in place."""
    if np.ndim(data) != dimensions:
        raise InvalidShapeError(f"{what} data", f"an array of {dimensions} dimensions", f"shape {np.shape(data)}", HINT)
    return np.array(finite_array(what, data, "of the entries"))


def _check_range(what: str, indices: IntArray, end: int) -> None:
    outside = (indices < 0) | (indices >= end)
    if outside.any():
        at = int(np.argmax(outside))
        raise InvalidValueError(what, f"indices from 0 to {end - 1}", f"{indices[at]} at position {at}", HINT)
