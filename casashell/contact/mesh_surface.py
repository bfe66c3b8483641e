"""Triangles prepared for signed-distance queries: cleaned, checked, with all pseudonormals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casashell.contact.validation import points3
from casashell.typing import AnyArray, ArrayLike, BoolArray, FloatArray, IntArray

#: height over longest edge below which a face is too thin to have a normal
_THIN = 1e-8


@dataclass(frozen=True, eq=False)
class Surface:
    """Cleaned triangles: coincident vertices joined, degenerate faces and stray vertices gone.

    vertices (V, 3) m, faces (F, 3), size (bounding box diagonal, m), closed
    face_normals (F, 3), edge_normals (E, 3), vertex_normals (V, 3) unit pseudonormals
    face_edges (F, 3) edge opposite to each corner; edge_rim (E,), vertex_rim (V,) on a border
    """

    vertices: FloatArray
    faces: IntArray
    size: float
    closed: bool
    face_normals: FloatArray
    edge_normals: FloatArray
    vertex_normals: FloatArray
    face_edges: IntArray
    edge_rim: BoolArray
    vertex_rim: BoolArray
    notes: tuple[str, ...]

    @classmethod
    def build(cls, vertices: ArrayLike, faces: ArrayLike, *, flip: bool, label: str) -> Surface:
        """Clean and check; ValueError naming the vertex or face when that cannot be done."""
        points = points3(vertices, f"vertices of {label}")
        triangles = _triangles(faces, len(points), label)
        x, corners, kept, notes = _cleaned(points, triangles[:, ::-1] if flip else triangles)
        normals, thin = _face_normals(x, corners)
        if thin.all():
            raise ValueError(f"{label} has no face with an area ({len(triangles)} faces read)")
        if thin.any():
            notes.append(f"{int(thin.sum())} faces without area left out")
        edges = _Edges.of(corners)
        edges.check_winding(kept, label)
        rim = edges.forward != edges.backward
        if not rim.any():
            _check_outward(x, corners, kept, flip, label)
        else:
            notes.append(
                f"open mesh, {int(rim.sum())} border edges: points behind its faces count as inside"
            )
        crowded = int((edges.forward + edges.backward > 2).sum())
        if crowded:
            notes.append(f"{crowded} edges with more than two faces: the side is uncertain there")
        vertex_rim = np.zeros(len(x), dtype=bool)
        vertex_rim[edges.ends[rim].reshape(-1)] = True
        angles = _corner_angles(x, corners, thin)
        return cls(
            vertices=x,
            faces=np.ascontiguousarray(corners[~thin]),
            size=float(np.linalg.norm(np.ptp(x, axis=0))),
            closed=not rim.any(),
            face_normals=normals[~thin],
            edge_normals=_summed(edges.of_face, np.ones(corners.shape), normals, len(edges.ends)),
            vertex_normals=_summed(corners, angles, normals, len(x)),
            face_edges=np.ascontiguousarray(edges.of_face[~thin]),
            edge_rim=rim,
            vertex_rim=vertex_rim,
            notes=tuple(notes),
        )

    def barycentric(self, face: IntArray, points: FloatArray) -> FloatArray:
        """Weights (N, 3) of points that lie on the given faces (N,)."""
        a, b, c = (self.vertices[self.faces[face, k]] for k in range(3))
        weights = np.empty((len(face), 3))
        normal = np.cross(b - a, c - a)
        double_area = np.einsum("ij,ij->i", normal, normal)
        for k, (first, second) in enumerate(((b, c), (c, a), (a, b))):
            part = np.cross(second - first, points - first)
            weights[:, k] = np.einsum("ij,ij->i", part, normal) / double_area
        return weights


@dataclass(frozen=True, eq=False)
class _Edges:
    """Edges (E, 2), how many faces run along each in either direction, and those of each face."""

    ends: IntArray
    of_face: IntArray
    forward: IntArray
    backward: IntArray

    @classmethod
    def of(cls, faces: IntArray) -> _Edges:
        half = faces[:, [1, 2, 2, 0, 0, 1]].reshape(-1, 2)
        up = half[:, 0] < half[:, 1]
        low, high = np.where(up, half.T, half.T[::-1])
        count = int(faces.max()) + 1
        keys, index = np.unique(low * count + high, return_inverse=True)
        ends = np.column_stack(np.divmod(keys, count))
        return cls(
            ends=ends,
            of_face=index.reshape(-1, 3),
            forward=np.bincount(index[up], minlength=len(ends)),
            backward=np.bincount(index[~up], minlength=len(ends)),
        )

    def check_winding(self, face_ids: IntArray, label: str) -> None:
        """ValueError when two faces that share an edge wind against each other."""
        count = self.forward + self.backward
        against = np.flatnonzero((count == 2) & (self.forward != self.backward))
        if against.size:
            pair = face_ids[(self.of_face == against[0]).any(axis=1)].tolist()
            raise ValueError(
                f"{label}: neighbouring faces wind against each other at {against.size} edges, "
                f"first faces {pair[0]} and {pair[-1]}; its outside is not defined. Orient it "
                "consistently (casashell.repaired, or 'recalculate normals' in a mesh editor)"
            )


def _triangles(faces: ArrayLike, vertex_count: int, label: str) -> IntArray:
    """Faces (F, 3) int64 with every index in range."""
    array: AnyArray = np.asarray(faces)
    if array.ndim != 2 or array.shape[1] != 3 or array.shape[0] == 0:
        raise ValueError(f"faces of {label} must have shape (F, 3) with F > 0, got {array.shape}")
    if array.dtype.kind not in "iu":
        raise ValueError(f"faces of {label} must be integer vertex ids, got type {array.dtype}")
    triangles = array.astype(np.int64)
    bad = np.flatnonzero(((triangles < 0) | (triangles >= vertex_count)).any(axis=1))
    if bad.size:
        raise ValueError(
            f"face {int(bad[0])} of {label} is {triangles[bad[0]].tolist()}, "
            f"but its vertices run from 0 to {vertex_count - 1}"
        )
    return triangles


def _cleaned(
    points: FloatArray, triangles: IntArray
) -> tuple[FloatArray, IntArray, IntArray, list[str]]:
    """Joined vertices, faces with three different corners, their original ids, notes."""
    notes = []
    # + 0.0 turns -0.0 into 0.0, so that equal coordinates are equal bits
    used = np.unique(triangles)
    joined, place = np.unique(points[used] + 0.0, axis=0, return_inverse=True)
    if len(joined) < len(used):
        notes.append(f"{len(used) - len(joined)} vertices joined with one at the same place")
    if len(used) < len(points):
        notes.append(f"{len(points) - len(used)} vertices without a face left out")
    renumbered = np.zeros(len(points), dtype=np.int64)
    renumbered[used] = place.reshape(-1)
    corners = renumbered[triangles]
    a, b, c = corners.T
    kept = np.flatnonzero((a != b) & (b != c) & (c != a))
    if len(kept) < len(corners):
        notes.append(f"{len(corners) - len(kept)} faces with a repeated corner left out")
    return np.ascontiguousarray(joined), corners[kept], kept, notes


def _face_normals(x: FloatArray, faces: IntArray) -> tuple[FloatArray, BoolArray]:
    """Unit normals (F, 3), zero for the faces (F,) too thin to have one."""
    sides = x[faces[:, [1, 2, 0]]] - x[faces]
    longest = np.linalg.norm(sides, axis=2).max(axis=1, initial=0.0)
    scale = np.where(longest > 0.0, longest, 1.0)[:, None]
    across = np.cross(sides[:, 0] / scale, sides[:, 1] / scale)
    height = np.linalg.norm(across, axis=1)
    thin = height <= _THIN
    normals = np.where(thin[:, None], 0.0, across / np.where(thin, 1.0, height)[:, None])
    return normals, thin


def _corner_angles(x: FloatArray, faces: IntArray, thin: BoolArray) -> FloatArray:
    """Angles (F, 3) rad at the corners, zero in thin faces."""
    angles = np.empty(faces.shape)
    for k in range(3):
        u = x[faces[:, (k + 1) % 3]] - x[faces[:, k]]
        v = x[faces[:, (k + 2) % 3]] - x[faces[:, k]]
        cross = np.linalg.norm(np.cross(u, v), axis=1)
        angles[:, k] = np.arctan2(cross, np.einsum("ij,ij->i", u, v))
    angles[thin] = 0.0
    return angles


def _summed(index: IntArray, weights: FloatArray, normals: FloatArray, count: int) -> FloatArray:
    """Unit sums (count, 3) of weights (F, 3) times face normals over the cells ``index`` (F, 3).

    Where the normals cancel (a blade of no thickness) one of them stands for the sum.
    """
    flat = index.reshape(-1)
    spread = np.repeat(normals, 3, axis=0)
    total = np.column_stack(
        [np.bincount(flat, weights.reshape(-1) * spread[:, k], minlength=count) for k in range(3)]
    )
    length = np.linalg.norm(total, axis=1)
    lost = length <= 1e-9
    # a cell all of whose faces are thin keeps +z: no query ends on it
    alone = np.tile([0.0, 0.0, 1.0], (count, 1))
    solid = np.flatnonzero(spread.any(axis=1))[::-1]
    alone[flat[solid]] = spread[solid]
    unit: FloatArray = np.where(lost[:, None], alone, total / np.where(lost, 1.0, length)[:, None])
    return unit


def _check_outward(
    x: FloatArray, faces: IntArray, face_ids: IntArray, flip: bool, label: str
) -> None:
    """ValueError when a closed part has its faces inwards and is not a cavity of another part."""
    labels = _parts(faces, len(x))
    first = np.unique(labels, return_index=True)[1]
    local = x[faces] - x[faces[first[labels], 0]][:, None, :]
    share = np.einsum("ij,ij->i", local[:, 0], np.cross(local[:, 1], local[:, 2])) / 6.0
    volume = np.bincount(labels, share)
    reach = np.zeros(len(first))
    np.maximum.at(reach, labels, np.abs(local).max(axis=(1, 2)))
    for part in np.flatnonzero(volume < -1e-12 * reach**3):
        if _inside_others(x, faces, labels, int(part)):
            continue
        where = "" if len(first) == 1 else f" in the part with face {int(face_ids[first[part]])}"
        step = (
            "leave out flip"
            if flip
            else "pass flip=True (flip = true in a scene file), or reverse the faces in the file"
        )
        raise ValueError(
            f"{label} is inside out{where}: its faces wind inwards "
            f"(signed volume {volume[part]:.3g}); {step}"
        )


def _parts(faces: IntArray, vertex_count: int) -> IntArray:
    """Connected part of each face (F,), over shared vertices, numbered from 0 without gaps."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    row = faces[:, [0, 1]].reshape(-1)
    column = faces[:, [1, 2]].reshape(-1)
    graph = coo_array((np.ones(len(row)), (row, column)), shape=(vertex_count, vertex_count))
    labels = connected_components(graph, directed=False)[1][faces[:, 0]]
    numbered: IntArray = np.unique(labels, return_inverse=True)[1].reshape(-1).astype(np.int64)
    return numbered


def _inside_others(x: FloatArray, faces: IntArray, labels: IntArray, part: int) -> bool:
    """True when the first vertex of a part lies inside the solid of the other parts."""
    others = faces[labels != part]
    if len(others) == 0:
        return False
    import igl

    start = x[faces[labels == part][0, 0]].reshape(1, 3)
    return bool(igl.winding_number(x, np.ascontiguousarray(others), start)[0] > 0.5)
