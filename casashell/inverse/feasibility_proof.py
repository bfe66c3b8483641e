"""Proofs that no natural shape holds a target, and their check.

A proof is a motion z of the vertices (Farkas' lemma).  Where z stretches and bends nothing, leaves the
pins in place and meets every admissible contact force with no negative work, stresses and contacts can
do no work against the loads; if the loads do work along z, they cannot be in balance with anything.

In floating point z leaks: an element is strained a little, a cone is entered a little.  Then balance
asks for forces that are large in proportion, and the check gives that number: what tensions, moments
(as forces on vertices) and contact forces would have to add up to, in units of the load.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import clarabel
import numpy as np
import scipy.sparse as sp

from casashell.engine.kernels import get_kernel
from casashell.inverse.forces import (
    Block,
    Shrink,
    cone_rows,
    contact_frames,
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
_WORK = 1e-9
#: Coulomb's cones as they are.
TRUE_CONES = Shrink(1.0, 0.0)


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
        return self.work > _WORK and self.strength >= STRENGTH


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
        proof = _bounded_rigid(piece, margin)
        if proof is not None and proof.holds:
            return proof
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


def area_spread(piece: Piece) -> tuple[float, FloatArray] | None:
    """Least change of masses for which contacts and pins balance the loads: factor, loads (n,3) [N].

    The factor is how many times natural areas have to be larger or smaller than the target's: with a
    common factor free, that is the square root of the least ratio of their changes.  None when not
    even ``AREA_FACTOR`` is enough, or when the program ends without an answer.
    """
    frames, owner = contact_frames(piece.contacts)
    columns, modes = load_columns(piece), piece.rigid_modes
    count, m, d = columns.shape[1], frames.shape[1], modes.shape[1]
    if d == 0 or count == 0:
        return 1.0, piece.loads
    # Unknowns: forces / f0, the growth p >= 0 of every load, and the largest growth.
    at = modes.reshape(len(piece.target), 3, d)[piece.contacts.vertices].reshape(-1, d)
    pull, weight = np.asarray(frames.T @ at).T, np.asarray(modes.T @ columns) / piece.f0
    rows = np.hstack([pull, weight, np.zeros((d, 1))])
    u, size, _ = np.linalg.svd(rows, full_matrices=False)  # turns that nothing feels drop out
    u = u[:, size > 1e-9 * max(float(size[0]), 1e-300)]
    one = sp.eye_array(count, format="csr")
    grown = sp.hstack([sp.csr_array((count, m)), -one, sp.csr_array((count, 1))])
    least = sp.hstack([sp.csr_array((count, m)), one, sp.csr_array(-np.ones((count, 1)))])
    blocks: list[Block] = [
        (
            sp.csr_array(u.T @ rows),
            -(u.T @ weight.sum(axis=1)),
            [clarabel.ZeroConeT(u.shape[1])],
        ),
        (
            sp.csr_array(sp.vstack([grown, least])),
            np.zeros(2 * count),
            [clarabel.NonnegativeConeT(2 * count)],
        ),
    ]
    if m:
        inside, bound, cones = cone_rows(piece.contacts, owner, TRUE_CONES, 0.0)
        empty = sp.csr_array((inside.shape[0], count + 1))
        blocks.append((sp.csr_array(sp.hstack([inside, empty])), bound, cones))
    goal = np.zeros(m + count + 1)
    goal[-1] = 1.0
    tiny = sp.diags_array(np.full(len(goal), 1e-9), format="csc")
    found, _, _ = run_clarabel(tiny, goal, blocks)
    if found is None:
        return None
    factor = float(np.sqrt(1.0 + max(found[-1], 0.0)))
    masses = (1.0 + np.maximum(found[m:-1], 0.0)) / factor
    loads = np.asarray(columns @ masses).reshape(-1, 3)
    return (factor, loads) if factor <= AREA_FACTOR else None


@dataclass(frozen=True, eq=False)
class FreeMasses:
    """Outcome of the stress program with natural areas free within ``AREA_FACTOR``.

    feasible  True or False as the program says, None when it ended without an answer
    proof     what its certificate is worth, when it says infeasible
    """

    feasible: bool | None
    proof: Proof | None = None


def free_masses(program: StressProgram) -> FreeMasses:
    """Is there any stress, any admissible contact force and any mass that balance?"""
    piece, balance = program.piece, program.balance
    frames, owner = program.frames
    columns = load_columns(piece)[program.loose] / piece.f0
    count, others = columns.shape[1], balance.shape[1]
    # Masses of the target are unknowns of size 1; columns in the size of the other unknowns.
    one = sp.hstack([sp.csr_array((count, others)), sp.eye_array(count, format="csr")])
    blocks: list[Block] = [
        (
            sp.csr_array(sp.hstack([balance, -columns])),
            np.zeros(balance.shape[0]),
            [clarabel.ZeroConeT(balance.shape[0])],
        ),
        (
            sp.csr_array(sp.vstack([one, -one])),
            np.concatenate([np.full(count, AREA_FACTOR), np.full(count, -1.0 / AREA_FACTOR)]),
            [clarabel.NonnegativeConeT(2 * count)],
        ),
    ]
    if frames.shape[1]:
        inside, bound, cones = cone_rows(piece.contacts, owner, TRUE_CONES, 0.0)
        before = sp.csr_array((inside.shape[0], len(program.stiffness)))
        after = sp.csr_array((inside.shape[0], count))
        blocks.append((sp.csr_array(sp.hstack([before, inside, after])), bound, cones))
    weight = np.concatenate([np.full(others, 1e-6), np.ones(count)])
    goal = np.concatenate([np.zeros(others), -np.ones(count)])
    found, duals, status = run_clarabel(sp.diags_array(weight, format="csc"), goal, blocks)
    if found is not None:
        return FreeMasses(True)
    if "PrimalInfeasible" not in status:
        return FreeMasses(None)
    z = np.zeros(piece.target.size)
    z[program.loose] = duals[: balance.shape[0]]
    best = max(_attempts(program, z), key=lambda proof: (proof.work > _WORK, proof.strength))
    return FreeMasses(False, best)


def _attempts(program: StressProgram, z: FloatArray) -> Iterator[Proof]:
    """The motion of a certificate, its part that strains nothing, either sign and scope."""
    flex = _unstrained(program, z)
    for motion in (z, -z, flex, -flex):
        for factor in (np.inf, AREA_FACTOR):
            yield check_proof(program.piece, motion.reshape(-1, 3), factor)


def _unstrained(program: StressProgram, z: FloatArray) -> FloatArray:
    """The motion nearest to z that strains no element, pins in place."""
    from scipy.sparse.linalg import lsmr

    slopes = program.slopes[program.loose]
    size = np.sqrt(np.asarray(slopes.multiply(slopes).sum(axis=0)).ravel())
    unit = sp.csr_array(slopes @ sp.diags_array(1.0 / np.where(size > 0.0, size, 1.0)))
    flex, part = np.zeros_like(z), z[program.loose]
    for _ in range(2):  # once more on what rounding left
        part = part - unit @ lsmr(unit, part, atol=1e-15, btol=1e-15, maxiter=4 * unit.shape[0])[0]
    flex[program.loose] = part
    return flex


def with_pins(piece: Piece, pins: FloatArray) -> Piece:
    """The same piece with more vertices pinned; they touch nothing any more."""
    chosen = np.union1d(piece.pinned, pins).astype(np.int64)
    contacts = piece.contacts.subset(~np.isin(piece.contacts.vertices, chosen))
    return replace(piece, pinned=chosen, contacts=contacts)
