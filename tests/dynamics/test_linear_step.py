"""The linear algebra of a step: changed rows behind one factor, and factors without pivoting."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from meshes import grid
from posed import sheet

from casashell.contact.obstacles import Plane
from casashell.dynamics import linear
from casashell.dynamics.patch import Patch
from casashell.dynamics.simulate import simulate
from casashell.engine.sparse_solver import SingularMatrix, make_solver
from casashell.typing import FloatArray


def _spd(count: int, seed: int) -> sp.csr_array:
    """A sparse matrix (3 count, 3 count) with 3x3 blocks, symmetric and positive definite."""
    rng = np.random.default_rng(seed)
    near = sp.random_array((count, count), density=4.0 / count, rng=rng)
    near = (near + near.T + sp.eye_array(count)).tocsr()
    full = sp.csr_array(sp.kron(near, np.ones((3, 3))))
    full.data = rng.normal(size=full.nnz)
    full = full + full.T
    return sp.csr_array(full + sp.diags_array(np.abs(full).sum(axis=1) + 1.0))


def _changed(
    matrix: sp.csr_array, ids: list[int], by_force: FloatArray, by_motion: FloatArray
) -> FloatArray:
    dense = matrix.toarray()
    made = dense.copy()
    for vertex, force, motion in zip(ids, by_force, by_motion):
        rows = slice(3 * vertex, 3 * vertex + 3)
        made[rows] += force @ dense[rows]
        made[rows, rows] += motion
    return made


def test_rows_changed_twice_behind_one_factor() -> None:
    """Woodbury's formula against a dense solution; the second change replaces the first."""
    rng = np.random.default_rng(3)
    matrix = _spd(30, 1)
    factor = make_solver(matrix.indptr, matrix.indices, "general")
    factor.factor(matrix.data)
    asked: list[int] = []

    def solve(right: FloatArray) -> FloatArray:
        asked.append(1 if right.ndim == 1 else right.shape[1])
        return factor.solve(right)

    patch = Patch(matrix, solve)
    right = rng.normal(size=90)
    for ids in ([4, 9, 20], [9, 20, 2]):
        by_force = 0.3 * rng.normal(size=(3, 3, 3))
        by_motion = rng.normal(size=(3, 3, 3))
        patch.change(np.array(ids), by_force, by_motion)
        exact = np.linalg.solve(_changed(matrix, ids, by_force, by_motion), right)
        assert patch.solve(right) == pytest.approx(exact, abs=1e-12)
    # Nine columns for the first change, three for the one vertex that is new in the second.
    assert asked == [9, 1, 3, 1]


def test_no_change_is_the_factor_itself() -> None:
    """An empty set of changed rows is allowed."""
    matrix = _spd(10, 2)
    factor = make_solver(matrix.indptr, matrix.indices, "general")
    factor.factor(matrix.data)
    patch = Patch(matrix, factor.solve)
    patch.change(np.zeros(0, dtype=np.int64), np.zeros((0, 3, 3)), np.zeros((0, 3, 3)))
    right = np.arange(30.0)
    assert np.array_equal(patch.solve(right), factor.solve(right))


@pytest.mark.parametrize("backend", ["mumps", "superlu"])
def test_unpivoted_factor_solves_dominant_matrices(backend: str) -> None:
    """Pivots from the diagonal are enough where it dominates."""
    matrix = _spd(40, 5)
    matrix.data[matrix.indptr[7] : matrix.indptr[8]] *= 3.0  # no longer symmetric
    solver = make_solver(matrix.indptr, matrix.indices, "unpivoted", backend)
    solver.factor(matrix.data)
    right = np.linspace(-1.0, 1.0, 120)
    assert matrix @ solver.solve(right) == pytest.approx(right, abs=1e-12)
    assert solver.negative_eigenvalues is None


def test_pivots_from_anywhere_give_the_same_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no solution without pivoting is good enough, each factor is made once more."""
    result = sheet(grid(4, 3, 0.05, 0.05), (Plane((0.3, 0.0, 1.0), 0.0, friction=0.2),))
    usual = simulate(result, 0.1)
    monkeypatch.setattr(linear, "_POOR", -1.0)
    pivoted = simulate(result, 0.1)
    assert usual.contact.any()
    assert pivoted.factorizations > usual.factorizations
    assert pivoted.positions == pytest.approx(usual.positions, abs=1e-10)


def test_a_zero_on_the_diagonal_calls_for_pivots() -> None:
    """Without pivoting the matrix cannot be factored, or not well; with it, it can."""
    swap = np.kron(np.array([[0.0, 1.0], [1.0, 0.0]]), np.eye(3))
    matrix = sp.csr_array(swap + 0.0)
    dense = sp.csr_array(np.ones((6, 6)))
    solver = make_solver(dense.indptr, dense.indices, "unpivoted", "mumps")
    with pytest.raises(SingularMatrix):
        solver.factor(matrix.toarray().ravel())
    general = make_solver(dense.indptr, dense.indices, "general")
    general.factor(matrix.toarray().ravel())
    assert general.solve(np.arange(6.0)) == pytest.approx(matrix.T @ np.arange(6.0))
