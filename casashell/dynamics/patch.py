"""A factored matrix of which the rows of a few vertices have changed, by the formula of Woodbury.

    M = M0 + E R,   M^-1 b = y - W (I + R W)^-1 R y,   y = M0^-1 b,   W = M0^-1 E

where E picks the rows of the vertices and R = dP A + dQ is what they changed by: contact takes row i of
A to P_i A_i + Q_i.  Contact changes branches many times while the shell hardly moves; a column
of W costs a small part of a factor, and is kept until the next factor.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp

from casashell.typing import FloatArray, IntArray


class Patch:
    """Solutions with changed rows behind one factor.

    matrix  A (3V,3V);  solve: M0^-1 for (3V,) or (3V,m)
    """

    def __init__(self, matrix: sp.csr_array, solve: Callable[[FloatArray], FloatArray]) -> None:
        self._matrix, self._base = matrix, solve
        self._place: dict[int, int] = {}
        self._answers = np.zeros((matrix.shape[0], 0))

    def missing(self, vertices: IntArray) -> IntArray:
        """Those of the vertices whose columns have not been made."""
        return np.array([v for v in vertices if int(v) not in self._place], dtype=np.int64)

    def change(self, vertices: IntArray, by_force: FloatArray, by_motion: FloatArray) -> None:
        """From now on the rows of ``vertices`` (k,) differ by dP, dQ (k,3,3).

        LinAlgError: M is singular.
        """
        fresh = self.missing(vertices)
        if len(fresh):
            units = np.zeros((self._matrix.shape[0], 3 * len(fresh)))
            units[_rows(fresh), np.arange(3 * len(fresh))] = 1.0
            first = self._answers.shape[1] // 3
            self._place.update({int(v): first + i for i, v in enumerate(fresh)})
            self._answers = np.hstack([self._answers, self._base(units)])
        chosen = np.array([self._place[int(v)] for v in vertices], dtype=np.int64)
        self._columns = self._answers[:, _rows(chosen)]
        self._rows = _rows(vertices)
        self._pull = self._matrix[self._rows]
        self._by_force, self._by_motion = by_force, by_motion
        small = self._changed(self._columns)
        small[np.diag_indices(len(small))] += 1.0
        self._small = np.asarray(np.linalg.inv(small), dtype=np.float64)

    def _changed(self, d: FloatArray) -> FloatArray:
        """R d (3k,m) for d (3V,m)."""
        shape = len(self._by_force), 3, d.shape[1]
        pulled, moved = (self._pull @ d).reshape(shape), d[self._rows].reshape(shape)
        changed = self._by_force @ pulled + self._by_motion @ moved
        return np.asarray(changed).reshape(3 * shape[0], shape[2])

    def solve(self, right: FloatArray) -> FloatArray:
        """M^-1 b for b (3V,)."""
        y = self._base(right)
        share = self._small @ self._changed(y[:, None])[:, 0]
        return np.asarray(y - self._columns @ share)


def _rows(vertices: IntArray) -> IntArray:
    return np.asarray((3 * vertices[:, None] + np.arange(3)).ravel())
