"""A small nonlinear program, written once and solved by more than one method.

    minimise f(z)   subject to   lower <= z <= upper,   C(z) = 0,   A z <= b,   G(z) <= 0

Pan, Huang and Bao 2016, Sec. 4: after the box substitution a step of a ribbon has this form, with at
most a few rows in A and C.  G are contacts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from casashell.typing import FloatArray

Objective = Callable[[FloatArray], tuple[float, FloatArray]]
Hessian = Callable[[FloatArray, FloatArray], FloatArray]
Equalities = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


def _no_equalities(z: FloatArray) -> tuple[FloatArray, FloatArray]:
    return np.empty(0), np.empty((0, len(z)))


@dataclass(frozen=True, eq=False)
class Program:
    """Functions, bounds and start; n unknowns, m equalities, k linear inequalities, q contacts.

    objective   z (n,) -> f and its gradient (n,)
    hessian     z, y (m + q,) -> (n, n) of f + y . (C, G); None: only methods without second derivatives
    equalities  z -> C (m,) and dC/dz (m, n)
    contacts    z -> G (q,) and dG/dz (q, n)
    matrix      (k, n) A and ``bound`` (k,) b
    Raises ValueError for sizes that do not fit, a start that is not finite or crossed bounds.
    """

    start: FloatArray
    lower: FloatArray
    upper: FloatArray
    objective: Objective
    hessian: Hessian | None = None
    equalities: Equalities = _no_equalities
    matrix: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    bound: FloatArray = field(default_factory=lambda: np.empty(0))
    contacts: Equalities = _no_equalities

    def __post_init__(self) -> None:
        n = len(self.start)
        if n == 0 or not np.all(np.isfinite(self.start)):
            raise ValueError("the start of a program must be finite and not empty")
        for name in ("lower", "upper"):
            if np.shape(getattr(self, name)) != (n,):
                raise ValueError(f"{name} must have shape ({n},)")
        crossed = np.flatnonzero(~(self.lower <= self.upper))
        if crossed.size:
            raise ValueError(f"unknown {crossed[0]}: its lower bound is above its upper bound")
        if len(self.bound) and self.matrix.shape != (len(self.bound), n):
            raise ValueError(f"matrix must have shape ({len(self.bound)}, {n})")

    def inequalities(self, z: FloatArray) -> FloatArray:
        """A z - b and G (k + q,); positive where violated."""
        linear = self.matrix @ z - self.bound if len(self.bound) else np.empty(0)
        return np.concatenate((linear, self.contacts(z)[0]))

    def inequality_rows(self, z: FloatArray) -> FloatArray:
        """Their derivatives (k + q, n)."""
        return np.concatenate((self.rows(), self.contacts(z)[1]))

    def rows(self) -> FloatArray:
        """A (k, n), also when k is 0."""
        return self.matrix if len(self.bound) else np.empty((0, len(self.start)))

    def clipped(self, z: FloatArray) -> FloatArray:
        """Nearest point of the box."""
        return np.clip(z, self.lower, self.upper)

    def violation(self, z: FloatArray) -> float:
        """Largest violation of an equality, inequality or bound."""
        parts = (
            np.abs(self.equalities(z)[0]),
            self.inequalities(z),
            self.lower - z,
            z - self.upper,
        )
        return float(max(part.max(initial=0.0) for part in parts))

    def projected(self, z: FloatArray, gradient: FloatArray) -> float:
        """Largest entry of z - clip(z - gradient): zero at a minimum within the box."""
        return float(np.abs(z - self.clipped(z - gradient)).max())


class Stop(StrEnum):
    """Why a method stopped; only the first is an answer to the tolerances asked for."""

    CONVERGED = "converged: projected gradient and constraints within tolerance"
    DECREASE = "the objective no longer decreases, though the gradient is above its tolerance"
    OUTER_LIMIT = "limit of outer iterations"
    INNER_LIMIT = "limit of inner iterations"
    INFEASIBLE = "the constraints cannot be met near here"
    NONFINITE = "a function or derivative is not finite"
    FAILED = "the method failed"

    @property
    def usable(self) -> bool:
        """True for a point worth keeping when its constraints hold."""
        return self in (Stop.CONVERGED, Stop.DECREASE, Stop.INNER_LIMIT)


@dataclass(frozen=True, eq=False)
class Multipliers:
    """Of the equalities (m,) and inequalities (k + q,), with the penalty that goes with them."""

    equality: FloatArray
    inequality: FloatArray
    penalty: float


@dataclass(frozen=True, eq=False)
class Outcome:
    """End of a run.

    outer, inner, evaluations  counts; ``outer`` is 1 for a method without outer iterations
    projected_gradient         of the Lagrangian on the box, largest entry
    """

    z: FloatArray
    objective: float
    stop: Stop
    outer: int
    inner: int
    evaluations: int
    violation: float
    projected_gradient: float
    multipliers: Multipliers
