"""Gradient of the distance to the target: differences of drapes, dense formulas, filtered vertices."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from meshes import grid, jittered, rolled
from plain_shell import PlainShell

from casashell.inverse.adjoint import adjoint, carried_along, distance
from casashell.inverse.drape import Draped, Draper
from casashell.inverse.piece import Piece, split
from casashell.inverse.pulled import Pulled
from casashell.problem import Problem
from casashell.typing import FloatArray

pulls = pytest.mark.parametrize("pull", [0.0, 2.0])


def _sheet() -> tuple[Piece, FloatArray]:
    """A curved sheet held along two rows, and a natural shape that is not at rest in it."""
    target = rolled(grid(4, 3, 0.05, 0.05), 0.05, 0.15)
    (piece,) = split(Problem(target, PlainShell(target, bend=5e-3).terms(), pinned=range(8)))
    rest = piece.target + jittered(target, 2e-3, 4).vertices - target.vertices
    rest[:8] = piece.target[:8]
    return piece, rest


def _move(piece: Piece) -> FloatArray:
    move = piece.h * np.random.default_rng(5).standard_normal(piece.target.shape)
    move[:8] = 0.0
    return move


@pulls
def test_slope_converges_with_order_two(pull: float) -> None:
    """Central differences of drapes against the gradient: a third of the step, a ninth of the error."""
    piece, rest = _sheet()
    draper = Draper(Pulled(piece, pull), piece.held)
    draped = draper.drape(rest, piece.target, tolerance=1e-12)
    move = _move(piece)
    slope = float(np.vdot(adjoint(draper, rest, draped).gradient, move))

    def drape_at(t: float) -> float:
        found = draper.drape(rest + t * move, draped.pose, tolerance=1e-12)
        assert found.good
        return distance(draper, found.pose)

    errors = [
        abs((drape_at(t) - drape_at(-t)) / (2.0 * t) / slope - 1.0) for t in (9e-3, 3e-3, 1e-3)
    ]
    for wide, narrow in pairwise(errors):
        assert wide / narrow == pytest.approx(9.0, rel=0.2)
    assert errors[-1] <= 1e-4


@pulls
def test_dense_formulas(pull: float) -> None:
    """H p = Φ - x_t and dJ/dr = -M^T p on the free rows and columns (Ly 2018, Eq. 32)."""
    piece, rest = _sheet()
    pulled = Pulled(piece, pull)
    draper = Draper(pulled, piece.held)
    draped = draper.drape(rest, piece.target)
    found = adjoint(draper, rest, draped)
    matrix = piece.assembly.pattern.matrix
    free = np.arange(24, piece.target.size)
    pick = np.ix_(free, free)
    stiffness = matrix(pulled.hessian(draped.pose, rest)[1]).toarray()[pick]
    mixed = matrix(pulled.mixed(draped.pose, rest)[1]).toarray()[pick]
    away = (draped.pose - piece.target).ravel()[free]
    state = np.linalg.solve(stiffness, away)
    known = -mixed.T @ state
    assert found.distance == pytest.approx(0.5 * away @ away, rel=1e-12)
    assert np.allclose(found.state.ravel()[free], state, rtol=0, atol=1e-9 * np.abs(state).max())
    assert np.allclose(found.gradient.ravel()[free], known, rtol=0, atol=1e-9 * np.abs(known).max())
    assert np.all(found.gradient[:8] == 0.0)
    assert np.all(found.state[:8] == 0.0)


def test_gradient_costs_no_factorization() -> None:
    piece, rest = _sheet()
    draper = Draper(Pulled(piece, 0.0), piece.held)
    draped = draper.drape(rest, piece.target)
    before = draper.factorizations
    first = adjoint(draper, rest, draped)
    assert draper.factorizations == before
    other = draper.drape(1.01 * rest, piece.target)  # the factor now belongs to another pose
    assert other.good
    again = adjoint(draper, rest, draped)
    assert np.allclose(again.gradient, first.gradient, rtol=0, atol=1e-12)


def test_pose_is_carried_along() -> None:
    """The first-order change of the pose leaves an error of order two."""
    piece, rest = _sheet()
    draper = Draper(Pulled(piece, 0.0), piece.held)
    draped = draper.drape(rest, piece.target, tolerance=1e-12)
    mixed = adjoint(draper, rest, draped).mixed
    move = _move(piece)
    follow = carried_along(draper, rest, draped, mixed, move)
    errors = []
    for t in (2e-3, 1e-3):
        moved = draper.drape(rest + t * move, draped.pose, tolerance=1e-12).pose
        errors.append(float(np.abs(moved - draped.pose - t * follow).max()))
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.2)


def test_no_gradient_where_there_is_no_minimum() -> None:
    piece, rest = _sheet()
    draper = Draper(Pulled(piece, 0.0), piece.held)
    nothing = Draped(piece.target, np.inf, 0, 0, stable=False, converged=False)
    with pytest.raises(ValueError, match="no local minimum"):
        adjoint(draper, rest, nothing)
    with pytest.raises(ValueError, match="no local minimum"):
        carried_along(draper, rest, nothing, np.zeros(0), rest)
