"""Equilibria of closed ribbons of any width and number of segments, by continuation."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from casashell.engine.threads import one_thread
from casashell.ribbon.loops import circle, moebius
from casashell.ribbon.physics import RibbonPhysics
from casashell.ribbon.ribbon import Ribbon, RibbonState, uncrossed
from casashell.ribbon.statics import Equilibrium, Method, Setting, equilibrium
from casashell.typing import FloatArray

#: A Moebius band is first closed with this length / width and with so many segments at most: in narrower
#: ones a coarse mesh has minima of its own, with uneven rulings, 16 % above the lowest.
NARROW, COARSE = 20.0, 30
#: Largest step of the half-width towards the widest band, as a part of the rest of the way.
WIDENED = 0.35


def closed(
    ribbon: Ribbon,
    physics: RibbonPhysics,
    setting: Setting | None = None,
    *,
    method: Method = "exact",
) -> Equilibrium:
    """The loop or the Moebius band with half a twist which ``ribbon`` is at rest.

    A Moebius band is closed narrow and coarse, then refined, then widened or narrowed.  Raises
    ValueError for an open ribbon.
    """
    if not ribbon.closed:
        raise ValueError(f"ends are {ribbon.ends!r}: only a loop or a Moebius band is closed")
    if ribbon.ends == "loop":
        return equilibrium(ribbon, physics, setting, start=circle(ribbon), method=method)
    width = ribbon.length / NARROW
    coarse = min(ribbon.segments, COARSE)
    narrow = replace(ribbon, width=width)
    first, _ = refined(narrow, RibbonState(*np.zeros((2, ribbon.segments - 1))), coarse)
    with one_thread():
        starts = moebius(first)
    bands = [equilibrium(first, physics, start=start) for start in starts]
    found = min(bands, key=lambda band: (not band.certified, band.energy))
    narrow, start = refined(first, found.state, ribbon.segments)
    widest = ribbon.length / math.sqrt(3.0)
    if width > ribbon.width:
        start = equilibrium(narrow, physics, start=start).state
    while width < ribbon.width:
        found = equilibrium(narrow, physics, start=start)
        width = min(ribbon.width, width + WIDENED * (widest - width))
        narrow = replace(narrow, width=width)
        start = RibbonState(uncrossed(narrow, found.state.slopes), found.state.angles)
    return equilibrium(ribbon, physics, setting, start=start, method=method)


def refined(ribbon: Ribbon, state: RibbonState, segments: int) -> tuple[Ribbon, RibbonState]:
    """The ribbon with another number of segments, and nearly the same shape: a start for a solve."""
    finer = replace(
        ribbon,
        segments=segments,
        rest_angles=_spread(np.asarray(ribbon.rest_angles), ribbon.segments, segments)
        * (ribbon.segments / segments),
        rest_start=ribbon.rest_start * ribbon.segments / segments,
        rest_end=ribbon.rest_end * ribbon.segments / segments,
        target_rulings=_spread(np.asarray(ribbon.target_rulings), ribbon.segments, segments),
    )
    return finer, RibbonState(
        uncrossed(finer, _spread(state.slopes, ribbon.segments, segments)),
        _spread(state.angles, ribbon.segments, segments) * (ribbon.segments / segments),
        state.frame,
        state.origin,
        state.start_angle * ribbon.segments / segments,
        state.end_angle * ribbon.segments / segments,
    )


def _spread(values: FloatArray, old: int, new: int) -> FloatArray:
    at = np.arange(1, new) / new
    return np.interp(at, np.arange(1, old) / old, values)


__all__ = ["closed", "refined", "uncrossed"]
