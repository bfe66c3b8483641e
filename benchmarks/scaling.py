"""Time of a solve against the number of vertices, with its parts, and the exponent of its growth.

The scene is the built-in skirt; its stretching stiffness follows the edge length so that the shell
stays the same material while the mesh is refined (Ly 2018, Sec. 4.1).
"""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.timing import Goal
from casashell.app.scene import Scene

SIZES = ((8, 26), (16, 52), (28, 92), (50, 200), (72, 280))
COARSE_STRETCH = 3.0  # N, of Ly 2018's Synthetic Skirt


def resized(rows: int, around: int) -> Scene:
    """The built-in skirt in this resolution, of the same material."""
    from casashell.app.builtin import skirt

    coarse = skirt(*SIZES[0]).target.mean_edge_length
    scene = skirt(rows, around)
    ratio = scene.target.mean_edge_length / coarse
    return replace(scene, material=replace(scene.material, stretch=COARSE_STRETCH * ratio))


def one(rows: int, around: int) -> dict[str, float | str]:
    """Solve one size in this process; what is reported of it."""
    from casashell.solving import solve

    scene = resized(rows, around)
    result = solve(scene.problem)
    return {
        "vertices": len(scene.target.vertices),
        "contacts": len(result.contacts),
        "status": str(result.status),
        "seconds": result.seconds,
        "factorizations": result.factorizations,
        "free_force": float(result.certificate.free_force or 0.0),
        "memory": _peak_memory(),
        **{part: result.timings.get(part, 0.0) for part in ("solve", "certificate", "quality")},
    }


def _peak_memory() -> float:
    """Peak of this process [MB]; from the kernel's own count, since getrusage keeps the parent's."""
    status = Path("/proc/self/status")
    if status.is_file():
        fields = dict(line.split(":", 1) for line in status.read_text().splitlines())
        return float(fields["VmHWM"].split()[0]) / 1024
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def run() -> tuple[list[Goal], str]:
    """Each size in a process of its own, twice, the second counted (kernels are compiled then)."""
    rows = []
    for size in SIZES:
        code = f"import json; from benchmarks.scaling import one; print(json.dumps(one{size}))"
        for _ in range(2):
            done = subprocess.run(
                [sys.executable, "-c", code], capture_output=True, text=True, check=True
            )
        rows.append(json.loads(done.stdout))
    head = "| vertices | contacts | status | solve() s | of it Newton s | certificate s | "
    lines = [head + "factorisations | free force / f0 | memory MB |", "|" + "---|" * 9]
    for row in rows:
        lines.append(
            "| {vertices} | {contacts} | {status} | {seconds:.2f} | {solve:.2f} | "
            "{certificate:.2f} | {factorizations} | {free_force:.0e} | {memory:.0f} |".format(**row)
        )
    count = np.log([float(row["vertices"]) for row in rows[1:]])
    exponent = float(np.polyfit(count, np.log([float(row["seconds"]) for row in rows[1:]]), 1)[0])
    lines += ["", f"Growth from {rows[1]['vertices']} vertices on: time ~ V^{exponent:.2f}."]
    unsolved = sum(row["status"] != "SOLVED" for row in rows)
    goals = [
        Goal("exponent of time against vertices", exponent, 1.3, ""),
        Goal("unsolved sizes", unsolved, 0, ""),
        Goal("solve of 20 160 vertices", float(rows[-1]["seconds"]), 25.0, "s"),
    ]
    return goals, "\n".join(lines)
