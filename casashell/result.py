"""The result of a solve: the natural shape and the evidence that it is one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from casashell.contact.detect import Contacts
from casashell.engine.energy import Energy
from casashell.mesh import TriMesh
from casashell.metric import Metric
from casashell.status import Status
from casashell.typing import AnyArray, FloatArray, IntArray


@dataclass(frozen=True)
class Certificate:
    """Evidence for a stable frictional equilibrium, all relative to ``f0`` [N] and ``h`` [m].

    Every entry is None when it does not apply (no contacts) or could not be computed (no pose).
    """

    free_force: float | None
    cone_margin: float | None
    min_normal_force: float | None
    min_eigenvalue: float | None
    min_eigenvalue_scaled: float | None
    target_distance: float | None
    f0: float
    h: float
    neutral_modes: int = 0
    evaluator: str = "numpy"


@dataclass(frozen=True)
class Quality:
    """Shape of the natural mesh: how far from the target and how well-shaped."""

    max_stretch: float
    max_rest_fold: float
    min_rest_angle: float
    flipped_faces: int
    rest_self_intersections: int
    softest_factor: float | None = None


@dataclass(frozen=True)
class Step:
    """One line of the history; what a callback receives at every iteration.

    residual    of the stage's own equations, mostly in f0
    seconds     since the solve began
    rest, pose  (V,3) m, where the stage has them; in a callback only, the history keeps none
    """

    stage: str
    load: float
    iteration: int
    residual: float
    seconds: float
    note: str = ""
    rest: FloatArray | None = field(default=None, compare=False, repr=False)
    pose: FloatArray | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True)
class Result:
    """Natural shape, contact forces and certificate of one solve.

    rest, pose       (V,3) m; the target is ``target.vertices``
    contact_forces   (C,3) N, on the shell, in the order of ``contacts``
    forces           (V,3) N, dE/dx at (pose, rest)
    material         arrays each energy term wrote about itself: edges, hinges, stretch, bend, ...
    contact_tolerance  m, the one the contacts were found with; kept for running again
    metric           natural lengths, angles and areas, when they were asked for.  Where it is not
                     embedded no mesh has them: then ``forces`` and the certificate are those of the
                     metric, and ``rest`` is the nearest mesh, good for pictures only
    energies         those of the problem, for `casashell.simulate`; results read from files have none
    """

    status: Status
    advice: str
    method: str
    target: TriMesh
    rest: FloatArray
    pose: FloatArray
    contacts: Contacts
    pinned: IntArray
    contact_forces: FloatArray
    forces: FloatArray
    material: Mapping[str, AnyArray]
    certificate: Certificate
    quality: Quality
    obstacles: tuple[Any, ...] = ()
    history: tuple[Step, ...] = ()
    notes: tuple[str, ...] = ()
    seconds: float = 0.0
    iterations: int = 0
    factorizations: int = 0
    timings: Mapping[str, float] = field(default_factory=dict)
    contact_tolerance: float | None = None
    metric: Metric | None = None
    energies: tuple[Energy, ...] = field(default=(), compare=False, repr=False)

    @property
    def natural(self) -> str:
        """What the certificate is about: "mesh" (``rest``) or "metric" (``metric``)."""
        return "mesh" if self.metric is None or self.metric.embedded else "metric"

    def require(self) -> Result:
        """The result itself if it is a certified equilibrium, else NotConverged is raised."""
        if not self.status.certified:
            raise NotConverged(self)
        return self

    def save(self, folder: str | Path, *, unit: float = 1.0, overwrite: bool = False) -> None:
        """Write natural.obj, pose.obj, result.json, result.npz and scene.toml into ``folder``.

        unit is metres per unit of the mesh files; overwrite replaces an earlier result.  Raises
        FileExistsError for a folder with files and OSError for what the file system refuses.
        """
        from casashell.io.results import save_result

        save_result(self, folder, unit=unit, overwrite=overwrite)

    @staticmethod
    def load(folder: str | Path) -> Result:
        """The result saved in ``folder``; ValueError if there is none."""
        from casashell.io.results import load_result

        return load_result(folder)


class NotConverged(RuntimeError):
    """Raised by `Result.require`; ``result`` holds the best shape found and its certificate."""

    def __init__(self, result: Result) -> None:
        super().__init__(f"{result.status}: {result.advice}")
        self.result = result
