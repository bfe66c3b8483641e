"""Nonlinear programs with own sparse derivatives, solved by Ipopt through CasADi.

    minimise f(x)   subject to   g_lower <= g(x) <= g_upper,   x_lower <= x <= x_upper

f, g and their derivatives are NumPy callables; CasADi sees them as callbacks that read and write raw
buffers, so nothing is differentiated, coloured or built twice (20 us a call at 3000 unknowns).
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from types import FrameType
from typing import Any, Final

import numpy as np

from casashell.engine.nlp_calls import Calls, Iterate, Option, Report
from casashell.typing import FloatArray, IntArray


class NlpStatus(StrEnum):
    """How a run of Ipopt ended; only the first is an answer."""

    CONVERGED = "converged"
    ACCEPTABLE = "stopped at a point that is only acceptable, not converged"
    INFEASIBLE = "locally infeasible: the constraints cannot be met near here"
    ITERATION_LIMIT = "iteration limit"
    TIME_LIMIT = "time limit"
    STALLED = "steps too small to go on"
    DIVERGED = "iterates diverge"
    STOPPED = "stopped by request"
    RESTORATION_FAILED = "no step reduces the violation of the constraints"
    STEP_FAILED = "the linear system of a step could not be solved"
    NONFINITE = "a function or derivative is not finite"
    MALFORMED = "more constraints than unknowns, or an option Ipopt does not accept"
    FAILED = "Ipopt failed"

    @property
    def converged(self) -> bool:
        """True for a point that meets every tolerance."""
        return self is NlpStatus.CONVERGED


_WORDS: Final[Mapping[str, NlpStatus]] = {
    "Solve_Succeeded": NlpStatus.CONVERGED,
    "Feasible_Point_Found": NlpStatus.CONVERGED,  # what a square system ends as
    "Solved_To_Acceptable_Level": NlpStatus.ACCEPTABLE,
    "Infeasible_Problem_Detected": NlpStatus.INFEASIBLE,
    "Search_Direction_Becomes_Too_Small": NlpStatus.STALLED,
    "Diverging_Iterates": NlpStatus.DIVERGED,
    "User_Requested_Stop": NlpStatus.STOPPED,
    "Maximum_Iterations_Exceeded": NlpStatus.ITERATION_LIMIT,
    "Maximum_CpuTime_Exceeded": NlpStatus.TIME_LIMIT,
    "Maximum_WallTime_Exceeded": NlpStatus.TIME_LIMIT,
    "Restoration_Failed": NlpStatus.RESTORATION_FAILED,
    "Error_In_Step_Computation": NlpStatus.STEP_FAILED,
    "Invalid_Number_Detected": NlpStatus.NONFINITE,
    "Not_Enough_Degrees_Of_Freedom": NlpStatus.MALFORMED,
    "Invalid_Problem_Definition": NlpStatus.MALFORMED,
    "Invalid_Option": NlpStatus.MALFORMED,
}


def status_in_words(ipopt: str) -> NlpStatus:
    """Meaning of a return status of Ipopt; FAILED for crashes and for statuses not known here."""
    return _WORDS.get(ipopt, NlpStatus.FAILED)


@dataclass(frozen=True, eq=False)
class Nlp:
    """Functions, patterns, bounds and start of a nonlinear program; n unknowns, m constraints.

    objective           x (n,) -> f
    objective_gradient  x -> (n,)
    constraints         x -> (m,)
    jacobian            x -> entries of dg/dx at (jacobian_rows, jacobian_columns)
    hessian             x, s, y (m,) -> entries of s d2f/dx2 + sum y_i d2g_i/dx2 at (hessian_rows,
                        hessian_columns), one of each symmetric pair
    Entries at the same place are added.  Bounds may be infinite.
    Raises ValueError for sizes that do not fit together.
    """

    start: FloatArray
    lower: FloatArray
    upper: FloatArray
    constraint_lower: FloatArray
    constraint_upper: FloatArray
    objective: Callable[[FloatArray], float]
    objective_gradient: Callable[[FloatArray], FloatArray]
    constraints: Callable[[FloatArray], FloatArray]
    jacobian: Callable[[FloatArray], FloatArray]
    jacobian_rows: IntArray
    jacobian_columns: IntArray
    hessian: Callable[[FloatArray, float, FloatArray], FloatArray]
    hessian_rows: IntArray
    hessian_columns: IntArray

    def __post_init__(self) -> None:
        n, m = len(self.start), len(self.constraint_lower)
        if n == 0:
            raise ValueError("a nonlinear program needs at least one unknown")
        if not np.all(np.isfinite(self.start)):
            raise ValueError("the start of a nonlinear program must be finite")
        for name, size in (("lower", n), ("upper", n), ("constraint_upper", m)):
            if np.shape(getattr(self, name)) != (size,):
                raise ValueError(f"{name} must have shape ({size},)")
        for name, height in (("jacobian", m), ("hessian", n)):
            rows, columns = getattr(self, f"{name}_rows"), getattr(self, f"{name}_columns")
            if rows.shape != columns.shape:
                raise ValueError(f"{name}: as many rows as columns are needed")
            if rows.size and not (
                0 <= rows.min() <= rows.max() < height and 0 <= columns.min() <= columns.max() < n
            ):
                raise ValueError(f"{name}: an entry lies outside of ({height}, {n})")

    def violation(self, x: FloatArray, g: FloatArray) -> float:
        """Largest violation of a bound by x (n,) or of a constraint by its values g (m,)."""
        parts = (
            self.lower - x,
            x - self.upper,
            self.constraint_lower - g,
            g - self.constraint_upper,
        )
        return float(max(part.max(initial=0.0) for part in parts))


@dataclass(frozen=True, eq=False)
class NlpResult:
    """End of a run.

    multipliers        (m,) of the constraints and bound_multipliers (n,): at a solution
                       df/dx + J^T multipliers + bound_multipliers = 0
    violation          largest violation of a constraint or bound at x
    stationarity       largest entry of that sum at x
    """

    x: FloatArray
    objective: float
    multipliers: FloatArray
    bound_multipliers: FloatArray
    status: NlpStatus
    iterations: int
    seconds: float
    violation: float
    stationarity: float


_QUIET: Final[Mapping[str, Option]] = {"print_level": 0, "sb": "yes"}


def minimise(
    nlp: Nlp,
    *,
    tolerance: float = 1e-8,
    max_iterations: int = 300,
    report: Report | None = None,
    options: Mapping[str, Option] | None = None,
) -> NlpResult:
    """Local minimum of ``nlp`` by Ipopt.

    tolerance  on the scaled optimality conditions; ``options`` are Ipopt's own and come last
    report     called with every `Iterate`; keep what an interrupt must not lose

    Exceptions of callables and of ``report`` end the run and are raised here, and so is
    KeyboardInterrupt, within one iteration.
    """
    begin = time.perf_counter()
    calls = Calls(nlp, report)
    settings = {
        **_QUIET,
        "tol": tolerance,
        "max_iter": max_iterations,
        "acceptable_iter": 0,  # an acceptable point is not an answer
        "nlp_scaling_method": "none",
        "bound_relax_factor": 0.0,  # a bound is a bound
        # Dependent constraints, as without friction: with Ipopt's 1e-8 rounding decides what happens.
        "jacobian_regularization_value": 1e-6,
        **(options or {}),
    }
    with _interrupts_wait() as waiting:
        calls.waiting = waiting
        solver = calls.solver(settings)
        try:
            found = solver(
                x0=nlp.start,
                lbx=nlp.lower,
                ubx=nlp.upper,
                lbg=nlp.constraint_lower,
                ubg=nlp.constraint_upper,
            )
        except RuntimeError:
            if calls.error is None:
                raise
        if calls.error is not None:
            raise calls.error
    stats = solver.stats()
    x, y, z = (np.asarray(found[name]).ravel() for name in ("x", "lam_g", "lam_x"))
    gradient = nlp.objective_gradient(x) + z
    np.add.at(gradient, nlp.jacobian_columns, nlp.jacobian(x) * y[nlp.jacobian_rows])
    return NlpResult(
        x=x,
        objective=float(nlp.objective(x)),
        multipliers=y,
        bound_multipliers=z,
        status=status_in_words(str(stats["return_status"])),
        iterations=int(stats["iter_count"]),
        seconds=time.perf_counter() - begin,
        violation=nlp.violation(x, nlp.constraints(x)),
        stationarity=float(np.abs(gradient).max()),
    )


Handler = Callable[[int, FrameType | None], Any]


@contextmanager
def _interrupts_wait() -> Iterator[list[tuple[int, FrameType | None]]]:
    """Keep Ctrl-C for the end of the block: an exception must not unwind through compiled code.

    Yields the signals that wait.  Outside of the main thread Python delivers none.
    """
    waiting: list[tuple[int, FrameType | None]] = []
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield waiting
        return
    signal.signal(signal.SIGINT, lambda number, frame: waiting.append((number, frame)))
    try:
        yield waiting
    finally:
        signal.signal(signal.SIGINT, before)
    if waiting:
        before(*waiting[0])


__all__ = ["Iterate", "Nlp", "NlpResult", "NlpStatus", "minimise", "status_in_words"]
