"""Pan 2016, Fig. 11: a free strip whose first quad is turned about the centreline.

With its mass on the centreline the strip has no inertia about it: all of it turns along, flat.  With the
consistent mass the rest lags behind; the strip twists, by flat triangles whose rulings meet on the rims,
and then the centrifugal force bends it.  Both start flat at rest with the same slanted rulings.

A strip that spins freely is stiffer than the centrifugal force up to the speed of the first bending mode,
22.373 sqrt(D / rho) / L^2.

Checked: angles with lumped mass stay 0 to rounding; with the consistent mass most neighbouring rulings meet
on alternate rims while the strip is straight, and its ends come nearer than 0.7 L later.  Of a strip that
spins freely, uneven by 1e-3 rad: nothing grows with lumped mass or at half the threshold, and it bends by
more than 0.5 rad at five times it.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from ribbon_stage import BLUE, ORANGE, Shot, panels, piece
from stage import conclude, folder

from casashell.app.ribbon_shapes import waved
from casashell.io.sheet import write_sheet
from casashell.ribbon import Body, Guide, Ribbon, RibbonSimulation, Scene, simulate
from formulations import ribbon_physics

TURNED = Ribbon(10.0, 1.0, 20, stiffness=1.0, density=0.1, ends="free")
SPEED, H, WEIGHT = 5.0, 0.01, 100.0  # rad/s, s, J
PATTERN, END = 25, 140  # steps at which the strips are shown

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


def turned(mass: str, steps: int = END) -> Run:
    """The strip that is turned at its begin."""

    def normal(t: float) -> np.ndarray:
        return np.array([0.0, -np.sin(SPEED * t), np.cos(SPEED * t)])

    body = Body(TURNED, waved(TURNED, 0.0, 0.5, SLANTED), guides=(Guide((0,), normal, WEIGHT),))
    sim = simulate(Scene((body,), ribbon_physics(), (0.0, 0.0, 0.0)), steps * H, H, mass=mass)
    if len(sim.times) != steps + 1:
        raise SystemExit(sim.message)
    return Run(np.abs(sim.tracks[0].angles).sum(axis=1), sim, np.nan)


def triangles(run: Run, frame: int) -> int:
    """Flat triangles in a row: pairs of quads that taper to nearly a point, on opposite rims."""
    slopes = np.concatenate([[0.0], run.sim.tracks[0].slopes[frame], [0.0]])
    fan = np.diff(slopes) / TURNED.most_turn
    meet = np.abs(fan) > 0.9
    return int((meet[1:] & meet[:-1] & (fan[1:] * fan[:-1] < 0.0)).sum())


def reach(run: Run, frame: int) -> float:
    """Distance of the ends of the centreline over the length."""
    track = run.sim.tracks[0]
    middle = 0.5 * (track.bottom[frame] + track.top[frame])
    return float(np.linalg.norm(middle[-1] - middle[0]) / TURNED.length)


def measure_one(mass: str, speed: float, turns: float = 2.0) -> Run:
    """A strip that spins freely."""
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


def complaints_of_turned(lumped: Run, ours: Run) -> list[str]:
    wrong = []
    if lumped.bent.max() > 1e-12:
        wrong.append(f"lumped mass: bent by {lumped.bent.max():.1e} rad")
    if (count := triangles(ours, PATTERN)) < 12 or reach(ours, PATTERN) < 0.99:
        wrong.append(f"consistent mass: {count} triangles, ends {reach(ours, PATTERN):.2f} L apart")
    if len(ours.bent) > END and reach(ours, END) > 0.7:
        wrong.append(f"consistent mass: ends still {reach(ours, END):.2f} L apart")
    return wrong


def draw(lumped: Run, ours: Run, path: Path) -> None:
    shots = []
    for run, colours, frame in ((lumped, ORANGE, END), (ours, BLUE, PATTERN), (ours, BLUE, END)):
        track = run.sim.tracks[0]
        mass = "mass on the centreline" if run is lumped else "consistent mass"
        label = f"{mass}, {frame * H:.2f} s: angles sum up to {run.bent[frame]:.2f} rad"
        shots.append(Shot(label, [piece(track.bottom[frame], track.top[frame], colours)]))
    made = panels(shots, view=(15.0, 40.0), height=420)
    write_sheet([[panel] for panel in made], path)


if __name__ == "__main__":
    out = folder(__doc__)
    lumped, ours = (turned(mass) for mass in ("lumped", "consistent"))
    draw(lumped, ours, out / "pan11_spinning.png")
    runs = {name: measure_one(*run) for name, run in RUNS.items()}
    lines = [
        f"turned, lumped mass: angles sum up to {lumped.bent.max():.1e} rad at most",
        f"turned, consistent mass: {triangles(ours, PATTERN)} triangles of 19 after {PATTERN * H:g} s, "
        f"ends {reach(ours, PATTERN):.3f} L apart; {reach(ours, END):.3f} L after {END * H:g} s",
    ]
    lines += [
        f"{name}: {run.speed:g} times the threshold of {CRITICAL:.1f} rad/s; angles sum up to "
        f"{run.bent[0]:.4f} rad at first, {run.bent.max():.4f} at most, {run.bent[-1]:.4f} at the end"
        for name, run in runs.items()
    ]
    conclude(lines, complaints(runs) + complaints_of_turned(lumped, ours))
