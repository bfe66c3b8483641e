"""Which vertices touch which obstacle: signed distance below a tolerance.

The target is not moved onto the obstacle.  Each contact keeps its signed gap, negative where the
vertex penetrates; a vertex near two obstacles is in contact twice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from casashell.contact.cone import UNIT, check_unit, tangents
from casashell.contact.obstacles import Obstacle, checked
from casashell.contact.validation import indices, number1, points3
from casashell.typing import AnyArray, ArrayLike, BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Contacts:
    """Contacts of a shell with obstacles, ordered by obstacle, then vertex.

    vertices  (C,) vertex ids; a vertex may appear twice (two obstacles)
    normals   (C, 3) unit, out of the obstacle into the shell
    friction  (C,) Coulomb coefficient of the obstacle
    gaps      (C,) m, signed distance, negative = penetrating
    obstacle  (C,) index into the obstacles

    Arrays are copied and read-only.  Raises ValueError on shapes and normals that are not unit.
    """

    vertices: IntArray
    normals: FloatArray
    friction: FloatArray
    gaps: FloatArray
    obstacle: IntArray

    def __post_init__(self) -> None:
        count = np.shape(self.vertices)[0]
        for name, kind, shape in (
            ("vertices", np.int64, (count,)),
            ("normals", np.float64, (count, 3)),
            ("friction", np.float64, (count,)),
            ("gaps", np.float64, (count,)),
            ("obstacle", np.int64, (count,)),
        ):
            array: AnyArray = np.array(getattr(self, name), dtype=kind)
            if array.shape != shape:
                raise ValueError(f"Contacts.{name} must have shape {shape}, got {array.shape}")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        check_unit(self.normals, "Contacts.normals")

    @classmethod
    def empty(cls) -> Contacts:
        """No contact at all."""
        none = np.zeros(0)
        ids = np.zeros(0, dtype=np.int64)
        return cls(ids, np.zeros((0, 3)), none, none, ids)

    def __len__(self) -> int:
        return len(self.vertices)

    def subset(self, mask: BoolArray | IntArray) -> Contacts:
        """Contacts selected by a mask (C,) or by their numbers, in that order."""
        return Contacts(
            self.vertices[mask],
            self.normals[mask],
            self.friction[mask],
            self.gaps[mask],
            self.obstacle[mask],
        )

    @cached_property
    def tangents(self) -> tuple[FloatArray, FloatArray]:
        """Unit t1, t2 (C, 3) with t1 x t2 = normal."""
        return tangents(self.normals)


@dataclass(frozen=True)
class ContactSummary:
    """Contacts with one obstacle.

    obstacle       its number; label: its name, or kind and number
    count          contacts; penetrating: those with a negative gap
    deepest        m, largest penetration depth, zero without penetration
    deepest_vertex the vertex that penetrates deepest; None without penetration
    largest_gap    m, largest positive gap, zero when there is none
    """

    obstacle: int
    label: str
    count: int
    penetrating: int
    deepest: float
    deepest_vertex: int | None
    largest_gap: float


def detect(
    points: ArrayLike,
    obstacles: Sequence[Obstacle],
    tolerance: float,
    exclude: ArrayLike = (),
) -> Contacts:
    """Vertices whose signed distance to an obstacle is below ``tolerance``.

    points     (V, 3) m
    tolerance  m, zero or more; with zero only penetrating vertices count
    exclude    vertex ids that are never in contact (pinned vertices)

    Raises ValueError naming the vertex, the obstacle or the parameter.
    """
    x = points3(points)
    reach = number1(tolerance, "contact tolerance")
    if reach < 0.0:
        raise ValueError(f"contact tolerance must be zero or more, got {tolerance!r}")
    allowed = np.ones(len(x), dtype=bool)
    allowed[indices(exclude, len(x), "exclude")] = False
    found = [
        _with_one(x, number, obstacle, reach, allowed)
        for number, obstacle in enumerate(checked(obstacles))
    ]
    touching = [contacts for contacts in found if len(contacts)]
    if not touching:
        return Contacts.empty()
    return Contacts(
        np.concatenate([c.vertices for c in touching]),
        np.concatenate([c.normals for c in touching]),
        np.concatenate([c.friction for c in touching]),
        np.concatenate([c.gaps for c in touching]),
        np.concatenate([c.obstacle for c in touching]),
    )


def describe(contacts: Contacts, obstacles: Sequence[Obstacle]) -> tuple[ContactSummary, ...]:
    """One summary per obstacle, those without contact included."""
    return tuple(_summary(contacts, number, obstacle) for number, obstacle in enumerate(obstacles))


def _with_one(
    x: FloatArray, number: int, obstacle: Obstacle, reach: float, allowed: BoolArray
) -> Contacts:
    """Contacts of all allowed vertices with one obstacle."""
    near = allowed
    box = obstacle.bounding_box()
    if box is not None:
        near = allowed & ((x > box[0] - reach) & (x < box[1] + reach)).all(axis=1)
    vertices = np.flatnonzero(near)
    if vertices.size == 0:
        return Contacts.empty()
    gap, normal = obstacle.signed_distance(x[vertices])
    if np.shape(gap) != vertices.shape or np.shape(normal) != (vertices.size, 3):
        raise ValueError(
            f"signed_distance of {_label(obstacle, number)} must return shapes ({vertices.size},) "
            f"and ({vertices.size}, 3), got {np.shape(gap)} and {np.shape(normal)}"
        )
    bad = np.flatnonzero(~np.isfinite(gap))
    if bad.size:
        raise ValueError(
            f"signed_distance of {_label(obstacle, number)} is {gap[bad[0]]} "
            f"at vertex {int(vertices[bad[0]])}"
        )
    close = np.flatnonzero(gap < reach)
    length = np.linalg.norm(normal[close], axis=1)
    off = np.flatnonzero(~(np.abs(length - 1.0) <= UNIT))
    if off.size:
        raise ValueError(
            f"signed_distance of {_label(obstacle, number)} at vertex "
            f"{int(vertices[close[off[0]]])}: normal has length {length[off[0]]:.6g}, not 1"
        )
    count = close.size
    return Contacts(
        vertices[close],
        normal[close],
        np.full(count, obstacle.friction),
        gap[close],
        np.full(count, number),
    )


def _summary(contacts: Contacts, number: int, obstacle: Obstacle) -> ContactSummary:
    """Counts and extremes of the contacts with one obstacle."""
    own = contacts.subset(contacts.obstacle == number)
    deepest = int(np.argmin(own.gaps)) if len(own) and own.gaps.min() < 0.0 else None
    return ContactSummary(
        obstacle=number,
        label=_label(obstacle, number),
        count=len(own),
        penetrating=int((own.gaps < 0.0).sum()),
        deepest=0.0 if deepest is None else -float(own.gaps[deepest]),
        deepest_vertex=None if deepest is None else int(own.vertices[deepest]),
        largest_gap=float(own.gaps.max(initial=0.0)),
    )


def _label(obstacle: Obstacle, number: int) -> str:
    return obstacle.name or f"{type(obstacle).__name__} {number}"
