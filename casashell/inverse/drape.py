"""Draping: the local minimum of the energy over the free vertices (Ly 2018, Sec. 5.3, Alg. 3)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from casashell.inverse.descent import ConjugateGradients, Direction, ShiftedNewton
from casashell.inverse.free_system import FreeSystem
from casashell.inverse.line_search import Trial, weak_wolfe
from casashell.inverse.load_path import Report
from casashell.inverse.pulled import Pulled
from casashell.inverse.stability import NEUTRAL, lowest_eigenpairs
from casashell.result import Step
from casashell.typing import ArrayLike, FloatArray, IntArray

DrapeMethod: TypeAlias = Literal["newton", "newton-cg"]
METHODS: tuple[DrapeMethod, ...] = ("newton", "newton-cg")

#: Force / f0 at free vertices that ends a drape.
TOLERANCE = 1e-9
#: Force / f0 below which a drape that cannot get any lower has met rounding.
ROUNDING = 1e-6
#: Iterations one drape may spend.
BUDGET = 200
MAX_SADDLES = 8


@dataclass(frozen=True)
class Draped:
    """Where a drape ended.

    pose            (n,3) m; fixed vertices are where the start had them
    residual        largest force at a free vertex / f0
    stable          the free Hessian at the pose is positive definite
    converged       the forces vanish, to the tolerance or to rounding
    """

    pose: FloatArray
    residual: float
    iterations: int
    factorizations: int
    stable: bool
    converged: bool

    @property
    def good(self) -> bool:
        """A local minimum: forces vanish and the Hessian is positive definite."""
        return self.stable and self.converged


@dataclass(frozen=True)
class _Point:
    """A pose with the energy and its derivatives."""

    x: FloatArray
    energy: float
    force: FloatArray  # free components of dE/dx
    entries: FloatArray

    @property
    def residual(self) -> float:
        return float(np.abs(self.force).max(initial=0.0))


class Draper:
    """Drapes of one piece with the same fixed vertices.

    Keeps pattern, symbolic analysis and the last factor: after a drape that ended ``good`` the system
    holds the factor of the Hessian at its pose, for adjoint solves.  ``pulled`` may be exchanged
    between drapes for one of the same piece with another pull.
    Raises ValueError for fixed vertices that do not exist.
    """

    def __init__(self, pulled: Pulled, fixed: ArrayLike, report: Report | None = None) -> None:
        count = len(pulled.piece.target)
        self.fixed: IntArray = np.unique(np.asarray(fixed, dtype=np.int64))
        wrong = self.fixed[(self.fixed < 0) | (self.fixed >= count)]
        if wrong.size:
            raise ValueError(
                f"fixed vertex {int(wrong[0])} does not exist: ids go from 0 to {count - 1}"
            )
        self.pulled = pulled
        self.report = report
        self.system = FreeSystem(pulled.piece.assembly.pattern, self.fixed, "symmetric")
        self.iterations = 0
        self._factored: tuple[FloatArray, FloatArray, float] | None = None

    @property
    def factorizations(self) -> int:
        """Factorisations of all drapes so far."""
        return self.system.factorizations

    def drape(
        self,
        rest: FloatArray,
        start: FloatArray,
        *,
        method: DrapeMethod = "newton",
        tolerance: float = TOLERANCE,
        budget: int = BUDGET,
    ) -> Draped:
        """Local minimum of the energy of natural shape ``rest`` (n,3), downhill from ``start``.

        method     "newton": Newton with a shifted Hessian; "newton-cg": the paper's algorithm
        tolerance  largest force left at a free vertex, relative to f0
        budget     iterations to spend, saddle points left behind included
        Never raises for poses or shapes whose energy is not finite; the result says so.  Raises
        ValueError for an unknown method.
        """
        if method not in METHODS:
            raise ValueError(f"drape method must be one of {', '.join(METHODS)}; got '{method}'")
        with np.errstate(all="ignore"):
            return _Run(self, rest, method, tolerance).from_pose(start, budget)

    def hold_factor(self, rest: FloatArray, pose: FloatArray) -> bool:
        """Make sure the factor is that of the Hessian at (pose, rest); False if not positive."""
        if not self._holds(rest, pose):
            _, entries = self.pulled.hessian(pose, rest)
            return self.factor_at(rest, pose, entries)
        return True

    def factor_at(self, rest: FloatArray, pose: FloatArray, entries: FloatArray) -> bool:
        """Factor the Hessian with these entries and remember where it belongs."""
        self._factored = None
        positive = self.system.factor(entries)
        if positive:
            self._factored = (pose, rest, self.pulled.pull)
        return positive

    def forget_factor(self) -> None:
        """The system is about to hold something else than the Hessian of a minimum."""
        self._factored = None

    def _holds(self, rest: FloatArray, pose: FloatArray) -> bool:
        if self._factored is None:
            return False
        at_pose, at_rest, pull = self._factored
        same = pull == self.pulled.pull and np.array_equal(at_pose, pose)
        return same and np.array_equal(at_rest, rest)


class _Run:
    """One drape."""

    def __init__(
        self, draper: Draper, rest: FloatArray, method: DrapeMethod, tolerance: float
    ) -> None:
        self.draper = draper
        self.pulled = draper.pulled
        self.system = draper.system
        self.rest = rest
        self.tolerance = tolerance
        piece = draper.pulled.piece
        self.f0, self.h = piece.f0, piece.h
        self.spent = draper.system.factorizations
        self.size = float(np.linalg.norm(np.ptp(piece.target, axis=0))) or piece.h
        draper.forget_factor()
        self.direction: Direction = (
            ShiftedNewton(self.system) if method == "newton" else ConjugateGradients(self.system)
        )

    def _at(self, x: FloatArray) -> _Point:
        gradient, entries = self.pulled.hessian(x, self.rest)
        return _Point(x, self.pulled.energy(x, self.rest), self.system.restrict(gradient), entries)

    def from_pose(self, start: FloatArray, budget: int) -> Draped:
        """Downhill until forces vanish at a point with a positive Hessian."""
        point, saddles = self._at(np.array(start, dtype=np.float64)), 0
        if not (math.isfinite(point.energy) and math.isfinite(point.residual)):
            return self._end(point, 0, stable=False, converged=False)
        for iteration in range(budget):
            self._tell(iteration, point)
            if point.residual <= self._goal(point):
                beyond = self._settle(point) if saddles < MAX_SADDLES else None
                saddles += 1
            else:
                beyond = self._descend(point)
                if beyond is None and point.residual <= ROUNDING * self.f0:
                    beyond = self._settle(point)
            if beyond is None:
                return self._finish(point, iteration)
            point = beyond
        return self._end(point, budget, stable=False, converged=False)

    def _finish(self, point: _Point, iteration: int) -> Draped:
        small = point.residual <= max(self._goal(point), ROUNDING * self.f0)
        stable = self.draper.hold_factor(self.rest, point.x)
        return self._end(point, iteration, stable=stable, converged=small)

    def _end(self, point: _Point, iterations: int, *, stable: bool, converged: bool) -> Draped:
        residual = point.residual / self.f0
        self.draper.iterations += iterations
        return Draped(
            pose=point.x,
            residual=residual if math.isfinite(residual) else math.inf,
            iterations=iterations,
            factorizations=self.system.factorizations - self.spent,
            stable=stable,
            converged=converged,
        )

    def _tell(self, iteration: int, point: _Point) -> None:
        if self.draper.report is not None:
            note = f"energy {point.energy:.12e} J"
            self.draper.report(Step("drape", 1.0, iteration, point.residual / self.f0, 0.0, note))

    def _goal(self, point: _Point) -> float:
        """Force [N] that counts as none: the tolerance, or what rounding of positions makes."""
        largest = float(np.abs(point.entries).max(initial=0.0))
        rounding = 4.0 * np.finfo(float).eps * largest * float(np.abs(point.x).max())
        return max(self.tolerance * self.f0, min(rounding, ROUNDING * self.f0))

    def _settle(self, point: _Point) -> _Point | None:
        """None at a minimum, with its factor held; a lower point when this is a saddle."""
        if self.draper.factor_at(self.rest, point.x, point.entries):
            return None
        values, vectors = lowest_eigenpairs(self.system.matrix(point.entries), 1)
        if values[0] * self.h / self.f0 > -NEUTRAL or not np.isfinite(values[0]):
            return None  # neutral: no way is down
        along = self.system.extend(vectors[:, 0])
        along *= 0.1 * self.h / np.abs(along).max()
        return self._leave(point, along)

    def _leave(self, point: _Point, along: FloatArray) -> _Point | None:
        """Lowest of both sides at the first step, halved from 0.1 h, that lowers the energy."""
        if float(point.force @ self.system.restrict(along)) > 0.0:
            along = -along
        for halving in range(12):
            moves = [point.x + sign * along * 0.5**halving for sign in (1.0, -1.0)]
            energies = [self.pulled.energy(x, self.rest) for x in moves]
            side = int(np.nanargmin([*energies, point.energy]))
            if side < 2:
                self.direction.forget()
                return self._at(moves[side])
        return None

    def _descend(self, point: _Point) -> _Point | None:
        """Next point by the method's direction; None when no step lowers the energy."""
        for _ in range(self.direction.patience):
            step = self.direction.find(point.entries, point.force)
            slope = float(step @ point.force)
            if math.isfinite(slope) and slope < 0.0:
                reached = self._search(point, self.system.extend(step), slope)
                if reached is not None:
                    return reached
            self.direction.rejected()
        return None

    def _search(self, point: _Point, move: FloatArray, slope: float) -> _Point | None:
        reach = float(np.abs(move).max())
        longest = self.size / reach if reach > 0.0 else 1.0

        def trial(t: float) -> Trial:
            x = point.x + t * move
            gradient = self.pulled.gradient(x, self.rest)
            return Trial(t, self.pulled.energy(x, self.rest), float(np.vdot(gradient, move)))

        # Energies are sums of cancelling terms as large as weight times size.
        scale = abs(point.energy) + self.f0 * self.size * len(move)
        here = Trial(0.0, point.energy, slope)
        found = weak_wolfe(trial, here, longest=max(longest, 1e-12), noise=1e-14 * scale)
        if found is None:
            return None
        self.direction.accepted(found.step)
        reached = self._at(point.x + found.step * move)
        return reached if math.isfinite(reached.residual) else None


def drape(
    pulled: Pulled,
    rest: FloatArray,
    start: FloatArray,
    fixed_vertices: ArrayLike,
    *,
    method: DrapeMethod = "newton",
    tolerance: float = TOLERANCE,
    report: Report | None = None,
) -> Draped:
    """One drape of natural shape ``rest`` (n,3) from ``start``; see `Draper.drape`."""
    draper = Draper(pulled, fixed_vertices, report)
    return draper.drape(rest, start, method=method, tolerance=tolerance)
