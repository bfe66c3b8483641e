"""Triangle mesh: read-only arrays, geometry and connectivity computed once on demand.

The constructor refuses what no later stage could interpret (shapes, indices, non-finite numbers).
Faults of the surface itself are found by `casashell.mesh_checks` and mended by `casashell.repair`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np

from casashell.topology import Topology
from casashell.typing import ArrayLike, FloatArray, IntArray

_LARGEST = 1e50  # m: areas and volumes of anything larger overflow


@dataclass(frozen=True, eq=False)
class TriMesh:
    """Triangles over vertices.

    vertices: (V,3) positions [m], copied to read-only float64.
    faces: (F,3) vertex ids from 0, copied to read-only int64.
    polygons: the faces before triangulation, empty when the input was triangles.  Polygon p with n
        corners owns n - 2 consecutive faces, in the order of the polygons.

    Raises ValueError for wrong shapes, an empty mesh, non-finite coordinates, indices out of range
    and polygons that do not match the faces.
    """

    vertices: FloatArray
    faces: IntArray
    polygons: tuple[tuple[int, ...], ...] = ()

    def __post_init__(self) -> None:
        vertices = _checked_vertices(self.vertices)
        faces = _checked_faces(self.faces, len(vertices))
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)
        object.__setattr__(self, "polygons", _checked_polygons(self.polygons, faces))

    def moved(self, vertices: ArrayLike) -> TriMesh:
        """Mesh with the same connectivity (shared, not recomputed) at new positions (V,3)."""
        positions = _checked_vertices(vertices)
        if len(positions) != len(self.vertices):
            raise ValueError(
                f"moved: got {len(positions)} positions for a mesh of {len(self.vertices)} vertices"
            )
        other = object.__new__(TriMesh)
        vars(other).update(
            vertices=positions, faces=self.faces, polygons=self.polygons, topology=self.topology
        )
        return other

    @cached_property
    def topology(self) -> Topology:
        """Connectivity beyond the properties below; shared by moved meshes."""
        return Topology(self.faces, len(self.vertices))

    @property
    def edges(self) -> IntArray:
        """(E,2) vertex pairs i < j, lexicographic."""
        return self.topology.edges

    @property
    def edge_faces(self) -> IntArray:
        """(E,2) face with i -> j and face with j -> i of every edge, -1 where none."""
        return self.topology.edge_faces

    @property
    def hinges(self) -> IntArray:
        """(H,4) interior edge i < j, corner k of its face with i -> j, corner l of the other.

        Raises ValueError on a non-manifold or inconsistently oriented mesh, naming an edge.
        """
        return self.topology.hinges

    @property
    def boundary_loops(self) -> tuple[IntArray, ...]:
        """Vertex ids along each boundary curve."""
        return self.topology.boundary_loops

    @property
    def components(self) -> tuple[int, IntArray]:
        """Number of pieces and the piece of every vertex (V,); a lone vertex is its own piece."""
        return self.topology.components

    @cached_property
    def _cross(self) -> FloatArray:
        a, b, c = (self.vertices[self.faces[:, corner]] for corner in range(3))
        return np.cross(b - a, c - a)

    @cached_property
    def face_areas(self) -> FloatArray:
        """(F,) area [m2]."""
        return _frozen(0.5 * np.linalg.norm(self._cross, axis=1))

    @cached_property
    def face_normals(self) -> FloatArray:
        """(F,3) unit normal, counter-clockwise side; zero for a face without area."""
        return _frozen(_unit(self._cross))

    @cached_property
    def face_angles(self) -> FloatArray:
        """(F,3) angle at each corner [rad]; 0 where a side has no length."""
        corners = self.vertices[self.faces]
        to_next = np.roll(corners, -1, axis=1) - corners
        to_last = np.roll(corners, 1, axis=1) - corners
        twice_area = np.linalg.norm(self._cross, axis=1)[:, None]
        return _frozen(np.arctan2(twice_area, np.einsum("fci,fci->fc", to_next, to_last)))

    @cached_property
    def edge_lengths(self) -> FloatArray:
        """(E,) length [m]."""
        ends = self.vertices[self.edges]
        return _frozen(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))

    @cached_property
    def mean_edge_length(self) -> float:
        """Mean length of all edges [m]."""
        return float(self.edge_lengths.mean()) if len(self.edges) else 0.0

    @cached_property
    def bbox_diagonal(self) -> float:
        """Diagonal of the bounding box of the vertices in use [m]."""
        used = np.zeros(len(self.vertices), dtype=np.bool_)
        used[self.faces] = True
        return float(np.linalg.norm(np.ptp(self.vertices[used], axis=0)))

    @cached_property
    def vertex_areas(self) -> FloatArray:
        """(V,) a third of the area of the faces around each vertex [m2]."""
        areas = np.zeros(len(self.vertices))
        np.add.at(areas, self.faces, self.face_areas[:, None] / 3)
        return _frozen(areas)

    @cached_property
    def vertex_normals(self) -> FloatArray:
        """(V,3) unit area-weighted mean of the normals around each vertex; zero if it has none."""
        weights = np.repeat(self._cross, 3, axis=0)
        corner, count = self.faces.ravel(), len(self.vertices)
        sums = [np.bincount(corner, weights[:, axis], minlength=count) for axis in range(3)]
        return _frozen(_unit(np.stack(sums, axis=1)))


def _unit(rows: FloatArray) -> FloatArray:
    """Rows scaled to length one; rows of length zero stay zero."""
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    unit: FloatArray = np.divide(rows, length, out=np.zeros_like(rows), where=length > 0)
    return unit


def _frozen(array: FloatArray) -> FloatArray:
    """The array, made read-only: cached values are shared between callers."""
    array.setflags(write=False)
    return array


def _checked_vertices(values: ArrayLike) -> FloatArray:
    try:
        vertices = np.array(values, dtype=np.float64, order="C")
    except (TypeError, ValueError) as problem:
        raise ValueError(f"vertices must be a (V, 3) array of numbers: {problem}") from None
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise ValueError(f"vertices must have shape (V, 3), got {vertices.shape}")
    if len(vertices) == 0:
        raise ValueError("the mesh is empty: no vertices")
    bad = np.flatnonzero(~(np.abs(vertices) < _LARGEST).all(axis=1))
    if bad.size:
        x, y, z = vertices[bad[0]]
        more = f" ({bad.size} such vertices in all)" if bad.size > 1 else ""
        fault = "beyond all measure" if np.isfinite([x, y, z]).all() else "not finite"
        raise ValueError(
            f"vertex {bad[0]} is {fault}: ({x:g}, {y:g}, {z:g}){more}; "
            "export the mesh again or delete the vertex and its faces"
        )
    vertices.setflags(write=False)
    return vertices


def _checked_faces(values: Any, vertex_count: int) -> IntArray:
    try:
        given = np.asarray(values)
    except ValueError:
        raise ValueError(
            "faces must be an (F, 3) array; split quads and polygons first (read_mesh does so)"
        ) from None
    if given.size == 0:
        raise ValueError("the mesh is empty: no faces")
    if given.ndim != 2 or given.shape[1] != 3:
        raise ValueError(f"faces must have shape (F, 3), got {given.shape}")
    if given.dtype.kind not in "iu":
        raise ValueError(f"faces must be integers (vertex ids from 0), got {given.dtype}")
    faces = np.array(given, dtype=np.int64, order="C")
    bad = np.flatnonzero(((faces < 0) | (faces >= vertex_count)).any(axis=1))
    if bad.size:
        raise ValueError(
            f"face {bad[0]} has vertices {faces[bad[0]].tolist()}, outside 0..{vertex_count - 1}; "
            "vertex ids count from 0"
        )
    faces.setflags(write=False)
    return faces


def _checked_polygons(
    values: Iterable[Iterable[int]], faces: IntArray
) -> tuple[tuple[int, ...], ...]:
    polygons = tuple(tuple(map(int, polygon)) for polygon in values)
    if not polygons:
        return ()
    size = np.fromiter(map(len, polygons), dtype=np.int64, count=len(polygons))
    if size.min() < 3 or int((size - 2).sum()) != len(faces):
        raise ValueError(
            f"{len(polygons)} polygons with {int(size.sum())} corners do not match {len(faces)} "
            "faces: a polygon with n >= 3 corners owns n - 2 consecutive faces"
        )
    # corners tagged with their polygon: a face may only use corners of its own polygon
    stride = int(max(faces.max(), max(map(max, polygons)))) + 1
    corners = np.fromiter(chain.from_iterable(polygons), dtype=np.int64, count=int(size.sum()))
    owned = corners + stride * np.repeat(np.arange(len(size)), size)
    used = faces + stride * np.repeat(np.arange(len(size)), size - 2)[:, None]
    foreign = np.flatnonzero(~np.isin(used, owned).all(axis=1))
    if foreign.size:
        raise ValueError(
            f"face {foreign[0]} uses a vertex that is not a corner of its polygon "
            f"{int(used[foreign[0], 0]) // stride}"
        )
    return polygons


def aligned(points: FloatArray, onto: FloatArray) -> FloatArray:
    """``points`` (n,3) turned and shifted as near to ``onto`` (n,3) as a rigid motion brings them.

    Least squares (Kabsch); no mirror images, no scaling.
    """
    here, there = points.mean(axis=0), onto.mean(axis=0)
    u, _, v = np.linalg.svd((points - here).T @ (onto - there))
    u[:, 2] *= np.sign(np.linalg.det(u @ v))
    return np.asarray((points - here) @ (u @ v) + there)
