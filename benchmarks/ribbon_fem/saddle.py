"""Linear systems of a body: second derivatives bordered by its forms."""

from __future__ import annotations

import numpy as np

from benchmarks.ribbon_fem.body import Body
from casashell.engine.sparse_solver import SingularMatrix, SparseSolver, make_solver
from casashell.typing import BoolArray, FloatArray, IntArray

#: Compliance given to every form, of that of the nodes: some forms say the same twice.
_COMPLIANCE = 1e-7


class Saddle:
    """[H + diagonal, J^T; J, -s] on the free nodes, H of the assembly and of the forms or left out.

    Entries come as lists of one fixed pattern; those of held nodes are dropped.
    """

    def __init__(self, body: Body, *, elastic: bool) -> None:
        self.forms, self.elastic = body.forms, elastic
        self.free = np.repeat(body.free, 3)
        size, count = 3 * len(body.rest), len(body.forms)
        dofs = 3 * body.forms.nodes[:, :, None] + np.arange(3)  # (P,k,3)
        number = size + np.arange(count)
        border = np.broadcast_to(number[:, None, None], dofs.shape).ravel()
        rows = [np.arange(size), number, border, dofs.ravel()]
        columns = [np.arange(size), number, dofs.ravel(), border]
        if elastic:
            shape = (*dofs.shape[:2], *dofs.shape[1:])
            pattern = body.assembly.pattern
            rows += [pattern.rows, np.broadcast_to(dofs[:, :, None], shape).ravel()]
            columns += [pattern.indices, np.broadcast_to(dofs[:, None], shape).ravel()]
        self._arrange(np.concatenate(rows), np.concatenate(columns), size, count)

    def _arrange(self, rows: IntArray, columns: IntArray, size: int, count: int) -> None:
        kept = np.concatenate([self.free, np.ones(count, dtype=bool)])
        unknowns = int(kept.sum())
        new = np.cumsum(kept) - 1
        self._used: BoolArray = kept[rows] & kept[columns]
        key = new[rows[self._used]] * unknowns + new[columns[self._used]]
        unique, self._home = np.unique(key, return_inverse=True)
        row, indices = np.divmod(unique, unknowns)
        indptr = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=unknowns))])
        self.solver: SparseSolver = make_solver(indptr, indices, "symmetric")
        self.entries, self.size, self.count = len(indices), size, count

    def factor(
        self,
        diagonal: FloatArray,
        x: FloatArray,
        entries: FloatArray | None = None,
        tension: FloatArray | None = None,
    ) -> bool:
        """Factor at nodes x (n,3); True when H is positive where the forms let it be felt.

        diagonal (n,) [N/m];  entries of H in the assembly's pattern;  tension (P,) of the forms,
        which gives them second derivatives.
        """
        heaviest = float(diagonal.max())
        stiffest = heaviest if entries is None else max(heaviest, float(entries.max()))
        self._extra = _COMPLIANCE / np.sqrt(heaviest * stiffest)
        slopes = self.forms.slopes(x).ravel()
        parts = [np.repeat(diagonal, 3), -(self.forms.compliance + self._extra), slopes, slopes]
        if self.elastic:
            if entries is None or tension is None:
                raise ValueError("an elastic system needs the entries of H and the tensions")
            turning = np.repeat((tension[:, None, None] * self.forms.weights).ravel(), 3)
            parts += [entries, turning]
        data = np.concatenate(parts)[self._used]
        summed = np.bincount(self._home, data, minlength=self.entries)
        self.solver.factor(np.asarray(summed, dtype=np.float64))
        negative = self.solver.negative_eigenvalues
        return negative is None or negative == self.count

    def solve(
        self, force: FloatArray, gap: FloatArray, tension: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Move (n,3) and new tensions (P,): H move + J^T new = force, J move - s new = gap.

        The compliance added acts on the change of tension: it is gone at the end of an iteration.
        """
        below = gap - self._extra * tension
        solution = self.solver.solve(np.concatenate([force.ravel()[self.free], below]))
        if not np.all(np.isfinite(solution)):
            raise SingularMatrix("the linear system has no finite solution")
        move = np.zeros(self.size)
        unknowns = len(solution) - self.count
        move[self.free] = solution[:unknowns]
        return move.reshape(-1, 3), solution[unknowns:]
