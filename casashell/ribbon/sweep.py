"""Continuous detection: when do two moving parts first come within a given distance?

Conservative advancement along separating slabs.  Let n point from the closest point of part A to
that of part B.  While n is held fixed the gap of a vertex pair changes linearly, and

    distance(t + dt) >= min over vertices a, b of  n.(x_b - x_a) - dt n.(v_a - v_b),

because both parts are convex hulls of their vertices.  Each pass moves on by the largest dt for
which this bound stays at the wanted level.  No impact can be missed, parallel and degenerate pairs
need no special treatment, and parts that slide along each other cost one pass.
Parts that turn closely around each other creep; those are sorted out by the times at which they
are coplanar.  Compare Mirtich
1996 (conservative advancement) and Li, Kaufman, Jiang 2021 (additive CCD), whose bounds ignore
the direction.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from casashell.ribbon.bodies import Pairs
from casashell.ribbon.closest import Weights, combine, segment_segment, vertex_triangle
from casashell.typing import BoolArray, FloatArray, IntArray

# A pair closer than the level times 1 + _SLACK has arrived.
_SLACK = 0.05
# A pair that starts below its level is watched at this share of its own distance instead.
_SHARE = 0.9
# Passes after which the pairs that still creep are sorted out, and bisections used for that.
_PASSES, _BISECTIONS = 40, 30
_THIRDS = np.linspace(0.0, 1.0, 4)


@dataclass(frozen=True, eq=False)
class Approach:
    """Pairs that reach their level, with the state at that time.

    rows     (C,) numbers of the pairs
    time     (C,) in [0, 1]
    weights  (C,4) barycentric, negative for the first part, positive for the second; sum 0
    normal   (C,3) unit, from the first part to the second
    """

    rows: IntArray
    time: FloatArray
    weights: FloatArray
    normal: FloatArray


@dataclass(frozen=True, eq=False)
class _Ways:
    """Straight ways of P pairs from time 0 to 1."""

    pairs: Pairs
    start: FloatArray
    end: FloatArray

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Both parts (P,a,3), (P,b,3) at times (P,)."""
        t = time[:, None, None]
        first, second = self.pairs.first, self.pairs.second
        a, b = self.start[first], self.start[second]
        return a + t * (self.end[first] - a), b + t * (self.end[second] - b)

    def gap(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Signed weights, unit normals and distances at times (P,)."""
        a, b = self.at(time)
        return _gap(_closest(self.pairs)(a, b), a, b)

    def subset(self, rows: IntArray) -> _Ways:
        return _Ways(self.pairs.subset(rows), self.start, self.end)


def approaches(pairs: Pairs, start: FloatArray, end: FloatArray, level: FloatArray) -> Approach:
    """The pairs that come within ``level`` (P,) [m] on the straight way from start to end (V,3).

    Every pair must be apart at the start; one that starts below its level counts as arrived when
    its distance falls below 0.9 of what it was.
    """
    every = _Ways(pairs, start, end)
    time = np.zeros(len(pairs))
    level = np.minimum(level, _SHARE * every.gap(time)[2])
    alive = np.arange(len(pairs))
    found = [np.zeros(0, dtype=np.int64)]
    for _ in range(_PASSES):
        if alive.size == 0:
            break
        ahead, arrived = _advance(every.subset(alive), time[alive], level[alive])
        found.append(alive[arrived])
        time[alive] += ahead
        alive = alive[~arrived & (time[alive] <= 1.0)]
    if alive.size:
        time[alive] = _late(every.subset(alive), time[alive], level[alive])
        found.append(alive[time[alive] <= 1.0])
    rows = np.concatenate(found)
    weights, normal, _ = every.subset(rows).gap(time[rows])
    return Approach(rows, time[rows], weights, normal)


def _advance(ways: _Ways, time: FloatArray, level: FloatArray) -> tuple[FloatArray, BoolArray]:
    """How far (P,) time may go on from ``time`` (P,), and which pairs have arrived (P,)."""
    a, b = ways.at(time)
    _, normal, distance = _gap(_closest(ways.pairs)(a, b), a, b)
    pairs, move = ways.pairs, ways.end - ways.start
    gaps = _along(b, normal)[:, None, :] - _along(a, normal)[:, :, None] - level[:, None, None]
    speed = _along(move[pairs.first], normal)[:, :, None]
    speed = speed - _along(move[pairs.second], normal)[:, None, :]
    closing = speed > 0.0
    ahead = np.where(closing, np.maximum(gaps, 0.0) / np.where(closing, speed, 1.0), np.inf)
    arrived = distance <= level * (1.0 + _SLACK)
    return np.where(arrived, 0.0, ahead.min(axis=(1, 2))), arrived


def _late(ways: _Ways, time: FloatArray, level: FloatArray) -> FloatArray:
    """Impact times (P,) of pairs that creep, infinite for those that neither cross nor end close.

    The volume of the tetrahedron of the four vertices is a cubic in time (Provot 1997), and parts
    can pass through each other only at a root of it; its turning points stand for double roots
    that rounding loses.  Bisection between ``time`` and the first root, or the end, at which the
    parts are within ``level`` finds where they reach it.
    """
    at = [np.concatenate(ways.at(np.full(len(time), third)), axis=1) for third in _THIRDS]
    volumes = np.stack([np.linalg.det(x[:, 1:] - x[:, :1]) for x in at])
    cubics = np.linalg.solve(np.vander(_THIRDS), volumes).T
    high = np.full(len(time), np.inf)
    for row, cubic in enumerate(cubics):
        roots = np.concatenate([np.roots(cubic), np.roots(np.polyder(cubic)), [1.0]]).real
        roots = roots[(roots > time[row]) & (roots <= 1.0)]
        close = ways.subset(np.full(len(roots), row)).gap(roots)[2] < level[row]
        high[row] = roots[close].min(initial=np.inf)
    rows = np.flatnonzero(np.isfinite(high))
    low, ways, level = time[rows], ways.subset(rows), level[rows]
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high[rows])
        apart = ways.gap(middle)[2] > level
        low = np.where(apart, middle, low)
        high[rows] = np.where(apart, high[rows], middle)
    high[rows] = low
    return high


def separations(pairs: Pairs, at: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Signed weights (P,4), unit normals (P,3) and distances (P,) at positions (V,3)."""
    a, b = at[pairs.first], at[pairs.second]
    return _gap(_closest(pairs)(a, b), a, b)


def _closest(pairs: Pairs) -> Callable[[FloatArray, FloatArray], Weights]:
    return vertex_triangle if pairs.first.shape[1] == 1 else segment_segment


def _gap(
    weights: Weights, a: FloatArray, b: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Signed weights (N,4), unit direction (N,3) from the closest point of a to that of b, length."""
    arm = combine(weights[1], b) - combine(weights[0], a)
    distance: FloatArray = np.linalg.norm(arm, axis=1)
    normal: FloatArray = arm / np.where(distance > 0.0, distance, 1.0)[:, None]
    return np.concatenate([-weights[0], weights[1]], axis=1), normal, distance


def _along(points: FloatArray, normal: FloatArray) -> FloatArray:
    """Components (N,k) of points (N,k,3) along normals (N,3)."""
    result: FloatArray = np.matmul(points, normal[:, :, None])[:, :, 0]
    return result
