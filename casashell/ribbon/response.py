"""What a collision does to velocities: impacts without rebound that never add kinetic energy.

The response to collisions moves vertices by u in a step h.  Were u / h all velocity, a push out of a
near miss would be a kick, and a strip that is pressed through itself would gain speed at every step.
So only a part of it counts,

    v = v* + share u / h,    share = clip(-<v*, u / h> / |u / h|^2, 0, 1)

in the mass norm of all ribbons together, v* the velocities before the response: the share after which
kinetic energy is least.  It is 1 for an impact that just stops, the perfectly inelastic one.  The same
share for all ribbons keeps their momentum where u keeps it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from casashell.ribbon.chain import BOTTOM, TOP, reconstruct
from casashell.ribbon.physics import RibbonPhysics
from casashell.ribbon.resample import abscissae
from casashell.ribbon.ribbon import Ribbon
from casashell.ribbon.step import Past, Proposed, Rule, Task, after, consistent, lumped, rims
from casashell.ribbon.terms import Terms
from casashell.typing import FloatArray


def kinetic_energy(ribbon: Ribbon, physics: RibbonPhysics, rule: Rule, past: Past) -> float:
    """[J] of the motion from ``past.former`` to ``past.points``."""
    table = reconstruct(ribbon, past.state).table.copy()
    table[BOTTOM::4], table[TOP::4] = past.points
    if rule.mass == "lumped":
        motion = lumped(ribbon, physics, past.lapse, past.former.mean(axis=0))
    else:
        former = rims(ribbon, past.former_slopes, past.former, physics, rule.interpolant)
        motion = consistent(ribbon, physics, past.lapse, former, former)
    return Terms(ribbon.segments + 1, (motion,)).energy(table)


def responded(
    tasks: Sequence[Task],
    free: Sequence[Proposed],
    ends: Sequence[Proposed],
    points: Sequence[FloatArray],
    physics: RibbonPhysics,
    rule: Rule,
) -> tuple[Past, ...]:
    """What the next step starts from, with vertices (2,N+1,3) [m] after collision response.

    free  ends of the step without contacts, on rulings of their own
    """
    made = tuple(after(task, end, x) for task, end, x in zip(tasks, ends, points))
    moved = [
        x - _free_points(task.ribbon, one, end, physics, rule)
        for task, one, end, x in zip(tasks, free, ends, points)
    ]
    if not any(u.any() for u in moved):
        return made
    share = _share(tasks, moved, made, physics, rule)
    if share == 1.0:
        return made
    return tuple(
        past if not u.any() else _slowed(task, past, (1.0 - share) * u, physics, rule)
        for task, past, u in zip(tasks, made, moved)
    )


def _free_points(
    ribbon: Ribbon, free: Proposed, end: Proposed, physics: RibbonPhysics, rule: Rule
) -> FloatArray:
    """(2,N+1,3) [m] where the step without contacts has the vertices of ``end``."""
    if free is end:
        return end.points
    there = rims(ribbon, free.state.all_slopes, free.points, physics, rule.interpolant)
    return there.at(abscissae(ribbon.length, ribbon.width, end.state.all_slopes))


def _share(
    tasks: Sequence[Task],
    moved: Sequence[FloatArray],
    made: Sequence[Past],
    physics: RibbonPhysics,
    rule: Rule,
) -> float:
    """The part of ``moved`` (2,N+1,3) [m] that becomes velocity, 0 .. 1."""
    product = square = 0.0
    for task, u, past in zip(tasks, moved, made):
        if not u.any():
            continue
        before, own = replace(past, points=past.points - u), _moving(past, past.points - u)
        energies = [
            kinetic_energy(task.ribbon, physics, rule, each) for each in (past, before, own)
        ]
        square += 2.0 * energies[2]
        product += energies[0] - energies[1] - energies[2]
    return 1.0 if square == 0.0 else float(np.clip(-product / square, 0.0, 1.0))


def _moving(past: Past, former: FloatArray) -> Past:
    """``past`` with ``former`` (2,N+1,3) on its own rulings."""
    return replace(past, former=former, former_slopes=past.state.all_slopes)


def _slowed(task: Task, past: Past, less: FloatArray, physics: RibbonPhysics, rule: Rule) -> Past:
    """``past`` with ``less`` (2,N+1,3) [m] taken from the way of its last step."""
    way = task.h * past.velocities(task.ribbon, physics, rule.interpolant) - less
    return _moving(past, past.points - way)


__all__ = ["kinetic_energy", "responded"]
