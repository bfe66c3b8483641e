"""Cases by name and number, for worker processes."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.stress import random_scenes
from benchmarks.stress.case import Row, run
from benchmarks.stress.families import FAMILIES

RANDOM = "random"


def work(task: tuple[str, int]) -> Row:
    """One case, named by family and number: what crosses the process border."""
    family, number = task
    if family == RANDOM:
        return run(family, random_scenes.cases(1, number)[0])
    return run(family, FAMILIES[family]()[number])


def tasks(names: Sequence[str], scenes: int) -> list[tuple[str, int]]:
    """All cases of the named families, then the random scenes."""
    chosen = [(name, n) for name in names for n in range(len(FAMILIES[name]()))]
    return chosen + [(RANDOM, seed) for seed in range(scenes)]
