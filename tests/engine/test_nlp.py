"""The door to Ipopt: known minima, statuses in words, errors and interrupts that come through."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from casashell.engine.nlp import Iterate, Nlp, NlpStatus, minimise, status_in_words
from casashell.typing import FloatArray

INF = np.inf


def rosenbrock(constraint: bool = True, hook: Callable[[], None] = lambda: None) -> Nlp:
    """Rosenbrock's valley from (-1, 1); with the constraint -10 <= x + y <= 1.5."""
    m = int(constraint)

    def objective(x: FloatArray) -> float:
        hook()
        return float((x[0] - 1.0) ** 2 + 100.0 * (x[1] - x[0] ** 2) ** 2)

    def gradient(x: FloatArray) -> FloatArray:
        bend = x[1] - x[0] ** 2
        return np.array([2.0 * (x[0] - 1.0) - 400.0 * x[0] * bend, 200.0 * bend])

    def hessian(x: FloatArray, scale: float, y: FloatArray) -> FloatArray:
        first = 2.0 - 400.0 * (x[1] - 3.0 * x[0] ** 2)
        return scale * np.array([0.5 * first, -400.0 * x[0], 200.0, 0.5 * first])

    return Nlp(
        start=np.array([-1.0, 1.0]),
        lower=np.full(2, -INF),
        upper=np.full(2, INF),
        constraint_lower=np.full(m, -10.0),
        constraint_upper=np.full(m, 1.5),
        objective=objective,
        objective_gradient=gradient,
        constraints=lambda x: np.full(m, x.sum()),
        jacobian=lambda x: np.ones(2 * m),
        jacobian_rows=np.zeros(2 * m, dtype=np.int64),
        jacobian_columns=np.arange(2 * m),
        hessian=hessian,
        # one entry of the lower triangle, and one diagonal entry given in two parts
        hessian_rows=np.array([0, 1, 1, 0]),
        hessian_columns=np.array([0, 0, 1, 0]),
    )


def test_unconstrained_minimum() -> None:
    """(1, 1), with value 0."""
    steps: list[Iterate] = []
    result = minimise(rosenbrock(False), report=steps.append)
    assert result.status.converged
    assert np.abs(result.x - 1.0).max() <= 1e-8
    assert len(steps) == result.iterations + 1
    assert [step.iteration for step in steps] == list(range(len(steps)))
    assert steps[0].objective == 4.0  # at (-1, 1)
    assert np.array_equal(steps[-1].x, result.x)
    assert result.iterations <= 25  # regression: 20


def test_constrained_minimum_meets_the_optimality_conditions() -> None:
    """On x + y = 1.5, where the gradient is minus the multiplier times (1, 1)."""
    nlp = rosenbrock()
    result = minimise(nlp, tolerance=1e-10)
    assert result.status is NlpStatus.CONVERGED
    assert result.x.sum() == pytest.approx(1.5, abs=1e-8)
    assert result.multipliers[0] > 0.0
    assert np.abs(nlp.objective_gradient(result.x) + result.multipliers).max() <= 1e-7
    assert result.stationarity <= 1e-7
    assert result.violation <= 1e-8


def test_bounds_have_multipliers() -> None:
    nlp = replace(rosenbrock(False), upper=np.array([0.5, INF]))
    result = minimise(nlp)
    assert result.x == pytest.approx([0.5, 0.25], abs=1e-6)
    assert result.bound_multipliers[0] == pytest.approx(1.0, abs=1e-4)  # -df/dx = 2 (1 - x)


def test_impossible_constraints_are_called_infeasible() -> None:
    """x^2 + y^2 <= -1."""
    nlp = replace(
        rosenbrock(),
        constraint_lower=np.array([-INF]),
        constraint_upper=np.array([-1.0]),
        constraints=lambda x: np.array([x @ x]),
        jacobian=lambda x: 2.0 * x,
        hessian=lambda x, s, y: (
            s * np.array([1.0, 0.0, 2.0, 1.0]) + y[0] * np.array([2.0, 0, 2, 0])
        ),
    )
    result = minimise(nlp)
    assert result.status is NlpStatus.INFEASIBLE
    assert result.violation == pytest.approx(1.0, abs=1e-3)


def test_limits_and_numbers_that_are_not_finite() -> None:
    assert minimise(rosenbrock(), max_iterations=3).status is NlpStatus.ITERATION_LIMIT
    lost = replace(rosenbrock(), objective=lambda x: np.nan)
    assert minimise(lost).status is NlpStatus.NONFINITE


def test_every_status_has_words() -> None:
    assert status_in_words("Solved_To_Acceptable_Level") is NlpStatus.ACCEPTABLE
    assert not NlpStatus.ACCEPTABLE.converged
    assert status_in_words("Internal_Error") is NlpStatus.FAILED
    assert status_in_words("anything else") is NlpStatus.FAILED
    assert [status for status in NlpStatus if status.converged] == [NlpStatus.CONVERGED]


def test_nothing_is_printed(capfd: pytest.CaptureFixture[str]) -> None:
    minimise(rosenbrock())
    minimise(replace(rosenbrock(), objective=lambda x: np.nan))
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("good_calls", [0, 1, 7])
def test_errors_of_functions_come_through(
    good_calls: int, capfd: pytest.CaptureFixture[str]
) -> None:
    left = [good_calls]

    def hook() -> None:
        left[0] -= 1
        if left[0] < 0:
            raise ZeroDivisionError("in the objective")

    with pytest.raises(ZeroDivisionError, match="in the objective"):
        minimise(rosenbrock(hook=hook))
    assert capfd.readouterr() == ("", "")


def test_interrupt_from_a_report_keeps_the_iterates() -> None:
    steps: list[Iterate] = []

    def report(step: Iterate) -> None:
        steps.append(step)
        if step.iteration == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        minimise(rosenbrock(), report=report)
    assert len(steps) == 6
    assert steps[-1].objective < steps[0].objective


@pytest.mark.parametrize("delay", [0.02, 0.05, 0.081])
def test_ctrl_c_ends_the_run(delay: float) -> None:
    timer = threading.Timer(delay, lambda: os.kill(os.getpid(), signal.SIGINT))
    before = signal.getsignal(signal.SIGINT)
    begin = time.perf_counter()
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        minimise(rosenbrock(hook=lambda: time.sleep(0.01)))  # 0.3 s when left alone
    timer.join()
    assert time.perf_counter() - begin < delay + 0.2
    assert signal.getsignal(signal.SIGINT) is before


def test_sizes_that_do_not_fit_are_refused() -> None:
    nlp = rosenbrock()
    with pytest.raises(ValueError, match="upper must have shape"):
        replace(nlp, upper=np.zeros(3))
    with pytest.raises(ValueError, match="jacobian: an entry lies outside"):
        replace(nlp, jacobian_columns=np.array([0, 2]))
    with pytest.raises(ValueError, match="finite"):
        replace(nlp, start=np.array([0.0, np.nan]))
    with pytest.raises(ValueError, match="at least one unknown"):
        replace(nlp, start=np.empty(0))
