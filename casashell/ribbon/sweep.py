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
# Passes after which only pairs that are close in one plane at some time are followed further, and
# passes after which those are reported as impacts.
_PASSES, _LAST_PASS = 40, 1000
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


def approaches(pairs: Pairs, start: FloatArray, end: FloatArray, level: FloatArray) -> Approach:
    """The pairs that come within ``level`` (P,) [m] on the straight way from start to end (V,3).

    Every pair must be apart at the start; one that starts below its level counts as arrived when
    its distance falls below 0.9 of what it was.
    """
    closest = _closest(pairs)
    one, two = start[pairs.first], start[pairs.second]
    one_move, two_move = end[pairs.first] - one, end[pairs.second] - two
    time, level = np.zeros(len(pairs)), level.copy()
    alive = np.arange(len(pairs))
    found: list[tuple[IntArray, FloatArray, FloatArray]] = []
    for number in range(_LAST_PASS):
        if number == _PASSES:
            alive = alive[_may_cross(pairs.subset(alive), start, end, level[alive])]
        if alive.size == 0:
            break
        at = time[alive, None, None]
        a, b = one[alive] + at * one_move[alive], two[alive] + at * two_move[alive]
        signed, normal, distance = _gap(closest(a, b), a, b)
        if number == 0:
            level = np.minimum(level, _SHARE * distance)
        here = level[alive]
        gaps = _along(b, normal)[:, None, :] - _along(a, normal)[:, :, None] - here[:, None, None]
        speed = _along(one_move[alive], normal)[:, :, None]
        speed = speed - _along(two_move[alive], normal)[:, None, :]
        closing = speed > 0.0
        ahead = np.where(closing, np.maximum(gaps, 0.0) / np.where(closing, speed, 1.0), np.inf)
        arrived = distance <= here * (1.0 + _SLACK)
        arrived |= number == _LAST_PASS - 1
        rows = alive[arrived]
        found.append((rows, signed[arrived], normal[arrived]))
        time[alive] += np.where(arrived, 0.0, ahead.min(axis=(1, 2)))
        alive = alive[~arrived & (time[alive] <= 1.0)]
    if not found:
        return Approach(np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 4)), np.zeros((0, 3)))
    rows = np.concatenate([part[0] for part in found])
    weights = np.concatenate([part[1] for part in found])
    return Approach(rows, time[rows], weights, np.concatenate([part[2] for part in found]))


def _may_cross(pairs: Pairs, start: FloatArray, end: FloatArray, level: FloatArray) -> BoolArray:
    """Pairs (P,) that are closer than ``level`` (P,) [m] when their four vertices are coplanar.

    The volume of the tetrahedron is a cubic in time (Provot 1997).  Two parts can pass through each
    other only at one of its roots; its turning points stand for double roots lost to rounding.
    """
    ids = pairs.vertices
    ways = start[ids], end[ids] - start[ids]
    at = [ways[0] + time * ways[1] for time in _THIRDS]
    volumes = np.stack([np.linalg.det(x[:, 1:] - x[:, :1]) for x in at])
    cubics = np.linalg.solve(np.vander(_THIRDS), volumes).T
    close = np.zeros(len(pairs), dtype=np.bool_)
    for number, cubic in enumerate(cubics):
        times = np.concatenate([np.roots(cubic), np.roots(np.polyder(cubic))]).real
        for time in times[(times > -1e-9) & (times < 1.0 + 1e-9)]:
            one = pairs.subset(slice(number, number + 1))
            distance = separations(one, start + time * (end - start))[2]
            close[number] |= distance[0] < level[number]
    return close


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
