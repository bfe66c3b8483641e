"""BFGS with backtracking for smooth, or nearly smooth, functions of many variables."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from casashell.inverse.inverse_hessian import QuasiNewton, worth_learning
from casashell.typing import FloatArray

Function = Callable[[FloatArray], tuple[float, FloatArray]]
Report = Callable[[int, FloatArray, float], None]

_ARMIJO, _SHORTEST = 1e-4, 2.0**-40
#: A descent that lowers the value by less than a thousandth in so many iterations is stuck at a kink.
_PATIENCE, _WORTH = 200, 0.999


@dataclass(frozen=True, eq=False)
class Descent:
    """Where a descent ended; ``reason`` is "goal", "flat", "stuck", "no lower point" or
    "iteration limit"."""

    x: FloatArray
    value: float
    slope: FloatArray
    iterations: int
    reason: str


def descend(
    function: Function,
    x: FloatArray,
    inverse: QuasiNewton,
    *,
    goal: float,
    longest: float,
    max_iterations: int,
    report: Report,
) -> Descent:
    """Lower ``function`` (value and gradient) from x (n,) until its value is ``goal`` or less.

    longest  largest change of a variable in one step
    Steps that do not increase the slope along themselves teach nothing and are left out; a direction
    that leads nowhere starts the approximation anew once.
    """
    value, slope = function(x)
    fresh, mark = True, np.inf
    for iteration in range(max_iterations):
        report(iteration, x, value)
        if value <= goal:
            return Descent(x, value, slope, iteration, "goal")
        if iteration % _PATIENCE == 0:
            if value > _WORTH * mark:
                return Descent(x, value, slope, iteration, "stuck")
            mark = value
        step = -inverse.times(slope)
        size = float(np.abs(step).max())
        if size == 0.0 or not np.isfinite(size):
            return Descent(x, value, slope, iteration, "flat")
        step *= min(1.0, longest / size)
        along = float(step @ slope)
        found = _lower(function, x, value, step, along) if along < 0.0 else None
        if found is None:
            if fresh:
                return Descent(x, value, slope, iteration, "no lower point")
            inverse.forget()
            fresh = True
            continue
        moved, lower, new_slope = found
        s, y = moved - x, new_slope - slope
        if worth_learning(s, y):
            inverse.learn(s, y)
            fresh = False
        x, value, slope = moved, lower, new_slope
    return Descent(x, value, slope, max_iterations, "iteration limit")


def _lower(
    function: Function, x: FloatArray, value: float, step: FloatArray, along: float
) -> tuple[FloatArray, float, FloatArray] | None:
    """First point on the way back from x + step that is low enough (Armijo)."""
    length = 1.0
    while length >= _SHORTEST:
        there = x + length * step
        found, slope = function(there)
        if np.isfinite(found) and found <= value + _ARMIJO * length * along:
            return there, found, slope
        # Minimum of the parabola through what is known, kept between a tenth and a half.
        bend = found - value - length * along
        best = -0.5 * along * length**2 / bend if np.isfinite(bend) and bend > 0.0 else 0.0
        length = float(np.clip(best, 0.1 * length, 0.5 * length))
    return None
