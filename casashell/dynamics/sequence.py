"""A step by a sequence of linearised ones, each with its contacts solved exactly: slow and sure.

Newton's method changes the branch of every touch at once, and where friction couples neighbours
strongly it may go round in circles.  Here shell and contact take turns: the shell is linearised, with
the convex part of its stiffness where it would buckle; Gauss-Seidel sweeps with the closed form of one
contact solve Coulomb's law for that (`casashell.dynamics.coulomb`), in few unknowns; a line search on the
energy of the step follows.  Near the answer Newton's method ends it.
"""

from __future__ import annotations

import numpy as np

from casashell.dynamics.coulomb import sweep
from casashell.dynamics.delassus import reduce
from casashell.dynamics.linear import Move
from casashell.dynamics.newton import Solved, StepSolver
from casashell.dynamics.touch import Touches
from casashell.engine.sparse_solver import SingularMatrix
from casashell.typing import FloatArray, IntArray

#: Linearisations of one step, and those without progress that end it.
ROUNDS, _PATIENCE = 20, 4
#: Touches that the sweeps may take on.
_MANY = 80
#: Sweeps of one linearisation and the relative change of forces that ends them.
_SWEEPS, _SETTLED = 40, 1e-4
#: Residual, in mean nodal weights, from which Newton's method takes over; by how much it must be smaller
#: before that is tried again.
_NEAR, _NEARER = 0.3, 0.1


def solve_sequence(
    solver: StepSolver, touches: Touches, d: FloatArray, f: FloatArray, h: float
) -> Solved:
    """The step from a first guess (d, f); says whether it converged, never raises for the numbers."""
    best = Solved(d, f, np.inf, 0, False)
    waited, near = 0, _NEAR * solver.weight
    with np.errstate(all="ignore"):
        for count in range(1, ROUNDS + 1):
            try:
                made = _round(solver, touches, d, f)
            except (SingularMatrix, np.linalg.LinAlgError):
                break
            if made is None:
                break
            d, f, residual = made
            if not np.isfinite(residual):
                break
            waited = 0 if residual < 0.7 * best.residual else waited + 1
            if residual < best.residual:
                best = Solved(d, f, residual, count, residual <= solver.goal)
            if residual <= near:
                near = _NEARER * residual
                ended = solver.solve(touches, d, f, h)
                if ended.converged:
                    return ended
            if best.converged or waited > _PATIENCE:
                break
    return best


def _round(
    solver: StepSolver, touches: Touches, d: FloatArray, f: FloatArray
) -> tuple[FloatArray, FloatArray, float] | None:
    """One linearisation: displacements, forces, residual [N]; None with more touches than it takes."""
    linear = solver.linear
    g, entries = solver.system.linearised(d)
    if linear.factor_shell(entries) != 0:
        g, entries = solver.system.linearised(d, convex=True)
        linear.factor_shell(entries)
    free = linear.push_shell(-g.ravel()).reshape(-1, 3)
    closed = (touches.gaps(d) <= 0.0) | (touches.gaps(d + free) <= 0.0) | (f != 0.0).any(axis=1)
    while True:
        chosen = np.flatnonzero(closed)
        if len(chosen) > _MANY:
            return None
        change, pushed = _contact(solver, touches, d, f, g, chosen)
        missed = ~closed & (touches.gaps(d + change) < 0.0)
        if not missed.any():
            break
        closed |= missed
    _, d, f, at = solver.advance(touches, d, f, Move(change, pushed - f))
    return d, f, at.size


def _contact(
    solver: StepSolver,
    touches: Touches,
    d: FloatArray,
    f: FloatArray,
    g: FloatArray,
    chosen: IntArray,
) -> tuple[FloatArray, FloatArray]:
    """Change (V,3) m and forces (C,3) N where only the ``chosen`` touches take part."""
    few = touches.only(chosen)
    reduced = reduce(solver.linear, g, few, d)
    local = np.einsum("cij,cj->ci", reduced.axes, f[chosen])
    local = sweep(reduced.matrix, reduced.alone, few.friction, local, _SWEEPS, _SETTLED)
    change, forces = reduced.moved(local)
    pushed = np.zeros_like(f)
    pushed[chosen] = forces
    return change, pushed
