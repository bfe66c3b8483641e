"""Distance of a draped pose to the target and its gradient by the adjoint method (Ly 2018, Alg. 2).

With F = -dE/dx the draping function has DΦ = -H^-1 M, H = d2E/dx2 and M = d2E/dxdr on the free
degrees of freedom; so the gradient of J = |Φ(r) - x_t|^2 / 2 is -M^T p with H p = Φ(r) - x_t
(Eqs. 22 and 32).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casashell.inverse.drape import Draped, Draper
from casashell.typing import FloatArray


@dataclass(frozen=True)
class Adjoint:
    """J and its gradient at one natural shape.

    distance  J [m2]
    gradient  dJ/dr (n,3) [m]; zero at fixed vertices, whose natural position is fixed too
    state     p (n,3) [m2/N], the adjoint state
    mixed     entries of d2E/dxdr at the pose [N/m]
    """

    distance: float
    gradient: FloatArray
    state: FloatArray
    mixed: FloatArray


def distance(draper: Draper, pose: FloatArray) -> float:
    """J = |pose - x_t|^2 / 2 over the free vertices [m2]."""
    away = draper.system.restrict(pose - draper.pulled.piece.target)
    return 0.5 * float(away @ away)


def adjoint(draper: Draper, rest: FloatArray, draped: Draped) -> Adjoint:
    """J and dJ/dr at ``rest`` (n,3), by one solve with the factor that the drape has left.

    A factor of another pose is replaced by the right one first.  Raises ValueError for a pose that is
    no local minimum: there the draping function has no derivative.
    """
    if not draped.good or not draper.hold_factor(rest, draped.pose):
        raise ValueError("the pose is no local minimum; drape again before asking for a gradient")
    system, pulled = draper.system, draper.pulled
    away = system.restrict(draped.pose - pulled.piece.target)
    state = system.solve(away)
    _, mixed = pulled.mixed(draped.pose, rest)
    full = system.extend(state)
    slope = pulled.piece.assembly.pattern.matrix(mixed).T @ full.ravel()
    gradient = system.extend(-slope[system.dofs])
    return Adjoint(0.5 * float(away @ away), gradient, full, mixed)


def carried_along(
    draper: Draper, rest: FloatArray, draped: Draped, mixed: FloatArray, move: FloatArray
) -> FloatArray:
    """First-order change of the draped pose (n,3) when ``rest`` changes by ``move`` (n,3).

    Raises ValueError as `adjoint` does.
    """
    if not draped.good or not draper.hold_factor(rest, draped.pose):
        raise ValueError("the pose is no local minimum; drape again before asking for a change")
    force = draper.pulled.piece.assembly.pattern.matrix(mixed) @ np.ravel(move)
    return draper.system.extend(-draper.system.solve(force[draper.system.dofs]))
