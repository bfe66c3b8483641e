"""Contact forces of least strain energy, without the stresses: the stress program on its contacts.

Around the target, taken as its own rest, a shell of stiffness K that feels the loads w and contact
forces f stores (w + S f).K^-1 (w + S f) / 2, S putting the forces in their places.  The minimum over
the cones and the balance of the rigid motions has the forces of the stress program, with 3 unknowns
a contact instead of one for every edge and hinge as well.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import scipy.sparse as sp

from casashell.engine.sparse_solver import SingularMatrix, SparseSolver, make_solver
from casashell.inverse.forces import (
    Shrink,
    balance_rows,
    cone_rows,
    contact_frames,
    run_clarabel,
)
from casashell.inverse.piece import Piece
from casashell.typing import FloatArray, IntArray

#: Contacts up to which the dense program is the cheaper one.
MOST_CONTACTS: Final = 250


def least_energy_forces(piece: Piece, shrink: Shrink) -> FloatArray | None:
    """Forces (C,3) [N] of least strain energy in the shrunk cones; None when there are none.

    None as well when the stiffness at rest is singular beyond rigid motions.
    """
    contacts, f0 = piece.contacts, piece.f0
    at, where = np.unique(contacts.vertices, return_inverse=True)
    dofs, solver = _factored(piece)
    if solver is None:
        return None
    place = np.full(piece.target.size, -1, dtype=np.int64)
    place[dofs] = np.arange(len(dofs))
    touched = place[(3 * at[:, None] + np.arange(3)).ravel()]
    unit = np.zeros((len(dofs), len(touched) + 1))
    unit[touched[touched >= 0], np.flatnonzero(touched >= 0)] = 1.0
    unit[:, -1] = piece.loads.ravel()[dofs]
    moved = np.zeros((len(touched), unit.shape[1]))
    moved[touched >= 0] = solver.solve(unit)[touched[touched >= 0]]
    flexible = moved[:, :-1].reshape(len(at), 3, len(at), 3)[where][:, :, where]
    sagged = moved[:, -1].reshape(len(at), 3)[where].ravel()
    frames, owner = contact_frames(contacts)
    count = 3 * len(contacts.vertices)
    quadratic = np.asarray(frames.T @ (frames.T @ flexible.reshape(count, count)).T)
    scale = float(np.trace(quadratic)) / len(quadratic)
    if not np.isfinite(scale) or scale <= 0.0:
        return None
    blocks = [cone_rows(contacts, owner, shrink, shrink.floor)]
    balance = balance_rows(piece, frames, piece.loads / f0)
    if balance is not None:
        blocks.insert(0, balance)
    # The ridge decides where forces on one vertex, or none of the stiffness, leaves a choice.
    dense = 0.5 * (quadratic + quadratic.T) / scale + 1e-9 * np.eye(len(quadratic))
    linear = np.asarray(frames.T @ sagged) / (scale * f0)
    found, _, _ = run_clarabel(sp.csc_array(dense), linear, blocks)
    return None if found is None else np.asarray((frames @ found).reshape(-1, 3) * f0)


def _factored(piece: Piece) -> tuple[IntArray, SparseSolver | None]:
    """Unpinned degrees of freedom and a factor of the stiffness there, rigid motions held.

    The springs that hold them resist rigid motions only, so that balanced forces do not feel them.
    """
    target, pattern = piece.target, piece.assembly.pattern
    free = np.setdiff1d(np.arange(len(target)), piece.pinned)
    dofs = (3 * free[:, None] + np.arange(3)).ravel()
    _, entries = piece.assembly.hessian(target, target, 0.0)
    stiffness = sp.csr_array(pattern.matrix(entries)[dofs][:, dofs])
    modes = piece.rigid_modes
    if modes.shape[1]:
        some = _spread(target)
        rows = (3 * some[:, None] + np.arange(3)).ravel()
        basis = np.linalg.qr(modes[rows])[0]
        spring = sp.lil_array(stiffness.shape)
        place = np.searchsorted(dofs, rows)
        spring[np.ix_(place, place)] = basis @ basis.T * float(np.abs(stiffness.diagonal()).mean())
        stiffness = sp.csr_array(stiffness + spring.tocsr())
    try:
        solver = make_solver(stiffness.indptr, stiffness.indices, "symmetric")
        solver.factor(stiffness.data)
    except SingularMatrix:
        return dofs, None
    return dofs, solver


def _spread(points: FloatArray) -> IntArray:
    """Three vertices far from each other and from one line."""
    first = int(np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1)))
    arm = points - points[first]
    second = int(np.argmax(np.linalg.norm(arm, axis=1)))
    along = arm[second] / np.linalg.norm(arm[second])
    third = int(np.argmax(np.linalg.norm(arm - np.outer(arm @ along, along), axis=1)))
    return np.unique([first, second, third])
