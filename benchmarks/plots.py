"""Error against run time: one figure per error, one panel per scene, one line per method."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.table2_runs import SOFTER, Run
from casashell.typing import FloatArray

#: Colours that stay apart for colour-blind eyes (Okabe and Ito).
COLOURS: Final[Mapping[str, str]] = {
    "direct": "#000000",
    "nlp": "#009e73",
    "two-step ipopt": "#0072b2",
    "two-step bfgs": "#d55e00",
}


@dataclass(frozen=True)
class Figure:
    """One error: its column in `Run.curve`, its name, and the ends of its axis.

    bottom  what is smaller is drawn there
    goal    what a certificate asks for, 0 for none
    """

    name: str
    column: int
    label: str
    bottom: float
    top: float
    goal: float


FIGURES: Final = (
    Figure("residual", 1, "largest force on a free vertex / nodal weight", 1e-13, 1e3, 1e-6),
    Figure("cones", 2, "worst violation of a friction cone / nodal weight", 1e-5, 1e3, 0.0),
    Figure("distance", 3, "farthest vertex from the target / bounding box", 1e-14, 1e-2, 1e-3),
)


def drawn(values: FloatArray, bottom: float, top: float) -> FloatArray:
    """Values (n,) as a log axis can show them: clipped to its ends, NaN for what is no number."""
    return np.where(np.isfinite(values), np.clip(values, bottom, top), np.nan)


def draw(figure: Figure, runs: Mapping[tuple[str, str], Run | None], folder: Path) -> Path:
    """The figure as ``folder``/table2-NAME.png.  Raises ImportError without matplotlib."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    scenes = list(dict.fromkeys(scene for scene, _ in runs if scene not in SOFTER))
    columns = 4
    rows = -(-(len(scenes) + 1) // columns)
    canvas, grid = plt.subplots(
        rows, columns, figsize=(11.0, 2.5 * rows + 0.4), sharex=True, sharey=True, squeeze=False
    )
    panels = grid.ravel()
    for panel, scene in zip(panels, scenes, strict=False):
        _panel(panel, figure, scene, runs)
    for panel in panels[len(scenes) :]:
        panel.axis("off")
    failed = any(
        run is not None and not run.numbers["certified"]
        for (scene, way), run in runs.items()
        if scene in scenes and way in COLOURS
    )
    _legend(panels[len(scenes)], figure, failed)
    for panel in panels[max(0, len(scenes) - columns) : len(scenes)]:
        panel.tick_params(labelbottom=True)
        panel.set_xlabel("wall time, s")
    canvas.supylabel(figure.label, fontsize=10)
    canvas.tight_layout()
    file = folder / f"table2-{figure.name}.png"
    canvas.savefig(file, dpi=130)
    plt.close(canvas)
    return file


def _panel(
    panel: Any, figure: Figure, scene: str, runs: Mapping[tuple[str, str], Run | None]
) -> None:
    """Lines of one scene: an error holds until the next iterate, hence the steps."""
    sizes = ""
    for way, colour in COLOURS.items():
        run = runs.get((scene, way))
        if run is None:
            continue
        sizes = f"  ({run.numbers['vertices']} / {run.numbers['contacts']})"
        seconds = np.maximum(run.curve[:, 0], 1e-3)
        errors = drawn(run.curve[:, figure.column], figure.bottom, figure.top)
        panel.plot(seconds, errors, color=colour, linewidth=1.1, drawstyle="steps-post", alpha=0.9)
        mark = "o" if run.numbers["certified"] else "X"
        panel.plot(
            seconds[-1:], errors[-1:], mark, color=colour, markersize=7, clip_on=False, zorder=5
        )
    panel.set_xscale("log")
    panel.set_yscale("log")
    panel.set_ylim(figure.bottom, figure.top)
    panel.set_title(scene.replace("_", " ") + sizes, fontsize=10)
    panel.grid(True, which="major", color="#e2e2e2", linewidth=0.6)
    panel.set_axisbelow(True)
    if figure.goal > 0.0:
        panel.axhline(figure.goal, color="#888888", linewidth=0.8, linestyle="--")


def _legend(panel: Any, figure: Figure, failed: bool) -> None:
    from matplotlib.lines import Line2D

    entries = [Line2D([], [], color=colour, label=way) for way, colour in COLOURS.items()]
    marks = [("o", "end of the run: certified")] + [("X", "not certified")] * failed
    for mark, label in marks:
        entries.append(Line2D([], [], color="#555555", marker=mark, linestyle="", label=label))
    if figure.goal > 0.0:
        goal = f"a certificate asks for {figure.goal:.0e}"
        entries.append(Line2D([], [], color="#888888", linestyle="--", label=goal))
    panel.legend(
        handles=entries,
        loc="center",
        frameon=False,
        fontsize=9,
        title=f"scene (vertices / contacts)\nbottom of the axis: {figure.bottom:.0e} or less",
        title_fontsize=9,
    )
