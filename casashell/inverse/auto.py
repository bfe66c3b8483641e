"""The cheapest method that works: a ladder that goes on only when a rung has not held the target.

1. Newton along the load path with projected reactions, then with the stress program and its cuts;
2. the nonlinear program at the target, from where the path ended;
3. Algorithm 1 of Ly 2018 with descent on G_K, which reaches shapes that the program does not;
4. a pose near the target, when the target itself cannot be held.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from casashell.inverse.direct import DirectSolver
from casashell.inverse.feasibility_proof import rigid_proof
from casashell.inverse.load_path import Report, rounding_of
from casashell.inverse.outcome import Outcome, PieceSolver
from casashell.inverse.piece import Piece
from casashell.inverse.warm_start import Guess
from casashell.result import Step

#: Vertices up to which the dearer rungs are tried: beyond, one takes minutes.
LARGEST: Final = 3000
#: Share of the load that the path has to carry for the program to have a chance.
NEAR_ENOUGH: Final = 0.3
#: Iterations of the program, and steps of the free pose.
NLP_ITERATIONS, POSE_STEPS = 75, 15
#: Processor seconds that each of the dearer rungs may take: other work on the machine changes nothing.
PATIENCE: Final = 15.0
#: Vertices up to which the two-step method gets less, in proportion: it ends late where it fails.
FULL_PATIENCE: Final = 100
#: Rounding of the elastic forces / f0 beyond which no method sees the weight.
HIDDEN: Final = 1e-2
#: Share of a rigid motion below which it is none.
FREE: Final = 1e-8
#: Distance / size up to which another pose is an answer to what was asked.
NEARBY: Final = 0.05


class _OutOfTime(Exception):
    """A rung has used up its seconds."""


class AutoSolver:
    """Climbs the ladder on one piece; ``method`` names the rung of the best outcome."""

    def __init__(self, piece: Piece, report: Report, guess: Guess | None = None) -> None:
        self.piece, self.report = piece, report
        self.direct = DirectSolver(piece, report, guess)
        self.solvers: list[PieceSolver] = [self.direct]
        self.best = self.direct.best
        self.method = "direct"
        self.notes: list[str] = []

    @property
    def iterations(self) -> int:
        """Of all rungs."""
        return sum(solver.iterations for solver in self.solvers)

    @property
    def factorizations(self) -> int:
        """Of all rungs."""
        return sum(solver.factorizations for solver in self.solvers)

    def salvage(self) -> Outcome:
        """The best outcome so far, also of a rung that was interrupted."""
        latest = self.solvers[-1].salvage()
        if len(self.solvers) == 1:
            return latest
        return latest if latest.good else self.best

    def run(self) -> Outcome:
        """Solve; the outcome is also in ``best``."""
        self.notes += _skipped(self.piece)
        self.best = self.direct.run()
        self.notes += self.direct.notes
        if not self.best.good and self._worth_more():
            for name, solver in self._dearer():
                self.solvers.append(solver)
                outcome = self._run(solver, name)
                away = self._away(outcome)
                if outcome.good and away > NEARBY:
                    self.notes.append(
                        f"the closest stable pose found is {away:.0%} of the size away from the target, "
                        "not an answer; --method free-pose gives it"
                    )
                    continue
                better = outcome.balanced and not self.best.balanced and away == 0.0
                if outcome.good or better:
                    self.best, self.method = outcome, name
                if outcome.good:
                    self.notes.append(f"direct did not hold the target, {name} found the answer")
                    self.notes += [note for note in solver.notes if note not in self.notes]
                    break
                self.notes.append(f"{name}: no stable equilibrium either")
        return self.best

    def _run(self, solver: PieceSolver, name: str) -> Outcome:
        """The rung's outcome, or what it had when its time was up."""
        try:
            return solver.run()
        except _OutOfTime:
            self.notes.append(f"{name} was stopped: it took too long")
            return solver.salvage()

    def _watched(self) -> Report:
        """The report, which ends a rung that takes too long."""
        share = min(1.0, len(self.piece.target) / FULL_PATIENCE)
        deadline = time.process_time() + share * PATIENCE

        def report(step: Step) -> None:
            self.report(step)
            if time.process_time() > deadline:
                raise _OutOfTime

        return report

    def _worth_more(self) -> bool:
        piece = self.piece
        if self.best.obstruction is not None or len(piece.held) == 0:
            return False
        proof = rigid_proof(piece)
        if proof is not None:
            self.best = replace(self.best, obstruction=proof.motion)
            if np.isfinite(proof.area_factor):
                self.notes.append(
                    "proved for natural shapes with areas up to "
                    f"{proof.area_factor:g} times larger or smaller than the target's"
                )
            return False
        if rounding_of(piece) > HIDDEN:
            return False  # the elastic forces round to more than the weight, whatever the method
        if _turns_freely(piece):
            self.notes.append("turns freely about what holds it, in any natural shape")
            return False
        if len(piece.target) > LARGEST:
            self.notes.append(
                f"more than {LARGEST} vertices: the dearer methods nlp, two-step and free-pose "
                "were not tried"
            )
            return False
        return True

    def _away(self, outcome: Outcome) -> float:
        """Largest component of pose - target over the size of the target."""
        target = self.piece.target
        size = float(np.linalg.norm(np.ptp(target, axis=0)))
        return float(np.abs(outcome.pose - target).max()) / (size or 1.0)

    def _dearer(self) -> Iterator[tuple[str, PieceSolver]]:
        """The other rungs, each made when the one before has failed."""
        from casashell.inverse.free_pose import FreePoseSolver
        from casashell.inverse.one_shot import NlpSolver
        from casashell.inverse.two_step import TwoStepSolver

        if self.best.load >= NEAR_ENOUGH:
            yield (
                "nlp",
                NlpSolver(
                    self.piece,
                    self.report,
                    max_iterations=NLP_ITERATIONS,
                    seconds=PATIENCE,
                    elastic=False,
                ),
            )
        yield "two-step", TwoStepSolver(self.piece, self._watched(), step2="bfgs")
        yield (
            "free-pose",
            FreePoseSolver(
                self.piece, self.report, after=self.direct, max_steps=POSE_STEPS, seconds=PATIENCE
            ),
        )


def _turns_freely(piece: Piece) -> bool:
    """Whether a rigid motion leaves what is held in place and no load does work along it.

    A turn about a vertical axis, say: neutral in every natural shape and pose with these contacts.
    """
    modes = piece.rigid_modes
    d = modes.shape[1]
    if d == 0:
        return False
    by_vertex = modes.reshape(len(piece.target), 3, d)
    loads = piece.loads / (float(np.abs(piece.loads).max(initial=0.0)) or 1.0)
    rows = np.concatenate(
        [by_vertex[piece.held].reshape(-1, d), np.einsum("ni,nid->nd", loads, by_vertex)]
    )
    size = np.linalg.svd(rows, compute_uv=False)
    return bool(len(size) < d or size[-1] <= FREE * float(np.linalg.norm(modes, axis=0).max()))


def _skipped(piece: Piece) -> list[str]:
    """What this piece does not need, in words."""
    notes = []
    contacts = piece.contacts
    internal = [term for term in piece.assembly.energies if not term.load]
    if not piece.loads.any():
        notes.append("no weight: the target is its own natural shape, nothing to solve")
    elif len(np.unique(piece.pinned)) == len(piece.target):
        notes.append("every vertex is pinned: nothing to solve")
    elif len(contacts) and (contacts.friction == 0.0).all():
        notes.append("no friction: one force a contact, no cones")
    if len(internal) == 1:
        notes.append(f"'{internal[0].name}' is the only elastic energy: the others are left out")
    return notes
