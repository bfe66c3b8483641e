"""Admissible contact forces: inside the Coulomb cones and in balance with the loads.

The cheap choice is the linear version of the two steps of Ly 2018: bilateral reactions with the
contacts held, then their projection onto the cones under the six balance equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import clarabel
import numpy as np
import scipy.sparse as sp

from casashell.contact.cone import tangents
from casashell.contact.detect import Contacts
from casashell.engine.sparse_solver import SingularMatrix, make_solver
from casashell.inverse.piece import Piece
from casashell.typing import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Shrink:
    """How far inside the cone forces have to stay: |f_T| <= factor mu f_N, f_N >= floor f0."""

    factor: float
    floor: float


Block: TypeAlias = tuple[sp.csr_array, FloatArray, list[object]]

#: How far inside the dual cone a proof of infeasibility has to be, for motions of unit size.
PROOF_MARGIN = 1e-7

#: Share of the largest displacement of a rigid motion that counts as none: on its axis.
STILL = 1e-11

#: From comfortable to barely admissible; 0.975 is the margin of Ly 2018 (their beta).
SHRINKS = (Shrink(0.95 * 0.975, 0.02), Shrink(0.97, 0.002), Shrink(0.995, 1e-5))


def contact_frames(contacts: Contacts) -> tuple[sp.csr_array, IntArray]:
    """Basis of the forces a set of contacts can exert, (3C, m), and the contact of each column.

    Columns are (n, t1, t2) per contact, or n alone where friction is zero.
    """
    t1, t2 = tangents(contacts.normals)
    frames = np.stack([contacts.normals, t1, t2], axis=2)  # (C, 3, 3): columns n, t1, t2
    count = len(contacts.vertices)
    row = np.broadcast_to(
        3 * np.arange(count)[:, None, None] + np.arange(3)[None, :, None], frames.shape
    )
    column = np.broadcast_to(
        3 * np.arange(count)[:, None, None] + np.arange(3)[None, None, :], frames.shape
    )
    full = sp.csr_array(
        (frames.ravel(), (row.ravel(), column.ravel())), shape=(3 * count, 3 * count)
    )
    keep = np.ones((count, 3), dtype=bool)
    keep[contacts.friction == 0.0, 1:] = False
    chosen = np.flatnonzero(keep.ravel())
    return full[:, chosen].tocsr(), chosen // 3


def cone_rows(contacts: Contacts, owner: IntArray, shrink: Shrink, floor: float) -> Block:
    """Clarabel rows A, b and cones of ``Shrink`` for the columns of `contact_frames`.

    floor  the normal force that ``shrink.floor`` asks for, in the unit of the unknowns
    """
    size = len(owner)
    first = np.searchsorted(owner, np.arange(len(contacts.vertices)))
    normal = sp.csr_array(
        (-np.ones(len(first)), (np.arange(len(first)), first)), shape=(len(first), size)
    )
    rough = np.flatnonzero(contacts.friction > 0.0)
    # A cone row triple is (mu f_N, f_1, f_2); Clarabel wants b - A f in the cone.
    scale = np.ones((len(rough), 3))
    scale[:, 0] = shrink.factor * contacts.friction[rough]
    column = first[rough][:, None] + np.arange(3)
    triples = sp.csr_array(
        (-scale.ravel(), (np.arange(3 * len(rough)), column.ravel())), shape=(3 * len(rough), size)
    )
    rows = sp.vstack([normal, triples], format="csr")
    bound = np.concatenate([np.full(len(first), -floor), np.zeros(3 * len(rough))])
    cones: list[object] = [clarabel.NonnegativeConeT(len(first))]
    cones += [clarabel.SecondOrderConeT(3) for _ in rough]
    return rows, bound, cones


def run_clarabel(
    quadratic: sp.csc_array,
    linear: FloatArray,
    blocks: Sequence[Block],
) -> tuple[FloatArray | None, FloatArray, str]:
    """Minimise x.P x / 2 + q.x subject to b - A x in the cones; (x or None, duals, status)."""
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_iter = 100
    # The unknowns are scaled already; without its own scaling the path of the interior-point method
    # does not depend on the choice of axes, so that a rotated scene gives the rotated forces.
    settings.equilibrate_enable = False
    rows = sp.vstack([block[0] for block in blocks], format="csc")
    bound = np.concatenate([block[1] for block in blocks])
    cones = [cone for block in blocks for cone in block[2]]
    solver = clarabel.DefaultSolver(
        sp.triu(quadratic, format="csc"), linear, sp.csc_matrix(rows), bound, cones, settings
    )
    found = solver.solve()
    status = str(found.status)
    good = status in ("Solved", "AlmostSolved")
    return (np.array(found.x) if good else None), np.array(found.z), status


def bilateral_reactions(piece: Piece) -> FloatArray:
    """Reactions (C,3) [N] when contacts and pins are held and the rest shape takes up the sag.

    To first order the natural shape moves against the load by K_ff^-1 w; the held vertices then feel
    their own weight and the pull of their neighbours.  Falls back to each vertex carrying its own
    weight when K_ff is singular.
    """
    contacts = piece.contacts
    own = -piece.loads
    target = piece.target
    _, entries = piece.assembly.hessian(target, target, 0.0)
    pattern = piece.assembly.pattern
    stiffness = pattern.matrix(entries)
    mask = np.ones(len(target), dtype=bool)
    mask[piece.held] = False
    free = np.flatnonzero(np.repeat(mask, 3))
    reaction = own.copy()
    if len(free):
        block = sp.csr_array(stiffness[free][:, free])
        try:
            solver = make_solver(block.indptr, block.indices, "symmetric")
            solver.factor(block.data)
            raised = np.zeros(target.size)
            raised[free] = solver.solve(own.ravel()[free])
            reaction = own - (stiffness @ raised).reshape(-1, 3)
        except SingularMatrix:
            pass
    share = np.bincount(contacts.vertices, minlength=len(target))[contacts.vertices]
    return np.asarray(reaction[contacts.vertices] / share[:, None])


def project_reactions(
    piece: Piece, wanted: FloatArray, loads: FloatArray, shrink: Shrink
) -> FloatArray | None:
    """Forces (C,3) [N] nearest to ``wanted`` in the shrunk cones that balance ``loads`` (n,3) [N].

    Only the rigid motions that the pins allow have to be balanced.  None when there are none.
    """
    contacts, f0 = piece.contacts, piece.f0
    frames, owner = contact_frames(contacts)
    blocks = [cone_rows(contacts, owner, shrink, shrink.floor)]
    balance = balance_rows(piece, frames, loads / f0)
    if balance is not None:
        blocks.insert(0, balance)
    quadratic = sp.eye_array(frames.shape[1], format="csc")
    found, _, _ = run_clarabel(quadratic, -(frames.T @ wanted.ravel()) / f0, blocks)
    return None if found is None else np.asarray((frames @ found).reshape(-1, 3) * f0)


def balance_rows(piece: Piece, frames: sp.csr_array, loads: FloatArray) -> Block | None:
    """Rows that balance ``loads`` (n,3) for the rigid motions that the pins allow."""
    modes = piece.rigid_modes
    if modes.shape[1] == 0:
        return None
    by_vertex = modes.reshape(len(piece.target), 3, -1)
    at_contacts = by_vertex[piece.contacts.vertices].reshape(-1, modes.shape[1])
    rows = np.asarray(frames.T @ at_contacts).T
    weight = modes.T @ loads.ravel()
    # Motions that contacts and loads both ignore (a turn about the vertical) make the rows dependent.
    u, size, _ = np.linalg.svd(rows, full_matrices=False)
    rank = int(np.sum(size > 1e-9 * max(size[0], 1e-300))) if size.size else 0
    if np.linalg.norm(weight - u[:, :rank] @ (u[:, :rank].T @ weight)) > 1e-9 * np.linalg.norm(
        weight
    ):
        rank = 0  # inconsistent: keep all rows, the program will say infeasible
    if rank:
        rows, weight = u[:, :rank].T @ rows, u[:, :rank].T @ weight
    return sp.csr_array(rows), -weight, [clarabel.ZeroConeT(len(weight))]


def rigid_obstruction(piece: Piece) -> FloatArray | None:
    """A rigid motion z (n,3) that proves that no natural shape and no mass can hold the target.

    Along z no admissible contact force does negative work (n.z >= mu |z_T| at every contact), pins
    stay, and every load of every vertex does positive work.  In balance the two would have to cancel,
    whatever the stresses, the stiffness and the (positive) masses.  Loads are taken to change with the
    natural shape in size, not in direction.  Re-checked in exact terms; None when not found.
    """
    contacts, modes = piece.contacts, piece.rigid_modes
    if modes.shape[1] == 0 or not piece.loads.any() or not piece.elastic_terms_are_blind:
        return None
    by_vertex = modes.reshape(len(piece.target), 3, -1)
    loose = np.setdiff1d(np.arange(len(piece.target)), piece.pinned)
    work = np.concatenate(
        [np.einsum("ni,nid->nd", load[loose], by_vertex[loose]) for load in piece.load_terms]
    )
    # Vertices on the axis of a line of pins stay where they are: their weight does no work.
    moves = np.tile(_movable(by_vertex)[loose], len(piece.load_terms))
    work = work[moves & (np.abs(work).max(axis=1, initial=0.0) > 0.0)] / piece.f0
    if len(work) == 0:
        return None
    # Maximise s with work.z >= s per vertex, n.z - mu |z_T| >= margin per contact, |z| <= 1.
    d = modes.shape[1]
    falls = sp.csr_array(np.hstack([-work, np.ones((len(work), 1))]))
    ball = sp.csr_array(np.vstack([np.zeros((1, d + 1)), -np.eye(d, d + 1)]))
    blocks: list[Block] = [
        (falls, np.zeros(len(work)), [clarabel.NonnegativeConeT(len(work))]),
        (ball, np.concatenate([[1.0], np.zeros(d)]), [clarabel.SecondOrderConeT(d + 1)]),
    ]
    if len(contacts.vertices):
        blocks.append(_lifting_rows(contacts, by_vertex[contacts.vertices]))
    goal = np.concatenate([np.zeros(d), [-1.0]])
    found, _, _ = run_clarabel(sp.csc_array((d + 1, d + 1)), goal, blocks)
    if found is None or found[-1] <= 0.0:
        return None
    motion = np.asarray((modes @ found[:d]).reshape(-1, 3))
    motion[piece.pinned] = 0.0
    motion[~_movable(by_vertex)] = 0.0
    return motion if is_obstruction(piece, motion) else None


def _movable(modes: FloatArray) -> BoolArray:
    """Vertices (n,) that some of the rigid motions (n,3,d) moves by more than rounding."""
    reach = np.abs(modes).max(axis=(1, 2), initial=0.0)
    return np.asarray(reach > STILL * reach.max(initial=0.0))


def _lifting_rows(contacts: Contacts, modes: FloatArray) -> Block:
    """Rows of n.z >= mu |z_T| + margin at every contact, for modes (C,3,d) and one slack column."""
    frames, owner = contact_frames(contacts)
    at = np.asarray(frames.T @ modes.reshape(-1, modes.shape[2]))
    rows = sp.csr_array(np.hstack([-at, np.zeros((len(at), 1))]))
    normal = np.flatnonzero(np.diff(owner, prepend=-1) != 0)
    smooth = normal[contacts.friction == 0.0]
    rough = normal[contacts.friction > 0.0]
    order = np.concatenate([smooth, (rough[:, None] + np.arange(3)).ravel()])
    weight = np.ones(len(at))
    weight[rough] = 1.0 / contacts.friction[contacts.friction > 0.0]
    bound = np.zeros(len(at))
    bound[normal] = -PROOF_MARGIN
    cones: list[object] = [clarabel.NonnegativeConeT(len(smooth))] if len(smooth) else []
    cones += [clarabel.SecondOrderConeT(3) for _ in rough]
    return sp.csr_array(sp.diags_array(weight) @ rows)[order], (weight * bound)[order], cones


def is_obstruction(piece: Piece, motion: FloatArray) -> bool:
    """Plain check of the proof of `rigid_obstruction`: strict signs, nothing but arithmetic.

    Vertices with a motion of exactly zero, pinned or on an axis of pins, do no work either way.
    """
    contacts = piece.contacts
    loose = np.flatnonzero(motion.any(axis=1))
    for newtons in piece.load_terms:
        load = newtons / (float(np.abs(newtons).max(initial=0.0)) or 1.0)
        loaded = loose[np.abs(load[loose]).max(axis=1) > 0.0]
        if len(loaded) == 0 or not np.all((load[loaded] * motion[loaded]).sum(axis=1) > 0.0):
            return False
    z = motion[contacts.vertices]
    normal = (z * contacts.normals).sum(axis=1)
    tangent = np.linalg.norm(z - normal[:, None] * contacts.normals, axis=1)
    return bool(np.all((normal - contacts.friction * tangent > 0.0) | ~z.any(axis=1)))
