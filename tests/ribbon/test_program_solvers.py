"""The two solvers of a program on problems with known answers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from casashell.ribbon.augmented import Schedule, augmented
from casashell.ribbon.exact import exact, independent_rows
from casashell.ribbon.program import Outcome, Program, Stop
from casashell.typing import FloatArray

SOLVERS: list[Callable[[Program], Outcome]] = [augmented, exact]
INF = np.inf


def quadratic(h: FloatArray, b: FloatArray) -> dict[str, object]:
    """f = z.H z/2 - b.z"""
    return {
        "objective": lambda z: (float(0.5 * z @ h @ z - b @ z), h @ z - b),
        "hessian": lambda z, y: h,
    }


def sphere(z: FloatArray) -> tuple[FloatArray, FloatArray]:
    return np.array([z @ z - 1.0]), 2.0 * z[None]


@pytest.mark.parametrize("solve", SOLVERS)
def test_box_closed_form(solve: Callable[[Program], Outcome]) -> None:
    """Separable: the minimum is the clipped free one."""
    h = np.diag([1.0, 2.0, 4.0])
    found = solve(
        Program(
            np.zeros(3), np.full(3, -1.0), np.full(3, 0.5), **quadratic(h, np.array([3.0, 0.5, -8]))
        )
    )
    assert found.stop is Stop.CONVERGED
    np.testing.assert_allclose(found.z, [0.5, 0.25, -1.0], atol=1e-6)
    assert found.outer == 1


@pytest.mark.parametrize("solve", SOLVERS)
def test_equality_on_the_sphere(solve: Callable[[Program], Outcome]) -> None:
    """min b.z with |z| = 1 is at -b/|b|; the multiplier is |b|/2 (closed form)."""
    b = np.array([1.0, -2.0, 2.0])
    program = Program(
        np.array([0.3, 0.2, -0.8]),
        np.full(3, -INF),
        np.full(3, INF),
        objective=lambda z: (float(b @ z), b.copy()),
        hessian=lambda z, y: 2.0 * y[0] * np.eye(3),
        equalities=sphere,
    )
    found = solve(program)
    assert found.stop is Stop.CONVERGED
    np.testing.assert_allclose(found.z, -b / 3.0, atol=1e-6)
    np.testing.assert_allclose(found.multipliers.equality, [1.5], atol=1e-5)
    assert found.violation < 1e-7
    assert found.projected_gradient < 1e-5


@pytest.mark.parametrize("solve", SOLVERS)
def test_two_linear_inequalities(solve: Callable[[Program], Outcome]) -> None:
    """min |z - 1|^2/2 with |sum z| <= 1: z = 1/n, multiplier 1 - 1/n (closed form)."""
    n = 5
    program = Program(
        np.zeros(n),
        np.full(n, -2.0),
        np.full(n, 2.0),
        **quadratic(np.eye(n), np.ones(n)),
        matrix=np.array([np.ones(n), -np.ones(n)]),
        bound=np.ones(2),
    )
    found = solve(program)
    assert found.stop is Stop.CONVERGED
    np.testing.assert_allclose(found.z, 1.0 / n, atol=1e-6)
    np.testing.assert_allclose(found.multipliers.inequality, [1.0 - 1.0 / n, 0.0], atol=1e-5)


def test_repeated_equality_is_left_out_for_ipopt() -> None:
    b = np.array([1.0, 2.0])
    twice = np.array([[1.0, 1.0], [2.0, 2.0], [1.0, 1.0]])
    assert len(independent_rows(twice)) == 1
    for value, stop in ((0.0, Stop.CONVERGED), (1.0, Stop.INFEASIBLE)):
        program = Program(
            np.zeros(2),
            np.full(2, -INF),
            np.full(2, INF),
            **quadratic(np.eye(2), b),
            equalities=lambda z, value=value: (twice @ z - [0.0, 0.0, value], twice),
        )
        found = exact(program)
        assert found.stop is stop
        np.testing.assert_allclose(found.violation, value, atol=1e-7)
    np.testing.assert_allclose(independent_rows(np.diag([1.0, 0.0, 2.0])), [0, 2])


def test_warm_multipliers_save_outer_iterations() -> None:
    n = 4
    program = Program(
        np.full(n, 0.1),
        np.full(n, -INF),
        np.full(n, INF),
        **quadratic(np.diag(np.arange(1.0, n + 1)), np.ones(n)),
        equalities=lambda z: (np.array([z.sum() - 1.0]), np.ones((1, n))),
    )
    cold = augmented(program)
    warm = augmented(program, warm=cold.multipliers)
    assert warm.outer < cold.outer
    # closed form: z_i = (1 - y)/i, sum = 1, so y = 1 - 1/(1 + 1/2 + 1/3 + 1/4) = 1 - 12/25
    np.testing.assert_allclose(warm.multipliers.equality, [13.0 / 25.0], atol=1e-6)


def test_infeasible_constraints_are_reported() -> None:
    program = Program(
        np.zeros(1),
        np.full(1, -1.0),
        np.full(1, 1.0),
        **quadratic(np.eye(1), np.zeros(1)),
        equalities=lambda z: (z - 2.0, np.eye(1)),
    )
    found = augmented(program, Schedule(outer=8))
    assert found.stop is Stop.OUTER_LIMIT
    assert found.violation == pytest.approx(1.0)
    assert exact(program).stop is not Stop.CONVERGED


def test_not_a_number_is_reported() -> None:
    program = Program(
        np.ones(1),
        np.zeros(1),
        np.ones(1),
        objective=lambda z: (float("nan"), np.full(1, np.nan)),
        hessian=lambda z, y: np.eye(1),
    )
    assert augmented(program).stop is Stop.NONFINITE
    assert exact(program).stop in (Stop.NONFINITE, Stop.FAILED)


def test_bad_programs_are_refused() -> None:
    f = quadratic(np.eye(1), np.ones(1))
    one = np.ones(1)
    with pytest.raises(ValueError, match="finite"):
        Program(np.array([np.nan]), -one, one, **f)
    with pytest.raises(ValueError, match="unknown 0"):
        Program(one, one, -one, **f)
    with pytest.raises(ValueError, match="matrix"):
        Program(one, -one, one, **f, bound=one)
    with pytest.raises(ValueError, match="second derivatives"):
        exact(Program(one, -one, one, objective=f["objective"]))
    with pytest.raises(ValueError, match="growth"):
        Schedule(growth=1.0)
