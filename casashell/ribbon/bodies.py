"""All strips of a scene joined into one mesh, and the pairs of parts that come near each other.

Broad phase: the boxes that the faces sweep, in the tree of `casashell.self_intersections`.  Every
vertex and every edge is owned by one of its faces, and a pair of faces is expanded to the vertices
and edges owned by the two, so that each pair of parts comes up once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from casashell.ribbon.strips import Strip, face_edges
from casashell.self_intersections import overlapping_boxes
from casashell.typing import AnyArray, ArrayLike, BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Pairs:
    """P pairs of disjoint parts, all vertex and triangle (sizes 1, 3) or all edges (2, 2).

    first, second  (P,1) and (P,3), or (P,2) and (P,2) vertex ids
    joined         (P,) some edge of the mesh connects the two parts
    """

    first: IntArray
    second: IntArray
    joined: BoolArray

    def __len__(self) -> int:
        return len(self.first)

    def subset(self, rows: IntArray | BoolArray) -> Pairs:
        """Pairs selected by number or mask."""
        return Pairs(self.first[rows], self.second[rows], self.joined[rows])

    @property
    def vertices(self) -> IntArray:
        """(P,4) ids, first part, then second."""
        return np.concatenate([self.first, self.second], axis=1)


@dataclass(frozen=True, eq=False)
class Bodies:
    """Strips with their vertices stacked in the given order; V vertices, F faces, E edges in all."""

    strips: tuple[Strip, ...]

    @cached_property
    def offsets(self) -> IntArray:
        """(S+1,) first vertex of each strip, then V."""
        return np.cumsum([0, *(len(strip.masses) for strip in self.strips)])

    @property
    def count(self) -> int:
        return int(self.offsets[-1])

    @cached_property
    def faces(self) -> IntArray:
        """(F,3) vertex ids."""
        stacked = [strip.faces + first for strip, first in zip(self.strips, self.offsets)]
        return np.concatenate(stacked)

    @cached_property
    def edges(self) -> IntArray:
        """(E,2) vertex ids, smaller first, in lexicographic order."""
        return face_edges(self.faces)[0]

    @cached_property
    def masses(self) -> FloatArray:
        """(V,) kg."""
        return np.concatenate([strip.masses for strip in self.strips])

    @cached_property
    def owner(self) -> IntArray:
        """(V,) number of the strip of a vertex."""
        return np.repeat(np.arange(len(self.strips)), np.diff(self.offsets))

    @cached_property
    def thickness(self) -> FloatArray:
        """(S,) m."""
        return np.array([strip.thickness for strip in self.strips])

    @cached_property
    def free(self) -> BoolArray:
        """(V,) true where the response may move a vertex."""
        mask = np.ones(self.count, dtype=np.bool_)
        for strip, first in zip(self.strips, self.offsets):
            mask[first + np.asarray(strip.pinned)] = False
        return mask

    def split(self, positions: FloatArray) -> tuple[FloatArray, ...]:
        """Stacked positions (V,3) as one array per strip."""
        return tuple(np.split(positions, self.offsets[1:-1]))

    def stack(self, positions: ArrayLike | Sequence[ArrayLike], what: str) -> FloatArray:
        """Positions (V,3), given so or as one array per strip; ValueError naming strip, vertex."""
        if isinstance(positions, list | tuple) and len(positions) == len(self.strips):
            parts = [np.asarray(part, dtype=np.float64) for part in positions]
            for number, (part, size) in enumerate(zip(parts, np.diff(self.offsets))):
                if part.shape != (size, 3):
                    raise ValueError(
                        f"{what}: strip {number} must have shape ({size}, 3), got {part.shape}"
                    )
            stacked = np.concatenate(parts)
        else:
            stacked = np.array(positions, dtype=np.float64)
        if stacked.shape != (self.count, 3):
            raise ValueError(f"{what} must have shape ({self.count}, 3), got {stacked.shape}")
        bad = np.flatnonzero(~np.isfinite(stacked).all(axis=1))
        if bad.size:
            raise ValueError(f"{what}: {self.name(int(bad[0]))} is at {stacked[bad[0]]}")
        return stacked

    def name(self, vertex: int) -> str:
        """Words for a stacked vertex id, for messages."""
        strip = int(self.owner[vertex])
        return f"vertex {vertex - self.offsets[strip]} of strip {strip}"

    def near(self, start: FloatArray, end: FloatArray, reach: float) -> tuple[Pairs, Pairs]:
        """Vertex-triangle and edge-edge pairs whose swept boxes are within ``reach`` [m].

        Parts that share a vertex and pairs without a free vertex are left out.
        """
        low, high = np.minimum(start, end) - 0.5 * reach, np.maximum(start, end) + 0.5 * reach
        faces = overlapping_boxes(low[self.faces].min(axis=1), high[self.faces].max(axis=1))
        f, g = faces[:, 0], faces[:, 1]
        inner, outer = np.concatenate([f, g]), np.concatenate([g, f])
        one = self._owned_vertices[inner]
        row, column = np.nonzero(one >= 0)
        vertex, triangle = one[row, column][:, None], self.faces[outer[row]]
        mine, yours = self._owned_edges[f][:, :, None], self._owned_edges[g][:, None, :]
        row, i, j = np.nonzero((mine >= 0) & (yours >= 0))
        edge, other = self.edges[mine[row, i, 0]], self.edges[yours[row, 0, j]]
        return self._kept(vertex, triangle, low, high), self._kept(edge, other, low, high)

    def _kept(self, first: IntArray, second: IntArray, low: FloatArray, high: FloatArray) -> Pairs:
        """The pairs with no common vertex, a free one, and boxes that meet."""
        keep = ~(first[:, :, None] == second[:, None, :]).any(axis=(1, 2))
        keep &= self.free[first].any(axis=1) | self.free[second].any(axis=1)
        first, second = first[keep], second[keep]
        meet = (low[first].min(axis=1) <= high[second].max(axis=1)).all(axis=1)
        meet &= (low[second].min(axis=1) <= high[first].max(axis=1)).all(axis=1)
        first, second = first[meet], second[meet]
        ends = np.stack(np.broadcast_arrays(first[:, :, None], second[:, None, :]), axis=-1)
        linked = np.isin(self._key(ends), self._key(self.edges))
        return Pairs(first, second, np.asarray(linked.any(axis=(1, 2))))

    def _key(self, ends: AnyArray) -> IntArray:
        """One number for each pair of ids in the last axis, whatever their order."""
        key: IntArray = ends.min(axis=-1) * self.count + ends.max(axis=-1)
        return key

    @cached_property
    def _owned_vertices(self) -> IntArray:
        """(F,3) vertices owned by a face, -1 where another face owns them."""
        return _first_owner(self.faces)

    @cached_property
    def _owned_edges(self) -> IntArray:
        """(F,3) edges owned by a face, -1 where another face owns them."""
        return _first_owner(face_edges(self.faces)[1])


def _first_owner(parts: IntArray) -> IntArray:
    """The table (F,3) with all but the first appearance of each number replaced by -1."""
    flat = parts.ravel()
    owned = np.full(len(flat), -1, dtype=np.int64)
    numbers, first = np.unique(flat, return_index=True)
    owned[first] = numbers
    return owned.reshape(parts.shape)
