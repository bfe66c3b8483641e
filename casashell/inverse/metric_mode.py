"""A natural metric for a whole shell: from natural meshes where there are any, else by the program."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from casashell.inverse.load_path import Report
from casashell.inverse.metric_fit import nearest_mesh
from casashell.inverse.metric_solver import MetricOutcome, MetricSolver
from casashell.inverse.piece import Piece
from casashell.mesh import TriMesh
from casashell.metric import Metric, require_forms
from casashell.problem import Problem
from casashell.result import Quality
from casashell.typing import FloatArray

NATURALS: Final = ("mesh", "metric")
#: Advice for a target that a metric holds and no mesh that was found.
METRIC_ONLY: Final = (
    "The target is a stable frictional equilibrium of these natural lengths and angles (metric.npz); "
    "no natural mesh was found that has them, so a simulator has to take the numbers."
)
_NEAREST: Final = (
    "the natural shape is a metric that no mesh was found for: pictures and nearest.obj show the "
    "mesh nearest to it"
)


@dataclass
class MetricMode:
    """The pieces of one problem whose natural shape exists as a metric only.

    Raises ValueError for an energy that has no metric form.
    """

    problem: Problem
    found: dict[int, tuple[MetricOutcome, FloatArray]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    rounds: int = 0

    def __post_init__(self) -> None:
        require_forms(self.problem.energies)

    def solve(self, number: int, piece: Piece, report: Report) -> bool:
        """Look for the metric of a piece that has no natural mesh; whether one was found."""
        solver = MetricSolver(piece, self.problem.target, report)
        outcome = solver.run()
        self.rounds += solver.rounds
        self.notes += solver.notes
        if outcome is not None:
            shape = nearest_mesh(solver.state, outcome.metric) + piece.origin
            self.found[number] = (outcome, shape)
            self.notes.append(_NEAREST)
        return outcome is not None

    def applied(
        self, pieces: list[Piece], rest: FloatArray, pose: FloatArray, forces: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Natural shape, pose (V,3) and contact forces (C,3) with those of the found pieces.

        Their natural shape is the nearest mesh, their pose the target.
        """
        rest, pose, forces = rest.copy(), pose.copy(), forces.copy()
        contacts, target = self.problem.contacts, self.problem.target.vertices
        for number, (outcome, nearest) in self.found.items():
            ids = pieces[number].vertices
            rest[ids], pose[ids] = nearest, target[ids]
            forces[np.isin(contacts.vertices, ids)] = outcome.contact_forces
        return rest, pose, forces

    def metric(self, pieces: list[Piece], rest: FloatArray) -> Metric | None:
        """The metric of the whole shell: of the mesh ``rest`` (V,3) m but for the found pieces.

        None when ``rest`` is not finite.
        """
        target = self.problem.target
        if not np.isfinite(rest).all():
            return None
        whole = Metric.of(target, rest)
        lengths, angles = whole.rest_length.copy(), whole.rest_angle.copy()
        areas = whole.rest_area.copy()
        for number, (outcome, _) in self.found.items():
            mine = np.zeros(len(target.vertices), dtype=bool)
            mine[pieces[number].vertices] = True
            on = mine[whole.edges[:, 0]]
            lengths[on] = outcome.metric.rest_length[on]
            on = mine[whole.hinges[:, 0]]
            angles[on] = outcome.metric.rest_angle[on]
            on = mine[target.faces[:, 0]]
            areas[on] = outcome.metric.rest_area[on]
        return replace(
            whole,
            rest_length=lengths,
            rest_angle=angles,
            rest_area=areas,
            embedded=not self.found,
        )


def metric_quality(target: TriMesh, metric: Metric | None, mesh: Quality) -> Quality:
    """Quality of a natural shape: of its mesh, or of a metric that no mesh has.

    Then lengths, angles and corners are its own, and the rest is of the mesh nearest to it.
    """
    if metric is None or metric.embedded:
        return mesh
    start = Metric.of(target, target.vertices)
    stretch = np.abs(metric.rest_length / start.rest_length - 1.0)
    fold = np.abs(metric.rest_angle - start.rest_angle)
    return replace(
        mesh,
        max_stretch=float(stretch.max(initial=0.0)),
        max_rest_fold=float(fold.max(initial=0.0)),
        min_rest_angle=float(metric.corner_angles(target).min()),
    )
