"""Inverse Hessian approximations from gradients: BFGS, dense or with limited memory.

Both start from a given matrix, or from the multiple of the identity that fits the first step (Nocedal
and Wright 2006, Secs. 6.1 and 7.2).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Protocol

import numpy as np

from casashell.typing import FloatArray

#: Curvature s.y below this share of |s||y| is rounding or a kink and is not learned from.
CURVATURE = 1e-12


class QuasiNewton(Protocol):
    """Approximate inverse Hessian of a function of m variables."""

    def times(self, gradient: FloatArray) -> FloatArray:
        """Approximate inverse Hessian times a vector (m,)."""

    def learn(self, step: FloatArray, change: FloatArray) -> None:
        """Take in a step (m,) and the change of the gradient along it (m,)."""

    def forget(self) -> None:
        """Go back to the start."""


def worth_learning(step: FloatArray, change: FloatArray) -> bool:
    """Whether the curvature along the step is positive beyond rounding."""
    size = float(np.linalg.norm(step) * np.linalg.norm(change))
    return size > 0.0 and float(step @ change) > CURVATURE * size


class DenseBfgs:
    """BFGS with the full inverse Hessian, 8 m^2 bytes; only its lower triangle is kept up.

    start  (m,m) positive definite to begin with
    """

    def __init__(self, size: int, start: FloatArray | None = None) -> None:
        from scipy.linalg import blas  # slow to import

        self._blas = blas
        self._start, self._size = start, size
        self._unscaled = start is None
        self._inverse: FloatArray = np.empty((0, 0))
        self.forget()

    def times(self, gradient: FloatArray) -> FloatArray:
        """Approximate inverse Hessian times a vector (m,)."""
        if not len(gradient):
            return np.zeros(0)
        return np.asarray(self._blas.dsymv(1.0, self._inverse, gradient, lower=1))

    def learn(self, step: FloatArray, change: FloatArray) -> None:
        """Rank-two update; skipped when the curvature is not positive."""
        if not worth_learning(step, change):
            return
        rho = 1.0 / float(step @ change)
        if self._unscaled:
            self._inverse *= 1.0 / (rho * float(change @ change))
            self._unscaled = False
        turned = self.times(change)
        weight = rho * (1.0 + rho * float(change @ turned))
        # One symmetric product: s u^T + u s^T with u = weight/2 s - rho H y, in place.
        half = 0.5 * weight * step - rho * turned
        update = self._blas.dsyr2
        self._inverse = update(1.0, step, half, a=self._inverse, lower=1, overwrite_a=1)

    def forget(self) -> None:
        """Go back to the start."""
        self._unscaled = self._start is None
        first = np.eye(self._size) if self._start is None else self._start
        self._inverse = np.array(first, order="F")


class LimitedBfgs:
    """L-BFGS: the last ``memory`` pairs, 16 m bytes each.

    start  product of a vector (m,) with the matrix to begin with
    """

    def __init__(
        self, start: Callable[[FloatArray], FloatArray] | None = None, memory: int = 30
    ) -> None:
        self._start = start
        self._pairs: deque[tuple[FloatArray, FloatArray, float]] = deque(maxlen=memory)

    def times(self, gradient: FloatArray) -> FloatArray:
        """Approximate inverse Hessian times a vector (m,), by the two-loop recursion."""
        vector = np.array(gradient, dtype=np.float64)
        shares = []
        for step, change, rho in reversed(self._pairs):
            share = rho * float(step @ vector)
            shares.append(share)
            vector -= share * change
        if self._start is not None:
            vector = self._start(vector)
        elif self._pairs:
            _, change, rho = self._pairs[-1]
            vector /= rho * float(change @ change)
        for (step, change, rho), share in zip(self._pairs, reversed(shares), strict=True):
            vector += (share - rho * float(change @ vector)) * step
        return vector

    def learn(self, step: FloatArray, change: FloatArray) -> None:
        """Keep the pair; skipped when the curvature is not positive."""
        if worth_learning(step, change):
            self._pairs.append((step, change, 1.0 / float(step @ change)))

    def forget(self) -> None:
        """Go back to the start."""
        self._pairs.clear()
