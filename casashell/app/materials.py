"""`casashell materials`: how soft, heavy and slippery a material may be for one target."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from casashell.app.display import Reporter
from casashell.app.failures import FAILURE, INTERRUPTED, complain, reading_input
from casashell.app.named_materials import SHEETS, Sheet
from casashell.app.options import SceneOptions
from casashell.app.scene import Material, Scene
from casashell.contact.detect import describe
from casashell.inverse.advice import status_of
from casashell.inverse.certificate import certify
from casashell.inverse.material_range import MaterialRange, Progress, material_range
from casashell.inverse.outcome import judged
from casashell.inverse.piece import split
from casashell.inverse.softest import Softest, SoftestSearch
from casashell.result import Step
from casashell.status import Status
from formulations.calibration import Calibration, calibrate

#: A material guessed to be within this share of holding is given forces of its own as well.
_NEAR = 0.2
#: Factorisations one named material may take.
_BUDGET = 20


@dataclass(frozen=True)
class Verdict:
    """Whether a named material holds the target, with the friction of the scene.

    factor  as in `Softest`, not taken beyond 1; below 1, 1 / factor times stiffer (or lighter) was solved
    failed, reason  as in `Softest`
    status  SOLVED with a certificate of its own, TOO_SOFT, ITERATION_LIMIT when nothing was solved however
            stiff, or what the certificate says
    """

    sheet: Sheet
    stretch: float
    bend: float
    status: Status
    factor: float
    failed: float | None
    reason: str

    @property
    def record(self) -> dict[str, Any]:
        """The same for programs."""
        return {
            "name": self.sheet.name,
            "density": self.sheet.density,
            "membrane": self.sheet.membrane,
            "rigidity": self.sheet.rigidity,
            "skin_friction": list(self.sheet.friction),
            "stretch": self.stretch,
            "bend": self.bend,
            "status": str(self.status),
            "factor": self.factor,
            "failed": self.failed,
            "reason": self.reason,
        }


@dataclass
class Findings:
    """All the command knows; filled as it goes on."""

    range: MaterialRange = field(default_factory=MaterialRange)
    verdicts: list[Verdict] = field(default_factory=list)
    calibration: Calibration | None = None
    interrupted: bool = False
    seconds: float = 0.0


def explore(scene: Scene, progress: Progress | None = None) -> Findings:
    """Range and named materials of a scene; an interrupt ends it with what it has."""
    found, begin = Findings(), time.perf_counter()
    try:
        found.calibration = calibrate(scene.target)
        material_range(scene.problem, progress, found.range)
        for sheet in SHEETS:
            found.verdicts.append(judge(scene, sheet, found, progress))
    except KeyboardInterrupt:
        found.interrupted = True
    found.seconds = time.perf_counter() - begin
    return found


def judge(scene: Scene, sheet: Sheet, found: Findings, progress: Progress | None = None) -> Verdict:
    """Solve one named material, or find how far from it one has to go.

    Contact forces are those of the range; the first load tried is guessed from how soft the scene's own
    material may be, for its weight.
    """
    fit = found.calibration or calibrate(scene.target)
    stretch, bend = fit.stretch * sheet.membrane, fit.bend * sheet.rigidity
    made = replace(scene, material=Material(sheet.density, stretch, bend, scene.material.friction))
    problem, results = made.problem, []
    rest, pose = problem.target.vertices.copy(), problem.target.vertices
    forces = np.zeros((len(problem.contacts), 3))

    def report(step: Step) -> None:
        if progress is not None:
            progress(sheet.name, step)

    for number, piece in enumerate(split(problem)):
        search = SoftestSearch(piece, report, budget=_BUDGET)
        start = found.range.starts[number] if number < len(found.range.starts) else None
        if start is None:
            result = search.run(ceiling=1.0)
        else:
            # Loads scale with the density: what was balanced for the scene is so for the sheet.
            ratio = piece.f0 / found.range.pieces[number].f0
            guess = _guess(scene, sheet, bend, found.range)
            loads = [guess * 3.0**-k for k in range(6)]
            first = search.first(start.forces * ratio, loads)
            again = 1 if guess >= _NEAR else 0
            result = (
                search.run(first, 1.0, again)
                if first
                else Softest(0.0, loads[-1], "no equilibrium")
            )
        results.append(result)
        if result.held is not None and result.factor >= 1.0:
            held = result.held
            outcome = judged(piece, held.point.rest, held.forces, sheet.name)
            rest[piece.vertices] = outcome.rest + piece.origin
            forces[np.isin(problem.contacts.vertices, piece.vertices)] = outcome.contact_forces
    worst = min(results, key=lambda one: one.factor)
    status = Status.TOO_SOFT if worst.factor > 0.0 else Status.ITERATION_LIMIT
    if worst.factor >= 1.0:
        mean_edge = float(problem.target.mean_edge_length)
        certificate, _ = certify(
            *(problem.energies, pose, pose, rest, problem.contacts, forces),
            *(np.asarray(problem.pinned), mean_edge),
        )
        status = status_of(certificate)
    return Verdict(sheet, stretch, bend, status, worst.factor, worst.failed, worst.reason)


def _guess(scene: Scene, sheet: Sheet, bend: float, known: MaterialRange) -> float:
    """Load to try first: by weight for bending stiffness, compared with the softest known."""
    own = float(np.mean(scene.material.bend)) / float(np.mean(scene.material.density))
    soft = known.alone.get("bend") or known.together
    factor = soft.factor if soft is not None else 1.0
    if own <= 0.0:
        return 1.0
    return min(1.0, 0.7 * factor * (bend / sheet.density) / own)


def run_materials(options: SceneOptions, *, repair: bool, quiet: bool, as_json: bool) -> int:
    """The whole command; the exit code: 0 when something holds the target."""
    from casashell.app.materials_table import lines_of, record_of

    with reading_input(mended=repair):
        scene = options.spec().load(repair=repair)
        contacts = describe(scene.problem.contacts, scene.obstacles)
        calibrate(scene.target)
    reporter = Reporter(quiet=quiet or as_json)
    reporter.scene(scene, contacts)
    with _live(reporter) as progress:
        found = explore(scene, progress)
    if as_json:
        print(json.dumps(record_of(found), indent=1, allow_nan=False))
    else:
        for line in lines_of(scene, found):
            reporter.line(line)
    if found.interrupted:
        complain("interrupted: what is above was solved before that")
        return INTERRUPTED
    some = found.range.holds or any(each.status is Status.SOLVED for each in found.verdicts)
    return 0 if some else FAILURE


@contextmanager
def _live(reporter: Reporter) -> Iterator[Progress | None]:
    """The live line, with what is being searched in front."""
    with reporter.live() as callback:
        if callback is None:
            yield None
            return
        show: Callable[[Step], None] = callback
        yield lambda name, step: show(replace(step, stage=f"{name}: {step.stage}"))
