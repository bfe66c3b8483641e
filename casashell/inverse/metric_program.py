"""The convex program of a natural metric, linearised once: strain forces and contact forces that
balance the target, strong enough to be stable.

    min  sum tau^2 / (2 c)   s.t.   sum tau dq/dx + dE_load/dx(tau) = contact forces in their cones
                                    V^T H(tau) V >= delta I   for every block V of cut directions

The balance is linear but for the weight, which follows the rest lengths through the areas, and the
Hessian affine but for the areas in the bending stiffness: both are linearised at the last metric.
Bounds keep natural lengths within a factor of the lengths, and triangles triangles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import clarabel
import numpy as np
import scipy.sparse as sp

from casashell.engine.sparse_solver import SingularMatrix, make_solver
from casashell.inverse.forces import Block, Shrink, cone_rows, contact_frames, run_clarabel
from casashell.inverse.metric_state import MetricState, Strained
from casashell.metric import Metric, thinness
from casashell.typing import FloatArray, IntArray

#: A natural length stays within this factor of the length.
LENGTH_FACTOR: Final = 4.0
#: Least (two short sides - longest side) / longest side of a natural triangle.
THINNEST: Final = 1e-3
#: Triangles thinner than this times the bound, or than the bound allows next, are watched.
_WATCHED: Final = 0.2


@dataclass(frozen=True, eq=False)
class Balanced:
    """Strain forces (T,) and contact forces as columns of the contact frames (m,), in f0."""

    tau: FloatArray
    columns: FloatArray


class MetricProgram:
    """The program of one piece; `at` linearises, `solve` runs it."""

    def __init__(self, state: MetricState) -> None:
        self.state, self.piece = state, state.piece
        contacts = self.piece.contacts
        self.frames, self.owner = contact_frames(contacts)
        at = (3 * contacts.vertices[:, None] + np.arange(3)).ravel()
        scatter = sp.csr_array(
            (np.ones(len(at)), (at, np.arange(len(at)))), shape=(self.piece.target.size, len(at))
        )
        self.push = sp.csr_array(scatter @ self.frames)
        free = np.ones(len(self.piece.target), dtype=bool)
        free[self.piece.pinned] = False
        self.rows = np.flatnonzero(np.repeat(free, 3))
        self.slopes = state.program.slopes
        self.watched = np.zeros(len(state.index.mesh.faces), dtype=bool)
        # Strain energy as at the target: with that of the last metric it would never settle.
        self.scale = np.sqrt(state.strained(state.start).c * self.piece.f0 * self.piece.h)
        self.at(state.start)

    def at(self, metric: Metric) -> None:
        """Linearise at a metric."""
        self.metric, state = metric, self.state
        self.now: Strained = state.strained(metric)
        self.weight, self.weight_slope = state.load(metric, self.now.reply)
        thin = thinness(metric.rest_length[state.index.sides])
        self.watched |= thin < _WATCHED

    def residual(self, columns: FloatArray) -> FloatArray:
        """What is out of balance on the vertices that are not pinned, / f0."""
        total = self.slopes @ self.now.tau + self.weight
        return np.asarray((total / self.piece.f0 - self.push @ columns)[self.rows])

    def forces(self, columns: FloatArray) -> FloatArray:
        """Contact forces (C,3) [N]."""
        return np.asarray((self.frames @ columns).reshape(-1, 3) * self.piece.f0)

    def solve(self, shrink: Shrink, cuts: Sequence[Block] = ()) -> Balanced | None:
        """Least strain energy in the shrunk cones; None when there is no solution.

        cuts   rows over the strain forces alone, from `StiffnessMap`
        """
        elements, m = self.state.size, self.frames.shape[1]
        blocks = [self._balance_rows(), *self._bounds(m)]
        if m:
            inside, bound, cones = cone_rows(self.piece.contacts, self.owner, shrink, shrink.floor)
            empty = sp.csr_array((inside.shape[0], elements))
            blocks.append((sp.csr_array(sp.hstack([empty, inside])), bound, cones))
        for rows, bound, cones in cuts:
            scaled = rows @ sp.diags_array(self.scale)
            padded = sp.hstack([scaled, sp.csr_array((rows.shape[0], m))])
            blocks.append((sp.csr_array(padded), bound, cones))
        quadratic = sp.diags_array(
            np.concatenate([np.ones(elements), np.full(m, 1e-9)]), format="csc"
        )
        found, _, _ = run_clarabel(quadratic, np.zeros(elements + m), blocks)
        if found is None:
            return None
        return Balanced(found[:elements] * self.scale, found[elements:])

    def polished(self, found: Balanced) -> Balanced:
        """The same, moved by least squares onto the linearised balance to rounding."""
        # Unknown change: strain forces in the units of the program, contact forces in f0.
        jacobian = self._jacobian()
        weights = np.concatenate([np.ones(self.state.size), np.full(self.frames.shape[1], 1.0)])
        normal = sp.csr_array(jacobian @ sp.diags_array(weights) @ jacobian.T)
        normal = sp.csr_array(
            normal + 1e-13 * float(normal.diagonal().mean()) * sp.eye_array(normal.shape[0])
        )
        normal.sort_indices()
        solver = make_solver(normal.indptr, normal.indices, "symmetric")
        try:
            solver.factor(normal.data)
        except SingularMatrix:
            return found
        y = np.concatenate([found.tau / self.scale, found.columns])
        for _ in range(3):
            y = y - weights * (jacobian.T @ solver.solve(jacobian @ y + self._constant()))
        return Balanced(y[: self.state.size] * self.scale, y[self.state.size :])

    def _jacobian(self) -> sp.csr_array:
        by_tau = (self.slopes + self.weight_slope) @ sp.diags_array(self.scale / self.piece.f0)
        return sp.csr_array(sp.csr_array(sp.hstack([by_tau, -self.push]))[self.rows])

    def _constant(self) -> FloatArray:
        """The linearised imbalance without strain and contact forces, / f0."""
        constant = self.weight - self.weight_slope @ self.now.tau
        return np.asarray(constant[self.rows] / self.piece.f0)

    def _balance_rows(self) -> Block:
        return self._jacobian(), -self._constant(), [clarabel.ZeroConeT(len(self.rows))]

    def _bounds(self, m: int) -> list[Block]:
        """Natural lengths within their factor; watched triangles stay triangles."""
        low, high = self.state.length_bounds(LENGTH_FACTOR)
        bounded = np.flatnonzero(np.isfinite(low))
        identity = sp.csr_array(
            (np.ones(len(bounded)), (np.arange(len(bounded)), bounded)),
            shape=(len(bounded), self.state.size + m),
        )
        rows = sp.csr_array(sp.vstack([identity, -identity]))
        bound = np.concatenate([(high / self.scale)[bounded], -(low / self.scale)[bounded]])
        blocks: list[Block] = [(rows, bound, [clarabel.NonnegativeConeT(len(bound))])]
        faces = np.flatnonzero(self.watched)
        if len(faces):
            blocks.append(self._triangle_rows(faces, m))
        return blocks

    def _triangle_rows(self, faces: IntArray, m: int) -> Block:
        """Linearised a + b - (1 + THINNEST) c >= 0 for every side c of ``faces``."""
        state, count = self.state, len(faces)
        sides = self.metric.rest_length[state.index.sides[faces]]
        pattern = np.ones((3, 3)) - (2.0 + THINNEST) * np.eye(3)
        mixing = sp.kron(sp.eye_array(count), pattern, format="csr")
        slope = mixing @ state.side_slopes(self.now.reply, faces)
        size = np.repeat(sides.max(axis=1), 3)
        here = mixing @ sides.ravel() - slope @ self.now.tau
        by_tau = sp.diags_array(1.0 / size) @ slope @ sp.diags_array(self.scale)
        rows = sp.csr_array(sp.hstack([-by_tau, sp.csr_array((3 * count, m))]))
        return rows, here / size, [clarabel.NonnegativeConeT(3 * count)]
