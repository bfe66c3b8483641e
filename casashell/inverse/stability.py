"""Lowest eigenvalues of the Hessian of a pose, on the degrees of freedom that are free to move."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from casashell.engine.sparse_solver import SingularMatrix, make_solver
from casashell.inverse.piece import Piece
from casashell.typing import BoolArray, FloatArray, IntArray

#: Eigenvalue times h / f0 below which a motion counts as neutral: f0 would move it by 1e7 edges.
NEUTRAL = 1e-7


def free_dofs(piece: Piece, active: BoolArray) -> IntArray:
    """Degrees of freedom left by pins and by the contacts that push (``active`` (C,))."""
    mask = np.ones(len(piece.target), dtype=bool)
    mask[piece.pinned] = False
    mask[piece.contacts.vertices[active]] = False
    return np.flatnonzero(np.repeat(mask, 3))


def lowest_modes(
    piece: Piece,
    rest: FloatArray,
    active: BoolArray,
    count: int,
    pose: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Lowest eigenvalues (count,) [N/m] and unit eigenvectors (3n, count) of the free Hessian.

    pose  (n,3) m, the target by default
    """
    dofs = free_dofs(piece, active)
    _, entries = piece.assembly.hessian(piece.target if pose is None else pose, rest)
    full = piece.assembly.pattern.matrix(entries)
    matrix = sp.csr_array(full[dofs][:, dofs])
    values, vectors = lowest_eigenpairs(matrix, count)
    modes = np.zeros((piece.target.size, len(values)))
    modes[dofs] = vectors
    return values, modes


def lowest_eigenpairs(matrix: sp.csr_array, count: int) -> tuple[FloatArray, FloatArray]:
    """Algebraically lowest eigenpairs of a symmetric matrix, indefinite or not.

    Shift-and-invert Lanczos just below the spectrum: the shift is lowered until the inertia says that
    nothing lies beneath it (Gershgorin's discs say so last), so that "nearest" means "lowest".
    """
    import scipy.sparse.linalg as spla

    size = matrix.shape[0]
    if size == 0:
        return np.array([np.inf]), np.zeros((0, 1))
    if size <= max(3 * count, 60):
        values, vectors = np.linalg.eigh(matrix.toarray())
        return values[:count], vectors[:, :count]
    diagonal = matrix.diagonal()
    solver = make_solver(matrix.indptr, matrix.indices, "symmetric")
    rows = np.repeat(np.arange(size), np.diff(matrix.indptr))
    at = np.flatnonzero(rows == matrix.indices)
    scale = float(np.abs(diagonal).mean())
    if scale == 0.0:
        return np.zeros(count), np.eye(size, count)
    lowest_disc = float((2.0 * diagonal - np.asarray(abs(matrix).sum(axis=1)).ravel()).min())
    for shift in (*(-1e-7 * scale * 4.0**k for k in range(16)), min(lowest_disc, 0.0) - scale):
        data = matrix.data.copy()
        data[at] -= shift
        try:
            solver.factor(data)
        except SingularMatrix:
            continue
        if solver.negative_eigenvalues == 0:
            break
    operator = spla.LinearOperator((size, size), matvec=solver.solve, dtype=np.float64)
    start = np.random.default_rng(0).standard_normal(size)
    try:
        values, vectors = spla.eigsh(
            matrix, k=count, sigma=shift, which="LM", OPinv=operator, v0=start, tol=1e-6
        )
    except spla.ArpackNoConvergence as error:
        values, vectors = error.eigenvalues, error.eigenvectors
        if len(values) == 0:
            return np.array([-np.inf]), start[:, None] / np.linalg.norm(start)
    order = np.argsort(values)
    return values[order], vectors[:, order]
