"""The fail-safe: vertices that keep hitting each other move on together, as rigid bodies.

A zone is a set of vertices (Provot 1997; Bridson, Fedkiw, Anderson 2002).  It moves by the
rigid motion that fits its proposed motion best, weighted by mass, which keeps its momentum.  On the
straight ways from start to end the zone then goes through the maps (1 - t) I + t R, which are
invertible for any rotation short of half a turn, so nothing inside a zone can pass through itself.
Zones that hit something merge with it.  When that is not enough, whole strips become zones, then
everything stays where it was.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from casashell.ribbon.impacts import Detector, Rows
from casashell.typing import BoolArray, FloatArray, IntArray

# Rounds in which zones grow by the vertices that were hit; the same again by whole strips.
_ROUNDS = 10


class Unresolved(RuntimeError):
    """No positions without interpenetration were found."""


def rigid_zones(detector: Detector, positions: FloatArray) -> FloatArray:
    """Positions (V,3) that are reached without an impact, close to the given ones.

    Raises Unresolved when prescribed motions alone collide.
    """
    bodies, start = detector.bodies, detector.start
    zone: IntArray = np.full(bodies.count, -1, dtype=np.int64)
    x = positions
    for number in range(2 * _ROUNDS):
        rows = Rows.joined([detector.pair_rows(x, zone), detector.obstacle_rows(x, deeper=True)])
        rows = rows.subset(np.flatnonzero(bodies.free[rows.vertices].any(axis=1)))
        if len(rows) == 0:
            return x
        zone = _merged(zone, rows.vertices, bodies.owner if number >= _ROUNDS else None)
        x = _moved(detector, positions, zone)
    x = np.where(bodies.free[:, None], start, positions)
    rows = Rows.joined(
        [
            detector.pair_rows(x, np.where(bodies.free, 0, -1)),
            detector.obstacle_rows(x, deeper=True),
        ]
    )
    if len(rows):
        raise Unresolved(
            f"{bodies.name(int(rows.vertices[0, 0]))} collides even when all free vertices stay "
            "where they are: a pinned vertex or an obstacle moves into the strip; take a smaller "
            "time step, or unpin vertices"
        )
    return x


def _merged(zone: IntArray, hit: IntArray, owner: IntArray | None) -> IntArray:
    """Zones (V,), -1 for none, after joining the vertices (C,4) of each row, or their strips."""
    count = len(zone)
    links = [hit[:, [0, k]] for k in (1, 2, 3)]
    old = np.flatnonzero(zone >= 0)
    first = np.full(int(zone.max(initial=-1)) + 1, count)
    np.minimum.at(first, zone[old], old)
    links.append(np.column_stack([old, first[zone[old]]]))
    inside = np.zeros(count, dtype=np.bool_)
    inside[hit] = inside[old] = True
    if owner is not None:
        inside = np.isin(owner, owner[inside])
        members = np.flatnonzero(inside)
        head = np.full(int(owner.max()) + 1, count)
        np.minimum.at(head, owner[members], members)
        links.append(np.column_stack([members, head[owner[members]]]))
    a, b = np.concatenate(links).T
    graph = sparse.coo_matrix((np.ones(len(a)), (a, b)), (count, count))
    label = connected_components(graph, directed=False)[1]
    return np.where(inside, label, -1)


def _moved(detector: Detector, proposed: FloatArray, zone: IntArray) -> FloatArray:
    """Proposed positions with every zone moved rigidly; those that cannot be stay at the start."""
    bodies, start = detector.bodies, detector.start
    x = proposed.copy()
    for label in np.unique(zone[zone >= 0]):
        members = zone == label
        x[members] = _rigid(start[members], proposed[members], bodies.masses[members])
    x[~bodies.free] = proposed[~bodies.free]
    blocked = _blocked(detector, x, zone)
    x[blocked] = start[blocked]
    return x


def _blocked(detector: Detector, x: FloatArray, zone: IntArray) -> BoolArray:
    """Vertices (V,) of zones that hold a pinned vertex or would enter an obstacle."""
    bodies = detector.bodies
    marked = ~bodies.free
    marked[detector.obstacle_rows(x, deeper=True).vertices] = True
    stuck = np.unique(zone[marked & (zone >= 0)])
    result: BoolArray = np.isin(zone, stuck) & bodies.free
    return result


def _rigid(start: FloatArray, end: FloatArray, masses: FloatArray) -> FloatArray:
    """The rigid motion of start (K,3) nearest to end in the mass norm (Kabsch 1976)."""
    share = masses / masses.sum()
    before, after = share @ start, share @ end
    u, _, vt = np.linalg.svd((start - before).T @ (share[:, None] * (end - after)))
    u[:, -1] *= np.sign(np.linalg.det(u @ vt))
    result: FloatArray = (start - before) @ (u @ vt) + after
    return result
