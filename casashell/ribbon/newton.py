"""Newton's method on a box with the exact Hessian, for the augmented Lagrangian.

Unknowns at a bound that the gradient pushes against stay there; the others move along the Newton
direction, projected onto the box (Bertsekas 1982).  Where the Hessian is not positive definite its
eigenvalues, after scaling to a unit diagonal, are replaced by their absolute values.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve, eigh

from casashell.ribbon.augmented import Inner, Lagrangian, Schedule
from casashell.ribbon.program import Program, Stop
from casashell.typing import BoolArray, FloatArray

_ARMIJO = 1e-4
#: Least eigenvalue kept where the Hessian is not positive definite, as a part of the largest one.
_FLATTEST = 1e-6
#: Longest step of an unknown; these are angles, slopes and lengths over the length of a ribbon.
_LONGEST = 1.0
#: Backtracking steps; beyond them the step is too small to change anything.
_TRIALS = 40
#: Changes of the objective below this many units of rounding mean nothing.
_ROUNDING = 64 * np.finfo(float).eps


def _direction(hessian: FloatArray, gradient: FloatArray, free: BoolArray) -> FloatArray:
    """(n,) descent direction, zero for unknowns that are not free."""
    h, g = hessian[np.ix_(free, free)], gradient[free]
    made = np.zeros(len(gradient))
    try:
        factor = cho_factor(h, lower=True, check_finite=False)
        made[free] = -cho_solve(factor, g, check_finite=False)
    except LinAlgError:
        size = np.abs(np.diag(h))
        root = np.sqrt(np.maximum(size, 1e-12 * size.max(initial=1e-300)))
        value, vector = eigh(h / np.outer(root, root), check_finite=False)
        bent = np.maximum(np.abs(value), _FLATTEST * np.abs(value).max())
        made[free] = -(vector @ ((vector.T @ (g / root)) / bent)) / root
    made *= min(1.0, _LONGEST / max(np.abs(made).max(), 1e-300))
    return made


def _free(program: Program, z: FloatArray, gradient: FloatArray) -> BoolArray:
    near = min(1e-6, program.projected(z, gradient))
    held = (z <= program.lower + near) & (gradient > 0)
    held |= (z >= program.upper - near) & (gradient < 0)
    return ~held


def newton(function: Lagrangian, start: FloatArray, gradient: float, schedule: Schedule) -> Inner:
    """Minimum on the box until the projected gradient is below ``gradient``; see `Minimiser`."""
    program = function.program
    z = program.clipped(start)
    value, slope = function(z)
    evaluations = 1
    for iteration in range(schedule.inner + 1):
        if not (np.isfinite(value) and np.all(np.isfinite(slope))):
            return Inner(z, iteration, evaluations, Stop.NONFINITE)
        if program.projected(z, slope) <= gradient:
            return Inner(z, iteration, evaluations, Stop.CONVERGED)
        if iteration == schedule.inner:
            break
        hessian = function.hessian(z)
        if not np.all(np.isfinite(hessian)):
            return Inner(z, iteration, evaluations, Stop.NONFINITE)
        d = _direction(hessian, slope, _free(program, z, slope))
        found = _search(function, z, value, slope, d)
        evaluations += found.evaluations
        if not found.success:
            return Inner(z, iteration, evaluations, Stop.DECREASE)
        z, value, slope = found.z, found.value, found.slope
    return Inner(z, schedule.inner, evaluations, Stop.INNER_LIMIT)


@dataclass(frozen=True, eq=False)
class _Found:
    z: FloatArray
    value: float
    slope: FloatArray
    evaluations: int
    success: bool


def _search(
    function: Lagrangian, z: FloatArray, value: float, slope: FloatArray, d: FloatArray
) -> _Found:
    """Backtracking along the projected direction.

    In the last digits, where values tell nothing, a step that shrinks the gradient is taken.
    """
    program, step = function.program, 1.0
    blind = _ROUNDING * max(abs(value), 1.0)
    before = program.projected(z, slope)
    for trial in range(1, _TRIALS + 1):
        new = program.clipped(z + step * d)
        expected = float(slope @ (new - z))
        got, gradient = function(new)
        if np.isfinite(got) and np.all(np.isfinite(gradient)):
            lower = got <= value + _ARMIJO * min(expected, 0.0) and got < value - blind
            smaller = abs(got - value) <= blind and program.projected(new, gradient) < before
            if lower or smaller:
                return _Found(new, got, gradient, trial, True)
        step *= 0.5
    return _Found(z, value, slope, _TRIALS, False)
