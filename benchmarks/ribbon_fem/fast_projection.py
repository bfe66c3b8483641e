"""A step without constraints, then the nearest nodes whose links have their length.

Goldenthal et al. 2007, as English and Bridson 2008 use it: with J the derivative of the lengths C, repeat

    J M^-1 J^T tension = C(x),   x = x - M^-1 J^T tension

until the lengths are kept.  The move is nearest in the mass norm, which knows no stiffness: a state of rest
is one of equilibrium only as h goes to 0.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.ribbon_fem.body import Body
from benchmarks.ribbon_fem.forms import Forms
from benchmarks.ribbon_fem.implicit import ImplicitEuler, State, StepFailed
from benchmarks.ribbon_fem.saddle import Saddle
from casashell.engine.sparse_solver import SingularMatrix
from casashell.typing import FloatArray

#: Error of length, relative to the shortest link, that ends a projection.
TOLERANCE = 1e-8
BUDGET = 100


class FastProjection:
    """Implicit Euler with bending and weight only, then projection onto fixed lengths.

    Raises ValueError for a body without links.
    """

    def __init__(self, body: Body) -> None:
        if not len(body.forms) or np.any(body.forms.compliance > 0):
            raise ValueError("nothing to project: the body has no links of fixed length")
        self.body = body
        none = Forms.links(body.rest, np.empty((0, 2), dtype=np.int64))
        self._loose = ImplicitEuler(replace(body, forms=none))
        self._saddle = Saddle(body, elastic=False)
        self._shortest = float(
            np.linalg.norm(np.ptp(body.rest[body.forms.nodes], axis=1), axis=1).min()
        )

    def begin(self, x: FloatArray | None = None, v: FloatArray | None = None) -> State:
        """The state at t = 0: flat and at rest by default."""
        return replace(self._loose.begin(x, v), tension=np.zeros(len(self.body.forms)))

    def step(self, state: State, h: float) -> State:
        """One step of h [s]; raises StepFailed when either half does not converge."""
        loose = self._loose.step(replace(state, tension=np.empty(0)), h)
        try:
            x, tension, count = self._project(loose.x)
        except SingularMatrix as error:
            raise StepFailed(f"step to t = {loose.time:g}: {error}") from None
        return State(x, (x - state.x) / h, tension / h**2, loose.time, count)

    def _project(self, x: FloatArray) -> tuple[FloatArray, FloatArray, int]:
        goal = TOLERANCE * self._shortest
        total = np.zeros(len(self.body.forms))
        still, none = np.zeros_like(x), np.zeros_like(total)
        for count in range(BUDGET + 1):
            gap = self.body.forms.values(x)
            worst = float(np.abs(gap).max())
            if worst <= goal:
                return x, total, count
            if not np.isfinite(worst):
                break
            self._saddle.factor(self.body.mass, x)
            move, tension = self._saddle.solve(still, -gap, none)
            x, total = x + move, total + tension
        raise StepFailed(
            f"lengths are still wrong by {worst:.1e} m after {count} projections; try a shorter step"
        )
