"""One implicit step by semismooth Newton on displacements and contact forces together.

Unknowns (d, f): balance g(d) = f at every vertex and the natural map Phi(f, d) = 0 at every touch.
Forces start from those of the step before, so that the first guess of what sticks does not depend on
how far the first guess of the displacements is from balance.  A move is cut where the energy of the step,
with the contact forces at the end of the move, would rise; contact changes its branches in full steps.
A factor is kept while corrections with it shrink fast.  An iteration that makes no progress is given up
early: `casashell.dynamics.sequence` or a shorter step is cheaper than going round in circles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casashell.dynamics.linear import Balance, LinearStep, Move
from casashell.dynamics.system import System
from casashell.dynamics.touch import OPEN, Touches, natural_map
from casashell.engine.sparse_solver import SingularMatrix
from casashell.typing import BoolArray, FloatArray

#: Residual, in mean nodal weights, that ends a step.
TOLERANCE = 1e-9
#: The same where rounding does not let it get lower, as it is where a shell is crushed.
ROUNDING = 1e-3
#: Newton iterations of one step, corrections with a kept factor counted too.
BUDGET = 60
#: Residual, in mean nodal weights, that will do where iterations bring no more.
_SMALL = 1e-6
#: A factor is kept while corrections shrink by this factor.
_KEEP = 0.2
_SHORTEST, _LEAST = 1.0 / 1024.0, 1.0 / 64.0
#: Share of the residual that the shell may have where only contact is linearised anew.
_STRAIGHT = 0.1
#: No vertex moves farther in an iteration than so many mean edge lengths.
_FARTHEST = 1.0
#: Share of the promised decrease of energy that a move must bring.
_ARMIJO = 1e-4
#: Iterations without a smaller residual that end a step.
_PATIENCE = 6
#: A touch that changes so often between open and closed is taken for jammed.
_FLIPS = 3


@dataclass(frozen=True, eq=False)
class Solved:
    """Displacements d (V,3) m and forces f (C,3) N of a step.

    residual  largest of balance and natural map [N];  converged: it is below the goal
    tangled   contact, not the shape of the shell, kept it from converging
    balanced  the shell is all but in balance: what is left of the residual is contact's
    """

    d: FloatArray
    f: FloatArray
    residual: float
    iterations: int
    converged: bool
    tangled: bool = False
    balanced: bool = False


class StepSolver:
    """Newton's method for the steps of one run."""

    def __init__(self, system: System, weight: float, size: float) -> None:
        self.system = system
        self.linear = LinearStep(system)
        self.weight, self.size = weight, size
        self.iterations = 0
        self.stiffest = 0.0
        corners = system.rest[system.faces]
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        self.farthest = _FARTHEST * float(sides.mean()) if sides.size else np.inf

    def balance(
        self,
        touches: Touches,
        d: FloatArray,
        f: FloatArray,
        g: FloatArray,
        tried: BoolArray | None = None,
    ) -> Balance:
        """Residuals at (d, f) where the forces of the step are g (V,3); tried: see `natural_map`."""
        force = g - touches.spread(f, len(d))
        force[~self.system.free] = 0.0
        return Balance(force, natural_map(touches, f, d, tried))

    @property
    def noticed(self) -> float:
        """Difference of energies [J] that is no rounding: a weight over a billionth of the size."""
        return 1e-9 * self.weight * self.size

    @property
    def goal(self) -> float:
        """Residual [N] that counts as none: the tolerance, or what rounding of positions makes."""
        rounding = 4.0 * np.finfo(float).eps * self.stiffest * self.size
        return max(TOLERANCE * self.weight, min(rounding, ROUNDING * self.weight))

    def solve(
        self, touches: Touches, d: FloatArray, f: FloatArray, h: float, *, energy: bool = False
    ) -> Solved:
        """The step from a first guess (d, f); at least one correction is always made.

        energy  moves are cut by the energy of the step, not by the size of the next correction

        Never raises for what the numbers do: a step that does not converge says so.
        """
        with np.errstate(all="ignore"):
            try:
                return self._iterate(touches, d, f, h, energy)
            except SingularMatrix:
                self.linear.forget()
                return Solved(d, f, np.inf, 0, False)

    def _at(self, touches: Touches, d: FloatArray, f: FloatArray) -> Balance:
        return self.balance(touches, d, f, self.system.force(d))

    def _iterate(
        self, touches: Touches, d: FloatArray, f: FloatArray, h: float, energy: bool
    ) -> Solved:
        linear = self.linear
        at = self._at(touches, d, f)
        move = linear.solve(at) if linear.fits(touches, at.law, h) else None
        best = Solved(d, f, at.size, 0, False)
        watch = _Progress(touches)
        for count in range(1, BUDGET + 1):
            if move is None:
                tried = watch.jammed(at)
                move = self._adapted(touches, at, h) if tried is None and count > 1 else None
                if move is None:
                    move, at = self._fresh(touches, d, f, h, energy, tried)
            size, before = _length(move.d), at.size
            if energy:
                share, d, f, at = self.advance(touches, d, f, move)
            else:
                share, d, f, at = self._damped(touches, d, f, move)
            self.iterations += 1
            if not np.isfinite(at.size):
                break
            if at.size < best.residual or count == 1:
                best = Solved(d, _cut(f, at), at.size, count, False)
            if at.size <= self.goal:
                return Solved(d, _cut(f, at), at.size, count, True)
            if watch.stuck(at, share):
                break
            move, shrink = None, np.inf
            if share == 1.0 and linear.fits(touches, at.law, h):
                move = linear.solve(at)
                shrink = _length(move.d) / size if size > 0.0 else 0.0
                if at.size > 0.5 * before and _length(move.d) <= 4e-16 * self.size:
                    break  # no correction is left to make
                move = move if shrink <= _KEEP else None
        small = best.residual <= max(self.goal, _SMALL * self.weight)
        balanced = self._at(touches, best.d, best.f).force_size <= _STRAIGHT * best.residual
        tangled = watch.whole > watch.waited // 2
        return Solved(best.d, best.f, best.residual, count, small, tangled, balanced)

    def _adapted(self, touches: Touches, at: Balance, h: float) -> Move | None:
        """Correction by the factor kept with changed branches, where contact is what is off."""
        if at.force_size > _STRAIGHT * at.size or not self.linear.adapt(touches, at.law, h):
            return None
        move = self.linear.solve(at)
        return move if np.isfinite(move.d).all() else None

    def _fresh(
        self,
        touches: Touches,
        d: FloatArray,
        f: FloatArray,
        h: float,
        energy: bool,
        tried: BoolArray | None,
    ) -> tuple[Move, Balance]:
        """Correction by a new factor at (d, f), of the convex part where the energy would rise."""
        for kind in (False, True):
            g, entries = self.system.linearised(d, convex=kind)
            self.stiffest = float(np.abs(entries).max(initial=0.0))
            at = self.balance(touches, d, f, g, tried)
            self.linear.factor(entries, touches, at.law, h)
            move = self.linear.solve(at)
            if kind or not energy or self._slope(touches, at, f, move) <= 0.0:
                break
        return move, at

    def _slope(self, touches: Touches, at: Balance, f: FloatArray, move: Move) -> float:
        """Slope of the step's energy along a move, with the contact forces at its end."""
        return float(((at.force - touches.spread(move.f, len(move.d))) * move.d).sum())

    def _damped(
        self, touches: Touches, d: FloatArray, f: FloatArray, move: Move
    ) -> tuple[float, FloatArray, FloatArray, Balance]:
        """Like `advance`, with moves cut until the next correction is no longer than this one."""
        share, size = 1.0, _length(move.d)
        while True:
            reached, pushed = d + share * move.d, f + share * move.f
            at = self._at(touches, reached, pushed)
            if at.size <= self.goal or share <= _LEAST:
                break
            if np.isfinite(at.size) and _length(self.linear.solve_motion(at)) <= size:
                break
            share *= 0.5
        return share, reached, pushed, at

    def advance(
        self, touches: Touches, d: FloatArray, f: FloatArray, move: Move
    ) -> tuple[float, FloatArray, FloatArray, Balance]:
        """The share of the move made, the point reached and its residuals."""
        longest = float(np.abs(move.d).max(initial=0.0))
        share = min(1.0, self.farthest / longest) if longest > 0.0 else 1.0
        reached, pushed = d + share * move.d, f + share * move.f
        at = self._at(touches, reached, pushed)
        here = self._at(touches, d, f)
        if share == 1.0 and at.force_size <= max(0.5 * here.force_size, self.goal):
            return 1.0, reached, pushed, at
        slope = self._slope(touches, here, f, move)
        carried = touches.spread(f + move.f, len(d))
        start = self.system.action(d)
        slack = 1e-12 * abs(start)

        def rise(share: float) -> float:
            gained = self.system.action(d + share * move.d) - start
            return gained - share * float((carried * move.d).sum())

        first, least = rise(share), _SHORTEST * share
        if first <= _ARMIJO * share * slope + slack:
            # The convex part is stiffer than the shell: go on while the energy falls.
            while 2.0 * share * longest <= self.farthest:
                second = rise(2.0 * share)
                if not second < min(1.5 * first, -slack):
                    break
                first, share = second, 2.0 * share
        else:
            while share > least and not rise(share) <= _ARMIJO * share * slope + slack:
                share *= 0.5
        reached, pushed = d + share * move.d, f + min(share, 1.0) * move.f
        return share, reached, pushed, self._at(touches, reached, pushed)


class _Progress:
    """Tells when the iteration goes round in circles, and which touches do.

    Friction may press a vertex that slides into the surface harder than the push itself lifts it off:
    then neither open nor sliding is a solution, and Newton's method flips between them for ever.
    Such a vertex is jammed; it is taken for sticking, from where the iteration finds its way.
    """

    def __init__(self, touches: Touches) -> None:
        self.lowest, self.waited, self.whole = np.inf, 0, 0
        self._open: BoolArray | None = None
        self._flips = np.zeros(len(touches), dtype=np.int64)

    def stuck(self, at: Balance, share: float) -> bool:
        """Whether the residual has not become smaller for `_PATIENCE` iterations."""
        if at.size < 0.7 * self.lowest:
            self.lowest, self.waited, self.whole = at.size, 0, 0
        else:
            self.waited += 1
            self.whole += int(share >= 1.0)
        return self.waited > _PATIENCE

    def jammed(self, at: Balance) -> BoolArray | None:
        """Touches (C,) that have opened and closed again, if any."""
        now = at.law.state == OPEN
        if self._open is not None:
            self._flips += now != self._open
        self._open = now
        jammed = (self._flips >= _FLIPS) & now
        self._flips[jammed] = 0
        return jammed if jammed.any() else None


def _cut(f: FloatArray, at: Balance) -> FloatArray:
    """Forces (C,3) without the rounding that is left where a touch is open."""
    return np.asarray(np.where((at.law.state == OPEN)[:, None], 0.0, f))


def _length(move: FloatArray) -> float:
    """Root mean square of the displacements [m]."""
    return float(np.sqrt((move * move).sum() / max(len(move), 1)))
