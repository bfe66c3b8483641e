"""Matrices of a piece restricted to the vertices that may move; one analysis, many factors."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from casashell.engine.assembly import Pattern
from casashell.engine.sparse_solver import SingularMatrix, SparseSolver, Symmetry, make_solver
from casashell.inverse.stability import lowest_eigenpairs
from casashell.typing import FloatArray, IntArray


class FreeSystem:
    """The rows and columns of the vertices outside ``fixed``, for a pattern of (n,3) unknowns.

    Plays the part of the filter of Ly 2018, Sec. 5.4: full entries go in, and vectors (n,3) that
    vanish at fixed vertices come out.
    """

    def __init__(self, pattern: Pattern, fixed: IntArray, symmetry: Symmetry) -> None:
        free = np.ones(pattern.size // 3, dtype=bool)
        free[fixed] = False
        self.dofs: IntArray = np.flatnonzero(np.repeat(free, 3))
        place = np.full(pattern.size, -1, dtype=np.int64)
        place[self.dofs] = np.arange(len(self.dofs))
        rows, columns = place[pattern.rows], place[pattern.indices]
        self._chosen = np.flatnonzero((rows >= 0) & (columns >= 0))
        row = rows[self._chosen]
        self._indices = columns[self._chosen]
        counts = np.bincount(row, minlength=len(self.dofs))
        self._indptr = np.concatenate([[0], np.cumsum(counts)])
        self._diagonal = np.flatnonzero(row == self._indices)
        self._shape = (pattern.size // 3, 3)
        self._symmetry: Symmetry = symmetry
        self._solver: SparseSolver | None = None
        self.factorizations = 0

    def __len__(self) -> int:
        return len(self.dofs)

    def restrict(self, vectors: FloatArray) -> FloatArray:
        """Free components (m,) of vectors (n,3)."""
        return np.asarray(vectors.reshape(-1)[self.dofs])

    def extend(self, free: FloatArray) -> FloatArray:
        """Vectors (n,3) of free components (m,), zero at fixed vertices."""
        full = np.zeros(self._shape)
        full.reshape(-1)[self.dofs] = free
        return full

    def matrix(self, entries: FloatArray) -> sp.csr_array:
        """Free rows and columns of the matrix with these entries of the full pattern."""
        size = len(self.dofs)
        data = (entries[self._chosen], self._indices, self._indptr)
        return sp.csr_array(data, shape=(size, size))

    def diagonal_scale(self, entries: FloatArray) -> float:
        """Mean size of the diagonal."""
        values = np.abs(entries[self._chosen][self._diagonal])
        return float(values.mean()) if len(values) else 0.0

    def factor(self, entries: FloatArray, shift: float = 0.0) -> bool:
        """Factor matrix + shift I; False when it is singular or, if symmetric, not positive."""
        if len(self.dofs) == 0:
            return True
        data = entries[self._chosen]
        if shift:
            data[self._diagonal] += shift
        if self._solver is None:
            self._solver = make_solver(self._indptr, self._indices, self._symmetry)
        self.factorizations += 1
        try:
            self._solver.factor(data)
        except SingularMatrix:
            return False
        if self._symmetry == "general":
            return True
        negative = self._solver.negative_eigenvalues
        if negative is None:  # a backend without inertia
            size = len(self.dofs)
            matrix = sp.csr_array((data, self._indices, self._indptr), shape=(size, size))
            return bool(lowest_eigenpairs(matrix, 1)[0][0] > 0.0)
        return negative == 0

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Solution (m,) of the last factored matrix; raises RuntimeError before the first."""
        if len(self.dofs) == 0:
            return np.zeros(0)
        if self._solver is None:
            raise RuntimeError("factor a matrix before solving with it")
        return self._solver.solve(rhs)
