"""Inverse ribbon: natural angles and rulings that make a given developable pose an equilibrium.

As for shells (Ly 2018): the unknowns are the natural coordinates, the pose is given, and Newton's
method makes the forces vanish.  Mass and gravity do not depend on natural angles, and a natural angle
acts on its own crease alone, so the Newton matrix is diagonal and Sadowsky's energy needs one step.
The forces on the rulings must vanish too.  What angles cannot balance there, target rulings do, with
the smallest weight for which they do not cross and the pose is stable.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from scipy.linalg import null_space

from casashell.engine.threads import one_thread
from casashell.ribbon import forces
from casashell.ribbon.physics import RibbonPhysics
from casashell.ribbon.potential import Potential
from casashell.ribbon.ribbon import MOST_BENT, Ribbon, RibbonState
from casashell.ribbon.stability import Stability, stability
from casashell.ribbon.statics import Setting
from casashell.ribbon.terms import Term
from casashell.status import Status
from casashell.typing import FloatArray

#: Where the natural number stands among the parameters of the densities of `RibbonPhysics`.
_NATURAL_ANGLE, _NATURAL_SLOPE = 3, 1
#: Largest force over D W / l of an equilibrium, and Newton steps to get there.
TOLERANCE, STEPS = 1e-9, 30
#: Weights of the target rulings are tried in steps of this factor, so many times.
FACTOR, TRIES = 4.0, 16


@dataclass(frozen=True, eq=False)
class InverseRibbon:
    """The answer.

    ribbon     with natural angles, target rulings and their weight; as given unless solved
    residual   largest force at the pose over D W / l, measured anew on the finished ribbon
    stability  of the pose, second order
    """

    ribbon: Ribbon
    pose: RibbonState
    status: Status
    residual: float
    stability: Stability | None
    message: str

    @property
    def certified(self) -> bool:
        """The pose is a stable equilibrium of ``ribbon``."""
        return self.status.certified

    def require(self) -> InverseRibbon:
        """Itself, or RuntimeError that says why there is no answer."""
        if not self.certified:
            raise RuntimeError(f"{self.status.value}: {self.message}")
        return self


def natural_ribbon(
    ribbon: Ribbon, physics: RibbonPhysics, pose: RibbonState, setting: Setting | None = None
) -> InverseRibbon:
    """The ribbon like ``ribbon`` that rests in ``pose`` under ``setting``.

    Its natural angles are unknown, and its target rulings if needed; the weight of these is at least
    the regulariser of ``ribbon``.  Reactions of holds are chosen so that natural angles differ least
    from those of the pose.
    Raises ValueError for a pose that is none of the ribbon's, or that its holds do not allow.
    """
    pose.checked(ribbon)
    with one_thread():
        return _natural(ribbon, physics, pose, setting or Setting())


def _natural(
    ribbon: Ribbon, physics: RibbonPhysics, pose: RibbonState, setting: Setting
) -> InverseRibbon:
    # Natural as in the pose: only what has to be balanced is left.
    relaxed = replace(
        ribbon,
        rest_angles=pose.angles,
        target_rulings=pose.slopes,
        rest_start=pose.start_angle,
        rest_end=pose.end_angle,
    )
    potential = _direct(relaxed, physics, setting, pose)
    z = potential.coordinates.pack(pose)
    apart = float(np.abs(potential.equalities(z)[0]).max(initial=0.0))
    if apart > 1e-7:
        raise ValueError(f"the pose misses its holds by {apart:.1e} (lengths of the ribbon)")
    multipliers, missing = _reactions(potential, z)
    if missing > TOLERANCE:
        message = (
            "nothing holds the ribbon: its weight and loads are not in balance with any reaction"
        )
        return _refused(ribbon, pose, Status.INFEASIBLE, missing, message)
    force = _forces(potential, z, multipliers)
    table = potential.coordinates.strip(z).table
    wanted = -_part(potential, force, 1)
    bent = _balanced(forces.bending(relaxed, physics), table, (1, _NATURAL_ANGLE), wanted)
    if bent is None or np.abs(bent).max(initial=0.0) > MOST_BENT:
        message = "natural angles would fold the strip onto itself: stiffen it or make it lighter"
        return _refused(ribbon, pose, Status.TOO_SOFT, np.inf, message)
    angles = np.zeros(ribbon.segments + 1)
    angles[ribbon.bends] = bent
    curved = replace(
        relaxed, rest_angles=angles[1:-1], rest_start=float(angles[0]), rest_end=float(angles[-1])
    )
    return _with_rulings(ribbon, curved, physics, setting, pose, multipliers)


def _direct(
    ribbon: Ribbon, physics: RibbonPhysics, setting: Setting, pose: RibbonState
) -> Potential:
    return setting.potential(ribbon, physics, pose, increments=False, slopes=pose.all_slopes)


def _forces(potential: Potential, z: FloatArray, multipliers: FloatArray) -> FloatArray:
    """Gradient (n,) of the Lagrangian over D W / l."""
    return potential.objective(z)[1] + potential.equalities(z)[1].T @ multipliers


def _part(potential: Potential, force: FloatArray, which: int) -> FloatArray:
    """Forces on slopes (0) or angles (1) [J]."""
    space = potential.coordinates
    cuts = [space.creases, space.creases + len(space.bends)]
    return potential.unit * np.split(force, cuts)[which]


def _reactions(potential: Potential, z: FloatArray) -> tuple[FloatArray, float]:
    """Multipliers (m,) that balance the frame and leave least to the angles; what is unbalanced."""
    gradient, rows = potential.objective(z)[1], potential.equalities(z)[1]
    first = potential.coordinates.creases
    last = first + len(potential.coordinates.bends)
    if not len(rows):
        return np.empty(0), float(np.abs(gradient[last:]).max(initial=0.0))
    found: FloatArray = np.zeros(len(rows))
    free: FloatArray = np.eye(len(rows))
    if len(gradient) > last:
        found = np.asarray(-np.linalg.lstsq(rows[:, last:].T, gradient[last:])[0], np.float64)
        free = null_space(rows[:, last:].T, rcond=1e-10)
    left = gradient[first:last] + rows[:, first:last].T @ found
    found = found - free @ np.linalg.lstsq(rows[:, first:last].T @ free, left)[0]
    unbalanced = gradient[last:] + rows[:, last:].T @ found
    return found, float(np.abs(unbalanced).max(initial=0.0))


def _balanced(
    term: Term, table: FloatArray, place: tuple[int, int], wanted: FloatArray
) -> FloatArray | None:
    """Natural numbers (S,) for which each stencil pushes with ``wanted`` (S,); None: no such numbers.

    ``place`` is the coordinate of the stencil's own crease which it pushes (0 slope, 1 angle), and
    where the natural number stands among the parameters.  Newton's method, derivatives by CasADi.
    """
    entry, natural = place
    k, m, count = term.density.size2_in(0), term.density.numel_in(2), len(term.stencils)
    x, p = ca.SX.sym("x", 3, k), ca.SX.sym("p", m)
    push = ca.gradient(term.density(x, x, p), x)[entry, k // 2]
    slope = ca.jacobian(push, p)[natural]
    both = ca.Function("push", [x, p], [push, slope]).map(count)
    points = table[term.stencils].reshape(-1, 3).T
    params = term.at(table).copy()
    for _ in range(STEPS):
        found, steep = (np.array(part).ravel() for part in both(points, params.T))
        off = wanted - found
        if np.all(np.abs(off) <= 1e-12 * (np.abs(found) + np.abs(wanted))):
            return params[:, natural]
        if not np.all(np.isfinite(steep)) or np.any(steep == 0.0):
            return None
        params[:, natural] += off / steep
    return params[:, natural] if np.all(np.abs(off) <= 1e-9 * np.abs(wanted).max()) else None


def _with_rulings(
    given: Ribbon,
    curved: Ribbon,
    physics: RibbonPhysics,
    setting: Setting,
    pose: RibbonState,
    multipliers: FloatArray,
) -> InverseRibbon:
    """``curved`` with the target rulings that are needed: none, or with the least weight that serves."""
    potential = _direct(curved, physics, setting, pose)
    z = potential.coordinates.pack(pose)
    table = potential.coordinates.strip(z).table
    push = _part(potential, _forces(potential, z, multipliers), 0)
    plain = replace(curved, target_rulings=given.target_rulings)
    answer = _judged(plain, physics, setting, pose, multipliers)
    weight = max(given.regulariser, 1e-6)
    for _ in range(TRIES):
        if answer.certified:
            return answer
        term = forces.rulings(replace(curved, regulariser=weight), physics)
        slopes = _balanced(term, table, (0, _NATURAL_SLOPE), -push)
        if slopes is not None and _uncrossed(curved, slopes):
            held = replace(curved, regulariser=weight, target_rulings=slopes)
            answer = _judged(held, physics, setting, pose, multipliers)
        weight *= FACTOR
    return replace(answer, ribbon=given)


def _uncrossed(ribbon: Ribbon, slopes: FloatArray) -> bool:
    try:
        ribbon.require_rulings(slopes)
    except ValueError:
        return False
    return True


def _judged(
    ribbon: Ribbon,
    physics: RibbonPhysics,
    setting: Setting,
    pose: RibbonState,
    multipliers: FloatArray,
) -> InverseRibbon:
    """What the pose is for the finished ``ribbon``, with nothing of the search but the reactions."""
    potential = _direct(ribbon, physics, setting, pose)
    z = potential.coordinates.pack(pose)
    residual = float(np.abs(_forces(potential, z, multipliers)).max())
    curvature = stability(potential, pose, multipliers)
    if not np.isfinite(residual):
        status, message = Status.NONFINITE, "the forces at the pose are not finite"
    elif residual > TOLERANCE:
        status = Status.INFEASIBLE
        message = f"forces on the rulings stay at {residual:.1e} D W / l"
    elif not curvature.stable:
        status = Status.UNSTABLE
        message = f"in balance, but {curvature}: stiffen the ribbon, make it lighter, or hold it"
    else:
        status, message = Status.SOLVED, f"stable equilibrium: {curvature}"
    return InverseRibbon(ribbon, pose, status, residual, curvature, message)


def _refused(
    ribbon: Ribbon, pose: RibbonState, status: Status, residual: float, message: str
) -> InverseRibbon:
    return InverseRibbon(ribbon, pose, status, residual, None, message)
