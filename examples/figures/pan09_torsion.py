"""Pan 2016, Fig. 9: the same twist by a ribbon of 20 segments, and by triangles of two kinds.

A strip 10 x 1, clamped at its begin; the normal of its end is turned by half a turn.
Triangles that share vertices are stiff springs in their plane; triangles that share the midpoints of
their edges keep their shape exactly, but have no common vertices: what is drawn is their mean.
Checked: the ribbon's lengths and area stay to rounding; triangles lose theirs by the numbers printed.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from ribbon_stage import BLUE, GREEN, ORANGE, Piece, Shot, panels, piece
from stage import conclude, folder

from benchmarks import ribbon_fem as fem
from casashell.app.ribbon_measures import isometry_error
from casashell.app.ribbon_shapes import waved
from casashell.io.sheet import write_sheet
from casashell.ribbon import Body, Guide, Ribbon, Scene, simulate
from casashell.ribbon.chain import reconstruct
from formulations import ribbon_physics

LENGTH, WIDTH, STIFFNESS, DENSITY, WEIGHT = 10.0, 1.0, 1.0, 0.1, 100.0
H, STEPS, TURN = 0.05, 60, np.pi  # the end has turned by TURN after two thirds of the steps
CELLS = 40, 4  # columns and rows of pairs of triangles
STRIP = Ribbon(LENGTH, WIDTH, 20, stiffness=STIFFNESS, density=DENSITY)
START = waved(STRIP, 0.02, 2.5)  # a flat one does not know which way to give


@dataclass(frozen=True)
class Run:
    """A method: end shape, largest error of a length, error of the area, seconds and iterations a step."""

    name: str
    points: np.ndarray
    faces: np.ndarray
    lines: np.ndarray
    length: float
    area: float
    seconds: float
    iterations: float

    def __str__(self) -> str:
        return (
            f"{self.name}: {len(self.faces)} faces, lengths off by {self.length:.1e}, area by "
            f"{self.area:.1e}; {self.seconds:.3f} s and {self.iterations:.1f} iterations a step"
        )


def wanted(t: float) -> np.ndarray:
    angle = TURN * min(1.5 * t / (H * STEPS), 1.0)
    return np.array([0.0, -np.sin(angle), np.cos(angle)])


def ours() -> Run:
    body = Body(STRIP, START, guides=(Guide((19,), wanted, WEIGHT),))
    sim = simulate(Scene((body,), ribbon_physics(), (0.0, 0.0, 0.0)), H * STEPS, H)
    if len(sim.times) != STEPS + 1:
        raise SystemExit(sim.message)
    track = sim.tracks[0]
    shown = piece(track.bottom[-1], track.top[-1])
    length, area = float(isometry_error(track).max()), _area(shown.points, shown.faces)
    counts = float(sim.seconds[1:].mean()), float(sim.inner[1:].mean())
    return Run("ribbon", shown.points, shown.faces, shown.lines, length, area, *counts)


def _area(points: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = np.moveaxis(points[faces], 1, 0)
    total = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    return float(abs(total / (LENGTH * WIDTH) - 1.0))


def bent(nodes: np.ndarray) -> np.ndarray:
    """Flat nodes (n,3) on the ribbon's own start, whose rulings go straight across."""
    shape = reconstruct(STRIP, START)
    s, at = np.linspace(0.0, LENGTH, STRIP.segments + 1), np.maximum(nodes[:, 0], 0.0)
    made = nodes.copy()
    made[:, 0] = np.interp(at, s, shape.middle[:, 0]) + np.minimum(nodes[:, 0], 0.0)
    made[:, 2] = np.interp(at, s, shape.middle[:, 2])
    return made


def elements(name: str, build: Callable[[fem.Patch], fem.Body]) -> Run:
    """Implicit Euler with the step of the ribbon; raises StepFailed."""
    flat = fem.strip(LENGTH, WIDTH, *CELLS, STIFFNESS, DENSITY, begin=fem.still)
    patch = replace(flat, guides=(fem.Guide(fem.last_column(flat), wanted, WEIGHT),))
    body = build(patch)
    way = fem.ImplicitEuler(body)
    film = fem.simulate(way, STEPS, H, start=way.begin(bent(body.rest)))
    mesh, shown = patch.mesh, film.surface[-1]
    faces = mesh.faces[~patch.outside]
    length, area, _ = film.drawn.max(axis=0)
    counts = float(film.seconds.mean()), float(film.iterations.mean())
    sides = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    lines = shown[np.unique(np.sort(sides, axis=1), axis=0)]
    return Run(name, shown, faces, lines, float(length), float(area), *counts)


def projected(h: float) -> str:
    """How the published way, a projection onto lengths after each step of h [s], gets on."""
    flat = fem.strip(LENGTH, WIDTH, *CELLS, STIFFNESS, DENSITY, begin=fem.still)
    patch = replace(flat, guides=(fem.Guide(fem.last_column(flat), wanted, WEIGHT),))
    way = fem.FastProjection(fem.nonconforming(patch))
    try:
        film = fem.simulate(way, round(STEPS * H / h), h, start=way.begin(bent(way.body.rest)))
    except fem.StepFailed as problem:
        return f"stops: {problem}"
    return f"gets to the end, drawn lengths off by {film.drawn[:, 0].max():.1e}"


def measure() -> list[Run]:
    return [
        ours(),
        elements("conforming triangles", fem.conforming),
        elements("non-conforming triangles", fem.nonconforming),
    ]


def complaints(runs: list[Run]) -> list[str]:
    ribbon, *others = runs
    wrong = []
    if max(ribbon.length, ribbon.area) > 1e-12:
        wrong.append(f"the ribbon drifts: {ribbon}")
    return wrong + [f"no drift: {run}" for run in others if run.length < 1e-4]


def draw(runs: list[Run], path: Path) -> None:
    shots = []
    for run, colours in zip(runs, (BLUE, ORANGE, GREEN)):
        drift = f"{run.length:.0e}" if run.length < 1e-6 else f"{100 * run.length:.1f} %"
        label = f"{run.name}, {len(run.faces)} faces: lengths off by {drift}"
        shots.append(Shot(label, [Piece(run.points, run.faces, run.lines, colours)]))
    made = panels(shots, view=(25.0, 25.0), height=420)
    write_sheet([[panel] for panel in made], path)


if __name__ == "__main__":
    out, runs = folder(__doc__), measure()
    draw(runs, out / "pan09_torsion.png")
    last = [
        f"non-conforming, fast projection, steps of {h:g} s: {projected(h)}" for h in (H, 0.4 * H)
    ]
    conclude([*map(str, runs), *last], complaints(runs))
