"""What holds a ribbon: attached material points, a held end, and what cannot hold it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from casashell.ribbon.chain import BOTTOM, COORDINATES, NORMAL, TOP, reconstruct
from casashell.ribbon.conditions import Condition
from casashell.ribbon.forces import ends, quads, vector
from casashell.ribbon.physics import RibbonPhysics
from casashell.ribbon.ribbon import Ribbon, RibbonState
from casashell.typing import ArrayLike

#: Part of the ribbon's length by which two attachments may disagree.
TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class Attachment:
    """The material point (s, y) [m], s from the begin and y from the centreline, is at ``place`` (3,)."""

    s: float
    y: float
    place: ArrayLike

    def __post_init__(self) -> None:
        object.__setattr__(self, "place", vector("place of an attachment", self.place))


@dataclass(frozen=True, eq=False)
class HeldEnd:
    """The last quad ends at ``middle`` (3,) [m] with the axes ``frame`` (3,3): along, across, normal."""

    middle: ArrayLike
    frame: ArrayLike

    def __post_init__(self) -> None:
        object.__setattr__(self, "middle", vector("middle of a held end", self.middle))
        frame = np.array(self.frame, dtype=np.float64)
        if frame.shape != (3, 3) or not np.allclose(frame.T @ frame, np.eye(3), atol=1e-9):
            raise ValueError("frame of a held end must be a rotation (3, 3)")
        object.__setattr__(self, "frame", frame)


def attached(
    ribbon: Ribbon, physics: RibbonPhysics, attachment: Attachment, quad: int
) -> Condition:
    """The condition on a quad, as from `taut.held_points`."""
    size = ribbon.segment
    place = [attachment.s, attachment.y, quad * size, size, ribbon.width]
    data = np.concatenate([np.asarray(attachment.place), place])
    return Condition(physics.attachment, quads(ribbon.segments)[quad], data)


def still(physics: RibbonPhysics, station: int, slope: float) -> Condition:
    """The ruling of a station keeps its slope."""
    return Condition(physics.ruling, np.array([4 * station + COORDINATES]), np.array([slope]))


def held(ribbon: Ribbon, physics: RibbonPhysics, end: HeldEnd) -> Condition:
    """The condition of a held end."""
    rows = 4 * ribbon.segments + np.array([BOTTOM, TOP, NORMAL], dtype=np.int64)
    frame = np.asarray(end.frame).ravel(order="F")
    data = np.concatenate([np.asarray(end.middle), frame, [ribbon.length]])
    return Condition(physics.held, rows, data)


def closing(ribbon: Ribbon, physics: RibbonPhysics, *, flat: bool) -> Condition:
    """The ends are joined; with a ``flat`` junction, or free to bend there."""
    density = physics.smooth if flat else physics.crease
    return Condition(density, ends(ribbon.segments)[0], np.array([ribbon.length]))


def require_consistent(
    ribbon: Ribbon, base: RibbonState, attachments: Sequence[Attachment], end: HeldEnd | None
) -> None:
    """Raise ValueError naming two holds that no shape of the ribbon can meet.

    An isometric strip brings no two points further apart than they are when flat, and not at all
    closer or further within one quad.
    """
    points = [(f"attachment {i}", a.s, a.y, np.asarray(a.place)) for i, a in enumerate(attachments)]
    half = 0.5 * ribbon.width
    if ribbon.ends == "clamped":
        strip = reconstruct(ribbon, base)
        names = ((-half, strip.bottom[0]), (half, strip.top[0]))
        points += [("the clamped begin", 0.0, y, place) for y, place in names]
    if end is not None:
        if ribbon.closed:
            raise ValueError("a closed ribbon has no end to hold")
        frame, middle = np.asarray(end.frame), np.asarray(end.middle)
        points += [
            ("the held end", ribbon.length, y, middle + y * frame[:, 1]) for y in (-half, half)
        ]
    for i, (name, s, y, place) in enumerate(points):
        for other, t, z, there in points[:i]:
            apart = float(np.hypot(s - t, y - z))
            found = float(np.linalg.norm(place - there))
            if found > apart + TOLERANCE * ribbon.length:
                raise ValueError(
                    f"{name} and {other} contradict each other: {found:.6g} m apart, but the strip "
                    f"has only {apart:.6g} m between these points; move them closer"
                )
