"""A sum of densities on the station table of one ribbon, with first and second derivatives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from casashell.engine.kernels import Kernel, get_kernel
from casashell.ribbon.composite import BandLayout
from casashell.typing import FloatArray, IntArray

#: Parameters (S,m) of a term, or how they follow from the station table.
Parameters = FloatArray | Callable[[FloatArray], FloatArray]


@lru_cache(maxsize=256)
def _kernel(density: ca.Function, name: str) -> Kernel:
    """Kept by the function itself: telling equal functions apart costs as much as running one."""
    return get_kernel(density, name)


@dataclass(frozen=True, eq=False)
class Term:
    """sum_s e(x[s], p[s]) over stencils (S,k) of rows of the station table.

    ``params`` that follow from the table are frozen in each evaluation: they choose a piece of a
    piecewise function, whose derivative at its own kinks is one-sided.
    """

    density: ca.Function
    stencils: IntArray
    params: Parameters

    def __post_init__(self) -> None:
        object.__setattr__(self, "stencils", np.ascontiguousarray(self.stencils, dtype=np.int64))

    def at(self, table: FloatArray) -> FloatArray:
        """(S,m) parameters."""
        value = self.params(table) if callable(self.params) else self.params
        return np.ascontiguousarray(value)

    def run(self, kernel: str, table: FloatArray) -> tuple[FloatArray, ...]:
        """Outputs of a kernel per stencil."""
        return _kernel(self.density, kernel)(table, table, self.at(table), self.stencils, table)


@dataclass(frozen=True, eq=False)
class Terms:
    """The terms of one ribbon with N+1 ``stations``."""

    stations: int
    terms: tuple[Term, ...]

    @cached_property
    def layout(self) -> BandLayout:
        """Where second derivatives go."""
        return BandLayout(self.stations)

    @cached_property
    def _places(self) -> tuple[IntArray, ...]:
        return tuple(self.layout.places(t.stencils).ravel() for t in self.terms)

    @cached_property
    def _rows(self) -> tuple[IntArray, ...]:
        return tuple(
            (3 * t.stencils[:, :, None] + np.arange(3)).reshape(-1).astype(np.int64)
            for t in self.terms
        )

    def energy(self, table: FloatArray) -> float:
        """Sum of all terms [J]."""
        return float(sum(term.run("energy", table)[0].sum() for term in self.terms))

    def gradient(self, table: FloatArray) -> FloatArray:
        """Derivative by the table (4 (N+1), 3)."""
        total = np.zeros(12 * self.stations)
        for term, rows in zip(self.terms, self._rows):
            block = term.run("gradient", table)[0]
            total += np.bincount(rows, block.ravel(), minlength=len(total))
        return total.reshape(-1, 3)

    def second(self, table: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivative by the table and a buffer of second derivatives, see `BandLayout`."""
        total = np.zeros(12 * self.stations)
        buffer = np.zeros(self.layout.size)
        for term, rows, places in zip(self.terms, self._rows, self._places):
            gradient, *hessian = term.run("hessian", table)
            total += np.bincount(rows, gradient.ravel(), minlength=len(total))
            if hessian and hessian[0].size:
                buffer += np.bincount(places, hessian[0].ravel(), minlength=len(buffer))
        return total.reshape(-1, 3), buffer

    def with_terms(self, more: Sequence[Term]) -> Terms:
        """These and ``more``."""
        return Terms(self.stations, (*self.terms, *more))
