"""Closest points of many pairs of small convex sets: vertex and triangle, segment and segment.

The squared distance is a convex quadratic over the barycentric weights, so its minimum is either
its stationary point, if that lies inside, or a minimum on the boundary: an end point against a
segment.  All of these are computed and the smallest is kept, which stays correct for parallel
segments and for triangles without area.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from casashell.typing import FloatArray

#: weights of the closest point in the first set (N,a) and in the second (N,b), each summing to 1
Weights: TypeAlias = tuple[FloatArray, FloatArray]

# squared sine of the angle between two edges below which they count as parallel
_PARALLEL = 1e-12


def vertex_triangle(first: FloatArray, second: FloatArray) -> Weights:
    """Closest points of vertices ``first`` (N,1,3) and triangles ``second`` (N,3,3)."""
    point = first[:, 0]
    one = np.ones((len(point), 1))
    a, ab, ac = second[:, 0], second[:, 1] - second[:, 0], second[:, 2] - second[:, 0]
    ap = point - a
    m11, m12, m22 = _dot(ab, ab), _dot(ab, ac), _dot(ac, ac)
    r1, r2 = _dot(ab, ap), _dot(ac, ap)
    determinant = m11 * m22 - m12 * m12
    flat = determinant <= _PARALLEL * m11 * m22
    scale = np.where(flat, 1.0, determinant)
    u, v = (m22 * r1 - m12 * r2) / scale, (m11 * r2 - m12 * r1) / scale
    inside = ~flat & (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0)
    weights = np.stack([1.0 - u - v, u, v], axis=1)
    rows = np.flatnonzero(~inside)
    weights[rows] = _on_boundary(point[rows], second[rows])
    return one, weights


def segment_segment(first: FloatArray, second: FloatArray) -> Weights:
    """Closest points of segments ``first`` (N,2,3) and ``second`` (N,2,3)."""
    p, q = first[:, 1] - first[:, 0], second[:, 1] - second[:, 0]
    offset = second[:, 0] - first[:, 0]
    pp, pq, qq = _dot(p, p), _dot(p, q), _dot(q, q)
    rp, rq = _dot(p, offset), _dot(q, offset)
    determinant = pp * qq - pq * pq
    flat = determinant <= _PARALLEL * pp * qq
    scale = np.where(flat, 1.0, determinant)
    s, t = (qq * rp - pq * rq) / scale, (pq * rp - pp * rq) / scale
    inside = ~flat & (s >= 0.0) & (s <= 1.0) & (t >= 0.0) & (t <= 1.0)
    rows = np.flatnonzero(~inside)
    s[rows], t[rows] = _at_an_end(first[rows], second[rows])
    return np.stack([1.0 - s, s], axis=1), np.stack([1.0 - t, t], axis=1)


def combine(weights: FloatArray, points: FloatArray) -> FloatArray:
    """Weighted sums (N,3) of points (N,k,3) with weights (N,k)."""
    result: FloatArray = np.matmul(weights[:, None, :], points)[:, 0]
    return result


def _on_boundary(point: FloatArray, triangle: FloatArray) -> FloatArray:
    """Weights (N,3) of the point of the three sides that is nearest."""
    count = len(point)
    best = np.full(count, np.inf)
    weights = np.zeros((count, 3))
    for start in range(3):
        end = (start + 1) % 3
        share, squared = _to_segment(point, triangle[:, start], triangle[:, end])
        nearer = squared < best
        best = np.where(nearer, squared, best)
        rows = np.flatnonzero(nearer)
        weights[rows] = 0.0
        weights[rows, start] = 1.0 - share[rows]
        weights[rows, end] = share[rows]
    return weights


def _at_an_end(first: FloatArray, second: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Parameters (N,), (N,) of the nearest pair in which one point is an end of its segment."""
    best = np.full(len(first), np.inf)
    s, t = np.zeros(len(first)), np.zeros(len(first))
    for end in (0, 1):
        share, squared = _to_segment(first[:, end], second[:, 0], second[:, 1])
        nearer = squared < best
        s, t = np.where(nearer, float(end), s), np.where(nearer, share, t)
        best = np.where(nearer, squared, best)
        share, squared = _to_segment(second[:, end], first[:, 0], first[:, 1])
        nearer = squared < best
        s, t = np.where(nearer, share, s), np.where(nearer, float(end), t)
        best = np.where(nearer, squared, best)
    return s, t


def _to_segment(
    point: FloatArray, start: FloatArray, end: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Parameter (N,) of the nearest point of a segment and the squared distance (N,) to it."""
    along, arm = end - start, point - start
    length = _dot(along, along)
    share = np.clip(_dot(along, arm) / np.where(length > 0.0, length, 1.0), 0.0, 1.0)
    rest = arm - share[:, None] * along
    return share, _dot(rest, rest)


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    result: FloatArray = np.einsum("ni,ni->n", a, b)
    return result
