"""`casashell.solve` from end to end on small scenes of every kind."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from meshes import cap, grid, joined, renumbered, rigid_motion, rolled, rotation
from plain_shell import PlainShell

from casashell.contact.obstacles import Obstacle, Plane, Sphere
from casashell.mesh import TriMesh
from casashell.problem import Problem
from casashell.result import NotConverged, Result, Step
from casashell.solve import solve
from casashell.status import Status
from casashell.typing import FloatArray
from formulations import discrete_shell

HEAD = Sphere((0.0, 0.0, 0.05), 0.15, friction=0.5)
DOWN = (0.0, 0.0, -9.81)


def _hat(
    obstacles: tuple[Obstacle, ...] = (HEAD,), pinned: tuple[int, ...] = (), bend: float = 3e-3
) -> Problem:
    """A cap on a ball of the same pole; the brim hangs free."""
    target = cap(4, 0.2, 1.3)
    terms = PlainShell(target, bend=bend).terms()
    return Problem(target, terms, obstacles, pinned=pinned, contact_tolerance=6e-3)


def _page(gravity: tuple[float, float, float] = DOWN, bend: float = 3e-3) -> Problem:
    """A curved sheet clamped along two rows."""
    target = rolled(grid(5, 3, 0.05, 0.05), 0.05, 0.12)
    shell = PlainShell(target, bend=bend, gravity=gravity)
    return Problem(target, shell.terms(), pinned=range(8))


def _upright(pinned: list[int]) -> Problem:
    """A flat square in the plane y = 0; vertex 5 i + j sits at x = 0.1 i, z = 0.1 j."""
    flat = grid(4, 4)
    sheet = flat.moved(flat.vertices[:, [0, 2, 1]])
    return Problem(sheet, PlainShell(sheet, bend=1e-1).terms(), pinned=pinned)


def _slope(degrees: float, friction: float) -> Problem:
    angle = np.radians(degrees)
    turn = np.array(
        [[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]]
    )
    flat = grid(5, 5)
    sheet = flat.moved(flat.vertices @ turn.T)
    plane = Plane((-np.sin(angle), 0.0, np.cos(angle)), 0.0, friction=friction)
    return Problem(sheet, PlainShell(sheet).terms(), (plane,), contact_tolerance=1e-6)


def _check(result: Result) -> None:
    """Thresholds of a certified result, read from the certificate and from the forces."""
    c = result.certificate
    assert c.free_force is not None
    assert c.free_force <= 1e-9  # what is aimed for, a thousand times inside the threshold
    assert (c.cone_margin is None) == (c.min_normal_force is None) == (len(result.contacts) == 0)
    assert min(c.cone_margin or 0.0, c.min_normal_force or 0.0) >= 0.0
    assert c.min_eigenvalue is None or c.min_eigenvalue > 0.0
    assert c.target_distance == 0.0
    held = np.zeros(len(result.target.vertices), dtype=bool)
    held[result.pinned] = held[result.contacts.vertices] = True
    assert np.abs(result.forces[~held]).max(initial=0.0) <= 1e-9 * c.f0


def test_contacts_alone() -> None:
    result = solve(_hat())
    assert result.status is Status.SOLVED
    _check(result)
    assert result.certificate.cone_margin is not None
    assert result.certificate.cone_margin > 0.0  # strictly inside
    weight = -result.contact_forces.sum(axis=0)[2]
    area = result.target.moved(result.rest).face_areas.sum()
    assert -weight == pytest.approx(0.2 * area * 9.81, rel=1e-8)
    assert np.array_equal(result.pose, result.target.vertices)
    assert result.contact_tolerance == 6e-3


def test_pins_alone() -> None:
    result = solve(_page())
    assert result.status is Status.SOLVED
    _check(result)
    assert np.array_equal(result.rest[:8], result.target.vertices[:8])  # pins stay
    assert result.contact_forces.shape == (0, 3)


def test_row_of_pins_lets_a_sheet_hang() -> None:
    """Upright square held along its upper side: a pendulum, stable."""
    result = solve(_upright([4, 9, 14, 19, 24]))
    assert result.status is Status.SOLVED
    _check(result)


def test_contacts_and_pins() -> None:
    result = solve(_hat(pinned=(40, 50)))
    assert result.status is Status.SOLVED
    _check(result)
    assert result.pinned.tolist() == [40, 50]
    assert len(result.contacts) > 0
    assert np.array_equal(result.rest[[40, 50]], result.target.vertices[[40, 50]])


def test_nothing_that_holds_is_infeasible() -> None:
    result = solve(_hat(obstacles=()))
    assert result.status is Status.INFEASIBLE
    assert "nothing holds" in result.advice
    assert np.array_equal(result.rest, result.target.vertices)
    with pytest.raises(NotConverged, match="INFEASIBLE") as caught:
        result.require()
    assert caught.value.result is result


def test_without_gravity_the_target_is_its_own_natural_shape() -> None:
    result = solve(_page(gravity=(0.0, 0.0, 0.0)))
    assert result.status is Status.SOLVED
    assert result.rest == pytest.approx(result.target.vertices, abs=1e-12)
    assert result.certificate.f0 == 1.0  # no weight and no reaction: 1 N


def test_free_shell_without_gravity_is_neutral() -> None:
    problem = _page(gravity=(0.0, 0.0, 0.0))
    result = solve(Problem(problem.target, problem.energies))
    assert result.status is Status.UNSTABLE
    assert result.certificate.neutral_modes == 6
    assert "neutral" in result.advice


def test_all_vertices_pinned() -> None:
    problem = _page()
    result = solve(Problem(problem.target, problem.energies, pinned=range(24)))
    assert result.status is Status.SOLVED
    assert np.array_equal(result.rest, result.target.vertices)
    assert result.certificate.min_eigenvalue is None


def test_pins_on_a_vertical_line_leave_a_turn_about_it() -> None:
    """A stiff upright square held along its middle line balances, but nothing resists the turn."""
    result = solve(_upright([10, 12, 14]))
    assert result.status is Status.UNSTABLE
    assert result.certificate.neutral_modes == 1
    assert result.certificate.free_force is not None
    assert result.certificate.free_force <= 1e-9
    assert "neutral" in result.advice


def test_one_pin_aside_is_not_an_equilibrium() -> None:
    result = solve(_upright([4]))
    assert not result.status.certified
    assert "pin more vertices" in result.advice


def test_smooth_floor_carries_a_sheet() -> None:
    """mu = 0: reactions along the normal alone, and the certificate's cone margin is exactly 0."""
    problem = _slope(0.0, 0.0)
    result = solve(problem)
    assert result.status is Status.SOLVED
    _check(result)
    assert np.abs(result.contact_forces[:, :2]).max() == 0.0
    assert any("no friction" in note for note in result.notes)


def test_smooth_ball_under_a_hat() -> None:
    """mu = 0 on a curved contact: the reactions are radial."""
    result = solve(_hat(obstacles=(Sphere(HEAD.center, HEAD.radius, friction=0.0),)))
    assert result.status is Status.SOLVED
    _check(result)
    across = np.cross(result.contact_forces, result.contacts.normals)
    assert np.abs(across).max() <= 1e-12 * result.certificate.f0


def test_smooth_slope_is_infeasible() -> None:
    result = solve(_slope(5.0, 0.0))
    assert result.status is Status.INFEASIBLE


@pytest.mark.parametrize(("friction", "status"), [(0.5, Status.INFEASIBLE), (1.0, Status.SOLVED)])
def test_slope_of_42_degrees(friction: float, status: Status) -> None:
    """tan 42 degrees = 0.900: proved impossible at 0.5, solved at 1."""
    result = solve(_slope(42.0, friction))
    assert result.status is status
    if status is Status.SOLVED:
        _check(result)
    else:
        assert "slides" in result.advice
        assert "0.9" in result.advice


def test_two_parts_are_solved_as_if_alone() -> None:
    """A hat and a page far apart: the same shapes, forces and entries as in two separate solves.

    1e-5 edges for the hat: its contact forces are kept above a share of f0, the mean over both parts.
    """
    hat, page = _hat(), _page()
    shift = np.array([2.0, 0.0, 0.0])
    both = joined(hat.target, page.target.moved(page.target.vertices + shift))
    count = len(hat.target.vertices)
    together = solve(
        Problem(
            both,
            PlainShell(both, bend=3e-3).terms(),
            (HEAD,),
            pinned=[count + v for v in range(8)],
            contact_tolerance=6e-3,
        )
    )
    alone = solve(hat), solve(page)
    assert together.status is Status.SOLVED
    h = both.mean_edge_length
    assert np.abs(together.rest[:count] - alone[0].rest).max() <= 1e-5 * h
    assert np.abs(together.rest[count:] - shift - alone[1].rest).max() <= 1e-8 * h
    difference = np.abs(together.contact_forces - alone[0].contact_forces)
    assert difference.max() <= 0.01 * together.certificate.f0
    lowest = min(one.certificate.min_eigenvalue or np.inf for one in alone)
    assert together.certificate.min_eigenvalue == pytest.approx(lowest, rel=1e-4)


def test_contact_forces_of_every_part_are_in_their_place() -> None:
    """Two hats of different weight on two balls, the ball of the second hat listed first."""
    hat = cap(4, 0.2, 1.3)
    shift = np.array([2.0, 0.0, 0.0])
    both = joined(hat, hat.moved(hat.vertices + shift))
    heavy = np.arange(len(both.faces)) >= len(hat.faces)
    terms = discrete_shell(
        both, density=np.where(heavy, 0.3, 0.2), stretch=20.0, bend=3e-3, gravity=DOWN
    )
    balls = (Sphere((2.0, 0.0, 0.05), 0.15), Sphere((0.0, 0.0, 0.05), 0.15))
    result = solve(Problem(both, terms, balls, contact_tolerance=6e-3))
    assert result.status is Status.SOLVED
    _check(result)
    assert result.contacts.obstacle.tolist() == [0] * 7 + [1] * 7
    areas = both.moved(result.rest).face_areas
    for first, faces, rho in ((0, heavy, 0.3), (7, ~heavy, 0.2)):
        carried = result.contact_forces[first : first + 7, 2].sum()
        assert carried == pytest.approx(rho * areas[faces].sum() * 9.81, rel=1e-7)


def test_part_that_fails_is_named() -> None:
    page = _page()
    other = page.target.moved(page.target.vertices + np.array([2.0, 0.0, 0.0]))
    both = joined(page.target, other)
    result = solve(Problem(both, PlainShell(both, bend=3e-3).terms(), pinned=range(8)))
    assert result.status is Status.INFEASIBLE
    assert "part with vertex 24" in result.advice
    wanted = solve(page).rest
    assert np.abs(result.rest[:24] - wanted).max() <= 1e-9  # the sound part is solved nevertheless


def _moved_hat(seed: int) -> Problem:
    """The hat, its head and gravity, all turned and moved."""
    target = cap(4, 0.2, 1.3)
    moved = target.moved(rigid_motion(target.vertices, seed))
    centre = rigid_motion(np.array([HEAD.center]), seed)[0]
    gravity = tuple(rotation(seed) @ np.array(DOWN))
    shell = PlainShell(moved, bend=3e-3, gravity=gravity)
    head = Sphere(tuple(centre), HEAD.radius, friction=0.5)
    return Problem(moved, shell.terms(), (head,), contact_tolerance=6e-3)


def test_moved_scene_with_pins_has_the_moved_shape() -> None:
    """1e-9 of the size: Newton converges to rounding and nothing else has a direction in it."""
    page = _page()
    gravity = tuple(rotation(3) @ np.array(DOWN))
    moved = page.target.moved(rigid_motion(page.target.vertices, 3))
    shell = PlainShell(moved, bend=3e-3, gravity=gravity)
    found = solve(Problem(moved, shell.terms(), pinned=range(8)))
    wanted = rigid_motion(solve(page).rest, 3)
    assert found.status is Status.SOLVED
    assert np.abs(found.rest - wanted).max() <= 1e-9 * page.target.bbox_diagonal


@pytest.mark.parametrize("seed", [1, 4])
def test_moved_scene_with_contacts_has_the_moved_shape(seed: int) -> None:
    """Also the contact forces: their choice has no preferred axes either."""
    still, moved = solve(_hat()), solve(_moved_hat(seed))
    assert moved.status is Status.SOLVED
    size = still.target.bbox_diagonal
    assert np.abs(moved.rest - rigid_motion(still.rest, seed)).max() <= 1e-9 * size
    turned = still.contact_forces @ rotation(seed).T
    assert np.abs(moved.contact_forces - turned).max() <= 1e-9 * still.certificate.f0


def test_vertex_order_does_not_matter() -> None:
    """For a pinned page and for a hat in contact."""
    for problem in (_page(), _hat()):
        still = solve(problem)
        count = len(still.rest)
        order = np.random.default_rng(5).permutation(count)
        shuffled = renumbered(problem.target, order)
        shell = PlainShell(shuffled, bend=3e-3)
        found = solve(
            Problem(
                shuffled,
                shell.terms(),
                problem.obstacles,
                pinned=order[np.asarray(problem.pinned)],
                contact_tolerance=problem.contact_tolerance,
            )
        )
        assert found.status is Status.SOLVED
        assert sorted(found.contacts.vertices) == sorted(order[still.contacts.vertices])
        assert np.abs(found.rest[order] - still.rest).max() <= 1e-9 * problem.target.bbox_diagonal


@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_units_of_force_do_not_matter(factor: float) -> None:
    """All of density and both stiffnesses times a factor: same shape, forces times the factor."""
    page = _page()
    shell = PlainShell(page.target, 0.2 * factor, 20.0 * factor, 3e-3 * factor)
    found, wanted = solve(Problem(page.target, shell.terms(), pinned=range(8))), solve(page)
    assert found.status is Status.SOLVED
    assert np.abs(found.rest - wanted.rest).max() <= 1e-9
    assert found.forces == pytest.approx(factor * wanted.forces, rel=1e-6, abs=1e-9 * factor)


def test_material_too_soft_is_said_to_be() -> None:
    result = solve(_page(bend=1e-6))
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

    result = solve(_hat(), callback=stop)
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
        solve(_page(), callback=fail)


def test_history_and_counts() -> None:
    result = solve(_hat())
    newton = [step for step in result.history if step.stage == "newton"]
    assert result.iterations == len(newton)
    assert 0 < result.factorizations <= result.iterations
    times = [step.seconds for step in result.history]
    assert times == sorted(times)
    assert times[-1] <= result.seconds
    assert min(step.residual for step in newton) <= 1e-9
    assert {"contacts", "solve", "certificate"} <= set(result.timings)


def test_same_problem_same_result() -> None:
    one, other = solve(_hat()), solve(_hat())
    assert np.array_equal(one.rest, other.rest)
    assert np.array_equal(one.contact_forces, other.contact_forces)
    assert one.certificate == other.certificate


def test_interpreted_kernels_give_the_same_shape() -> None:
    one, other = solve(_page()), solve(_page(), interpreted=True)
    assert other.status is Status.SOLVED
    assert np.abs(one.rest - other.rest).max() <= 1e-10
    assert not any("compiler" in note for note in other.notes)  # asked for, nothing to report


def test_unknown_method() -> None:
    with pytest.raises(ValueError, match=r"method must be one of auto, .*got 'magic'"):
        solve(_page(), method="magic")


def test_input_is_left_alone() -> None:
    problem = _hat()
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
    assert float(height) == pytest.approx(solve(_page()).rest[-1, 2], abs=1e-10)


def test_mesh_with_two_orientations_of_the_same_surface() -> None:
    """Turning all faces over changes no energy and therefore no natural shape."""
    page = _page()
    over = TriMesh(page.target.vertices, page.target.faces[:, ::-1])
    found = solve(Problem(over, PlainShell(over, bend=3e-3).terms(), pinned=range(8)))
    assert found.status is Status.SOLVED
    assert np.abs(found.rest - solve(page).rest).max() <= 1e-10
