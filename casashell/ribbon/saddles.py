"""Steps that ended on a saddle: symmetric states that exact Newton steps never leave.

A flat strip that is twisted at its end feels no force along its rulings, and none on its angles: the
gradient vanishes there while the energy falls along a slope and an angle together.  Ipopt ends
on such a point when it starts there.  Beside it, along the direction of most negative curvature, it
does not; which of the two sides is taken is fixed, so that runs repeat.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from casashell.ribbon.coordinates import Coordinates
from casashell.ribbon.potential import Potential
from casashell.ribbon.program import Outcome, Stop
from casashell.ribbon.stability import stability
from casashell.typing import FloatArray

#: Curvature over D W / l below which a step's end counts as a saddle, and how far beside it the search
#: goes on [rad, slope].
SADDLE, ASIDE = -1e-6, 0.02

Solve = Callable[[FloatArray], Outcome]


def left(potential: Potential, found: Outcome, solve: Solve) -> Outcome:
    """``found``, or what ``solve`` finds from beside it when it is a saddle and that is lower."""
    if found.stop is not Stop.CONVERGED or potential.touch is not None:
        return found
    if _convex(potential, found):
        return found
    space = potential.coordinates
    state = space.state(found.z)
    plain = Coordinates(space.ribbon, space.base, space.floating, increments=False)
    direct = potential.with_coordinates(plain)
    check = stability(direct, state, found.multipliers.equality)
    if check.free == 0 or check.lowest > SADDLE - check.neutral:
        return found
    away = check.direction
    away = away * np.sign(away[np.argmax(np.abs(away))]) / np.abs(away).max()
    z = plain.pack(state) + ASIDE * away
    beside = space.pack(plain.state(np.clip(z, plain.lower, plain.upper)))
    other = solve(np.clip(beside, space.lower, space.upper))
    lower = other.stop is Stop.CONVERGED and other.objective < found.objective
    inner, tries = found.inner + other.inner, found.evaluations + other.evaluations
    return replace(other, inner=inner, evaluations=tries) if lower else found


def _convex(potential: Potential, found: Outcome) -> bool:
    """Whether a factorisation shows at once that no direction is downhill."""
    hessian = potential.hessian(found.z, found.multipliers.equality)
    slopes = potential.equalities(found.z)[1]
    weight = np.abs(np.diag(hessian)).max() / max(np.square(slopes).sum(), 1e-300)
    try:
        np.linalg.cholesky(hessian + weight * slopes.T @ slopes)
    except np.linalg.LinAlgError:
        return False
    return True
