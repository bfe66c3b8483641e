"""Steps of ribbons that are pressed against something, with their contacts as conditions.

The paper moves vertices out of impacts after the step, away from where strips are developable.  A strip
that is pressed against itself is then led back through itself by the next step, which takes
that way for motion: energy from nowhere.  So where the response moves a vertex by more than the
thickness in two steps running, the step is made again with the contacts found as inequalities, and the
response is left with what they miss.  An impact that is over after one step is left to the response.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from casashell.ribbon.contact import StripCollisions
from casashell.ribbon.impacts import Rows
from casashell.ribbon.step import Proposed, Task
from casashell.typing import BoolArray, FloatArray

#: Times a step is made again with the contacts found so far.  More of them find more contacts, at the
#: price of a step each; the response sees to those, without a gain of energy in a strip twisted tight.
ROUNDS = 1

Advance = Callable[[Sequence[Task]], list[Proposed]]
Sound = Callable[[int, Proposed], bool]


def with_contacts(
    collide: StripCollisions,
    tasks: Sequence[Task],
    free: Sequence[Proposed],
    advance: Advance,
    sound: Sound,
) -> tuple[list[Proposed], list[FloatArray], list[BoolArray]]:
    """Ends of steps, their vertices (2,N+1,3) [m] without interpenetration, and which were pushed.

    advance  makes steps;  sound tells whether the end of a ribbon's step counts
    A ribbon whose step fails with its contacts keeps the one without.
    """
    before = [task.past.points for task in tasks]
    ends = list(free)
    points, found = collide.respond(before, [end.points for end in ends])
    pushed = _pushed(collide, ends, points)
    rows = Rows.joined([])
    for _ in range(ROUNDS):
        stuck = [
            task.past.pushed is not None and bool((task.past.pushed & late).any())
            for task, late in zip(tasks, _pushed(collide, ends, points))
        ]
        rows = Rows.joined([rows, found.contacts])
        touches = collide.touches(rows)
        again = [k for k, t in enumerate(touches) if t is not None and stuck[k]]
        made = advance([replace(tasks[k], touch=touches[k], near=ends[k].state) for k in again])
        kept = {k: end for k, end in zip(again, made) if sound(k, end)}
        if not kept:
            break
        ends = [kept.get(k, end) for k, end in enumerate(ends)]
        points, found = collide.respond(before, [end.points for end in ends])
    return ends, points, pushed


def _pushed(
    collide: StripCollisions, ends: Sequence[Proposed], points: Sequence[FloatArray]
) -> list[BoolArray]:
    """(2,N+1) vertices of each ribbon that were moved by more than its thickness."""
    thickness = collide.collider.bodies.thickness
    return [
        np.asarray(np.linalg.norm(x - end.points, axis=2) > size)
        for end, x, size in zip(ends, points, thickness)
    ]
