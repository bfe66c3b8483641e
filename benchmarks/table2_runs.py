"""One inversion in a process of its own: scenes and methods by name, numbers and curves to a file."""

from __future__ import annotations

import _thread
import json
import os
import subprocess
import sys
import threading
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from benchmarks.programs import DATA
from benchmarks.recording import Recorder, StepClocks, Yardstick
from benchmarks.scaling import _peak_memory
from casashell.inverse.methods import StepTwoMethod
from casashell.problem import Problem
from casashell.result import Result
from casashell.typing import FloatArray

if TYPE_CHECKING:
    from casashell.app.scene import Scene

#: Folder of a real garment: metres per unit of its files, contact tolerance in that unit.
GARMENTS: Final = {"hat_on_sphere": (0.1, 0.039), "skirt_8panel_smpl": (1.0, 0.0045)}
#: Scenes with another material: which scene, and by what its stretch and bend are divided.
SOFTER: Final = {
    f"{scene}, {factor} x softer": (scene, factor)
    for scene, factor in (
        ("synthetic-skirt", 3),
        ("skirt_8panel_smpl", 3),
        ("skirt_8panel_smpl", 10),
    )
}


@dataclass(frozen=True)
class Way:
    """A method as `solve` takes it."""

    method: str
    step2: StepTwoMethod = "ipopt"
    preset: str = "scaled"


WAYS: Final[Mapping[str, Way]] = {
    "two-step ipopt": Way("two-step", "ipopt"),
    "two-step bfgs": Way("two-step", "bfgs"),
    "direct": Way("direct"),
    "nlp": Way("nlp"),
    "free-pose": Way("free-pose"),
    "paper preset, ipopt": Way("two-step", "ipopt", "paper"),
    "paper preset, bfgs": Way("two-step", "bfgs", "paper"),
}


@dataclass(frozen=True, eq=False)
class Run:
    """What was measured of one inversion.

    numbers  by name; None where a certificate has none
    rest     (V,3) m, natural shape
    curve    (n,4) seconds, free force / f0, cone violation / f0, distance / bounding box
    """

    numbers: Mapping[str, Any]
    rest: FloatArray
    curve: FloatArray

    @property
    def finished(self) -> bool:
        """Whether the solver ended by itself."""
        return not self.numbers["interrupted"]

    def save(self, file: Path) -> None:
        """Write a .npz."""
        np.savez(file, numbers=json.dumps(dict(self.numbers)), rest=self.rest, curve=self.curve)

    @staticmethod
    def load(file: Path) -> Run:
        """Read what `save` wrote."""
        with np.load(file) as stored:
            return Run(json.loads(str(stored["numbers"])), stored["rest"], stored["curve"])


#: By scene and way; None for a process that had to be killed.
Runs = dict[tuple[str, str], Run | None]


def scene_names() -> list[str]:
    """The paper's five and the real garments that are there."""
    from casashell.app.paper_scenes import PAPER

    return [*PAPER, *(name for name in GARMENTS if (DATA / name).is_dir())]


def problem_of(name: str) -> Problem:
    """Scene by name, those of `SOFTER` included.

    Garments in the default material of the command line, +y up.
    """
    from casashell.app.paper_scenes import PAPER

    base, factor = SOFTER.get(name, (name, 1))
    scene = PAPER[base]() if base in PAPER else _garment(base)
    material = scene.material
    softer = replace(material, stretch=material.stretch / factor, bend=material.bend / factor)
    return replace(scene, material=softer).problem


def _garment(name: str) -> Scene:
    from casashell.app.scene import Scene
    from casashell.contact.mesh_obstacle import MeshObstacle
    from casashell.io.meshes import read_mesh

    unit, tolerance = GARMENTS[name]
    shell = read_mesh(DATA / name / "shell.obj", unit=unit)
    body = MeshObstacle(read_mesh(DATA / name / "obstacle.obj", unit=unit), friction=0.5)
    return Scene(name, shell, (body,), tolerance=tolerance * unit)


def warm_up() -> None:
    """Every method once on a small skirt, so that no kernel is left to compile."""
    from casashell.app.builtin import skirt
    from casashell.solving import solve

    for way in WAYS.values():
        if way.preset == "scaled":
            solve(skirt(6, 20).problem, way.method, step2=way.step2)


def measure(scene: str, way: str, limit: float, file: str) -> None:
    """Solve in this process, for ``limit`` seconds at the most, and write a `Run` to ``file``."""
    from casashell.solving import solve

    problem, chosen, recorder = problem_of(scene), WAYS[way], Recorder()
    load = os.getloadavg()[0]
    alarm = threading.Timer(limit, _thread.interrupt_main)
    alarm.daemon = True
    alarm.start()
    with StepClocks() as clocks:
        result = solve(
            problem, chosen.method, step2=chosen.step2, preset=chosen.preset, callback=recorder
        )
    fired = alarm.finished.is_set()
    alarm.cancel()
    memory = _peak_memory()
    stick = Yardstick(problem)
    rows = [(each.seconds, *stick.errors(each.rest, each.pose)) for each in recorder.iterates]
    solved = sum(result.timings.get(part, 0.0) for part in ("contacts", "kernels", "solve"))
    spent = min(limit, result.seconds) if fired else solved
    rows.append((spent, *stick.errors(result.rest, result.pose)))
    numbers = {
        **_numbers(result, stick),
        "interrupted": fired,
        "memory": memory,
        "load": load,
        "passes": clocks.one.calls,
        "seconds_one": clocks.one.seconds,
        "seconds_two": clocks.two.seconds,
        "iterations_one": clocks.one.iterations,
        "iterations_two": clocks.two.iterations,
    }
    Run(numbers, result.rest, np.array(rows)).save(Path(file))


def _numbers(result: Result, stick: Yardstick) -> dict[str, Any]:
    certificate, quality = result.certificate, result.quality
    rest, pose = result.rest, result.pose
    return {
        "vertices": len(rest),
        "contacts": len(result.contacts),
        "status": str(result.status),
        "certified": result.status.certified,
        "seconds": result.seconds,
        "iterations": result.iterations,
        "J": stick.distance(pose),
        "G": stick.cone_residual(rest, pose),
        "G_true": stick.cone_residual(rest, pose, beta=1.0),
        "G_newtons": stick.cone_residual_in_newtons(rest, pose),
        "floor": stick.rounding_floor(rest, pose),
        "energy": stick.elastic_energy(rest, pose),
        "free_force": certificate.free_force,
        "cone_margin": certificate.cone_margin,
        "min_normal_force": certificate.min_normal_force,
        "eigenvalue": certificate.min_eigenvalue,
        "target_distance": certificate.target_distance,
        "max_stretch": quality.max_stretch,
        "max_fold": quality.max_rest_fold,
        "h": result.target.mean_edge_length,
        "size": result.target.bbox_diagonal,
        "notes": list(result.notes),
    }


def run(scene: str, way: str, limit: float, file: Path) -> Run | None:
    """`measure` in a process of its own; None when it had to be killed.  Raises when it fails."""
    arguments = f"{scene!r}, {way!r}, {limit}, {str(file)!r}"
    code = f"from benchmarks.table2_runs import measure; measure({arguments})"
    try:
        done = subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            text=True,
            check=False,
            timeout=limit + 120.0,
        )
    except subprocess.TimeoutExpired:
        return None
    if done.returncode != 0:
        raise RuntimeError(f"{scene}, {way}: exit {done.returncode}\n{done.stderr}")
    return Run.load(file)
