"""What a solver found for one piece, and what every solver of a piece offers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from casashell.contact.cone import margin, project
from casashell.contact.cone import split as split_force
from casashell.inverse.piece import Piece
from casashell.inverse.stability import NEUTRAL, lowest_modes
from casashell.typing import BoolArray, FloatArray

#: Residual / f0 of an equilibrium, a little inside what a certificate asks for.
BALANCED = 5e-7
#: Cone violation / f0 that is rounding: the margin of a frictionless contact is zero at best.
ROUNDING_OF_CONES = 1e-12


@dataclass(frozen=True)
class Outcome:
    """Natural shape and contact forces of a piece, with the solver's own view of them.

    rest, pose       (n,3) m, relative to the origin of the piece
    contact_forces   (C,3) N, on the shell
    load             share of the load reached, 1 for an equilibrium
    residual         what Newton left of its equations, / f0
    missing          largest force on a vertex that nothing holds, / f0
    cone_margin      least of mu f_N - |f_T| and f_N over the contacts, / f0
    eigenvalue       lowest eigenvalue of the free Hessian as the solver sees it, times h / f0
    rung             which forces: a rung of the ladder, or "start" before any
    obstruction      rigid motion that proves infeasibility, or None
    """

    rest: FloatArray
    pose: FloatArray
    contact_forces: FloatArray
    load: float
    residual: float
    missing: float
    cone_margin: float
    eigenvalue: float
    rung: str
    obstruction: FloatArray | None = None

    @property
    def balanced(self) -> bool:
        """Full load carried, to rounding, by contacts and pins alone."""
        return self.load == 1.0 and max(self.residual, self.missing) <= BALANCED

    @property
    def good(self) -> bool:
        """A stable equilibrium with every contact force strictly inside its cone."""
        return (
            self.balanced and self.cone_margin >= -ROUNDING_OF_CONES and self.eigenvalue > NEUTRAL
        )

    @property
    def rank(self) -> tuple[bool, float, float, float]:
        """Order of preference among outcomes that are not good."""
        balanced = self.balanced
        return balanced, self.load, min(self.cone_margin, 0.0), min(self.eigenvalue, 0.0)


def starting_outcome(piece: Piece) -> Outcome:
    """The target itself, which is what is known before any work."""
    nothing = np.zeros((len(piece.contacts.vertices), 3))
    bad = (0.0, np.inf, np.inf, -np.inf, -np.inf)
    return Outcome(piece.target, piece.target, nothing, *bad, "start")


def pushing(piece: Piece, contact_forces: FloatArray) -> BoolArray:
    """Contacts (C,) that push hard enough to hold their vertex."""
    normal, _ = split_force(contact_forces, piece.contacts.normals)
    return np.asarray(normal > 1e-6 * piece.f0)


def judged(
    piece: Piece,
    rest: FloatArray,
    contact_forces: FloatArray,
    rung: str,
    *,
    pose: FloatArray | None = None,
    load: float = 1.0,
    residual: float = 0.0,
) -> Outcome:
    """What a natural shape is worth with the contact forces meant for it.

    contact_forces  (C,3) N at full load; what dE/dx differs from ``load`` times them is added to the
                    contacts of its vertex
    """
    contacts, at = piece.contacts, piece.contacts.vertices
    x = piece.target if pose is None else pose
    total = piece.assembly.gradient(x, rest, load)
    held = np.zeros(len(x), dtype=bool)
    held[piece.held] = True
    missing = float(np.abs(total[~held]).max(initial=0.0)) / piece.f0
    share = np.bincount(at, minlength=len(x))[at] if len(at) else np.ones(0)
    beyond = total - load * piece.spread(contact_forces)
    felt = _snapped(load * contact_forces + beyond[at] / share[:, None], piece)
    inside = np.inf
    if len(at):
        normal, _ = split_force(felt, contacts.normals)
        slack = margin(felt, contacts.normals, contacts.friction)
        inside = min(float(slack.min()), float(normal.min()))
    outcome = Outcome(
        rest=rest,
        pose=x,
        contact_forces=felt,
        load=load,
        residual=residual,
        missing=missing,
        cone_margin=inside / piece.f0,
        eigenvalue=-np.inf,
        rung=rung,
    )
    if outcome.balanced:
        values, _ = lowest_modes(piece, rest, pushing(piece, felt), 1, x)
        outcome = replace(outcome, eigenvalue=float(values[0]) * piece.h / piece.f0)
    return outcome


def _snapped(forces: FloatArray, piece: Piece) -> FloatArray:
    """Forces outside their cone by rounding alone put onto it: without friction that is all of them."""
    contacts = piece.contacts
    onto = project(forces, contacts.normals, contacts.friction)
    near = np.linalg.norm(onto - forces, axis=1) <= 1e-8 * piece.f0
    return np.where(near[:, None], onto, forces)


class PieceSolver(Protocol):
    """A method of inversion, applied to one piece."""

    notes: list[str]
    best: Outcome

    @property
    def iterations(self) -> int:
        """Iterations so far."""

    @property
    def factorizations(self) -> int:
        """Factorisations so far."""

    def run(self) -> Outcome:
        """Solve; the outcome is also in ``best``, which is kept up to date for an interrupt."""

    def salvage(self) -> Outcome:
        """The best outcome when the run was interrupted."""
