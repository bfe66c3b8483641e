"""The same program by Ipopt with its exact Hessian."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from casashell.engine.nlp import Nlp, NlpResult, NlpStatus, minimise
from casashell.engine.nlp_calls import Option
from casashell.ribbon.program import Hessian, Multipliers, Outcome, Program, Stop
from casashell.typing import FloatArray, IntArray

#: Ipopt trusts a start: it is a shape, perhaps with rulings at their limit, not a guess.
CLOSE: dict[str, Option] = {
    "mu_init": 1e-5,
    "bound_push": 1e-8,
    "bound_frac": 1e-8,
    "slack_bound_push": 1e-8,
    "slack_bound_frac": 1e-8,
}
#: With contacts it starts outside of them, and an eighth fewer iterations lead back with more room.
ROOM: dict[str, Option] = {
    "mu_init": 1e-4,
    "bound_push": 1e-6,
    "bound_frac": 1e-6,
    "slack_bound_push": 1e-6,
    "slack_bound_frac": 1e-6,
}
#: What the ends of a run of Ipopt are called here.
STOPS = {
    NlpStatus.CONVERGED: Stop.CONVERGED,
    NlpStatus.STALLED: Stop.DECREASE,
    NlpStatus.ITERATION_LIMIT: Stop.INNER_LIMIT,
    NlpStatus.INFEASIBLE: Stop.INFEASIBLE,
    NlpStatus.RESTORATION_FAILED: Stop.INFEASIBLE,
    NlpStatus.NONFINITE: Stop.NONFINITE,
}


@dataclass(eq=False)
class _Memory:
    """Last value of the objective and of the equalities: Ipopt asks for value and gradient apart."""

    program: Program
    count: int = 0

    def __post_init__(self) -> None:
        self._objective: tuple[FloatArray, tuple[float, FloatArray]] | None = None
        self._equalities: tuple[FloatArray, tuple[FloatArray, FloatArray]] | None = None
        self._contacts: tuple[FloatArray, tuple[FloatArray, FloatArray]] | None = None

    def objective(self, z: FloatArray) -> tuple[float, FloatArray]:
        if self._objective is None or not np.array_equal(self._objective[0], z):
            self._objective = (z.copy(), self.program.objective(z))
            self.count += 1
        return self._objective[1]

    def equalities(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        if self._equalities is None or not np.array_equal(self._equalities[0], z):
            self._equalities = (z.copy(), self.program.equalities(z))
        return self._equalities[1]

    def contacts(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        if self._contacts is None or not np.array_equal(self._contacts[0], z):
            self._contacts = (z.copy(), self.program.contacts(z))
        return self._contacts[1]


def independent_rows(jacobian: FloatArray, tolerance: float = 1e-9) -> IntArray:
    """Rows of ``jacobian`` (m, n) that span all of it, in order (pivoted QR)."""
    if not len(jacobian):
        return np.empty(0, dtype=np.int64)
    triangle, order = qr(jacobian.T, mode="r", pivoting=True)
    size = np.abs(np.diag(triangle))
    return np.sort(order[: np.count_nonzero(size > tolerance * max(size[0], 1e-300))]).astype(
        np.int64
    )


def exact(
    program: Program,
    *,
    feasibility: float = 1e-8,
    gradient: float = 1e-6,
    iterations: int = 200,
) -> Outcome:
    """Local minimum of ``program`` by Ipopt.

    Equalities whose rows depend on others at the start are left out (Ipopt needs independent ones)
    and measured at the end: left unmet, they make the outcome INFEASIBLE.
    Raises ValueError for a program without second derivatives.
    """
    if program.hessian is None:
        raise ValueError("this program has no second derivatives: use the augmented Lagrangian")
    z = program.clipped(program.start)
    memory = _Memory(program)
    m = len(memory.equalities(z)[0])
    kept = independent_rows(memory.equalities(z)[1])
    found = minimise(
        _nlp(program, program.hessian, memory, z, kept),
        tolerance=gradient,
        max_iterations=iterations,
        options={**(ROOM if len(memory.contacts(z)[0]) else CLOSE), "constr_viol_tol": feasibility},
    )
    return _outcome(program, memory, found, kept, m, feasibility)


def _nlp(
    program: Program, curvature: Hessian, memory: _Memory, start: FloatArray, kept: IntArray
) -> Nlp:
    n, k, m = len(start), len(program.bound), len(memory.equalities(start)[0])
    q = len(memory.contacts(start)[0])
    upper = np.triu_indices(n)
    rows, columns = np.divmod(np.arange((len(kept) + k + q) * n), n)
    matrix = program.rows()

    def constraints(z: FloatArray) -> FloatArray:
        return np.concatenate((memory.equalities(z)[0][kept], matrix @ z, memory.contacts(z)[0]))

    def jacobian(z: FloatArray) -> FloatArray:
        parts = (memory.equalities(z)[1][kept], matrix, memory.contacts(z)[1])
        return np.concatenate([part.ravel() for part in parts])

    def hessian(z: FloatArray, scale: float, y: FloatArray) -> FloatArray:
        force = np.zeros(m + q)
        force[kept], force[m:] = y[: len(kept)], y[len(kept) + k :]
        if scale == 1.0:
            return curvature(z, force)[upper]
        flat = curvature(z, np.zeros(m + q))  # the restoration phase scales f: C'' is linear in y
        return (scale * flat + curvature(z, force) - flat)[upper]

    return Nlp(
        start=start,
        lower=program.lower,
        upper=program.upper,
        constraint_lower=np.concatenate((np.zeros(len(kept)), np.full(k + q, -np.inf))),
        constraint_upper=np.concatenate((np.zeros(len(kept)), program.bound, np.zeros(q))),
        objective=lambda z: memory.objective(z)[0],
        objective_gradient=lambda z: memory.objective(z)[1],
        constraints=constraints,
        jacobian=jacobian,
        jacobian_rows=rows.astype(np.int64),
        jacobian_columns=columns.astype(np.int64),
        hessian=hessian,
        hessian_rows=upper[0].astype(np.int64),
        hessian_columns=upper[1].astype(np.int64),
    )


def _outcome(
    program: Program,
    memory: _Memory,
    found: NlpResult,
    kept: IntArray,
    m: int,
    feasibility: float,
) -> Outcome:
    z = program.clipped(found.x)
    stop = STOPS.get(found.status, Stop.FAILED)
    violation = program.violation(z)
    if stop is Stop.CONVERGED and violation > 10.0 * feasibility:
        stop = Stop.INFEASIBLE
    equality = np.zeros(m)
    equality[kept] = found.multipliers[: len(kept)]
    inequality = np.maximum(0.0, found.multipliers[len(kept) :])
    value, gradient = memory.objective(z)
    gradient = gradient + memory.equalities(z)[1].T @ equality
    gradient = gradient + program.inequality_rows(z).T @ inequality
    return Outcome(
        z=z,
        objective=value,
        stop=stop,
        outer=1,
        inner=found.iterations,
        evaluations=memory.count,
        violation=violation,
        projected_gradient=program.projected(z, gradient),
        multipliers=Multipliers(equality, inequality, 10.0),
    )
