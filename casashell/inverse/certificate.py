"""The proof: forces and stiffness at (pose, rest), by code that shares nothing with the solver.

Energies come from their plain NumPy form and are differentiated here by complex step (gradient) and by
central differences of the complex step (Hessian); eigenvalues by SciPy.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import casadi as ca
import numpy as np
import scipy.sparse as sp

from casashell.contact.detect import Contacts
from casashell.engine.energy import Energy
from casashell.engine.sparse_solver import make_solver
from casashell.inverse.rigid import rigid_curvatures
from casashell.inverse.stability import NEUTRAL as NEUTRAL
from casashell.mesh import TriMesh
from casashell.result import Certificate
from casashell.typing import AnyArray, BoolArray, FloatArray, IntArray

#: A contact with less normal force than this share of f0 does not hold its vertex.
ACTIVE = 1e-6
#: Force [N] that is rounding in a shell without loads.
NO_FORCE = 1e-9
#: Cone margin / f0 that counts as zero.
ROUNDING = 1e-12
#: SciPy's SuperLU takes over-long above this many degrees of freedom; MUMPS serves there.
_SUPERLU_LIMIT = 12_000
_IMAGINARY = 1e-30
#: Stencils at a time: their arrays stay in the processor's cache.
_BATCH = 4096
#: Differences on the two sides of a point that differ by this factor: one of them met a jump.
_JUMP = 1e3

Plain: TypeAlias = Callable[[AnyArray], AnyArray]


def _plain(
    term: Energy, x: FloatArray, r: FloatArray, some: slice = slice(None)
) -> tuple[AnyArray, Plain | None]:
    """Positions of ``some`` stencils (3k,S), and the term's NumPy form as a function of them."""
    stencils = term.stencils[some]
    now = np.ascontiguousarray(x[stencils].reshape(-1, 3 * term.size).T)
    if term.reference is None:
        return now, None
    rest = np.ascontiguousarray(np.moveaxis(r[stencils], 0, 2))
    energy = term.reference(rest, np.ascontiguousarray(term.params[some].T))
    return now, lambda flat: energy(flat.reshape(term.size, 3, -1))


def stencil_forces(term: Energy, x: FloatArray, r: FloatArray) -> FloatArray:
    """dE/dx of every stencil (S,k,3), by complex step of the term's NumPy form."""
    shape = (len(term.stencils), term.size, 3)
    now, energy = _plain(term, x, r)
    if energy is None:
        return _interpreted(term, x, r, second=False).reshape(shape)
    made = np.empty((shape[0], len(now)))
    for i in range(len(now)):
        shifted = now.astype(np.complex128)
        shifted[i] += 1j * _IMAGINARY
        made[:, i] = energy(shifted).imag / _IMAGINARY
    return made.reshape(shape)


def stencil_stiffness(term: Energy, x: FloatArray, r: FloatArray, length: float) -> FloatArray:
    """d2E/dx2 of every stencil (S,3k,3k): complex step in one variable, differences in the other."""
    size, count = 3 * term.size, len(term.stencils)
    if term.reference is None:
        return _interpreted(term, x, r, second=True).reshape(-1, size, size)
    made = np.empty((count, size, size))
    for first in range(0, count, _BATCH):
        some = slice(first, first + _BATCH)
        now, energy = _plain(term, x, r, some)
        if energy is not None:
            step = 1e-5 * _thickness(x[term.stencils[some]], length)
            made[some] = _stiffness(now, energy, step)
    return made


def _stiffness(now: AnyArray, energy: Plain, step: FloatArray) -> FloatArray:
    """d2E/dx2 (S,3k,3k) at ``now`` (3k,S) by differences over ``step`` (S,)."""
    size = len(now)
    made = np.empty((size, size, now.shape[1]))
    shifted = now.astype(np.complex128)
    for i in range(size):
        shifted[i] += 1j * _IMAGINARY
        here = energy(shifted).imag
        for j in range(i + 1):
            centre = shifted[j].copy()
            shifted[j] = centre + step
            ahead = energy(shifted).imag - here
            shifted[j] = centre - step
            behind = here - energy(shifted).imag
            made[i, j] = made[j, i] = _central(ahead, behind) / (step * _IMAGINARY)
            shifted[j] = centre
        shifted[i] = now[i]
    return np.moveaxis(made, 2, 0)


def _central(ahead: AnyArray, behind: AnyArray) -> AnyArray:
    """Mean of the differences on both sides, or the smaller one where the other meets a jump.

    A hinge folded over has its angle jump from pi to -pi within a step; the side that does not is
    right.  Where a smooth entry is nearly zero the choice costs no more than that entry.
    """
    small, large = np.minimum(abs(ahead), abs(behind)), np.maximum(abs(ahead), abs(behind))
    one_side = np.where(abs(ahead) < abs(behind), ahead, behind)
    return np.where(large > _JUMP * small, one_side, 0.5 * (ahead + behind))


def _thickness(points: FloatArray, length: float) -> FloatArray:
    """Length (S,) over which the energy of each stencil (S,k,3) varies: its thinnest triangle.

    Distance of the first two vertices and heights of the others over it; a height enters the
    stiffness squared, so that a step of the size of an edge is far too long on a sliver.
    """
    if points.shape[1] == 1:
        return np.full(len(points), length)
    edge = points[:, 1] - points[:, 0]
    size = np.linalg.norm(edge, axis=1)
    smallest = np.minimum(size, length)
    for other in range(2, points.shape[1]):
        across = np.linalg.norm(np.cross(edge, points[:, other] - points[:, 0]), axis=1)
        smallest = np.minimum(smallest, across / size)
    return np.asarray(smallest)


def _interpreted(term: Energy, x: FloatArray, r: FloatArray, *, second: bool) -> FloatArray:
    """Derivatives of a term without NumPy form, by CasADi's virtual machine, one row a stencil."""
    k = term.size
    now, rest = ca.SX.sym("x", 3, k), ca.SX.sym("r", 3, k)
    p = ca.SX.sym("p", term.params.shape[1])
    wanted = ca.gradient(term.density(now, rest, p), now)
    if second:
        wanted = ca.jacobian(ca.vec(wanted), now)
    function = ca.Function("plain", [now, rest, p], [ca.vec(ca.densify(wanted))])
    rows = [
        np.asarray(function(xs.T, rs.T, ps)).ravel()
        for xs, rs, ps in zip(x[term.stencils], r[term.stencils], term.params, strict=True)
    ]
    return np.array(rows).reshape(len(rows), (9 * k * k) if second else 3 * k)


def total_energy(energies: Sequence[Energy], x: FloatArray, r: FloatArray) -> float:
    """Potential energy [J] at pose x and natural shape r, in plain NumPy."""
    total = 0.0
    for term in energies:
        now, energy = _plain(term, x, r)
        if energy is not None:
            total += float(energy(now).sum())
        else:
            rows = zip(x[term.stencils], r[term.stencils], term.params, strict=True)
            total += sum(float(term.density(xs.T, rs.T, ps)) for xs, rs, ps in rows)
    return total


def total_forces(energies: Sequence[Energy], x: FloatArray, r: FloatArray) -> FloatArray:
    """dE/dx (V,3) [N] at pose x and natural shape r."""
    total = np.zeros_like(x)
    for term in energies:
        np.add.at(total, term.stencils, stencil_forces(term, x, r))
    return total


def stiffness_matrix(
    energies: Sequence[Energy], x: FloatArray, r: FloatArray, length: float
) -> sp.csr_array:
    """d2E/dx2 (3V,3V) [N/m]; ``length`` sets the difference step."""
    size = x.size
    rows: list[AnyArray] = []
    columns: list[AnyArray] = []
    values: list[FloatArray] = []
    for term in energies:
        if not len(term.stencils):
            continue
        block = stencil_stiffness(term, x, r, length)
        dofs = (3 * term.stencils[:, :, None] + np.arange(3)).reshape(len(block), -1)
        dofs = dofs.astype(np.int32)  # half the memory, and what SciPy works in
        rows.append(np.broadcast_to(dofs[:, :, None], block.shape).ravel())
        columns.append(np.broadcast_to(dofs[:, None, :], block.shape).ravel())
        values.append(block.ravel())
    if not values:
        return sp.csr_array((size, size))
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return sp.csr_array(sp.coo_array(entries, shape=(size, size)).tocsr())


def _factor(matrix: sp.csr_array) -> tuple[Callable[[FloatArray], FloatArray], int | None]:
    """Solve function and number of negative eigenvalues (None: unknown) of a symmetric matrix.

    Raises ArithmeticError for a singular matrix.
    """
    from scipy.sparse.linalg import splu

    if matrix.shape[0] <= _SUPERLU_LIMIT:
        try:
            lu = splu(
                sp.csc_array(matrix),
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError as error:
            raise ArithmeticError(str(error)) from None
        if np.array_equal(lu.perm_r, lu.perm_c):  # no row exchanges: signs of U are the inertia
            return lu.solve, int(np.sum(lu.U.diagonal() < 0.0))
    solver = make_solver(matrix.indptr, matrix.indices, "symmetric")
    solver.factor(matrix.data)
    return solver.solve, solver.negative_eigenvalues


def lowest_eigenvalues(matrix: sp.csr_array, count: int) -> FloatArray:
    """Algebraically lowest eigenvalues of a symmetric matrix, ascending; inf when it is empty."""
    import scipy.sparse.linalg as spla

    size = matrix.shape[0]
    if size == 0:
        return np.array([np.inf])
    if size <= 200:
        return np.asarray(np.linalg.eigvalsh(matrix.toarray())[:count])
    scale = float(np.abs(matrix.diagonal()).mean())
    if scale == 0.0:
        return np.zeros(min(count, size))
    # Below everything in the spectrum, "nearest to the shift" means "lowest".  Inertia tells how
    # far down that is; Gershgorin's discs do when it is not known.
    lowest_disc = float((matrix.diagonal() - _off_diagonal(matrix)).min()) - 1e-8 * scale
    solve: Callable[[FloatArray], FloatArray] | None = None
    for shift in (*(-1e-8 * scale * 8.0**k for k in range(12)), lowest_disc):
        try:
            solve, negative = _factor(sp.csr_array(matrix - shift * sp.eye_array(size)))
        except ArithmeticError:
            continue
        if negative == 0:
            break
    if solve is None:
        return np.array([-np.inf])
    operator = spla.LinearOperator((size, size), matvec=solve, dtype=np.float64)
    start = np.random.default_rng(1).standard_normal(size)
    try:
        values = spla.eigsh(
            matrix, k=count, sigma=shift, OPinv=operator, v0=start, return_eigenvectors=False
        )
    except spla.ArpackNoConvergence as error:
        values = error.eigenvalues if len(error.eigenvalues) else np.array([-np.inf])
    return np.sort(values)


def _off_diagonal(matrix: sp.csr_array) -> FloatArray:
    """Sum of the absolute values off the diagonal, per row."""
    return np.asarray(abs(matrix).sum(axis=1).ravel() - np.abs(matrix.diagonal()))


def cone_numbers(contacts: Contacts, forces: FloatArray) -> tuple[FloatArray, FloatArray]:
    """mu f_N - |f_T| and f_N of every contact [N], in plain arithmetic."""
    normal = (forces * contacts.normals).sum(axis=1)
    tangential = np.linalg.norm(forces - normal[:, None] * contacts.normals, axis=1)
    return contacts.friction * normal - tangential, normal


def _above_rounding(margin: float) -> float:
    """Zero for a margin that is negative by rounding only, as without friction it must be."""
    return 0.0 if -ROUNDING <= margin < 0.0 else margin


def _free(
    count: int, contacts: Contacts, normal: FloatArray, pinned: IntArray, f0: float
) -> BoolArray:
    free = np.ones(count, dtype=bool)
    free[pinned] = False
    free[contacts.vertices[normal > ACTIVE * f0]] = False
    return free


def certify(
    energies: Sequence[Energy],
    target: FloatArray,
    pose: FloatArray,
    rest: FloatArray,
    contacts: Contacts,
    contact_forces: FloatArray,
    pinned: IntArray,
    h: float,
) -> tuple[Certificate, FloatArray]:
    """Certificate of an equilibrium and the forces dE/dx (V,3) it is based on.

    Definitions are those of `Certificate`.  Contact forces are checked against dE/dx: what they leave
    unbalanced at contact vertices counts as free force.
    """
    f0, diagonal = scale_of_forces(energies, target), float(np.linalg.norm(np.ptp(target, axis=0)))
    if not all(np.all(np.isfinite(a)) for a in (pose, rest, contact_forces)):
        lost = np.full_like(target, np.nan)
        return Certificate(None, None, None, None, None, None, f0 or 1.0, h), lost
    forces = total_forces(energies, pose, rest)
    f0 = f0 or _felt(forces, contacts, pinned)
    unbalanced = forces.copy()
    np.subtract.at(unbalanced, contacts.vertices, contact_forces)
    unbalanced[pinned] = 0.0
    slack, normal = cone_numbers(contacts, contact_forces)
    free = _free(len(target), contacts, normal, pinned, f0)
    dofs = np.flatnonzero(np.repeat(free, 3))
    matrix = sp.csr_array(stiffness_matrix(energies, pose, rest, h)[dofs][:, dofs])
    lowest = float(lowest_eigenvalues(matrix, 1)[0])
    # Rounding in the Hessian can hide a rigid motion that nothing resists; the energy cannot.
    rigid = rigid_curvatures(energies, lambda x: total_energy(energies, x, rest), pose, ~free)
    neutral = int(np.sum(np.abs(rigid) * h / f0 <= NEUTRAL))
    lowest = min(lowest, float(rigid.min(initial=np.inf)))
    if not neutral and abs(lowest) * h / f0 <= NEUTRAL:
        several = lowest_eigenvalues(matrix, min(6, max(1, len(dofs) - 1)))
        neutral = int(np.sum(np.abs(several) * h / f0 <= NEUTRAL))
    nothing_free = lowest == np.inf
    lowest = lowest if np.isfinite(lowest) else np.nan
    touched = len(contacts.vertices) > 0
    certificate = Certificate(
        free_force=float(np.abs(unbalanced).max(initial=0.0)) / f0,
        cone_margin=_above_rounding(float(slack.min()) / f0) if touched else None,
        min_normal_force=float(normal.min()) / f0 if touched else None,
        min_eigenvalue=None if nothing_free else lowest,
        min_eigenvalue_scaled=None if nothing_free else lowest * h / f0,
        target_distance=float(np.abs(pose - target).max()) / diagonal,
        f0=f0,
        h=h,
        neutral_modes=neutral,
        evaluator="numpy" if all(t.reference for t in energies) else "casadi",
    )
    return certificate, forces


def no_certificate(target: TriMesh) -> Certificate:
    """What stands in for a certificate that was not computed."""
    return Certificate(None, None, None, None, None, None, 1.0, float(target.mean_edge_length))


def scale_of_forces(energies: Sequence[Energy], target: FloatArray) -> float:
    """Mean nodal weight at the target [N], which is f0 unless it is zero."""
    loads = total_forces([term for term in energies if term.load], target, target)
    largest = float(np.abs(loads).max(initial=0.0))  # squares of tiny loads would vanish
    return largest * float(np.linalg.norm(loads / (largest or 1.0), axis=1).mean())


def _felt(forces: FloatArray, contacts: Contacts, pinned: IntArray) -> float:
    """f0 without weight: mean force on what is held; 1 N when that is nothing but rounding."""
    held = np.union1d(contacts.vertices, pinned).astype(np.int64)
    size = float(np.linalg.norm(forces[held], axis=1).mean()) if len(held) else 0.0
    return size if size > NO_FORCE else 1.0
