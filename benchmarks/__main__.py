"""``python -m benchmarks``: run everything, write benchmarks/RESULTS.md, exit 1 on a missed goal.

``python -m benchmarks table2 [FOLDER]`` and ``python -m benchmarks garments`` are apart, for they take
long; see `benchmarks.table2` and `benchmarks.garments`.
"""

from __future__ import annotations

import platform
import sys
from collections.abc import Callable
from pathlib import Path

from benchmarks import (
    derivatives,
    dynamics,
    garments,
    hold,
    programs,
    ribbons,
    scaling,
    skips,
    table2,
)
from benchmarks.timing import Goal

PARTS = {
    "derivatives": derivatives.run,
    "scaling": scaling.run,
    "skips": skips.run,
    "programs": programs.run,
}


def main(names: list[str]) -> int:
    """Run the named parts (all by default, but for table2)."""
    if names[:1] == ["table2"]:
        return table2.main(names[1:])
    if names == ["garments"]:
        return _apart("Garments", "GARMENTS.md", garments.run)
    if names == ["dynamics"]:
        return _apart("Simulation", "DYNAMICS.md", dynamics.run)
    if names == ["ribbons"]:
        return _apart("Ribbons", "RIBBONS.md", ribbons.run)
    if names == ["hold"]:
        return _apart("Hold test", "HOLD.md", hold.run)
    text = [
        "# Benchmarks",
        "",
        f"`python -m benchmarks` on {platform.machine()}, Python {platform.python_version()}. "
        "Wall times of a shared machine: ratios are safer than the last digit.",
    ]
    missed = 0
    for name in names or list(PARTS):
        goals, table = PARTS[name]()
        missed += sum(not goal.met for goal in goals)
        rows = ["| goal | measured | wanted | |", "|---|---|---|---|", *(g.row() for g in goals)]
        text += ["", f"## {name}", "", table, "", *rows]
        print("\n".join([f"{name}:", table, *(goal.row() for goal in goals), ""]), flush=True)
    if not names:
        (Path(__file__).parent / "RESULTS.md").write_text("\n".join(text) + "\n")
    return 1 if missed else 0


def _apart(title: str, file: str, part: Callable[[], tuple[list[Goal], str]]) -> int:
    """Run a part that has a file of its own; 1 on a missed goal."""
    goals, table = part()
    rows = ["| goal | measured | wanted | |", "|---|---|---|---|", *(g.row() for g in goals)]
    text = [f"# {title}", "", str(sys.modules[part.__module__].__doc__), "", table, "", *rows]
    (Path(__file__).parent / file).write_text("\n".join(text) + "\n")
    return 0 if all(goal.met for goal in goals) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
