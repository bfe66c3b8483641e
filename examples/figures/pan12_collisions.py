"""Pan 2016, Fig. 12: a long ribbon falls on the ground; two chains of 9 loops; a chain of Moebius bands.

The ribbon has the paper's 150 segments, the chains are the first moments of the built-in scenes
`double-chain` and `moebius-chain`.  Checked in every frame: no two faces pass through each other, nothing
is below the ground, and neighbours in a chain stay linked (Gauss linking number of centrelines, exact for
polygons).
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from ribbon_stage import Shot, panels, pieces, write_grid
from stage import conclude, folder

from casashell.app.ribbon_measures import distances
from casashell.app.ribbon_scenes import builtin_setup
from casashell.app.ribbon_setup import RibbonSetup
from casashell.app.ribbon_shapes import frame_of, placed, waved
from casashell.contact.obstacles import Plane
from casashell.ribbon import Body, Ribbon, RibbonSimulation, Scene, simulate
from formulations import ribbon_physics

#: Seconds of motion and step [s] of each scene.
TIMES = {"falling": (0.6, 0.02), "double-chain": (0.5, 0.01), "moebius-chain": (0.4, 0.01)}
LINKS = 9


@dataclass(frozen=True)
class Run:
    """A scene, its frames, frames with crossings, least distances, and linking numbers (F,L)."""

    setup: RibbonSetup
    sim: RibbonSimulation
    crossing: int
    between: float
    above: float
    linked: np.ndarray


def falling() -> RibbonSetup:
    """A satin ribbon with 150 segments, slanted, above the ground."""
    # Rulings of a ribbon that is nearly flat are nearly free: the regulariser steadies them.
    strip = Ribbon(1.5, 0.03, 150, stiffness=2e-4, density=0.1, ends="free", regulariser=10.0)
    tilted = frame_of((0.5, 0.0, -1.0), (0.0, 1.0, 0.0))
    start = placed(strip, waved(strip, 0.03, 3.0), tilted, centre=(0.0, 0.0, 0.8))
    ground = Plane((0.0, 0.0, 1.0), 0.0, name="ground")
    bodies = (Body(strip, start, name="ribbon"),)
    scene = Scene(bodies, ribbon_physics(), thickness=2e-3, obstacles=(ground,))
    return RibbonSetup("falling", scene, *TIMES["falling"])


def chain(name: str) -> RibbonSetup:
    return builtin_setup(name).with_times(*TIMES[name])


def linking(one: np.ndarray, two: np.ndarray) -> float:
    """Gauss linking number of closed polygons (n,3): solid angles of pairs of edges over 4 pi."""
    a, b = one[:, None], np.roll(one, -1, axis=0)[:, None]
    c, d = two[None], np.roll(two, -1, axis=0)[None]
    ac, ad, bc, bd = c - a, d - a, c - b, d - b
    corners = [np.cross(p, q) for p, q in ((ac, ad), (ad, bd), (bd, bc), (bc, ac))]
    unit = [n / np.linalg.norm(n, axis=-1, keepdims=True) for n in corners]
    sines = [np.sum(p * q, axis=-1) for p, q in zip(unit, unit[1:] + unit[:1])]
    angle = sum(np.arcsin(np.clip(sine, -1.0, 1.0)) for sine in sines)
    sign = np.sign(np.sum(np.cross(b - a, d - c) * ac, axis=-1))
    return float((angle * sign).sum() / (4.0 * np.pi))


def measure(setup: RibbonSetup) -> Run:
    sim = simulate(setup.scene, setup.seconds, setup.step, tolerance=1e-4)
    found = distances(setup, sim)
    tracks = sim.tracks
    pairs = [k for k in range(len(tracks) - 1) if (k + 1) % LINKS]
    linked = [
        [linking(tracks[k].middle[f, :-1], tracks[k + 1].middle[f, :-1]) for k in pairs]
        for f in range(len(sim.times))
    ]
    return Run(setup, sim, found.crossing, found.between, found.obstacles, np.array(linked))


def complaints(run: Run) -> list[str]:
    name, wrong = run.setup.name, []
    if len(run.sim.times) != run.setup.steps + 1:
        wrong.append(f"{name}: {run.sim.message}")
    if run.crossing or run.between <= 0.0 or run.above < 0.0:
        wrong.append(f"{name}: interpenetration in {run.crossing} frames, {run.above:.1e} m above")
    if np.any(np.abs(np.abs(run.linked) - 1.0) > 1e-6):
        wrong.append(f"{name}: links open, numbers {np.unique(run.linked.round(3))}")
    return wrong


def draw(runs: list[Run], path: Path) -> None:
    rows = []
    for run in runs:
        last = len(run.sim.times) - 1
        shots = [
            Shot(f"{run.setup.name}, {run.sim.times[k]:.2g} s", pieces(run.sim, k))
            for k in (last // 2, (3 * last) // 4, last)
        ]
        ground = run.setup.scene.obstacles
        view, near = ((20.0, 30.0), True) if ground else ((20.0, 12.0), False)
        rows.append(panels(shots, view=view, height=640, obstacles=ground, close=near))
    write_grid(rows, (500, 440), path)


if __name__ == "__main__":
    out = folder(__doc__)
    runs = [measure(setup) for setup in (falling(), chain("double-chain"), chain("moebius-chain"))]
    draw(runs, out / "pan12_collisions.png")
    lines = [
        f"{run.setup.name}: {len(run.sim.times) - 1} steps of {run.setup.step:g} s, {run.crossing} frames "
        f"with crossings, closest parts {1e3 * run.between:.3f} mm, ground {1e3 * run.above:.3f} mm, "
        f"{run.sim.inner[1:].mean():.1f} / {run.sim.outer[1:].mean():.2f} iterations, "
        f"{run.sim.seconds[1:].mean():.2f} s a step; linking {np.unique(np.abs(run.linked).round(6))}"
        for run in runs
    ]
    conclude(lines, [text for run in runs for text in complaints(run)])
