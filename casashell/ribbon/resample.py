"""Former shapes of a ribbon at the material points which its vertices occupy now (Pan 2016, Sec. 4).

A rim of a former shape is an interpolant of world positions over the material abscissa
s = i l -+ c_i W/2.  "linear" is the paper's; it has kinks at the knots, where every step starts, and
methods with second derivatives fail on them.  "hermite" is smooth to first order.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal, TypeAlias

import casadi as ca
import numpy as np

from casashell.ribbon.chain import COORDINATES
from casashell.ribbon.physics import RibbonPhysics
from casashell.typing import FloatArray

Resample: TypeAlias = Literal["linear", "hermite"]


@lru_cache(maxsize=64)
def _mapped(piece: ca.Function, count: int) -> ca.Function:
    return piece.map(count)


def abscissae(length: float, width: float, slopes: FloatArray) -> FloatArray:
    """(2,N+1) [m] where the ends of the rulings are on the bottom and top rim."""
    middle = np.linspace(0.0, length, len(slopes))
    run = 0.5 * width * slopes
    return np.stack([middle - run, middle + run])


@dataclass(frozen=True, eq=False)
class Rims:
    """World positions of both rims of a former shape.

    knots   (2,N+1) [m] material abscissae, increasing
    points  (2,N+1,3) [m]
    piece   CasADi function: 4 knots, their values (3,4) -> coefficients (3,4) between the middle two
    """

    knots: FloatArray
    points: FloatArray
    piece: ca.Function

    @cached_property
    def pieces(self) -> FloatArray:
        """(2,N,13) left knot and coefficients of each interval."""
        knots, points = self.knots, self.points
        k = np.concatenate(
            [2 * knots[:, :1] - knots[:, 1:2], knots, 2 * knots[:, -1:] - knots[:, -2:-1]], axis=1
        )
        y = np.concatenate(
            [2 * points[:, :1] - points[:, 1:2], points, 2 * points[:, -1:] - points[:, -2:-1]],
            axis=1,
        )
        n = knots.shape[1] - 1
        window = np.arange(n)[:, None] + np.arange(4)
        s = k[:, window].reshape(-1, 4).T
        values = y[:, window].reshape(-1, 3).T
        found = np.asarray(_mapped(self.piece, 2 * n)(s, values)).reshape(3, 2 * n, 4)
        made = np.empty((2, n, 13))
        made[:, :, 0] = knots[:, :-1]
        made[:, :, 1:] = found.transpose(1, 2, 0).reshape(2, n, 12)
        return made

    def of(self, s: FloatArray) -> FloatArray:
        """(2,N+1,13) pieces that hold the abscissae s (2,N+1); the outer ones go on."""
        made = np.empty((*s.shape, 13))
        for rim in (0, 1):
            where = np.searchsorted(self.knots[rim], s[rim], side="right") - 1
            made[rim] = self.pieces[rim][np.clip(where, 0, self.knots.shape[1] - 2)]
        return made

    def at(self, s: FloatArray) -> FloatArray:
        """(2,N+1,3) [m] positions at the abscissae s (2,N+1)."""
        p = self.of(s)
        u = (s - p[..., 0])[..., None]
        a = p[..., 1:].reshape(*s.shape, 4, 3)
        value: FloatArray = a[..., 0, :] + u * (
            a[..., 1, :] + u * (a[..., 2, :] + u * a[..., 3, :])
        )
        return value


@dataclass(frozen=True, eq=False)
class History:
    """Parameters of the consistent inertia: the two former shapes that a step reads.

    now, before  the rims of x^n and x^{n-1}
    head         (5,) rho, l, W, h and 0
    """

    length: float
    now: Rims
    before: Rims
    head: FloatArray

    def __call__(self, table: FloatArray) -> FloatArray:
        """(N,109) for the quads of the station table."""
        slopes = table[COORDINATES::4, 0]
        n, width = len(slopes) - 1, float(self.head[2])
        s = abscissae(self.length, width, slopes)
        each = np.concatenate([self.now.of(s), self.before.of(s)], axis=2)
        made = np.empty((n, 5 + 4 * 26))
        made[:, :5] = self.head
        made[:, 4] = np.arange(n) * (self.length / n)
        for vertex, (rim, shift) in enumerate(((0, 0), (0, 1), (1, 0), (1, 1))):
            made[:, 5 + 26 * vertex : 31 + 26 * vertex] = each[rim, shift : n + shift]
        return made


def piece_of(physics: RibbonPhysics, resample: Resample) -> ca.Function:
    """The interpolant's piece; ValueError for an unknown name."""
    pieces = {"linear": physics.linear_piece, "hermite": physics.hermite_piece}
    if resample not in pieces:
        raise ValueError(f"resample must be 'linear' or 'hermite', got {resample!r}")
    return pieces[resample]
