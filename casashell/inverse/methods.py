"""The methods of inversion by name, and which of them solves a piece."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

from casashell.inverse.auto import AutoSolver
from casashell.inverse.direct import DirectSolver
from casashell.inverse.load_path import Report
from casashell.inverse.outcome import PieceSolver
from casashell.inverse.piece import Piece
from casashell.inverse.warm_start import WarmStart
from casashell.typing import FloatArray

METHODS: Final = ("auto", "direct", "two-step", "nlp", "free-pose")
#: Methods that can begin with an earlier result.
STARTED: Final = ("auto", "direct")
STEP2: Final = ("ipopt", "bfgs")
PRESETS: Final = ("scaled", "paper")
StepTwoMethod: TypeAlias = Literal["ipopt", "bfgs"]


@dataclass(frozen=True, eq=False)
class Choice:
    """How to solve; the arguments of `casashell.solve`, checked.

    preferred  (V,3) m or None
    start      an earlier result that "auto" and "direct" begin with, or None
    Raises ValueError for an unknown method, second step or preset, and for a method without a start.
    """

    method: str
    step2: StepTwoMethod
    preset: str
    preferred: FloatArray | None
    start: WarmStart | None = None

    def __post_init__(self) -> None:
        for name, value, known in (
            ("method", self.method, METHODS),
            ("step2", self.step2, STEP2),
            ("preset", self.preset, PRESETS),
        ):
            if value not in known:
                raise ValueError(f"{name} must be one of {', '.join(known)}; got '{value}'")
        if self.start is not None and self.method not in STARTED:
            raise ValueError(
                f"start helps the methods {', '.join(STARTED)} only, not '{self.method}': leave it out"
            )

    def solver(self, piece: Piece, report: Report) -> PieceSolver:
        """The solver of one piece; methods are loaded when they are asked for."""
        solver = self._method(piece, report)
        if self.preferred is None:
            return solver
        from casashell.inverse.prefer import PreferSolver

        preferred = self.preferred[piece.vertices] - piece.origin
        return PreferSolver(piece, report, solver, preferred)

    def _method(self, piece: Piece, report: Report) -> PieceSolver:
        if self.method == "two-step":
            from casashell.inverse.two_step import PRESETS as SCHEDULES
            from casashell.inverse.two_step import TwoStepSolver

            return TwoStepSolver(
                piece, report, step2=self.step2, continuation=SCHEDULES[self.preset]
            )
        if self.method == "nlp":
            from casashell.inverse.one_shot import NlpSolver

            return NlpSolver(piece, report)
        if self.method == "free-pose":
            from casashell.inverse.free_pose import FreePoseSolver

            return FreePoseSolver(piece, report)
        guess = None if self.start is None else self.start.of(piece)
        made = DirectSolver if self.method == "direct" else AutoSolver
        return made(piece, report, guess)
