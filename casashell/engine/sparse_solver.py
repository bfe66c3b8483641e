"""One door to sparse direct solvers: analyse a pattern once, factor and solve many times."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Callable
from typing import Literal, Protocol, TypeAlias

import numpy as np
import scipy.sparse as sp

from casashell.typing import FloatArray, IntArray

#: "unpivoted" is general with pivots from the diagonal, and by MUMPS without scaling: a quarter faster
#: there, and the caller has to check what it gets.
Symmetry: TypeAlias = Literal["general", "symmetric", "unpivoted"]


class SingularMatrix(ArithmeticError):
    """The matrix could not be factored; the message says where."""


def check_rhs(rhs: FloatArray, size: int) -> None:
    """Raise ValueError unless ``rhs`` is (size,) or (size, m): libraries read past a shorter one."""
    if np.ndim(rhs) not in (1, 2) or np.shape(rhs)[0] != size:
        raise ValueError(f"right-hand side must have {size} rows, got shape {np.shape(rhs)}")


class SparseSolver(Protocol):
    """Direct solver for matrices of one pattern."""

    name: str

    def factor(self, data: FloatArray) -> None:
        """Factor the matrix with entries ``data``; raises SingularMatrix."""

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Solution of the last factored matrix; rhs (n,) or (n, m)."""

    @property
    def negative_eigenvalues(self) -> int | None:
        """Number of negative eigenvalues of a symmetric matrix; None when not known."""


class SuperLU:
    """SciPy's SuperLU: always there, no reuse of the analysis."""

    name = "superlu"

    def __init__(self, indptr: IntArray, indices: IntArray, symmetry: Symmetry) -> None:
        size = len(indptr) - 1
        # CSR of A read as CSC is A transposed: the solve below undoes it.
        self._matrix = sp.csc_array((np.ones(len(indices)), indices, indptr), shape=(size, size))
        self._symmetry = symmetry

    def factor(self, data: FloatArray) -> None:
        """Factor the matrix with entries ``data``; raises SingularMatrix."""
        from scipy.sparse.linalg import splu

        if not np.all(np.isfinite(data)):
            raise SingularMatrix("the matrix has entries that are not finite")
        self._matrix.data = np.asarray(data)
        symmetric = self._symmetry != "general"
        order = "MMD_AT_PLUS_A" if symmetric else "COLAMD"
        try:
            self._lu = splu(
                self._matrix,
                permc_spec=order,
                diag_pivot_thresh=0.0 if symmetric else 1.0,
                options={"SymmetricMode": symmetric},
            )
        except RuntimeError as error:
            raise SingularMatrix(f"SuperLU: {error}") from None

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Solution of the last factored matrix; rhs (n,) or (n, m)."""
        check_rhs(rhs, self._matrix.shape[0])
        return np.asarray(self._lu.solve(np.asarray(rhs, dtype=np.float64), trans="T"))

    @property
    def negative_eigenvalues(self) -> int | None:
        """Signs on the diagonal of U; None when rows were exchanged or the matrix is not symmetric."""
        if self._symmetry != "symmetric" or not np.array_equal(self._lu.perm_r, self._lu.perm_c):
            return None
        return int(np.sum(self._lu.U.diagonal() < 0.0))


def _backends() -> dict[str, Callable[[IntArray, IntArray, Symmetry], SparseSolver]]:
    from casashell.engine.mumps import Mumps
    from casashell.engine.pardiso import Pardiso

    return {"mumps": Mumps, "pardiso": Pardiso, "superlu": SuperLU}


def make_solver(
    indptr: IntArray, indices: IntArray, symmetry: Symmetry, backend: str | None = None
) -> SparseSolver:
    """Solver for square CSR matrices of this pattern (full pattern also when symmetric).

    backend  'mumps', 'pardiso' or 'superlu'; by default ``$CASASHELL_LINEAR_SOLVER``, else MUMPS
             with SuperLU where CasADi's wheel has no MUMPS library.
    Raises ValueError for an unknown or missing backend.
    """
    wanted = backend or os.environ.get("CASASHELL_LINEAR_SOLVER", "")
    known = _backends()
    if wanted:
        if wanted not in known:
            raise ValueError(f"linear solver must be one of {', '.join(known)}; got '{wanted}'")
        if wanted == "pardiso" and importlib.util.find_spec("pypardiso") is None:
            raise ValueError("linear solver 'pardiso' needs: pip install 'casashell[fast]'")
        return known[wanted](indptr, indices, symmetry)
    try:
        return known["mumps"](indptr, indices, symmetry)
    except OSError:
        return SuperLU(indptr, indices, symmetry)
