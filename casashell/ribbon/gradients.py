"""Two other ways to the gradient of an energy of a strip, to compare with `chain.pull_back`.

by_chain_rule   every point by every coordinate before it, then one product: O(N^2), Pan 2016, Sec. 3.3
by_two_passes   the paper's Algorithm 3: 4x4 frames forward, 4x4 moments of the forces backward, O(N)
"""

from __future__ import annotations

import numpy as np

from casashell.ribbon.chain import BOTTOM, COORDINATES, NORMAL, TOP, Strip, cross
from casashell.typing import FloatArray


def jacobian(shape: Strip) -> FloatArray:
    """(4 (N+1), 3, N+1, 2): derivative of the station table by (c_i, beta_i)."""
    count = len(shape.middle)
    table = shape.table.reshape(count, 4, 3)
    arms = table[:, None, BOTTOM : TOP + 1] - shape.middle[None, :, None]
    made = np.zeros((count, 4, 3, count, 2))
    later = np.tri(count, k=-1)[:, :, None]
    for k in range(2):
        spins = shape.spins[None, :, k]
        for row in (BOTTOM, TOP):
            moved = cross(spins, arms[:, :, row - BOTTOM]) * later
            made[:, row, :, :, k] = np.swapaxes(moved, 1, 2)
        turned = cross(spins, table[:, None, NORMAL]) * np.tri(count)[:, :, None]
        made[:, NORMAL, :, :, k] = np.swapaxes(turned, 1, 2)
    at = np.arange(count)
    made[at, BOTTOM, :, at, 0] -= shape.slide
    made[at, TOP, :, at, 0] += shape.slide
    made[at, COORDINATES, 0, at, 0] = made[at, COORDINATES, 1, at, 1] = 1.0
    return made.reshape(4 * count, 3, count, 2)


def by_chain_rule(shape: Strip, gradient: FloatArray) -> FloatArray:
    """(N+1,2) derivative by (c, beta) of an energy with ``gradient`` (4 (N+1), 3) by the table."""
    return np.asarray(np.tensordot(gradient, jacobian(shape), axes=((0, 1), (0, 1))))


def by_two_passes(length: float, shape: Strip, gradient: FloatArray) -> FloatArray:
    """(N+1,2) the same; backward over 4x4 matrices, one ruling at a time."""
    count = len(shape.middle)
    g = gradient.reshape(count, 4, 3)
    made = g[:, COORDINATES, :2].copy()
    frames, half = _frames(length, shape), 0.5 * shape.width
    moments = np.zeros((4, 4))
    for i in range(count - 1, -1, -1):
        at, c = i * length / (count - 1), shape.slopes[i]
        before, behind = frames[i], frames[i + 1]
        moments[2, :3] += g[i, NORMAL]
        crease = np.linalg.solve(before, behind)
        for k in range(2):
            spin = before[:3, :3].T @ shape.spins[i, k]
            rate = _rate(spin, np.array([at, 0.0, 0.0])) @ crease
            made[i, k] += np.trace(rate @ moments @ before)
        made[i, 0] += half * before[:3, 0] @ (g[i, TOP] - g[i, BOTTOM])
        moments = crease @ moments
        # The points of ruling i lie on its crease: the frame before places them as well.
        for row, side in ((BOTTOM, -half), (TOP, half)):
            moments[:, :3] += np.outer([at + side * c, side, 0.0, 1.0], g[i, row])
    return made


def _frames(length: float, shape: Strip) -> FloatArray:
    """(N+2,4,4) P_{-1}, P_0, ..., P_N: material to world, before and behind each ruling."""
    count = len(shape.middle)
    made = np.tile(np.eye(4), (count + 1, 1, 1))
    made[0, :3, :3], made[1:, :3, :3] = shape.before[0], shape.behind
    s = np.arange(count) * length / (count - 1)
    made[0, :3, 3] = shape.middle[0]
    made[1:, :3, 3] = shape.middle - s[:, None] * shape.behind[:, :, 0]
    return made


def _rate(spin: FloatArray, point: FloatArray) -> FloatArray:
    """(4,4) velocity of a rotation about ``point``."""
    made = np.zeros((4, 4))
    made[0, 1], made[0, 2], made[1, 2] = -spin[2], spin[1], -spin[0]
    made[:3, :3] -= made[:3, :3].T
    made[:3, 3] = -made[:3, :3] @ point
    return made
