"""One implicit step by semismooth Newton on displacements and contact forces together.

Unknowns (d, f): balance g(d) = f at every vertex and the natural map Phi(f, d) = 0 at every touch.
Forces start from those of the step before, so that the first guess of what sticks does not depend on
how far the first guess of the displacements is from balance.  Steps are judged by the size of the next
correction under the same factor (the natural monotonicity test of Deuflhard 2004, Sec. 3.3), which
sees neither the units nor the stiffness; where that correction is small the factor is kept.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casashell.dynamics.linear import Balance, LinearStep, Move
from casashell.dynamics.system import System
from casashell.dynamics.touch import OPEN, Touches, natural_map
from casashell.engine.sparse_solver import SingularMatrix
from casashell.typing import FloatArray

#: Residual, in mean nodal weights, that ends a step.
TOLERANCE = 1e-9
#: The same where rounding does not let it get lower.
ROUNDING = 1e-6
#: Newton iterations of one step, corrections with a kept factor counted too.
BUDGET = 60
#: A factor is kept while corrections shrink by this factor.
_KEEP = 0.2
_SHORTEST = 1.0 / 64.0


@dataclass(frozen=True, eq=False)
class Solved:
    """Displacements d (V,3) m and forces f (C,3) N of a step.

    residual  largest of balance and natural map [N];  converged: it is below the goal
    """

    d: FloatArray
    f: FloatArray
    residual: float
    iterations: int
    converged: bool


class StepSolver:
    """Newton's method for the steps of one run."""

    def __init__(self, system: System, weight: float, size: float) -> None:
        self.system = system
        self.linear = LinearStep(system)
        self.weight, self.size = weight, size
        self.iterations = 0
        self.stiffest = 0.0

    def balance(self, touches: Touches, d: FloatArray, f: FloatArray, g: FloatArray) -> Balance:
        """Residuals at (d, f) where the forces of the step are g (V,3)."""
        force = g - touches.spread(f, len(d))
        force[~self.system.free] = 0.0
        return Balance(force, natural_map(touches, f, d))

    @property
    def goal(self) -> float:
        """Residual [N] that counts as none: the tolerance, or what rounding of positions makes."""
        rounding = 4.0 * np.finfo(float).eps * self.stiffest * self.size
        return max(TOLERANCE * self.weight, min(rounding, ROUNDING * self.weight))

    def solve(
        self, touches: Touches, d: FloatArray, f: FloatArray, h: float, *, convex: bool = False
    ) -> Solved:
        """The step from a first guess (d, f); at least one correction is always made.

        Never raises for what the numbers do: a step that does not converge says so.
        """
        with np.errstate(all="ignore"):
            try:
                return self._iterate(touches, d, f, h, convex)
            except SingularMatrix:
                self.linear.forget()
                return Solved(d, f, np.inf, 0, False)

    def _at(self, touches: Touches, d: FloatArray, f: FloatArray) -> Balance:
        return self.balance(touches, d, f, self.system.force(d))

    def _iterate(
        self, touches: Touches, d: FloatArray, f: FloatArray, h: float, convex: bool
    ) -> Solved:
        linear, move, count = self.linear, None, 0
        at = self._at(touches, d, f)
        if linear.fits(touches, at.law, h):
            move = linear.solve(at)
        best = Solved(d, f, at.size, 0, False)
        while count < BUDGET:
            count += 1
            if move is None:
                move, at = self._fresh(touches, d, f, h, convex)
            size, before = _length(move.d), at.size
            d, f, at, after, shrink = self._advance(touches, d, f, move, size)
            self.iterations += 1
            if not np.isfinite(at.size):
                break
            if at.size < best.residual or count == 1:
                best = Solved(d, _cut(f, at), at.size, count, False)
            if at.size <= self.goal:
                return Solved(d, _cut(f, at), at.size, count, True)
            same = linear.fits(touches, at.law, h)
            move = after if same and shrink <= _KEEP else None
            if at.size > 0.5 * before and _length(after.d) <= 4e-16 * self.size:
                break  # no correction is left to make
        small = best.residual <= max(self.goal, ROUNDING * self.weight)
        return Solved(best.d, best.f, best.residual, count, small)

    def _fresh(
        self, touches: Touches, d: FloatArray, f: FloatArray, h: float, convex: bool
    ) -> tuple[Move, Balance]:
        """Correction by a new factor at (d, f)."""
        g, entries = self.system.linearised(d, convex=convex)
        self.stiffest = float(np.abs(entries).max(initial=0.0))
        at = self.balance(touches, d, f, g)
        self.linear.factor(entries, touches, at.law, h)
        return self.linear.solve(at), at

    def _advance(
        self, touches: Touches, d: FloatArray, f: FloatArray, move: Move, size: float
    ) -> tuple[FloatArray, FloatArray, Balance, Move, float]:
        """The point reached, its residuals, the next correction and how much shorter that is."""
        share = 1.0
        while True:
            reached, pushed = d + share * move.d, f + share * move.f
            at = self._at(touches, reached, pushed)
            if not np.isfinite(at.size):
                after, shrink = move, np.inf
            else:
                after = self.linear.solve(at)
                shrink = _length(after.d) / size if size > 0.0 else 0.0
            if at.size <= self.goal or shrink <= 1.0 or share <= _SHORTEST:
                return reached, pushed, at, after, shrink
            share *= 0.5


def _cut(f: FloatArray, at: Balance) -> FloatArray:
    """Forces (C,3) without the rounding that is left where a touch is open."""
    return np.asarray(np.where((at.law.state == OPEN)[:, None], 0.0, f))


def _length(move: FloatArray) -> float:
    """Root mean square of the displacements [m]."""
    return float(np.sqrt((move * move).sum() / max(len(move), 1)))
