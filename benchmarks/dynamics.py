"""Simulation: seconds a step, with a natural shape that holds and without, and on a body that turns.

Processor seconds of one thread, for the machine may be busy; the first frames, in which most moves.
`contacts` counts vertices that an obstacle pushes, at most.  The last column is the time in units of
the calibration kernel.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.programs import DATA, calibration
from benchmarks.scaling import resized
from benchmarks.timing import Goal
from casashell.app.paper_scenes import PAPER
from casashell.contact.mesh_obstacle import MeshObstacle
from casashell.contact.obstacles import Plane
from casashell.dynamics.motion import RigidMotion
from casashell.dynamics.newton import Solved, StepSolver
from casashell.dynamics.references import solve_step
from casashell.dynamics.simulate import simulate
from casashell.dynamics.simulation import Simulation
from casashell.dynamics.touch import Touches
from casashell.engine.threads import one_thread
from casashell.inverse.certificate import no_certificate
from casashell.mesh import TriMesh
from casashell.problem import Problem
from casashell.result import Quality, Result
from casashell.solving import solve
from casashell.status import Status
from casashell.typing import FloatArray
from formulations import discrete_shell

HEAD = "| scene | vertices | contacts | steps | iterations a step | factors a step | ms a step | / kernel |"
FPS, FRAMES = 60.0, 12


@dataclass(frozen=True)
class Timed:
    """What a run took: processor seconds a step, contacts at most, and the run."""

    seconds: float
    contacts: int
    run: Simulation

    def row(self, name: str, kernel: float) -> str:
        """Line of the table."""
        run, steps = self.run, max(int(self.run.steps.sum()), 1)
        cells = [
            f"{name} ({run.status})",
            str(run.positions.shape[1]),
            str(self.contacts),
            str(steps),
        ]
        cells += [f"{run.iterations / steps:.1f}", f"{run.factorizations / steps:.1f}"]
        cells += [f"{1e3 * self.seconds:.1f}", f"{self.seconds / kernel:.2f}"]
        return "| " + " | ".join(cells) + " |"


def timed(
    result: Result, rest: str, motion: RigidMotion | None = None, frames: int = FRAMES
) -> Timed:
    """One simulation, everything before its first frame left out."""
    marks: list[float] = []
    with one_thread():
        run = simulate(
            result,
            frames / FPS,
            fps=FPS,
            rest=rest,
            motion=motion,
            callback=lambda frame: marks.append(time.process_time()),
        )
    taken = (marks[-1] - marks[0]) / max(int(run.steps.sum()), 1)
    return Timed(taken, int(run.contact.sum(axis=1).max()), run)


def turning(axis: tuple[float, float, float]) -> RigidMotion:
    """Half a radian in a second, at full speed from the start."""
    return RigidMotion(np.array([0.0, 1.0]), rotation=[[0.0, 0.0, 0.0], list(0.5 * np.array(axis))])


def tablecloth(rows: int = 50) -> Result:
    """A square cloth, its middle on a table and its rim bent up; not solved for."""
    line = np.linspace(-0.5, 0.5, rows)
    x, y = (part.ravel() for part in np.meshgrid(line, line, indexing="ij"))
    beyond = np.clip(np.maximum(np.abs(x), np.abs(y)) - 0.3, 0.0, None)
    k = np.arange(rows * rows).reshape(rows, rows)
    a, b, c, d = (part.ravel() for part in (k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    mesh = TriMesh(np.stack([x, y, 1.5 * beyond**2], axis=1), faces)
    terms = discrete_shell(mesh, density=0.2, stretch=20.0, bend=1e-3)
    table = Plane((0.0, 0.0, 1.0), 0.0, friction=0.4, name="table")
    return unsolved(Problem(mesh, terms, (table,), contact_tolerance=1e-6))


def unsolved(problem: Problem) -> Result:
    """The target as a result, for runs without inversion."""
    x = np.array(problem.target.vertices)
    return Result(
        status=Status.ITERATION_LIMIT,
        advice="",
        method="none",
        target=problem.target,
        rest=x,
        pose=x,
        contacts=problem.contacts,
        pinned=np.asarray(problem.pinned),
        contact_forces=np.zeros((len(problem.contacts), 3)),
        forces=np.zeros_like(x),
        material={},
        certificate=no_certificate(problem.target),
        quality=Quality(0.0, 0.0, 1.0, 0, 0),
        obstacles=problem.obstacles,
        contact_tolerance=problem.tolerance,
        energies=problem.energies,
    )


def top() -> Result:
    """The top of the data folder on its body."""
    folder = DATA / "top_avatar"
    from casashell.io.meshes import read_mesh

    target, body = (read_mesh(folder / f"{name}.obj", unit=0.1) for name in ("shell", "obstacle"))
    terms = discrete_shell(target, density=0.2, stretch=20.0, bend=1e-3, gravity=(0.0, -9.81, 0.0))
    obstacle = MeshObstacle(body, friction=0.5)
    return solve(Problem(target, terms, (obstacle,), contact_tolerance=3.3e-3))


def _part(
    name: str, result: Result, axis: tuple[float, float, float], limit: float, kernel: float
) -> tuple[list[Goal], list[str]]:
    """Hold, naive and moving of one scene."""
    kinds: dict[str, Callable[[], Timed]] = {
        "holds": lambda: timed(result, "natural"),
        "without inversion": lambda: timed(result, "target"),
        "body turns": lambda: timed(result, "natural", turning(axis)),
    }
    goals, lines = [], []
    for kind, make in kinds.items():
        made = make()
        lines.append(made.row(f"{name}, {kind}", kernel))
        print(lines[-1], flush=True)
        goals.append(Goal(f"a step of {name}, {kind}", made.seconds, limit, "s"))
    return goals, lines


def compared(result: Result, frames: int = 6) -> list[str]:
    """The three contact solvers on the steps of one run without inversion."""
    spent: dict[str, list[tuple[float, int, float, bool]]] = {}
    newton = StepSolver.solve

    class Compare(StepSolver):
        """Solves every step three times; goes on from the first."""

        def solve(
            self, touches: Touches, d: FloatArray, f: FloatArray, h: float, *, energy: bool = False
        ) -> Solved:
            kept = None
            for name in ("Newton", "sweeps", "conic"):
                begin = time.process_time()
                if name == "Newton":
                    made = newton(self, touches, d, f, h, energy=energy)
                else:
                    made = solve_step(
                        self, touches, d, f, "sweeps" if name == "sweeps" else "conic", 12
                    )
                row = (time.process_time() - begin, made.iterations, made.residual, made.converged)
                spent.setdefault(name, []).append((*row[:2], row[2] / self.weight, row[3]))
                kept = kept or made
            if kept is None:
                raise RuntimeError("no solver ran")
            return kept

    StepSolver.solve = Compare.solve  # type: ignore[method-assign]
    try:
        timed(result, "target", frames=frames)
    finally:
        StepSolver.solve = newton  # type: ignore[method-assign]
    lines = ["| solver | steps | converged | ms a step | iterations | worst residual / weight |"]
    lines.append("|" + "---|" * 6)
    for name, rows in spent.items():
        seconds, count, residual, done = (np.array(column, dtype=float) for column in zip(*rows))
        cells = [name, str(len(rows)), f"{int(done.sum())}", f"{1e3 * seconds.mean():.0f}"]
        cells += [f"{count.mean():.1f}", f"{residual.max():.0e}"]
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def memory(steps: int = 10_000) -> tuple[float, float]:
    """Resident memory [MB] of this process a tenth of the way and at the end of many steps."""
    result = tablecloth(6)
    marks: list[float] = []

    def mark(number: int) -> None:
        if number in (steps // 10, steps):
            text = Path("/proc/self/status").read_text()
            found = next(line for line in text.splitlines() if line.startswith("VmRSS"))
            marks.append(float(found.split()[1]) / 1024)

    with one_thread():
        simulate(
            result,
            steps / 1000.0,
            fps=50.0,
            substeps=20,
            callback=lambda frame: mark(20 * frame.number),
        )
    return marks[0], marks[1]


def run() -> tuple[list[Goal], str]:
    """Goals and Markdown tables."""
    kernel = calibration()
    lines = [f"Calibration kernel: {1e3 * kernel:.1f} ms.", "", HEAD, "|" + "---|" * 8]
    skirt = solve(PAPER["synthetic-skirt"]().problem)
    goals, rows = _part("skirt", skirt, (0.0, 1.0, 0.0), 0.03, kernel)
    lines += rows
    if DATA.is_dir():
        more, rows = _part("top", top(), (0.0, 1.0, 0.0), 0.15, kernel)
        goals, lines = goals + more, lines + rows
    large = solve(resized(28, 92).problem)
    still = timed(large, "natural")
    lines.append(still.row("skirt 28 x 92, holds", kernel))
    cloth = tablecloth()
    sizes = [timed(tablecloth(n), "target", frames=8) for n in (12, 24)]
    sizes.append(timed(cloth, "target", frames=8))
    turned = timed(cloth, "target", turning((0.0, 0.0, 1.0)), 4)
    lines += [sizes[-1].row("tablecloth, without inversion", kernel)]
    lines += [turned.row("tablecloth, table turns", kernel)]
    goals += [
        Goal("a step of skirt 28 x 92, holds", still.seconds, 0.6, "s"),
        Goal("a step of tablecloth, without inversion", sizes[-1].seconds, 0.6, "s"),
        Goal("a step of tablecloth, table turns", turned.seconds, 0.6, "s"),
    ]
    lines += [made.row("tablecloth, growth", kernel) for made in sizes[:-1]]
    counts = [np.log(made.run.positions.shape[1]) for made in sizes]
    slope = np.polyfit(counts, np.log([made.seconds for made in sizes]), 1)[0]
    touched = [np.log(made.contacts) for made in sizes]
    slope_c = np.polyfit(touched, np.log([made.seconds for made in sizes]), 1)[0]
    lines += ["", f"Growth of the tablecloth's step: V^{slope:.2f}, contacts^{slope_c:.2f}.", ""]
    lines += ["The skirt's first steps without inversion by each of the contact solvers:", ""]
    lines += compared(skirt)
    early, late = memory()
    lines += ["", f"Memory after 1000 and 10 000 steps: {early:.1f} and {late:.1f} MB."]
    goals.append(Goal("memory gained from step 1000 to 10 000", late - early, 5.0, "MB"))
    return goals, "\n".join(lines)
