"""Obstacles in motion, as the stepper sees them: distance at a time, and what rides on the surface.

    place(x, t)      coordinates in which the surface rests or nearly so; two points of space that are
                     d apart there have signed distances that differ by at most d (+ ``sway``)
    carry(x, t0, t1) where a point that is attached to the nearest piece of surface moves

The displacement carry(x) - x over a step is the velocity of the contact point times the step, so
velocity and positions agree to rounding.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from casashell.contact.mesh_obstacle import MeshObstacle
from casashell.contact.obstacles import Obstacle
from casashell.typing import FloatArray, IntArray

#: Rotation (3,3) and shift (3,) of a rigid body at a time.
Pose = Callable[[float], tuple[FloatArray, FloatArray]]


class Body(Protocol):
    """An obstacle that may move.

    obstacle  as the scene has it;  number: its place among the obstacles
    """

    @property
    def obstacle(self) -> Obstacle: ...

    @property
    def number(self) -> int: ...

    def signed_distance(self, points: FloatArray, time: float) -> tuple[FloatArray, FloatArray]:
        """Distance (N,) m and normal (N,3) of points (N,3) from the surface at ``time``."""

    def carry(self, points: FloatArray, start: float, end: float) -> FloatArray:
        """Where points (N,3) fixed to the nearest surface at ``start`` are at ``end``."""

    def place(self, points: FloatArray, time: float) -> FloatArray:
        """Points (N,3) seen from the body."""

    def sway(self, start: float, end: float) -> float:
        """How far [m] the surface moves at most, seen in the coordinates of ``place``."""


@dataclass(frozen=True, eq=False)
class RestingBody:
    """An obstacle that stays where it is."""

    obstacle: Obstacle
    number: int

    def signed_distance(self, points: FloatArray, time: float) -> tuple[FloatArray, FloatArray]:
        """Distance (N,) m and normal (N,3)."""
        return self.obstacle.signed_distance(points)

    def carry(self, points: FloatArray, start: float, end: float) -> FloatArray:
        """The points themselves."""
        return points

    def place(self, points: FloatArray, time: float) -> FloatArray:
        """The points themselves."""
        return points

    def sway(self, start: float, end: float) -> float:
        """Nothing moves."""
        return 0.0


@dataclass(frozen=True, eq=False)
class RigidBody:
    """An obstacle that moves as a whole: ``x -> R(t) x + s(t)``."""

    obstacle: Obstacle
    number: int
    pose: Pose

    def signed_distance(self, points: FloatArray, time: float) -> tuple[FloatArray, FloatArray]:
        """Distance (N,) m and normal (N,3)."""
        gap, normal = self.obstacle.signed_distance(self.place(points, time))
        return gap, np.asarray(normal @ self.pose(time)[0].T)

    def carry(self, points: FloatArray, start: float, end: float) -> FloatArray:
        """Points moved as the body moves; the points themselves when it does not."""
        (before, shift), (after, moved) = self.pose(start), self.pose(end)
        if np.array_equal(before, after) and np.array_equal(shift, moved):
            return points
        turn = after @ before.T
        return np.asarray((points - shift) @ turn.T + moved)

    def place(self, points: FloatArray, time: float) -> FloatArray:
        """Points where they would be had the body not moved."""
        turn, shift = self.pose(time)
        return np.asarray((points - shift) @ turn)

    def sway(self, start: float, end: float) -> float:
        """A rigid body does not move in its own coordinates."""
        return 0.0


@dataclass(frozen=True)
class _Triangles:
    vertices: FloatArray
    faces: IntArray


@dataclass(frozen=True, eq=False)
class DeformingBody:
    """A mesh obstacle with vertices (V,3) that are a function of time."""

    obstacle: MeshObstacle
    number: int
    vertices: Callable[[float], FloatArray]
    _kept: OrderedDict[float, tuple[MeshObstacle, Any]] = field(
        default_factory=OrderedDict, repr=False
    )

    def _at(self, time: float) -> tuple[MeshObstacle, Any]:
        """The obstacle at ``time`` and a search tree over its faces as given."""
        if time not in self._kept:
            import igl

            mesh = _Triangles(np.ascontiguousarray(self.vertices(time)), self._faces)
            tree = igl.AABB()
            tree.init(mesh.vertices, mesh.faces)
            self._kept[time] = (replace(self.obstacle, mesh=mesh), tree)
            while len(self._kept) > 3:
                self._kept.popitem(last=False)
        return self._kept[time]

    @property
    def _faces(self) -> IntArray:
        return np.ascontiguousarray(self.obstacle.mesh.faces, dtype=np.int64)

    def signed_distance(self, points: FloatArray, time: float) -> tuple[FloatArray, FloatArray]:
        """Distance (N,) m and normal (N,3)."""
        return self._at(time)[0].signed_distance(points)

    def carry(self, points: FloatArray, start: float, end: float) -> FloatArray:
        """Points moved with the nearest triangle: its nearest point, and the arm in its own axes."""
        here, there = self.vertices(start), self.vertices(end)
        if len(points) == 0 or np.array_equal(here, there):
            return points
        _, face, foot = self._at(start)[1].squared_distance(
            np.ascontiguousarray(here), self._faces, np.ascontiguousarray(points)
        )
        corners = self._faces[np.asarray(face, dtype=np.int64)]
        before, after = here[corners], there[corners]
        moved = np.einsum("ni,nij->nj", _weights(before, foot), after - before)
        arm = points - foot
        turned = np.einsum("nij,ni->nj", _axes(after), np.einsum("nij,nj->ni", _axes(before), arm))
        return np.asarray(points + moved + (turned - arm))

    def place(self, points: FloatArray, time: float) -> FloatArray:
        """The points themselves."""
        return points

    def sway(self, start: float, end: float) -> float:
        """Largest move of a vertex: no point of the surface moves farther."""
        moves = self.vertices(end) - self.vertices(start)
        return float(np.sqrt((moves**2).sum(axis=1).max()))


def _axes(corners: FloatArray) -> FloatArray:
    """Orthonormal rows (N,3,3) of triangles (N,3,3): along the first side, across it, normal."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    along = first / np.linalg.norm(first, axis=1, keepdims=True)
    normal = np.cross(first, second)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return np.stack([along, np.cross(normal, along), normal], axis=1)


def _weights(corners: FloatArray, points: FloatArray) -> FloatArray:
    """Barycentric weights (N,3) of points (N,3) on triangles (N,3,3)."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = points - corners[:, 0]
    aa, ab, bb = (a * a).sum(1), (a * b).sum(1), (b * b).sum(1)
    pa, pb = (p * a).sum(1), (p * b).sum(1)
    area = aa * bb - ab * ab
    v, w = (bb * pa - ab * pb) / area, (aa * pb - ab * pa) / area
    return np.stack([1.0 - v - w, v, w], axis=1)
