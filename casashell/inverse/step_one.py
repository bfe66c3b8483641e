"""Step one of Ly 2018: the natural shape whose drape comes nearest to the target (Eq. 20, Alg. 2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from casashell.inverse.adjoint import Adjoint, adjoint, carried_along
from casashell.inverse.drape import BUDGET, TOLERANCE, Draped, DrapeMethod, Draper
from casashell.inverse.free_system import FreeSystem
from casashell.inverse.inverse_hessian import DenseBfgs, LimitedBfgs, QuasiNewton
from casashell.inverse.line_search import Trial, weak_wolfe
from casashell.inverse.load_path import Report, longest_step
from casashell.inverse.pulled import Pulled
from casashell.result import Step
from casashell.typing import ArrayLike, FloatArray

StepOneMethod: TypeAlias = Literal["auto", "bfgs", "l-bfgs", "newton"]
METHODS: tuple[StepOneMethod, ...] = ("auto", "bfgs", "l-bfgs", "newton")
Reason: TypeAlias = Literal["target", "gradient", "step", "iterations", "stuck", "no drape"]

#: Vertices up to which the inverse Hessian is kept dense: 160 MB.
DENSE_UP_TO = 1500
#: Iterations of a drape along a line: one that needs more has left for another minimum.
TRIAL_BUDGET = 40
#: Trials along a line, and iterations without Newton after it did not go down.
NEWTON_TRIES, BFGS_TRIES, PAUSE = 5, 12, 5


@dataclass(frozen=True)
class Limits:
    """When to stop.

    distance    J; times n h^2 if relative
    gradient    largest component of dJ/dr; times h [m] if relative
    step        largest component of a change of r; times h [m] if relative
    iterations  of the outer method
    """

    distance: float = 1e-18
    gradient: float = 1e-11
    step: float = 1e-12
    iterations: int = 500
    relative: bool = True

    def scaled(self, h: float, count: int) -> Limits:
        """The same in metres for mean edge length h [m] and ``count`` vertices."""
        if not self.relative:
            return self
        return Limits(
            self.distance * count * h * h, self.gradient * h, self.step * h, self.iterations, False
        )


#: Ly 2018, Sec. 7.1: in metres, which mostly means running to where nothing moves any more.
PAPER = Limits(distance=0.0, gradient=1e-15, step=1e-15, iterations=2000, relative=False)


@dataclass(frozen=True)
class StepOneShape:
    """A natural shape and how near its drape comes to the target.

    rest      (n,3) m;  draped  its pose;  distance  J = |pose - x_t|^2 / 2 [m2]
    gradient  largest component of dJ/dr [m]
    reason    what ended the iterations: J, gradient or step below its limit, too many iterations,
              no step lowers J, or no minimum of the energy to start from
    """

    rest: FloatArray
    draped: Draped
    distance: float
    gradient: float
    iterations: int
    evaluations: int
    reason: Reason

    @property
    def converged(self) -> bool:
        """At the target, or at a point where J has no slope."""
        return self.reason in ("target", "gradient")


@dataclass(frozen=True)
class _Point:
    rest: FloatArray
    draped: Draped
    adjoint: Adjoint


class StepOne:
    """Minimises J(r) = |Φ(r) - x_t|^2 / 2 over natural shapes whose fixed vertices do not move.

    method  "bfgs": the paper's; "l-bfgs": the same with limited memory; "auto": "bfgs" up to
            ``DENSE_UP_TO`` vertices and "l-bfgs" above; "newton": Newton on Φ(r) = x_t, with BFGS
            steps where it does not go down
    best    the best shape so far, also after an exception; ``pulled`` of the draper may be exchanged
            between calls of `solve`
    Raises ValueError for an unknown method and for fixed vertices that do not exist.
    """

    def __init__(
        self,
        pulled: Pulled,
        fixed: ArrayLike,
        *,
        method: StepOneMethod = "auto",
        drape: DrapeMethod = "newton",
        limits: Limits | None = None,
        tolerance: float = TOLERANCE,
        report: Report | None = None,
    ) -> None:
        if method not in METHODS:
            raise ValueError(f"step one must be one of {', '.join(METHODS)}; got '{method}'")
        piece = pulled.piece
        self.draper = Draper(pulled, fixed)
        self.target = piece.target
        self.limits = (limits or Limits()).scaled(piece.h, len(piece.target))
        self.unit = piece.h**2 * len(piece.target)
        self.drape_method: DrapeMethod = drape
        self.tolerance = tolerance
        self.report = report
        self.best: StepOneShape | None = None
        self.iterations = self.evaluations = self._resume = 0
        size = len(self.draper.system)
        limited = method == "l-bfgs" or (method != "bfgs" and len(self.target) > DENSE_UP_TO)
        self.curvature: QuasiNewton = LimitedBfgs() if limited else DenseBfgs(size)
        self._mixed: FreeSystem | None = None
        if method == "newton":
            pattern = piece.assembly.pattern
            self._mixed = FreeSystem(pattern, self.draper.fixed, "general")

    def solve(self, rest0: FloatArray, pose0: FloatArray | None = None) -> StepOneShape:
        """Natural shape from ``rest0`` (n,3), draped from ``pose0`` or the target.

        Fixed vertices stay where ``rest0`` has them in the natural shape, and are put at the target in
        the pose.  Never raises for shapes that do not drape.
        """
        self.best, self.iterations, self.evaluations, self._resume = None, 0, 0, 0
        self.curvature.forget()
        fixed = self.draper.fixed
        rest, pose = np.array(rest0, dtype=np.float64), self.target.copy()
        if pose0 is not None:
            pose[:] = pose0
            pose[fixed] = self.target[fixed]
        point = self._evaluate(rest, pose) or self._evaluate(rest, self.target)
        if point is None:
            return self._without_drape(rest)
        self._keep(point, "iterations")
        return self._iterate(point)

    def _iterate(self, point: _Point) -> StepOneShape:
        while True:
            reason = self._reason(point)
            if reason is not None:
                return self._keep(point, reason)
            reached = self._advance(point)
            self.iterations += 1
            if reached is None:
                reached = self._redraped(point)
                if reached is None:
                    return self._keep(point, "stuck")
                self.curvature.forget()
                point = reached
                continue
            moved = float(np.abs(reached.rest - point.rest).max())
            point = reached
            self._keep(point, "iterations")
            if moved <= self.limits.step:
                return self._keep(point, self._reason(point) or "step")

    def _reason(self, point: _Point) -> Reason | None:
        limits = self.limits
        if point.adjoint.distance <= limits.distance:
            return "target"
        if float(np.abs(point.adjoint.gradient).max()) <= limits.gradient:
            return "gradient"
        return "iterations" if self.iterations >= limits.iterations else None

    def _evaluate(self, rest: FloatArray, start: FloatArray, budget: int = BUDGET) -> _Point | None:
        """Drape and adjoint; None when there is no minimum to be found."""
        self.evaluations += 1
        draped = self.draper.drape(
            rest, start, method=self.drape_method, tolerance=self.tolerance, budget=budget
        )
        return _Point(rest, draped, adjoint(self.draper, rest, draped)) if draped.good else None

    def _redraped(self, point: _Point) -> _Point | None:
        """The same shape draped from the target, if that comes nearer to it."""
        found = self._evaluate(point.rest, self.target)
        if found is None or found.adjoint.distance > 0.99 * point.adjoint.distance:
            return None
        return found

    def _advance(self, point: _Point) -> _Point | None:
        """Next shape along the first direction that lowers J; curvature learned on the way."""
        system = self.draper.system
        gradient = system.restrict(point.adjoint.gradient)
        move = self._newton_move(point)
        reached = self._search(point, move, NEWTON_TRIES)
        if reached is None:
            if move is not None:
                self._resume = self.iterations + PAUSE
            reached = self._search(point, system.extend(-self.curvature.times(gradient)))
        if reached is None and not self._mixed:
            self.curvature.forget()
            reached = self._search(point, system.extend(-gradient))
        if reached is not None:
            self.curvature.learn(
                system.restrict(reached.rest - point.rest),
                system.restrict(reached.adjoint.gradient) - gradient,
            )
        return reached

    def _newton_move(self, point: _Point) -> FloatArray | None:
        """Solution of DΦ move = x_t - Φ, which is M move = H (Φ - x_t); None when M is singular."""
        if self._mixed is None or self.iterations < self._resume:
            return None
        if not self._mixed.factor(point.adjoint.mixed):
            return None
        system = self.draper.system
        away = system.restrict(point.draped.pose - self.target)
        _, entries = self.draper.pulled.hessian(point.draped.pose, point.rest)
        return system.extend(self._mixed.solve(system.matrix(entries) @ away))

    def _search(
        self, point: _Point, move: FloatArray | None, tries: int = BFGS_TRIES
    ) -> _Point | None:
        if move is None or not np.all(np.isfinite(move)):
            return None
        slope = float(np.vdot(point.adjoint.gradient, move))
        if not slope < 0.0:
            return None
        longest = longest_step(point.rest, move, self.draper.pulled.piece.edges)
        follow = carried_along(self.draper, point.rest, point.draped, point.adjoint.mixed, move)
        tried: dict[float, _Point] = {}

        def trial(t: float) -> Trial:
            rest = point.rest + t * move
            found = self._evaluate(rest, point.draped.pose + t * follow, TRIAL_BUDGET)
            found = found or self._evaluate(rest, self.target, TRIAL_BUDGET)
            if found is None:
                return Trial(t, np.inf, np.inf)
            tried[t] = found
            return Trial(t, found.adjoint.distance, float(np.vdot(found.adjoint.gradient, move)))

        here = Trial(0.0, point.adjoint.distance, slope)
        chosen = weak_wolfe(trial, here, longest=longest, tries=tries)
        return None if chosen is None else tried[chosen.step]

    def _keep(self, point: _Point, reason: Reason) -> StepOneShape:
        shape = StepOneShape(
            rest=point.rest,
            draped=point.draped,
            distance=point.adjoint.distance,
            gradient=float(np.abs(point.adjoint.gradient).max(initial=0.0)),
            iterations=self.iterations,
            evaluations=self.evaluations,
            reason=reason,
        )
        self.best = shape  # J never rises, so the last is the best
        if self.report is not None and reason == "iterations":
            residual = float(np.sqrt(2.0 * shape.distance / self.unit))
            note = f"J {shape.distance:.3e} m2, pull {self.draper.pulled.pull:g} N/m"
            at, pose = self.iterations, shape.draped.pose
            self.report(Step("step one", 1.0, at, residual, 0.0, note, point.rest, pose))
        return shape

    def _without_drape(self, rest: FloatArray) -> StepOneShape:
        draped = Draped(self.target.copy(), np.inf, 0, 0, stable=False, converged=False)
        self.best = StepOneShape(rest, draped, np.inf, np.inf, 0, self.evaluations, "no drape")
        return self.best


def step_one(
    pulled: Pulled,
    rest0: FloatArray,
    fixed: ArrayLike,
    *,
    method: StepOneMethod = "auto",
    drape: DrapeMethod = "newton",
    limits: Limits | None = None,
    report: Report | None = None,
) -> StepOneShape:
    """Natural shape (n,3) whose drape comes nearest to the target; see `StepOne`."""
    return StepOne(pulled, fixed, method=method, drape=drape, limits=limits, report=report).solve(
        rest0
    )
