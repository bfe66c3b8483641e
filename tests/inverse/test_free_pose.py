"""The closest stable pose: what direct inversion cannot hold, what it can, and what nothing can."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from small_scenes import clamped_page, hat_on_ball, sheet_on_slope

from casashell.app.builtin import skirt
from casashell.engine.assembly import Assembly
from casashell.engine.sparse_solver import SparseSolver
from casashell.inverse import free_system, load_path
from casashell.inverse.drape import drape
from casashell.inverse.free_pose import FreePoseSolver
from casashell.inverse.piece import split
from casashell.inverse.pulled import Pulled
from casashell.problem import Problem
from casashell.result import Step
from casashell.solving import solve
from casashell.status import Status
from casashell.typing import FloatArray


def silent(step: Step) -> None:
    """No progress wanted."""


def test_a_target_that_can_be_held_is_held() -> None:
    result = solve(skirt(6, 20).problem, "free-pose")
    assert result.status is Status.SOLVED
    assert result.certificate.target_distance == 0.0


def test_a_slope_that_is_too_slippery_stays_infeasible() -> None:
    """tan 20 degrees is 0.36, more than the friction, whatever the pose."""
    result = solve(sheet_on_slope(20.0, 0.1), "free-pose")
    assert result.status is Status.INFEASIBLE


def test_a_target_too_soft_to_be_held_becomes_a_stable_pose_nearby() -> None:
    """Thresholds of a certified result; that direct inversion fails is what makes the scene soft."""
    problem = clamped_page(bend=3e-5)
    assert solve(problem, "direct").status is Status.TOO_SOFT
    result = solve(problem, "free-pose")
    c = result.certificate
    assert result.status is Status.SOLVED_NEARBY
    assert c.free_force is not None
    assert c.free_force <= 1e-6
    assert c.min_eigenvalue is not None
    assert c.min_eigenvalue > 0.0
    assert np.array_equal(result.pose[:8], problem.target.vertices[:8])  # pins
    assert any("could not be held" in note for note in result.notes)
    drape = drape_of_target(problem)
    gap = np.linalg.norm(result.pose - problem.target.vertices)
    assert gap < np.linalg.norm(drape - problem.target.vertices)  # the steps come closer


def drape_of_target(problem: Problem) -> FloatArray:
    """Where the shell hangs when the target itself is its natural shape."""
    (piece,) = split(problem)
    draped = drape(Pulled(piece, 0.0), piece.target, piece.target, piece.held)
    assert draped.good
    return draped.pose + piece.origin


def test_steps_analyse_their_patterns_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Newton's bordered matrix of the steps and the Cholesky factor that tests them."""
    made: list[str] = []
    for module in (load_path, free_system):
        make = module.make_solver

        def counted(
            *args: Any, make: Callable[..., SparseSolver] = make, name: str = module.__name__
        ) -> SparseSolver:
            made.append(name)
            return make(*args)

        monkeypatch.setattr(module, "make_solver", counted)
    (piece,) = split(clamped_page(bend=3e-5))
    solver = FreePoseSolver(piece, silent)
    solver.run()
    assert solver.steps > 5
    # two load paths (at the target, at moved poses); the drapes' system and the steps' own
    assert made.count(load_path.__name__) == 2
    assert made.count(free_system.__name__) == 2


def test_an_interrupt_keeps_a_finite_shape() -> None:
    def stop(step: Step) -> None:
        raise KeyboardInterrupt

    result = solve(hat_on_ball(bend=1e-5), "free-pose", callback=stop)
    assert result.status is Status.INTERRUPTED
    assert np.all(np.isfinite(result.rest))


@pytest.mark.parametrize("second", ["mixed", "pose"])
def test_slope_of_a_curvature(second: str) -> None:
    """v.Hv changes by (C(v) v).dx and (B(v) v).dr: central differences, error of second order."""
    (piece,) = split(hat_on_ball())
    assembly: Assembly = piece.assembly
    rng = np.random.default_rng(0)
    x, r, v, d = (rng.standard_normal(piece.target.shape) for _ in range(4))
    x, r = piece.target + 0.05 * piece.h * x, piece.target + 0.05 * piece.h * r
    d = piece.h * d

    def curvature(e: float) -> float:
        moved = (x + e * d, r) if second == "pose" else (x, r + e * d)
        _, entries = assembly.hessian(*moved)
        return float(v.ravel() @ (assembly.pattern.matrix(entries) @ v.ravel()))

    block = assembly.lagrangian_pose if second == "pose" else assembly.lagrangian_mixed
    wanted = float(d.ravel() @ (assembly.pattern.matrix(block(x, r, v)) @ v.ravel()))
    steps = np.array([4e-3, 2e-3, 1e-3])
    errors = [abs((curvature(e) - curvature(-e)) / (2.0 * e) - wanted) for e in steps]
    order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert order == pytest.approx(2.0, abs=0.1)
    assert errors[-1] <= 1e-2 * abs(wanted)
