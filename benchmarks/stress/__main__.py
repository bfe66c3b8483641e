"""``python -m benchmarks.stress``: run all families and random scenes, write STRESS.md and plots."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

# Workers share the cores: one thread each, and dense algebra must not start more.  Before NumPy.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

from benchmarks.stress import report  # noqa: E402
from benchmarks.stress.families import FAMILIES  # noqa: E402
from benchmarks.stress.tasks import tasks, work  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run; exit code 1 when anything was not as theory says."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.stress")
    parser.add_argument("--scenes", type=int, default=1000, help="random scenes")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", choices=sorted(FAMILIES), help="one family, nothing written")
    given = parser.parse_args(arguments)
    names = [given.only] if given.only else list(FAMILIES)
    todo = tasks(names, 0 if given.only else given.scenes)
    with ProcessPoolExecutor(given.workers, mp_context=get_context("spawn")) as pool:
        rows = []
        for row in pool.map(work, todo, chunksize=4):
            rows.append(row)
            if row.faults:
                print(f"{row.family}, {row.label}: {row.status}; {'; '.join(row.faults)}")
    print(report.table(rows))
    if not given.only:
        (ROOT / "benchmarks" / "STRESS.md").write_text(report.page(rows))
        report.plots(rows, ROOT / "docs")
    return 1 if any(row.faults for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
