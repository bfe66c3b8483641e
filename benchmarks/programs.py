"""Whole processes: import, and the command line on built-in and real scenes, warm and cold."""

from __future__ import annotations

import shutil
from pathlib import Path

from benchmarks.timing import Goal, process, scratch

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


def garment(name: str, unit: str, tolerance: str) -> list[str]:
    """Arguments that invert one garment of the data folder without pictures."""
    folder = DATA / name
    return [
        *("-m", "casashell", "invert", str(folder / "shell.obj")),
        *("--obstacle", str(folder / "obstacle.obj"), "--unit", unit, "--tolerance", tolerance),
        *("--no-pictures", "--quiet", "--force", "--out"),
    ]


def run() -> tuple[list[Goal], str]:
    """Goals and a Markdown table; real garments only where the data folder exists."""
    goals = [Goal("import casashell", process(["-c", "import casashell"], 5), 0.5, "s")]
    empty = process(["-c", "pass"], 5)
    lines = [f"An empty Python process takes {empty:.2f} s; all numbers include it.", ""]
    if not DATA.is_dir():
        return goals, "\n".join([*lines, "No ../shared/data: real garments skipped."])
    folder = scratch()
    command = [*garment("top_avatar", "dm", "0.033"), str(folder / "out")]
    process(command, 1)
    goals.append(Goal("invert top_avatar (903 vertices), warm", process(command), 3.0, "s"))
    cold = scratch()
    goals.append(
        Goal(
            "the same with an empty kernel cache",
            process(command, 1, CASASHELL_CACHE=str(cold)),
            15.0,
            "s",
        )
    )
    for used in (folder, cold):
        shutil.rmtree(used, ignore_errors=True)
    return goals, "\n".join(lines)
