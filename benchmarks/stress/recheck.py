"""Second opinion on a result: nothing of the solver or of its certificate is used.

A certified status is recomputed from the formulas of the paper with dense eigenvalues; a proof of
infeasibility is tried to be refuted by a linear program over forces and masses.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import coo_array, csgraph

from benchmarks.stress.physics import Shell
from casashell.contact.cone import tangents
from casashell.contact.detect import Contacts
from casashell.problem import Problem
from casashell.result import Result
from casashell.status import Status
from casashell.typing import BoolArray, FloatArray, IntArray

FREE_FORCE, NEARBY, ACTIVE = 1e-6, 1e-3, 1e-6
#: Share of the largest entry of a dense matrix that its eigenvalues can be wrong by, per row.
_DENSE = 4e-16
#: Sides of the polygon that replaces the circle of a Coulomb cone.
_SIDES = 24


def complaints(problem: Problem, result: Result) -> list[str]:
    """What is wrong with a result; empty when it stands."""
    found = []
    if result.status.certified:
        found += _not_finite(result) or _false_success(problem, result)
    if result.status is Status.INFEASIBLE:
        found += _false_proof(problem)
    if not result.advice:
        found.append("no advice")
    return found


def _not_finite(result: Result) -> list[str]:
    arrays = {
        "rest": result.rest,
        "pose": result.pose,
        "forces": result.forces,
        "contact forces": result.contact_forces,
    }
    return [f"{k} not finite" for k, v in arrays.items() if not np.all(np.isfinite(v))]


def scale(shell: Shell, target: FloatArray, forces: FloatArray, held: BoolArray) -> float:
    """f0 [N]: mean nodal weight; without weight the mean reaction, or 1 N."""
    weight = shell.weights(target)
    largest = float(np.abs(weight).max())
    if largest > 0.0:
        return largest * float(np.linalg.norm(weight / largest, axis=1).mean())
    felt = float(np.linalg.norm(forces[held], axis=1).mean()) if held.any() else 0.0
    return felt if felt > 1e-9 else 1.0


def _false_success(problem: Problem, result: Result) -> list[str]:
    shell, contacts = Shell.of(problem), problem.contacts
    target = problem.target.vertices
    pinned = np.asarray(problem.pinned)
    held = np.zeros(len(target), dtype=bool)
    held[pinned] = held[contacts.vertices] = True
    forces = shell.forces(result.pose, result.rest)
    f0 = scale(shell, target, forces, held)
    found = []
    left = forces.copy()
    np.subtract.at(left, contacts.vertices, result.contact_forces)
    left[pinned] = 0.0
    # Two ways to round the same sum differ by as much as coordinates round.
    allowed = FREE_FORCE * f0 + 8.0 * shell.rounding(result.rest)
    if np.abs(left).max() > allowed:
        found.append(f"unbalanced force {np.abs(left).max() / f0:.1e} f0")
    normal = (result.contact_forces * contacts.normals).sum(axis=1)
    across = np.linalg.norm(result.contact_forces - normal[:, None] * contacts.normals, axis=1)
    slack = min((contacts.friction * normal - across).min(initial=0.0), normal.min(initial=0.0))
    if slack < -1e-11 * f0:
        found.append(f"cone broken by {-slack / f0:.1e} f0")
    free = np.ones(len(target), dtype=bool)
    free[pinned] = False
    free[contacts.vertices[normal > ACTIVE * f0]] = False
    away = np.abs(result.pose - target).max() / np.linalg.norm(np.ptp(target, axis=0))
    if result.status is Status.SOLVED and away > NEARBY:
        found.append(f"pose {away:.1e} diagonals from the target")
    return found + _unstable(shell, result, free, f0)


def _unstable(shell: Shell, result: Result, free: BoolArray, f0: float) -> list[str]:
    dofs = np.flatnonzero(np.repeat(free, 3))
    if not len(dofs):
        return []
    found = []
    matrix = shell.stiffness(result.pose, result.rest)[np.ix_(dofs, dofs)]
    lowest = float(np.linalg.eigvalsh(matrix)[0])
    if lowest < -_DENSE * len(dofs) * np.abs(matrix).max():
        found.append(f"lowest eigenvalue {lowest:.1e} N/m")
    for label, curvature in turning(shell, result.pose, result.rest, ~free):
        if curvature <= 1e-9 * f0:
            found.append(f"part {label} turns or moves freely")
    return found


def parts(shell: Shell, count: int) -> IntArray:
    """Connected part (V,) of every vertex, through edges."""
    a, b = shell.edges.T
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(count, count))
    return np.asarray(csgraph.connected_components(graph, directed=False)[1])


def turning(
    shell: Shell, pose: FloatArray, rest: FloatArray, held: BoolArray
) -> list[tuple[int, float]]:
    """Parts whose held vertices leave a rigid motion, and the weight's curvature along it.

    Weight [N] times arm [m] over the radius: what resists a turn about the line of the held vertices;
    zero for parts that nothing holds, or one point only, and that can therefore shift or twist.
    """
    found = []
    weight = shell.weights(rest)
    labels = parts(shell, len(pose))
    for label in range(labels.max() + 1):
        mine = labels == label
        fixed = pose[mine & held]
        size = float(np.linalg.norm(np.ptp(pose[mine], axis=0)))
        if not len(fixed):
            found.append((label, 0.0))
            continue
        centre = fixed[0]
        _, width, axes = np.linalg.svd(fixed - centre, full_matrices=True)
        rank = int((width > 1e-9 * size).sum())
        if rank >= 2:
            continue
        # A point lets the part turn about every axis, the vertical with no resistance at all.
        down = shell.gravity / (np.linalg.norm(shell.gravity) or 1.0)
        axis = axes[0] if rank == 1 else down
        arm = pose[mine] - centre
        inward = np.cross(axis, np.cross(axis, arm))
        found.append((label, -float((weight[mine] * inward).sum()) / size))
    return found


def balances(problem: Problem, *, outer: bool, masses: str = "target", push: float = 0.0) -> bool:
    """Whether contact forces in polygonal cones can balance the weight for free rigid motions.

    outer    polygons around the circles of Coulomb's cones, otherwise inside them
    masses   "target": those of the target; "any": any positive mass per vertex
    push     normal force that every contact exerts at least, in nodal weights
    """
    shell, contacts = Shell.of(problem), problem.contacts
    points = problem.target.vertices
    pinned = np.zeros(len(points), dtype=bool)
    pinned[np.asarray(problem.pinned)] = True
    labels = parts(shell, len(points))
    return all(
        _part_balances(
            shell, contacts, points, labels == label, pinned, outer, masses == "any", push
        )
        for label in range(labels.max() + 1)
    )


def _part_balances(
    shell: Shell,
    contacts: Contacts,
    points: FloatArray,
    mine: BoolArray,
    pinned: BoolArray,
    outer: bool,
    any_mass: bool,
    push: float,
) -> bool:
    weight = shell.weights(points)
    size = float(np.abs(weight).max())
    if size == 0.0:
        return True
    centre = points[mine].mean(axis=0)
    reach = float(np.abs(points[mine] - centre).max())
    here = np.flatnonzero(mine[contacts.vertices])
    rays, at = _rays(contacts, here, outer)
    columns = [_wrench((points[at] - centre) / reach, rays)]
    for axis in np.eye(3):  # reactions of pins, both signs
        where = np.flatnonzero(mine & pinned)
        for sign in (1.0, -1.0):
            force = np.broadcast_to(sign * axis, (len(where), 3))
            columns.append(_wrench((points[where] - centre) / reach, force))
    loose = np.flatnonzero(mine)
    loads = _wrench((points[loose] - centre) / reach, weight[loose] / size)
    pushed = _wrench(
        (points[contacts.vertices[here]] - centre) / reach, push * contacts.normals[here]
    )
    target = -loads.sum(axis=1) - pushed.sum(axis=1)
    matrix = np.concatenate(columns, axis=1)
    if any_mass:  # one more factor >= 0 on top of every nodal weight; scale leaves it without bound
        matrix = np.concatenate([matrix, loads], axis=1)
    if not matrix.shape[1]:
        return False
    # Least sum of slacks: a linear program's own tolerance must not decide.
    slack = np.concatenate([np.eye(6), -np.eye(6)], axis=1)
    cost = np.concatenate([np.zeros(matrix.shape[1]), np.ones(12)])
    done = linprog(
        cost, A_eq=np.concatenate([matrix, slack], axis=1), b_eq=target, bounds=(0, None)
    )
    return bool(done.status == 0 and done.fun <= 1e-7 * len(loose))


def _wrench(arm: FloatArray, force: FloatArray) -> FloatArray:
    """Resultant and moment (6,N) of forces (N,3) at arms (N,3)."""
    return np.concatenate([force, np.cross(arm, force)], axis=1).T


def _rays(contacts: Contacts, here: IntArray, outer: bool) -> tuple[FloatArray, IntArray]:
    """Edges of polygonal cones (N,3) of the contacts ``here``, and their vertices (N,)."""
    normals, mu = contacts.normals[here], contacts.friction[here]
    t1, t2 = tangents(normals)
    wide = mu / np.cos(np.pi / _SIDES) if outer else mu
    turn = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
    rays = normals[:, None] + wide[:, None, None] * (
        np.cos(turn)[:, None] * t1[:, None] + np.sin(turn)[:, None] * t2[:, None]
    )
    return rays.reshape(-1, 3), np.repeat(contacts.vertices[here], _SIDES)


def _false_proof(problem: Problem) -> list[str]:
    """A proof says: no positive masses whatever.  Forces inside the cones would refute it."""
    if balances(problem, outer=False, masses="any"):
        return ["proved infeasible, yet forces inside the cones balance some masses"]
    return []
