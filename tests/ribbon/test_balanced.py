"""Unknowns of even curvature for the augmented Lagrangian."""

from __future__ import annotations

import numpy as np
import pytest

from casashell.app.ribbon_scenes import builtin_setup
from casashell.ribbon.augmented import Schedule, augmented
from casashell.ribbon.balanced import Balanced
from casashell.ribbon.dynamics import simulate
from casashell.ribbon.exact import exact
from casashell.ribbon.program import Program
from casashell.typing import FloatArray

STIFF = np.array([300.0, 1.0, 10.0, 100.0, 1.0])
MIX = np.triu(np.ones((5, 5)))
GOAL = np.array([2.0, -1.0, 0.5, 0.3, 4.0])


def uneven() -> Program:
    """A badly scaled quadratic; a box, a loose bound, an equality, a row and a contact are active."""
    hessian = MIX.T @ np.diag(STIFF) @ MIX
    lower, upper = np.full(5, -np.inf), np.full(5, np.inf)
    lower[0], upper[0], upper[4] = -1.0, 1.0, 1.5

    def objective(z: FloatArray) -> tuple[float, FloatArray]:
        away = z - GOAL
        return float(away @ hessian @ away) / 2, hessian @ away

    def contacts(z: FloatArray) -> tuple[FloatArray, FloatArray]:
        return np.array([0.7 - z[3] + 0.1 * z[0]]), np.array([[0.1, 0.0, 0.0, -1.0, 0.0]])

    return Program(
        start=np.zeros(5),
        lower=lower,
        upper=upper,
        objective=objective,
        hessian=lambda z, y: hessian,
        equalities=lambda z: (np.array([z[1] + z[2]]), np.array([[0.0, 1.0, 1.0, 0.0, 0.0]])),
        matrix=np.array([[0.0, 1.0, 0.0, 0.0, 1.0]]),
        bound=np.array([1.0]),
        contacts=contacts,
    )


@pytest.mark.parametrize("boxes", [0, 2, 5])
def test_the_minimum_is_the_same(boxes: int) -> None:
    """And its multipliers, and what is measured of it; there and back keeps multipliers."""
    program = uneven()
    true = exact(program, gradient=1e-10)
    even = Balanced.of(program, np.arange(5) < boxes, 10.0)
    found = even.back(augmented(even.program, Schedule(gradient=1e-7)))
    np.testing.assert_allclose(found.z, true.z, atol=1e-5)
    assert found.objective == pytest.approx(true.objective, rel=1e-7)
    assert found.violation < 1e-7
    np.testing.assert_allclose(
        found.multipliers.equality, true.multipliers.equality, rtol=1e-3, atol=1e-3
    )
    np.testing.assert_allclose(
        found.multipliers.inequality, true.multipliers.inequality, rtol=1e-3, atol=1e-3
    )
    there = even.there(found.multipliers).inequality
    assert len(there) == len(even.program.inequalities(np.zeros(5)))


def test_the_method_of_the_paper_gets_through_the_first_steps_of_torsion() -> None:
    """Some 9000 iterations of the first step without it."""
    setup = builtin_setup("torsion")
    sim = simulate(setup.scene, 0.1, 0.05, solver="augmented")
    exactly = simulate(setup.scene, 0.1, 0.05, form="positions")
    assert len(sim.times) == 3
    assert sim.parts.max() == 1
    assert sim.inner.max() < 1500
    off = np.abs(sim.tracks[0].middle[-1] - exactly.tracks[0].middle[-1]).max()
    assert off < 2e-2 * 10.0
