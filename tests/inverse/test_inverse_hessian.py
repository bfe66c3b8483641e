"""Quasi-Newton approximations on quadratics, where they are exact after as many steps as variables."""

from __future__ import annotations

import numpy as np
import pytest

from casashell.inverse.inverse_hessian import DenseBfgs, LimitedBfgs, QuasiNewton
from casashell.typing import FloatArray

SIZE = 8


def _matrix() -> FloatArray:
    root = np.random.default_rng(0).standard_normal((SIZE, SIZE))
    return np.asarray(root @ root.T + np.eye(SIZE))


def _after_exact_searches(approximation: QuasiNewton) -> FloatArray:
    """What is left of a start after SIZE steps with exact line searches."""
    matrix = _matrix()
    x = np.random.default_rng(1).standard_normal(SIZE)
    for _ in range(SIZE):
        step = -approximation.times(matrix @ x)
        step *= -float(step @ matrix @ x) / float(step @ matrix @ step)
        approximation.learn(step, matrix @ step)
        x = x + step
    return x


@pytest.mark.parametrize("made", [DenseBfgs(SIZE), LimitedBfgs()], ids=["dense", "limited"])
def test_quadratic_is_minimised_in_as_many_steps_as_variables(made: QuasiNewton) -> None:
    """Conjugate directions (Nocedal and Wright 2006, Thm. 6.4); the dense inverse is then exact."""
    assert np.abs(_after_exact_searches(made)).max() <= 1e-10
    if isinstance(made, DenseBfgs):
        vector = np.arange(1.0, SIZE + 1.0)
        assert np.allclose(made.times(_matrix() @ vector), vector, rtol=1e-9)


@pytest.mark.parametrize("made", [DenseBfgs(SIZE), LimitedBfgs()], ids=["dense", "limited"])
def test_secant_equation_symmetry_and_forgetting(made: QuasiNewton) -> None:
    rng = np.random.default_rng(2)
    for _ in range(3):
        step = rng.standard_normal(SIZE)
        change = _matrix() @ step
        made.learn(step, change)
        assert np.allclose(made.times(change), step, rtol=1e-9)  # the secant equation
    a, b = rng.standard_normal((2, SIZE))
    assert a @ made.times(b) == pytest.approx(b @ made.times(a), rel=1e-9)
    made.learn(step, -change)  # negative curvature teaches nothing
    assert np.allclose(made.times(change), step, rtol=1e-9)
    made.forget()
    assert np.array_equal(made.times(a), a)
