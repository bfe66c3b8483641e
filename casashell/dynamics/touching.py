"""Which vertices may meet which body in a step: distances are asked for only where they can matter.

A signed distance changes by no more than the point moves, so a vertex is left alone until it has moved,
as seen from the body, as far as it was away when last asked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from casashell.dynamics.bodies import Body
from casashell.dynamics.touch import Touches
from casashell.typing import AnyArray, BoolArray, FloatArray, IntArray

#: Stiffness of the natural map in that of the vertex alone: neighbours give way too.
_SOFTER = 0.3
#: Samples of one vertex's path through one body at most.
_SAMPLES = 64


class Watch:
    """Lower bounds on the distance of every vertex to one body.

    friction, offset  (V,): Coulomb coefficient, and the gap [m] at which a vertex touches
    allowed           (V,): pinned vertices never touch
    """

    def __init__(
        self, body: Body, friction: FloatArray, offset: FloatArray, allowed: BoolArray
    ) -> None:
        self.body = body
        self.friction, self.offset, self.allowed = friction, offset, allowed
        self.forget()

    def forget(self) -> None:
        """Nothing is known about distances."""
        count = len(self.friction)
        self._gap = np.full(count, -np.inf)
        self._place = np.zeros((count, 3))
        self._time = np.zeros(count)

    def bound(self, x: FloatArray, time: float) -> FloatArray:
        """Lower bound (V,) m on the signed distance of vertices at x (V,3), less the offset."""
        moved = np.linalg.norm(self.body.place(x, time) - self._place, axis=1)
        sway = {float(t): self.body.sway(float(t), time) for t in np.unique(self._time)}
        drifted = np.array([sway[t] for t in self._time.tolist()]) if any(sway.values()) else 0.0
        return np.asarray(self._gap - moved - drifted - self.offset)

    def ask(self, x: FloatArray, time: float, vertices: IntArray) -> tuple[FloatArray, FloatArray]:
        """Signed distance less offset (N,) and normal (N,3) of some vertices of x (V,3)."""
        if len(vertices) == 0:
            return np.zeros(0), np.zeros((0, 3))
        points = x[vertices]
        gap, normal = self.body.signed_distance(points, time)
        self._gap[vertices] = gap
        self._place[vertices] = self.body.place(points, time)
        self._time[vertices] = time
        return gap - self.offset[vertices], normal


@dataclass(frozen=True, eq=False)
class Reach:
    """What the vertices may do in a step: start and end [s], positions (V,3), reach (V,) [m]."""

    start: float
    end: float
    x: FloatArray
    reach: FloatArray


class Detector:
    """Finds the touches of a step and checks afterwards that nothing was missed.

    fine  m, length over which obstacles are resolved along a fast path: the mean edge length
    deep  m, error of the linearised gap that is let pass
    """

    def __init__(self, watches: Sequence[Watch], fine: float, deep: float) -> None:
        self.watches = tuple(watches)
        self.fine, self.deep = fine, deep

    def find(self, step: Reach, stiffness: FloatArray, also: Sequence[IntArray] = ()) -> Touches:
        """Touches of the vertices within reach, and of those in ``also`` (one array a body).

        stiffness  (V,3,3) diagonal blocks of A
        """
        parts = [
            self._of(watch, step, also[number] if also else np.zeros(0, dtype=np.int64))
            for number, watch in enumerate(self.watches)
        ]
        columns = [np.concatenate(column) for column in zip(*parts)] if parts else []
        if not columns:
            return _nothing()
        vertex, body, normal, friction, gap, carried = columns
        own = _SOFTER * stiffness[vertex]
        along = np.einsum("ci,cij,cj->c", normal, own, normal)
        across = 0.5 * (np.trace(own, axis1=1, axis2=2) - along)
        _, place = np.unique(vertex, return_index=True)
        first = np.zeros(len(vertex), dtype=bool)
        first[place] = True
        return Touches(vertex, body, normal, friction, gap, carried, along, across, first)

    def _of(self, watch: Watch, step: Reach, also: IntArray) -> tuple[AnyArray, ...]:
        near = watch.allowed & (watch.bound(step.x, step.start) <= step.reach)
        near[also] = True
        asked = np.flatnonzero(near)
        carried = watch.body.carry(step.x[asked], step.start, step.end)
        there = step.x.copy()
        there[asked] = carried
        gap, normal = watch.ask(there, step.end, asked)
        kept = (gap <= step.reach[asked]) | np.isin(asked, also)
        vertex = asked[kept]
        return (
            vertex,
            np.full(len(vertex), watch.body.number),
            normal[kept],
            watch.friction[vertex],
            gap[kept],
            (carried - step.x[asked])[kept],
        )

    def missed(
        self, step: Reach, touches: Touches, x: FloatArray, pushed: BoolArray
    ) -> tuple[list[IntArray], float]:
        """Vertices that met a body without a touch, by body, and the worst error of a gap [m].

        x  (V,3) m at the end of the step;  pushed (C,): touches with a force
        """
        worst, found = 0.0, []
        for watch in self.watches:
            mine = touches.body == watch.body.number
            known = np.zeros(len(x), dtype=bool)
            known[touches.vertex[mine]] = True
            bound = watch.bound(x, step.end)
            sunk = watch.allowed & (bound < np.where(known, -self.deep, 0.0))
            near = np.flatnonzero(sunk)
            gap, _ = watch.ask(x, step.end, near)
            deep = near[known[near] & (gap < -self.deep)]
            if len(deep):
                error = np.minimum(self._start(watch, step, deep), 0.0) - gap[np.isin(near, deep)]
                worst = max(worst, float(error.max()))
            worst = max(worst, self._held_off(watch, touches, mine & pushed, step, x))
            fast = self._fast(watch, step, x)
            crossed = fast[self._crosses(watch, step, x, fast)]
            if known[crossed].any():
                worst = max(worst, self.fine)
            found.append(np.union1d(near[(gap < 0.0) & ~known[near]], crossed[~known[crossed]]))
        return found, worst

    def _held_off(
        self, watch: Watch, touches: Touches, chosen: BoolArray, step: Reach, x: FloatArray
    ) -> float:
        """How far [m] the plane of a touch holds a vertex off a body that curves away from it."""
        at = np.flatnonzero(chosen)
        moves = np.linalg.norm(touches.slips(x - step.x)[at], axis=1)
        ids = touches.vertex[at[moves > self.deep]]
        if not len(ids):
            return 0.0
        return float(watch.ask(x, step.end, ids)[0].max())

    def _start(self, watch: Watch, step: Reach, vertices: IntArray) -> FloatArray:
        carried = watch.body.carry(step.x[vertices], step.start, step.end)
        gap, _ = watch.body.signed_distance(carried, step.end)
        return np.asarray(gap - watch.offset[vertices])

    def _fast(self, watch: Watch, step: Reach, x: FloatArray) -> IntArray:
        """Vertices that move farther than ``fine`` and than they are away."""
        before = watch.body.place(step.x, step.start)
        moved = np.linalg.norm(watch.body.place(x, step.end) - before, axis=1)
        moved = moved + watch.body.sway(step.start, step.end)
        candidates = watch.allowed & (moved > self.fine)
        if not candidates.any():
            return np.zeros(0, dtype=np.int64)
        return np.flatnonzero(candidates & (watch.bound(x, step.end) < moved))

    def _crosses(self, watch: Watch, step: Reach, x: FloatArray, vertices: IntArray) -> BoolArray:
        """Whether vertices go deeper than ``fine`` / 2 into the body on their way.

        The way is straight as seen from the body at the end of the step; it is walked by as much
        as the distance allows, and by ``fine`` / 2 where that is less.
        """
        body, end = watch.body, step.end
        begin = body.carry(step.x[vertices], step.start, end)
        way = x[vertices] - begin
        length = np.linalg.norm(way, axis=1)
        hit = np.zeros(len(vertices), dtype=bool)
        done = np.zeros(len(vertices))
        going = np.flatnonzero(length > self.fine)
        for _ in range(_SAMPLES):
            if not len(going):
                break
            share = (done[going] / length[going])[:, None]
            gap = body.signed_distance(begin[going] + share * way[going], end)[0]
            gap = gap - watch.offset[vertices[going]]
            hit[going] |= gap < -0.5 * self.fine
            done[going] += np.maximum(gap, 0.5 * self.fine)
            going = going[(done[going] < length[going]) & ~hit[going]]
        return hit


def _nothing() -> Touches:
    ids, none, rows = np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros((0, 3))
    return Touches(ids, ids, rows, none, none, rows, none, none, np.zeros(0, dtype=bool))
