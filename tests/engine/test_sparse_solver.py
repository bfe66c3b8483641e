"""Every linear solver on the same matrices."""

from __future__ import annotations

import gc
import importlib.util
from collections.abc import Callable

import numpy as np
import pytest
import scipy.sparse as sp

from casashell.engine.sparse_solver import SingularMatrix, SparseSolver, Symmetry, make_solver
from casashell.typing import FloatArray, IntArray

BACKENDS = ["mumps", "superlu"]
if importlib.util.find_spec("pypardiso") is not None:
    BACKENDS.append("pardiso")
N = 40
Pattern = tuple[IntArray, IntArray]


def _general(seed: int = 0) -> sp.csr_array:
    """Unsymmetric values on a symmetric pattern with a full diagonal, as the solvers get it."""
    rng = np.random.default_rng(seed)
    places = sp.random_array((N, N), density=0.1, rng=np.random.default_rng(9))
    pattern = sp.csr_array(places + places.T + sp.eye_array(N))
    pattern.sort_indices()
    pattern.data = rng.standard_normal(pattern.nnz)
    return pattern


def _indefinite(seed: int = 0) -> sp.csr_array:
    """Symmetric, indefinite."""
    half = _general(seed)
    matrix = sp.csr_array(half + half.T)
    matrix.sort_indices()
    return matrix


def _saddle() -> sp.csr_array:
    """[[A, B], [B^T, 0]] with a zero block on the diagonal, which needs pivoting: inertia (5, 2)."""
    rng = np.random.default_rng(2)
    border = rng.standard_normal((5, 2))
    dense = np.block([[np.diag(np.arange(1.0, 6.0)), border], [border.T, np.zeros((2, 2))]])
    full = sp.coo_array(np.ones((7, 7)))
    rows, columns = full.coords
    return sp.csr_array((dense[rows, columns], (rows, columns)), shape=(7, 7))


def _solver(matrix: sp.csr_array, symmetry: Symmetry, backend: str) -> SparseSolver:
    solver = make_solver(matrix.indptr, matrix.indices, symmetry, backend)
    assert solver.name == backend
    return solver


@pytest.fixture(params=BACKENDS)
def backend(request: pytest.FixtureRequest) -> str:
    return str(request.param)


MATRICES: list[tuple[Callable[[], sp.csr_array], Symmetry]] = [
    (_general, "general"),
    (_indefinite, "symmetric"),
    (_indefinite, "general"),
    (_saddle, "symmetric"),
    (_saddle, "general"),
]


@pytest.mark.parametrize(("make", "symmetry"), MATRICES)
def test_solution_satisfies_the_equations(
    backend: str, make: Callable[[], sp.csr_array], symmetry: Symmetry
) -> None:
    matrix = make()
    x = np.random.default_rng(1).standard_normal(matrix.shape[0])
    solver = _solver(matrix, symmetry, backend)
    solver.factor(matrix.data)
    assert solver.solve(matrix @ x) == pytest.approx(x, rel=1e-9, abs=1e-10)


def test_several_right_hand_sides(backend: str) -> None:
    matrix = _general()
    for order in ("C", "F"):
        x = np.array(np.random.default_rng(1).standard_normal((N, 3)), order=order)
        rhs = np.array(matrix @ x, order=order)
        kept = rhs.copy()
        solver = _solver(matrix, "general", backend)
        solver.factor(matrix.data)
        assert solver.solve(rhs) == pytest.approx(x, rel=1e-9, abs=1e-10)
        assert np.array_equal(rhs, kept)  # the caller's array is not the work space


@pytest.mark.parametrize("symmetry", ["general", "symmetric"])
def test_new_values_in_the_same_pattern(backend: str, symmetry: Symmetry) -> None:
    make = _general if symmetry == "general" else _indefinite
    solver = _solver(make(), symmetry, backend)
    for seed in range(4):
        matrix = make(seed)
        x = np.random.default_rng(seed).standard_normal(N)
        solver.factor(matrix.data)
        assert solver.solve(matrix @ x) == pytest.approx(x, rel=1e-8, abs=1e-9)


@pytest.mark.parametrize("make", [_indefinite, _saddle])
def test_inertia_counts_negative_eigenvalues(
    backend: str, make: Callable[[], sp.csr_array]
) -> None:
    matrix = make()
    solver = _solver(matrix, "symmetric", backend)
    solver.factor(matrix.data)
    negative = int(np.sum(np.linalg.eigvalsh(matrix.toarray()) < 0.0))
    assert 0 < negative < matrix.shape[0]
    # SuperLU knows it only when it exchanged no rows; what it says then is right.
    assert solver.negative_eigenvalues in (
        (negative, None) if backend == "superlu" else (negative,)
    )
    general = _solver(matrix, "general", backend)
    general.factor(matrix.data)
    assert general.negative_eigenvalues is None


@pytest.mark.parametrize("symmetry", ["general", "symmetric"])
@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_numbers_that_are_not_finite_are_refused(
    backend: str, symmetry: Symmetry, wrong: float
) -> None:
    """And the object still works afterwards."""
    matrix = _indefinite()
    solver = _solver(matrix, symmetry, backend)
    data = matrix.data.copy()
    data[0] = wrong
    with pytest.raises(SingularMatrix, match="not finite"):
        solver.factor(data)
    solver.factor(matrix.data)
    x = np.ones(N)
    assert solver.solve(matrix @ x) == pytest.approx(x, rel=1e-9)


@pytest.mark.parametrize("symmetry", ["general", "symmetric"])
@pytest.mark.parametrize("name", ["mumps", "superlu"])
def test_singular_matrices_are_refused(name: str, symmetry: Symmetry) -> None:
    """A zero row and column; Pardiso perturbs small pivots instead, which its users have to know."""
    matrix = _indefinite().toarray()
    matrix[3, :] = matrix[:, 3] = 0.0
    pattern = _indefinite()
    rows = np.repeat(np.arange(N), np.diff(pattern.indptr))
    solver = _solver(pattern, symmetry, name)
    with pytest.raises(SingularMatrix):
        solver.factor(matrix[rows, pattern.indices])
    solver.factor(pattern.data)
    assert np.all(np.isfinite(solver.solve(np.ones(N))))


def test_solvers_side_by_side_and_one_after_another(backend: str) -> None:
    """Factors belong to their object: a second one neither disturbs nor outlives the first."""
    one, other = _general(1), _general(2)
    x = np.ones(N)
    first, second = _solver(one, "general", backend), _solver(other, "general", backend)
    first.factor(one.data)
    second.factor(other.data)
    assert first.solve(one @ x) == pytest.approx(x, rel=1e-8)
    del first
    gc.collect()
    assert second.solve(other @ x) == pytest.approx(x, rel=1e-8)
    for seed in range(6):
        matrix = _general(seed)
        again = _solver(matrix, "general", backend)
        again.factor(matrix.data)
        assert again.solve(matrix @ x) == pytest.approx(x, rel=1e-7)
        del again
    gc.collect()


def test_badly_scaled_system(backend: str) -> None:
    """Bordered systems of the load path mix N/m and metres: rows scaled by up to 1e8."""
    matrix = _general()
    rows = np.repeat(np.arange(N), np.diff(matrix.indptr))
    matrix.data = matrix.data * (10.0 ** np.random.default_rng(3).uniform(-4, 4, N))[rows]
    solver = _solver(matrix, "general", backend)
    solver.factor(matrix.data)
    x = np.ones(N)
    assert solver.solve(matrix @ x) == pytest.approx(x, rel=1e-6)


def test_choice_of_solver(monkeypatch: pytest.MonkeyPatch) -> None:
    matrix = _general()
    monkeypatch.delenv("CASASHELL_LINEAR_SOLVER", raising=False)
    assert make_solver(matrix.indptr, matrix.indices, "general").name == "mumps"
    monkeypatch.setenv("CASASHELL_LINEAR_SOLVER", "superlu")
    assert make_solver(matrix.indptr, matrix.indices, "general").name == "superlu"
    assert make_solver(matrix.indptr, matrix.indices, "general", "mumps").name == "mumps"
    with pytest.raises(ValueError, match=r"one of mumps, pardiso, superlu; got 'umfpack'"):
        make_solver(matrix.indptr, matrix.indices, "general", "umfpack")


def test_without_mumps_library_superlu_serves(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing() -> None:
        raise OSError("no library")

    monkeypatch.delenv("CASASHELL_LINEAR_SOLVER", raising=False)
    monkeypatch.setattr("casashell.engine.mumps._open", missing)
    matrix = _general()
    assert make_solver(matrix.indptr, matrix.indices, "general").name == "superlu"


def test_large_values_survive_many_factors() -> None:
    """A path refactors one object some hundred times."""
    matrix: sp.csr_array = _general()
    solver = make_solver(matrix.indptr, matrix.indices, "general", "mumps")
    x: FloatArray = np.ones(N)
    for scale in np.logspace(-8, 8, 100):
        solver.factor(scale * matrix.data)
        assert solver.solve(scale * (matrix @ x)) == pytest.approx(x, rel=1e-8)
