"""What a solve can end as.  The value is what result.json and exit codes are derived from."""

from __future__ import annotations

from enum import StrEnum


class Status(StrEnum):
    """Outcome of a solve; only the first two are certified equilibria."""

    SOLVED = "SOLVED"
    SOLVED_NEARBY = "SOLVED_NEARBY"
    UNSTABLE = "UNSTABLE"
    CONE_VIOLATED = "CONE_VIOLATED"
    INFEASIBLE = "INFEASIBLE"
    TOO_SOFT = "TOO_SOFT"
    ITERATION_LIMIT = "ITERATION_LIMIT"
    INTERRUPTED = "INTERRUPTED"
    NONFINITE = "NONFINITE"

    @property
    def certified(self) -> bool:
        """True for a stable frictional equilibrium."""
        return self in (Status.SOLVED, Status.SOLVED_NEARBY)

    @property
    def exit_code(self) -> int:
        """Exit code of the command line program."""
        if self.certified:
            return 0
        return {Status.INFEASIBLE: 3, Status.INTERRUPTED: 130}.get(self, 1)
