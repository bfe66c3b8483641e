"""The ladder: dearer rungs when the cheap one does not hold the target."""

from __future__ import annotations

import numpy as np
import pytest

from casashell.inverse import auto
from casashell.inverse.auto import AutoSolver
from casashell.inverse.direct import DirectSolver
from casashell.inverse.one_shot import NlpSolver
from casashell.inverse.outcome import Outcome
from casashell.inverse.piece import split
from casashell.inverse.two_step import TwoStepSolver
from casashell.result import Step
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
