"""Natural metric of one piece: the convex program, linearised again and cut until it is stable.

Reaches softer materials than a natural mesh can: the strain forces are free, where those of a mesh have
to be compatible.  Ends with a stable equilibrium at exactly the target, or with none that it could find.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Final

import numpy as np

from casashell.inverse.forces import SHRINKS, Block
from casashell.inverse.load_path import Report
from casashell.inverse.metric_cuts import StiffnessMap
from casashell.inverse.metric_program import THINNEST, Balanced, MetricProgram
from casashell.inverse.metric_state import MetricState
from casashell.inverse.piece import Piece
from casashell.inverse.stability import free_dofs, lowest_eigenpairs
from casashell.mesh import TriMesh
from casashell.metric import Metric, thinness
from casashell.result import Step
from casashell.typing import FloatArray, IntArray

#: Rounds of the program at most, and seconds after which no other is begun.
MAX_ROUNDS: Final = 40
MAX_SECONDS: Final = 120.0
#: Least curvature asked for, times f0 / h; and the share of it that is enough.
DELTA: Final = 3e-3
ENOUGH: Final = 0.3
#: Unstable directions that become one cut.
BLOCK: Final = 8
#: Residual / f0 at which the linearisation no longer matters.
SETTLED: Final = 1e-10
_POLISHING: Final = 4


@dataclass(frozen=True, eq=False)
class MetricOutcome:
    """A metric of the whole mesh that is right on one piece.

    metric          the other pieces have the numbers of the target there
    contact_forces  (C,3) N, on the shell, of the piece
    residual        what is out of balance, / f0
    eigenvalue      lowest of the free Hessian, times h / f0
    """

    metric: Metric
    contact_forces: FloatArray
    residual: float
    eigenvalue: float


class MetricSolver:
    """Runs the rounds on one piece.

    Raises ValueError for an energy that has no metric form.
    """

    def __init__(self, piece: Piece, mesh: TriMesh, report: Report) -> None:
        self.piece, self.report = piece, report
        self.state = MetricState(piece, mesh)
        self.notes: list[str] = []
        self.rounds = 0
        active = np.ones(len(piece.contacts.vertices), dtype=bool)
        self.dofs = free_dofs(piece, active)
        free = np.zeros(len(piece.target), dtype=bool)
        free[self.dofs // 3] = True
        places = [np.flatnonzero(free)[:, None], piece.edges]
        self.places = [_coordinates(place[free[place].all(axis=1)]) for place in places]
        self.chosen = [np.zeros(len(place), dtype=bool) for place in self.places]
        self.directions: list[FloatArray] = []

    def run(self) -> MetricOutcome | None:
        """A stable metric, or None."""
        if len(self.state.terms) == 0:
            self.notes.append("no metric: no energy has a strain measure")
            return None
        program, shrinks = MetricProgram(self.state), list(SHRINKS)
        columns = np.zeros(program.frames.shape[1])
        begin = time.perf_counter()
        for self.rounds in range(1, MAX_ROUNDS + 1):
            found = program.solve(shrinks[0], self._cuts(program))
            while found is None and len(shrinks) > 1:
                shrinks.pop(0)
                found = program.solve(shrinks[0], self._cuts(program))
            if found is None:
                self.notes.append(
                    "no natural metric" + (" that is stable" if self._cut else "") + " was found: "
                    "the convex program has no solution"
                )
                return None
            if not self._move(program, found.tau):
                self.notes.append("no natural metric was found: rest lengths make no triangles")
                return None
            columns = found.columns
            outcome = self._judged(program, columns)
            self.report(Step("metric", 1.0, self.rounds, outcome.residual, 0.0))
            if outcome.eigenvalue > ENOUGH * DELTA:
                outcome = self._polished(program, columns)
                if outcome.eigenvalue > ENOUGH * DELTA and outcome.residual <= SETTLED:
                    return outcome
            if time.perf_counter() - begin > MAX_SECONDS:
                break
        self.notes.append(
            f"no stable natural metric after {self.rounds} rounds of the convex program"
        )
        return None

    @property
    def _cut(self) -> bool:
        return bool(self.directions)

    @property
    def _unit(self) -> float:
        return self.piece.f0 / self.piece.h

    def _cuts(self, program: MetricProgram) -> list[Block]:
        if not self._cut:
            return []
        stiffness, delta = StiffnessMap(self.state, program.metric, program.now), DELTA * self._unit
        cuts = [stiffness.along(block, delta) for block in self.directions]
        cuts += [
            stiffness.on(dofs[chosen], delta)
            for dofs, chosen in zip(self.places, self.chosen, strict=True)
            if chosen.any()
        ]
        return cuts

    def _move(self, program: MetricProgram, tau: FloatArray) -> bool:
        """Linearise at the metric with the strain forces ``tau``, or on the way to it."""
        before = program.now.tau
        for share in (1.0, 0.5, 0.25, 0.1, 0.03):
            metric = self.state.realised(program.metric, before + share * (tau - before))
            sides = metric.rest_length[self.state.index.sides]
            if np.all(np.isfinite(metric.rest_angle)) and thinness(sides).min() > 0.5 * THINNEST:
                program.at(metric)
                return True
        return False

    def _judged(self, program: MetricProgram, columns: FloatArray) -> MetricOutcome:
        """Residual and stability at the metric; what is unstable becomes a cut."""
        stiffness = StiffnessMap(self.state, program.metric, program.now)
        delta = DELTA * self._unit
        matrix = stiffness.matrix[self.dofs][:, self.dofs]
        values, vectors = lowest_eigenpairs(matrix.tocsr(), BLOCK)
        if values[0] <= ENOUGH * delta:
            weak = values < 20.0 * delta
            block = np.zeros((self.piece.target.size, int(weak.sum())))
            block[self.dofs] = vectors[:, weak]
            self.directions.append(block)
            for dofs, chosen in zip(self.places, self.chosen, strict=True):
                if len(dofs):
                    chosen |= stiffness.lowest_on(dofs) < delta
        residual = float(np.abs(program.residual(columns)).max(initial=0.0))
        forces = program.forces(columns)
        return MetricOutcome(program.metric, forces, residual, float(values[0]) / self._unit)

    def _polished(self, program: MetricProgram, columns: FloatArray) -> MetricOutcome:
        """Newton on the balance with the weight of the metric itself, from an outcome near it."""
        for _ in range(_POLISHING):
            found = program.polished(Balanced(program.now.tau, columns))
            columns = found.columns
            program.at(self.state.realised(program.metric, found.tau))
            if np.abs(program.residual(columns)).max(initial=0.0) <= 1e-3 * SETTLED:
                break
        return self._judged(program, columns)


def _coordinates(vertices: IntArray) -> IntArray:
    """Coordinates (n,3k) of vertices (n,k)."""
    return np.asarray((3 * vertices[:, :, None] + np.arange(3)).reshape(len(vertices), -1))
