"""Balance with the masses as unknowns: natural areas move, and the loads with them.

Loads are linear in the natural sizes of their elements, so both questions stay convex: how far areas
have to move for the contacts to carry the whole (`area_spread`), and whether any stress, contact force
and mass balance at every vertex (`free_masses`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import clarabel
import numpy as np
import scipy.sparse as sp

from casashell.inverse.feasibility_proof import (
    AREA_FACTOR,
    WORK,
    Proof,
    check_proof,
    load_columns,
)
from casashell.inverse.forces import Block, Shrink, cone_rows, contact_frames, run_clarabel
from casashell.inverse.piece import Piece
from casashell.inverse.stress import StressProgram
from casashell.typing import FloatArray

#: Coulomb's cones as they are.
TRUE_CONES = Shrink(1.0, 0.0)


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
    best = max(_attempts(program, z), key=lambda proof: (proof.work > WORK, proof.strength))
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
