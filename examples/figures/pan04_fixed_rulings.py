"""Pan 2016, Fig. 4: rulings have to move; kept in place, or moved now and then, they lock the ribbon.

The end of a strip 10 x 1, clamped at its begin, is turned about its length, 2.25 degrees a step.
Three runs: rulings stay across the strip; rulings move in every tenth step only; rulings move always.
Checked: straight rulings cannot turn the end at all (closed form: bending about the y axis leaves every
normal perpendicular to it); rulings moved now and then lag behind; moving ones follow.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from ribbon_stage import BLUE, GREEN, ORANGE, Shot, panels, piece
from stage import conclude, folder

from casashell.app.ribbon_shapes import waved
from casashell.io.sheet import write_sheet
from casashell.ribbon import Body, Guide, Ribbon, Rule, Scene
from casashell.ribbon.chain import Strip, reconstruct
from casashell.ribbon.dynamics import Stepper
from casashell.ribbon.parallel import Workers
from formulations import ribbon_physics

STRIP = Ribbon(10.0, 1.0, 20, stiffness=1.0, density=0.1)
H, STEPS, TURNING = 0.05, 39, 40  # time step [s]; steps made, and those of a right angle
EVERY = 10  # steps between those in which the rulings of the second run move
STIFF = 1e8  # weight of rulings that stay: no energy here moves them by 1e-3
GOAL = 90.0 * np.arange(STEPS + 1) / TURNING  # [degrees]
RUNS = {"rulings stay": 0, f"rulings move every {EVERY} steps": EVERY, "rulings move always": 1}


@dataclass(frozen=True)
class Run:  # end shape, over time angle of the end [degrees] and centreline, largest motion of a slope
    shape: Strip
    turned: np.ndarray
    middles: np.ndarray
    moved: float


def wanted(t: float) -> np.ndarray:
    angle = 0.5 * np.pi * t / (H * TURNING)
    return np.array([0.0, -np.sin(angle), np.cos(angle)])


def measure_one(every: int, steps: int = STEPS) -> Run:
    physics = ribbon_physics()
    # Bent a little: a flat strip has no rulings to move.  Unslanted at first.
    start = waved(STRIP, 0.02, 2.5)
    guide = Guide((18, 19), wanted, 100.0)
    turned, middles, frozen, pasts = [], [], start.slopes, ()
    with Workers(1) as workers:
        for k in range(steps + 1):
            kept = replace(STRIP, regulariser=STIFF, target_rulings=frozen)
            ribbon = STRIP if every and k % every == 0 else kept
            scene = Scene((Body(ribbon, start, guides=(guide,)),), physics, (0.0, 0.0, 0.0))
            stepper = Stepper(scene, Rule(), workers, None)
            pasts = stepper.step(pasts, (k - 1) * H, H).pasts if k else stepper.begin(H)
            shape = reconstruct(ribbon, pasts[0].state)
            if every and k % every == 0:
                frozen = pasts[0].state.slopes
            middles.append(shape.middle)
            turned.append(np.degrees(np.arctan2(-shape.normals[-1, 1], shape.normals[-1, 2])))
    moved = float(np.abs(shape.slopes[1:-1] - start.slopes).max())
    return Run(shape, np.array(turned), np.array(middles), moved)


def deviation(run: Run, from_one: Run) -> float:
    """Largest distance of centreline points in any step, over the length."""
    return float(np.linalg.norm(run.middles - from_one.middles, axis=2).max() / STRIP.length)


def complaints(runs: list[Run]) -> list[str]:
    stay, rarely, always = runs
    side = float(np.abs(stay.shape.normals[:, 1]).max())
    goal, apart = GOAL[-1], [deviation(run, always) for run in (stay, rarely)]
    checks = {
        f"the end with fixed rulings turns out of its plane by {side:.1e}": side > 1e-2,
        f"the end with moving rulings turned by {always.turned[-1]:.1f} degrees, not {goal:.1f}": (
            np.abs(always.turned - GOAL).max() > 2.0
        ),
        f"rulings moved now and then give the same shape to {apart[1]:.1e} L": apart[1] < 0.02,
        f"rulings that stay give the same shape to {apart[0]:.1e} L": apart[0] < 0.02,
    }
    return [text for text, wrong in checks.items() if wrong]


def draw(runs: list[Run], path: Path) -> None:
    shots = []
    for (label, _), run, colours in zip(RUNS.items(), runs, (ORANGE, GREEN, BLUE)):
        shape, angle = run.shape, abs(run.turned[-1])
        text = f"{label}: end turned by {angle:.0f} degrees"
        shots.append(Shot(text, [piece(shape.bottom, shape.top, colours)]))
    write_sheet([[panel] for panel in panels(shots, view=(25.0, 25.0), height=380)], path)


if __name__ == "__main__":
    out, runs = folder(__doc__), [measure_one(every) for every in RUNS.values()]
    draw(runs, out / "pan04_fixed_rulings.png")
    lines = [
        f"{name}: end turned by {run.turned[19]:.1f} of {GOAL[19]:.1f}, {run.turned[-1]:.1f} of "
        f"{GOAL[-1]:.1f} degrees; slopes moved by {run.moved:.1e}, "
        f"up to {deviation(run, runs[-1]):.1e} L away"
        for name, run in zip(RUNS, runs)
    ]
    conclude(lines, complaints(runs))
