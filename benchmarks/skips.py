"""What a scene does not need is left out: seconds of `solve` beside those of the nearest scene that does.

On the built-in skirt of 832 vertices, the hat, and the beret of Ly 2018.  Seconds are those of the
processor, the shortest of several runs, which other work on the machine disturbs least.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.timing import Goal
from casashell.app.builtin import hat, skirt
from casashell.app.paper_scenes import PAPER
from casashell.contact.obstacles import Obstacle
from casashell.engine import assembly
from casashell.inverse import load_path
from casashell.problem import Problem
from casashell.result import Result
from casashell.solving import solve

SIZE, REPEATS = (16, 52), 3
Call = Callable[[], Result]


@dataclass(frozen=True)
class Skip:
    """One row: a scene, what it does without, and the nearest scene that needs it."""

    scene: str
    skipped: str
    other: str
    lean: Call
    full: Call

    def measure(self) -> tuple[float, str]:
        """Ratio of the times of the two, and the row."""
        first, second = self.lean(), self.full()  # kernels are compiled by now
        lean, full = _shortest(self.lean, self.full)
        work = f"{first.factorizations} / {second.factorizations}"
        row = (
            f"| {self.scene} | {self.skipped} | {self.other} | {lean:.3f} | {full:.3f} | "
            f"{full / lean:.1f} | {work} | {first.status} / {second.status} |"
        )
        return lean / full, row


def _shortest(*calls: Call) -> list[float]:
    """Least processor time [s] of each call, taken in turns."""
    times = [np.inf] * len(calls)
    for _ in range(REPEATS):
        for n, call in enumerate(calls):
            begin = time.process_time()
            call()
            times[n] = min(times[n], time.process_time() - begin)
    return times


def _solved(problem: Problem, *, interpreted: bool = False) -> Call:
    problem.contacts  # noqa: B018  found once, before any clock runs
    return lambda: solve(problem, interpreted=interpreted)


def _smooth(obstacle: Obstacle) -> Obstacle:
    return replace(obstacle, friction=0.0)  # type: ignore[type-var]


def _waist() -> tuple[int, ...]:
    return tuple(range(SIZE[1]))


def _scenes() -> list[Skip]:
    """Scenes that do without weight, contacts, friction or unknowns; and with a compiler."""
    scene = skirt(*SIZE)
    whole = _solved(scene.problem)
    weightless = replace(scene, gravity=(0.0, 0.0, 0.0), pinned=_waist())
    hung = replace(scene, obstacles=(), pinned=_waist())
    rough = hat()
    smooth = replace(rough, obstacles=tuple(_smooth(o) for o in rough.obstacles))
    pinned = replace(scene, pinned=tuple(range(len(scene.target.vertices))))
    pinned_skirt = _solved(hung.problem)
    return [
        Skip(
            "no weight",
            "contact forces, Newton",
            "with weight",
            _solved(weightless.problem),
            pinned_skirt,
        ),
        Skip("pins only", "contact forces, cones", "waist on a cone", pinned_skirt, whole),
        Skip(
            "no friction (hat)",
            "cones: one unknown a contact",
            "hat, mu = 0.6",
            _solved(smooth.problem),
            _solved(rough.problem),
        ),
        Skip(
            "every vertex pinned",
            "everything but the certificate",
            "waist pinned",
            _solved(pinned.problem),
            pinned_skirt,
        ),
        Skip(
            "compiler",
            "interpreting kernels",
            "no C compiler",
            whole,
            _solved(scene.problem, interpreted=True),
        ),
    ]


def _again() -> list[Skip]:
    """The same mesh a second time: with its patterns, from its last answer."""

    def forgetting() -> Result:
        assembly.forget_layouts()
        load_path.forget_systems()
        return solve(problem)

    scene = skirt(*SIZE)
    problem = scene.problem
    rows = [
        Skip("same mesh again", "patterns", "first time", _solved(problem), forgetting),
    ]
    for name, before in (("skirt", scene), ("beret", PAPER["beret"]())):
        harder = replace(before.material, bend=1.2 * before.material.bend)
        after = replace(before, material=harder).problem
        earlier = solve(before.problem)
        warm = _started(after, earlier)
        rows.append(
            Skip(f"{name}, bend + 20 %, start", "the load path", "no start", warm, _solved(after))
        )
    same = skirt(*SIZE).problem
    rows.append(Skip("skirt, nothing new, start", "Newton", "no start", *_twice(same)))
    return rows


def _started(problem: Problem, earlier: Result) -> Call:
    problem.contacts  # noqa: B018
    return lambda: solve(problem, start=earlier)


def _twice(problem: Problem) -> tuple[Call, Call]:
    return _started(problem, solve(problem)), _solved(problem)


def run() -> tuple[list[Goal], str]:
    """Measure every row; goals and a Markdown table."""
    head = "| scene | left out | beside | s | beside s | times | factorisations | status |"
    lines, ratios = [head, "|" + "---|" * 8], {}
    for skip in [*_scenes(), *_again()]:
        ratios[skip.scene], row = skip.measure()
        lines.append(row)
    goals = [
        Goal("no weight against weight", ratios["no weight"], 0.8, ""),
        Goal("beret from its last answer", ratios["beret, bend + 20 %, start"], 0.8, ""),
        Goal("skirt from the same answer", ratios["skirt, nothing new, start"], 0.8, ""),
    ]
    return goals, "\n".join(lines)
