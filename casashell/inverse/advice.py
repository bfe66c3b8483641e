"""Status of a solve from its certificate, and one sentence on what it means and what to try."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from casashell.inverse.feasibility_proof import AREA_FACTOR
from casashell.inverse.forces import (
    SHRINKS,
    bilateral_reactions,
    is_obstruction,
    project_reactions,
)
from casashell.inverse.load_path import rounding_of
from casashell.inverse.outcome import Outcome
from casashell.inverse.piece import Piece
from casashell.inverse.stability import NEUTRAL
from casashell.problem import Problem
from casashell.result import Certificate
from casashell.status import Status
from casashell.typing import FloatArray

FREE_FORCE = 1e-6
NEARBY = 1e-3


def status_of(certificate: Certificate) -> Status:
    """Status that the certificate alone supports; ITERATION_LIMIT when it is not an equilibrium."""
    c = certificate
    numbers = (
        *(c.cone_margin, c.min_normal_force, c.target_distance),
        *(c.min_eigenvalue, c.min_eigenvalue_scaled),
    )
    if c.free_force is None or not np.isfinite(c.free_force):
        return Status.NONFINITE
    if any(number is not None and np.isnan(number) for number in numbers):
        return Status.NONFINITE
    if c.free_force > FREE_FORCE:
        return Status.ITERATION_LIMIT
    if min(c.cone_margin or 0.0, c.min_normal_force or 0.0) < 0.0:
        return Status.CONE_VIOLATED
    soft = c.min_eigenvalue_scaled is not None and c.min_eigenvalue_scaled <= NEUTRAL
    if soft or c.neutral_modes > 0:
        return Status.UNSTABLE
    if c.target_distance is None or c.target_distance > NEARBY:
        return Status.SOLVED_NEARBY
    return Status.SOLVED


def needed_friction(piece: Piece) -> float | None:
    """Smallest friction coefficient on all contacts at which the target's weight can be balanced.

    Contacts that have more keep it.  None when even a coefficient of 64 does not help.
    """
    wanted = bilateral_reactions(piece)

    def works(least: float) -> bool:
        rougher = replace(piece.contacts, friction=np.maximum(piece.contacts.friction, least))
        found = project_reactions(piece.touching(rougher), wanted, piece.loads, SHRINKS[-1])
        return found is not None

    low, high = 0.0, 0.02
    while not works(high):
        low, high = high, 2.0 * high
        if high > 64.0:
            return None
    while high - low > 0.01 * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if works(middle) else (middle, high)
    return high


def explain(status: Status, problem: Problem, piece: Piece | None, outcome: Outcome | None) -> str:
    """One sentence of advice; ``piece`` and ``outcome`` are those of the part that failed first."""
    if status is Status.SOLVED:
        return "The target is a stable frictional equilibrium of this natural shape."
    if status is Status.SOLVED_NEARBY:
        return "A stable frictional equilibrium was found, but its pose differs from the target."
    if status is Status.INTERRUPTED:
        return (
            "Stopped before the end: the natural shape is the best so far and not an equilibrium."
        )
    if status is Status.NONFINITE:
        return (
            "The computation met numbers that are not finite: look for extremely bad triangles "
            "(casashell check) and for material values of very different size."
        )
    if piece is None or outcome is None:
        return (
            "The solver found an equilibrium, but rounding keeps the certificate from confirming it: "
            "move the scene nearer to the origin, and look for bad or folded-over triangles "
            "(casashell check)."
        )
    where = _where(problem, piece)
    if outcome.rung in ("start", "nlp with slack"):
        return where + _unsupported(piece, outcome.obstruction)
    return where + (_drowned(status, piece, outcome) or _unfinished(status, piece, outcome))


def _drowned(status: Status, piece: Piece, outcome: Outcome) -> str | None:
    """Advice for a weight that rounding of the elastic forces hides; None when that is not it."""
    hidden = rounding_of(piece)
    if hidden <= 0.1 * FREE_FORCE or status is Status.INFEASIBLE or outcome.missing > hidden:
        return None
    if status in (Status.UNSTABLE, Status.CONE_VIOLATED) and hidden <= 1.0:
        return None
    return (
        f"The shell is so stiff for its weight that rounding alone makes forces of up to {hidden:.0e} "
        "of a nodal weight: lower stretch and bend, raise density, and look for bad triangles and "
        "wrong units (casashell check)."
    )


def _where(problem: Problem, piece: Piece) -> str:
    if len(piece.vertices) == len(problem.target.vertices):
        return ""
    return f"In the part with vertex {int(piece.vertices[0])} ({len(piece.vertices)} vertices): "


def _impossible(piece: Piece, motion: FloatArray) -> str:
    """What a motion that proves infeasibility rules out, and no more."""
    if is_obstruction(piece, motion):
        return "No natural shape, stiffness or density can hold this target"
    return (
        f"No natural shape with areas within a factor of {AREA_FACTOR:g} of the target's, can "
        "hold this target, whatever the stiffness"
    )


def _unsupported(piece: Piece, motion: FloatArray | None) -> str:
    if len(piece.held) == 0:
        return (
            "nothing holds this shell: no pinned vertex and no contact. Raise the contact tolerance, "
            "check unit and up axis, add an obstacle or pin vertices."
        )
    start = "No contact forces inside the friction cones balance the weight of this target"
    if motion is not None:
        start = _impossible(piece, motion)
    if len(piece.contacts.vertices) == 0:
        return (
            "No natural shape was found that the pins alone hold in this pose: raise bend and stretch, "
            "lower density or pin more vertices."
        )
    needed = needed_friction(piece)
    if needed is None:
        return (
            f"{start}: no friction is enough, because the contacts do not support the centre of "
            "mass. Raise the contact tolerance so that more vertices touch, or pin vertices."
        )
    least = float(piece.contacts.friction.min())
    return (
        f"{start}: it slides. It takes a friction of about {needed:.2g} "
        f"(now {least:.2g}), more contacts (tolerance) or pinned vertices."
    )


def _unfinished(status: Status, piece: Piece, outcome: Outcome) -> str:
    if status is Status.INFEASIBLE and outcome.obstruction is not None:
        return (
            f"{_impossible(piece, outcome.obstruction)}: it moves along what holds it, and the weight "
            "pushes that way: pin more vertices or let more vertices touch (tolerance)."
        )
    if status is Status.UNSTABLE:
        if abs(outcome.eigenvalue) <= NEUTRAL:
            return (
                "The equilibrium is neutral, not stable: the shell can move as a rigid body without "
                "resistance. Pin vertices or let more vertices touch (tolerance)."
            )
        return (
            "The equilibrium exists but is unstable: the material is too soft for this pose. Raise "
            "bend (first) and stretch, or lower density."
        )
    if status is Status.CONE_VIOLATED:
        return (
            "The equilibrium needs contact forces outside the friction cones: raise the friction, "
            "let more vertices touch (tolerance) or pin vertices."
        )
    if status is Status.TOO_SOFT and outcome.load == 0.0:
        return (
            "Not even a small part of the weight could be carried: without enough bending stiffness "
            "this target is a mechanism. Raise bend."
        )
    if status is Status.TOO_SOFT:
        return (
            f"Only {100.0 * outcome.load:.0f} % of the weight could be carried: the material is too "
            f"soft for this pose. About {1.0 / max(outcome.load, 1e-2):.1f} times the stretch and bend "
            "stiffness (or less density) should do; look at contacts with bad triangles if not."
        )
    if outcome.missing > FREE_FORCE:
        return (
            "The pins and contacts leave a rigid motion free that the weight pushes: pin more "
            "vertices or let more vertices touch (tolerance)."
        )
    return (
        "The solver stopped before an equilibrium: raise stretch and bend or lower density, and "
        "check the mesh for bad triangles (casashell check)."
    )
