"""Pan 2016, Fig. 11: a strip that spins about its centreline.

With its mass on the centreline it has no inertia about it: it stays flat, however fast.  With the
consistent mass it bends once the spin passes the threshold at which the
centrifugal force is stiffer than the first bending mode of a free strip: 22.373 sqrt(D / rho) / L^2.
Checked: from the same start, uneven by 1e-3 rad, nothing grows with lumped mass or below the threshold, and
the strip bends by more than 0.5 rad in all above it.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from ribbon_stage import BLUE, ORANGE, Shot, panels, piece
from stage import conclude, folder

from casashell.app.ribbon_shapes import waved
from casashell.io.sheet import write_sheet
from casashell.ribbon import Body, Ribbon, RibbonSimulation, Scene, simulate
from formulations import ribbon_physics

STRIP = Ribbon(1.0, 0.1, 20, stiffness=1.0, density=1.0, ends="free")
CRITICAL = 22.373 * np.sqrt(STRIP.stiffness / STRIP.density) / STRIP.length**2  # [rad/s]
UNEVEN, SLANTED = 1e-3, 0.3  # angles [rad] and slopes at the start
TURN = 0.05  # radians a step: implicit Euler damps fast turns
RUNS = {"lumped": ("lumped", 5.0), "below": ("consistent", 0.5), "above": ("consistent", 5.0)}


@dataclass(frozen=True)
class Run:  # sum of the bending angles over time [rad], the simulation, and its speed over the threshold
    bent: np.ndarray
    sim: RibbonSimulation
    speed: float


def measure_one(mass: str, speed: float, turns: float = 2.0) -> Run:
    h = TURN / (speed * CRITICAL)
    body = Body(STRIP, waved(STRIP, UNEVEN, 0.5, SLANTED), spin=(speed * CRITICAL, 0.0, 0.0))
    scene = Scene((body,), ribbon_physics(), (0.0, 0.0, 0.0))
    sim = simulate(scene, round(2.0 * np.pi * turns / TURN) * h, h, mass=mass)
    return Run(np.abs(sim.tracks[0].angles).sum(axis=1), sim, speed)


def complaints(runs: dict[str, Run]) -> list[str]:
    # On a centreline without spin the start's unevenness swings, at most spin / frequency times as wide.
    start = float(runs["lumped"].bent[0])
    wrong = []
    if runs["lumped"].bent.max() > 1.1 * runs["lumped"].speed * start:
        wrong.append("lumped mass: the strip bends by itself")
    if runs["below"].bent.max() > 1.1 * start:
        wrong.append("consistent mass: it bends below the threshold")
    if runs["above"].bent.max() < 50.0 * start:
        wrong.append("consistent mass: it does not bend above the threshold")
    return wrong


def draw(runs: dict[str, Run], path: Path) -> None:
    shots = []
    for name, colours, part in (
        ("lumped", ORANGE, 1.0),
        ("above", BLUE, 0.5),
        ("above", BLUE, 1.0),
    ):
        run = runs[name]
        k = round(part * (len(run.bent) - 1))
        track, turns = run.sim.tracks[0], part * TURN * (len(run.bent) - 1) / (2.0 * np.pi)
        mass = "mass on the centreline" if name == "lumped" else "consistent mass"
        label = f"{mass}, {turns:.1f} turns: bent by {run.bent[k]:.2f} rad"
        shots.append(Shot(label, [piece(track.bottom[k], track.top[k], colours)]))
    made = panels(shots, view=(15.0, 30.0), height=420)
    write_sheet([[panel] for panel in made], path)


if __name__ == "__main__":
    out = folder(__doc__)
    runs = {name: measure_one(*run) for name, run in RUNS.items()}
    draw(runs, out / "pan11_spinning.png")
    lines = [
        f"{name}: {run.speed:g} times the threshold of {CRITICAL:.1f} rad/s; angles sum up to "
        f"{run.bent[0]:.4f} rad at first, {run.bent.max():.4f} at most, {run.bent[-1]:.4f} at the end"
        for name, run in runs.items()
    ]
    conclude(lines, complaints(runs))
