"""Newton on the natural shape along the load path.

With admissible contact forces f given, dE/dx(x_t, r) = f is square in r up to rigid motion.  At no
load its solution is r = x_t and its Jacobian is minus the stiffness matrix, so weight and contact
forces are scaled together by t from 0 to 1.  Multipliers take the resultant that f misses, because
f was balanced with other masses, and spread it over the contacts; as many gauge rows fix the rigid
motion of r.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from casashell.engine.assembly import Pattern
from casashell.engine.recent import Recent, digest, frozen
from casashell.engine.sparse_solver import SingularMatrix, SparseSolver, make_solver
from casashell.inverse.piece import Piece
from casashell.result import Step
from casashell.typing import BoolArray, FloatArray, IntArray

Report = Callable[[Step], None]

#: Residual / f0 that ends a Newton solve at full load, and one that is good enough on the way.
TIGHT, LOOSE = 1e-9, 1e-3
#: Residual / f0 at which a Newton solve that cannot be lowered any more has met rounding.
ROUNDING = 1e-4
MAX_NEWTON, MIN_LOAD_STEP = 25, 1.0 / 64.0
#: Factorisations one path may spend; the hardest real garment that was solved took 63.
BUDGET = 120
#: The same for resuming from an earlier natural shape, which has to pay.
RESUME_BUDGET, MIN_RESUME_STEP = 16, 1.0 / 8.0


@dataclass(frozen=True)
class PathPoint:
    """Natural shape r (n,3) in balance with ``load`` times the forces plus the multipliers' part."""

    rest: FloatArray
    correction: FloatArray
    load: float
    residual: float


@dataclass(frozen=True, eq=False)
class _Bordered:
    """CSR pattern of the bordered matrix.

    chosen  entries of the pattern of the piece that are in it
    order   where its entries are in those, followed by those of -C and C^T
    """

    chosen: IntArray
    order: IntArray
    indptr: IntArray
    indices: IntArray

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays."""
        return sum(a.nbytes for a in (self.chosen, self.order, self.indptr, self.indices))


#: Patterns of the last systems: the same mesh with the same pins and contacts makes none.
_BORDERED: Recent[_Bordered] = Recent()


def forget_systems() -> None:
    """Give back the memory of the patterns kept."""
    _BORDERED.clear()


def _bordered(pattern: Pattern, dofs: IntArray, coupled: BoolArray) -> _Bordered:
    """Pattern on ``dofs`` with the border C where ``coupled`` (len(dofs), d)."""
    place = np.full(pattern.size, -1, dtype=np.int64)
    place[dofs] = np.arange(len(dofs))
    rows, columns = place[pattern.rows], place[pattern.indices]
    chosen = np.flatnonzero((rows >= 0) & (columns >= 0))
    at, which = np.nonzero(coupled)
    size, d = coupled.shape
    row = np.concatenate([rows[chosen], at, size + which])
    column = np.concatenate([columns[chosen], size + which, at])
    order = np.lexsort((column, row))
    indptr = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=size + d))])
    return _Bordered(frozen(chosen), frozen(order), frozen(indptr), frozen(column[order]))


class LoadPath:
    """The bordered system of one piece: its pattern, its factor, its count of factorisations."""

    def __init__(self, piece: Piece, report: Report) -> None:
        self.piece = piece
        self.report = report
        self.factorizations = 0
        self.iterations = 0
        self.furthest: PathPoint | None = None
        n = len(piece.target)
        free = np.setdiff1d(np.arange(n), piece.pinned)
        self.dofs = (3 * free[:, None] + np.arange(3)).ravel()
        self.border = _border(piece)  # (3n, d)
        self._solver: SparseSolver | None = None
        self._system()

    def _system(self) -> None:
        """Pattern of [[M, -C], [C^T, 0]] on the unpinned degrees of freedom, and its constants."""
        pattern, border = self.piece.assembly.pattern, self.border[self.dofs]
        coupled = border != 0.0
        key = digest(pattern.key, self.dofs, coupled)
        self._bordered = _BORDERED.get(
            key, lambda: _bordered(pattern, self.dofs, coupled), lambda made: made.nbytes
        )
        self._constants = np.concatenate([-border[coupled], border[coupled]])

    def forget_analysis(self) -> None:
        """Analyse the next matrix anew: the analysis of an unsymmetric one depends on its values."""
        self._solver = None

    def _factor(self, entries: FloatArray) -> SparseSolver:
        system = self._bordered
        data = np.concatenate([entries[system.chosen], self._scale * self._constants])
        if self._solver is None:
            self._solver = make_solver(system.indptr, system.indices, "general")
        self._solver.factor(data[system.order])
        self.factorizations += 1
        return self._solver

    @cached_property
    def rounding(self) -> float:
        """`rounding_of` the piece."""
        return rounding_of(self.piece)

    def newton(
        self, rest: FloatArray, correction: FloatArray, forces: FloatArray, load: float, goal: float
    ) -> PathPoint | None:
        """Solve at one load from (rest, correction); None when it does not converge."""
        piece, target = self.piece, self.piece.target
        size = len(self.dofs)
        best: PathPoint | None = None
        slow = 0
        for _ in range(MAX_NEWTON):
            gradient, entries = piece.assembly.mixed(target, rest, load)
            gap = (gradient - load * forces).ravel() - self.border @ correction
            residual = float(np.abs(gap[self.dofs]).max(initial=0.0)) / piece.f0
            self.report(
                Step("newton", load, self.iterations, residual, 0.0, rest=rest, pose=target)
            )
            self.iterations += 1
            if not np.isfinite(residual):
                return None
            if best is None or residual < 0.5 * best.residual:
                slow = 0
            else:
                slow += 1
            if best is None or residual < best.residual:
                best = PathPoint(rest, correction, load, residual)
            if residual <= goal:
                return best
            if slow >= 3 or (slow >= 2 and best.residual <= ROUNDING):
                break
            self._scale = float(np.abs(entries).mean())
            drift = self.border.T @ (rest - target).ravel()
            try:
                solver = self._factor(entries)
                step = solver.solve(-np.concatenate([gap[self.dofs], self._scale * drift]))
            except SingularMatrix:
                return None
            flat = np.zeros(target.size)
            flat[self.dofs] = step[:size]
            moved = flat.reshape(-1, 3)
            damping = min(1.0, longest_step(rest, moved, piece.edges))
            if damping < 0.02:
                return None
            rest = rest + damping * moved
            correction = correction + damping * self._scale * step[size:]
        if best is None or best.residual <= max(goal, ROUNDING):
            return best
        return best if best.residual <= self.rounding else None

    def follow(
        self, forces: FloatArray, start: PathPoint | None = None, *, brief: bool = False
    ) -> PathPoint:
        """Raise the load to 1 with forces (n,3) [N] at the contacts; the furthest point reached.

        brief  give up where the full load is not reached at once
        """
        target = self.piece.target
        d = self.border.shape[1]
        spent = self.factorizations + BUDGET
        if start is not None:
            there = self.newton(start.rest, start.correction, forces, 1.0, TIGHT)
            if there is not None:
                return there
        point = PathPoint(target, np.zeros(d), 0.0, 0.0)
        before: PathPoint | None = None
        step = 1.0
        while point.load < 1.0 and step >= MIN_LOAD_STEP and self.factorizations < spent:
            load = min(1.0, point.load + step)
            guess, correction = _ahead(before, point, load)
            reached = self.newton(guess, correction, forces, load, TIGHT if load == 1.0 else LOOSE)
            if reached is None and brief:
                return point
            if reached is None:
                step /= 4.0 if step == 1.0 else 2.0
                continue
            before, point, step = point, reached, min(2.0 * step, 1.0)
            self.furthest = point
        return point

    def resume(self, rest: FloatArray, forces: FloatArray) -> PathPoint | None:
        """Full load with forces (n,3) [N] from a natural shape that balances others; None if lost.

        What ``rest`` leaves unbalanced is taken away at once, or else step by step.
        """
        gap = self.piece.assembly.gradient(self.piece.target, rest) - forces
        spent = self.factorizations + RESUME_BUDGET
        point = PathPoint(rest, np.zeros(self.border.shape[1]), 0.0, 0.0)
        before: PathPoint | None = None
        step = 1.0
        while point.load < 1.0 and step >= MIN_RESUME_STEP and self.factorizations < spent:
            share = min(1.0, point.load + step)
            guess, correction = _ahead(before, point, share)
            felt = forces + (1.0 - share) * gap
            reached = self.newton(guess, correction, felt, 1.0, TIGHT if share == 1.0 else LOOSE)
            if reached is None:
                step /= 4.0 if step == 1.0 else 2.0
                continue
            before, point, step = point, replace(reached, load=share), min(2.0 * step, 1.0)
        return point if point.load == 1.0 else None


def _ahead(
    before: PathPoint | None, point: PathPoint, load: float
) -> tuple[FloatArray, FloatArray]:
    """Natural shape and correction expected at ``load``, along the line of the last two points."""
    if before is None:
        return point.rest, point.correction
    along = (load - point.load) / (point.load - before.load)
    rest = point.rest + along * (point.rest - before.rest)
    return rest, point.correction + along * (point.correction - before.correction)


def _border(piece: Piece) -> FloatArray:
    """Orthonormal rigid modes restricted to the contact vertices, (3n, d); see module docstring.

    A mode that the contacts cannot resist is spread over all vertices instead: its multiplier has to
    come out as zero, which only the loads themselves can bring about.
    """
    modes = piece.rigid_modes
    if modes.shape[1] == 0:
        return modes
    mask = np.zeros(len(piece.target), dtype=bool)
    mask[piece.contacts.vertices] = True
    touching = np.where(np.repeat(mask, 3)[:, None], modes, 0.0)
    u, size, vh = np.linalg.svd(touching, full_matrices=False)
    rank = int(np.sum(size > 1e-6 * np.linalg.norm(modes, axis=0).max())) if mask.any() else 0
    loose = np.linalg.qr(modes @ vh[rank:].T)[0] if rank < modes.shape[1] else modes[:, :0]
    return np.hstack([u[:, :rank], loose])


def rounding_of(piece: Piece) -> float:
    """Forces / f0 that rounding of the coordinates makes at most, by the stiffness at rest.

    Above the threshold of a certificate the weight is too small against the stiffness for any proof
    in double precision.
    """
    target = piece.target
    _, entries = piece.assembly.hessian(target, target, 0.0)
    stiffness = abs(piece.assembly.pattern.matrix(entries))
    worst = np.asarray(stiffness @ np.abs(target).ravel())
    return float(np.finfo(np.float64).eps * worst.max(initial=0.0)) / piece.f0


def unsupported(piece: Piece) -> int:
    """How many rigid motions neither pins nor contacts resist."""
    modes = piece.rigid_modes
    at: IntArray = np.unique(piece.contacts.vertices)
    if modes.shape[1] == 0:
        return 0
    rows = modes.reshape(len(piece.target), 3, -1)[at].reshape(-1, modes.shape[1])
    if len(rows) == 0:
        return int(modes.shape[1])
    size = np.linalg.svd(rows, compute_uv=False)
    return int(modes.shape[1] - np.sum(size > 1e-6 * np.linalg.norm(modes, axis=0).max()))


def longest_step(points: FloatArray, move: FloatArray, edges: IntArray) -> float:
    """Largest share of ``move`` (n,3) at which no edge changes by more than half its length."""
    i, j = edges[:, 0], edges[:, 1]
    length = np.linalg.norm(points[j] - points[i], axis=1)
    change = np.linalg.norm(move[j] - move[i], axis=1)
    ratio = float(np.max(change / length, initial=0.0))
    return 0.5 / ratio if ratio > 0.0 else np.inf
