"""The pull towards the target: derivatives by differences, and what it must not change."""

from __future__ import annotations

import numpy as np
import pytest
from meshes import grid, jittered, rolled
from plain_shell import PlainShell

from casashell.inverse.piece import Piece, split
from casashell.inverse.pulled import Pulled
from casashell.problem import Problem

PULL = 3.0


def _piece() -> Piece:
    target = rolled(grid(3, 2, 0.05, 0.05), 0.05, 0.2)
    (piece,) = split(Problem(target, PlainShell(target).terms(), pinned=[0, 1, 2]))
    return piece


def test_without_pull_it_is_the_energy() -> None:
    piece = _piece()
    x, r = piece.target + 1e-3, piece.target * 1.01
    pulled = Pulled(piece, 0.0)
    assert pulled.energy(x, r) == piece.assembly.energy(x, r)
    assert np.array_equal(pulled.gradient(x, r), piece.assembly.gradient(x, r))
    assert np.array_equal(pulled.hessian(x, r)[1], piece.assembly.hessian(x, r)[1])
    assert np.array_equal(pulled.mixed(x, r)[1], piece.assembly.mixed(x, r)[1])


def test_nothing_pulls_at_the_target() -> None:
    piece = _piece()
    r = piece.target * 1.01
    assert Pulled(piece, PULL).energy(piece.target, r) == piece.assembly.energy(piece.target, r)
    force = piece.assembly.gradient(piece.target, r)
    assert np.array_equal(Pulled(piece, PULL).gradient(piece.target, r), force)


def test_derivatives_by_differences() -> None:
    """Central differences of step 1e-6 m; agreement to 1e-6 of the largest value."""
    piece = _piece()
    pulled, step = Pulled(piece, PULL), 1e-6
    mesh = grid(3, 2, 0.05, 0.05)
    x = piece.target + jittered(mesh, 2e-3, 1).vertices - mesh.vertices
    r = piece.target + jittered(mesh, 2e-3, 2).vertices - mesh.vertices
    w = np.random.default_rng(3).standard_normal(x.shape)
    gradient, entries = pulled.hessian(x, r)
    slope = (pulled.energy(x + step * w, r) - pulled.energy(x - step * w, r)) / (2.0 * step)
    assert slope == pytest.approx(float((gradient * w).sum()), rel=1e-6)
    matrix = piece.assembly.pattern.matrix
    ahead, behind = pulled.gradient(x + step * w, r), pulled.gradient(x - step * w, r)
    along = (ahead - behind).ravel() / (2.0 * step)
    assert np.abs(along - matrix(entries) @ w.ravel()).max() <= 1e-6 * np.abs(along).max()
    force, mixed = pulled.mixed(x, r)
    assert np.allclose(force, gradient, rtol=0.0, atol=1e-12 * np.abs(gradient).max())
    ahead, behind = pulled.gradient(x, r + step * w), pulled.gradient(x, r - step * w)
    along = (ahead - behind).ravel() / (2.0 * step)
    assert np.abs(along - matrix(mixed) @ w.ravel()).max() <= 1e-6 * np.abs(along).max()


def test_pull_shifts_every_eigenvalue() -> None:
    piece = _piece()
    matrix = piece.assembly.pattern.matrix
    without = matrix(Pulled(piece, 0.0).hessian(piece.target, piece.target)[1]).toarray()
    shifted = matrix(Pulled(piece, PULL).hessian(piece.target, piece.target)[1]).toarray()
    assert np.allclose(shifted - without, PULL * np.eye(len(without)), rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("pull", [-1.0, np.nan, np.inf])
def test_pull_must_be_a_stiffness(pull: float) -> None:
    with pytest.raises(ValueError, match="pull must be a stiffness"):
        Pulled(_piece(), pull)
