"""Rigid motions that a held shell is left with, and how its energy curves along them.

Rounding in a Hessian can hide that a shell turns freely about an axis: the elastic energy is some
1e12 times stiffer than the weight that would resist.  Along a finite rigid motion the elastic energy
does not change at all, so differences of the energy itself show what is left.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import scipy.sparse as sp

from casashell.engine.energy import Energy
from casashell.typing import BoolArray, FloatArray, IntArray

_ANGLE = 1e-2  # rad; translations move by this times the radius of the part


def parts_of(stencils: Sequence[IntArray], count: int) -> IntArray:
    """Label (V,) of the part each vertex belongs to; stencils couple their vertices."""
    from scipy.sparse.csgraph import connected_components  # slow to import

    rows = [np.repeat(s[:, 0], s.shape[1] - 1) for s in stencils]
    columns = [s[:, 1:].ravel() for s in stencils]
    row, column = (
        np.concatenate([np.empty(0, np.int64), *rows]),
        np.concatenate([np.empty(0, np.int64), *columns]),
    )
    graph = sp.coo_array((np.ones(len(row)), (row, column)), shape=(count, count))
    _, labels = connected_components(graph.tocsr(), directed=False)
    return np.asarray(labels, dtype=np.int64)


def rigid_curvatures(
    energies: Sequence[Energy],
    energy: Callable[[FloatArray], float],
    pose: FloatArray,
    held: BoolArray,
) -> FloatArray:
    """Second derivatives [N/m] of ``energy`` along the rigid motions of each part that ``held`` allows.

    energy  total potential energy [J] of a pose (V,3)
    held    (V,) vertices that do not move
    Eigenvalues over motions of unit norm; empty when no part can move rigidly.
    """
    labels = parts_of([t.stencils for t in energies], len(pose))
    found: list[float] = []
    for part in range(int(labels.max(initial=-1)) + 1):
        found += _curvatures(energy, pose, labels == part, held)
    return np.sort(np.array(found))


def _curvatures(
    energy: Callable[[FloatArray], float], pose: FloatArray, part: BoolArray, held: BoolArray
) -> list[float]:
    """Eigenvalues for one part."""
    motions = list(_motions(pose, part, held))
    if not motions:
        return []
    steps = [move(_ANGLE) - move(-_ANGLE) for move, _ in motions]
    basis = np.stack([step.ravel() / (2.0 * _ANGLE) for step in steps], axis=1)
    size = len(motions)
    form = np.zeros((size, size))
    centre = energy(pose)
    for i, (move, twist) in enumerate(motions):
        form[i, i] = (energy(move(_ANGLE)) - 2.0 * centre + energy(move(-_ANGLE))) / _ANGLE**2
        for j in range(i):
            both = _mover(
                pose, part, twist[0], twist[1] + motions[j][1][1], twist[2] + motions[j][1][2]
            )
            sum_ = (energy(both(_ANGLE)) - 2.0 * centre + energy(both(-_ANGLE))) / _ANGLE**2
            form[i, j] = form[j, i] = 0.5 * (sum_ - form[i, i] - form[j, j])
    gram = basis.T @ basis
    width, turn = np.linalg.eigh(gram)
    useful = width > 1e-12 * width[-1]
    root = turn[:, useful] / np.sqrt(width[useful])
    return [float(value) for value in np.linalg.eigvalsh(root.T @ form @ root)]


Twist = tuple[FloatArray, FloatArray, FloatArray]  # centre, rotation vector, translation


def _motions(
    pose: FloatArray, part: BoolArray, held: BoolArray
) -> Iterator[tuple[Callable[[float], FloatArray], Twist]]:
    """Basis of the rigid motions of ``part`` that leave its held vertices in place."""
    fixed = pose[part & held]
    centre = fixed[0] if len(fixed) else pose[part].mean(axis=0)
    turns = np.eye(3)
    if len(fixed):
        # w x arm = 0 for every arm: the null space of the stacked cross-product matrices.
        arms = fixed - centre
        rows = np.concatenate([np.cross(np.eye(3), arm).T for arm in arms])
        _, size, vh = np.linalg.svd(rows)
        extent = float(np.linalg.norm(np.ptp(pose[part], axis=0))) or 1.0
        turns = vh[np.concatenate([size, np.zeros(3 - len(size))]) <= 1e-9 * extent]
    radius = float(np.sqrt(((pose[part] - centre) ** 2).sum(axis=1).mean()))
    twists: list[Twist] = [(centre, turn, np.zeros(3)) for turn in turns if radius > 0.0]
    if not len(fixed):
        twists += [(centre, np.zeros(3), (radius or 1.0) * axis) for axis in np.eye(3)]
    for twist in twists:
        yield _mover(pose, part, *twist), twist


def _mover(
    pose: FloatArray, part: BoolArray, centre: FloatArray, turn: FloatArray, shift: FloatArray
) -> Callable[[float], FloatArray]:
    """Pose after the finite motion ``angle * (turn, shift)`` of one part (Rodrigues' formula)."""
    rate = float(np.linalg.norm(turn))
    axis = turn / rate if rate > 0.0 else turn

    def move(angle: float) -> FloatArray:
        moved = pose.copy()
        arm = pose[part] - centre
        around = np.cross(axis, arm)
        sine, cosine = np.sin(rate * angle), np.cos(rate * angle)
        moved[part] = centre + arm + sine * around + (1.0 - cosine) * np.cross(axis, around)
        moved[part] += angle * shift
        return moved

    return move


def is_blind(forces: FloatArray, points: FloatArray) -> bool:
    """Whether forces (V,3) at ``points`` of a strained shell have no resultant and no moment.

    Energies that do not feel rigid motions have such forces.
    """
    scale = float(np.abs(forces).sum()) or 1.0
    arm = points - points.mean(axis=0)
    reach = float(np.abs(arm).max()) or 1.0
    resultant = float(np.abs(forces.sum(axis=0)).max())
    moment = float(np.abs(np.cross(arm, forces).sum(axis=0)).max())
    return max(resultant, moment / reach) <= 1e-9 * scale
