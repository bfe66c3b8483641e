"""Connectivity of a triangle list: edges, half-edges, hinges, boundary loops, components.

Half-edge h = 3 f + c runs from corner c of face f to corner c + 1; corner c + 2 is opposite to it.
Everything here depends on the faces only, so moving a mesh keeps one `Topology`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from casashell.typing import BoolArray, IntArray

_SUGGESTION = (
    "casashell.validate(mesh) lists every fault, casashell.repaired(mesh) mends the safe ones"
)


@dataclass(frozen=True, eq=False)
class Topology:
    """Connectivity of ``faces (F,3)`` over ``vertex_count`` vertices, computed on demand."""

    faces: IntArray
    vertex_count: int

    @cached_property
    def half_edges(self) -> IntArray:
        """(3F,2) start and end vertex of every half-edge."""
        return np.stack([self.faces, np.roll(self.faces, -1, axis=1)], axis=2).reshape(-1, 2)

    @cached_property
    def _repeats_vertex(self) -> BoolArray:
        """(F,) faces with a vertex twice; they are passed over and have no edges."""
        repeats: BoolArray = (self.faces == np.roll(self.faces, 1, axis=1)).any(axis=1)
        return repeats

    @cached_property
    def _edge_data(self) -> tuple[IntArray, IntArray, IntArray]:
        pairs = np.sort(self.half_edges, axis=1)
        key = pairs[:, 0] * self.vertex_count + pairs[:, 1]
        key[np.repeat(self._repeats_vertex, 3)] = -1
        unique, inverse, count = np.unique(key, return_inverse=True, return_counts=True)
        skip = int(unique.size > 0 and unique[0] == -1)  # the faces without edges
        edges = np.stack(np.divmod(unique[skip:], self.vertex_count), axis=1)
        return _frozen(edges), _frozen(inverse.reshape(-1) - skip), _frozen(count[skip:])

    @property
    def edges(self) -> IntArray:
        """(E,2) vertex pairs i < j in lexicographic order."""
        return self._edge_data[0]

    @property
    def half_edge_edges(self) -> IntArray:
        """(3F,) edge of every half-edge; -1 where a face repeats a vertex."""
        return self._edge_data[1]

    @property
    def edge_valence(self) -> IntArray:
        """(E,) number of faces at every edge: 1 boundary, 2 interior, more: non-manifold."""
        return self._edge_data[2]

    @cached_property
    def _grouped(self) -> tuple[IntArray, IntArray]:
        """Half-edges sorted by edge, and where each edge starts in that list."""
        order = np.argsort(self.half_edge_edges, kind="stable")
        order = order[self.half_edge_edges[order] >= 0]
        return order, np.cumsum(self.edge_valence) - self.edge_valence

    @cached_property
    def _pairs(self) -> tuple[IntArray, IntArray, IntArray]:
        """Edges with exactly two faces, and their two half-edges."""
        order, start = self._grouped
        inner = np.flatnonzero(self.edge_valence == 2)
        return inner, order[start[inner]], order[start[inner] + 1]

    @cached_property
    def non_manifold_edges(self) -> IntArray:
        """Ids of edges with three or more faces."""
        ids: IntArray = np.flatnonzero(self.edge_valence > 2)
        return ids

    @cached_property
    def conflicting_edges(self) -> IntArray:
        """Ids of edges whose two faces run through them in the same direction."""
        inner, first, second = self._pairs
        ids: IntArray = inner[self.half_edges[first, 0] == self.half_edges[second, 0]]
        return ids

    def _require_oriented_manifold(self) -> None:
        for ids, fault in (
            (self.non_manifold_edges, "belongs to more than two faces"),
            (self.conflicting_edges, "has two faces with opposite orientation"),
        ):
            if ids.size:
                edge = int(ids[0])
                i, j = self.edges[edge]
                faces = np.flatnonzero(self.half_edge_edges == edge) // 3
                more = f" (and {ids.size - 1} more edges)" if ids.size > 1 else ""
                raise ValueError(
                    f"edge {edge} (vertices {i}, {j}) {fault}: faces "
                    f"{', '.join(map(str, faces[:4]))}{more}; {_SUGGESTION}"
                )

    @cached_property
    def edge_faces(self) -> IntArray:
        """(E,2) for edge i < j: the face with i -> j, the face with j -> i; -1 where none.

        Raises ValueError on a non-manifold or inconsistently oriented edge.
        """
        self._require_oriented_manifold()
        sides = np.full((len(self.edges), 2), -1, dtype=np.int64)
        used = np.flatnonzero(self.half_edge_edges >= 0)
        start, end = self.half_edges[used].T
        sides[self.half_edge_edges[used], (start > end).astype(np.int64)] = used // 3
        return _frozen(sides)

    @cached_property
    def hinges(self) -> IntArray:
        """(H,4) rows (i, j, k, l): interior edge i < j, its face with i -> j has k, with j -> i l.

        Raises ValueError on a non-manifold or inconsistently oriented edge.
        """
        self._require_oriented_manifold()
        _, first, second = self._pairs
        forward = self.half_edges[first, 0] < self.half_edges[first, 1]
        left, right = np.where(forward, first, second), np.where(forward, second, first)
        opposite = np.roll(self.faces, -2, axis=1).reshape(-1)
        return _frozen(np.column_stack([self.half_edges[left], opposite[left], opposite[right]]))

    @cached_property
    def boundary_edges(self) -> IntArray:
        """Ids of edges with one face."""
        return np.flatnonzero(self.edge_valence == 1)

    @cached_property
    def boundary_loops(self) -> tuple[IntArray, ...]:
        """Vertex ids along each boundary, in the direction of its faces (the surface on the left).

        Every loop starts at its lowest vertex.  Where faces disagree on the direction the walk
        goes on along the boundary all the same, so loops can be counted on faulty meshes too.
        """
        order, start = self._grouped
        rim = self.half_edges[order[start[self.boundary_edges]]]
        rim = rim[np.lexsort(rim.T[::-1])]
        at: dict[int, list[int]] = {}
        for row in range(len(rim)):
            at.setdefault(int(rim[row, 0]), []).append(row)
        for row in range(len(rim)):  # after the outgoing ones: only taken where none is left
            at.setdefault(int(rim[row, 1]), []).append(row)
        used = np.zeros(len(rim), dtype=np.bool_)
        loops = []
        for seed in range(len(rim)):
            if not used[seed]:
                loops.append(_walk(rim, at, used, seed))
        return tuple(loops)

    @cached_property
    def components(self) -> tuple[int, IntArray]:
        """Number of pieces and the piece of every vertex (V,); a lone vertex is its own piece."""
        labels = linked(self.edges[:, 0], self.edges[:, 1], self.vertex_count)
        return int(labels.max()) + 1, labels

    @cached_property
    def face_components(self) -> tuple[int, IntArray]:
        """Number of pieces that have faces and the piece of every face (F,)."""
        _, labels = np.unique(self.components[1][self.faces[:, 0]], return_inverse=True)
        return int(labels.max()) + 1, labels.reshape(-1).astype(np.int64)

    @cached_property
    def unreferenced(self) -> IntArray:
        """Ids of vertices in no face."""
        return np.flatnonzero(np.bincount(self.faces.ravel(), minlength=self.vertex_count) == 0)

    @cached_property
    def non_manifold_vertices(self) -> IntArray:
        """Ids of vertices whose faces form more than one fan (a bow tie)."""
        order, _ = self._grouped
        group = self.half_edge_edges[order]
        same = np.flatnonzero(group[1:] == group[:-1])
        a, b = order[same], order[same + 1]  # two half-edges of one edge
        a_end, b_end = _next_corner(a), _next_corner(b)
        flipped = self.half_edges[a, 0] != self.half_edges[b, 0]
        rows = np.concatenate([a, a_end])
        columns = np.concatenate([np.where(flipped, b_end, b), np.where(flipped, b, b_end)])
        fan = linked(rows, columns, self.faces.size)
        fan[np.repeat(self._repeats_vertex, 3)] = -1
        _, representative = np.unique(fan, return_index=True)
        representative = representative[fan[representative] >= 0]
        fans = np.bincount(self.faces.ravel()[representative], minlength=self.vertex_count)
        return np.flatnonzero(fans > 1)

    @cached_property
    def orientation(self) -> tuple[BoolArray, BoolArray]:
        """Which faces to turn over so that all agree (F,), and which cannot be made to (F,).

        Works per patch of faces joined over two-face edges; the smaller side of a patch is turned.
        Every face stands in a graph twice, as it is and turned over; an edge joins the copies that
        agree.  A patch whose two copies are connected is a Moebius band.
        """
        _, first, second = self._pairs
        conflict = self.half_edges[first, 0] == self.half_edges[second, 0]
        f, g, count = first // 3, second // 3, len(self.faces)
        rows = np.concatenate([f, f + count])
        columns = np.concatenate([g + count * conflict, g + count * ~conflict])
        labels = linked(rows, columns, 2 * count)
        kept, turned = labels[:count], labels[count:]
        size = np.bincount(kept, minlength=int(labels.max()) + 1)
        # equal halves: the one that holds the lower label, i.e. the lowest face, stays as it is
        turn = (size[kept] < size[turned]) | ((size[kept] == size[turned]) & (kept > turned))
        return turn, kept == turned


def linked(rows: IntArray, columns: IntArray, size: int) -> IntArray:
    """Label of each of ``size`` nodes, the same for nodes joined by links rows[i] - columns[i]."""
    from scipy.sparse import coo_array  # here, because csgraph is slow to import
    from scipy.sparse.csgraph import connected_components

    ones = np.ones(len(rows), dtype=np.int8)
    graph = coo_array((ones, (rows, columns)), shape=(size, size))
    labels: IntArray = connected_components(graph, directed=False)[1].astype(np.int64)
    return labels


def _frozen(array: IntArray) -> IntArray:
    """The array, made read-only: cached values are shared between callers."""
    array.setflags(write=False)
    return array


def _next_corner(half_edge: IntArray) -> IntArray:
    """Corner at the end of a half-edge (its start corner has the half-edge's own number)."""
    following: IntArray = half_edge - half_edge % 3 + (half_edge + 1) % 3
    return following


def _walk(rim: IntArray, at: dict[int, list[int]], used: BoolArray, seed: int) -> IntArray:
    """Follow unused boundary edges from edge ``seed`` until back at its start or stuck."""
    start, vertex = int(rim[seed, 0]), int(rim[seed, 1])
    used[seed] = True
    loop = [start]
    while vertex != start:
        loop.append(vertex)
        row = next((r for r in at[vertex] if not used[r]), None)
        if row is None:
            break
        used[row] = True
        vertex = int(rim[row, 0] + rim[row, 1]) - vertex
    return np.array(loop, dtype=np.int64)
