"""Independent parts of a problem, their rigid motions and their softest modes."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from meshes import cap, grid, jittered, joined, rigid_motion, rolled
from plain_shell import PlainShell

from casashell.contact.obstacles import Plane
from casashell.inverse.piece import Piece, rigid_modes, split
from casashell.inverse.stability import lowest_eigenpairs, lowest_modes
from casashell.problem import Problem

SHEET = jittered(rolled(grid(4, 2), 0.1, 0.3), 0.003)


def _piece(problem: Problem) -> Piece:
    (only,) = split(problem)
    return only


def test_one_shell_is_one_piece_near_the_origin() -> None:
    far = SHEET.moved(SHEET.vertices + np.array([100.0, -50.0, 7.0]))
    piece = _piece(Problem(far, PlainShell(far).terms(), pinned=[3, 1]))
    assert np.abs(piece.target).max() < 1.0
    assert np.array_equal(piece.target + piece.origin, far.vertices)  # the shift is exact
    assert piece.pinned.tolist() == [1, 3]
    assert piece.h == far.mean_edge_length
    assert piece.f0 == pytest.approx(0.2 * far.face_areas.sum() * 9.81 / 15, rel=1e-12)


def test_parts_have_their_own_numbers() -> None:
    """A sheet and a cap: contacts, pins, weight and stencils of each under local ids."""
    ball = cap(2, 0.2, 0.8)
    ball = ball.moved(ball.vertices + np.array([5.0, 0.0, -0.2]))
    both = joined(SHEET, ball)
    floor = Plane((0, 0, 1), float(ball.vertices[:, 2].min()), friction=0.4)
    problem = Problem(
        both, PlainShell(both).terms(), (floor,), pinned=[2, 16], contact_tolerance=1e-4
    )
    first, second = split(problem)
    assert first.vertices.tolist() == list(range(15))
    assert second.vertices.tolist() == list(range(15, 34))
    assert first.pinned.tolist() == [2]
    assert second.pinned.tolist() == [1]
    assert len(first.contacts) == 0
    assert (second.contacts.vertices + 15).tolist() == problem.contacts.vertices.tolist()
    assert len(second.contacts) > 0
    assert second.edges.tolist() == ball.edges.tolist()
    for part, alone in ((first, SHEET), (second, ball)):
        weight = part.loads.sum(axis=0)
        assert weight == pytest.approx([0.0, 0.0, -0.2 * 9.81 * alone.face_areas.sum()], abs=1e-12)
        for term, other in zip(part.energies, PlainShell(alone).terms(), strict=True):
            assert np.array_equal(term.stencils, other.stencils)


@pytest.mark.parametrize(
    ("pinned", "count"), [([], 6), ([0], 3), ([0, 1, 2], 1), ([0, 1, 5], 0), ([0, 1], 1)]
)
def test_rigid_motions_that_pins_allow(pinned: list[int], count: int) -> None:
    """None, a point, a straight line, a triangle: 6, 3, 1, 0."""
    flat = grid(4, 2)
    modes = _piece(Problem(flat, PlainShell(flat).terms(), pinned=pinned)).rigid_modes
    assert modes.shape == (45, count)
    assert np.linalg.matrix_rank(modes) == count
    held = modes.reshape(15, 3, -1)[pinned]
    assert np.abs(held).max(initial=0.0) <= 1e-12


def test_rigid_modes_are_infinitesimal_rigid_motions() -> None:
    """Lengths change to second order: (x_i - x_j) . (v_i - v_j) = 0, for six independent motions."""
    points = rigid_motion(SHEET.vertices, 1)
    modes = rigid_modes(points)
    assert np.linalg.matrix_rank(modes) == 6
    by_vertex = modes.reshape(15, 3, 6)
    arm = points[:, None] - points[None]
    assert (
        np.abs(np.einsum("ijc,ijcd->ijd", arm, by_vertex[:, None] - by_vertex[None])).max() < 1e-14
    )


def _symmetric(size: int, seed: int) -> sp.csr_array:
    rng = np.random.default_rng(seed)
    half = sp.random_array((size, size), density=0.02, rng=rng, data_sampler=rng.standard_normal)
    return sp.csr_array(half + half.T + sp.diags_array(rng.uniform(-1.0, 8.0, size)))


@pytest.mark.parametrize("size", [1, 2, 40, 61, 250])
def test_lowest_eigenpairs_against_dense(size: int) -> None:
    """Dense branch below 60, shift-and-invert above; indefinite matrices."""
    matrix = _symmetric(size, size)
    values, vectors = lowest_eigenpairs(matrix, 3)
    wanted = np.linalg.eigvalsh(matrix.toarray())[:3]
    assert values == pytest.approx(wanted, rel=1e-6)
    for value, vector in zip(values, vectors.T, strict=True):
        assert np.linalg.norm(matrix @ vector - value * vector) <= 1e-4 * abs(wanted).max()
        assert np.linalg.norm(vector) == pytest.approx(1.0)


def test_modes_vanish_where_the_shell_is_held() -> None:
    ball = cap(4, 0.2, 1.0)
    pole = Plane((0, 0, -1), -0.199, friction=0.5)  # touches the pole from above
    problem = Problem(
        ball, PlainShell(ball).terms(), (pole,), pinned=[40, 50], contact_tolerance=1e-6
    )
    piece = _piece(problem)
    assert piece.contacts.vertices.tolist() == [0]
    for active in (True, False):
        values, modes = lowest_modes(piece, 1.01 * piece.target, np.array([active]), 2)
        fixed = [0, 40, 50] if active else [40, 50]
        assert np.all(modes.reshape(61, 3, -1)[fixed] == 0.0)
        free = np.flatnonzero(np.repeat(~np.isin(np.arange(61), fixed), 3))
        entries = piece.assembly.hessian(piece.target, 1.01 * piece.target)[1]
        dense = piece.assembly.pattern.matrix(entries).toarray()[np.ix_(free, free)]
        assert values == pytest.approx(np.linalg.eigvalsh(dense)[:2], rel=1e-5)


def test_nothing_free_has_no_softest_mode() -> None:
    piece = _piece(Problem(SHEET, PlainShell(SHEET).terms(), pinned=range(15)))
    values, _ = lowest_modes(piece, piece.target, np.zeros(0, dtype=bool), 1)
    assert values.tolist() == [np.inf]
