"""Step one: natural shapes whose drape is the target, and what happens when there is none."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from meshes import grid, rolled
from plain_shell import PlainShell
from small_scenes import DOWN, hat_on_ball

from casashell.inverse.certificate import certify
from casashell.inverse.drape import METHODS as DRAPES
from casashell.inverse.drape import Draped, DrapeMethod
from casashell.inverse.piece import Piece, split
from casashell.inverse.pulled import Pulled
from casashell.inverse.step_one import (
    PAPER,
    Limits,
    StepOne,
    StepOneMethod,
    longest_step,
    step_one,
)
from casashell.problem import Problem
from casashell.result import Step
from casashell.typing import FloatArray

EVERY: tuple[StepOneMethod, ...] = ("auto", "bfgs", "l-bfgs", "newton")
every = pytest.mark.parametrize("method", EVERY)


def _page(bend: float = 1e-2) -> Problem:
    """A curved sheet pinned along two rows."""
    target = rolled(grid(5, 3, 0.05, 0.05), 0.05, 0.12)
    return Problem(target, PlainShell(target, bend=bend, gravity=DOWN).terms(), pinned=range(8))


def _piece(bend: float = 1e-2) -> Piece:
    (piece,) = split(_page(bend))
    return piece


@every
def test_pinned_sheet_is_recovered_and_certified(method: StepOneMethod) -> None:
    """J below 1e-10 of h^2 a vertex, as a pose that the independent certificate accepts."""
    problem, piece = _page(), _piece()
    shape = step_one(Pulled(piece, 0.0), piece.target, piece.held, method=method)
    assert shape.reason == "target"
    assert shape.distance <= 1e-10 * piece.h**2 * len(piece.target)
    assert np.array_equal(shape.rest[piece.pinned], piece.target[piece.pinned])
    certificate, _ = certify(
        problem.energies,
        problem.target.vertices,
        shape.draped.pose + piece.origin,
        shape.rest + piece.origin,
        problem.contacts,
        np.zeros((0, 3)),
        np.asarray(problem.pinned),
        piece.h,
    )
    assert certificate.free_force is not None
    assert certificate.free_force <= 1e-8
    assert certificate.min_eigenvalue is not None
    assert certificate.min_eigenvalue > 0.0
    assert certificate.target_distance is not None
    assert certificate.target_distance <= 1e-8


@pytest.mark.parametrize("drape", DRAPES)
def test_contacts_are_fixed_as_pins_are(drape: DrapeMethod) -> None:
    """A cap on a ball with its contacts held, as step one of the paper has them."""
    (piece,) = split(hat_on_ball())
    assert len(piece.held) > 0
    solver = StepOne(Pulled(piece, 0.0), piece.held, drape=drape)
    shape = solver.solve(piece.target)
    assert shape.converged
    assert shape.distance <= 1e-10 * piece.h**2 * len(piece.target)
    assert np.array_equal(shape.rest[piece.held], piece.target[piece.held])
    assert np.array_equal(shape.draped.pose[piece.held], piece.target[piece.held])


def test_newton_needs_few_iterations() -> None:
    """Regression, 4 and 21 when written: the reference is BFGS."""
    piece = _piece()
    newton, bfgs = (
        step_one(Pulled(piece, 0.0), piece.target, piece.held, method=m) for m in ("newton", "bfgs")
    )
    assert newton.iterations <= 6
    assert newton.iterations < bfgs.iterations <= 40
    assert np.abs(newton.rest - bfgs.rest).max() <= 1e-3 * piece.h  # the same branch


@every
def test_distance_never_rises(method: StepOneMethod) -> None:
    steps: list[Step] = []
    piece = _piece(bend=2e-3)
    step_one(Pulled(piece, 1.0), piece.target, piece.held, method=method, report=steps.append)
    assert len(steps) >= 3
    assert {step.stage for step in steps} == {"step one"}
    assert all(after.residual < before.residual for before, after in pairwise(steps))


def test_pull_is_lowered_between_solves() -> None:
    """The outer loop of Ly 2018, Alg. 1: each answer starts the next with half the pull or less.

    The answer for one pull is one for every other whose Hessian stays positive: nothing pulls at x_t.
    """
    piece = _piece(bend=4e-3)
    solver = StepOne(Pulled(piece, 100.0), piece.held)
    rest = piece.target
    for pull in (100.0, 10.0, 1.0, 0.0):
        solver.draper.pulled = Pulled(piece, pull)
        shape = solver.solve(rest)
        assert shape.converged
        rest = shape.rest
    assert shape.distance <= 1e-10 * piece.h**2 * len(piece.target)


def test_soft_sheet_comes_nearer() -> None:
    """Far too soft for its pose: no exact answer in a few steps, but a stable one that is nearer."""
    piece = _piece(bend=3e-4)
    steps: list[Step] = []
    shape = step_one(
        Pulled(piece, 0.0),
        piece.target,
        piece.held,
        method="bfgs",
        limits=Limits(iterations=8),
        report=steps.append,
    )
    assert shape.draped.good
    assert shape.reason == "iterations"
    assert steps[-1].residual < 0.8 * steps[0].residual


def test_interrupt_keeps_the_best() -> None:
    piece = _piece()
    seen: list[Step] = []

    def interrupt(step: Step) -> None:
        seen.append(step)
        if len(seen) == 4:
            raise KeyboardInterrupt

    solver = StepOne(Pulled(piece, 0.0), piece.held, report=interrupt)
    with pytest.raises(KeyboardInterrupt):
        solver.solve(piece.target)
    assert solver.best is not None
    assert solver.best.iterations == 3
    h2 = piece.h**2 * len(piece.target)
    assert np.sqrt(2.0 * solver.best.distance / h2) == pytest.approx(seen[-1].residual)


class _Fickle(StepOne):
    """Drapes fail on the far side of a wall in the space of natural shapes."""

    wall = 0.0
    failures = 0

    def _evaluate(self, rest: FloatArray, start: FloatArray, budget: int = 200) -> object:  # type: ignore[override]
        if np.abs(rest - self.target).max() > self.wall:
            self.failures += 1
            return None
        return super()._evaluate(rest, start, budget)


def test_failed_drapes_cut_the_step() -> None:
    """The wall stands a thousandth beyond the answer, where full steps overshoot it."""
    piece = _piece()
    known = step_one(Pulled(piece, 0.0), piece.target, piece.held)
    solver = _Fickle(Pulled(piece, 0.0), piece.held, method="bfgs")
    solver.wall = 1.0001 * float(np.abs(known.rest - piece.target).max())
    shape = solver.solve(piece.target)
    assert shape.converged
    assert solver.failures > 0


def test_shape_that_does_not_drape() -> None:
    piece = _piece()
    shape = step_one(Pulled(piece, 0.0), np.full_like(piece.target, np.nan), piece.held)
    assert shape.reason == "no drape"
    assert not shape.converged
    assert shape.distance == np.inf
    assert isinstance(shape.draped, Draped)


def test_target_at_rest_needs_nothing() -> None:
    """Without weight the target is its own natural shape."""
    target = rolled(grid(3, 2, 0.05, 0.05), 0.05, 0.2)
    terms = PlainShell(target, gravity=(0.0, 0.0, 0.0)).terms()
    (piece,) = split(Problem(target, terms, pinned=range(6)))
    shape = step_one(Pulled(piece, 0.0), piece.target, piece.held)
    assert shape.iterations == 0
    assert shape.distance == 0.0
    assert np.array_equal(shape.rest, piece.target)


def test_everything_fixed_needs_nothing() -> None:
    piece = _piece()
    every_vertex = np.arange(len(piece.target))
    assert step_one(Pulled(piece, 0.0), piece.target, every_vertex).reason == "target"


def test_limits() -> None:
    """Relative limits scale with h; the paper's (Sec. 7.1) are metres and stay."""
    piece = _piece()
    limits = Limits(distance=1e-6, gradient=1e-5, step=1e-4, iterations=2).scaled(0.1, 50)
    assert (limits.distance, limits.gradient, limits.step) == pytest.approx((5e-7, 1e-6, 1e-5))
    assert PAPER.scaled(0.1, 50) == PAPER
    assert (PAPER.gradient, PAPER.step, PAPER.iterations) == (1e-15, 1e-15, 2000)
    cut = step_one(Pulled(piece, 0.0), piece.target, piece.held, limits=Limits(iterations=2))
    assert (cut.reason, cut.iterations) == ("iterations", 2)


def test_longest_step_halves_no_edge() -> None:
    points = np.array([[0.0, 0, 0], [1.0, 0, 0], [3.0, 0, 0]])
    move = np.array([[0.0, 0, 0], [4.0, 0, 0], [4.0, 2.0, 0]])
    edges = np.array([[0, 1], [1, 2]])
    assert longest_step(points, move, edges) == pytest.approx(0.5 / 4.0)
    assert longest_step(points, np.ones((3, 3)), edges) == np.inf


def test_unknown_method() -> None:
    piece = _piece()
    with pytest.raises(ValueError, match="step one must be one of auto, bfgs, l-bfgs, newton"):
        step_one(Pulled(piece, 0.0), piece.target, piece.held, method="sgd")  # type: ignore[arg-type]
