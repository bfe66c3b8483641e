"""Algorithm 1 of Ly 2018 as a whole: certified answers, both second steps, the schedule of the pull."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from casashell.app.builtin import skirt
from casashell.inverse.load_path import Report
from casashell.inverse.piece import Piece, split
from casashell.inverse.two_step import PAPER, Continuation, TwoStepSolver
from casashell.problem import Problem
from casashell.result import Step
from casashell.solving import solve
from casashell.status import Status


def silent(step: Step) -> None:
    """No progress wanted."""


@pytest.fixture(scope="module")
def problem() -> Problem:
    return skirt(6, 20).problem


@pytest.mark.parametrize("step2", ["ipopt", "bfgs"])
def test_a_skirt_is_certified_with_either_second_step(problem: Problem, step2: str) -> None:
    result = solve(problem, "two-step", step2=step2)  # type: ignore[arg-type]
    assert result.status is Status.SOLVED
    assert result.method == "two-step"
    assert result.certificate.free_force is not None
    assert result.certificate.free_force <= 1e-6


def test_the_methods_find_different_natural_shapes_of_one_target(problem: Problem) -> None:
    """Each is an equilibrium; the contact forces, and so the shapes, are not unique (Sec. 8.2)."""
    shapes = [solve(problem, method) for method in ("direct", "two-step", "nlp")]
    assert all(s.status is Status.SOLVED for s in shapes)
    h = problem.target.mean_edge_length
    gaps = [np.abs(a.rest - b.rest).max() / h for a in shapes for b in shapes if a is not b]
    assert 0.0 < max(gaps) < 0.2


def test_pins_alone_need_no_second_step() -> None:
    scene = skirt(6, 20)
    stages: list[str] = []
    problem = Problem(scene.target, scene.problem.energies, pinned=range(20))
    result = solve(problem, "two-step", callback=lambda step: stages.append(step.stage))
    assert result.status is Status.SOLVED
    assert "step two" not in stages
    assert result.contacts.vertices.size == 0


def test_schedule_of_the_paper() -> None:
    """Sec. 7.1: 1000, halved, zero once below 0.1: 14 pulls and one pass without."""
    piece = next(iter(split(skirt(6, 20).problem)))
    pulls = list(PAPER.pulls(piece))
    assert pulls[0] == 1000.0
    assert pulls[1] == 500.0
    assert pulls[-1] == 0.0
    assert len(pulls) == 15
    assert min(pulls[:-1]) > 0.1


def test_scaled_schedule_follows_the_scene() -> None:
    piece = next(iter(split(skirt(6, 20).problem)))
    pulls = list(Continuation().pulls(piece))
    assert pulls[0] == pytest.approx(1e3 * piece.f0 / piece.h)


def test_nothing_that_holds_is_infeasible() -> None:
    scene = skirt(6, 20)
    result = solve(Problem(scene.target, scene.problem.energies), "two-step")
    assert result.status is Status.INFEASIBLE


def test_an_interrupt_keeps_the_best(problem: Problem) -> None:
    count = 0

    def stop(step: Step) -> None:
        nonlocal count
        count += 1
        if count > 3:
            raise KeyboardInterrupt

    result = solve(problem, "two-step", callback=stop)
    assert result.status is Status.INTERRUPTED
    assert np.all(np.isfinite(result.rest))


def test_unknown_preset_and_step_are_named(problem: Problem) -> None:
    with pytest.raises(ValueError, match="preset must be one of scaled, paper"):
        solve(problem, "two-step", preset="mine")
    with pytest.raises(ValueError, match="step2 must be one of ipopt, bfgs"):
        solve(problem, "two-step", step2="newton")  # type: ignore[arg-type]


def test_without_skipping_every_pull_is_passed(problem: Problem) -> None:
    def passes(continuation: Continuation) -> int:
        seen: list[str] = []
        report: Report = lambda step: seen.append(step.stage)  # noqa: E731
        piece: Piece = next(iter(split(problem)))
        TwoStepSolver(piece, report, continuation=continuation).run()
        return seen.count("step two")

    assert passes(replace(Continuation(), skip=False)) > passes(Continuation())
