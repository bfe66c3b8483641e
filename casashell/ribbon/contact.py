"""Collision response of the ribbons of a scene: from rims to triangulated strips and back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from casashell.contact.obstacles import Obstacle
from casashell.ribbon.chain import BOTTOM, TOP, reconstruct
from casashell.ribbon.collide import Collider, Resolved
from casashell.ribbon.impacts import Rows
from casashell.ribbon.ribbon import Ribbon
from casashell.ribbon.scene import Body
from casashell.ribbon.strips import Ends, ribbon_strip, to_rims, to_vertices
from casashell.ribbon.touch import Touch
from casashell.typing import FloatArray


def _ends(ribbon: Ribbon) -> Ends:
    if ribbon.ends == "loop" or ribbon.ends == "moebius":
        return ribbon.ends
    return "open"


@dataclass(frozen=True, eq=False)
class StripCollisions:
    """Response of the strips of ``bodies``, on rims (2,N+1,3) [m]."""

    bodies: Sequence[Body]
    collider: Collider

    @cached_property
    def _kinds(self) -> list[Ends]:
        return [_ends(body.ribbon) for body in self.bodies]

    def __call__(self, start: Sequence[FloatArray], end: Sequence[FloatArray]) -> list[FloatArray]:
        """Rims near ``end`` without interpenetration."""
        return self.respond(start, end)[0]

    def respond(
        self, start: Sequence[FloatArray], end: Sequence[FloatArray]
    ) -> tuple[list[FloatArray], Resolved]:
        """The same, and how they came about."""
        before, after = (
            [to_vertices(rims[0], rims[1], kind) for rims, kind in zip(places, self._kinds)]
            for places in (start, end)
        )
        found = self.collider.resolve(before, after)
        parts = self.collider.bodies.split(found.positions)
        return [np.stack(to_rims(x, kind)) for x, kind in zip(parts, self._kinds)], found

    def touches(self, rows: Rows) -> list[Touch | None]:
        """What those of ``rows`` ask of each ribbon that are about nothing else that moves.

        Rows about two ribbons are left out: told to each of them apart, they would ask both to
        get out of the other's way by themselves, at any cost of bending.
        """
        bodies, made = self.collider.bodies, list[Touch | None]()
        owner = bodies.owner[rows.vertices]
        alone = (owner == owner[:, :1]).all(axis=1)
        for k, (body, first) in enumerate(zip(self.bodies, bodies.offsets)):
            own = rows.subset(alone & (owner[:, 0] == k))
            if not len(own):
                made.append(None)
                continue
            station, side = np.divmod(own.vertices - first, 2)
            place = 4 * station + np.where(side == 0, BOTTOM, TOP)
            push = own.weights[:, :, None] * own.normals[:, None, :]
            made.append(Touch(place, push, own.bounds, body.ribbon.length))
        return made


def strip_collisions(
    bodies: Sequence[Body], thickness: float, obstacles: Sequence[Obstacle]
) -> StripCollisions:
    """Response for ``bodies`` of ``thickness`` [m]; the first quad of a clamped one may not give way."""
    strips = []
    for body in bodies:
        ribbon, shape = body.ribbon, reconstruct(body.ribbon, body.initial)
        strips.append(
            ribbon_strip(
                shape.bottom,
                shape.top,
                mass=ribbon.density * ribbon.width * ribbon.length,
                thickness=thickness,
                ends=_ends(ribbon),
                pinned=(0, 1) if ribbon.ends == "clamped" else (),
            )
        )
    return StripCollisions(bodies, Collider(tuple(strips), tuple(obstacles)))
