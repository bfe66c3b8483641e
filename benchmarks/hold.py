"""Does a solved target stay where it is?

Every scene is solved and simulated from its target: for 10 s at 60 frames a second with the natural shape
that was found, and for 2 s, or as long as 100 s of processor time allow, with the target as natural shape,
as without inversion.  Drift is in diagonals of the bounding box; less than 1e-15 counts as 1e-15 where it
divides.  Scenes: those made by formula, the nine of Ly 2018 with the materials of its Table 1, and real
garments with the default material.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.garments import GARMENTS
from benchmarks.programs import DATA
from benchmarks.timing import Goal
from casashell.app.builtin import hat, page, skirt
from casashell.app.resimulation_scenes import examples
from casashell.app.scene import Material, Scene
from casashell.contact.mesh_obstacle import MeshObstacle
from casashell.dynamics.simulate import simulate
from casashell.dynamics.simulation import Frame, Simulation
from casashell.engine.threads import one_thread
from casashell.io.meshes import read_mesh
from casashell.result import Result
from casashell.solving import solve

SECONDS, NAIVE, FPS = 10.0, 2.0, 60.0
#: Seconds of processor time after which a simulation is ended; what it moved until then counts.
PATIENCE = 100.0
#: Rounding of positions, in the size of the shell: no drift is taken for smaller.
ROUNDING = 1e-15
METRES = {"m": 1.0, "dm": 0.1}
HEAD = (
    "| scene | vertices | contacts | drift in 10 s | m/s, last second | s a step | "
    "rest = target: drift | in | times as far | |"
)


@dataclass(frozen=True)
class Held:
    """One scene: drift in the size of its shell, contact speed [m/s], seconds a step."""

    name: str
    vertices: int
    contacts: int
    drift: float
    speed: float
    step: float
    naive: float
    lasted: float
    ended: str

    @property
    def ratio(self) -> float:
        """How many times as far the shell moves without inversion."""
        return self.naive / max(self.drift, ROUNDING)

    @property
    def met(self) -> bool:
        """Whether it held, all 10 s of it."""
        return self.ended == "" and self.drift < 1e-6 and self.speed < 1e-9 and self.ratio >= 1e3

    def row(self) -> str:
        """Line of the table."""
        return (
            f"| {self.name} | {self.vertices} | {self.contacts} | {self.drift:.1e} | "
            f"{self.speed:.1e} | {self.step:.3f} | {self.naive:.1e} | {self.lasted:.2g} s | "
            f"{self.ratio:.0e} | {'met' if self.met else 'MISSED ' + self.ended} |"
        )


def held(name: str, result: Result, patience: float = PATIENCE) -> Held:
    """Both simulations of one solved scene."""
    ours = _played(result, SECONDS, "natural", patience)
    naive = _played(result, NAIVE, "target", patience)
    touching = ours.velocities[ours.times > ours.times[-1] - 1.0][:, result.contacts.vertices]
    speed = float(np.linalg.norm(touching, axis=2).max(initial=0.0))
    short = ours.times[-1] < SECONDS - 0.5 / FPS
    return Held(
        name=name,
        vertices=len(result.target.vertices),
        contacts=len(result.contacts),
        drift=float(ours.drift.max()),
        speed=speed,
        step=ours.seconds / max(int(ours.steps.sum()), 1),
        naive=float(naive.drift.max()),
        lasted=float(naive.times[-1]),
        ended=f"after {ours.times[-1]:.2g} s: {ours.status}" if short else "",
    )


def _played(result: Result, seconds: float, rest: str, patience: float) -> Simulation:
    """The simulation, ended between two frames when it takes longer than ``patience`` [s]."""
    began = time.process_time()

    def watch(_: Frame) -> None:
        if time.process_time() - began > patience:
            raise KeyboardInterrupt

    with one_thread():
        return simulate(result, seconds, fps=FPS, rest=rest, callback=watch)


def _worn(folder: Path, unit: float, tolerance: float) -> Scene:
    """A real pair with friction 0.5 and the default material."""
    shell = read_mesh(folder / "shell.obj", unit=unit)
    body = MeshObstacle(read_mesh(folder / "obstacle.obj", unit=unit), friction=0.5, name="body")
    return Scene(folder.name, shell, (body,), Material(), tolerance=tolerance * unit)


def scenes(data: Path) -> tuple[dict[str, Callable[[], Scene]], list[str]]:
    """How every scene is made, by name, and a line on each that is skipped."""
    made: dict[str, Callable[[], Scene]] = {"hat": hat, "skirt": skirt, "page": page}
    named, skipped = examples(data)
    made |= {f"{example.title} (Table 1)": example.make for example in named}
    for name, unit, tolerance in GARMENTS:
        if (data / name / "shell.obj").is_file():
            made[name] = partial(_worn, data / name, METRES[unit], float(tolerance))
        else:
            skipped.append(f"{name}: not in {data}")
    return made, skipped


def run(data: Path = DATA, only: str = "") -> tuple[list[Goal], str]:
    """Hold every scene with ``only`` in its name; goals and a Markdown table."""
    made, notes = scenes(data)
    rows = [HEAD, "|" + "---|" * 10]
    found = []
    for line in _held(made, only, notes):
        found.append(line)
        rows.append(line.row())
        print(rows[-1], flush=True)
    goals = [
        Goal("largest drift", max(one.drift for one in found), 1e-6, "of the size"),
        Goal("largest contact speed", max(one.speed for one in found), 1e-9, "m/s"),
        Goal("rest = target, least ratio", min(one.ratio for one in found), 1e3, "", False),
        Goal("scenes that did not hold", sum(not one.met for one in found), 0, ""),
    ]
    return goals, "\n".join([*rows, "", *(f"- {note}" for note in notes)])


def _held(made: dict[str, Callable[[], Scene]], only: str, notes: list[str]) -> Iterator[Held]:
    """Every scene that could be solved; the others go to ``notes``."""
    for name, make in made.items():
        if only not in name:
            continue
        result = solve(make().problem, "direct")
        if result.status.certified:
            yield held(name, result)
        else:
            notes.append(f"{name}: {result.status}. {result.advice}")
