"""Real garments on their bodies, at three bending stiffnesses: status, time and certificate.

Every run is a whole process of the command line without pictures, kernels compiled before.  Where no
natural mesh holds the design, rest lengths and angles alone are asked for (`--natural metric`).
"""

from __future__ import annotations

import json
import shutil
import sys
import time
from typing import Any, Final

from benchmarks.programs import DATA, measured
from benchmarks.timing import Goal, scratch

#: Folder, unit and contact tolerance.
GARMENTS: Final = (
    ("hat_on_sphere", "dm", "0.039"),
    ("skirt_8panel_smpl", "m", "0.0045"),
    ("skirt_4panel_smpl", "m", "0.0039"),
    ("long_skirt_makehuman", "dm", "0.069"),
    ("top_avatar", "dm", "0.033"),
    ("sleeve_avatar", "dm", "0.040"),
    ("shirt_avatar", "dm", "0.085"),
    ("pants_avatar", "dm", "0.049"),
    ("dress_avatar", "dm", "0.048"),
    ("knit_cap_avatar", "dm", "0.091"),
    ("brimmed_hat_avatar", "dm", "0.057"),
)
SLOPE: Final = ("sheet_on_slope_576", "m", "0.01")
BENDS: Final = ("1e-3", "1e-4", "1e-5")
HEAD: Final = (
    "| shell | bend J | asked for | status | method | s | processor s | free force | cone margin | "
    "lowest eigenvalue N/m | target distance | edges | largest fold rad |"
)


def invert(name: str, unit: str, tolerance: str, *more: str) -> tuple[str, dict[str, Any]]:
    """Row of the table and the record of one run."""
    folder = scratch()
    command = [
        *(sys.executable, "-m", "casashell", "invert", str(DATA / name / "shell.obj")),
        *("--obstacle", str(DATA / name / "obstacle.obj"), "--unit", unit),
        *("--tolerance", tolerance, "--no-pictures", "--quiet", "--force"),
        *("--out", str(folder / "out"), *more),
    ]
    begin = time.perf_counter()
    run = measured(command, 1, allowed=(0, 1, 3))
    wall = time.perf_counter() - begin
    record: dict[str, Any] = json.loads((folder / "out" / "result.json").read_text())
    shutil.rmtree(folder)
    proof, quality = record["certificate"], record["quality"]
    given = dict(zip(more[::2], more[1::2], strict=True))
    cells = [name, given.get("--bend", "1e-3"), given.get("--natural", "mesh"), record["status"]]
    cells += [record["method"], f"{wall:.1f}", f"{run.processor:.1f}" if run else ""]
    cells += [
        "" if proof[key] is None else f"{proof[key]:.1e}"
        for key in ("free_force", "cone_margin", "min_eigenvalue", "target_distance")
    ]
    cells += [f"{quality['max_stretch']:.1%}", f"{quality['max_rest_fold']:.2f}"]
    return "| " + " | ".join(cells) + " |", record


def run() -> tuple[list[Goal], str]:
    """Goals and a Markdown table; nothing without the data folder."""
    if not DATA.is_dir():
        return [], "No ../shared/data: skipped."
    lines, solved = [HEAD, "|" + "---|" * 13], 0
    for bend in BENDS:
        for garment in GARMENTS:
            row, record = invert(*garment, "--bend", bend)
            lines.append(row)
            print(row, flush=True)
            solved += bend == BENDS[0] and record["status"] == "SOLVED"
            if record["status"] != "SOLVED":
                row, _ = invert(*garment, "--bend", bend, "--natural", "metric")
                lines.append(row)
                print(row, flush=True)
    slope, proved = invert(*SLOPE)
    rough, held = invert(*SLOPE, "--friction", "1.0", "--bend", "1e-2")
    lines += [slope, rough, "", "The slope: friction 0.5, then 1.0. " + proved["advice"]]
    goals = [
        Goal("garments solved at bend 1e-3", solved, len(GARMENTS), "", at_most=False),
        Goal(
            "slope at friction 0.5 proved impossible",
            proved["status"] == "INFEASIBLE",
            1,
            "",
            at_most=False,
        ),
        Goal("slope at friction 1.0 solved", held["status"] == "SOLVED", 1, "", at_most=False),
    ]
    return goals, "\n".join(lines)
