"""Shapes that ribbons start from, and where they are put."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from casashell.ribbon.bands import uncrossed
from casashell.ribbon.chain import reconstruct
from casashell.ribbon.ribbon import MOST_BENT, Ribbon, RibbonState
from casashell.typing import ArrayLike, FloatArray


def wound(ribbon: Ribbon, radius: float, slope: float = 0.0) -> RibbonState:
    """The strip on a cylinder of ``radius`` [m], its rulings at ``slope`` (cotangent): a helix.

    With slope 0 an arc.  Rulings turn from the end, which is straight, as fast as they may.  A
    negative radius winds to the other side.  Raises ValueError for a radius too small for segments.
    """
    if not (np.isfinite(radius) and radius != 0.0 and np.isfinite(slope)):
        raise ValueError("radius must be a number other than 0, and slope a finite one")
    slopes = uncrossed(ribbon, np.full(ribbon.segments - 1, slope, dtype=np.float64))
    angles = ribbon.segment / (radius * np.sqrt(1.0 + slopes**2))
    if np.abs(angles).max() > MOST_BENT:
        raise ValueError(
            f"radius {radius:g} is too small for segments of {ribbon.segment:g} m: take more "
            "segments or a larger radius"
        )
    return RibbonState(slopes, angles)


def waved(ribbon: Ribbon, angle: float, waves: float, slope: float = 0.0) -> RibbonState:
    """Slightly uneven: bending angles ``angle`` [rad] times a sine, rulings at ``slope`` times another."""
    phase = 2.0 * np.pi * waves * np.arange(1, ribbon.segments) / ribbon.segments
    return RibbonState(uncrossed(ribbon, slope * np.sin(0.7 * phase + 1.0)), angle * np.sin(phase))


def frame_of(along: ArrayLike, across: ArrayLike) -> FloatArray:
    """(3,3) axes of the first quad in columns, ``across`` made perpendicular to ``along``.

    Raises ValueError for directions that are zero or parallel.
    """
    first, second = (np.array(v, dtype=np.float64) for v in (along, across))
    length = float(np.linalg.norm(first))
    if not (np.isfinite(length) and length > 0.0):
        raise ValueError("along has no direction")
    first = first / length
    side = second - (second @ first) * first
    width = float(np.linalg.norm(side))
    if not width > 1e-6 * float(np.linalg.norm(second)):
        raise ValueError("across must be a direction, and not that of along")
    side = side / width
    return np.column_stack([first, side, np.cross(first, side)])


def placed(
    ribbon: Ribbon,
    state: RibbonState,
    frame: FloatArray,
    *,
    origin: ArrayLike | None = None,
    centre: ArrayLike | None = None,
) -> RibbonState:
    """The same shape with ``frame`` as its first quad, its centreline beginning in ``origin`` [m].

    Or with ``centre`` as the mean of its centreline instead.
    """
    turned = replace(state, frame=frame, origin=np.zeros(3))
    if centre is not None:
        shape = reconstruct(ribbon, turned)
        points = shape.middle[:-1] if ribbon.closed else shape.middle
        return replace(turned, origin=np.asarray(centre, dtype=np.float64) - points.mean(axis=0))
    return replace(
        turned, origin=np.zeros(3) if origin is None else np.asarray(origin, dtype=float)
    )
