"""The closest stable pose that can be held, when the target cannot.

Newton at the target first (`DirectSolver`).  Failing that, a drape with contacts held is stable
but its contact forces are not admissible; steps of `PoseProgram` bring them into the cones and
the pose towards the target.  After each step the natural shape is found again, exactly, by Newton at
the new pose with the new forces, so that every iterate is an equilibrium, and a Cholesky factor
says whether it is stable.  A step that fails either test is shortened.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from casashell.contact.cone import margin
from casashell.contact.cone import split as split_force
from casashell.inverse.direct import DirectSolver
from casashell.inverse.drape import Draper
from casashell.inverse.forces import rigid_obstruction
from casashell.inverse.free_pose_step import STEEP, PoseProgram, PoseStep
from casashell.inverse.load_path import TIGHT, LoadPath, Report
from casashell.inverse.outcome import Outcome, judged, starting_outcome
from casashell.inverse.piece import Piece
from casashell.inverse.pulled import Pulled
from casashell.result import Step
from casashell.typing import FloatArray

MAX_STEPS: Final = 60
#: Trials of one direction, each 0.3 times as long as the one before.
TRIALS: Final = 5
#: Lowest modes that a step has to keep stable once one was lost.
MODES: Final = 4
#: Least eigenvalue h / f0 of an iterate.
MARGIN: Final = 1e-5
#: |x - x_t|^2 / (2 h^2) a vertex below which no other drape is tried.
NEAR: Final = 0.05
#: Relative drop of the distance below which admissible poses are as close as they get.
SLOW: Final = 3e-2


@dataclass(frozen=True)
class _State:
    """An equilibrium: pose, natural shape (n,3) [m] and contact forces (C,3) [N]."""

    pose: FloatArray
    rest: FloatArray
    contact_forces: FloatArray
    away: float  # |x - x_t|^2 / (2 h^2)
    outside: float  # farthest of a contact force from its cone, / f0

    @property
    def merit(self) -> float:
        return self.away + STEEP * self.outside


class FreePoseSolver:
    """Runs the steps on one piece and keeps the best outcome where an interrupt can find it.

    after      a solver of the target that has run already; None runs one
    max_steps  steps from one drape
    seconds    of the processor after which no other step is begun
    """

    def __init__(
        self,
        piece: Piece,
        report: Report,
        *,
        after: DirectSolver | None = None,
        max_steps: int = MAX_STEPS,
        seconds: float = np.inf,
    ) -> None:
        self.piece, self.report = piece, report
        self._fresh = after is None
        self.direct = after or DirectSolver(piece, report)
        self.max_steps = max_steps
        self.seconds = seconds
        self._deadline = np.inf
        self.path = LoadPath(piece, lambda step: None)
        self.draper = Draper(Pulled(piece, 0.0), piece.held)
        self.program = PoseProgram(piece)
        self.best = starting_outcome(piece)
        self.notes: list[str] = []
        self.steps = 0
        self._unstable = False

    @property
    def iterations(self) -> int:
        """Newton iterations and steps so far."""
        before = self.direct.iterations if self._fresh else 0
        return before + self.path.iterations + self.steps

    @property
    def factorizations(self) -> int:
        """Factorisations of all parts so far, without those of the convex programs."""
        return (
            (self.direct.factorizations if self._fresh else 0)
            + self.path.factorizations
            + self.draper.factorizations
            + self.program.system.factorizations
        )

    def salvage(self) -> Outcome:
        """The best outcome so far."""
        return self.best if self.best.rung != "start" else self.direct.salvage()

    def run(self) -> Outcome:
        """The target itself, or the closest pose found; the outcome is also in ``best``."""
        if self._fresh:
            self.direct.run()
            self.notes += self.direct.notes
        self.best = self.direct.best
        if self.best.good or self.best.obstruction is not None or len(self.piece.held) == 0:
            return self.best
        if len(self.piece.contacts):
            obstruction = rigid_obstruction(self.piece)
            if obstruction is not None:
                self.best = replace(self.best, obstruction=obstruction)
                return self.best
        self._deadline = time.process_time() + self.seconds
        starts = self._draped()
        if not starts:
            self.notes.append("no shape at hand drapes to a stable pose with its contacts held")
        for state in starts:
            self._approach(state)
            if self.best.good and self._away(self.best.pose) < NEAR * len(self.piece.target):
                break
        if self.best.good:
            self.notes.append(
                f"the target itself could not be held: the pose is the closest found in {self.steps} steps"
            )
        return self.best

    def _draped(self) -> list[_State]:
        """Drapes, contacts held, of the shapes at hand: stable, forces as they come."""
        shapes = [self.piece.target]
        if not np.array_equal(self.best.rest, self.piece.target):
            shapes.append(self.best.rest)
        return [state for state in map(self._drape, shapes) if state is not None]

    def _drape(self, rest: FloatArray) -> _State | None:
        piece, at = self.piece, self.piece.contacts.vertices
        draped = self.draper.drape(rest, piece.target)
        if not draped.good:
            return None
        forces = piece.assembly.gradient(draped.pose, rest)[at]
        share = np.bincount(at, minlength=len(piece.target))[at] if len(at) else np.ones(0)
        return self._state(draped.pose, rest, forces / share[:, None])

    def _away(self, pose: FloatArray) -> float:
        """|x - x_t|^2 / (2 h^2)."""
        return 0.5 * float(((pose - self.piece.target) ** 2).sum()) / self.piece.h**2

    def _state(self, pose: FloatArray, rest: FloatArray, forces: FloatArray) -> _State:
        piece, contacts = self.piece, self.piece.contacts
        away = self._away(pose)
        outside = 0.0
        if len(contacts):
            normal, _ = split_force(forces, contacts.normals)
            room = margin(forces, contacts.normals, 0.975 * contacts.friction)
            outside = max(0.0, -float(min(room.min(), normal.min()))) / piece.f0
        return _State(pose, rest, forces, away, outside)

    def _approach(self, state: _State) -> None:
        """Steps until the pose is admissible and comes no closer."""
        kappa, share = 1e-2, 1.0
        self._unstable = False
        for _ in range(self.max_steps):
            if time.process_time() > self._deadline:
                self.notes.append(f"free pose stopped after {self.seconds:g} s")
                break
            modes = MODES if self._unstable else 0
            step = self.program.step(state.pose, state.rest, kappa, modes)
            self.steps += 1
            begin = min(1.0, share / 0.3)
            share, reached = (1.0, None) if step is None else self._search(state, step, begin)
            if reached is None:
                share, kappa = 1.0, max(30.0 * kappa, 1.0)
                if kappa > 1e6:
                    break
                continue
            slow = state.outside <= 1e-9 and reached.merit > (1.0 - SLOW) * state.merit
            state = reached
            kappa = kappa / 5.0 if share == 1.0 else kappa if share > 0.05 else 3.0 * kappa
            self._tell(state)
            if state.outside <= 1e-9:
                self._keep(state)
            if slow and kappa < 1.0:
                break
        self._keep(state)

    def _search(self, state: _State, step: PoseStep, share: float) -> tuple[float, _State | None]:
        """The first share of ``step`` that is a stable equilibrium of less merit."""
        for _ in range(TRIALS):
            reached = self._moved(state, step, share)
            if reached is not None and reached.merit < state.merit:
                return share, reached
            share *= 0.3
        return share, None

    def _moved(self, state: _State, step: PoseStep, share: float) -> _State | None:
        """Equilibrium after a share of a step: Newton on the natural shape; None unless stable."""
        piece, at = self.piece, self.piece.contacts.vertices
        pose = state.pose + share * step.pose
        forces = state.contact_forces + share * (step.contact_forces - state.contact_forces)
        self.path.piece = replace(piece, target=pose)
        nothing = np.zeros(self.path.border.shape[1])
        rest = state.rest + share * step.rest
        point = self.path.newton(rest, nothing, piece.spread(forces), 1.0, TIGHT)
        if point is None or point.residual > 1e-7:
            return None
        _, entries = piece.assembly.hessian(pose, point.rest)
        if not self.program.system.factor(entries, -MARGIN * piece.f0 / piece.h):
            self._unstable = True
            return None
        if len(at):  # what balance was short of goes to the contacts
            extra = (self.path.border @ point.correction).reshape(-1, 3)[at]
            forces = forces + extra / np.bincount(at, minlength=len(pose))[at][:, None]
        return self._state(pose, point.rest, forces)

    def _keep(self, state: _State) -> None:
        """Judge a state; the best of the good ones is the closest."""
        outcome = judged(self.piece, state.rest, state.contact_forces, "free pose", pose=state.pose)
        if outcome.good:
            better = not self.best.good or self._away(outcome.pose) < self._away(self.best.pose)
        else:
            better = not self.best.good and outcome.rank > self.best.rank
        if better:
            self.best = outcome

    def _tell(self, state: _State) -> None:
        away = float(np.abs(state.pose - self.piece.target).max()) / self.piece.h
        note = f"{away:.3g} edge lengths from the target"
        self.report(Step("free pose", 1.0, self.steps, state.outside, 0.0, note))
