"""The mesh nearest to a natural metric that no mesh has: for pictures and as a starting shape."""

from __future__ import annotations

from functools import cache
from typing import Final

import casadi as ca
import numpy as np
import scipy.sparse as sp

from casashell.engine.sparse_solver import SingularMatrix, make_solver
from casashell.inverse.metric_state import MetricState
from casashell.metric import Metric
from casashell.typing import FloatArray

MAX_STEPS: Final = 30
_DAMPING: Final = (1e-6, 1e-4, 1e-2, 1.0, 1e2)


@cache
def _with_slope(measure: str) -> ca.Function:
    """x (3,k) -> q and dq/dx (3k,)."""
    of = ca.Function.deserialize(measure)
    x = ca.SX.sym("x", 3, of.size2_in(0))
    return ca.Function("fit", [x], [of(x), ca.vec(ca.gradient(of(x), x))])


def nearest_mesh(state: MetricState, metric: Metric) -> FloatArray:
    """Positions (n,3) of a piece with the least  sum c (q - n_0)^2 / 2  [J] near its target.

    Levenberg-Marquardt; n_0 are the natural lengths and angles, c the stiffness at the metric.
    """
    stiffness = np.sqrt(state.strained(metric).c)
    goals = np.concatenate(state.natural_numbers(metric))
    shape = state.piece.target.copy()
    miss, slope = _miss(state, shape, goals, stiffness)
    for _ in range(MAX_STEPS):
        normal, gradient = sp.csr_array(slope.T @ slope), slope.T @ miss
        before = float(miss @ miss)
        for damping in _DAMPING:
            step = _step(normal, gradient, damping)
            trial = shape - step.reshape(-1, 3)
            trial_miss, trial_slope = _miss(state, trial, goals, stiffness)
            if float(trial_miss @ trial_miss) < before:
                break
        else:
            return shape
        shape, miss, slope = trial, trial_miss, trial_slope
        if float(miss @ miss) > (1.0 - 1e-4) * before:
            return shape
    return shape


def _step(normal: sp.csr_array, gradient: FloatArray, damping: float) -> FloatArray:
    scale = float(normal.diagonal().mean()) or 1.0
    system = sp.csr_array(normal + damping * scale * sp.eye_array(normal.shape[0]))
    system.sort_indices()
    solver = make_solver(system.indptr, system.indices, "symmetric")
    try:
        solver.factor(system.data)
    except SingularMatrix:
        return np.zeros_like(gradient)
    return solver.solve(gradient)


def _miss(
    state: MetricState, shape: FloatArray, goals: FloatArray, weights: FloatArray
) -> tuple[FloatArray, sp.csr_array]:
    """Weighted differences (T,) of the measures at ``shape`` from their goals, and slopes (T,3n)."""
    values, rows, columns, slopes = [], [], [], []
    for at, term in enumerate(state.terms):
        if term.measure is None:
            raise ValueError(f"energy '{term.name}' has no strain measure")
        count = len(term.stencils)
        points = shape[term.stencils].reshape(-1, 3).T
        measured, slope = _with_slope(term.measure.serialize()).map(count)(points)
        values.append(np.asarray(measured).ravel())
        slopes.append(np.asarray(slope).T.ravel())
        dofs = (3 * term.stencils[:, :, None] + np.arange(3)).reshape(count, -1)
        columns.append(dofs.ravel())
        rows.append(np.repeat(np.arange(state.ends[at], state.ends[at + 1]), dofs.shape[1]))
    entries = (np.concatenate(slopes), (np.concatenate(rows), np.concatenate(columns)))
    slope_matrix = sp.csr_array(entries, shape=(state.size, shape.size))
    weighted = sp.csr_array(sp.diags_array(weights) @ slope_matrix)
    return weights * (np.concatenate(values) - goals), weighted
