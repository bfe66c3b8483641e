"""What a solve did over time: its iterates, judged after the run, and the clocks of its two steps."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any, Final
from unittest.mock import patch

import numpy as np

from casashell.contact.cone import margin, split
from casashell.engine.assembly import Assembly
from casashell.inverse.balance import rounding
from casashell.inverse.balance_nlp import BalanceNlp
from casashell.inverse.cone_residual import BETA, ConeResidual
from casashell.inverse.piece import Piece
from casashell.inverse.piece import split as pieces_of
from casashell.inverse.pulled import Pulled
from casashell.inverse.step_one import StepOne
from casashell.inverse.step_two import step_two
from casashell.problem import Problem
from casashell.result import Step
from casashell.typing import FloatArray

#: Iterates nearer in time than this factor are left out: on a log axis nobody could tell.
SPACING: Final = 1.02


@dataclass(frozen=True, eq=False)
class Iterate:
    """Natural shape and pose (V,3) [m] after so many seconds."""

    seconds: float
    stage: str
    rest: FloatArray
    pose: FloatArray


class Recorder:
    """Callback of `solve` that keeps iterates: the last of every stage, and others well apart."""

    def __init__(self) -> None:
        self._kept: list[Iterate] = []
        self._last: Iterate | None = None
        self._due = 0.0

    def __call__(self, step: Step) -> None:
        """Keep the iterate before this one if it is worth it."""
        if step.rest is None or step.pose is None:
            return
        last, pose = self._last, step.pose
        if last is not None:
            if step.stage != last.stage or last.seconds >= self._due:
                self._kept.append(last)
                self._due = SPACING * last.seconds
            if np.array_equal(pose, last.pose):
                pose = last.pose  # one array for all that share it
        self._last = Iterate(step.seconds, step.stage, step.rest, pose)

    @property
    def iterates(self) -> list[Iterate]:
        """In order of time, the very last included."""
        return self._kept if self._last is None else [*self._kept, self._last]


@dataclass
class Clock:
    """Time and iterations of all calls of one step."""

    seconds: float = 0.0
    calls: int = 0
    iterations: int = 0

    def around(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """``function`` with its time taken, also when it is interrupted."""

        def timed(*arguments: Any, **options: Any) -> Any:
            begin = time.perf_counter()
            self.calls += 1
            try:
                found = function(*arguments, **options)
                self.iterations += found.iterations
                return found
            finally:
                self.seconds += time.perf_counter() - begin

        return timed


@dataclass
class StepClocks:
    """Within ``with``, times every Step 1 and Step 2 that the two-step solver makes."""

    one: Clock = field(default_factory=Clock)
    two: Clock = field(default_factory=Clock)

    def __enter__(self) -> StepClocks:
        self._undo = ExitStack()
        self._undo.enter_context(patch.object(StepOne, "solve", self.one.around(StepOne.solve)))
        second = self.two.around(step_two)
        self._undo.enter_context(patch("casashell.inverse.two_step.step_two", second))
        return self

    def __exit__(self, *_: object) -> None:
        self._undo.close()


class Yardstick:
    """Measures natural shape and pose (V,3) of a problem, at full load and without any pull."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.pieces = list(pieces_of(problem))

    def errors(self, rest: FloatArray, pose: FloatArray) -> tuple[float, float, float]:
        """Largest free force / f0, largest violation of a cone / f0, distance / bounding box.

        The violation is that of the true friction: pull, or tangential force beyond mu f_N; where
        several contacts share a vertex, what no sum of admissible forces provides counts too.
        """
        free = outside = 0.0
        for piece in self.pieces:
            forces = self._forces(piece, rest, pose)
            loose = np.setdiff1d(np.arange(len(forces)), piece.held)
            free = max(free, float(np.abs(forces[loose]).max(initial=0.0)) / piece.f0)
            outside = max(outside, cone_violation(piece, forces))
        target = self.problem.target
        away = float(np.abs(pose - target.vertices).max()) / target.bbox_diagonal
        return free, outside, away

    def cone_residual(self, rest: FloatArray, pose: FloatArray, beta: float = BETA) -> float:
        """G = |G_K(F)|^2 / 2 of Ly 2018, Sec. 6, in f0^2, kinked and with ``beta`` mu for mu."""
        return sum(self._residuals(rest, pose, beta))

    def cone_residual_in_newtons(self, rest: FloatArray, pose: FloatArray) -> float:
        """The same with 0.975 mu in N^2."""
        parts = self._residuals(rest, pose, BETA)
        return sum(part * piece.f0**2 for part, piece in zip(parts, self.pieces, strict=True))

    def rounding_floor(self, rest: FloatArray, pose: FloatArray) -> float:
        """What rounding the coordinates of the natural shape makes of G at most, in f0^2."""
        total = 0.0
        for piece in self.pieces:
            x, r = self._local(piece, pose), self._local(piece, rest)
            program = BalanceNlp(Pulled(piece, 0.0), x, r)
            total += 0.5 * len(program.dofs) * rounding(program) ** 2
        return total

    def distance(self, pose: FloatArray) -> float:
        """J = |x - x_t|^2 / 2 [m2], the column Phi of the paper's Table 2."""
        return 0.5 * float(((pose - self.problem.target.vertices) ** 2).sum())

    def elastic_energy(self, rest: FloatArray, pose: FloatArray) -> float:
        """Energy of all terms but the loads [J]."""
        terms = [term for term in self.problem.energies if not term.load]
        return Assembly(terms, len(rest)).energy(pose, rest)

    def _residuals(self, rest: FloatArray, pose: FloatArray, beta: float) -> list[float]:
        return [
            ConeResidual(piece, beta=beta).value(self._forces(piece, rest, pose))[0]
            for piece in self.pieces
        ]

    @staticmethod
    def _local(piece: Piece, points: FloatArray) -> FloatArray:
        return np.ascontiguousarray(points[piece.vertices] - piece.origin)

    def _forces(self, piece: Piece, rest: FloatArray, pose: FloatArray) -> FloatArray:
        return piece.assembly.gradient(self._local(piece, pose), self._local(piece, rest))


def cone_violation(piece: Piece, forces: FloatArray) -> float:
    """How far the worst contact is outside its cone when vertices need ``forces`` (n,3) [N], / f0."""
    contacts = piece.contacts
    if len(contacts) == 0:
        return 0.0
    felt = ConeResidual(piece, beta=1.0).contact_forces(forces)
    normal, _ = split(felt, contacts.normals)
    room = margin(felt, contacts.normals, contacts.friction)
    missed = np.linalg.norm((forces - piece.spread(felt))[contacts.vertices], axis=1)
    worst = max(-float(room.min()), -float(normal.min()), float(missed.max()), 0.0)
    return worst / piece.f0
