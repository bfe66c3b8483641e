"""Whole processes of the command line, without pictures, kernels compiled before: time and memory.

Every time is given in seconds and as a ratio to a calibration kernel timed in the same run (a sparse
factorisation and array arithmetic of fixed size), which says more on another or a busy machine.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.timing import Goal, best, process, scratch

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
#: Vertices up to which a run is repeated and also made with the two-step method.
SMALL = 3000
PATIENCE = 120.0

#: name, function that makes the scene (in a process of its own), seconds wanted, MB wanted.
MADE = (
    ("synthetic skirt", "paper('synthetic-skirt')", 0.8, None),
    ("book page", "paper('book-page')", 1.2, None),
    ("floppy hat", "paper('floppy-hat')", 1.2, None),
    ("skirt 28 x 92", "sized_skirt(28, 92)", 2.5, None),
    ("skirt 50 x 200", "sized_skirt(50, 200)", 9.0, 2000.0),
    ("skirt 72 x 280", "sized_skirt(72, 280)", 22.0, None),
    ("skirt 160 x 625", "sized_skirt(160, 625)", 180.0, 12000.0),
)
REAL = (
    ("top_avatar", "dm", "0.033", 1.5),
    ("long_skirt_makehuman", "dm", "0.069", 1.5),
    ("hat_on_sphere", "dm", "0.039", None),
)


@dataclass(frozen=True)
class Run:
    """One process: wall and processor seconds, peak memory [MB]."""

    seconds: float
    processor: float
    memory: float


def measured(
    command: list[str], repeats: int, patience: float = 3600.0, allowed: tuple[int, ...] = (0,)
) -> Run | None:
    """The run of median time; None when its exit code is not ``allowed`` or it takes too long."""
    runs = []
    for _ in range(repeats):
        begin = time.perf_counter()
        # The program of a user writes its byte code once; only the first run here does.
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, env=environment) as child:
            usage = None
            while usage is None:
                pid, status, found = os.wait4(child.pid, os.WNOHANG)
                if pid:
                    child.returncode, usage = os.waitstatus_to_exitcode(status), found
                elif time.perf_counter() - begin > patience:
                    child.kill()
                    return None
                else:
                    time.sleep(0.005)
        if child.returncode not in allowed:
            return None
        wall = time.perf_counter() - begin
        runs.append(Run(wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024))
    return sorted(runs, key=lambda run: run.seconds)[len(runs) // 2]


def calibration() -> float:
    """Seconds of the calibration kernel on this machine now."""
    import scipy.sparse as sp
    from scipy.sparse.linalg import splu

    line = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(120, 120))
    one = sp.eye_array(120)
    grid = sp.csc_array(sp.kron(line, one) + sp.kron(one, line))
    values = np.linspace(0.0, 1.0, 400_000)

    def kernel() -> None:
        splu(grid)
        for _ in range(10):
            np.sqrt(values * values + 1.0).sum()

    return best(kernel, 7)


def paper(name: str, folder: str) -> None:
    """Write a scene of Ly 2018 as files."""
    from casashell.app.paper_scenes import PAPER

    _store(PAPER[name](), folder)


def sized_skirt(rows: int, around: int, folder: str) -> None:
    """Write the built-in skirt in another resolution, its material kept."""
    from benchmarks.scaling import resized

    _store(resized(rows, around), folder)


def _store(scene: object, folder: str) -> None:
    from dataclasses import replace

    from casashell.app.scene import Scene
    from casashell.solving import solve

    if not isinstance(scene, Scene):
        raise TypeError("not a scene")
    result = solve(scene.problem)
    named = replace(result, contact_tolerance=scene.problem.tolerance, method="auto")
    named.save(folder, overwrite=True)
    print(json.dumps({"vertices": len(scene.target.vertices), "contacts": len(result.contacts)}))


def garment(name: str, unit: str, tolerance: str) -> list[str]:
    """Arguments that invert one garment of the data folder without pictures."""
    folder = DATA / name
    return [
        *("-m", "casashell", "invert", str(folder / "shell.obj")),
        *("--obstacle", str(folder / "obstacle.obj"), "--unit", unit, "--tolerance", tolerance),
        *("--no-pictures", "--quiet", "--force", "--out"),
    ]


def _row(
    name: str, size: dict[str, int], command: list[str], kernel: float
) -> tuple[Run | None, str]:
    small = size.get("vertices", 0) <= SMALL
    run = measured([sys.executable, *command], 3 if small else 1)
    paper_way = [sys.executable, *command, "--method", "two-step"]
    other = measured(paper_way, 1, PATIENCE) if small else None
    cells = [name, str(size.get("vertices", "")), str(size.get("contacts", ""))]
    if run is None:
        return None, "| " + " | ".join([*cells, "failed", "", "", "", ""]) + " |"
    ratio = "" if other is None else f"{other.seconds / run.seconds:.1f}"
    cells += [f"{run.seconds:.2f}", f"{run.processor:.2f}", f"{run.memory:.0f}"]
    return run, "| " + " | ".join([*cells, f"{run.seconds / kernel:.0f}", ratio]) + " |"


def run() -> tuple[list[Goal], str]:
    """Goals and a Markdown table; real garments only where the data folder exists."""
    kernel = calibration()
    goals = [Goal("import casashell", process(["-c", "import casashell"], 5), 0.5, "s")]
    lines = [
        f"Calibration kernel: {1e3 * kernel:.1f} ms. Its multiples and the two-step method's time, "
        "where that is SOLVED within two minutes, are the last columns. MB is the peak of the process, "
        "and at least what the benchmark itself had when it started it.",
        "",
        "| scene | vertices | contacts | s | processor s | MB | / kernel | two-step / auto |",
        "|" + "---|" * 8,
    ]
    folder = scratch()
    growth = []
    for name, make, seconds, memory in MADE:
        place = folder / name.replace(" ", "")
        call = f"{make[:-1]}, {str(place)!r})"
        code = f"from benchmarks.programs import paper, sized_skirt; {call}"
        made = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        )
        size = json.loads(made.stdout)
        command = ["-m", "casashell", "invert", str(place / "scene.toml")]
        command += ["--no-pictures", "--quiet", "--force", "--out", str(folder / "out")]
        result, row = _row(name, size, command, kernel)
        lines.append(row)
        goals.append(Goal(f"invert {name}", result.seconds if result else np.inf, seconds, "s"))
        if memory is not None:
            goals.append(
                Goal(f"memory of {name}", result.memory if result else np.inf, memory, "MB")
            )
        if result and name.startswith("skirt "):
            growth.append((size["vertices"], result.seconds))
    lines += _real(goals, folder, kernel) if DATA.is_dir() else ["", "No ../shared/data: skipped."]
    v, t = np.log(np.array(growth)).T
    exponent = float(np.polyfit(v, t, 1)[0])
    goals.append(Goal(f"exponent from {growth[0][0]} vertices on", exponent, 1.3, ""))
    cold = ["-m", "casashell", "invert", str(folder / "bookpage" / "scene.toml")]
    cold += ["--no-pictures", "--quiet", "--force", "--out", str(folder / "out")]
    empty = scratch()
    goals.append(
        Goal("book page, empty cache", process(cold, 1, CASASHELL_CACHE=str(empty)), 15.0, "s")
    )
    for used in (folder, empty):
        shutil.rmtree(used, ignore_errors=True)
    return goals, "\n".join(lines)


def _real(goals: list[Goal], folder: Path, kernel: float) -> list[str]:
    lines = []
    for name, unit, tolerance, seconds in REAL:
        result, row = _row(name, {}, [*garment(name, unit, tolerance), str(folder / "out")], kernel)
        lines.append(row)
        if seconds is not None:
            taken = result.seconds if result else np.inf
            goals.append(Goal(f"invert {name}", taken, seconds, "s"))
    return lines
