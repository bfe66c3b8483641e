"""What must not change a solve: other parts, axes, numbering, units of force, orientation."""

from __future__ import annotations

import numpy as np
import pytest
from meshes import cap, joined, renumbered, rigid_motion, rotation
from plain_shell import PlainShell
from small_scenes import DOWN, HEAD, assert_certified, clamped_page, hat_on_ball

from casashell.contact.obstacles import Sphere
from casashell.mesh import TriMesh
from casashell.problem import Problem
from casashell.solving import solve
from casashell.status import Status
from formulations import discrete_shell


def test_two_parts_are_solved_as_if_alone() -> None:
    """A hat and a page far apart: the same shapes, forces and entries as in two separate solves.

    1e-5 edges for the hat: its contact forces are kept above a share of f0, the mean over both parts.
    """
    hat, page = hat_on_ball(), clamped_page()
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
    assert_certified(result)
    assert result.contacts.obstacle.tolist() == [0] * 7 + [1] * 7
    areas = both.moved(result.rest).face_areas
    for first, faces, rho in ((0, heavy, 0.3), (7, ~heavy, 0.2)):
        carried = result.contact_forces[first : first + 7, 2].sum()
        assert carried == pytest.approx(rho * areas[faces].sum() * 9.81, rel=1e-7)


def test_part_that_fails_is_named() -> None:
    page = clamped_page()
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
    page = clamped_page()
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
    still, moved = solve(hat_on_ball()), solve(_moved_hat(seed))
    assert moved.status is Status.SOLVED
    size = still.target.bbox_diagonal
    assert np.abs(moved.rest - rigid_motion(still.rest, seed)).max() <= 1e-9 * size
    turned = still.contact_forces @ rotation(seed).T
    assert np.abs(moved.contact_forces - turned).max() <= 1e-9 * still.certificate.f0


def test_vertex_order_does_not_matter() -> None:
    """For a pinned page and for a hat in contact."""
    for problem in (clamped_page(), hat_on_ball()):
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
    page = clamped_page()
    shell = PlainShell(page.target, 0.2 * factor, 20.0 * factor, 3e-3 * factor)
    found, wanted = solve(Problem(page.target, shell.terms(), pinned=range(8))), solve(page)
    assert found.status is Status.SOLVED
    assert np.abs(found.rest - wanted.rest).max() <= 1e-9
    assert found.forces == pytest.approx(factor * wanted.forces, rel=1e-6, abs=1e-9 * factor)


def test_mesh_with_two_orientations_of_the_same_surface() -> None:
    """Turning all faces over changes no energy and therefore no natural shape."""
    page = clamped_page()
    over = TriMesh(page.target.vertices, page.target.faces[:, ::-1])
    found = solve(Problem(over, PlainShell(over, bend=3e-3).terms(), pinned=range(8)))
    assert found.status is Status.SOLVED
    assert np.abs(found.rest - solve(page).rest).max() <= 1e-10


@pytest.mark.parametrize("s", [1e-3, 1e3])
def test_size_does_not_matter(s: float) -> None:
    """Lengths times s, k_L times s^2, k_theta times s^3: every energy times s^3, the shape times s."""
    small = hat_on_ball()
    target = small.target.moved(s * small.target.vertices)
    shell = PlainShell(target, stretch=20.0 * s**2, bend=3e-3 * s**3)
    ball = Sphere((0.0, 0.0, 0.05 * s), 0.15 * s, friction=0.5)
    found = solve(Problem(target, shell.terms(), (ball,), contact_tolerance=6e-3 * s))
    assert found.status is Status.SOLVED
    assert np.abs(found.rest / s - solve(small).rest).max() <= 1e-9


@pytest.mark.parametrize("distance", [100.0, 1e4])
def test_distance_from_the_origin_costs_only_rounding(distance: float) -> None:
    near = clamped_page()
    target = near.target.moved(near.target.vertices + distance)
    shell = PlainShell(target, bend=3e-3)
    found = solve(Problem(target, shell.terms(), pinned=range(8)))
    assert found.status is Status.SOLVED
    assert np.abs(found.rest - distance - solve(near).rest).max() <= 1e-12 * distance
