"""Downhill directions for draping: shifted Newton, and conjugate gradients with a curvature exit."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from casashell.inverse.free_system import FreeSystem
from casashell.typing import FloatArray

#: First shift of an indefinite Hessian, relative to its mean diagonal, and how shifts change.
FIRST_SHIFT, RAISE, LOWER = 1e-4, 6.0, 8.0
LOWEST_SHIFT, HIGHEST_SHIFT = 1e-9, 1e4
#: A line search that cuts the step below this share asks for a larger shift.
SHORT = 0.3
MAX_CONJUGATE, STALE_AFTER = 400, 60


class Direction(Protocol):
    """Gives downhill steps (m,) for the free Hessian and gradient; learns from what became of them."""

    patience: int

    def find(self, entries: FloatArray, force: FloatArray) -> FloatArray:
        """Step from the entries of the full Hessian and the free gradient (m,)."""

    def accepted(self, share: float) -> None:
        """A line search took this share of the step."""

    def rejected(self) -> None:
        """No share of the step went downhill."""

    def forget(self) -> None:
        """The pose has jumped."""


class ShiftedNewton:
    """Newton with ``H + tau I``, tau raised until the inertia shows no negative eigenvalue."""

    patience = 4

    def __init__(self, system: FreeSystem) -> None:
        self.system = system
        self.shift = 0.0  # relative to the mean diagonal

    def find(self, entries: FloatArray, force: FloatArray) -> FloatArray:
        """Step of the smallest shift tried that makes the Hessian positive."""
        scale = self.system.diagonal_scale(entries) or 1.0
        while not self.system.factor(entries, self.shift * scale):
            if self.shift > HIGHEST_SHIFT:
                return -force / scale
            self.shift = max(RAISE * self.shift, FIRST_SHIFT)
        return -self.system.solve(force)

    def accepted(self, share: float) -> None:
        """Lower the shift after long steps, raise it after short ones."""
        if share >= SHORT:
            self.shift /= LOWER
            if self.shift < LOWEST_SHIFT:
                self.shift = 0.0
        else:
            self.shift = max(RAISE * self.shift, FIRST_SHIFT)

    def rejected(self) -> None:
        """Try a shorter step that is closer to steepest descent."""
        self.shift = max(RAISE * RAISE * self.shift, FIRST_SHIFT)

    def forget(self) -> None:
        """Start without a shift."""
        self.shift = 0.0


class ConjugateGradients:
    """Line search Newton-CG (Nocedal and Wright 2006, Alg. 7.1), as in Ly 2018.

    Preconditioned by the shifted Hessian of an earlier pose, which is factored anew when the
    iterations grow.
    """

    patience = 2

    def __init__(self, system: FreeSystem) -> None:
        self.system = system
        self._shifted = ShiftedNewton(system)
        self._fresh = False

    def find(self, entries: FloatArray, force: FloatArray) -> FloatArray:
        """Step of conjugate gradients, cut off where the curvature is not positive."""
        if not self._fresh:
            self._shifted.forget()
            self._shifted.find(entries, force)
            self._fresh = True
        matrix = self.system.matrix(entries)
        residual = force.copy()
        step = np.zeros_like(force)
        size = float(np.linalg.norm(force))
        goal = min(0.5, math.sqrt(size / (float(np.abs(matrix.data).max()) or 1.0))) * size
        goal = max(min(goal, 0.1 * size), 1e-12 * size)
        steep = self.system.solve(residual)
        direction, product = -steep, float(residual @ steep)
        for count in range(MAX_CONJUGATE):
            bent = matrix @ direction
            curvature = float(direction @ bent)
            if not curvature > 0.0:
                return step if count else direction
            length = product / curvature
            step = step + length * direction
            residual = residual + length * bent
            if float(np.linalg.norm(residual)) <= goal:
                break
            steep = self.system.solve(residual)
            before, product = product, float(residual @ steep)
            direction = -steep + product / before * direction
        if count > STALE_AFTER:
            self._fresh = False
        return step

    def accepted(self, share: float) -> None:
        """Nothing to learn: the direction has its own length."""

    def rejected(self) -> None:
        """Renew the preconditioner."""
        self._fresh = False

    def forget(self) -> None:
        """Renew the preconditioner."""
        self._fresh = False
