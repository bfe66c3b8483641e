"""Which faces of a mesh pass through each other.

Broad phase: a binary tree of boxes over the faces in Morton order (Karras 2012 without the GPU),
walked against itself one level at a time.  Narrow phase: an edge of one face crosses the plane of
the other strictly, and does so inside it; coplanar faces are told apart by separating axes.
Faces that only touch (a common corner or edge, an open seam) do not count, so neighbours need no
special treatment.
"""

from __future__ import annotations

import numpy as np

from casashell.typing import ArrayLike, BoolArray, FloatArray, IntArray

# Touching means closer than this times the diagonal of the bounding box: far above rounding
# (1e-16), far below what a file with 6 or 7 digits can state.
TOUCH_TOLERANCE = 1e-10
_CHUNK = 200_000  # pairs tested at once: bounds the memory to some 100 MB


def self_intersections(vertices: ArrayLike, faces: ArrayLike) -> IntArray:
    """Pairs of faces that cross or overlap, (N,2) with f < g in lexicographic order.

    vertices: (V,3).  faces: (F,3).  Faces with the same three vertices are duplicates, not
    intersections, and are left out; faces without area can be crossed only along their edges.
    """
    points = np.asarray(vertices, dtype=np.float64)
    triangles = np.asarray(faces, dtype=np.int64)
    corners = points[triangles]
    low, high = corners.min(axis=1), corners.max(axis=1)
    middle = 0.5 * (low.min(axis=0) + high.max(axis=0))
    tolerance = TOUCH_TOLERANCE * float(np.linalg.norm(high.max(axis=0) - low.min(axis=0)))
    pairs = overlapping_boxes(low, high)
    same = np.sort(triangles, axis=1)
    pairs = pairs[(same[pairs[:, 0]] != same[pairs[:, 1]]).any(axis=1)]
    corners = corners - middle  # rounding grows with the distance from the origin
    found = [
        chunk[_faces_cross(corners[chunk[:, 0]], corners[chunk[:, 1]], tolerance)]
        for chunk in np.array_split(pairs, len(pairs) // _CHUNK + 1)
    ]
    result = np.concatenate(found)
    return result[np.lexsort(result.T[::-1])]


def overlapping_boxes(low: FloatArray, high: FloatArray) -> IntArray:
    """All pairs i < j of boxes ``[low, high]`` (N,3) that meet, in no particular order."""
    count = len(low)
    order = _morton_order(0.5 * (low + high))
    leaves = 1 << max(count - 1, 0).bit_length()
    empty = np.full((leaves - count, 3), np.inf)  # padding meets nothing
    levels = [(np.concatenate([low[order], empty]), np.concatenate([high[order], -empty]))]
    while len(levels[-1][0]) > 1:
        below, above = levels[-1]
        levels.append((np.minimum(below[::2], below[1::2]), np.maximum(above[::2], above[1::2])))
    a = b = np.zeros(1, dtype=np.int64)
    for below, above in levels[-2::-1]:
        same, other = a[a == b], a != b
        p, q = 2 * a[other], 2 * b[other]
        a = np.concatenate([2 * same, 2 * same, 2 * same + 1, p, p, p + 1, p + 1])
        b = np.concatenate([2 * same, 2 * same + 1, 2 * same + 1, q, q + 1, q, q + 1])
        meet = np.ones(len(a), dtype=np.bool_)
        for axis in range(3):
            meet &= (below[a, axis] <= above[b, axis]) & (below[b, axis] <= above[a, axis])
        a, b = a[meet], b[meet]
    apart = a != b
    return np.sort(np.column_stack([order[a[apart]], order[b[apart]]]), axis=1)


def _morton_order(points: FloatArray) -> IntArray:
    """Order along a space-filling curve, 21 bits an axis."""
    extent = np.ptp(points, axis=0).max()
    cells = np.zeros(points.shape, dtype=np.int64)
    if extent > 0:
        cells = ((points - points.min(axis=0)) / extent * (2**21 - 1)).astype(np.int64)
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        cells = (cells | (cells << shift)) & mask
    code = cells[:, 0] | (cells[:, 1] << 1) | (cells[:, 2] << 2)
    return np.argsort(code, kind="stable")


def _faces_cross(a: FloatArray, b: FloatArray, tolerance: float) -> BoolArray:
    """Row by row: do triangles ``a`` and ``b`` (N,3,3) cross or overlap?"""
    normal_a, normal_b = _unit_normals(a), _unit_normals(b)
    side_a = _sides(a, b, normal_b, tolerance)
    side_b = _sides(b, a, normal_a, tolerance)
    cross: BoolArray = np.zeros(len(a), dtype=np.bool_)
    # either triangle wholly on one side of the other's plane: at most touching
    near = np.flatnonzero((_straddles(side_a) | _straddles(side_b)) & ~_beyond(side_a, side_b))
    a_near, b_near = a[near], b[near]
    cross[near] = _edges_pierce(a_near, b_near, normal_b[near], tolerance)
    cross[near] |= _edges_pierce(b_near, a_near, normal_a[near], tolerance)
    flat = (side_a == 0).all(axis=1) & (side_b == 0).all(axis=1)
    flat &= normal_a.any(axis=1) & normal_b.any(axis=1)
    level = np.flatnonzero(flat)
    cross[level] = _overlap_in_plane(a[level], b[level], normal_a[level], tolerance)
    return cross


def _unit_normals(triangles: FloatArray) -> FloatArray:
    """(N,3); zero for a triangle without area."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    unit: FloatArray = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    return unit


def _heights(a: FloatArray, b: FloatArray, normal_b: FloatArray) -> FloatArray:
    """(N,3) signed distance of the corners of ``a`` from the plane of ``b``."""
    heights: FloatArray = np.einsum("nci,ni->nc", a - b[:, :1], normal_b)
    return heights


def _sides(a: FloatArray, b: FloatArray, normal_b: FloatArray, tolerance: float) -> IntArray:
    """(N,3) side of the plane of ``b`` each corner of ``a`` is on: -1, 0 (touching), 1."""
    height = _heights(a, b, normal_b)
    return (height > tolerance).astype(np.int64) - (height < -tolerance)


def _straddles(side: IntArray) -> BoolArray:
    result: BoolArray = (side.min(axis=1) < 0) & (side.max(axis=1) > 0)
    return result


def _beyond(side_a: IntArray, side_b: IntArray) -> BoolArray:
    result: BoolArray = (np.abs(side_a.sum(axis=1)) == 3) | (np.abs(side_b.sum(axis=1)) == 3)
    return result


def _edges_pierce(
    a: FloatArray, b: FloatArray, normal_b: FloatArray, tolerance: float
) -> BoolArray:
    """Does an edge of ``a`` cross the plane of ``b`` strictly, at a point in ``b``?"""
    height = _heights(a, b, normal_b)
    side = np.abs(height) > tolerance
    hit: BoolArray = np.zeros(len(a), dtype=np.bool_)
    for start in range(3):
        end = (start + 1) % 3
        h, k = height[:, start], height[:, end]
        row = np.flatnonzero((h * k < 0) & side[:, start] & side[:, end])
        share = (h[row] / (h[row] - k[row]))[:, None]
        point = a[row, start] + share * (a[row, end] - a[row, start])
        inside = np.ones(len(row), dtype=np.bool_)
        for corner in range(3):
            inward = _inward(b[row, corner], b[row, (corner + 1) % 3], normal_b[row])
            inside &= np.einsum("ni,ni->n", point - b[row, corner], inward) >= -tolerance
        hit[row] |= inside
    return hit


def _inward(start: FloatArray, end: FloatArray, normal: FloatArray) -> FloatArray:
    """Unit vectors in the plane, from an edge into its triangle."""
    across = np.cross(normal, end - start)
    length = np.linalg.norm(across, axis=1, keepdims=True)
    unit: FloatArray = np.divide(across, length, out=np.zeros_like(across), where=length > 0)
    return unit


def _overlap_in_plane(
    a: FloatArray, b: FloatArray, normal: FloatArray, tolerance: float
) -> BoolArray:
    """Separating axes among the six edge normals; touching triangles are separate."""
    overlap: BoolArray = np.ones(len(a), dtype=np.bool_)
    for triangle in (a, b):
        for corner in range(3):
            axis = _inward(triangle[:, corner], triangle[:, (corner + 1) % 3], normal)
            p = np.einsum("nci,ni->nc", a, axis)
            q = np.einsum("nci,ni->nc", b, axis)
            depth = np.minimum(p.max(axis=1) - q.min(axis=1), q.max(axis=1) - p.min(axis=1))
            overlap &= depth > tolerance
    return overlap
