"""Collision response of the ribbons of a scene: from rims to triangulated strips and back."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casashell.contact.obstacles import Obstacle
from casashell.ribbon.chain import reconstruct
from casashell.ribbon.collide import Collider
from casashell.ribbon.ribbon import Ribbon
from casashell.ribbon.scene import Body, Collide
from casashell.ribbon.strips import Ends, ribbon_strip, to_rims, to_vertices
from casashell.typing import FloatArray


def _ends(ribbon: Ribbon) -> Ends:
    if ribbon.ends == "loop" or ribbon.ends == "moebius":
        return ribbon.ends
    return "open"


def strip_collisions(
    bodies: Sequence[Body], thickness: float, obstacles: Sequence[Obstacle]
) -> Collide:
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
    collider = Collider(tuple(strips), tuple(obstacles))
    kinds = [_ends(body.ribbon) for body in bodies]
    cuts = np.cumsum([len(strip.masses) for strip in strips])[:-1]

    def collide(start: Sequence[FloatArray], end: Sequence[FloatArray]) -> list[FloatArray]:
        before, after = (
            [to_vertices(rims[0], rims[1], kind) for rims, kind in zip(places, kinds)]
            for places in (start, end)
        )
        found = np.split(collider.resolve(before, after).positions, cuts)
        return [np.stack(to_rims(x, kind)) for x, kind in zip(found, kinds)]

    return collide
