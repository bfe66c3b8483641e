"""Tables and plots of a run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.stress.case import TIME_LIMIT, Row

ORDER = (
    "SOLVED",
    "SOLVED_NEARBY",
    "UNSTABLE",
    "TOO_SOFT",
    "CONE_VIOLATED",
    "INFEASIBLE",
    "ITERATION_LIMIT",
    "NONFINITE",
    "INTERRUPTED",
    "ValueError",
)
COLOURS = dict(
    zip(
        ORDER,
        ("#2a7f3f", "#8fce8f", "#e08a1e", "#f2c14e", "#b3446c", "#3b5b92", *["#777777"] * 4),
        strict=True,
    )
)


def table(rows: Sequence[Row]) -> str:
    """One line a family: cases, how many as theory says, statuses, times."""
    lines = [
        "| family | cases | as theory says | one status allowed | statuses | median s | slowest s |",
        "|---|---|---|---|---|---|---|",
    ]
    for family in dict.fromkeys(row.family for row in rows):
        mine = [row for row in rows if row.family == family]
        counts = Counter(row.status for row in mine)
        seconds = np.array([row.seconds for row in mine])
        told = ", ".join(f"{counts[s]} {s}" for s in ORDER if counts[s])
        good = sum(not row.faults for row in mine)
        sharp = sum(len(row.allowed) == 1 for row in mine)
        lines.append(
            f"| {family} | {len(mine)} | {good} | {sharp} | {told} | "
            f"{np.median(seconds):.2f} | {seconds.max():.1f} |"
        )
    return "\n".join(lines)


def page(rows: Sequence[Row]) -> str:
    """STRESS.md."""
    faults = [row for row in rows if row.faults]
    certified = sum(row.status in ("SOLVED", "SOLVED_NEARBY") for row in rows)
    proofs = sum(row.status == "INFEASIBLE" for row in rows)
    shell_sizes = [row.vertices for row in rows]
    text = [
        "# Numerical stability, stressed",
        "",
        "`python -m benchmarks.stress` solves sweeps of scenes and random scenes with the direct "
        f"method ({min(shell_sizes)} to {max(shell_sizes)} vertices).  The statuses a scene may end "
        "with are written in `benchmarks/stress/` with their reason, from theory and before the run; "
        "random scenes are judged by linear theory (`oracle.py`; its rule for supports that only just "
        "balance came after a first run had shown six promises too many).  Every certified result is "
        "recomputed by formulas of its own with dense eigenvalues, every proof of infeasibility is "
        "tried to be refuted by a linear program over forces and masses (`recheck.py`).  A case may "
        f"take {TIME_LIMIT:.0f} s.",
        "",
        table(rows),
        "",
        f"{len(rows)} cases: {certified} certified, none of them refuted unless listed below; "
        f"{proofs} proofs of infeasibility, likewise; {len(faults)} not as theory says.",
        "",
        "## Not as theory says",
        "",
    ]
    if not faults:
        text.append("Nothing.")
    for row in faults:
        text.append(
            f"* {row.family}, {row.label} ({row.vertices} vertices, {row.seconds:.1f} s): "
            f"{'; '.join(row.faults)}. Theory: {row.because}."
        )
    text += ["", "## Why the others are allowed to fail", "", *_reasons(rows), ""]
    text += ["![statuses of the sweeps](../docs/stress_sweeps.png)", ""]
    text += ["![random scenes](../docs/stress_random.png)", ""]
    return "\n".join(text)


def _reasons(rows: Sequence[Row]) -> list[str]:
    """Statuses other than SOLVED by the reason that allows them, with numbers left out."""
    counts: Counter[tuple[str, str]] = Counter()
    for row in rows:
        if row.status != "SOLVED" and not row.faults:
            words = " ".join(w for w in row.because.split() if not any(c.isdigit() for c in w))
            counts[words, row.status] += 1
    lines = ["| reason | status | cases |", "|---|---|---|"]
    return lines + [f"| {why} | {status} | {n} |" for (why, status), n in counts.most_common()]


def plots(rows: Sequence[Row], folder: Path) -> None:
    """stress_sweeps.png and stress_random.png in ``folder``."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    swept = (
        "stretch",
        "bend",
        "stretch and bend",
        "target noise",
        "far from the origin",
        "slivers",
    )
    figure, grid = plt.subplots(2, 3, figsize=(12, 6), constrained_layout=True)
    for family, axes in zip(swept, grid.ravel(), strict=True):
        mine = [row for row in rows if row.family == family]
        for row in mine:
            axes.plot(row.value, max(row.seconds, 1e-3), "o", color=COLOURS.get(row.status, "k"))
        axes.set(xscale="log", yscale="log", title=family, ylabel="seconds")
    seen = [s for s in ORDER if any(row.status == s and row.family in swept for row in rows)]
    handles = [plt.Line2D([], [], marker="o", ls="", color=COLOURS[s], label=s) for s in seen]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(seen), fontsize=8)
    figure.savefig(folder / "stress_sweeps.png", dpi=80)
    plt.close(figure)
    figure, axes = plt.subplots(figsize=(7, 4), constrained_layout=True)
    for status in ORDER:
        mine = [row for row in rows if row.family == "random" and row.status == status]
        if mine:
            axes.loglog(
                [row.vertices for row in mine],
                [max(row.seconds, 1e-3) for row in mine],
                ".",
                color=COLOURS[status],
                label=f"{status} ({len(mine)})",
            )
    axes.set(xlabel="vertices", ylabel="seconds", title="random scenes")
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=8)
    figure.savefig(folder / "stress_random.png", dpi=80)
    plt.close(figure)
