"""The release test: stable poses answer in proportion and come back, unstable ones leave."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from meshes import grid, joined
from plain_shell import PlainShell
from small_scenes import clamped_page, hat_on_ball

from casashell.inverse.piece import split
from casashell.inverse.release import release
from casashell.inverse.step_two import step_two
from casashell.problem import Problem
from casashell.solving import solve
from casashell.typing import FloatArray


@pytest.mark.parametrize("scene", [clamped_page, hat_on_ball])
def test_a_stable_result_answers_in_proportion_and_comes_back(
    scene: Callable[[], Problem],
) -> None:
    problem = scene()
    result = solve(problem).require()
    args = problem, result.rest, result.pose, result.contact_forces
    one, two = release(*args, 1.001), release(*args, 1.002)
    for found in (one, two):
        assert found.stays
        assert found.back <= 1e-7 * found.h
        assert len(found.slipping) == 0
    assert two.moved / one.moved == pytest.approx(2.0, rel=0.02)


def test_the_answer_is_that_of_the_hessian() -> None:
    """Closed form for small changes: H dx = 0.0001 times the weight, pins held."""
    problem = clamped_page()
    result = solve(problem).require()
    (piece,) = split(problem)
    rest = result.rest - piece.origin
    gradient = piece.assembly.gradient(piece.target, rest, 2.0)
    load = gradient - piece.assembly.gradient(piece.target, rest, 1.0)
    matrix = piece.assembly.pattern.matrix(piece.assembly.hessian(piece.target, rest)[1]).toarray()
    free = np.flatnonzero(np.repeat(~np.isin(np.arange(len(rest)), piece.pinned), 3))
    moves = np.zeros(rest.size)
    moves[free] = np.linalg.solve(matrix[np.ix_(free, free)], -1e-4 * load.ravel()[free])
    found = release(problem, result.rest, result.pose, result.contact_forces, 1.0001)
    expected = np.linalg.norm(moves.reshape(-1, 3), axis=1).max()
    assert found.moved == pytest.approx(expected, rel=1e-2)


def _standing(bend: float) -> tuple[Problem, FloatArray]:
    """A sheet, 0.4 m high, clamped at its lower rows; a natural shape that balances it upright."""
    flat = grid(4, 4)
    sheet = flat.moved(flat.vertices[:, [0, 2, 1]])
    pinned = [5 * i + j for i in range(5) for j in (0, 1)]
    problem = Problem(sheet, PlainShell(sheet, bend=bend).terms(), pinned=pinned)
    (piece,) = split(problem)
    found = step_two(piece, piece.target, piece.target)
    assert found.converged
    return problem, found.rest + piece.origin


def test_an_upright_sheet_falls_when_it_is_soft() -> None:
    """Nothing pushes it out of its plane, but its Hessian has a negative eigenvalue."""
    none = np.zeros((0, 3))
    stiff, rest = _standing(1e-1)
    stands = release(stiff, rest, stiff.target.vertices, none)
    assert stands.stays
    assert stands.moved <= 0.01 * stands.h
    soft, rest = _standing(1e-3)
    falls = release(soft, rest, soft.target.vertices, none)
    assert falls.settled
    assert not falls.stays
    assert min(falls.moved, falls.back) > 2.0 * falls.h
    assert np.array_equal(falls.pose[list(soft.pinned)], soft.target.vertices[list(soft.pinned)])


def test_pieces_are_released_by_themselves() -> None:
    soft, second = _standing(3e-3)
    page = clamped_page()
    held = solve(page).require()
    both = joined(page.target, soft.target)
    count = len(page.target.vertices)
    terms = PlainShell(both, bend=3e-3).terms()
    pinned = [*page.pinned, *(count + v for v in soft.pinned)]
    problem = Problem(both, terms, pinned=pinned)
    shapes = np.vstack([held.rest, second])
    found = release(problem, shapes, both.vertices, np.zeros((0, 3)))
    alone = release(page, held.rest, held.pose, held.contact_forces)
    away = np.linalg.norm(found.pose - both.vertices, axis=1)
    assert away[:count].max() == pytest.approx(alone.moved, rel=1e-6)
    assert away[count:].max() == pytest.approx(found.moved, rel=1e-12)
    assert not found.stays


def test_contacts_let_go_or_slip_when_the_load_changes_much() -> None:
    """Which ones is a regression; under four times its weight the hat lifts off at the pole."""
    problem = hat_on_ball()
    result = solve(problem).require()
    args = problem, result.rest, result.pose, result.contact_forces
    light, heavy = release(*args, 0.05), release(*args, 4.0)
    assert len(light.let_go) == 0
    assert light.slipping.tolist() == [1, 2, 3, 4, 5, 6]
    assert heavy.let_go.tolist() == [0]
    (piece,) = split(problem)
    pose, rest = heavy.pose - piece.origin, result.rest - piece.origin
    forces = piece.assembly.gradient(pose, rest, 4.0) / piece.f0
    at = problem.contacts.vertices
    assert np.abs(forces[at[0]]).max() <= 1e-8
    assert (forces[at] * problem.contacts.normals).sum(axis=1).min() > -1e-8
    assert np.linalg.norm(heavy.pose[at[0]] - result.pose[at[0]]) > 1e-6 * heavy.h
    assert heavy.depth <= 1e-12


def test_wrong_input() -> None:
    problem = clamped_page()
    points, none = problem.target.vertices, np.zeros((0, 3))
    for rest, pose, forces, factor, words in (
        (points[1:], points, none, 1.01, "rest"),
        (points, points * np.nan, none, 1.01, "pose"),
        (points, points, np.zeros((2, 3)), 1.01, "contact_forces"),
        (points, points, none, 0.0, "gravity_factor"),
    ):
        with pytest.raises(ValueError, match=words):
            release(problem, rest, pose, forces, factor)
