"""What is told of a trajectory, and the table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from benchmarks.peers.programs import Trajectory
from casashell.contact.obstacles import Obstacle
from casashell.result import Result
from casashell.typing import IntArray

#: Creep is the way of the last so many seconds, which shaking in place does not add up to.
LAST: Final = 0.5
HEAD: Final = (
    "| scene | program | natural shape | drift after 2 s | drift after 10 s | creep at the end, mm/s | "
    "wall s a frame |"
)


@dataclass(frozen=True)
class Row:
    """One run: drift in bounding boxes at the times asked for (NaN: not run so long).

    creep  largest tangential speed [m/s] of a contact of the design over the last half second
    """

    scene: str
    program: str
    rest: str
    drift: tuple[float, ...]
    creep: float
    frame_seconds: float

    def cells(self) -> str:
        """The row in Markdown."""
        drifts = ["" if np.isnan(value) else f"{value:.2g}" for value in self.drift]
        numbers = [*drifts, f"{1e3 * self.creep:.2g}", f"{self.frame_seconds:.3f}"]
        return "| " + " | ".join([self.scene, self.program, self.rest, *numbers]) + " |"


def measured(
    scene: str, program: str, rest: str, run: Trajectory, result: Result, moments: Sequence[float]
) -> Row:
    """Raises ValueError for a trajectory of another shell or with positions that are not finite."""
    expected = result.target.vertices.shape
    if run.positions.shape[1:] != expected:
        raise ValueError(f"{program}: {run.positions.shape[1]} vertices, {expected[0]} expected")
    if not np.isfinite(run.positions).all():
        frame = int(np.flatnonzero(~np.isfinite(run.positions).all(axis=(1, 2)))[0])
        raise ValueError(f"{program}, {scene}: positions of frame {frame} are not finite")
    drifts = tuple(drift_at(run, moment, result.target.bbox_diagonal) for moment in moments)
    speed = creep(run, result.contacts.vertices, result.obstacles)
    return Row(scene, program, rest, drifts, speed, run.frame_seconds)


def drift_at(run: Trajectory, moment: float, size: float) -> float:
    """Farthest a vertex is from its start at a time, in ``size``; NaN when the run is shorter."""
    if run.times[-1] < moment - 1e-6:
        return float("nan")
    frame = int(np.argmin(np.abs(run.times - moment)))
    way = np.linalg.norm(run.positions[frame] - run.positions[0], axis=1)
    return float(way.max() / size)


def creep(run: Trajectory, contacts: IntArray, obstacles: Sequence[Obstacle]) -> float:
    """Largest speed [m/s] along the body of vertices ``contacts`` over the last half second."""
    first = int(np.searchsorted(run.times, run.times[-1] - LAST - 1e-6))
    if not len(contacts) or not obstacles or first == len(run.times) - 1:
        return 0.0
    begin, end = run.positions[first, contacts], run.positions[-1, contacts]
    found = [obstacle.signed_distance(begin) for obstacle in obstacles]
    nearest = np.argmin([distance for distance, _ in found], axis=0)
    normals = np.stack([normal for _, normal in found])[nearest, np.arange(len(begin))]
    way = end - begin
    along = way - (way * normals).sum(axis=1, keepdims=True) * normals
    duration = float(run.times[-1] - run.times[first])
    return float(np.linalg.norm(along, axis=1).max() / duration)


def table(rows: Sequence[Row]) -> str:
    """All rows in Markdown."""
    return "\n".join([HEAD, "|" + "---|" * 7, *(row.cells() for row in rows)])
