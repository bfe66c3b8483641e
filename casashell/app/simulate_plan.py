"""What `casashell simulate` is told, read and checked: result, scene, wind, motions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from casashell.app.motion_files import read_motions
from casashell.app.scene import Scene
from casashell.app.scene_reader import read_scene
from casashell.app.simulate_options import SimulateOptions
from casashell.dynamics.motion import MeshSequence, RigidMotion
from casashell.dynamics.system import Damping
from casashell.inverse.certificate import scale_of_forces, total_forces
from casashell.io.results import load_result
from casashell.result import Result
from formulations.wind import FaceWind

#: Forces of the scene that differ from those of the result by this share of their scale are others.
_SAME_FORCES: Final = 1e-6
_FROM_PYTHON: Final = (
    "which files do not keep: simulate it from Python, "
    "casashell.simulate(result, seconds, problem=problem)"
)


@dataclass(frozen=True, eq=False)
class Plan:
    """What a simulation is made of, in SI."""

    options: SimulateOptions
    result: Result
    scene: Scene
    wind: FaceWind | None
    motions: Mapping[int, RigidMotion | MeshSequence]
    damping: Damping

    @property
    def natural(self) -> bool:
        return self.options.rest == "natural"


def read_plan(options: SimulateOptions) -> Plan:
    """Read and check everything.

    Raises ValueError naming option, file or obstacle, OSError for a file that cannot be opened.
    """
    options.check()
    folder = options.folder
    result = load_result(folder)
    if not (folder / "scene.toml").is_file():
        raise ValueError(f"{folder} holds no scene: scene.toml is missing")
    spec = read_scene(folder / "scene.toml")
    if any(source.table.get("kind") == "custom" for source in spec.obstacles):
        raise ValueError(f"{folder} has an obstacle of a class of its own, {_FROM_PYTHON}")
    scene = replace(spec.load(), target=result.target)
    _check_physics(result, scene, folder)
    rate = options.sequence_fps or options.fps
    paths = (options.sequences, options.keyframes)
    motions = read_motions(*paths, scene.obstacles, unit=scene.unit, fps=rate)
    return Plan(options, result, scene, options.air.read(), motions, options.read_damping())


def _check_physics(result: Result, scene: Scene, folder: Path) -> None:
    """ValueError when the scene file cannot tell what the result was solved for.

    A result of energies of the user's own is saved without them; its forces at the pose give it away.
    """
    own = f"{folder} was solved with energies of its own, {_FROM_PYTHON}"
    if any(key not in result.material for key in ("density", "stretch", "bend")):
        raise ValueError(own)
    shapes = (result.pose, result.rest, result.forces)
    if result.natural == "metric" or not all(np.isfinite(shape).all() for shape in shapes):
        return
    energies = scene.problem.energies
    forces = total_forces(energies, result.pose, result.rest)
    scale = scale_of_forces(energies, result.target.vertices) + float(np.abs(result.forces).max())
    if float(np.abs(forces - result.forces).max()) > _SAME_FORCES * scale:
        raise ValueError(own)


def settings(plan: Plan) -> dict[str, Any]:
    """What a reader of the record wants to know of the run; SI."""
    options, wind = plan.options, plan.wind
    air = None
    if wind is not None:
        keys = ("air", "drag", "lift", "gust", "period", "seed", "onset")
        air = {"velocity": list(wind.velocity)} | {key: getattr(wind, key) for key in keys}
    return {
        "result": str(options.folder),
        "result_status": str(plan.result.status),
        "rest": options.rest,
        "seconds": options.seconds,
        "fps": options.fps,
        "substeps": options.substeps,
        "wind": air,
        "damping": {"mass": plan.damping.mass, "stiffness": plan.damping.stiffness},
        "obstacle_sequences": list(options.sequences),
        "keyframes": list(options.keyframes),
    }


def summary(plan: Plan) -> list[tuple[str, str]]:
    """Label and text of what the options say."""
    options, wind = plan.options, plan.wind
    steps = f", {options.substeps} steps a frame" if options.substeps > 1 else ""
    shape = "that of the result" if plan.natural else "the design itself, no inversion"
    lines = [
        ("Time", f"{options.seconds:g} s at {options.fps:g} frames a second{steps}"),
        ("Natural", shape),
    ]
    if wind is not None:
        x, y, z = wind.velocity
        gusts = f", gusts {wind.gust:g} of it every {wind.period:g} s, seed {wind.seed}"
        lines.append(
            (
                "Wind",
                f"({x:g}, {y:g}, {z:g}) m/s{gusts if wind.gust else ''}; air {wind.air:g} kg/m3, "
                f"drag {wind.drag:g}, lift {wind.lift:g}",
            )
        )
    if plan.damping != Damping():
        damping = plan.damping
        lines.append(("Damping", f"mass {damping.mass:g} 1/s, stiffness {damping.stiffness:g} s"))
    for number, motion in plan.motions.items():
        keys = isinstance(motion, RigidMotion)
        what = f"{len(motion.times)} {'keyframes' if keys else 'meshes'}"
        name = plan.scene.obstacles[number].name or f"obstacle {number}"
        lines.append(("Motion", f"{name}: {what}, {motion.times[0]:g} to {motion.times[-1]:g} s"))
    return lines


def remarks(plan: Plan) -> list[str]:
    """What may surprise."""
    found = []
    for number, motion in plan.motions.items():
        if not isinstance(motion, RigidMotion):
            continue
        turn, shift = motion.at(0.0)
        if np.abs(turn - np.eye(3)).max() > 1e-12 or np.abs(shift).max() > 0.0:
            name = plan.scene.obstacles[number].name or f"obstacle {number}"
            found.append(f"at 0 s the keyframes have {name} elsewhere than the scene")
    return found
