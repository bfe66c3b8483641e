"""Impacts of moving strips with each other, with themselves and with obstacles, as linear rows.

An impact is linearised where it happens (Harmon et al. 2008): with the barycentric weights w and
the unit normal n of that moment, the end positions x have to satisfy

    n . sum_k w_k x_k >= bound.

Distances.  A pair wants its `target`: the mean thickness of the two strips, or less inside one
strip whose own parts are closer than that by construction.  Coming below HIT times the target is
an impact, unless the pair is apart again at the end; coming below GRAZE times the target always
is one.  An obstacle wants half the thickness between itself and a vertex.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from casashell.contact.obstacles import Obstacle, Plane
from casashell.contact.validation import Vector3
from casashell.ribbon.bodies import Bodies, Pairs
from casashell.ribbon.sweep import approaches, separations
from casashell.typing import BoolArray, FloatArray, IntArray

HIT = 0.5
GRAZE = 0.1
# Share of the target by which a row must be violated to count as new.
_NEW = 1e-6
# Most passes of the march along a vertex path through the distance field of an obstacle.
_MARCH = 100
# Targets inside one strip: shares of its shortest edge, and of its lowest triangle for parts that
# an edge joins (a crease may fold them almost together).  Never below the last share of thickness.
_OF_EDGE, _OF_HEIGHT, _OF_THICKNESS = 0.5, 0.02, 1e-3


@dataclass(frozen=True, eq=False)
class Rows:
    """C linear conditions  normal . sum_k weights_k x[vertices_k] >= bound  on positions x (V,3).

    vertices (C,4), weights (C,4), normals (C,3) unit, bounds (C,) m, targets (C,) m: the wanted
    separation.  A row about an obstacle has weights (1, 0, 0, 0).
    """

    vertices: IntArray
    weights: FloatArray
    normals: FloatArray
    bounds: FloatArray
    targets: FloatArray

    def __len__(self) -> int:
        return len(self.vertices)

    def values(self, x: FloatArray) -> FloatArray:
        """Left-hand sides (C,) m."""
        result: FloatArray = np.einsum("ck,cki,ci->c", self.weights, x[self.vertices], self.normals)
        return result

    def subset(self, rows: IntArray | BoolArray) -> Rows:
        """Rows selected by number or mask."""
        return Rows(
            self.vertices[rows],
            self.weights[rows],
            self.normals[rows],
            self.bounds[rows],
            self.targets[rows],
        )

    def without_repeats(self) -> Rows:
        """The same rows, each once, in their order."""
        parts = (self.vertices, self.weights, self.normals, self.bounds[:, None])
        first = np.unique(np.hstack(parts), axis=0, return_index=True)[1]
        return self.subset(np.sort(first))

    @classmethod
    def joined(cls, parts: Sequence[Rows]) -> Rows:
        """All rows of the parts."""
        none = np.zeros(0)
        empty = cls(np.zeros((0, 4), np.int64), np.zeros((0, 4)), np.zeros((0, 3)), none, none)
        every = [empty, *parts]
        return cls(
            np.concatenate([part.vertices for part in every]),
            np.concatenate([part.weights for part in every]),
            np.concatenate([part.normals for part in every]),
            np.concatenate([part.bounds for part in every]),
            np.concatenate([part.targets for part in every]),
        )


@dataclass(frozen=True)
class Moving:
    """An obstacle carried along without turning.

    before, after  m, how far it is from where ``shape`` puts it, at the start and end of the step
    """

    shape: Obstacle
    before: Vector3 = (0.0, 0.0, 0.0)
    after: Vector3 = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Detector:
    """Finds impacts on straight ways.

    proposed  (V,3) m, positions without contact; the strips are unstretched there, so their
              shortest edges and lowest triangles are read off them
    """

    bodies: Bodies
    start: FloatArray
    proposed: FloatArray
    obstacles: tuple[Moving, ...]

    def pair_rows(self, end: FloatArray, zone: IntArray | None = None) -> Rows:
        """Rows that ``end`` violates; pairs wholly inside one zone (V,) >= 0 are left out."""
        found = []
        for pairs in self._near(end):
            if zone is not None:
                ids = zone[pairs.vertices]
                same = (ids[:, 0] >= 0) & (ids == ids[:, :1]).all(axis=1)
                pairs = pairs.subset(~same)
            if len(pairs):
                found += self._of_pairs(pairs, end)
        return Rows.joined(found)

    def obstacle_rows(self, end: FloatArray, deeper: bool = False) -> Rows:
        """Rows about obstacles that ``end`` violates; for a plane, all vertices near it.

        deeper  only vertices that have less of a gap than at the start
        """
        return Rows.joined([self._of_obstacle(o, end, deeper) for o in self.obstacles])

    def rows(self, end: FloatArray) -> Rows:
        """All rows that ``end`` (V,3) violates; none means that it is reached without impact."""
        return Rows.joined([self.obstacle_rows(end), self.pair_rows(end)])

    def smallest_gap(self, end: FloatArray) -> float:
        """m, between free vertices and obstacles; infinite without obstacles."""
        x = end[self.bodies.free]
        gaps = [o.shape.signed_distance(x - np.array(o.after))[0] for o in self.obstacles]
        return min((float(gap.min(initial=np.inf)) for gap in gaps), default=np.inf)

    def smallest_separation(self, end: FloatArray) -> float:
        """m, over pairs that no edge joins; infinite when none is closer than the thickness."""
        reach = float(self.bodies.thickness.max())
        smallest = np.inf
        for pairs in self.bodies.near(end, end, reach):
            apart = pairs.subset(~pairs.joined)
            smallest = min(smallest, float(separations(apart, end)[2].min(initial=np.inf)))
        return smallest if smallest < reach else np.inf

    def wanted(self, pairs: Pairs) -> FloatArray:
        """Target separation (P,) m."""
        one = self.bodies.owner[pairs.first[:, 0]]
        two = self.bodies.owner[pairs.second[:, 0]]
        thickness = self.bodies.thickness
        apart = 0.5 * (thickness[one] + thickness[two])
        inside = np.where(pairs.joined, self._limits[one, 1], self._limits[one, 0])
        result: FloatArray = np.where(one == two, inside, apart)
        return result

    @cached_property
    def _limits(self) -> FloatArray:
        """(S,2) m, targets inside a strip: parts that no edge joins, and parts that one does."""
        x, rows = self.proposed, []
        for strip, (first, last) in zip(self.bodies.strips, pairwise(self.bodies.offsets)):
            corners = x[first:last][strip.faces]
            sides = np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2)
            area = np.linalg.norm(
                np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
            )
            height = (area / np.maximum(sides.max(axis=1), np.finfo(float).tiny)).min()
            share = np.array([_OF_EDGE * sides.min(), _OF_HEIGHT * height])
            rows.append(np.clip(share, _OF_THICKNESS * strip.thickness, strip.thickness))
        return np.array(rows)

    def _near(self, end: FloatArray) -> list[Pairs]:
        """Pairs whose ways come within the thickness; none when the strips are far apart."""
        bodies = self.bodies
        return [p for p in bodies.near(self.start, end, float(bodies.thickness.max())) if len(p)]

    def _of_pairs(self, pairs: Pairs, end: FloatArray) -> list[Rows]:
        """First the linearisation at the impact; where that holds already, the finer checks."""
        target = self.wanted(pairs)
        hit = approaches(pairs, self.start, end, HIT * target)
        if hit.rows.size == 0:
            return []
        pairs, target = pairs.subset(hit.rows), target[hit.rows]
        rows = Rows(pairs.vertices, hit.weights, hit.normal, target, target)
        new = rows.values(end) < (1.0 - _NEW) * target
        rest = np.flatnonzero(~new)
        if rest.size == 0:
            return [rows.subset(new)]
        return [rows.subset(new), *self._of_grazing(pairs.subset(rest), target[rest], end)]

    def _of_grazing(self, pairs: Pairs, target: FloatArray, end: FloatArray) -> list[Rows]:
        """Pairs that dip below HIT on the way although the impact's row holds at the end."""
        graze = approaches(pairs, self.start, end, GRAZE * target)
        touched = np.zeros(len(pairs), dtype=np.bool_)
        touched[graze.rows] = True
        weights, normal, distance = separations(pairs, end)
        close = ~touched & (distance < HIT * target)
        near = Rows(pairs.vertices, weights, normal, target, target).subset(close)
        dips, wanted = pairs.subset(graze.rows), target[graze.rows]
        rows = Rows(dips.vertices, graze.weights, graze.normal, wanted, wanted)
        # HIT, or as much as at the start, at the time of the dip, where a point is at
        # x(t) = start + t (x - start); told in terms of x
        before, time = rows.values(self.start), np.maximum(graze.time, 1e-6)
        bounds = before - np.maximum(before - HIT * wanted, 0.0) / time
        return [near, Rows(dips.vertices, graze.weights, graze.normal, bounds, wanted)]

    def _of_obstacle(self, moving: Moving, end: FloatArray, deeper: bool) -> Rows:
        """Rows of one obstacle, pinned vertices left out.

        Works in the frame of its shape.
        """
        bodies, shift = self.bodies, np.array(moving.after)
        half = 0.5 * bodies.thickness[bodies.owner]
        first, last = self.start - np.array(moving.before), end - shift
        near = bodies.free & _reachable(moving.shape, first, last, half)
        ids = np.flatnonzero(near)
        if ids.size == 0:
            return Rows.joined([])
        half = half[ids]
        if isinstance(moving.shape, Plane):
            at = last[ids]
            gap, normal = moving.shape.signed_distance(at)
            depth = max(0.0, float((half - gap).max()))
            keep = (gap < half + depth) & bool((gap < HIT * half).any())
        else:
            at, keep = _touching(moving.shape, first[ids], last[ids], half)
            gap, normal = moving.shape.signed_distance(at)
        if deeper:
            before, after = (moving.shape.signed_distance(p[ids])[0] for p in (first, last))
            keep &= after < before - _NEW * half
        bound = half - gap + np.einsum("ni,ni->n", normal, at + shift)
        weights = np.zeros((len(ids), 4))
        weights[:, 0] = 1.0
        vertices = np.repeat(ids[:, None], 4, axis=1)
        return Rows(vertices, weights, normal, bound, half).subset(keep)


def _touching(
    shape: Obstacle, start: FloatArray, last: FloatArray, half: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Where to linearise (N,3), and whether there is something to correct (N,).

    At the impact; at the end of the way where the impact's row holds there and the gap does not.
    """
    at, hit = _march(shape, start, last, half)
    gap, normal = shape.signed_distance(at)
    along = gap + np.einsum("ni,ni->n", normal, last - at)
    new = hit & (along < (1.0 - _NEW) * half)
    inside = ~new & (shape.signed_distance(last)[0] < HIT * half)
    return np.where(inside[:, None], last, at), np.asarray(new | inside)


def _reachable(shape: Obstacle, start: FloatArray, last: FloatArray, half: FloatArray) -> BoolArray:
    """Vertices (V,) whose way meets the bounding box of an obstacle, grown by ``half`` (V,)."""
    box = shape.bounding_box()
    if box is None:
        return np.ones(len(start), dtype=np.bool_)
    low = np.minimum(start, last) - half[:, None]
    high = np.maximum(start, last) + half[:, None]
    return np.asarray(((high >= box[0]) & (low <= box[1])).all(axis=1))


def _march(
    shape: Obstacle, start: FloatArray, last: FloatArray, half: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """First points (N,3) of straight ways with a gap below HIT half, or their ends; found (N,).

    A signed distance changes by at most the distance travelled, so each pass moves on by the gap.
    """
    at = start.copy()
    left = np.linalg.norm(last - start, axis=1)
    direction = (last - start) / np.where(left > 0.0, left, 1.0)[:, None]
    alive = np.flatnonzero(left > 0.0)
    hit = np.zeros(len(at), dtype=np.bool_)
    for _ in range(_MARCH):
        if alive.size == 0:
            break
        gap = shape.signed_distance(at[alive])[0] - HIT * half[alive]
        there = gap <= 1e-2 * half[alive]
        hit[alive[there]] = True
        alive, gap = alive[~there], gap[~there]
        step = np.minimum(gap, left[alive])
        at[alive] += step[:, None] * direction[alive]
        left[alive] -= step
        alive = alive[left[alive] > 0.0]
    hit[alive] = True
    return at, hit
