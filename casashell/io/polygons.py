"""Quads and larger polygons cut into triangles.

A quad is cut along its shorter diagonal (0-2 if they are equal to 1e-6) among those that leave two
triangles facing the same way, which settles concave quads.  Larger polygons lose their ears in the
plane of their mean normal, the shortest cut first.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casashell.typing import BoolArray, FloatArray, IntArray

_TIE = 1e-6  # relative: files state some 6 digits, and a regular grid should be cut one way


def triangulated(vertices: FloatArray, polygons: Sequence[Sequence[int]]) -> IntArray:
    """Triangles (F,3) of all polygons in order, n - 2 consecutive ones for each with n corners."""
    size = np.fromiter(map(len, polygons), dtype=np.int64, count=len(polygons))
    first = np.cumsum(size - 2) - (size - 2)
    faces = np.empty((int((size - 2).sum()), 3), dtype=np.int64)
    triangles, quads = np.flatnonzero(size == 3), np.flatnonzero(size == 4)
    if triangles.size:
        faces[first[triangles]] = [polygons[int(p)] for p in triangles]
    if quads.size:
        halves = _split_quads(vertices, np.array([polygons[int(p)] for p in quads], dtype=np.int64))
        faces[first[quads]], faces[first[quads] + 1] = halves[:, 0], halves[:, 1]
    for p in np.flatnonzero(size > 4).tolist():
        faces[first[p] : first[p] + size[p] - 2] = _clip_ears(vertices, list(polygons[p]))
    return faces


def _split_quads(vertices: FloatArray, quads: IntArray) -> IntArray:
    """(N,2,3) triangles of quads (N,4)."""
    cuts = (quads[:, [[0, 1, 2], [0, 2, 3]]], quads[:, [[0, 1, 3], [1, 2, 3]]])
    corner = vertices[quads]
    length = [np.linalg.norm(corner[:, k + 2] - corner[:, k], axis=1) for k in (0, 1)]
    shorter_second = length[1] < (1 - _TIE) * length[0]
    proper = [_agree(vertices, cut) for cut in cuts]
    second = np.where(proper[0] == proper[1], shorter_second, proper[1])
    return np.where(second[:, None, None], cuts[1], cuts[0])


def _agree(vertices: FloatArray, halves: IntArray) -> BoolArray:
    """Do the two triangles of each quad (N,2,3) face the same way?"""
    a, b, c = (vertices[halves[:, :, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    same: BoolArray = np.einsum("ni,ni->n", normal[:, 0], normal[:, 1]) > 0
    return same


def _clip_ears(vertices: FloatArray, polygon: list[int]) -> list[list[int]]:
    """Triangles of one polygon; a fan of what is left where no ear exists (self-crossing)."""
    flat = dict(zip(polygon, _projected(vertices[polygon]), strict=True))
    rest, triangles = list(polygon), []
    while len(rest) > 3:
        length = [
            float(np.linalg.norm(vertices[rest[k - 1]] - vertices[rest[(k + 1) % len(rest)]]))
            for k in range(len(rest))
        ]
        ears = (k for k in np.argsort(length, kind="stable").tolist() if _is_ear(flat, rest, k))
        k = next(ears, 1)  # cutting at 1 again and again is a fan around rest[0]
        triangles.append([rest[k - 1], rest[k], rest[(k + 1) % len(rest)]])
        del rest[k]
    return [*triangles, rest]


def _projected(points: FloatArray) -> FloatArray:
    """(n,2) coordinates in the plane across the vector area, counter-clockwise."""
    centred = points - points.mean(axis=0)
    normal = np.cross(centred, np.roll(centred, -1, axis=0)).sum(axis=0)
    length = np.linalg.norm(normal)
    normal = normal / length if length > 0 else np.array([0.0, 0.0, 1.0])
    first = np.cross(np.eye(3)[int(np.argmin(np.abs(normal)))], normal)
    first /= np.linalg.norm(first)
    return np.column_stack([centred @ first, centred @ np.cross(normal, first)])


def _is_ear(flat: dict[int, FloatArray], rest: list[int], k: int) -> bool:
    """Is the corner convex and its triangle free of other corners?"""
    ids = (rest[k - 1], rest[k], rest[(k + 1) % len(rest)])
    a, b, c = (flat[i] for i in ids)
    if _cross(b - a, c - b) <= 0:
        return False
    others = [flat[i] for i in rest if i not in ids]
    p = np.array(others)
    inside = (_cross(b - a, p - a) >= 0) & (_cross(c - b, p - b) >= 0) & (_cross(a - c, p - c) >= 0)
    return not inside.any()


def _cross(u: FloatArray, v: FloatArray) -> FloatArray:
    product: FloatArray = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
    return product
