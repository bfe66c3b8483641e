"""Signorini-Coulomb contact of one step, and its natural map.

With delta = d_i - D_i the motion of the vertex over the step against that of the surface under it, and
gap = s + n . delta the gap at the end of the step, less the offset of the vertex:

    open   f = 0, gap >= 0          stick  gap = 0, delta_T = 0, |f_T| <= mu f_N
    slide  gap = 0, f_T = -mu f_N delta_T / |delta_T|

are the zeros of the map of Alart and Curnier (1991, CMAME 92(3)), with p = f_N - rho_N gap and
z = f_T - rho_T delta_T:

    Phi_N = f_N - max(0, p)         Phi_T = f_T - z min(1, mu max(0, p) / |z|)

Nothing is smoothed: sticking is delta_T = 0 exactly.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from casashell.contact.cone import project
from casashell.typing import BoolArray, FloatArray, IntArray

OPEN, STICK, SLIDE = 0, 1, 2


@dataclass(frozen=True, eq=False)
class Touches:
    """Pairs of a vertex and an obstacle that may meet in a step, C of them.

    vertex, body  (C,) ids
    normal        (C,3) unit, at the end of the step
    friction      (C,)
    gap           (C,) m at the end of the step, less the offset, were the vertex carried along
    carried       (C,3) m, motion of the surface over the step
    normal_stiffness, tangent_stiffness  (C,) N/m, rho of the natural map
    first         (C,) True for one touch of every vertex, the one that is eliminated
    """

    vertex: IntArray
    body: IntArray
    normal: FloatArray
    friction: FloatArray
    gap: FloatArray
    carried: FloatArray
    normal_stiffness: FloatArray
    tangent_stiffness: FloatArray
    first: BoolArray

    def __len__(self) -> int:
        return len(self.vertex)

    def gaps(self, d: FloatArray) -> FloatArray:
        """Gap (C,) m at the end of the step for displacements d (V,3)."""
        return np.asarray(self.gap + (self.normal * (d[self.vertex] - self.carried)).sum(axis=1))

    def slips(self, d: FloatArray) -> FloatArray:
        """Tangential motion (C,3) m against the surface."""
        move = d[self.vertex] - self.carried
        return np.asarray(move - (self.normal * move).sum(axis=1)[:, None] * self.normal)

    def only(self, chosen: IntArray) -> Touches:
        """Some of the touches."""
        columns = {entry.name: getattr(self, entry.name)[chosen] for entry in fields(self)}
        return Touches(**columns)

    def spread(self, f: FloatArray, count: int) -> FloatArray:
        """Forces per vertex (V,3) of forces per touch (C,3)."""
        total = np.zeros((count, 3))
        np.add.at(total, self.vertex, f)
        return total


@dataclass(frozen=True, eq=False)
class NaturalMap:
    """Phi (C,3) [N] at (f, d), and P, Q (C,3,3) with dPhi = P df + Q dd; state: the branch (C,).

    along, shrink  (C,3) direction of z, and mu p over its length where a touch slides, else 0
    P and Q are made when they are first asked for: most moves that are tried need the value alone.
    """

    touches: Touches
    value: FloatArray
    state: IntArray
    along: FloatArray
    shrink: FloatArray

    @cached_property
    def by_force(self) -> FloatArray:
        """P (C,3,3)."""
        made = np.zeros((len(self.touches), 3, 3))
        made[self.state == OPEN] = np.eye(3)
        slides = np.flatnonzero(self.state == SLIDE)
        plane, mixed, turn = self._parts(slides)
        made[slides] = plane - turn - mixed
        return made

    @cached_property
    def by_motion(self) -> FloatArray:
        """Q (C,3,3) [N/m]."""
        touches = self.touches
        made = np.zeros((len(touches), 3, 3))
        rho_n, rho_t = touches.normal_stiffness, touches.tangent_stiffness
        for state in (STICK, SLIDE):
            ids = np.flatnonzero(self.state == state)
            plane, mixed, turn = self._parts(ids)
            pressed = np.eye(3) - plane
            if state == SLIDE:
                plane, pressed = turn, pressed + mixed
            made[ids] = rho_n[ids, None, None] * pressed + rho_t[ids, None, None] * plane
        return made

    def _parts(self, ids: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Projector on the plane of the touch, mu t n^T, and shrink (plane - t t^T)."""
        n, t = self.touches.normal[ids], self.along[ids]
        plane = np.eye(3) - n[:, :, None] * n[:, None, :]
        mixed = (self.touches.friction[ids, None] * t)[:, :, None] * n[:, None, :]
        across = plane - t[:, :, None] * t[:, None, :]
        return plane, mixed, self.shrink[ids, None, None] * across


def natural_map(
    touches: Touches, f: FloatArray, d: FloatArray, tried: BoolArray | None = None
) -> NaturalMap:
    """The map and its derivative, that of the sliding direction included.

    tried  (C,) touches to take for sticking, whatever forces and motions say
    """
    n, mu = touches.normal, touches.friction
    rho_n, rho_t = touches.normal_stiffness, touches.tangent_stiffness
    move = d[touches.vertex] - touches.carried
    apart = (n * move).sum(axis=1)
    gap, slip = touches.gap + apart, move - apart[:, None] * n
    f_n = (f * n).sum(axis=1)
    f_t = f - f_n[:, None] * n
    push = f_n - rho_n * gap
    z = f_t - rho_t[:, None] * slip
    size = np.sqrt((z * z).sum(axis=1))
    limit = mu * np.maximum(push, 0.0)
    closed = push > 0.0
    if tried is not None:
        closed = closed | tried
    slides = closed & ((size > limit) | (mu == 0.0))
    if tried is not None:
        slides &= ~tried
    state = np.where(closed, np.where(slides, SLIDE, STICK), OPEN)
    length = np.where(size > 0.0, size, 1.0)
    along = z / length[:, None]
    value = np.where(closed[:, None], (rho_n * gap)[:, None] * n, f)
    stuck = state == STICK
    value[stuck] += rho_t[stuck, None] * slip[stuck]
    value[slides] += (f_t - limit[:, None] * along)[slides]
    shrink = np.where(slides & (size > 0.0), limit / length, 0.0)
    return NaturalMap(touches, value, state, along, shrink)


def contact_residual(touches: Touches, f: FloatArray, d: FloatArray) -> FloatArray:
    """Residual (C,) [N] of Coulomb's law by De Saxce and Feng (1998), another map than is solved.

    |f - P_K(f - rho (delta + mu |delta_T| n))| with the motion delta (its normal part: the gap) and P_K
    the projection onto the friction cone; zero for exact contact and only then.
    """
    if not len(touches):
        return np.zeros(0)
    n = touches.normal
    gap, slip = touches.gaps(d), touches.slips(d)
    rho = touches.tangent_stiffness
    lifted = gap + touches.friction * np.linalg.norm(slip, axis=1)
    tried = f - rho[:, None] * (slip + lifted[:, None] * n)
    return np.asarray(np.linalg.norm(f - project(tried, n, touches.friction), axis=1))
