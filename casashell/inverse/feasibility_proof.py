"""Proofs that no natural shape holds a target, and their check.

A proof is a motion z of the vertices (Farkas' lemma).  Where z stretches and bends nothing, leaves the
pins in place and meets every admissible contact force with no negative work, stresses and contacts can
do no work against the loads; if the loads do work along z, they cannot be in balance with anything.

In floating point z leaks: an element is strained a little, a cone is entered a little.  Then balance
asks for forces that are large in proportion, and the check gives that number: what tensions, moments
(as forces on vertices) and contact forces would have to add up to, in units of the load.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import clarabel
import numpy as np
import scipy.sparse as sp

from casashell.engine.kernels import get_kernel
from casashell.inverse.forces import (
    Block,
    is_obstruction,
    rigid_obstruction,
    run_clarabel,
)
from casashell.inverse.piece import Piece
from casashell.inverse.stress import StressProgram
from casashell.typing import FloatArray

#: Natural areas, and with them masses, may be this many times larger or smaller than the target's:
#: lengths within a factor of two.
AREA_FACTOR = 4.0
#: A proof rules out all forces that add up to less than this times the load.
STRENGTH = 1e6
#: Work of the loads, per load and largest motion, below which it is rounding.
WORK = 1e-9


@dataclass(frozen=True, eq=False)
class Proof:
    """A motion that proves infeasibility, as `check_proof` sees it.

    motion       (n,3) per vertex of the piece, the largest has length 1
    area_factor  natural areas up to this many times larger or smaller than the target's; inf: any
    work         least work of the loads along the motion, / (sum of loads x largest motion)
    strength     sum of stresses and contact forces that balance would take, / sum of loads
    rigid        whether the motion is rigid: then stiffness and stresses are out of the question
    """

    motion: FloatArray
    area_factor: float
    work: float
    strength: float
    rigid: bool

    @property
    def holds(self) -> bool:
        """Whether this is a proof: the forces that could refute it are beyond all measure."""
        return self.work > WORK and self.strength >= STRENGTH


def load_columns(piece: Piece) -> sp.csr_array:
    """Nodal loads (3n, M) [N] at the target, one column for every stencil of every load term."""
    target, blocks = piece.target, []
    for term in piece.assembly.energies:
        if not term.load:
            continue
        kernel = get_kernel(term.density, "gradient", interpreted=piece.assembly.interpreted)
        force = -kernel(target, target, term.params, term.stencils, target)[0]
        row = (3 * term.stencils[:, :, None] + np.arange(3)).reshape(force.shape)
        column = np.broadcast_to(np.arange(len(force))[:, None], force.shape)
        shape = (target.size, len(force))
        blocks.append(sp.csr_array((force.ravel(), (row.ravel(), column.ravel())), shape=shape))
    return sp.csr_array(sp.hstack(blocks) if blocks else sp.csr_array((target.size, 0)))


def check_proof(piece: Piece, motion: FloatArray, area_factor: float) -> Proof:
    """What a motion (n,3) proves; arithmetic on vectors only, no solver.

    area_factor  inf asks that every load works along the motion, so that sizes do not matter
    Energies without strain measure are ruled out only for rigid motions they do not feel.
    """
    z = np.array(motion)
    z[piece.pinned] = 0.0
    largest = float(np.linalg.norm(z, axis=1).max(initial=0.0))
    z /= largest or 1.0
    rigid = _is_rigid(piece, z)
    factor = area_factor if np.isfinite(area_factor) else 1.0
    columns = load_columns(piece)
    work = np.asarray(columns.T @ z.ravel())
    size = np.asarray(abs(columns).sum(axis=0)).ravel()
    least = float(np.where(work > 0.0, work / factor, work * factor).sum())
    total = factor * float(size.sum())
    share = least / total if total > 0.0 else 0.0
    if not np.isfinite(area_factor) and not is_obstruction(piece, z):
        share = 0.0
    leak = max(_contact_leak(piece, z), _element_leak(piece, z, rigid))
    strength = share / leak if leak > 0.0 else (np.inf if share > 0.0 else 0.0)
    return Proof(z, area_factor, share, strength, rigid)


def _is_rigid(piece: Piece, z: FloatArray) -> bool:
    modes = piece.rigid_modes
    if modes.shape[1] == 0:
        return False
    fit, *_ = np.linalg.lstsq(modes, z.ravel(), rcond=None)
    return bool(np.abs(modes @ fit - z.ravel()).max() <= 1e-10)


def _element_leak(piece: Piece, z: FloatArray, rigid: bool) -> float:
    """Largest rate of strain along z per unit of what the element does to its vertices."""
    if rigid and piece.elastic_terms_are_blind:
        return 0.0
    program = StressProgram(piece)
    if not program.complete:
        return np.inf
    slopes = program.slopes
    size = np.sqrt(np.asarray(slopes.multiply(slopes).sum(axis=0)).ravel())
    rate = np.abs(np.asarray(slopes.T @ z.ravel()))
    return float((rate / np.where(size > 0.0, size, 1.0)).max(initial=0.0))


def _contact_leak(piece: Piece, z: FloatArray) -> float:
    """Largest negative work along z of a contact force of size one in its cone."""
    contacts = piece.contacts
    at = z[contacts.vertices]
    normal = (at * contacts.normals).sum(axis=1)
    slip = np.linalg.norm(at - normal[:, None] * contacts.normals, axis=1)
    cos = 1.0 / np.hypot(1.0, contacts.friction)
    sin = contacts.friction * cos
    edge = slip * sin - normal * cos
    inside = slip * cos <= -normal * sin  # -z itself is in the cone
    worst = np.where(inside, np.hypot(normal, slip), edge)
    return float(np.maximum(worst, 0.0).max(initial=0.0))


def rigid_proof(piece: Piece) -> Proof | None:
    """Cheapest first: for any masses, then for natural areas within ``AREA_FACTOR``."""
    motion = rigid_obstruction(piece)
    if motion is not None:
        proof = check_proof(piece, motion, np.inf)
        if proof.holds:
            return proof
    if piece.rigid_modes.shape[1] == 0 or not piece.elastic_terms_are_blind:
        return None
    for margin in (1e-7, 0.0):
        bounded = _bounded_rigid(piece, margin)
        if bounded is not None and bounded.holds:
            return bounded
    return None


def _bounded_rigid(piece: Piece, margin: float) -> Proof | None:
    """Rigid motion of most work for the worst masses, with n.z >= mu |z_T| + margin at contacts."""
    modes, columns = piece.rigid_modes, load_columns(piece)
    d, count = modes.shape[1], columns.shape[1]
    work = np.asarray((columns.T @ modes) / float(abs(columns).sum()))
    one = -sp.eye_array(count, format="csr")
    # Unknowns: the motion and, per load, a bound u <= work / factor and u <= work factor.
    low = sp.hstack([sp.csr_array(work / AREA_FACTOR), one])
    high = sp.hstack([sp.csr_array(work * AREA_FACTOR), one])
    ball = sp.csr_array(np.vstack([np.zeros((1, d + count)), -np.eye(d, d + count)]))
    blocks: list[Block] = [
        (
            -sp.csr_array(sp.vstack([low, high])),
            np.zeros(2 * count),
            [clarabel.NonnegativeConeT(2 * count)],
        ),
        (ball, np.concatenate([[1.0], np.zeros(d)]), [clarabel.SecondOrderConeT(d + 1)]),
    ]
    if len(piece.contacts):
        blocks.append(_polar_rows(piece, modes, count, margin))
    goal = np.concatenate([np.zeros(d), -np.ones(count)])
    found, _, _ = run_clarabel(sp.csc_array((d + count, d + count)), goal, blocks)
    if found is None:
        return None
    return check_proof(piece, (modes @ found[:d]).reshape(-1, 3), AREA_FACTOR)


def _polar_rows(piece: Piece, modes: FloatArray, others: int, margin: float) -> Block:
    """Rows of n.z - mu |z_T| >= margin for z = modes y; ``others`` unknowns follow y."""
    contacts = piece.contacts
    at = modes.reshape(len(piece.target), 3, -1)[contacts.vertices]
    normal = np.einsum("ci,cid->cd", contacts.normals, at)
    slip = contacts.friction[:, None, None] * (at - contacts.normals[:, :, None] * normal[:, None])
    rows = np.concatenate([normal[:, None], slip], axis=1).reshape(-1, modes.shape[1])
    bound = np.zeros((len(contacts), 4))
    bound[:, 0] = -margin
    full = sp.hstack([sp.csr_array(-rows), sp.csr_array((len(rows), others))])
    cones: list[object] = [clarabel.SecondOrderConeT(4) for _ in range(len(contacts))]
    return sp.csr_array(full), bound.ravel(), cones


def with_pins(piece: Piece, pins: FloatArray) -> Piece:
    """The same piece with more vertices pinned; they touch nothing any more."""
    chosen = np.union1d(piece.pinned, pins).astype(np.int64)
    contacts = piece.contacts.subset(~np.isin(piece.contacts.vertices, chosen))
    return replace(piece, pinned=chosen, contacts=contacts)
