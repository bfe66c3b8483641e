"""How times are taken: best of several for kernels, whole processes for programs."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Goal:
    """One measured number beside what was promised; ``at_most`` False means at least."""

    name: str
    value: float
    goal: float
    unit: str
    at_most: bool = True

    @property
    def met(self) -> bool:
        """Whether the promise holds."""
        return self.value <= self.goal if self.at_most else self.value >= self.goal

    def row(self) -> str:
        """Line of a Markdown table."""
        sign = "<=" if self.at_most else ">="
        verdict = "met" if self.met else "MISSED"
        return f"| {self.name} | {self.value:.3g} {self.unit} | {sign} {self.goal:g} | {verdict} |"


def best(call: Callable[[], object], repeats: int = 5) -> float:
    """Shortest of several runs [s]."""
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        call()
        times.append(time.perf_counter() - begin)
    return min(times)


def process(arguments: list[str], repeats: int = 3, **environment: str) -> float:
    """Median wall time [s] of a whole Python process; raises when it fails."""
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        done = subprocess.run(
            [sys.executable, *arguments],
            env={**os.environ, **environment},
            capture_output=True,
            text=True,
            check=False,
        )
        times.append(time.perf_counter() - begin)
        if done.returncode != 0:
            raise RuntimeError(f"{' '.join(arguments)}: exit {done.returncode}\n{done.stderr}")
    return sorted(times)[len(times) // 2]


def scratch() -> Path:
    """A fresh directory that goes with the process."""
    return Path(tempfile.mkdtemp(prefix="casashell-bench-"))
