"""Two held points as far apart as in the flat strip: it is straight between them.

An isometric strip brings no two points further apart than they are when flat.  Held at that distance,
their straight connection lies in a ruling or within one quad; a crease between them that bends would
bring them closer.  Conditions on two quads then have no independent derivatives, which no
optimiser gets through.  Told of one and the same quad, they have, and that quad's rulings keep out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from casashell.ribbon.forces import material
from casashell.ribbon.ribbon import Ribbon
from casashell.typing import FloatArray

if TYPE_CHECKING:
    from casashell.ribbon.holds import Attachment

#: Part of the ribbon's length by which a connection may be shorter than flat, and still be straight.
TAUT = 1e-9
#: Part of a segment within which a point is on a ruling.
_NEAR = 1e-6


@dataclass(frozen=True)
class Limit:
    """lower <= c_station <= upper."""

    station: int
    lower: float
    upper: float


@dataclass(frozen=True)
class Held:
    """What attachments ask of the rulings.

    quads    one an attachment
    rulings  station and slope of each that may not turn
    limits   of slopes of rulings that may not pass a held point
    """

    quads: tuple[int, ...]
    rulings: tuple[tuple[int, float], ...] = ()
    limits: tuple[Limit, ...] = ()


def held_points(
    ribbon: Ribbon, attachments: Sequence[Attachment], slopes: FloatArray | None
) -> Held:
    """For rulings that now have ``slopes`` (N+1,), None for all 0.  ValueError as of `material`."""
    quads = [material(ribbon, a.s, a.y, slopes)[0] for a in attachments]
    now = np.zeros(ribbon.segments + 1) if slopes is None else slopes
    most = ribbon.most_turn * ribbon.segments  # no ruling gets there
    rulings: dict[int, float] = {}
    limits: dict[int, Limit] = {}
    for i, j in combinations(range(len(attachments)), 2):
        one, two = attachments[i], attachments[j]
        apart = np.linalg.norm(np.subtract(one.place, two.place))
        if apart < np.hypot(one.s - two.s, one.y - two.y) - TAUT * ribbon.length:
            continue
        quad = _common(ribbon, (one, two), now)
        if quad is None:
            continue
        quads[i] = quads[j] = quad
        for station in (quad, quad + 1):
            if not 0 < station < ribbon.segments:
                continue
            gaps = [_gap(ribbon, a, station, now) for a in (one, two)]
            if max(map(abs, gaps)) < _NEAR * ribbon.segment and one.y != two.y:
                rulings[station] = (one.s - two.s) / (one.y - two.y)
                continue
            known = limits.get(station, Limit(station, -most, most))
            limits[station] = _narrowed(known, ribbon, (one, two), before=station == quad)
    free = tuple(limits[station] for station in sorted(limits) if station not in rulings)
    return Held(tuple(quads), tuple(sorted(rulings.items())), free)


def _narrowed(
    limit: Limit, ribbon: Ribbon, points: tuple[Attachment, Attachment], *, before: bool
) -> Limit:
    """A ruling ``before`` the points, or behind them, that does not pass them."""
    lower, upper = limit.lower, limit.upper
    for point in points:
        if point.y == 0.0:
            continue
        slope = float((point.s - limit.station * ribbon.segment) / point.y)
        if (point.y > 0.0) == before:
            upper = min(upper, slope)
        else:
            lower = max(lower, slope)
    return Limit(limit.station, lower, upper)


def _gap(ribbon: Ribbon, point: Attachment, station: int, slopes: FloatArray) -> float:
    """How far [m] a point is behind a ruling, along the strip."""
    return float(point.s - station * ribbon.segment - slopes[station] * point.y)


def _common(
    ribbon: Ribbon, points: tuple[Attachment, Attachment], slopes: FloatArray
) -> int | None:
    """The quad that holds both points best; None when none does."""
    stations = ribbon.segment * np.arange(ribbon.segments + 1)
    gaps = [point.s - stations - slopes * point.y for point in points]
    inside = np.min([[gap[:-1], -gap[1:]] for gap in gaps], axis=(0, 1))
    best = int(np.argmax(inside))
    return best if inside[best] > -_NEAR * ribbon.segment else None
