"""The ladder: dearer rungs when the cheap one does not hold the target."""

from __future__ import annotations

import numpy as np
import pytest

from casashell import Capsule, Problem, Status, solve
from casashell.inverse import auto
from casashell.inverse.auto import AutoSolver
from casashell.inverse.direct import DirectSolver
from casashell.inverse.feasibility_proof import rigid_proof
from casashell.inverse.one_shot import NlpSolver
from casashell.inverse.outcome import Outcome
from casashell.inverse.piece import split
from casashell.inverse.two_step import TwoStepSolver
from casashell.result import Step
from formulations import discrete_shell
from tests.meshes import grid
from tests.small_scenes import hat_on_ball


def _fails(self: DirectSolver | NlpSolver) -> Outcome:
    """A rung that does not hold the target."""
    return self.best


def _solver() -> AutoSolver:
    (piece,) = split(hat_on_ball(), interpreted=False)
    return AutoSolver(piece, lambda step: None)


def test_the_two_step_method_is_tried_where_path_and_program_fail(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(DirectSolver, "run", _fails)
    monkeypatch.setattr(NlpSolver, "run", _fails)
    solver = _solver()
    outcome = solver.run()
    assert outcome.good
    assert solver.method == "two-step"
    assert "direct did not hold the target, two-step found the answer" in solver.notes


def test_a_rung_that_takes_too_long_is_stopped_and_the_next_one_tried(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def endless(self: TwoStepSolver) -> Outcome:
        while True:
            self.report(Step("endless", 1.0, 0, np.nan, 0.0))

    monkeypatch.setattr(DirectSolver, "run", _fails)
    monkeypatch.setattr(NlpSolver, "run", _fails)
    monkeypatch.setattr(TwoStepSolver, "run", endless)
    monkeypatch.setattr(auto, "PATIENCE", 0.01)
    solver = _solver()
    solver.run()
    assert "two-step was stopped: it took too long" in solver.notes
    assert len(solver.solvers) >= 3


def _ledge(second: float) -> Problem:
    """A flat sheet, 1 m long, on two thin bars across it, one at its end and one at ``second`` m."""
    mesh = grid(10, 2, 0.1, 0.1)
    bars = tuple(
        Capsule((x, -0.1, -0.02), (x, 0.3, -0.02), 0.02, friction=0.5) for x in (0.0, second)
    )
    terms = discrete_shell(mesh, density=0.2, stretch=20.0, bend=1e-2, gravity=(0.0, 0.0, -9.81))
    return Problem(mesh, terms, bars, contact_tolerance=1e-6)


def _nearest_centre() -> float:
    """Least x of the centre of mass when every column may weigh 4 times more or less than now."""
    x, mass = 0.1 * np.arange(11), np.array([0.5, *[1.0] * 9, 0.5])
    # Heavy columns first: the best choice is a threshold.
    centres = []
    for k in range(12):
        weights = np.where(np.arange(11) < k, 4.0, 0.25) * mass
        centres.append(float((weights * x).sum() / weights.sum()))
    return min(centres)


def test_an_overhang_that_no_near_masses_can_balance_is_proved_and_said_no_more_than_that() -> None:
    """Lever rule by hand: the centre of mass stays beyond the second bar, unless masses are free."""
    assert _nearest_centre() > 0.1
    result = solve(_ledge(0.1))
    assert result.status is Status.INFEASIBLE
    assert "areas within a factor of 4" in result.advice
    assert "density" not in result.advice
    assert any("areas up to 4 times" in note for note in result.notes)


def test_an_overhang_that_other_masses_could_balance_is_not_proved_impossible() -> None:
    assert _nearest_centre() < 0.3
    (piece,) = split(_ledge(0.3), interpreted=False)
    assert rigid_proof(piece) is None
