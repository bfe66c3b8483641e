"""`casashell.solve` from end to end on small scenes of every kind."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from small_scenes import (
    HEAD,
    assert_certified,
    clamped_page,
    hat_on_ball,
    sheet_on_slope,
    upright_sheet,
)

from casashell.contact.obstacles import Sphere
from casashell.problem import Problem
from casashell.result import NotConverged, Step
from casashell.solving import solve
from casashell.status import Status
from casashell.typing import FloatArray


def test_contacts_alone() -> None:
    result = solve(hat_on_ball())
    assert result.status is Status.SOLVED
    assert_certified(result)
    assert result.certificate.cone_margin is not None
    assert result.certificate.cone_margin > 0.0  # strictly inside
    weight = -result.contact_forces.sum(axis=0)[2]
    area = result.target.moved(result.rest).face_areas.sum()
    assert -weight == pytest.approx(0.2 * area * 9.81, rel=1e-8)
    assert np.array_equal(result.pose, result.target.vertices)
    assert result.contact_tolerance == 6e-3


def test_pins_alone() -> None:
    result = solve(clamped_page())
    assert result.status is Status.SOLVED
    assert_certified(result)
    assert np.array_equal(result.rest[:8], result.target.vertices[:8])  # pins stay
    assert result.contact_forces.shape == (0, 3)


def test_row_of_pins_lets_a_sheet_hang() -> None:
    """Upright square held along its upper side: a pendulum, stable."""
    result = solve(upright_sheet([4, 9, 14, 19, 24]))
    assert result.status is Status.SOLVED
    assert_certified(result)


def test_contacts_and_pins() -> None:
    result = solve(hat_on_ball(pinned=(40, 50)))
    assert result.status is Status.SOLVED
    assert_certified(result)
    assert result.pinned.tolist() == [40, 50]
    assert len(result.contacts) > 0
    assert np.array_equal(result.rest[[40, 50]], result.target.vertices[[40, 50]])


def test_nothing_that_holds_is_infeasible() -> None:
    result = solve(hat_on_ball(obstacles=()))
    assert result.status is Status.INFEASIBLE
    assert "nothing holds" in result.advice
    assert np.array_equal(result.rest, result.target.vertices)
    with pytest.raises(NotConverged, match="INFEASIBLE") as caught:
        result.require()
    assert caught.value.result is result


def test_without_gravity_the_target_is_its_own_natural_shape() -> None:
    result = solve(clamped_page(gravity=(0.0, 0.0, 0.0)))
    assert result.status is Status.SOLVED
    assert result.rest == pytest.approx(result.target.vertices, abs=1e-12)
    assert result.certificate.f0 == 1.0  # no weight and no reaction: 1 N


def test_free_shell_without_gravity_is_neutral() -> None:
    problem = clamped_page(gravity=(0.0, 0.0, 0.0))
    result = solve(Problem(problem.target, problem.energies))
    assert result.status is Status.UNSTABLE
    assert result.certificate.neutral_modes == 6
    assert "neutral" in result.advice


def test_all_vertices_pinned() -> None:
    problem = clamped_page()
    result = solve(Problem(problem.target, problem.energies, pinned=range(24)))
    assert result.status is Status.SOLVED
    assert np.array_equal(result.rest, result.target.vertices)
    assert result.certificate.min_eigenvalue is None


def test_pins_on_a_vertical_line_leave_a_turn_about_it() -> None:
    """A stiff upright square held along its middle line balances, but nothing resists the turn."""
    result = solve(upright_sheet([10, 12, 14]))
    assert result.status is Status.UNSTABLE
    assert result.certificate.neutral_modes == 1
    assert result.certificate.free_force is not None
    assert result.certificate.free_force <= 1e-9
    assert "neutral" in result.advice


def test_one_pin_aside_is_not_an_equilibrium() -> None:
    result = solve(upright_sheet([4]))
    assert not result.status.certified
    assert "pin more vertices" in result.advice


def test_smooth_floor_carries_a_sheet() -> None:
    """mu = 0: reactions along the normal alone, and the certificate's cone margin is exactly 0."""
    problem = sheet_on_slope(0.0, 0.0)
    result = solve(problem)
    assert result.status is Status.SOLVED
    assert_certified(result)
    assert np.abs(result.contact_forces[:, :2]).max() == 0.0
    assert any("no friction" in note for note in result.notes)


def test_smooth_ball_under_a_hat() -> None:
    """mu = 0 on a curved contact: the reactions are radial."""
    result = solve(hat_on_ball(obstacles=(Sphere(HEAD.center, HEAD.radius, friction=0.0),)))
    assert result.status is Status.SOLVED
    assert_certified(result)
    across = np.cross(result.contact_forces, result.contacts.normals)
    assert np.abs(across).max() <= 1e-12 * result.certificate.f0


def test_smooth_slope_is_infeasible() -> None:
    result = solve(sheet_on_slope(5.0, 0.0))
    assert result.status is Status.INFEASIBLE


@pytest.mark.parametrize(("friction", "status"), [(0.5, Status.INFEASIBLE), (1.0, Status.SOLVED)])
def test_slope_of_42_degrees(friction: float, status: Status) -> None:
    """tan 42 degrees = 0.900: proved impossible at 0.5, solved at 1."""
    result = solve(sheet_on_slope(42.0, friction))
    assert result.status is status
    if status is Status.SOLVED:
        assert_certified(result)
    else:
        assert "slides" in result.advice
        assert "0.9" in result.advice


def test_material_too_soft_is_said_to_be() -> None:
    result = solve(clamped_page(bend=1e-6))
    assert result.status in (Status.TOO_SOFT, Status.UNSTABLE)
    assert "aise bend" in result.advice or "stiffness" in result.advice
    assert np.all(np.isfinite(result.rest))


@pytest.mark.parametrize("after", [1, 2, 5])
def test_interrupt_returns_what_there_is(after: int) -> None:
    seen: list[Step] = []

    def stop(step: Step) -> None:
        seen.append(step)
        if len(seen) == after:
            raise KeyboardInterrupt

    result = solve(hat_on_ball(), callback=stop)
    assert result.status is Status.INTERRUPTED
    assert result.status.exit_code == 130
    assert result.rest.shape == result.target.vertices.shape
    assert np.all(np.isfinite(result.rest))
    assert np.all(np.isfinite(result.contact_forces))
    assert list(result.history) == seen


def test_other_exceptions_of_a_callback_come_through() -> None:
    def fail(step: Step) -> None:
        raise LookupError("mine")

    with pytest.raises(LookupError, match="mine"):
        solve(clamped_page(), callback=fail)


def test_history_and_counts() -> None:
    result = solve(hat_on_ball())
    newton = [step for step in result.history if step.stage == "newton"]
    assert result.iterations == len(newton)
    assert 0 < result.factorizations <= result.iterations
    times = [step.seconds for step in result.history]
    assert times == sorted(times)
    assert times[-1] <= result.seconds
    assert min(step.residual for step in newton) <= 1e-9
    assert {"contacts", "solve", "certificate"} <= set(result.timings)


def test_same_problem_same_result() -> None:
    one, other = solve(hat_on_ball()), solve(hat_on_ball())
    assert np.array_equal(one.rest, other.rest)
    assert np.array_equal(one.contact_forces, other.contact_forces)
    assert one.certificate == other.certificate


def test_interpreted_kernels_give_the_same_shape() -> None:
    one, other = solve(clamped_page()), solve(clamped_page(), interpreted=True)
    assert other.status is Status.SOLVED
    assert np.abs(one.rest - other.rest).max() <= 1e-10
    assert not any("compiler" in note for note in other.notes)  # asked for, nothing to report


def test_unknown_method() -> None:
    with pytest.raises(ValueError, match=r"method must be one of auto, .*got 'magic'"):
        solve(clamped_page(), method="magic")


def test_input_is_left_alone() -> None:
    problem = hat_on_ball()
    before: FloatArray = problem.target.vertices.copy()
    params = [term.params.copy() for term in problem.energies]
    result = solve(problem)
    assert np.array_equal(problem.target.vertices, before)
    for term, kept in zip(problem.energies, params, strict=True):
        assert np.array_equal(term.params, kept)
    assert not np.shares_memory(result.rest, problem.target.vertices)


SCRIPT = """
import numpy as np
from meshes import grid, rolled
from plain_shell import PlainShell
from casashell import Problem, solve

target = rolled(grid(5, 3, 0.05, 0.05), 0.05, 0.12)
result = solve(Problem(target, PlainShell(target, bend=3e-3).terms(), pinned=range(8)))
print(result.status, repr(float(result.rest[-1, 2])), sum("compiler" in n for n in result.notes))
"""


def test_without_a_compiler_the_solve_says_so_once(tmp_path: Path) -> None:
    here = Path(__file__).resolve().parent
    paths = os.pathsep.join([str(here.parent), str(here)])
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", SCRIPT],
        env={**os.environ, "PYTHONPATH": paths, "CASASHELL_CC": "none"},
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    status, height, notes = done.stdout.split()
    assert (status, notes) == ("SOLVED", "1")
    assert float(height) == pytest.approx(solve(clamped_page()).rest[-1, 2], abs=1e-10)
