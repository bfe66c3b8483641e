"""Ribbons: Table I of Pan 2016, error against time, gradients, seconds a step, Moebius bands.

Every scene is one of `casashell ribbon NAME` or of a figure; a run is cut after 15 s of wall time.
The paper's sizes are not known, so that its seconds are not repeated here.  Ratios, of processor time,
are to the calibration kernel of `benchmarks.programs`, timed in the same run.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from benchmarks import ribbon_fem as fem
from benchmarks.programs import calibration
from benchmarks.ribbons_accuracy import accuracy
from benchmarks.ribbons_gradients import gradients
from benchmarks.ribbons_moebius import moebius
from benchmarks.timing import Goal
from casashell.app.ribbon_scenes import builtin_setup
from casashell.app.ribbon_shapes import waved, wound
from casashell.ribbon import Body, Guide, Ribbon, RibbonSimulation, Rule, Scene, simulate
from casashell.typing import FloatArray
from formulations import ribbon_physics

#: Seconds after which a run is cut.
PATIENCE = 15.0
HEAD = (
    "| scene | segments | solver | step s | steps | s a step | most s | processor s | inner | outer "
    "| / kernel | |"
)
#: The compared torsion: length, width, stiffness, density, weight of the guide, step, steps.
SIZES, GUIDED, STEP, STEPS = (10.0, 1.0, 1.0, 0.1), 100.0, 0.05, 40
CELLS = (40, 4)


@dataclass(frozen=True)
class Case:
    """A scene of the table; ``solvers`` it is run with."""

    name: str
    build: Callable[[], tuple[Scene, float, float]]
    solvers: tuple[str, ...] = ("ipopt", "augmented")


def builtin(name: str, step: float | None = None) -> Callable[[], tuple[Scene, float, float]]:
    """Scene, seconds and step of a built-in scene."""

    def build() -> tuple[Scene, float, float]:
        setup = builtin_setup(name)
        return setup.scene, setup.seconds, step or setup.step

    return build


def wanted(t: float) -> FloatArray:
    """The guided normal of the compared torsion: half a turn in all."""
    angle = np.pi * t / (STEP * STEPS)
    return np.array([0.0, -np.sin(angle), np.cos(angle)])


def torsion() -> tuple[Scene, float, float]:
    """The ribbon of the compared torsion (Fig. 9)."""
    length, width, stiffness, density = SIZES
    strip = Ribbon(length, width, 20, stiffness=stiffness, density=density)
    body = Body(strip, waved(strip, 0.02, 2.5), guides=(Guide((19,), wanted, GUIDED),))
    return Scene((body,), ribbon_physics(), (0.0, 0.0, 0.0)), STEP * STEPS, STEP


def helix(step: float) -> Callable[[], tuple[Scene, float, float]]:
    """The slow helix of Fig. 8, with the resolution of the built-in one."""

    def build() -> tuple[Scene, float, float]:
        strip = Ribbon(10.0, 0.6, 40, stiffness=0.1, density=0.08)
        body = Body(strip, wound(strip, 1.0, 0.5))
        return Scene((body,), ribbon_physics(), (0.0, 0.0, 0.0)), 1.5, step

    return build


def goal_scene() -> tuple[Scene, float, float]:
    """A strip of paper with 30 segments that unrolls under its weight: the 0.1 s a step."""
    strip = Ribbon(0.5, 0.03, 30, stiffness=2.7e-4, density=0.08)
    return Scene((Body(strip, wound(strip, 0.05, 0.3)),), ribbon_physics()), 0.5, 0.01


CASES = (
    Case("extreme torsion", builtin("torsion")),
    Case("extreme dragging", builtin("dragging")),
    Case("torsion (ours)", torsion),
    Case("helix, h = 0.01", helix(0.01)),
    Case("helix, h = 0.05", helix(0.05)),
    Case("falling, 150 segments", builtin("falling"), ("ipopt",)),
    Case("double chain, 2 x 9", builtin("double-chain"), ("ipopt",)),
    Case("Moebius chain, 9", builtin("moebius-chain"), ("ipopt",)),
    Case("30 segments", goal_scene, ("ipopt",)),
)
#: Seconds a step that are promised, solver ipopt and consistent mass.
GOALS = {"30 segments": 0.1, "falling, 150 segments": 1.0, "Moebius chain, 9": 3.0}


def timed(scene: Scene, seconds: float, step: float, rule: Rule) -> RibbonSimulation:
    """The run, cut after `PATIENCE`."""
    begin = time.perf_counter()
    return simulate(
        scene,
        seconds,
        step,
        solver=rule.solver,
        callback=lambda _: time.perf_counter() - begin < PATIENCE,
    )


def row(case: Case, rule: Rule, kernel: float) -> tuple[str, float]:
    """Line of the table, and the median of the seconds a step without the first."""
    scene, seconds, step = case.build()
    begin = time.process_time()
    sim = timed(scene, seconds, step, rule)
    spent = time.process_time() - begin
    segments = sum(body.ribbon.segments for body in scene.bodies)
    made = len(sim.times) - 1
    cells = [case.name, str(segments), rule.solver, f"{step:g}", str(made)]
    if made < 2:
        return "| " + " | ".join([*cells, "", "", "", "", "", "", sim.message]) + " |", np.inf
    each, inner, outer = sim.seconds[2:], sim.inner[1:].mean(), sim.outer[1:].mean()
    cells += [f"{each.mean():.3f}", f"{each.max():.2f}", f"{spent / made:.3f}"]
    cells += [f"{inner:.1f}", f"{outer:.2f}"]
    note = "" if sim.status == "COMPLETE" else sim.message
    if sim.parts.max() > 1:
        note += f" {int((sim.parts > 1).sum())} steps in parts"
    cells += [f"{spent / made / kernel:.1f}", note.strip()]
    return "| " + " | ".join(cells) + " |", float(each.mean())


def elements(name: str, conforming: bool, kernel: float) -> str:
    """Line of the table: the compared torsion by finite elements."""
    length, width, stiffness, density = SIZES
    flat = fem.strip(length, width, *CELLS, stiffness, density, begin=fem.still)
    patch = replace(flat, guides=(fem.Guide(fem.last_column(flat), wanted, GUIDED),))
    body = fem.conforming(patch) if conforming else fem.nonconforming(patch)
    way = fem.ImplicitEuler(body)
    # Uneven like the ribbon: a flat sheet does not know which way to give.
    start = body.rest.copy()
    start[:, 2] += 0.02 * np.sin(0.5 * np.pi * np.maximum(start[:, 0], 0.0)) ** 2
    cells = [name, f"{CELLS[0]} x {CELLS[1]}", "Newton", f"{STEP:g}"]
    begin = time.process_time()
    try:
        film = fem.simulate(way, STEPS, STEP, start=way.begin(start))
    except fem.StepFailed as problem:
        return "| " + " | ".join([*cells, "", "", "", "", "", "", "", str(problem)]) + " |"
    spent = (time.process_time() - begin) / STEPS
    each, drift = film.seconds[1:], film.drawn.max(axis=0)
    cells += [str(STEPS), f"{each.mean():.3f}", f"{each.max():.2f}", f"{spent:.3f}"]
    cells += [f"{film.iterations.mean():.1f}", "", f"{spent / kernel:.1f}"]
    return "| " + " | ".join([*cells, f"lengths off by {drift[0]:.1e}"]) + " |"


def table(kernel: float) -> tuple[list[Goal], list[str]]:
    """Table I."""
    goals, lines = [], [HEAD, "|" + "---|" * 12]
    for case in CASES:
        for solver in case.solvers:
            rule = Rule("augmented" if solver == "augmented" else "ipopt")
            line, each = row(case, rule, kernel)
            lines.append(line)
            print(line, flush=True)
            if solver == "ipopt" and case.name in GOALS:
                goals.append(Goal(f"step of {case.name}", each, GOALS[case.name], "s"))
        if case.name == "torsion (ours)":
            lines.append(elements("torsion (C-FEM)", True, kernel))
            lines.append(elements("torsion (NC-FEM)", False, kernel))
            print(*lines[-2:], sep="\n", flush=True)
    return goals, lines


def run() -> tuple[list[Goal], str]:
    """Goals and Markdown."""
    kernel = calibration()
    goals, lines = table(kernel)
    more, cost = gradients()
    lines = [f"Calibration kernel: {1e3 * kernel:.1f} ms.", "", "## Table I", "", *lines]
    lines += ["", "## Error against time: heavy cantilever", "", *accuracy(kernel)]
    lines += ["", "## Gradient", "", *cost]
    lines += ["", "## Moebius bands over their width", "", *moebius()]
    return [*goals, *more], "\n".join(lines)
