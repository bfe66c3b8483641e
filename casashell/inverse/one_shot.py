"""Inversion in one nonlinear program: the natural shape nearest to the target that holds it."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from casashell.contact.cone import margin, split
from casashell.inverse.balance import (
    MAX_ITERATIONS,
    SLACK_WEIGHT,
    Balance,
    balance,
    unbalanced,
)
from casashell.inverse.balance_nlp import BalanceNlp
from casashell.inverse.forces import (
    SHRINKS,
    bilateral_reactions,
    project_reactions,
    rigid_obstruction,
)
from casashell.inverse.load_path import Report
from casashell.inverse.outcome import BALANCED, Outcome, starting_outcome
from casashell.inverse.piece import Piece
from casashell.inverse.pulled import Pulled
from casashell.inverse.stability import lowest_modes
from casashell.result import Step
from casashell.typing import FloatArray

#: Least normal force / f0 of a contact: asked for first, so that every contact holds its vertex.
FLOORS: Final = (1e-2, 0.0)


def one_shot(
    piece: Piece,
    *,
    floor: float = FLOORS[0],
    max_iterations: int = MAX_ITERATIONS,
    report: Report | None = None,
) -> Balance:
    """Natural shape of ``piece`` nearest to its target that balances it, with slack if there is none.

    floor  least normal force / f0 of a contact; zero is tried when it cannot be had
    Its stability is not part of the program: look at the lowest eigenvalue afterwards.
    """
    solver = NlpSolver(piece, report or _silent, floor=floor, max_iterations=max_iterations)
    return solver.solve()


class NlpSolver:
    """`one_shot` as a solver of a piece: keeps its outcome where an interrupt can find it.

    elastic  when there is no solution, find where balance lacks least; else one attempt, no slack
    seconds  of the processor that one attempt may take
    """

    def __init__(
        self,
        piece: Piece,
        report: Report,
        *,
        floor: float = FLOORS[0],
        elastic: bool = True,
        max_iterations: int = MAX_ITERATIONS,
        seconds: float = np.inf,
    ) -> None:
        self.piece, self.report = piece, report
        self.floor, self.elastic, self.max_iterations = floor, elastic, max_iterations
        self.seconds = seconds
        self.best = starting_outcome(piece)
        self.notes: list[str] = []
        self.iterations = 0
        self._latest: tuple[FloatArray, FloatArray] | None = None

    @property
    def factorizations(self) -> int:
        """Factorisations so far, at least: Ipopt makes one an iteration, more when it regularises."""
        return self.iterations

    def run(self) -> Outcome:
        """Solve; the outcome is also in ``best``."""
        piece = self.piece
        if len(piece.held) == 0 and piece.loads.any():
            self.notes.append("nothing holds this part: no pins, no contacts")
            obstruction = rigid_obstruction(piece)
            if obstruction is not None:
                self.best = replace(self.best, obstruction=obstruction)
                return self.best
        found = self.solve()
        self.best = self._outcome(found.rest, found.contact_forces, "nlp")
        if not found.converged:
            if not found.status.converged:
                self.notes.append(f"nonlinear program: {found.status}")
            if found.slack > 0.0:
                self.notes.append(
                    f"balance lacks up to {found.slack:.2g} of a nodal weight at a vertex: shape and "
                    "forces are those that come nearest"
                )
                self.best = replace(self.best, rung="nlp with slack")
            if len(piece.contacts):
                self.best = replace(self.best, obstruction=rigid_obstruction(piece))
        return self.best

    def salvage(self) -> Outcome:
        """The outcome, or that of the last iterate of a run that was interrupted."""
        if self._latest is None or self.best.rung != "start":
            return self.best
        return self._outcome(*self._latest, "nlp")

    def solve(self) -> Balance:
        """The program from the target, its contact forces from the rigid balance."""
        piece = self.piece
        forces = self._first_forces()
        program = self._program(self.floor)
        spent, seconds = 0, 0.0
        if forces is not None:
            lower = [f for f in FLOORS if f < self.floor] if self.elastic else []
            for floor in (self.floor, *lower):
                program = self._program(floor)
                found = self._run(program, forces, elastic=False)
                spent, seconds = spent + found.iterations, seconds + found.seconds
                if found.converged or len(piece.contacts) == 0:
                    break
            if found.converged or not self.elastic:
                return replace(found, iterations=spent, seconds=seconds)
        else:
            self.notes.append("no contact forces in the friction cones balance the weight")
            forces = piece.f0 * piece.contacts.normals
        found = self._run(program, forces, elastic=True)
        return replace(found, iterations=spent + found.iterations, seconds=seconds + found.seconds)

    def _program(self, floor: float) -> BalanceNlp:
        target = self.piece.target
        return BalanceNlp(Pulled(self.piece, 0.0), target, target, floor=floor)

    def _run(self, program: BalanceNlp, forces: FloatArray, *, elastic: bool) -> Balance:
        if elastic:
            program = program.softened(SLACK_WEIGHT)
        return balance(
            program,
            self.piece.target,
            forces,
            elastic=False,
            max_iterations=self.max_iterations,
            seconds=self.seconds,
            report=self._count,
            keep=self._keep,
        )

    def _first_forces(self) -> FloatArray | None:
        """Admissible forces that balance the target as a rigid body; None when there are none."""
        piece = self.piece
        if len(piece.contacts) == 0:
            return np.zeros((0, 3))
        wanted = bilateral_reactions(piece)
        for shrink in SHRINKS:
            forces = project_reactions(piece, wanted, piece.loads, shrink)
            if forces is not None:
                return forces
        return None

    def _count(self, step: Step) -> None:
        self.iterations += step.iteration > 0
        self.report(replace(step, iteration=self.iterations))

    def _keep(self, rest: FloatArray, forces: FloatArray) -> None:
        self._latest = rest, forces

    def _outcome(self, rest: FloatArray, forces: FloatArray, rung: str) -> Outcome:
        piece, contacts = self.piece, self.piece.contacts
        residual = unbalanced(self._program(0.0), rest, forces)
        inside, active = np.inf, np.zeros(0, dtype=bool)
        if len(contacts):
            normal, _ = split(forces, contacts.normals)
            room = margin(forces, contacts.normals, contacts.friction)
            inside, active = float(min(room.min(), normal.min())), normal > 1e-6 * piece.f0
        eigenvalue = -np.inf
        if residual <= BALANCED:  # what a balanced outcome needs
            values, _ = lowest_modes(piece, rest, active, 1)
            eigenvalue = float(values[0]) * piece.h / piece.f0
        return Outcome(
            rest=rest,
            pose=piece.target,
            contact_forces=forces,
            load=1.0,
            residual=residual,
            missing=residual,
            cone_margin=inside / piece.f0,
            eigenvalue=eigenvalue,
            rung=rung,
        )


def _silent(step: Step) -> None:
    """Report to nobody."""
