"""Solving the balance program of a piece: as it is, with central forces, with slack."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from casashell.engine.nlp import Iterate, NlpStatus, minimise
from casashell.inverse.balance_nlp import BalanceNlp
from casashell.inverse.load_path import Report
from casashell.result import Step
from casashell.typing import FloatArray

#: Violation of a balance row (in f0) and of the optimality conditions that end a run.
FEASIBLE: Final = 1e-10
OPTIMAL: Final = 1e-8
#: Residual / f0 up to which a program counts as balanced, as Newton's does.
BALANCED: Final = 1e-8
#: Weight of the slack against the change of the natural shape.  Forces in f0 are some 1e4 times as steep
#: as shapes in h, so 1 counts what is missing first; more only teaches the shell to shed its weight by
#: shrinking, and does not converge.
SLACK_WEIGHT: Final = 1.0
MAX_ITERATIONS: Final = 200
#: Iterations after which another version of the program is tried; most converge in 5 to 60.
FIRST_TRY: Final = 75


@dataclass(frozen=True, eq=False)
class Balance:
    """Natural shape and contact forces in balance, or as near to it as the slack allows.

    rest            (n,3) m
    contact_forces  (C,3) N, inside their cones in any case
    residual        largest entry of dE/dx - S f at unpinned vertices, / f0
    tolerance       what the residual may be: `BALANCED`, or more for elements that are very stiff
    slack           largest slack / f0; 0 when none was needed
    status          of the last run of Ipopt
    """

    rest: FloatArray
    contact_forces: FloatArray
    residual: float
    tolerance: float
    slack: float
    iterations: int
    seconds: float
    status: NlpStatus

    @property
    def converged(self) -> bool:
        """Balanced without slack, at a minimum."""
        return self.status.converged and self.slack == 0.0 and self.residual <= self.tolerance


Keep = Callable[[FloatArray, FloatArray], None]


def balance(
    program: BalanceNlp,
    rest: FloatArray,
    forces: FloatArray,
    *,
    elastic: bool = True,
    max_iterations: int = MAX_ITERATIONS,
    seconds: float = np.inf,
    report: Report | None = None,
    keep: Keep | None = None,
) -> Balance:
    """Solve ``program`` from the natural shape ``rest`` (n,3) and contact forces (C,3) [N].

    elastic  when there is no solution near by, answer with the program with slack
    seconds  of the processor after which Ipopt stops: on a busy machine the answer is the same
    keep     called with natural shape and contact forces of every iterate
    """
    begin, started = time.perf_counter(), time.process_time()
    if len(program.dofs) == 0:
        nothing = np.zeros((len(program.piece.contacts), 3))
        done = NlpStatus.CONVERGED
        return Balance(program.reference, nothing, 0.0, BALANCED, 0.0, 0, 0.0, done)
    versions = [program]
    if len(program.piece.contacts) and not program.elastic:
        versions.append(program.centred())
    if elastic and not program.elastic:
        versions.append(program.softened(SLACK_WEIGHT))
    spent, limit = 0, rounding(program)
    allowed = max(BALANCED, 2.0 * limit)
    for version in versions:
        last = version is versions[-1]

        def each(iterate: Iterate, version: BalanceNlp = version, spent: int = spent) -> None:
            if keep is not None:
                keep(version.rest(iterate.x), version.contact_forces(iterate.x))
            if report is not None:
                name = "ipopt with slack" if version.elastic else "ipopt"
                at, shape = spent + iterate.iteration, version.rest(iterate.x)
                report(Step(name, 1.0, at, iterate.violation, 0.0, rest=shape, pose=version.pose))

        result = minimise(
            version.nlp(version.unknowns(rest, forces)),
            tolerance=OPTIMAL,
            max_iterations=max_iterations if last else min(max_iterations, FIRST_TRY),
            report=each,
            options={
                "constr_viol_tol": max(FEASIBLE, limit),
                # Adaptive takes two thirds of the iterations, and wanders where slack is needed.
                "mu_strategy": "monotone" if version.elastic else "adaptive",
                "max_cpu_time": max(1e-3, min(1e20, seconds - (time.process_time() - started))),
            },
        )
        spent += result.iterations
        found = version.rest(result.x), version.contact_forces(result.x)
        residual = unbalanced(version, *found)
        if result.status.converged and residual <= allowed:
            break
    slack = version.slack(result.x)
    seconds = time.perf_counter() - begin
    return Balance(*found, residual, allowed, slack, spent, seconds, result.status)


def unbalanced(program: BalanceNlp, rest: FloatArray, forces: FloatArray) -> float:
    """Largest entry of dE/dx - S f at unpinned vertices, / f0."""
    piece = program.piece
    gap = program.energy.gradient(program.pose, rest) - piece.spread(forces)
    return float(np.abs(gap.ravel()[program.dofs]).max(initial=0.0)) / piece.f0


def rounding(program: BalanceNlp) -> float:
    """What rounding the coordinates of the natural shape does to a balance row, / f0, at most."""
    piece = program.piece
    _, entries = program.energy.mixed(program.pose, program.reference)
    stiffness = abs(piece.assembly.pattern.matrix(entries))
    worst = np.asarray(stiffness @ np.abs(program.reference).ravel())[program.dofs]
    return float(np.finfo(np.float64).eps * worst.max(initial=0.0)) / piece.f0
