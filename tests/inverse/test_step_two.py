"""Step 2 of Ly 2018 both ways: admissible forces, the nearest shape, slack, limits."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from small_scenes import clamped_page, hat_on_ball, sheet_on_slope

import casashell
from casashell.app.builtin import page, skirt
from casashell.contact.cone import margin
from casashell.contact.obstacles import Sphere
from casashell.inverse.cone_residual import ConeResidual
from casashell.inverse.inverse_hessian import DenseBfgs, LimitedBfgs, QuasiNewton
from casashell.inverse.piece import Piece, split
from casashell.inverse.pulled import Pulled
from casashell.inverse.quasi_newton import descend
from casashell.inverse.step_two import Method, step_two
from casashell.problem import Problem
from casashell.result import Step
from casashell.typing import FloatArray

METHODS: tuple[Method, ...] = ("ipopt", "bfgs")
SCENES = {
    "skirt": lambda: skirt(8, 26).problem,
    "page": lambda: page(9, 11).problem,
    "hat": hat_on_ball,
    "hat without friction": lambda: hat_on_ball((Sphere((0.0, 0.0, 0.05), 0.15, friction=0.0),)),
    "pins only": clamped_page,
}


@cache
def _disturbed(name: str, amount: float = 0.02) -> tuple[Piece, FloatArray]:
    """A piece and its natural shape, deformed by slow waves of ``amount`` edge lengths."""
    problem: Problem = SCENES[name]()
    (piece,) = split(problem)
    rest = casashell.solve(problem).require().rest - piece.origin
    size = piece.target / np.ptp(piece.target, axis=0).max()
    ways = np.array([[1.0, 2, 3], [2, -1, 1], [-1, 1, 2]])
    waves = amount * piece.h * np.sin(3.0 * size @ ways.T)
    waves[piece.pinned] = 0.0
    return piece, rest + waves


@pytest.mark.parametrize("name", ["skirt", "page", "hat", "pins only"])
def test_both_methods_make_forces_admissible(name: str) -> None:
    """G <= 1e-16 f0^2; Ipopt's shape is the nearer one in the mean square, as it is asked to be."""
    piece, start = _disturbed(name)
    before = ConeResidual(piece).value(piece.assembly.gradient(piece.target, start))[0]
    assert before > 1e-2
    moved = {}
    for method in METHODS:
        found = step_two(piece, piece.target, start, method=method)
        print(
            f"{name}, {method}: G {before:.1e} -> {found.residual:.1e} f0^2, "
            f"{found.iterations} iterations, {found.seconds:.2f} s"
        )
        assert found.converged
        assert found.residual <= 1e-16
        assert found.slack == 0.0
        room = margin(found.contact_forces, piece.contacts.normals, piece.contacts.friction)
        assert room.min(initial=0.0) >= 0.0  # mu' is 2.5 % less
        gap = piece.assembly.gradient(piece.target, found.rest) - piece.spread(found.contact_forces)
        gap[piece.pinned] = 0.0
        assert np.abs(gap).max() <= 2e-8 * piece.f0  # sqrt(2 G)
        assert np.array_equal(found.rest[piece.pinned], start[piece.pinned])
        moved[method] = (found.rest - start) / piece.h
    apart = np.abs(moved["ipopt"] - moved["bfgs"]).max()
    print(f"{name}: shapes differ by {apart:.3f} edges")
    assert np.linalg.norm(moved["ipopt"]) <= np.linalg.norm(moved["bfgs"]) + 1e-9


def test_contacts_without_friction() -> None:
    """Rays instead of cones: Ipopt is as good as ever, BFGS meets a kink at every weak contact."""
    piece, start = _disturbed("hat without friction")
    found = step_two(piece, piece.target, start)
    assert found.residual <= 1e-16
    room = margin(found.contact_forces, piece.contacts.normals, piece.contacts.friction)
    assert room.min() >= -1e-12 * piece.f0
    lowered = step_two(piece, piece.target, start, method="bfgs")
    print(f"without friction: G {lowered.residual:.1e} f0^2 after {lowered.iterations} iterations")
    assert lowered.residual <= 1e-10  # regression: 2e-13
    assert lowered.converged or lowered.reason == "stuck"
    assert lowered.iterations <= 1000


@pytest.mark.parametrize("method", METHODS)
def test_at_a_pulled_pose_that_is_not_the_target(method: Method) -> None:
    """The pull counts as a force: G is that of E + pull/2 |x - target|^2."""
    piece, start = _disturbed("hat")
    pose = piece.target.copy()
    loose = np.setdiff1d(np.arange(len(pose)), piece.held)
    pose[loose] += 1e-3 * piece.h
    found = step_two(piece, pose, start, 2.0, method=method)
    assert found.residual <= 1e-16
    forces = Pulled(piece, 2.0).gradient(pose, found.rest)
    assert np.abs(forces[loose]).max() <= 2e-8 * piece.f0
    without = piece.assembly.gradient(pose, found.rest)
    assert np.abs(without[loose]).max() > 1e-3 * piece.f0


def test_plain_start_of_the_paper_is_slower() -> None:
    """Regression: 48 iterations from the Gauss-Newton matrix, some hundreds from the identity."""
    piece, start = _disturbed("page")
    scaled = step_two(piece, piece.target, start, method="bfgs")
    plain = step_two(piece, piece.target, start, method="bfgs", scaled=False)
    print(f"scaled {scaled.iterations}, plain {plain.iterations} iterations")
    assert scaled.converged
    assert plain.converged
    assert scaled.iterations < plain.iterations


def test_smooth_residual_is_slower_than_the_kinked_one() -> None:
    """What the paper reports of its two choices of h (Sec. 6.2): higher powers damp convergence."""
    piece, start = _disturbed("hat")
    kinked = step_two(piece, piece.target, start, method="bfgs", max_iterations=60)
    smooth = step_two(piece, piece.target, start, method="bfgs", kind="smooth", max_iterations=60)
    cones = ConeResidual(piece)
    forces = [piece.assembly.gradient(piece.target, s.rest) for s in (kinked, smooth)]
    assert cones.value(forces[0])[0] < cones.value(forces[1])[0]


def test_slippery_slope_has_slack() -> None:
    """sin a - 0.975 mu cos a of the weight cannot be held."""
    (piece,) = split(sheet_on_slope(20.0, 0.1))
    found = step_two(piece, piece.target, piece.target, max_iterations=60)
    expected = np.sin(np.radians(20.0)) - 0.0975 * np.cos(np.radians(20.0))
    assert not found.converged
    assert found.slack == pytest.approx(expected, rel=0.1)
    lowered = step_two(piece, piece.target, piece.target, method="bfgs", max_iterations=60)
    assert not lowered.converged
    assert lowered.reason == "iteration limit"


@pytest.mark.parametrize("method", METHODS)
def test_reports_and_interrupts(method: Method) -> None:
    piece, start = _disturbed("hat")
    steps: list[Step] = []

    def report(step: Step) -> None:
        steps.append(step)
        if len(steps) == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        step_two(piece, piece.target, start, method=method, report=report)
    assert [step.iteration for step in steps] == [0, 1, 2, 3]
    assert {step.stage for step in steps} == {method}


def test_unknown_method_is_refused() -> None:
    piece, start = _disturbed("hat")
    with pytest.raises(ValueError, match="method must be one of ipopt, bfgs"):
        step_two(piece, piece.target, start, method="newton")  # type: ignore[arg-type]


def _bowl(x: FloatArray) -> tuple[float, FloatArray]:
    """A quadratic of condition number 1e4 with its minimum 0 at (1, .., 1)."""
    weights = np.logspace(0.0, 4.0, len(x))
    return float(weights @ (x - 1.0) ** 2), 2.0 * weights * (x - 1.0)


@pytest.mark.parametrize("inverse", [DenseBfgs(12), LimitedBfgs()], ids=["dense", "limited"])
def test_descent_of_a_quadratic(inverse: QuasiNewton) -> None:
    end = descend(
        _bowl,
        np.zeros(12),
        inverse,
        goal=1e-20,
        longest=1.0,
        max_iterations=200,
        report=lambda iteration, x, value: None,
    )
    assert end.reason == "goal"
    assert np.abs(end.x - 1.0).max() <= 1e-10
    assert end.iterations <= 100


def test_dense_and_limited_memory_agree_while_nothing_is_forgotten() -> None:
    rng = np.random.default_rng(0)
    start = np.diag(np.linspace(1.0, 2.0, 6))
    dense, limited = DenseBfgs(6, start), LimitedBfgs(lambda g: start @ g)
    for _ in range(5):
        s = rng.standard_normal(6)
        y = s + 0.1 * rng.standard_normal(6)
        assert s @ y > 0.0
        dense.learn(s, y)
        limited.learn(s, y)
        g = rng.standard_normal(6)
        assert dense.times(g) == pytest.approx(limited.times(g), rel=1e-10)
        assert dense.times(y) == pytest.approx(s, rel=1e-10)  # the secant equation
