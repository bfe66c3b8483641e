"""The natural shape nearest to one that the user prefers, where there is freedom to choose.

Contact forces inside their cones can be chosen, and every choice has its natural shape (Ly 2018,
Sec. 9.3, whose answers stick to the target).  This finds the choice whose shape is nearest, in the mean
square, to a flat sheet, a pattern or an older version: the balance program with that as its reference.
What is not stable is given up in part: the reference moves back towards the shape found without it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from casashell.inverse.balance import balance
from casashell.inverse.balance_nlp import BalanceNlp
from casashell.inverse.cone_residual import ConeResidual
from casashell.inverse.load_path import Report
from casashell.inverse.outcome import Outcome, PieceSolver, judged
from casashell.inverse.piece import Piece
from casashell.inverse.pulled import Pulled
from casashell.inverse.step_two import first_forces
from casashell.mesh import aligned
from casashell.result import Step
from casashell.typing import FloatArray

#: How much of the way to the preferred shape the reference is put, one after the other.
SHARES: Final = (1.0, 0.5, 0.25, 0.125)
#: Least normal force / f0 of a contact.
FLOOR: Final = 1e-2
MAX_ITERATIONS: Final = 100


class PreferSolver:
    """Runs another solver, then moves its answer towards a preferred natural shape (n,3) [m]."""

    def __init__(
        self, piece: Piece, report: Report, first: PieceSolver, preferred: FloatArray
    ) -> None:
        if preferred.shape != piece.target.shape:
            raise ValueError(f"the preferred shape must have shape {piece.target.shape}")
        self.piece, self.report, self.first = piece, report, first
        self.preferred = preferred
        self.best = first.best
        self.notes: list[str] = []
        self._spent = 0

    @property
    def iterations(self) -> int:
        """Those of the first solver and of Ipopt."""
        return self.first.iterations + self._spent

    @property
    def factorizations(self) -> int:
        """Those of the first solver, and at least one an iteration of Ipopt."""
        return self.first.factorizations + self._spent

    def salvage(self) -> Outcome:
        """The best outcome so far."""
        return self.best if self.best.good else self.first.salvage()

    def run(self) -> Outcome:
        """Solve; the outcome is also in ``best``."""
        self.best = self.first.run()
        self.notes += self.first.notes
        piece = self.piece
        if not self.best.good:
            self.notes.append("preferred shape left out: the target is not held without it either")
        elif len(piece.contacts) == 0:
            self.notes.append(
                "preferred shape left out: without contacts there is nothing to choose"
            )
        else:
            self._approach()
        return self.best

    def _approach(self) -> None:
        piece, base = self.piece, self.best
        fixed = len(piece.pinned) > 0
        wanted = self.preferred if fixed else aligned(self.preferred, base.rest)
        before = _apart(base.rest, wanted, piece.h)
        for share in SHARES:
            reference = base.rest + share * (wanted - base.rest)
            reference[piece.pinned] = piece.target[piece.pinned]
            found = self._nearest(reference, base)
            if found is not None and found.good:
                self.best = replace(found, rung=f"{base.rung}, then nearest to the preferred shape")
                after = _apart(
                    found.rest, wanted if fixed else aligned(wanted, found.rest), piece.h
                )
                self.notes.append(
                    f"preferred shape: {before:.3g} edge lengths away without it, {after:.3g} with it"
                )
                return
            self.notes.append(
                f"{share:.0%} of the way to the preferred shape: "
                + ("not stable" if found is not None and found.balanced else "no balance")
            )

    def _nearest(self, reference: FloatArray, base: Outcome) -> Outcome | None:
        """Balanced shape nearest to ``reference`` (n,3), judged; None when there is none near by."""
        piece = self.piece
        program = BalanceNlp(Pulled(piece, 0.0), piece.target, reference, floor=FLOOR)
        felt = piece.assembly.gradient(piece.target, reference)
        there = first_forces(program, ConeResidual(piece), felt)
        for rest, forces in ((reference, there), (base.rest, base.contact_forces)):
            found = balance(
                program,
                rest,
                forces,
                elastic=False,
                max_iterations=MAX_ITERATIONS,
                report=self._count,
            )
            if found.converged:
                return judged(piece, found.rest, found.contact_forces, base.rung)
        return None

    def _count(self, step: Step) -> None:
        self._spent += step.iteration > 0
        self.report(replace(step, stage="prefer"))


def _apart(a: FloatArray, b: FloatArray, h: float) -> float:
    """Root mean square distance of two shapes in edge lengths."""
    return float(np.sqrt(((a - b) ** 2).sum(axis=1).mean())) / h
