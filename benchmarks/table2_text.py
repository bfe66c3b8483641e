"""The tables of TABLE2.md, from measured runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any, Final

import numpy as np

from benchmarks.table2_runs import SOFTER, WAYS, Run, Runs
from casashell.inverse.quality import rigid_fit
from casashell.typing import FloatArray

#: Table 2 of Ly 2018: vertices, contacts, share of Step 1 and its iterations a lambda, the same of
#: Step 2, minutes, J in m2, G.  Their "Soft Hat" is the Floppy Hat of their Table 1.
PUBLISHED: Final[Mapping[str, tuple[int, int, int, int, int, int, int, str, str]]] = {
    "synthetic-skirt": (200, 19, 75, 598, 25, 157, 4, "0", "1.5e-23"),
    "book-page": (817, 143, 46, 75, 54, 2338, 187, "1.5e-11", "1.2e-23"),
    "puff-sleeve": (402, 67, 68, 509, 32, 389, 14, "0", "7.4e-23"),
    "beret": (846, 69, 48, 883, 52, 3055, 97, "0", "4.5e-25"),
    "floppy-hat": (876, 178, 51, 500, 49, 723, 50, "0", "2.3e-22"),
}

_HEAD: Final = (
    "| scene | | n_v | n_c | Step 1 % | n1 | Step 2 % | n2 | total | J, m2 | G, f0^2 | "
    "its rounding | G with mu | G, N^2 | memory MB | status |"
)
_COLUMNS: Final = _HEAD.count("|") - 1


#: Methods that are compared on every scene.
COMPARED: Final = ("two-step ipopt", "two-step bfgs", "direct", "nlp")


def scenes_of(runs: Runs) -> list[str]:
    """Names in the order they were run, in their own material."""
    return list(dict.fromkeys(scene for scene, _ in runs if scene not in SOFTER))


def paper_table(runs: Runs, ways: Sequence[str]) -> str:
    """Columns of Table 2, the paper's row above those of ``ways``."""
    lines = [_HEAD, "|" + "---|" * _COLUMNS]
    for scene in scenes_of(runs):
        if scene in PUBLISHED:
            v, c, one, n1, two, n2, minutes, j, g = PUBLISHED[scene]
            lines.append(
                f"| {scene} | paper | {v} | {c} | {one} | {n1} | {two} | {n2} | {minutes} min | {j} | "
                f"| | | {g} | | |"
            )
        lines += [two_step_row(scene, way, runs.get((scene, way))) for way in ways]
    return "\n".join(
        [
            *lines,
            "",
            "n1, n2: mean iterations per lambda. Step 1 %, Step 2 %: shares of the total; the rest is "
            "set-up, judging passes and the certificate. J = |x - x_t|^2 / 2, the paper's Phi. "
            "G = |G_K|^2 / 2 at the final pose with 0.975 mu, in squares of the mean nodal weight f0. "
            "Its rounding: what the last bit of the coordinates of the natural shape can make of it, at "
            "most. G with mu: the same with the true friction; where it is the smaller one, the last "
            "drape used up some of the 2.5 % that Step 2 keeps in hand, which is what they are for. "
            "G, N^2: not scaled, as the paper's tolerances are not; it does not name the unit of its G.",
        ]
    )


def two_step_row(scene: str, way: str, run: Run | None) -> str:
    """One measured line of `paper_table`."""
    if run is None:
        return f"| {scene} | {way} | | | | | | | not finished | | | | | | | killed |"
    n = run.numbers
    passes, total = max(1, n["passes"]), n["seconds"]
    one, two = (100.0 * n[f"seconds_{step}"] / total for step in ("one", "two"))
    return (
        f"| {scene} | {way} | {n['vertices']} | {n['contacts']} | {one:.0f} | "
        f"{n['iterations_one'] / passes:.0f} | {two:.0f} | {n['iterations_two'] / passes:.0f} | "
        f"{duration(run)} | {brief(n['J'])} | {brief(n['G'])} | {brief(n['floor'])} | "
        f"{brief(n['G_true'])} | {brief(n['G_newtons'])} | {n['memory']:.0f} | {n['status']} |"
    )


def methods(runs: Runs) -> str:
    """All methods side by side: time, certificate, memory."""
    lines = [
        "| scene | method | solve() | iterations | status | free force / f0 | cone margin / f0 | "
        "lowest eigenvalue N/m | target distance | G, f0^2 | memory MB |",
        "|" + "---|" * 11,
    ]
    for (scene, way), run in runs.items():
        if way not in COMPARED or scene in SOFTER:
            continue
        if run is None:
            lines.append(f"| {scene} | {way} | not finished | | killed | | | | | | |")
            continue
        n = run.numbers
        lines.append(
            f"| {scene} | {way} | {duration(run)} | {n['iterations']} | {n['status']} | "
            f"{brief(n['free_force'])} | {brief(n['cone_margin'])} | {brief(n['eigenvalue'])} | "
            f"{brief(n['target_distance'])} | {brief(n['G'])} | {n['memory']:.0f} |"
        )
    return "\n".join(lines)


def shapes(runs: Runs) -> str:
    """How the certified natural shapes of one scene differ, and how far apart they are."""
    lines = [
        "| scene | method | elastic energy J | largest stretch | largest fold ° | "
        "lowest eigenvalue N/m | cone margin / f0 |",
        "|" + "---|" * 7,
    ]
    apart = [
        "| scene | between | farthest vertex, h | % of the size | root mean square, h |",
        "|" + "---|" * 5,
    ]
    for scene in scenes_of(runs):
        good = certified(runs, scene)
        for way, run in good.items():
            n = run.numbers
            lines.append(
                f"| {scene} | {way} | {n['energy']:.4g} | {100 * n['max_stretch']:.2f} % | "
                f"{np.degrees(n['max_fold']):.2f} | {n['eigenvalue']:.3g} | {n['cone_margin']:.2g} |"
            )
        for a, b in combinations(good, 2):
            farthest, mean = distance(good[a].rest, good[b].rest)
            n = good[a].numbers
            apart.append(
                f"| {scene} | {a}, {b} | {farthest / n['h']:.2g} | {100 * farthest / n['size']:.2g} | "
                f"{mean / n['h']:.2g} |"
            )
    return "\n".join(
        [
            "Certified runs only.",
            "",
            *lines,
            "",
            "Distances after the best rigid fit; h: mean edge length; size: diagonal of the bounding box.",
            "",
            *apart,
        ]
    )


def softer(runs: Runs, limit: float) -> str:
    """What becomes of every method as stretch and bend are divided by more and more."""
    ways = [*COMPARED, "free-pose"]
    lines = ["| scene | " + " | ".join(ways) + " |", "|" + "---|" * (len(ways) + 1)]
    for scene in SOFTER:
        if not any(name == scene for name, _ in runs):
            continue
        cells = [
            _ending(runs[scene, way]) if (scene, way) in runs else "not measured" for way in ways
        ]
        lines.append(f"| {scene} | " + " | ".join(cells) + " |")
    return "\n".join(
        [
            f"Stretch and bend divided by the same number, {limit:.0f} s at the most. Status, seconds, and "
            "how far the pose is from the target, in bounding boxes, where that is more than rounding.",
            "",
            *lines,
        ]
    )


def _ending(run: Run | None) -> str:
    if run is None:
        return "killed"
    away = run.numbers["target_distance"]
    far = f", {brief(away)} away" if away is not None and away > 1e-8 else ""
    return f"{run.numbers['status']}, {duration(run)}{far}"


def paper_preset(runs: Runs, limit: float) -> str:
    """Runs with lambda from 1000 N/m, halved fourteen times, and tolerances of 1e-15 m."""
    rows = [(*key, run) for key, run in runs.items() if WAYS[key[1]].preset == "paper"]
    return "\n".join(
        [
            '`preset="paper"`: lambda from 1000 N/m, halved, 0 below 0.1; Step 1 by BFGS until nothing '
            f"moves by more than 1e-15 m or for 2000 iterations. Limit {limit:.0f} s.",
            "",
            _HEAD,
            "|" + "---|" * _COLUMNS,
            *(two_step_row(scene, way, run) for scene, way, run in rows),
        ]
    )


def certified(runs: Runs, scene: str) -> dict[str, Run]:
    """Runs of the scene whose result is certified, by way, without those of the paper's preset."""
    return {
        way: run
        for (name, way), run in runs.items()
        if name == scene and run is not None and run.numbers["certified"] and way in COMPARED
    }


def distance(one: FloatArray, other: FloatArray) -> tuple[float, float]:
    """Farthest and root mean square distance of vertices (V,3) after the best rigid fit [m]."""
    away = np.linalg.norm(rigid_fit(one, other) - other, axis=1)
    return float(away.max()), float(np.sqrt((away**2).mean()))


def duration(run: Run) -> str:
    """Seconds of solve(), or that it was stopped after them."""
    seconds = f"{run.numbers['seconds']:.2f} s"
    return seconds if run.finished else f"not finished in {seconds}"


def brief(value: Any) -> str:
    """A number with two digits; a dash for none."""
    if value is None:
        return "–"
    return "0" if value == 0 else f"{value:.1e}" if not 1e-3 <= abs(value) < 1e4 else f"{value:.2g}"
