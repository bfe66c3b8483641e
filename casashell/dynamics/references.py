"""Two other solvers of a step, for when Newton's method fails and to hold it against.

Both linearise the balance, A dd + g = f with the convex part of A, solve contact for that exactly, and
repeat until the step is solved.

    sweeps  Gauss-Seidel on the Delassus operator of the touches, with the closed form of one contact
    conic   Acary, Cadoux, Lemarechal and Malick 2011 (ZAMM 91(2)): with the sliding s = |delta_T| given
            Coulomb's law is that of the cone program
                min 1/2 f.W f + (b + mu s n).f     over forces f in their friction cones
            with W the Delassus operator; s follows from its answer.  Solved by Clarabel
"""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np
import scipy.sparse as sp

from casashell.dynamics.coulomb import sweep
from casashell.dynamics.delassus import reduce
from casashell.dynamics.newton import Solved, StepSolver
from casashell.dynamics.touch import Touches
from casashell.engine.sparse_solver import SingularMatrix
from casashell.typing import FloatArray

Method: TypeAlias = Literal["sweeps", "conic"]

#: Linearisations of one step.
ROUNDS = 60
#: Rounds without progress that end it.
_PATIENCE = 8


def solve_step(
    solver: StepSolver,
    touches: Touches,
    d: FloatArray,
    f: FloatArray,
    method: Method,
    rounds: int = ROUNDS,
) -> Solved:
    """The step from a first guess (d, f) by one of the references; says whether it converged."""
    best = Solved(d, f, np.inf, 0, False)
    waited = 0
    for count in range(1, rounds + 1):
        try:
            d, f = _round(solver, touches, d, f, method)
        except (SingularMatrix, np.linalg.LinAlgError):
            break
        at = solver.balance(touches, d, f, solver.system.force(d))
        if not np.isfinite(at.size):
            break
        waited = 0 if at.size < 0.9 * best.residual else waited + 1
        if at.size < best.residual:
            best = Solved(d, f, at.size, count, at.size <= solver.goal)
        if best.converged or waited > _PATIENCE:
            break
    return best


def _round(
    solver: StepSolver, touches: Touches, d: FloatArray, f: FloatArray, method: Method
) -> tuple[FloatArray, FloatArray]:
    """One linearisation and its contact problem."""
    g, entries = solver.system.linearised(d, convex=True)
    solver.linear.factor_shell(entries)
    reduced = reduce(solver.linear, g, touches, d)
    local = np.einsum("cij,cj->ci", reduced.axes, f)
    method_of = sweep if method == "sweeps" else _by_cones
    local = method_of(reduced.matrix, reduced.alone, touches.friction, local)
    change, f = reduced.moved(local)
    return d + change, f


def _by_cones(
    delassus: FloatArray, alone: FloatArray, friction: FloatArray, f: FloatArray
) -> FloatArray:
    """Forces (C,3) of the cone program in the axes of the touches; ``alone`` (C,3): motion without.

    Each cone is scaled by its own compliance, and all forces by the largest there could be.
    """
    import clarabel

    count = len(alone)
    # Cone variable z >= |z_T| with f_N = z_N, f_T = mu z_T; without friction z_T does nothing.
    own = 1.0 / np.sqrt(np.diag(delassus).reshape(-1, 3).sum(axis=1))
    weight = (own[:, None] * np.column_stack([np.ones(count), friction, friction])).ravel()
    slide = np.linalg.norm((delassus @ f.ravel()).reshape(-1, 3)[:, 1:] + alone[:, 1:], axis=1)
    lifted = alone.copy()
    lifted[:, 0] += friction * slide
    push = weight * lifted.ravel()
    scale = float(np.abs(push).max()) or 1.0
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-12
    answer = clarabel.DefaultSolver(
        sp.csc_matrix(np.triu(weight[:, None] * delassus * weight)),
        push / scale,
        sp.csc_matrix(-sp.eye_array(3 * count)),
        np.zeros(3 * count),
        [clarabel.SecondOrderConeT(3)] * count,
        settings,
    ).solve()
    return np.asarray(scale * weight * np.asarray(answer.x)).reshape(-1, 3)
