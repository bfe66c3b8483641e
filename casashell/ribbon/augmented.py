"""Augmented Lagrangian around L-BFGS-B, as in Pan, Huang and Bao 2016, Sec. 4.

    L_A = f + y . C + (mu/2) |C|^2 + 1/(2 mu) sum ( max(0, v + mu G)^2 - v^2 ),    G = (A z - b, contacts)

Multipliers and penalty by the schedule of Nocedal and Wright, Numerical Optimization, Alg. 17.4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from casashell.ribbon.program import Multipliers, Outcome, Program, Stop
from casashell.typing import FloatArray


@dataclass(frozen=True)
class Schedule:
    """Tolerances and limits; the objective is expected in units where its curvature is about 1.

    feasibility, gradient   at the end: largest |C|, max(0, G) and projected gradient
    penalty, growth         first mu, and its factor when the constraints lag behind
    outer, inner            limits: rounds, and iterations of each
    memory                  pairs kept by L-BFGS-B
    decrease                relative decrease of f below which an inner run ends, in units of rounding
    """

    feasibility: float = 1e-8
    gradient: float = 1e-6
    penalty: float = 10.0
    growth: float = 8.0
    outer: int = 40
    inner: int = 3000
    memory: int = 20
    decrease: float = 10.0

    def __post_init__(self) -> None:
        for name in ("feasibility", "gradient", "penalty", "decrease"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} of a schedule must be positive")
        if not self.growth > 1 or min(self.outer, self.inner, self.memory) < 1:
            raise ValueError("a schedule needs growth > 1 and limits of at least 1")


@dataclass(frozen=True, eq=False)
class Inner:
    """End of one minimisation on the box."""

    z: FloatArray
    iterations: int
    evaluations: int
    stop: Stop


@dataclass(frozen=True, eq=False)
class Lagrangian:
    """L_A for fixed multipliers."""

    program: Program
    at: Multipliers

    def __call__(self, z: FloatArray) -> tuple[float, FloatArray]:
        """Value and gradient (n,)."""
        value, gradient = self.program.objective(z)
        y, v, mu = self.at.equality, self.at.inequality, self.at.penalty
        if len(y):
            c, jacobian = self.program.equalities(z)
            value += float(y @ c + 0.5 * mu * (c @ c))
            gradient = gradient + jacobian.T @ (y + mu * c)
        if len(v):
            force = np.maximum(0.0, v + mu * self.program.inequalities(z))
            value += float(force @ force - v @ v) / (2.0 * mu)
            gradient = gradient + self.program.inequality_rows(z).T @ force
        return value, gradient


def lbfgsb(function: Lagrangian, start: FloatArray, gradient: float, schedule: Schedule) -> Inner:
    """SciPy's L-BFGS-B until the projected gradient is below ``gradient``."""
    program = function.program
    found = minimize(
        function,
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=np.column_stack((program.lower, program.upper)),
        options={
            "maxcor": schedule.memory,
            "gtol": gradient,
            "ftol": schedule.decrease * np.finfo(float).eps,
            "maxiter": schedule.inner,
            "maxfun": 3 * schedule.inner,
            "maxls": 40,
        },
    )
    if not np.isfinite(found.fun):
        stop = Stop.NONFINITE
    elif program.projected(found.x, found.jac) <= gradient:
        stop = Stop.CONVERGED
    else:
        stop = Stop.INNER_LIMIT if found.status == 1 else Stop.DECREASE
    return Inner(program.clipped(found.x), int(found.nit), int(found.nfev), stop)


def augmented(
    program: Program,
    schedule: Schedule | None = None,
    warm: Multipliers | None = None,
) -> Outcome:
    """Local minimum of ``program``, from its start and the multipliers of a run before.

    The outcome's ``stop`` tells both ends apart: by the gradient, or by a decrease lost in rounding.
    """
    plan = schedule or Schedule()
    z = program.clipped(program.start)
    at = warm or _cold(program, plan)
    constrained = bool(len(at.equality) or len(at.inequality))
    wanted = at.penalty**-0.1
    omega = max(plan.gradient, 1.0 / at.penalty) if len(at.equality) else plan.gradient
    inner = evaluations = 0
    for outer in range(1, plan.outer + 1):
        run = lbfgsb(Lagrangian(program, at), z, omega, plan)
        z, inner, evaluations = run.z, inner + run.iterations, evaluations + run.evaluations
        if run.stop is Stop.NONFINITE:
            return _outcome(program, z, at, run.stop, (outer, inner, evaluations))
        equality, inequality = program.equalities(z)[0], program.inequalities(z)
        off = max(np.abs(equality).max(initial=0.0), inequality.max(initial=0.0))
        if off > max(wanted, plan.feasibility):
            mu = at.penalty * plan.growth
            at = Multipliers(at.equality, at.inequality, mu)
            wanted, omega = mu**-0.1, max(plan.gradient, 1.0 / mu) if len(equality) else omega
            continue
        at = Multipliers(
            at.equality + at.penalty * equality,
            np.maximum(0.0, at.inequality + at.penalty * inequality),
            at.penalty,
        )
        tight = omega <= plan.gradient
        if (off <= plan.feasibility and tight) or not constrained:
            return _outcome(program, z, at, run.stop, (outer, inner, evaluations))
        wanted, omega = wanted * at.penalty**-0.9, max(plan.gradient, omega / at.penalty)
    return _outcome(program, z, at, Stop.OUTER_LIMIT, (plan.outer, inner, evaluations))


def _cold(program: Program, plan: Schedule) -> Multipliers:
    m = len(program.equalities(program.start)[0])
    return Multipliers(
        np.zeros(m), np.zeros(len(program.inequalities(program.start))), plan.penalty
    )


def _outcome(
    program: Program, z: FloatArray, at: Multipliers, stop: Stop, counts: tuple[int, int, int]
) -> Outcome:
    """Measured afresh: the gradient of the Lagrangian, with multipliers and no penalty."""
    value, gradient = program.objective(z)
    gradient = gradient + program.equalities(z)[1].T @ at.equality
    gradient = gradient + program.inequality_rows(z).T @ at.inequality
    return Outcome(
        z, value, stop, *counts, program.violation(z), program.projected(z, gradient), at
    )
