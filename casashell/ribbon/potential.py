"""Energy of one ribbon as a function of its unknowns, and conditions on it: a `Program`."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from casashell.ribbon.composite import Placed
from casashell.ribbon.conditions import Condition, Far, table_rows
from casashell.ribbon.coordinates import Coordinates
from casashell.ribbon.program import Program
from casashell.ribbon.taut import Limit
from casashell.ribbon.terms import Term, Terms
from casashell.ribbon.touch import Touch
from casashell.typing import FloatArray


@dataclass(frozen=True, eq=False)
class Potential:
    """Sum of terms, divided by ``unit`` [J], over the unknowns of ``coordinates``.

    terms       of neighbouring stations
    far         of one stencil each, whose stations may be anywhere
    conditions  C = 0
    limits      of single slopes, beside those that keep rulings from crossing
    touch       contacts G <= 0
    """

    coordinates: Coordinates
    terms: Terms
    unit: float
    far: tuple[Term, ...] = ()
    conditions: tuple[Condition, ...] = ()
    limits: tuple[Limit, ...] = ()
    touch: Touch | None = None
    _last: list[tuple[FloatArray, Placed]] = field(init=False, repr=False, default_factory=list)

    @cached_property
    def matrix(self) -> FloatArray:
        """A of all linear conditions A z <= ``bound``."""
        space = self.coordinates
        if not self.limits:
            return space.matrix
        full = np.zeros((2 * len(self.limits), 6 + 2 * (space.ribbon.segments + 1)))
        for k, limit in enumerate(self.limits):
            full[2 * k : 2 * k + 2, 6 + 2 * limit.station] = 1.0, -1.0
        return np.concatenate([space.matrix, space.rows(full)])

    @cached_property
    def bound(self) -> FloatArray:
        """b of these."""
        more = [side for limit in self.limits for side in (limit.upper, -limit.lower)]
        return np.append(self.coordinates.bound, more)

    def _placed(self, z: FloatArray) -> Placed:
        """The strip at z; kept, since solvers ask for values and derivatives at one z apart."""
        if not (self._last and np.array_equal(self._last[0][0], z)):
            self._last[:] = [(z.copy(), self.coordinates.placed(z))]
        return self._last[0][1]

    def energy(self, z: FloatArray) -> float:
        """Sum of all terms [J]."""
        table = self._placed(z).shape.table
        return self.terms.energy(table) + sum(
            float(term.run("energy", table)[0].sum()) for term in self.far
        )

    def objective(self, z: FloatArray) -> tuple[float, FloatArray]:
        """Value and gradient (n,), both over the unit."""
        placed = self._placed(z)
        table = placed.shape.table
        value, gradient = self.terms.energy(table), self.terms.gradient(table)
        for term in self.far:
            value += float(term.run("energy", table)[0].sum())
            gradient[term.stencils[0]] += term.run("gradient", table)[0].reshape(-1, 3)
        full = placed.gradient(gradient)
        return value / self.unit, self.coordinates.rows(full) / self.unit

    def hessian(self, z: FloatArray, multipliers: FloatArray) -> FloatArray:
        """(n,n) second derivative of objective + multipliers . (C, G)."""
        placed = self._placed(z)
        shape = placed.shape
        gradient, buffer = self.terms.second(shape.table)
        apart = [Far.of(term, shape.table) for term in self.far]
        apart += [Far.of(term, shape.table) for term in self._weighed(multipliers * self.unit)]
        for far in apart:
            np.add.at(gradient, far.rows, far.gradient.reshape(-1, 3))
        if self.touch is not None:
            first = sum(condition.count for condition in self.conditions)
            self.touch.add_forces(multipliers[first:] * self.unit, gradient)
        full = placed.hessian(gradient, *self.terms.layout.split(buffer))
        for far in apart:
            rows = table_rows(placed, far.rows)
            full += rows.T @ far.hessian @ rows
        return self.coordinates.hessian(full) / self.unit

    def _weighed(self, multipliers: FloatArray) -> list[Term]:
        made, first = [], 0
        for condition in self.conditions:
            made.append(condition.weighed(multipliers[first : first + condition.count]))
            first += condition.count
        return made

    def equalities(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """C (m,) and its derivative (m,n)."""
        if not self.conditions:
            return np.empty(0), np.empty((0, len(z)))
        placed = self._placed(z)
        shape = placed.shape
        values = [c.values(shape.table) for c in self.conditions]
        slopes = [c.slopes(shape.table) @ table_rows(placed, c.rows) for c in self.conditions]
        return np.concatenate(values), self.coordinates.rows(np.concatenate(slopes))

    def contacts(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """G (q,) and its derivative (q,n)."""
        if self.touch is None:
            return np.empty(0), np.empty((0, len(z)))
        placed = self._placed(z)
        slopes = self.touch.slopes(placed)
        return self.touch.values(placed.shape.table), self.coordinates.rows(slopes)

    def program(self, start: FloatArray, *, second: bool = True) -> Program:
        """The program of least energy from ``start`` (n,)."""
        space = self.coordinates
        return Program(
            start=start,
            lower=space.lower,
            upper=space.upper,
            objective=self.objective,
            hessian=self.hessian if second else None,
            equalities=self.equalities,
            matrix=self.matrix,
            bound=self.bound,
            contacts=self.contacts,
        )

    def with_coordinates(self, coordinates: Coordinates) -> Potential:
        """The same in other unknowns of the same ribbon."""
        return replace(self, coordinates=coordinates)

    def with_terms(self, *more: Term) -> Potential:
        """The same with more terms of neighbouring stations."""
        return replace(self, terms=self.terms.with_terms(more))
