"""Conditions C = 0 on a few stations of a ribbon, and energies that couple stations far apart.

A condition is a density linear in its first parameters, the multipliers: y . C(x).  Its values and
derivatives come from the same kernels as those of an energy, with unit multipliers.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from casashell.ribbon.chain import BOTTOM, COORDINATES, NORMAL, TOP, cross
from casashell.ribbon.composite import Placed
from casashell.ribbon.terms import Term
from casashell.typing import FloatArray, IntArray


def table_rows(placed: Placed, rows: IntArray) -> FloatArray:
    """(3 k, 6 + 2 (N+1)) derivative of ``rows`` (k,) of the station table, as `Placed.gradient`."""
    twists = np.concatenate([placed.base_twists, placed.twists.reshape(-1, 6)])
    pivot, table = placed.pivot, placed.shape.table
    station, kind = np.divmod(rows, 4)
    own = 6 + 2 * station
    point, normal = (kind == BOTTOM) | (kind == TOP), kind == NORMAL
    places = table[rows] - np.where(normal[:, None], 0.0, pivot)
    # Rates of all rows for all twists, then zero for creases behind a row.
    made = cross(twists[None, :, :3], places[:, None])
    made[point] += twists[:, 3:]
    reach = np.where(point, own, np.where(normal, own + 2, 0))
    made[np.arange(len(twists)) >= reach[:, None]] = 0.0
    made = np.swapaxes(made, 1, 2).copy()
    at = np.flatnonzero(point)
    side = np.where(kind[at] == TOP, 1.0, -1.0)
    made[at, :, own[at]] = side[:, None] * placed.shape.slide[station[at]]
    flat = np.flatnonzero(kind == COORDINATES)
    made[flat, 0, own[flat]] = made[flat, 1, own[flat] + 1] = 1.0
    return made.reshape(-1, len(twists))


@dataclass(frozen=True, eq=False)
class Condition:
    """``count`` conditions on ``rows`` (k,) of the station table.

    density  SX function (x (3,k), r (3,k), p) -> y . C(x) with p = (y (count,), data)
    """

    density: ca.Function
    rows: IntArray
    data: FloatArray

    @property
    def count(self) -> int:
        """m."""
        return int(self.density.numel_in(2)) - len(self.data)

    @cached_property
    def _units(self) -> Term:
        m = self.count
        params = np.hstack([np.eye(m), np.tile(self.data, (m, 1))])
        return Term(self.density, np.tile(self.rows, (m, 1)), params)

    def values(self, table: FloatArray) -> FloatArray:
        """C (m,)."""
        return self._units.run("energy", table)[0].ravel()

    def slopes(self, table: FloatArray) -> FloatArray:
        """(m, 3k) derivative by the rows of the table."""
        return self._units.run("gradient", table)[0]

    def weighed(self, multipliers: FloatArray) -> Term:
        """y . C as an energy."""
        return Term(self.density, self.rows[None], np.concatenate([multipliers, self.data])[None])


@dataclass(frozen=True, eq=False)
class Far:
    """Gradient (3k,) and second derivative (3k, 3k) of a term by a few rows of the table."""

    rows: IntArray
    gradient: FloatArray
    hessian: FloatArray

    @staticmethod
    def of(term: Term, table: FloatArray) -> Far:
        """Of a term with one stencil."""
        gradient, *second = term.run("hessian", table)
        size = gradient.shape[1]
        full = second[0].reshape(size, size) if second and second[0].size else None
        return Far(term.stencils[0], gradient[0], np.zeros((size, size)) if full is None else full)
