"""One stressed scene: how it is made, which statuses are allowed and why, and how it is judged."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from types import FrameType

import numpy as np

from benchmarks.stress.oracle import ANYTHING, CERTIFIED, SOFT, Expected, expected
from benchmarks.stress.physics import Shell
from benchmarks.stress.recheck import FREE_FORCE, complaints, scale
from benchmarks.stress.shapes import Setup
from casashell.problem import Problem
from casashell.result import Result
from casashell.solving import solve
from casashell.status import Status
from casashell.typing import FloatArray

#: Seconds a case may take; longer is a failure of its own.
TIME_LIMIT = 20.0


@dataclass(frozen=True)
class Twin:
    """Another scene with the same answer: ``back`` takes the natural shape of the case to it."""

    setup: Callable[[], Setup]
    back: Callable[[FloatArray], FloatArray]
    tolerance: float  # of the twin's bounding box diagonal


@dataclass(frozen=True)
class Case:
    """A scene of a family.

    value   the swept parameter, for the plot
    expect  allowed statuses and why, or a function of the problem that tells them beforehand
    """

    label: str
    value: float
    setup: Callable[[], Setup]
    expect: Expected | Callable[[Problem], Expected]
    twin: Twin | None = None


@dataclass(frozen=True)
class Row:
    """What became of a case; ``faults`` empty when everything is as theory says."""

    family: str
    label: str
    value: float
    status: str
    allowed: tuple[str, ...]
    because: str
    seconds: float
    vertices: int
    faults: tuple[str, ...]
    advice: str = ""


def stiff_side(problem: Problem) -> Expected:
    """For scenes at least as stiff as one in the linear regime: solved, unless rounding forbids."""
    shell, x = Shell.of(problem), problem.target.vertices
    f0 = scale(shell, x, np.zeros_like(x), np.zeros(len(x), bool))
    doubt = shell.rounding(x - x.mean(axis=0)) / f0
    if doubt <= 0.1 * FREE_FORCE:
        return Expected(CERTIFIED, "stiffer than a scene that linear theory solves")
    return Expected(SOFT | {Status.NONFINITE}, f"rounding makes forces of {doubt:.0e} f0")


def only(*statuses: Status, because: str) -> Expected:
    """Exactly these statuses."""
    return Expected(frozenset(statuses), because)


def soft(because: str = "softer than linear theory reaches; feasible when stiffer") -> Expected:
    """Any honest outcome but a proof of infeasibility, which would hold for stiff material too."""
    return Expected(SOFT | {Status.NONFINITE}, because)


def refused(because: str) -> Expected:
    """A scene that must be refused by ValueError at construction."""
    return Expected(frozenset(), because, raises=True)


def run(family: str, case: Case) -> Row:
    """Predict, solve and judge one case."""
    setup = case.setup()
    count = len(setup.target.vertices)

    def row(status: str, told: Expected, seconds: float, faults: list[str], advice: str) -> Row:
        allowed = tuple(sorted(str(s) for s in told.allowed)) or ("ValueError",)
        return Row(
            *(family, case.label, case.value, status, allowed, told.because),
            *(seconds, count, tuple(faults), advice),
        )

    told = case.expect if isinstance(case.expect, Expected) else Expected(ANYTHING, "not built")
    try:
        problem = setup.problem()
    except ValueError as error:
        faults = [] if told.raises else [f"refused: {error}"]
        return row("ValueError", told, 0.0, faults, str(error))
    if not isinstance(case.expect, Expected):
        told = case.expect(problem)
    if told.raises:
        return row("accepted", told, 0.0, ["not refused"], "")
    begin = time.perf_counter()
    try:
        result = within(TIME_LIMIT, problem)
    except Exception as error:
        seconds = time.perf_counter() - begin
        return row(type(error).__name__, told, seconds, [f"exception: {error!r}"], "")
    seconds = time.perf_counter() - begin
    faults = complaints(problem, result)
    if result.status not in told.allowed:
        faults.append(f"{result.status} is not expected")
    if seconds > TIME_LIMIT:
        faults.append(f"took {seconds:.0f} s")
    if case.twin is not None and not faults:
        faults += _differences(case.twin, result)
    return row(str(result.status), told, seconds, faults, result.advice)


def within(limit: float, problem: Problem, method: str = "direct") -> Result:
    """Solve; after ``limit`` seconds as if the user had interrupted.  Main thread, POSIX."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, limit)
    try:
        return solve(problem, method)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def predicted(problem: Problem) -> Expected:
    """The oracle of linear theory, under the name families use."""
    return expected(problem)


def _differences(twin: Twin, result: Result) -> list[str]:
    """Distance between the natural shape of a case and that of its twin."""
    problem = twin.setup().problem()
    other = within(TIME_LIMIT, problem)
    if other.status is not result.status:
        return [f"twin is {other.status}"]
    if not result.status.certified:
        return []
    gap = np.abs(twin.back(result.rest) - other.rest).max() / problem.target.bbox_diagonal
    return [f"twin's shape differs by {gap:.1e}"] if gap > twin.tolerance else []
