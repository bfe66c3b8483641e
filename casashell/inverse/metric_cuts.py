"""The Hessian as an affine function of the strain forces, and convex cuts that make it positive.

With a metric, d2E/dx2 = sum c dq dq^T + tau d2q, where c is affine in tau too (k_L / L_r for an edge) or
constant (a hinge).  "V^T H V >= delta" is then a linear matrix inequality in tau for any V: along
unstable directions of the whole shell, and on single vertices and edges, where short or thin elements
under pressure buckle by themselves.
"""

from __future__ import annotations

import clarabel
import numpy as np
import scipy.sparse as sp

from casashell.inverse.forces import Block
from casashell.inverse.metric_state import MetricState, Strained, block_entries
from casashell.metric import Metric
from casashell.typing import FloatArray, IntArray


class StiffnessMap:
    """Entries of the Hessian of one piece by strain forces, linearised at a metric."""

    def __init__(self, state: MetricState, metric: Metric, now: Strained) -> None:
        size, count = state.piece.target.size, state.size
        self.size = size
        keys, columns, slopes, values = [], [], [], []
        for at, term in enumerate(state.terms):
            part = slice(state.ends[at], state.ends[at + 1])
            slope, curve = state.curvatures[at]
            outer = slope[:, :, None] * slope[:, None, :]
            row, column = block_entries(term)
            keys.append((row * size + column).ravel())
            elements = np.arange(part.start, part.stop)[:, None, None]
            columns.append(np.broadcast_to(elements, row.shape).ravel())
            slopes.append((curve + now.stiffening[part, None, None] * outer).ravel())
            values.append((now.c[part, None, None] * outer).ravel())
            values[-1] = values[-1] + (now.tau[part, None, None] * curve).ravel()
        fixed = state.constant_stiffness(metric).tocoo()
        keys.append(fixed.row.astype(np.int64) * size + fixed.col)
        self.keys, place = np.unique(np.concatenate(keys), return_inverse=True)
        self.rows, self.columns = self.keys // size, self.keys % size
        elastic = len(place) - len(fixed.data)
        self.slopes = sp.csr_array(
            sp.coo_array(
                (np.concatenate(slopes), (place[:elastic], np.concatenate(columns))),
                shape=(len(self.keys), count),
            ).tocsr()
        )
        self.values = np.bincount(
            place, np.concatenate([*values, fixed.data]), minlength=len(self.keys)
        )
        self.constant = self.values - self.slopes @ now.tau

    @property
    def matrix(self) -> sp.csr_array:
        """The Hessian at the metric it is linearised at."""
        entries = (self.values, (self.rows, self.columns))
        return sp.csr_array(sp.coo_array(entries, shape=(self.size, self.size)).tocsr())

    def along(self, directions: FloatArray, delta: float) -> Block:
        """Rows of V^T H V >= delta for orthonormal directions V (3n,b)."""
        ahead, behind = directions[self.rows], directions[self.columns]
        upper = _upper(directions.shape[1])
        weights = np.stack([ahead[:, i] * behind[:, j] for i, j in upper])
        rows = sp.csr_array(np.asarray(weights @ self.slopes))
        return _positive(rows, (weights @ self.constant)[None], directions.shape[1], delta)

    def on(self, dofs: IntArray, delta: float) -> Block:
        """Rows of H[d, d] >= delta for every set of coordinates d in ``dofs`` (B,b)."""
        size = dofs.shape[1]
        pairs = np.array(_upper(size))
        wanted = dofs[:, pairs[:, 0]] * self.size + dofs[:, pairs[:, 1]]
        at = np.searchsorted(self.keys, wanted.ravel())
        return _positive(self.slopes[at], self.constant[at].reshape(wanted.shape), size, delta)

    def lowest_on(self, dofs: IntArray) -> FloatArray:
        """Lowest eigenvalues (B,) of H[d, d] for every set of coordinates d in ``dofs`` (B,b)."""
        wanted = dofs[:, :, None] * self.size + dofs[:, None, :]
        at = np.searchsorted(self.keys, wanted)
        return np.asarray(np.linalg.eigvalsh(self.values[at])[:, 0])


def _upper(size: int) -> list[tuple[int, int]]:
    """Entries of the upper triangle by columns, Clarabel's order."""
    return [(i, j) for j in range(size) for i in range(j + 1)]


def _positive(slopes: sp.csr_array, constants: FloatArray, size: int, delta: float) -> Block:
    """Cones of positive matrices (b,b) with upper triangles ``slopes`` tau + ``constants`` - delta.

    slopes (B b(b+1)/2, T), constants (B, b(b+1)/2); each block is scaled to size one.
    """
    blocks = len(constants)
    diagonal = np.array([i == j for i, j in _upper(size)])
    shifted = constants - delta * diagonal
    largest = np.abs(constants[:, diagonal]).max(axis=1, initial=0.0)
    unit = np.where(largest > 0.0, largest, 1.0)
    weight = np.where(diagonal, 1.0, np.sqrt(2.0)) / unit[:, None]
    rows = sp.csr_array(sp.diags_array(-weight.ravel()) @ slopes)
    cone = clarabel.NonnegativeConeT(1) if size == 1 else clarabel.PSDTriangleConeT(size)
    return rows, (shifted * weight).ravel(), [cone] * blocks
