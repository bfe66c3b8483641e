"""The methods of inversion by name, and which of them solves a piece."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

from casashell.inverse.auto import AutoSolver
from casashell.inverse.direct import DirectSolver
from casashell.inverse.load_path import Report
from casashell.inverse.outcome import PieceSolver
from casashell.inverse.piece import Piece
from casashell.typing import FloatArray

METHODS: Final = ("auto", "direct", "two-step", "nlp", "free-pose")
STEP2: Final = ("ipopt", "bfgs")
PRESETS: Final = ("scaled", "paper")
StepTwoMethod: TypeAlias = Literal["ipopt", "bfgs"]


@dataclass(frozen=True, eq=False)
class Choice:
    """How to solve; the arguments of `casashell.solve`, checked.

    preferred  (V,3) m or None
    Raises ValueError for an unknown method, second step or preset.
    """

    method: str
    step2: StepTwoMethod
    preset: str
    preferred: FloatArray | None

    def __post_init__(self) -> None:
        for name, value, known in (
            ("method", self.method, METHODS),
            ("step2", self.step2, STEP2),
            ("preset", self.preset, PRESETS),
        ):
            if value not in known:
                raise ValueError(f"{name} must be one of {', '.join(known)}; got '{value}'")

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
        return DirectSolver(piece, report) if self.method == "direct" else AutoSolver(piece, report)
