"""Algorithm 1 of Ly 2018: contacts fixed, then contact forces, under a pull that is let go.

Step one finds the natural shape whose drape, contacts held, comes nearest to the target.  Step two
changes it so that the contact forces lie in their friction cones.  Both see the energy with a pull
lambda/2 |x - x_t|^2 towards the target (Eq. 24), which is lowered until it is gone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from casashell.inverse.cone_residual import ConeResidual
from casashell.inverse.forces import rigid_obstruction
from casashell.inverse.load_path import Report
from casashell.inverse.outcome import Outcome, judged, starting_outcome
from casashell.inverse.piece import Piece
from casashell.inverse.pulled import Pulled
from casashell.inverse.step_one import PAPER as PAPER_LIMITS
from casashell.inverse.step_one import Limits, StepOne, StepOneMethod
from casashell.inverse.step_two import Method as StepTwoMethod
from casashell.inverse.step_two import step_two
from casashell.result import Step
from casashell.typing import FloatArray


@dataclass(frozen=True)
class Continuation:
    """How the pull is let go.

    first, last  lambda of the first pass, and the one below which it becomes zero; N/m, or f0 / h if
                 ``relative``
    factor       lambda of a pass over that of the pass before
    rounds       passes without pull at the most
    limits       stopping rules of step one;  step1  its method, see `StepOne`
    skip         go straight to no pull once a drape meets the target, whose forces then owe nothing to
                 the pull; and leave out a last step two that has nothing to do
    floors       least normal forces / f0 that step two asks of every contact, tried in turn by "ipopt"
    restart      put the natural contacts back to the target before every step one (Eq. 28), rather
                 than leave them where step two has moved them
    """

    first: float = 1e3
    last: float = 1.0
    factor: float = 0.1
    rounds: int = 4
    relative: bool = True
    limits: Limits = field(default_factory=Limits)
    step1: StepOneMethod = "newton"
    skip: bool = True
    floors: tuple[float, ...] = (1e-2, 0.0)
    restart: bool = False

    def pulls(self, piece: Piece) -> Iterator[float]:
        """The values of lambda [N/m], ending with zero ``rounds`` times."""
        unit = piece.f0 / piece.h if self.relative else 1.0
        pull = self.first
        while pull > self.last:
            yield pull * unit
            pull *= self.factor
        yield from [0.0] * self.rounds


#: Ly 2018, Sec. 7.1: lambda from 1000, halved, zero below 0.1; one pass without pull.
PAPER = Continuation(1e3, 0.1, 0.5, 1, False, PAPER_LIMITS, "auto", False, (0.0,), True)
PRESETS = {"scaled": Continuation(), "paper": PAPER}


class TwoStepSolver:
    """Runs Algorithm 1 on one piece.

    step2         "ipopt": the cone-constrained program;  "bfgs": descent on G_K
    continuation  schedule of the pull
    """

    def __init__(
        self,
        piece: Piece,
        report: Report,
        *,
        step2: StepTwoMethod = "ipopt",
        continuation: Continuation | None = None,
    ) -> None:
        self.piece = piece
        self.report = report
        self.step2 = step2
        self.continuation = continuation or Continuation()
        self.best = starting_outcome(piece)
        self.notes: list[str] = []
        self.iterations = 0
        self.step_one = StepOne(
            Pulled(piece, 0.0),
            piece.held,
            method=self.continuation.step1,
            limits=self.continuation.limits,
            report=report,
        )
        self.arrived = False

    @property
    def factorizations(self) -> int:
        """Factorisations of all drapes so far; Ipopt's own are not counted."""
        return self.step_one.draper.factorizations

    def salvage(self) -> Outcome:
        """The best outcome so far."""
        return self.best

    def run(self) -> Outcome:
        """Alternate the two steps while the pull is let go; the outcome is also in ``best``."""
        piece = self.piece
        if len(piece.held) == 0 and piece.loads.any():
            self.notes.append("nothing holds this part: no pins, no contacts")
            self.best = replace(self.best, obstruction=rigid_obstruction(piece))
            return self.best
        rest, pose = piece.target, piece.target
        for pull in self.continuation.pulls(piece):
            if pull > 0.0 and self.arrived and self.continuation.skip:
                continue
            rest, pose = self._first_step(rest, pose, pull)
            if pull == 0.0 and self.continuation.skip and self._accept(rest, pose, None):
                break  # the margin of mu' absorbs what the last drape moved
            rest, forces = self._second_step(rest, pose, pull)
            if pull == 0.0 and self._accept(rest, pose, forces):
                break
        return self.best

    def _first_step(
        self, rest: FloatArray, pose: FloatArray, pull: float
    ) -> tuple[FloatArray, FloatArray]:
        """Natural shape and its drape, with contacts and pins held (Eq. 20)."""
        self.step_one.draper.pulled = Pulled(self.piece, pull)
        if self.continuation.restart:
            rest = rest.copy()
            rest[self.piece.held] = self.piece.target[self.piece.held]
        shape = self.step_one.solve(rest, pose)
        self.iterations += shape.iterations
        self.arrived = shape.reason == "target"
        return (shape.rest, shape.draped.pose) if shape.draped.good else (rest, pose)

    def _second_step(
        self, rest: FloatArray, pose: FloatArray, pull: float
    ) -> tuple[FloatArray, FloatArray]:
        """Natural shape whose contact forces at ``pose`` lie in the cones (Eq. 34)."""
        if len(self.piece.contacts.vertices) == 0:
            return rest, np.zeros((0, 3))
        floors = self.continuation.floors if self.step2 == "ipopt" else (0.0,)
        for floor in floors:
            found = step_two(
                self.piece,
                pose,
                rest,
                pull,
                method=self.step2,
                floor=floor,
                elastic=floor == floors[-1],
                report=self.report,
            )
            self.iterations += found.iterations
            if found.converged:
                break
        self.report(
            Step("step two", 1.0, found.iterations, found.residual, 0.0, f"pull {pull:g} N/m")
        )
        return found.rest, found.contact_forces

    def _accept(self, rest: FloatArray, pose: FloatArray, forces: FloatArray | None) -> bool:
        """Judge a pass without pull; True when it is a stable equilibrium with strict cones.

        forces  of the contacts (C,3) [N]; None for those the shape needs
        """
        if forces is None:
            felt = self.piece.assembly.gradient(pose, rest)
            forces = ConeResidual(self.piece).contact_forces(felt)
        outcome = judged(self.piece, rest, forces, "two-step", pose=pose)
        if outcome.good or outcome.rank > self.best.rank or self.best.rung == "start":
            self.best = outcome
        return outcome.good
