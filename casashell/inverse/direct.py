"""Direct inversion of one piece: admissible contact forces, then Newton on the natural shape.

A ladder, cheapest first; the first rung whose answer is stable with strict cones wins:
  0. the natural shape and forces of an earlier answer, where one is given;
  1. projected bilateral reactions, at full load at once where rung 2 is cheap,
  2. forces of least strain energy (condensed to the contacts, or the full stress program),
  3. the same with stability cuts along the unstable directions found so far,
  4. projected reactions in small steps of the load, where rung 1 did not take them.
Masses move with the natural shape, so the forces of a rung are rebalanced once or twice.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from casashell.inverse.compliance import MOST_CONTACTS, least_energy_forces
from casashell.inverse.forces import (
    SHRINKS,
    Shrink,
    bilateral_reactions,
    project_reactions,
    rigid_obstruction,
)
from casashell.inverse.load_path import LoadPath, Report
from casashell.inverse.outcome import ROUNDING_OF_CONES, Outcome, judged, pushing, starting_outcome
from casashell.inverse.piece import Piece
from casashell.inverse.stability import lowest_modes
from casashell.inverse.stress import StressProgram
from casashell.inverse.warm_start import Guess
from casashell.result import Step
from casashell.typing import FloatArray

MASS_ROUNDS = 4
MAX_CUT_ROUNDS = 6
#: Vertices up to which the program on the contacts costs less than small steps of the load.
MOST_VERTICES = 3000
EARLIER = "earlier natural shape"

#: Contact forces (C,3) [N] that balance loads (n,3) [N]; None when there are none.
ForceChoice = Callable[[FloatArray], "FloatArray | None"]


@dataclass(frozen=True)
class _Rung:
    """A way to choose the contact forces; ``brief``: only the full load at once is tried."""

    name: str
    choose: ForceChoice
    brief: bool = False


class DirectSolver:
    """Runs the ladder on one piece and keeps the best outcome where an interrupt can find it."""

    def __init__(self, piece: Piece, report: Report, guess: Guess | None = None) -> None:
        self.piece = piece
        self.report = report
        self.guess = guess
        self.path = LoadPath(piece, report)
        self.best = starting_outcome(self.piece)
        self.last = self.best
        self.notes: list[str] = []

    @property
    def iterations(self) -> int:
        """Newton iterations so far."""
        return self.path.iterations

    @property
    def factorizations(self) -> int:
        """Factorisations of the bordered system so far."""
        return self.path.factorizations

    def run(self) -> Outcome:
        """Climb the ladder; the outcome is also in ``best`` after every rung."""
        if len(self.piece.held) == 0 and self.piece.loads.any():
            self.notes.append("nothing holds this part: no pins, no contacts")
            self.best = replace(self.best, obstruction=rigid_obstruction(self.piece))
            if self.best.obstruction is not None:
                return self.best
        needed = self.piece.loads.any() and len(self.path.dofs) > 0
        if self.guess is not None and needed and self._resume(self.guess):
            return self.best
        for rung in self._rungs():
            outcome = self._invert(rung)
            if outcome.good or outcome.rank > self.best.rank or self.best.rung == "start":
                self.best = outcome
            if outcome.good:
                return outcome
        if not self.best.balanced and len(self.piece.held):
            self.best = replace(self.best, obstruction=rigid_obstruction(self.piece))
        return self.best

    def _resume(self, guess: Guess) -> bool:
        """Begin with an earlier natural shape at full load; whether the answer is good."""
        outcome = self._near(guess)
        if outcome is None or not outcome.good:
            self.path.forget_analysis()
            self.notes.append("the earlier natural shape was no good start here: solved without it")
            return False
        self.best = outcome
        self.notes.append(
            "started from the earlier natural shape and forces: no load path, "
            f"{self.factorizations} factorisations"
        )
        return True

    def _near(self, guess: Guess) -> Outcome | None:
        """Outcome of Newton with the earlier forces, rebalanced as the masses move."""
        piece, path = self.piece, self.path
        rest = guess.scaled(piece)
        outcome: Outcome | None = None
        choose: ForceChoice | None = None
        for round_ in range(MASS_ROUNDS):
            loads = piece.assembly.nodal_loads(rest)
            if round_ == 0 and guess.comfortable(piece, SHRINKS[0]):
                found: FloatArray | None = guess.wanted  # multipliers see to what they miss
            else:
                choose = choose or self._nearest_to(guess.wanted, loads)
                found = choose(loads)
            if found is None:
                break
            point = path.resume(rest, piece.spread(found))
            if point is None:
                break
            rest = point.rest
            outcome = judged(piece, rest, found, EARLIER, residual=point.residual)
            self.last = outcome
            self.report(Step(EARLIER, 1.0, round_, point.residual, 0.0))
            if outcome.cone_margin >= -ROUNDING_OF_CONES:
                break
        return outcome

    def _nearest_to(self, wanted: FloatArray, loads: FloatArray) -> ForceChoice:
        """Projection of ``wanted`` as far inside the cones as balances ``loads``."""
        piece = self.piece
        if len(wanted) == 0:
            return lambda loads: wanted
        for shrink in SHRINKS:
            if project_reactions(piece, wanted, loads, shrink) is not None:
                break
        return lambda loads: project_reactions(piece, wanted, loads, shrink)

    def salvage(self) -> Outcome:
        """The best outcome so far; on a first path that was interrupted, its furthest point."""
        point = self.path.furthest
        if self.best.rung != "start" or point is None:
            return self.best
        return replace(self.best, rest=point.rest, load=point.load, residual=point.residual)

    def _rungs(self) -> Iterator[_Rung]:
        piece = self.piece
        if len(piece.contacts.vertices) == 0 or not piece.loads.any():
            nothing = np.zeros((len(piece.contacts.vertices), 3))
            yield _Rung("no contact forces", lambda loads: nothing)
            return
        wanted = bilateral_reactions(piece)
        tried = None
        for shrink in SHRINKS:
            tried = project_reactions(piece, wanted, piece.loads, shrink)
            if tried is not None:
                break
        if tried is None:
            return  # no rigid balance: no other program can find one either
        program = StressProgram(piece)
        cheap = program.complete and len(piece.contacts.vertices) <= MOST_CONTACTS
        brief = cheap and len(piece.target) <= MOST_VERTICES
        projected = _Rung(
            "projected reactions",
            lambda loads: project_reactions(piece, wanted, loads, shrink),
            brief,
        )
        yield projected
        stopped = self.last.load < 1.0
        if program.complete:
            yield from self._least_energy(program, shrink, cheap)
        else:
            self.notes.append("no stress program: not every energy has a strain measure")
        if brief and stopped:
            yield replace(projected, brief=False)

    def _least_energy(self, program: StressProgram, shrink: Shrink, cheap: bool) -> Iterator[_Rung]:
        """Forces of least strain energy, and again with more and more stability cuts."""
        piece = self.piece
        self.report(Step("stress program", 0.0, 0, np.nan, 0.0))
        cuts: list[FloatArray] = []
        delta = 0.0
        for round_ in range(MAX_CUT_ROUNDS):
            forces = least_energy_forces(piece, shrink) if cheap and not cuts else None
            if forces is None:
                stress = program.solve(shrink, cuts, delta)
                forces = None if stress is None else stress.contact_forces
            if forces is None:
                self.notes.append(
                    "the stress program has no solution"
                    + (" that is stable: the material is too soft" if cuts else "")
                )
                return
            name = "least energy" + (f" with {len(cuts)} stability cuts" if cuts else "")
            yield _Rung(name, _rebalanced(piece, forces, shrink))
            if not self.last.balanced:
                return  # too soft for least energy: cuts only ask for more
            cuts += self._cut_directions(round_)
            delta = 1e-3 * piece.f0 / piece.h
            self.report(Step("stability cut", 1.0, len(cuts), np.nan, 0.0))

    def _cut_directions(self, round_: int) -> list[FloatArray]:
        """Directions along which the last natural shape is not stable at the target."""
        piece = self.piece
        _, modes = lowest_modes(
            piece, self.last.rest, pushing(piece, self.last.contact_forces), 2 if round_ else 3
        )
        return [mode.reshape(-1, 3) for mode in modes.T]

    def _invert(self, rung: _Rung) -> Outcome:
        """Follow the load path with the forces of one rung, rebalanced as the masses move."""
        piece, name, choose = self.piece, rung.name, rung.choose
        loads, point = piece.loads, None
        outcome: Outcome | None = None
        for round_ in range(MASS_ROUNDS):
            forces = choose(loads)
            if forces is None:
                break
            point = self.path.follow(piece.spread(forces), point, brief=rung.brief)
            outcome = judged(
                piece, point.rest, forces, name, load=point.load, residual=point.residual
            )
            self.last = outcome
            self.report(Step(name, point.load, round_, point.residual, 0.0))
            if point.load < 1.0 or outcome.cone_margin >= -ROUNDING_OF_CONES:
                break
            loads = piece.assembly.nodal_loads(point.rest)
        return outcome if outcome is not None else starting_outcome(self.piece)


def _rebalanced(piece: Piece, forces: FloatArray, shrink: Shrink) -> ForceChoice:
    """Forces as they are for the loads of the target, nearest admissible ones for other loads."""

    def choose(loads: FloatArray) -> FloatArray | None:
        if loads is piece.loads:
            return forces
        return project_reactions(piece, forces, loads, shrink)

    return choose
