"""BFGS with backtracking for smooth, or nearly smooth, functions of many variables."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

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


class InverseHessian(Protocol):
    """Approximation of the inverse Hessian that learns from steps."""

    def __matmul__(self, g: FloatArray) -> FloatArray:
        """Product with a gradient."""

    def learn(self, s: FloatArray, y: FloatArray) -> None:
        """Take in a step s that changed the gradient by y, with s.y > 0."""

    def forget(self) -> None:
        """Back to the start."""


Solve = Callable[[FloatArray], FloatArray]


class Dense:
    """The BFGS update of a full matrix (Nocedal and Wright 2006, Eq. 6.17).

    start  (n,n) positive definite to begin with; by default a multiple of the identity, found from
           the first step
    """

    def __init__(self, size: int, start: FloatArray | None = None) -> None:
        self._start, self._size = start, size
        self._matrix: FloatArray = np.empty((0, 0))
        self._unscaled = True
        self.forget()

    def __matmul__(self, g: FloatArray) -> FloatArray:
        return np.asarray(self._matrix @ g)

    def learn(self, s: FloatArray, y: FloatArray) -> None:
        """Rank-two update."""
        sy = float(s @ y)
        if self._unscaled:
            self._matrix *= sy / float(y @ y)
            self._unscaled = False
        hy = self._matrix @ y
        self._matrix += np.outer(((sy + y @ hy) / sy**2) * s - hy / sy, s)
        self._matrix -= np.outer(s, hy / sy)

    def forget(self) -> None:
        """Back to the start."""
        self._unscaled = self._start is None
        self._matrix = np.eye(self._size) if self._start is None else self._start.copy()


class Limited:
    """Two-loop recursion over the last ``memory`` steps (Nocedal and Wright 2006, Alg. 7.4).

    start  product with the matrix to begin with; by default a multiple of the identity, found from
           the last step
    """

    def __init__(self, start: Solve | None = None, memory: int = 30) -> None:
        self._start = start
        self._steps: deque[tuple[FloatArray, FloatArray, float]] = deque(maxlen=memory)

    def __matmul__(self, g: FloatArray) -> FloatArray:
        q, shares = g.copy(), []
        for s, y, sy in reversed(self._steps):
            share = float(s @ q) / sy
            shares.append(share)
            q -= share * y
        if self._start is not None:
            q = self._start(q)
        elif self._steps:
            _, y, sy = self._steps[-1]
            q *= sy / float(y @ y)
        for (s, y, sy), share in zip(self._steps, reversed(shares), strict=True):
            q += (share - float(y @ q) / sy) * s
        return q

    def learn(self, s: FloatArray, y: FloatArray) -> None:
        """Remember a step."""
        self._steps.append((s, y, float(s @ y)))

    def forget(self) -> None:
        """Back to the start."""
        self._steps.clear()


def descend(
    function: Function,
    x: FloatArray,
    inverse: InverseHessian,
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
        step = -(inverse @ slope)
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
        if float(s @ y) > 1e-12 * float(np.linalg.norm(s) * np.linalg.norm(y)):
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
