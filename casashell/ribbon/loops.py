"""Closed ribbons: starts for loops and Moebius bands, and their twist, writhe and linking number.

Every band with the right number of half twists meets the closing conditions; which one is found is
decided by the start.  The starts here are the circle and the band with half a twist.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from casashell.ribbon.chain import Strip, cross, strip
from casashell.ribbon.ribbon import MOST_BENT, Ribbon, RibbonState
from casashell.typing import FloatArray

#: Parameters from which a Moebius band is closed: bends and rulings of the family in `_band`.
_STARTS = tuple(
    (bend, 0.0, 0.0, tilt, 0.0, 0.0) for bend in (0.8, 1.2, 1.6) for tilt in (0.2, 0.6, 1.0)
)
#: Largest gap of a start, over the length, and largest misfit of its ends' directions.
_CLOSED = 1e-5


def circle(ribbon: Ribbon) -> RibbonState:
    """A round loop in the plane across the strip; closed exactly when its junction bends too."""
    n = ribbon.segments
    return RibbonState(np.zeros(n - 1), np.full(n - 1, 2.0 * np.pi / n))


def moebius(ribbon: Ribbon) -> tuple[RibbonState, ...]:
    """Moebius bands with half a twist, closed and flat at the junction, least bent first: starts.

    Members of a symmetric family with six parameters, found by least squares.  Several equilibria are
    nearly as low as the lowest; which start leads there is not known before.
    Raises ValueError when none closes: the strip is too wide for its rulings.
    """
    found: list[tuple[float, RibbonState]] = []
    for start in _STARTS:
        fit = least_squares(lambda p: _misfit(ribbon, p), np.array(start), xtol=1e-12)
        c, beta = _band(ribbon, fit.x)
        shape = strip(ribbon.length, ribbon.width, c, beta, np.eye(3), np.zeros(3))
        bent = np.any(np.abs(beta) > MOST_BENT) or np.abs(np.diff(c)).max() > ribbon.most_turn
        if bent or np.abs(fit.fun).max() > _CLOSED:
            continue
        energy = float(np.sum(beta**2 * (1 + c**2)))
        known = any(abs(energy - other) < 1e-3 * energy for other, _ in found)
        if not known and abs(abs(links(shape, moebius=True).linking) - 0.5) < 0.25:
            found.append((energy, RibbonState(c[1:-1], beta[1:-1])))
    if not found:
        raise ValueError(
            f"no Moebius band of length / width {ribbon.length / ribbon.width:.3g} with "
            f"{ribbon.segments} segments to start from: take more segments, "
            "a longer or narrower strip, or start from a narrower band's equilibrium"
        )
    return tuple(state for _, state in sorted(found, key=lambda entry: entry[0]))


def _band(ribbon: Ribbon, p: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Slopes and angles (N+1,) of the family: straight at the junction, tilted rulings behind it."""
    n = ribbon.segments
    s = np.arange(n + 1) / n
    waves = np.stack([np.sin(k * np.pi * s) ** 2 for k in (1, 2, 3)])
    beta = 2 * np.pi / n * (p[:3] @ waves)
    ramp = max(0.06, 2.0 / n)
    # No steeper than rulings may turn from one to the next.
    steep = 0.9 * ribbon.most_turn * n * ramp
    tilt = p[3] + p[4] * np.cos(2 * np.pi * s) + p[5] * np.cos(4 * np.pi * s)
    tilt = steep * np.tanh(tilt / steep)
    c = tilt * np.tanh(s / ramp) * np.tanh((1 - s) / ramp)
    c[0] = c[-1] = beta[0] = beta[-1] = 0.0
    return c, beta


def _misfit(ribbon: Ribbon, p: FloatArray) -> FloatArray:
    """Closing of a Moebius band: gap over the length, and the frame turned about the centreline."""
    shape = strip(ribbon.length, ribbon.width, *_band(ribbon, p), np.eye(3), np.zeros(3))
    last = shape.behind[-1]
    gap = shape.middle[-1] / ribbon.length
    turned = [last[1, 0], last[2, 0], last[2, 1]]
    side = [max(0.0, 0.5 + last[1, 1]), max(0.0, 0.5 + last[2, 2])]
    return np.concatenate([gap, turned, side])


def gap(ribbon: Ribbon, shape: Strip, *, flat: bool) -> float:
    """How far a closed ribbon is from closed: ends apart, over the length, or normals, if ``flat``.

    The conditions of `formulations.ribbon_closing` have more roots than this: strips that arrive
    backwards or with the wrong side.
    """
    bottom, top, normal = shape.bottom[-1], shape.top[-1], shape.normals[-1]
    if ribbon.ends == "moebius":
        bottom, top, normal = top, bottom, -normal
    apart = max(np.abs(bottom - shape.bottom[0]).max(), np.abs(top - shape.top[0]).max())
    turned = np.abs(normal - shape.normals[0]).max() if flat else 0.0
    return float(max(apart / ribbon.length, turned))


@dataclass(frozen=True)
class Links:
    """Of a closed band: total twist of the rulings about the centreline, writhe, and their sum."""

    twist: float
    writhe: float

    @property
    def linking(self) -> float:
        """Lk = Tw + Wr: a whole number for loops, a half one for Moebius bands."""
        return self.twist + self.writhe


def links(shape: Strip, *, moebius: bool) -> Links:
    """Tw and Wr of a closed strip in turns; the centreline as a polygon, exact for that polygon.

    Wr is the sum of signed solid angles of pairs of edges (Klenin and Langowski 2000), Tw the angle by
    which the strip's normal turns from edge to edge beyond parallel transport.
    """
    points = shape.middle[:-1]
    normals = shape.behind[:-1, :, 2]
    ahead = np.concatenate([normals[1:], (-normals[:1] if moebius else normals[:1])])
    along = np.roll(points, -1, axis=0) - points
    along /= np.linalg.norm(along, axis=1)[:, None]
    behind = np.roll(along, -1, axis=0)
    carried = _transported(along, behind, normals)
    sine = np.einsum("ia,ia->i", cross(carried, ahead), behind)
    twist = np.arctan2(sine, np.einsum("ia,ia->i", carried, ahead)).sum()
    return Links(float(twist) / (2 * np.pi), _writhe(points))


def _transported(first: FloatArray, second: FloatArray, v: FloatArray) -> FloatArray:
    """v (n,3) turned by the smallest rotations that take ``first`` to ``second``, unit vectors."""
    axis = cross(first, second)
    cosine = np.einsum("ia,ia->i", first, second)[:, None]
    dotted = np.einsum("ia,ia->i", axis, v)[:, None]
    return np.asarray(cosine * v + cross(axis, v) + axis * dotted / np.maximum(1.0 + cosine, 1e-12))


def _writhe(points: FloatArray) -> float:
    """Writhe of a closed polygon (n,3)."""
    n = len(points)
    i, j = np.triu_indices(n, 2)
    apart = ~((i == 0) & (j == n - 1))
    i, j = i[apart], j[apart]
    a, b = points[i], points[(i + 1) % n]
    c, d = points[j], points[(j + 1) % n]
    corners = [cross(c - a, d - a), cross(d - a, d - b), cross(d - b, c - b), cross(c - b, c - a)]
    unit = []
    for corner in corners:
        size = np.linalg.norm(corner, axis=1)
        unit.append(corner / np.where(size > 0, size, 1.0)[:, None])
    angle = np.zeros(len(i))
    for k in range(4):
        dots = np.einsum("ia,ia->i", unit[k], unit[(k + 1) % 4])
        angle += np.arcsin(np.clip(dots, -1.0, 1.0))
    sign = np.sign(np.einsum("ia,ia->i", cross(d - c, b - a), c - a))
    return float(np.sum(np.abs(angle) * sign) / (2.0 * np.pi))
