"""The smallest correction that satisfies all impact rows, where small includes stiffness.

    min over u   1/2 u^T (H (x) I_3) u     subject to   J (x* + u) >= bounds
    H = M + k Lap(E),   M lumped masses,  Lap(E) the graph Laplacian of all edges

(Pan, Huang, Bao 2016, Section 5.2.)  The term in k resists any change of an edge vector, so a push
on a few vertices is shared by their neighbours; k = 0 is the closeness of Harmon et al. 2008.
Every row about two strips has weights of sum zero and H has the row sums of M, so without pinned
vertices the correction keeps the momentum of the strips.

Clarabel solves the sparse primal problem.  H has a handful of entries a row, so this costs less
than a dense dual Hessian as soon as there are some hundred rows, and it proves infeasibility.
Lengths are told in thicknesses, masses in mean masses, so the tolerances mean the same anywhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import clarabel
import numpy as np
from scipy import sparse

from casashell.ribbon.bodies import Bodies
from casashell.ribbon.impacts import Rows
from casashell.typing import AnyArray, BoolArray, FloatArray, IntArray

# Programs in which rows are taken in one a vertex.
_CAREFUL = 3
# Share of the thickness by which a row may be missed: the smallest targets are 1e-3 of it.
_SATISFIED = 1e-5
_ACCEPTED = (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved)


@dataclass(frozen=True, eq=False)
class Correction:
    """x* + u (V,3) m and the multipliers (C,) of the rows, kg m (a force times a time squared)."""

    positions: FloatArray
    multipliers: FloatArray


@dataclass(frozen=True, eq=False)
class ImpactProgram:
    """The quadratic program of a set of strips.

    stiffness  k of a strip in units of the mean mass of its vertices, zero or more
    """

    bodies: Bodies
    stiffness: float

    @cached_property
    def hessian(self) -> AnyArray:
        """H (V,V) kg, sparse: the blocks of the strips."""
        bodies, edges = self.bodies, self.bodies.edges
        total = np.bincount(bodies.owner, weights=bodies.masses)
        mean = total / np.bincount(bodies.owner)
        k = self.stiffness * mean[bodies.owner[edges[:, 0]]]
        i, j = edges.T
        rows, columns = np.concatenate([i, j, i, j]), np.concatenate([i, j, j, i])
        shape = (bodies.count, bodies.count)
        laplacian = sparse.coo_matrix((np.concatenate([k, k, -k, -k]), (rows, columns)), shape)
        result: AnyArray = (sparse.diags(bodies.masses) + laplacian).tocsr()
        return result

    def solve(
        self, rows: Rows, proposed: FloatArray, known: BoolArray | None = None
    ) -> Correction | None:
        """The corrected positions, strips without a row left alone; None if rows contradict.

        Most rows follow from others.  So the program starts with the most violated row of each
        vertex and takes in more, in the end all that are violated, until the answer satisfies
        every row.  Rows that are ``known`` (C,) to carry something are taken from the beginning.
        """
        taken = np.zeros(len(rows), dtype=np.bool_) if known is None else known.copy()
        x, multipliers = proposed, np.zeros(len(rows))
        if taken.any():
            answer = self._solve(rows.subset(taken), proposed)
            if answer is None:
                return None
            x, multipliers[taken] = answer.positions, answer.multipliers
        attempt = 0
        while True:
            missing = rows.bounds - rows.values(x)
            missing[taken] = 0.0
            violated = np.flatnonzero(missing > _SATISFIED * self.bodies.thickness.min())
            if violated.size == 0:
                return Correction(x, multipliers)
            attempt += 1
            if attempt <= _CAREFUL:
                violated = violated[_worst(rows.vertices[violated], missing[violated])]
            taken[violated] = True
            answer = self._solve(rows.subset(taken), proposed)
            if answer is None:
                return None
            x, multipliers[taken] = answer.positions, answer.multipliers

    def _solve(self, rows: Rows, proposed: FloatArray) -> Correction | None:
        """All rows at once."""
        bodies = self.bodies
        involved = np.unique(bodies.owner[rows.vertices])
        ids = np.flatnonzero(np.isin(bodies.owner, involved) & bodies.free)
        length, mass = float(bodies.thickness.min()), float(bodies.masses.mean())
        h = self.hessian[ids][:, ids] / mass
        objective = sparse.triu(sparse.kron(h, sparse.eye(3)), format="csc")
        j = self._jacobian(rows, ids)
        missing = (rows.bounds - rows.values(proposed)) / length
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.max_threads = 1  # of so small systems more threads only wait for each other
        cones = [clarabel.NonnegativeConeT(len(rows))]
        solver = clarabel.DefaultSolver(
            objective, np.zeros(3 * len(ids)), -j, -missing, cones, settings
        )
        answer = solver.solve()
        if answer.status not in _ACCEPTED:
            return None
        positions = proposed.copy()
        positions[ids] += length * np.array(answer.x).reshape(-1, 3)
        return Correction(positions, length * mass * np.maximum(np.array(answer.z), 0.0))

    def _jacobian(self, rows: Rows, ids: IntArray) -> AnyArray:
        """J (C, 3 len(ids)), sparse: the columns of the given vertices."""
        place = np.full(self.bodies.count, -1)
        place[ids] = np.arange(len(ids))
        column = place[rows.vertices]
        row, corner = np.nonzero((column >= 0) & (rows.weights != 0.0))
        values = rows.weights[row, corner][:, None] * rows.normals[row]
        columns = 3 * column[row, corner][:, None] + np.arange(3)
        shape = (len(rows), 3 * len(ids))
        indices = (np.repeat(row, 3), columns.ravel())
        result: AnyArray = sparse.coo_matrix((values.ravel(), indices), shape).tocsc()
        return result


def _worst(vertices: IntArray, missing: FloatArray) -> IntArray:
    """Numbers of the rows that miss most at one or more of their vertices (C,4)."""
    order = np.argsort(-missing, kind="stable")
    first = np.unique(vertices[order], return_index=True)[1]
    return np.unique(order[first // vertices.shape[1]])
