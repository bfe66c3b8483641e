"""Can a target be held at all?  Convex answers before a solve.

In this order, cheapest first: a rigid motion that nothing resists (a proof), balance as a whole, the
convex stress program with the true friction and free masses, and stability by linear cuts.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from casashell.inverse.feasibility_masses import TRUE_CONES, area_spread, free_masses
from casashell.inverse.feasibility_mending import SAME_AREAS, Mending, mend_elastic, mend_rigid
from casashell.inverse.feasibility_proof import Proof, rigid_proof
from casashell.inverse.feasibility_states import (
    StabilityMargin,
    StressState,
    least_stress,
    stability,
    state_of,
)
from casashell.inverse.forces import SHRINKS, Shrink, project_reactions
from casashell.inverse.piece import Piece, split
from casashell.inverse.stress import StressProgram
from casashell.problem import Problem
from casashell.typing import IntArray

#: Balance with natural areas that differ from the target's by more than this factor is doubtful.
NEAR_AREAS = 1.1


class Verdict(StrEnum):
    """From best to worst; the last one is a theorem, the others are what the programs found."""

    FEASIBLE = "FEASIBLE"
    DOUBTFUL = "DOUBTFUL"
    UNSTABLE = "UNSTABLE"
    TOO_SOFT = "TOO_SOFT"
    INFEASIBLE = "INFEASIBLE"

    @property
    def exit_code(self) -> int:
        """Exit code of the command line program."""
        return {Verdict.FEASIBLE: 0, Verdict.INFEASIBLE: 3}.get(self, 1)


@dataclass(frozen=True, eq=False)
class PartFeasibility:
    """The answer for one connected part.

    vertices     (n,) ids in the whole mesh; proof and mending use the numbering of the part
    contacts     (C,) vertex ids, in the whole mesh, of its contacts
    friction     least friction coefficient of its contacts; None without contacts
    reason       which stage decided: "rigid", "masses", "stresses", "measures", "program", "folds",
                 "stability", or "" when feasible
    area_factor  natural areas have to differ from the target's by this factor for contacts and pins to
                 balance the loads, 1 when the target's do; None when no factor up to 4 does
    proof        a checked proof, or for a doubtful part the certificate that is too weak to be one
    """

    vertices: IntArray
    contacts: IntArray
    friction: float | None
    verdict: Verdict
    reason: str = ""
    area_factor: float | None = None
    proof: Proof | None = None
    mending: Mending | None = None
    state: StressState | None = None
    margin: StabilityMargin | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Feasibility:
    """Whether a natural shape can exist that holds the target of a problem.

    verdict  the worst of the parts
    seconds  wall clock time
    """

    verdict: Verdict
    parts: tuple[PartFeasibility, ...]
    seconds: float

    @property
    def exit_code(self) -> int:
        """0 feasible, 1 doubtful, unstable or too soft, 3 proved infeasible."""
        return self.verdict.exit_code

    @property
    def summary(self) -> tuple[str, ...]:
        """Sentences: the verdict, what it rests on, what to do."""
        from casashell.inverse.feasibility_words import summary

        return summary(self)

    @property
    def record(self) -> dict[str, Any]:
        """The same for programs; SI units, ids of the whole mesh."""
        from casashell.inverse.feasibility_words import record

        return record(self)


def feasibility(
    problem: Problem, *, seconds: float = 20.0, interpreted: bool = False
) -> Feasibility:
    """Whether some natural shape can hold the target of ``problem``, without solving for it.

    seconds      time for cuts and for trying out pins; a program that has begun is not cut short
    interpreted  run kernels by CasADi's virtual machine even when there is a C compiler

    INFEASIBLE is proved: for any masses or for natural areas within a factor of four of the target's
    (`Proof.area_factor`), whatever the stiffness.  The other verdicts are about this material: an
    equilibrium in rest lengths and angles is found or not; that a mesh has them is for `solve`.
    Raises ValueError when ``seconds`` is not a positive number.
    """
    if not seconds > 0.0:
        raise ValueError(f"seconds must be a positive number, got {seconds}")
    started = time.perf_counter()
    deadline = started + seconds
    parts = tuple(_judge(piece, deadline) for piece in split(problem, interpreted=interpreted))
    order = list(Verdict)
    worst = max((part.verdict for part in parts), key=order.index)
    return Feasibility(worst, parts, time.perf_counter() - started)


@dataclass(frozen=True)
class _Part:
    """One piece on its way through the stages."""

    piece: Piece
    deadline: float

    def says(self, verdict: Verdict, reason: str = "", **found: Any) -> PartFeasibility:
        piece = self.piece
        contacts = piece.contacts
        return PartFeasibility(
            vertices=piece.vertices,
            contacts=piece.vertices[contacts.vertices],
            friction=float(contacts.friction.min()) if len(contacts) else None,
            verdict=verdict,
            reason=reason,
            **found,
        )


def _judge(piece: Piece, deadline: float) -> PartFeasibility:
    """The stages in order; each returns what it knows."""
    part = _Part(piece, deadline)
    notes: list[str] = []
    if len(np.unique(piece.pinned)) == len(piece.target):
        notes.append("every vertex is pinned: nothing to balance, nothing can move")
        return part.says(Verdict.FEASIBLE, area_factor=1.0, notes=tuple(notes))
    if not piece.loads.any():
        notes.append("no weight: the target is its own natural shape, without contact forces")
        return _stressed(part, StressProgram(piece), 1.0, notes)
    if len(piece.contacts) == 0:
        notes.append("no contacts: no cones to test")
    if not piece.elastic_terms_are_blind:
        notes.append("an energy holds the shell in place by itself: balance as a whole skipped")
        return _stressed(part, StressProgram(piece), 1.0, notes)
    proof = rigid_proof(piece)
    if proof is not None:
        mending = mend_rigid(piece, proof.motion)
        return part.says(Verdict.INFEASIBLE, "rigid", proof=proof, mending=mending)
    spread = area_spread(piece)
    if spread is None or spread[0] > NEAR_AREAS:
        return part.says(
            Verdict.DOUBTFUL,
            "masses",
            area_factor=None if spread is None else spread[0],
            mending=mend_rigid(piece, None),
        )
    factor, loads = spread
    if factor <= 1.0 + SAME_AREAS:
        factor, loads = 1.0, piece.loads
    return _stressed(part, StressProgram(piece, loads), factor, notes)


def _stressed(
    part: _Part, program: StressProgram, factor: float, notes: list[str]
) -> PartFeasibility:
    """Stresses at every vertex, then stability."""
    if not program.complete:
        notes.append("an energy has no strain measure: stresses and stability skipped")
        return part.says(Verdict.DOUBTFUL, "measures", area_factor=factor, notes=tuple(notes))
    for shrink in _shrinks(program):
        found = least_stress(program, shrink)
        if found is not None:
            break
    else:
        return _no_stress(part, program, factor, notes)
    stress, limit = found
    state = state_of(program, stress)
    if limit is not None:
        notes.append("stresses of least energy ask for more; these stay within fold and stretch")
    known: dict[str, Any] = {"area_factor": factor}
    if not state.bearable:
        notes.append("stability skipped: these stresses are beyond what a mesh can have")
        return part.says(Verdict.TOO_SOFT, "folds", state=state, notes=tuple(notes), **known)
    margin, stress = stability(program, stress, shrink, limit, part.deadline)
    state = state_of(program, stress)
    known |= {"state": state, "margin": margin, "notes": tuple(notes)}
    if margin.ended == "time":
        return part.says(Verdict.DOUBTFUL, "stability", **known)
    if not margin.stable:
        return part.says(Verdict.UNSTABLE, "stability", **known)
    if not state.bearable:
        return part.says(Verdict.TOO_SOFT, "folds", **known)
    return part.says(Verdict.FEASIBLE, **known)


def _shrinks(program: StressProgram) -> list[Shrink]:
    """Cones to try: the most comfortable that can balance the whole, then the true ones."""
    piece = program.piece
    if len(piece.contacts) == 0 or not piece.loads.any() or not piece.elastic_terms_are_blind:
        return [TRUE_CONES]
    own = -piece.loads[piece.contacts.vertices]
    for shrink in SHRINKS:
        if project_reactions(piece, own, program.loads, shrink) is not None:
            return [shrink, TRUE_CONES]
    return [TRUE_CONES]


def _no_stress(
    part: _Part, program: StressProgram, factor: float, notes: list[str]
) -> PartFeasibility:
    """The stress program has no solution at the target's masses: a proof, or doubt."""
    free = free_masses(program)
    known: dict[str, Any] = {"area_factor": factor, "notes": tuple(notes)}
    if free.feasible is None:
        return part.says(Verdict.DOUBTFUL, "program", **known)
    if free.feasible or free.proof is None:
        return part.says(Verdict.DOUBTFUL, "masses", **known)
    mending = mend_elastic(program, free.proof.motion, part.deadline)
    verdict = Verdict.INFEASIBLE if free.proof.holds else Verdict.DOUBTFUL
    return part.says(verdict, "stresses", proof=free.proof, mending=mending, **known)
