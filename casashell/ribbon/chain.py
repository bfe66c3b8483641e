"""From slopes and angles to a developable strip and back, for all rulings at once.

Pan 2016, Sec. 3.2.  Crease i turns everything behind it about the ruling through the centreline point
m_i; quads are rigid.  So rotations are a running product, centreline points a running sum, and a
derivative is a suffix sum of force and torque over what a crease moves: O(N), without 4x4 matrices.

A station i = 0..N is a ruling with its ends b_i, t_i and the normal n_i of the quad behind it (n_N:
behind the end crease).  The *station table* (4 (N+1), 3) has four rows a station:
(c_i, beta_i, 0), b_i, t_i, n_i.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import isqrt

import numpy as np

from casashell.ribbon.ribbon import Ribbon, RibbonState
from casashell.typing import FloatArray

#: Rows of a station in the table.
COORDINATES, BOTTOM, TOP, NORMAL = 0, 1, 2, 3


@dataclass(frozen=True, eq=False)
class Strip:
    """A reconstructed ribbon; N+1 stations.

    slopes, angles  c, beta (N+1,)
    before, behind  (N+1,3,3) axes of the quads before and behind each station
    middle          (N+1,3) centreline points m_i
    bottom, top     (N+1,3) ends of the rulings; normals (N,3) of the quads
    table           (4 (N+1), 3), see the module
    """

    width: float
    slopes: FloatArray
    angles: FloatArray
    before: FloatArray
    behind: FloatArray
    middle: FloatArray

    @cached_property
    def arms(self) -> FloatArray:
        """(N+1,3) from the centreline to the top end of each ruling; also (W/2) e_x in the world."""
        return (
            0.5 * self.width * (self.slopes[:, None] * self.before[:, :, 0] + self.before[:, :, 1])
        )

    @cached_property
    def table(self) -> FloatArray:
        """The station table."""
        made = np.zeros((len(self.slopes), 4, 3))
        made[:, COORDINATES, 0], made[:, COORDINATES, 1] = self.slopes, self.angles
        made[:, BOTTOM], made[:, TOP] = self.middle - self.arms, self.middle + self.arms
        made[:, NORMAL] = self.behind[:, :, 2]
        return made.reshape(-1, 3)

    @property
    def bottom(self) -> FloatArray:
        """b (N+1,3) [m]."""
        return self.table[BOTTOM::4]

    @property
    def top(self) -> FloatArray:
        """t (N+1,3) [m]."""
        return self.table[TOP::4]

    @property
    def normals(self) -> FloatArray:
        """n (N,3)."""
        return self.table[NORMAL::4][:-1]

    @cached_property
    def spins(self) -> FloatArray:
        """(N+1,2,3) angular velocity of all behind a crease, for unit rates of c and beta."""
        local = _local_spins(self.slopes, self.angles)
        return np.asarray(np.einsum("iab,ikb->ika", self.before, local))

    @cached_property
    def slide(self) -> FloatArray:
        """(N+1,3) how the top end of a ruling moves with its own c; the bottom end opposite."""
        return 0.5 * self.width * self.before[:, :, 0]


def _local_spins(c: FloatArray, beta: FloatArray) -> FloatArray:
    """Angular velocities (N+1,2,3) in the axes before the crease.

    beta turns about the ruling d; c turns d itself: sin(beta) d' + (1 - cos beta) d x d'.
    """
    root = 1.0 / np.sqrt(1.0 + c * c)
    sine, turn = np.sin(beta) * root**3, (1.0 - np.cos(beta)) * root**2
    made = np.zeros((len(c), 2, 3))
    made[:, 0, 0], made[:, 0, 1], made[:, 0, 2] = sine, -c * sine, -turn
    made[:, 1, 0], made[:, 1, 1] = c * root, root
    return made


def crease_rotations(c: FloatArray, beta: FloatArray) -> FloatArray:
    """(n,3,3) rotation by beta about the unit vector along (c, 1, 0)."""
    root = 1.0 / np.sqrt(1.0 + c * c)
    a, b = c * root, root
    sine, turn = np.sin(beta), 2.0 * np.sin(0.5 * beta) ** 2
    made = np.empty((len(c), 3, 3))
    made[:, 0, 0], made[:, 0, 1], made[:, 0, 2] = 1 - b * b * turn, a * b * turn, b * sine
    made[:, 1, 0], made[:, 1, 1], made[:, 1, 2] = a * b * turn, 1 - a * a * turn, -a * sine
    made[:, 2, 0], made[:, 2, 1], made[:, 2, 2] = -b * sine, a * sine, 1 - turn
    return made


def running_products(first: FloatArray, factors: FloatArray) -> FloatArray:
    """first, first f_0, first f_0 f_1, ... (n+1,3,3), in blocks of sqrt(n) side by side."""
    n = len(factors)
    size = max(1, isqrt(n))
    blocks = -(-n // size)
    padded = np.empty((blocks * size, 3, 3))
    padded[:n], padded[n:] = factors, np.eye(3)
    within = padded.reshape(blocks, size, 3, 3)
    for j in range(1, size):
        within[:, j] = within[:, j - 1] @ within[:, j]
    starts = np.empty((blocks, 3, 3))
    starts[0] = first
    for k in range(1, blocks):
        starts[k] = starts[k - 1] @ within[k - 1, -1]
    made = np.empty((n + 1, 3, 3))
    made[0] = first
    made[1:] = (starts[:, None] @ within).reshape(-1, 3, 3)[:n]
    return made


def strip(
    length: float,
    width: float,
    c: FloatArray,
    beta: FloatArray,
    frame: FloatArray,
    origin: FloatArray,
) -> Strip:
    """The strip with slopes c and angles beta (N+1,) at all stations; ``frame`` and ``origin`` place it."""
    axes = running_products(frame, crease_rotations(c, beta))
    middle = np.empty((len(c), 3))
    middle[0] = origin
    middle[1:] = origin + np.cumsum(length / (len(c) - 1) * axes[1:-1, :, 0], axis=0)
    return Strip(width, c, beta, axes[:-1], axes[1:], middle)


def reconstruct(ribbon: Ribbon, state: RibbonState) -> Strip:
    """The strip which ``state`` describes."""
    return strip(
        ribbon.length, ribbon.width, state.all_slopes, state.all_angles, state.frame, state.origin
    )


@dataclass(frozen=True, eq=False)
class Pull:
    """Derivative of an energy by the coordinates of a strip.

    creases  (N+1,2) by c and beta
    force    (3,) by a displacement of the whole strip
    torque   (3,) by a rotation of the whole strip about its first centreline point
    """

    creases: FloatArray
    force: FloatArray
    torque: FloatArray


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """a x b along the last axis; three times faster than NumPy's for long arrays."""
    made = np.empty(np.broadcast_shapes(a.shape, b.shape))
    made[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    made[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    made[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return made


def suffix(a: FloatArray) -> FloatArray:
    """Sum over all later entries of the first axis, itself not included; one row more in front.

    Row 0 is the sum of all, row i + 1 the sum behind entry i.
    """
    made = np.zeros((len(a) + 1, *a.shape[1:]))
    made[:-1] = np.cumsum(a[::-1], axis=0)[::-1]
    return made


def pull_back(shape: Strip, gradient: FloatArray) -> Pull:
    """Adjoint of the reconstruction: ``gradient`` (4 (N+1), 3) by the station table."""
    g = gradient.reshape(-1, 4, 3)
    bottom, top = g[:, BOTTOM], g[:, TOP]
    both, apart = bottom + top, top - bottom
    forces = suffix(both)
    centre = shape.middle - shape.middle[0]
    points = cross(centre, both) + cross(shape.arms, apart)
    turned = suffix(cross(shape.behind[:, :, 2], g[:, NORMAL]))
    torques = suffix(points)
    # Points on a crease do not move with it, the normal behind it does.
    moment = torques[1:] + turned[:-1] - cross(centre, forces[1:])
    creases = g[:, COORDINATES, :2] + np.einsum("ika,ia->ik", shape.spins, moment)
    creases[:, 0] += np.einsum("ia,ia->i", shape.slide, apart)
    return Pull(creases, forces[0], torques[0] + turned[0])
