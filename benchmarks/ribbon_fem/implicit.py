"""Implicit Euler by Newton's method on nodes and tensions together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.ribbon_fem.body import Body
from benchmarks.ribbon_fem.saddle import Saddle
from casashell.engine.sparse_solver import SingularMatrix
from casashell.typing import FloatArray

#: Length of the last Newton move, in lengths of the mean edge, that ends a step.
TOLERANCE = 1e-8
#: Last move that is put up with when the budget is spent.
ROUGH = 1e-3
#: Error of exact forms in lengths of the mean edge, with a small move and with the budget spent.
EXACT, NEARLY = 1e-8, 1e-6
BUDGET = 40
#: Iterations in which tensions, still far from right, are not trusted to stiffen anything.
_EARLY = 8
#: Least and most of what is added to the mass, in masses, and by what factor it grows.
_LEAST, _MOST, _STIFFER = 1e-2, 1e8, 4.0


class StepFailed(RuntimeError):
    """A step did not converge; the message says how far it came."""


@dataclass(frozen=True, eq=False)
class State:
    """Nodes x (n,3) [m], velocities v (n,3) [m/s] and tensions (P,) of the forms at a time [s].

    move  the last Newton move in mean edges: above `TOLERANCE` where the budget was spent
    """

    x: FloatArray
    v: FloatArray
    tension: FloatArray
    time: float
    iterations: int = 0
    move: float = 0.0


class ImplicitEuler:
    """min |x - x0 - h v0|^2_M / (2 h^2) + E(x) + forms - f.x, each step.

    The tensions of the forms are unknowns of their own, so that it makes no difference to Newton's
    method how stiff the forms are.  Where second derivatives are not positive a multiple of the mass is
    added.  No node moves more than a mean edge in
    an iteration.
    """

    def __init__(self, body: Body) -> None:
        self.body = body
        self.edge = body.patch.mesh.mean_edge_length
        self._saddle = Saddle(body, elastic=True)
        self._raised = _LEAST

    def begin(self, x: FloatArray | None = None, v: FloatArray | None = None) -> State:
        """The state at t = 0: flat and at rest by default.  ValueError for nodes of another body."""
        x = np.array(self.body.rest if x is None else x, dtype=np.float64)
        v = np.zeros_like(x) if v is None else np.array(v, dtype=np.float64)
        if x.shape != self.body.rest.shape or v.shape != x.shape:
            raise ValueError(f"nodes and velocities must be {self.body.rest.shape}")
        return State(self.body.held(x, 0.0), v, np.zeros(len(self.body.forms)), 0.0)

    def step(self, state: State, h: float) -> State:
        """One step of h [s]; raises StepFailed when Newton's method does not converge."""
        target = state.x + h * state.v
        x = self.body.held(state.x, state.time + h)
        try:
            x, tension, count, move = self._newton(x, state, target, h)
        except SingularMatrix as error:
            raise StepFailed(f"step to t = {state.time + h:g}: {error}") from None
        return State(x, (x - state.x) / h, tension, state.time + h, count, move)

    def _newton(
        self, x: FloatArray, start: State, target: FloatArray, h: float
    ) -> tuple[FloatArray, FloatArray, int, float]:
        body, inertia = self.body, self.body.mass / h**2
        assembly, tension = body.at(start.time + h), start.tension
        longest, exact = np.inf, body.forms.compliance == 0
        for count in range(1, BUDGET + 1):
            gradient, entries = assembly.hessian(x, body.rest)
            gradient += inertia[:, None] * (x - target) - body.force
            self._factor(x, entries, tension, inertia, early=count <= _EARLY)
            gap = body.forms.values(x)
            wrong = float(np.abs(gap[exact]).max(initial=0.0)) / self.edge
            move, tension = self._saddle.solve(-gradient, -gap, tension)
            longest = float(np.sqrt((move * move).sum(axis=1)).max())
            if longest <= TOLERANCE * self.edge and wrong <= EXACT:
                return x + move, tension, count, longest / self.edge
            x = x + min(1.0, self.edge / longest) * move
        if longest <= ROUGH * self.edge and wrong <= NEARLY:
            return x, tension, BUDGET, longest / self.edge
        raise StepFailed(
            f"no convergence in {BUDGET} iterations with h = {h:g} s: the last move was "
            f"{longest:.1e} m, lengths are wrong by {wrong:.1e} edges; try a shorter step"
        )

    def _factor(
        self,
        x: FloatArray,
        entries: FloatArray,
        tension: FloatArray,
        inertia: FloatArray,
        *,
        early: bool,
    ) -> None:
        """Factor second derivatives, made positive."""
        if self._saddle.factor(inertia, x, entries, tension):
            self._raised = max(0.5 * self._raised, _LEAST)
            return
        if early and self._saddle.factor(inertia, x, entries, np.zeros_like(tension)):
            return
        raised = self._raised
        while raised < _MOST:
            if self._saddle.factor((1.0 + raised) * inertia, x, entries, tension):
                self._raised = max(raised / _STIFFER, _LEAST)
                return
            raised *= _STIFFER
        raise SingularMatrix("second derivatives cannot be made positive")
