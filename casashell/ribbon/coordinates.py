"""Unknowns of a ribbon, z = (slopes, angles[, t, w]), and what they are for the strip.

slopes  increments delta_i = c_i - c_{i-1}, i = 1..N-1, which turns all but one of the conditions that
        rulings do not cross into a box (Pan 2016, Sec. 4); or c_i themselves
angles  beta_i of every station that bends
t, w    translation / length and three angles of a ribbon that floats, on top of a base frame
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from casashell.ribbon.chain import Strip, strip
from casashell.ribbon.composite import Placed
from casashell.ribbon.ribbon import MOST_BENT, Ribbon, RibbonState
from casashell.typing import FloatArray, IntArray

#: Limit of the second angle of a floating frame [rad]: at a right angle the other two are the same.
MOST_TURNED = 1.4


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Unknowns of ``ribbon``; frame and origin are those of ``base``, or move from there.

    floating    t and w are unknowns; w stays within `MOST_TURNED` of the base
    increments  slopes as delta; False: as c
    """

    ribbon: Ribbon
    base: RibbonState
    floating: bool = False
    increments: bool = True

    def __post_init__(self) -> None:
        self.base.checked(self.ribbon)

    @cached_property
    def bends(self) -> IntArray:
        """Stations with an angle among the unknowns."""
        return np.flatnonzero(self.ribbon.bends)

    @property
    def creases(self) -> int:
        """Number of slopes, N - 1."""
        return self.ribbon.segments - 1

    @property
    def size(self) -> int:
        """n, length of z."""
        return self.creases + len(self.bends) + (6 if self.floating else 0)

    def pack(self, state: RibbonState) -> FloatArray:
        """z of ``state``; a floating one's frame and origin count from the base."""
        c = state.all_slopes
        slopes = np.diff(c)[:-1] if self.increments else c[1:-1]
        parts = [slopes, state.all_angles[self.bends]]
        if self.floating:
            turn = Rotation.from_matrix(state.frame @ self.base.frame.T).as_euler("XYZ")
            parts += [(state.origin - self.base.origin) / self.ribbon.length, turn]
        return np.concatenate(parts)

    def _split(self, z: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """c and beta (N+1,), frame (3,3), origin (3,)."""
        n, m = self.creases, len(self.bends)
        c, beta = np.zeros(n + 2), np.zeros(n + 2)
        c[1:-1] = np.cumsum(z[:n]) if self.increments else z[:n]
        beta[self.bends] = z[n : n + m]
        if not self.floating:
            return c, beta, self.base.frame, self.base.origin
        frame = turning(z[-3:])[0] @ self.base.frame
        return c, beta, frame, self.base.origin + self.ribbon.length * z[-6:-3]

    def state(self, z: FloatArray) -> RibbonState:
        """The state which z describes."""
        c, beta, frame, origin = self._split(z)
        return RibbonState(c[1:-1], beta[1:-1], frame, origin, float(beta[0]), float(beta[-1]))

    def strip(self, z: FloatArray) -> Strip:
        """The strip at z."""
        return strip(self.ribbon.length, self.ribbon.width, *self._split(z))

    def placed(self, z: FloatArray, shape: Strip | None = None) -> Placed:
        """The strip at z with the rotations of the whole about its first centreline point."""
        shape = self.strip(z) if shape is None else shape
        turns = turning(z[-3:])[1] if self.floating else np.eye(3)
        return Placed(shape, shape.middle[0], turns)

    @cached_property
    def _places(self) -> IntArray:
        """Where the unknowns are among (t, w, c_0, beta_0, c_1, ...)."""
        inner = np.arange(1, self.ribbon.segments)
        base = np.arange(6 if self.floating else 0)
        return np.concatenate([6 + 2 * inner, 7 + 2 * self.bends, base])

    def rows(self, full: FloatArray) -> FloatArray:
        """Derivatives (..., 6 + 2 (N+1)) by the coordinates of the strip, as ones by z (..., n)."""
        made = full[..., self._places]
        n = self.creases
        if self.increments:
            made[..., :n] = np.cumsum(made[..., :n][..., ::-1], axis=-1)[..., ::-1]
        if self.floating:
            made[..., -6:-3] *= self.ribbon.length
        return made

    def hessian(self, full: FloatArray) -> FloatArray:
        """(n,n) by z of a symmetric matrix by the coordinates of the strip."""
        made = full[np.ix_(self._places, self._places)]
        n = self.creases
        if self.increments:
            made[:n] = np.cumsum(made[n - 1 :: -1], axis=0)[::-1]
            made[:, :n] = np.cumsum(made[:, n - 1 :: -1], axis=1)[:, ::-1]
        if self.floating:
            made[-6:-3] *= self.ribbon.length
            made[:, -6:-3] *= self.ribbon.length
        return made

    @cached_property
    def lower(self) -> FloatArray:
        """Lower bounds of z."""
        return -self.upper

    @cached_property
    def upper(self) -> FloatArray:
        """Upper bounds of z."""
        made = np.full(self.size, np.inf)
        n, m = self.creases, len(self.bends)
        if self.increments:
            made[:n] = self.ribbon.most_turn
        made[n : n + m] = MOST_BENT
        if self.floating:
            made[-2] = MOST_TURNED
        return made

    @cached_property
    def matrix(self) -> FloatArray:
        """A of the conditions A z <= ``bound`` that the box leaves: two, or 2 N without increments."""
        n = self.creases
        each = np.diff(np.eye(n), axis=0, prepend=0, append=0)
        turn = np.ones((1, n)) if self.increments else each
        made = np.zeros((2 * len(turn), self.size))
        made[: len(turn), :n], made[len(turn) :, :n] = turn, -turn
        return made

    @cached_property
    def bound(self) -> FloatArray:
        """b of those conditions."""
        return np.full(len(self.matrix), self.ribbon.most_turn)


def turning(angles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotation (3,3) by angles [rad] about x, the turned y and the turned z axis; these axes as rows.

    Joints in series: a later one is carried by those before it.
    """
    cosine, sine = np.cos(angles), np.sin(angles)
    x = np.array([[1, 0, 0], [0, cosine[0], -sine[0]], [0, sine[0], cosine[0]]])
    y = np.array([[cosine[1], 0, sine[1]], [0, 1, 0], [-sine[1], 0, cosine[1]]])
    z = np.array([[cosine[2], -sine[2], 0], [sine[2], cosine[2], 0], [0, 0, 1]])
    first = x @ y
    return first @ z, np.stack([x[:, 0], x[:, 1], first[:, 2]])
