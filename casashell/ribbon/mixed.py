"""The same equilibria without a chain: every ruling has its own place, quads are conditions.

Unknowns are the station table itself, so an energy couples neighbours only and all matrices are
sparse: one iteration costs O(N), against O(N^3) of the dense Hessian by slopes and angles
(Charrondiere et al. 2024 make the same choice for curvature-based elements).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from casashell.engine.nlp import Nlp, NlpResult, minimise
from casashell.ribbon.chain import BOTTOM, COORDINATES, NORMAL, TOP, reconstruct
from casashell.ribbon.exact import CLOSE, STOPS, independent_rows
from casashell.ribbon.physics import RibbonPhysics
from casashell.ribbon.potential import Potential
from casashell.ribbon.program import Multipliers, Outcome, Stop
from casashell.ribbon.ribbon import MOST_BENT, Ribbon, RibbonState
from casashell.ribbon.terms import Term
from casashell.typing import BoolArray, FloatArray, IntArray


def _entries(stencils: IntArray) -> IntArray:
    """(S,3k) places of the stencils' numbers in the flat station table."""
    return (3 * stencils[:, :, None] + np.arange(3)).reshape(len(stencils), -1)


@dataclass(frozen=True, eq=False)
class _Family:
    """Conditions of one kind on many stencils (S,k): ``count`` each, with data (S,d).

    kept  (S count,) which of them are asked for: the others repeat these
    """

    condition: Term
    count: int
    kept: BoolArray

    @staticmethod
    def all(condition: Term, count: int) -> _Family:
        return _Family(condition, count, np.ones(count * len(condition.stencils), dtype=np.bool_))

    @cached_property
    def _units(self) -> Term:
        data = np.asarray(self.condition.at(np.empty((0, 3))))[:, self.count :]
        each, m = len(data), self.count
        params = np.hstack([np.tile(np.eye(m), (each, 1)), np.repeat(data, m, axis=0)])
        stencils = np.repeat(self.condition.stencils, m, axis=0)
        return Term(self.condition.density, stencils[self.kept], params[self.kept])

    @property
    def size(self) -> int:
        """Number of conditions."""
        return int(np.count_nonzero(self.kept))

    def values(self, table: FloatArray) -> FloatArray:
        return self._units.run("energy", table)[0].ravel()

    def slopes(self, table: FloatArray) -> FloatArray:
        return self._units.run("gradient", table)[0].ravel()

    def pattern(self, first: int) -> tuple[IntArray, IntArray]:
        """Rows, from ``first``, and columns of the entries of `slopes`."""
        columns = _entries(self._units.stencils)
        rows = first + np.repeat(np.arange(len(columns)), columns.shape[1])
        return rows, columns.ravel()

    def weighed(self, multipliers: FloatArray) -> Term:
        """y . C as an energy."""
        data = np.asarray(self.condition.at(np.empty((0, 3))))[:, self.count :]
        full = np.zeros(len(self.kept))
        full[self.kept] = multipliers
        params = np.hstack([full.reshape(-1, self.count), data])
        return Term(self.condition.density, self.condition.stencils, params)


def _families(potential: Potential, physics: RibbonPhysics, kept: BoolArray) -> list[_Family]:
    """Quads, the first ruling of a floating ribbon, then the ``kept`` conditions of the potential.

    A clamp crease is a quad without length, from an extra station at the end of the table.
    """
    ribbon = potential.coordinates.ribbon
    n, first = ribbon.segments, _first(ribbon)
    before, behind, lengths = np.arange(n), np.arange(1, n + 1), np.full(n, ribbon.segment)
    if first:
        before, behind = np.append(before, first), np.append(behind, 0)
        lengths = np.append(lengths, 0.0)
    rows = np.array([COORDINATES, BOTTOM, TOP, NORMAL])
    stencils = np.hstack([4 * before[:, None] + rows, 4 * behind[:, None] + rows])
    params = np.zeros((len(lengths), 12))
    params[:, 9], params[:, 10], params[:, 11] = lengths, ribbon.width, ribbon.length
    made = [_Family.all(Term(physics.link, stencils, params), 9)]
    if potential.coordinates.floating:
        begin = 4 * first + np.array([[BOTTOM, TOP, NORMAL]])
        params = np.array([[0.0, 0.0, 0.0, ribbon.width]])
        made.append(_Family.all(Term(physics.rigid_begin, begin, params), 3))
    first = 0
    for c in potential.conditions:
        made.append(_Family(c.weighed(np.zeros(c.count)), c.count, kept[first : first + c.count]))
        first += c.count
    return made


def _first(ribbon: Ribbon) -> int:
    """Station that the base frame places: 0, or the extra one before a clamp crease."""
    return ribbon.segments + 1 if ribbon.clamp_crease else 0


def _begin(ribbon: Ribbon, state: RibbonState) -> FloatArray:
    """Flat table at ``state``, with the extra station."""
    table = reconstruct(ribbon, state).table
    if not ribbon.clamp_crease:
        return table.ravel()
    half = 0.5 * ribbon.width * state.frame[:, 1]
    extra = [np.zeros(3), state.origin - half, state.origin + half, state.frame[:, 2]]
    return np.concatenate([table, extra]).ravel()


def _state(ribbon: Ribbon, x: FloatArray) -> RibbonState:
    """State of a flat table that meets its conditions."""
    table = x.reshape(-1, 4, 3)
    begin = table[_first(ribbon)]
    across, normal = (begin[TOP] - begin[BOTTOM]) / ribbon.width, begin[NORMAL]
    left, _, right = np.linalg.svd(np.stack([np.cross(across, normal), across, normal], axis=1))
    c, beta = table[: ribbon.segments + 1, COORDINATES, :2].T
    return RibbonState(
        c[1:-1],
        beta[1:-1],
        left @ right,
        0.5 * (begin[BOTTOM] + begin[TOP]),
        float(beta[0]),
        float(beta[-1]),
    )


@dataclass(frozen=True, eq=False)
class _Mixed:
    """Functions of the sparse program over the flat station table."""

    potential: Potential
    families: Sequence[_Family]

    @property
    def terms(self) -> tuple[Term, ...]:
        return (*self.potential.terms.terms, *self.potential.far)

    @property
    def segments(self) -> int:
        return self.potential.coordinates.ribbon.segments

    def table(self, x: FloatArray) -> FloatArray:
        return x.reshape(-1, 3)

    def objective(self, x: FloatArray) -> float:
        table = self.table(x)
        return sum(float(t.run("energy", table)[0].sum()) for t in self.terms) / self.potential.unit

    def gradient(self, x: FloatArray) -> FloatArray:
        made = np.zeros(len(x))
        for term in self.terms:
            block = term.run("gradient", self.table(x))[0]
            made += np.bincount(_entries(term.stencils).ravel(), block.ravel(), minlength=len(x))
        return made / self.potential.unit

    @cached_property
    def turns(self) -> tuple[IntArray, IntArray, FloatArray]:
        """Rows, columns and entries of c_{i+1} - c_i for all quads."""
        n = self.segments
        quads = np.arange(n)
        columns = np.concatenate([12 * quads, 12 * (quads + 1)])
        return np.tile(quads, 2), columns, np.repeat([-1.0, 1.0], n)

    def constraints(self, x: FloatArray) -> FloatArray:
        table = self.table(x)
        turned = np.diff(table[COORDINATES::4, 0][: self.segments + 1])
        return np.concatenate([*(f.values(table) for f in self.families), turned])

    def jacobian(self, x: FloatArray) -> FloatArray:
        table = self.table(x)
        return np.concatenate([*(f.slopes(table) for f in self.families), self.turns[2]])

    def pattern(self) -> tuple[IntArray, IntArray]:
        """Rows and columns of the entries of `jacobian`."""
        rows, columns, first = [], [], 0
        for family in self.families:
            row, column = family.pattern(first)
            rows.append(row)
            columns.append(column)
            first += family.size
        rows.append(first + self.turns[0])
        columns.append(self.turns[1])
        return np.concatenate(rows), np.concatenate(columns)

    def curved(self, multipliers: FloatArray) -> list[Term]:
        """Conditions weighed with their multipliers (all of them, turns left out)."""
        cuts = np.cumsum([f.size for f in self.families])
        parts = np.split(multipliers[: cuts[-1]], cuts[:-1])
        return [f.weighed(part) for f, part in zip(self.families, parts, strict=True)]

    @cached_property
    def upper(self) -> list[tuple[IntArray, IntArray, IntArray]]:
        """For each term and family: which entries of a block are kept, their rows and columns."""
        made = []
        for term in (*self.terms, *(f.condition for f in self.families)):
            entries = _entries(term.stencils)
            size = entries.shape[1]
            row, column = np.triu_indices(size)
            made.append((row * size + column, entries[:, row].ravel(), entries[:, column].ravel()))
        return made

    def hessian(self, x: FloatArray, scale: float, multipliers: FloatArray) -> FloatArray:
        table, made = self.table(x), []
        terms = (*self.terms, *self.curved(multipliers))
        weights = [scale / self.potential.unit] * len(self.terms) + [1.0] * len(self.families)
        for term, weight, (kept, rows, _) in zip(terms, weights, self.upper, strict=True):
            _, *block = term.run("hessian", table)
            if block and block[0].size:
                made.append(weight * block[0][:, kept].ravel())
            else:
                made.append(np.zeros(len(rows)))
        return np.concatenate(made)

    def nlp(self, start: FloatArray) -> Nlp:
        """The sparse program from the flat table ``start``."""
        lower, upper = self.bounds(start)
        rows, columns = self.pattern()
        met = np.zeros(sum(f.size for f in self.families))
        turn = np.full(self.segments, self.potential.coordinates.ribbon.most_turn)
        return Nlp(
            start=start,
            lower=lower,
            upper=upper,
            constraint_lower=np.concatenate([met, -turn]),
            constraint_upper=np.concatenate([met, turn]),
            objective=self.objective,
            objective_gradient=self.gradient,
            constraints=self.constraints,
            jacobian=self.jacobian,
            jacobian_rows=rows,
            jacobian_columns=columns,
            hessian=self.hessian,
            hessian_rows=np.concatenate([entry[1] for entry in self.upper]),
            hessian_columns=np.concatenate([entry[2] for entry in self.upper]),
        )

    def bounds(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What is fixed stays as in x: third coordinates, end slopes, creases that do not bend."""
        space = self.potential.coordinates
        lower = np.full((len(x) // 12, 4, 3), -np.inf)
        lower[:, COORDINATES, 1], lower[:, COORDINATES, 2] = -MOST_BENT, 0.0
        upper = -lower
        fixed = np.zeros(lower.shape, dtype=np.bool_)
        n, first = self.segments, _first(space.ribbon)
        fixed[: n + 1, COORDINATES, 1] = ~space.ribbon.bends
        fixed[[0, n], COORDINATES, 0] = True
        fixed[n + 1 :, COORDINATES] = True
        for limit in self.potential.limits:
            lower[limit.station, COORDINATES, 0] = limit.lower
            upper[limit.station, COORDINATES, 0] = limit.upper
        if not space.floating:
            fixed[first, [BOTTOM, TOP, NORMAL]] = True
        values = x.reshape(lower.shape)
        return np.where(fixed, values, lower).ravel(), np.where(fixed, values, upper).ravel()


def mixed(
    potential: Potential,
    physics: RibbonPhysics,
    state: RibbonState,
    *,
    feasibility: float = 1e-10,
    gradient: float = 1e-9,
    iterations: int = 300,
) -> Outcome:
    """Local minimum of ``potential`` from ``state`` by Ipopt on the station table.

    The outcome is measured on the chain: unknowns, residual and violation are those of the program
    by slopes and angles.
    """
    ribbon = potential.coordinates.ribbon
    jacobian = potential.equalities(potential.coordinates.pack(state))[1]
    kept = np.zeros(len(jacobian), dtype=np.bool_)
    kept[independent_rows(jacobian)] = True
    program = _Mixed(potential, _families(potential, physics, kept))
    found = minimise(
        program.nlp(_begin(ribbon, state)),
        tolerance=gradient,
        max_iterations=iterations,
        options={**CLOSE, "constr_viol_tol": feasibility},
    )
    if not np.all(np.isfinite(found.x)):
        raise FloatingPointError("Ipopt returned a point that is not finite")
    return _measured(potential, program, kept, found, feasibility)


def _measured(
    potential: Potential,
    program: _Mixed,
    kept: BoolArray,
    found: NlpResult,
    feasibility: float,
) -> Outcome:
    space = potential.coordinates
    chain = potential.program(space.pack(_state(space.ribbon, found.x)))
    z = chain.clipped(chain.start)
    held = sum(f.size for f in program.families)
    equality = np.zeros(len(kept))
    equality[kept] = found.multipliers[held - np.count_nonzero(kept) : held]
    slopes = found.bound_multipliers.reshape(-1, 4, 3)[:, COORDINATES, 0]
    forces = [found.multipliers[-1]] + [-slopes[limit.station] for limit in potential.limits]
    inequality = np.maximum(0.0, [side for force in forces for side in (-force, force)])
    value, gradient = chain.objective(z)
    gradient = gradient + chain.equalities(z)[1].T @ equality + chain.rows().T @ inequality
    stop, violation = STOPS.get(found.status, Stop.FAILED), chain.violation(z)
    if stop is Stop.CONVERGED and violation > 100.0 * feasibility:
        stop = Stop.INFEASIBLE
    return Outcome(
        z=z,
        objective=value,
        stop=stop,
        outer=1,
        inner=found.iterations,
        evaluations=found.iterations + 1,
        violation=violation,
        projected_gradient=chain.projected(z, gradient),
        multipliers=Multipliers(equality, inequality, 10.0),
    )
