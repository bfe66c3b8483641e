"""Pan 2016, Fig. 8: a helix unrolls the same with steps of 0.01 and 0.05 s.

A strip 10 x 0.6 wound on a cylinder of radius 1 with slanted rulings, clamped at one end and let go; no
gravity.  Its size and material are ours, slow enough for a step of 0.05 s: a light strip of paper unrolls
within one such step, and then implicit Euler shows its own damping instead.
Checked: the shapes agree with each other, and with steps of 0.0025 s, to one to three hundredths of the
length while the ends travel a sixth of it, and the error falls with the step.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from ribbon_stage import BLUE, GREEN, ORANGE, Shot, panels, piece
from stage import conclude, folder

from casashell.app.ribbon_shapes import wound
from casashell.io.sheet import write_sheet
from casashell.ribbon import Body, Ribbon, RibbonSimulation, Scene, simulate
from formulations import ribbon_physics

STRIP = Ribbon(10.0, 0.6, 16, stiffness=0.1, density=0.08)
RADIUS, SLOPE = 1.0, 0.5
SECONDS, SHOWN = 1.5, (0.5, 1.0, 1.5)
STEPS = {0.05: ORANGE, 0.01: BLUE, 0.0025: GREEN}  # [s], the last one is the reference


@dataclass(frozen=True)
class Measured:
    """Runs by step; largest distance of centreline points over time from the reference, over L."""

    runs: dict[float, RibbonSimulation]
    errors: dict[float, float]
    apart: float
    travelled: float


def middles(sim: RibbonSimulation, every: float) -> np.ndarray:
    """(F,N+1,3) centrelines at multiples of a time."""
    stride = round(every / (sim.times[1] - sim.times[0]))
    return sim.tracks[0].middle[::stride]


def measure() -> Measured:
    start = wound(STRIP, RADIUS, SLOPE)
    scene = Scene((Body(STRIP, start),), ribbon_physics(), (0.0, 0.0, 0.0))
    # Resampling errors over h^2 grow as steps get short: a reference carries velocities instead.
    last = min(STEPS)
    runs = {
        h: simulate(scene, SECONDS, h, form="velocities" if h == last else "positions")
        for h in STEPS
    }
    for h, sim in runs.items():
        if abs(sim.times[-1] - SECONDS) > 1e-9:
            raise SystemExit(f"step {h}: {sim.message}")
    lines = {h: middles(sim, 0.05) for h, sim in runs.items()}
    reference = lines[min(STEPS)]

    def distance(one: np.ndarray, two: np.ndarray) -> float:
        return float(np.linalg.norm(one - two, axis=-1).max() / STRIP.length)

    errors = {h: distance(line, reference) for h, line in lines.items() if h > min(STEPS)}
    return Measured(
        runs, errors, distance(lines[0.05], lines[0.01]), distance(reference, reference[0])
    )


def complaints(found: Measured) -> list[str]:
    wrong = []
    if found.apart > 0.015 or found.travelled < 10.0 * found.apart:
        wrong.append(f"0.05 and 0.01 s are {found.apart:.1e} L apart of {found.travelled:.2f} L")
    if found.errors[0.01] > 0.7 * found.errors[0.05]:
        wrong.append(f"the error does not fall with the step: {found.errors}")
    return wrong


def draw(found: Measured, path: Path) -> None:
    rows = []
    for h in (0.05, 0.01):
        track, colours = found.runs[h].tracks[0], STEPS[h]
        for t in SHOWN:
            k = round(t / h)
            rows.append(
                Shot(f"step {h:g} s, t = {t:g} s", [piece(track.bottom[k], track.top[k], colours)])
            )
    made = panels(rows, view=(40.0, 25.0), height=420)
    write_sheet([made[:3], made[3:]], path)


if __name__ == "__main__":
    out, found = folder(__doc__), measure()
    draw(found, out / "pan08_helix_steps.png")
    lines = [
        f"step {h:g} s: {e:.2e} L from steps of {min(STEPS):g} s; {found.runs[h].inner[1:].mean():.1f} "
        f"iterations and {found.runs[h].seconds[1:].mean():.3f} s a step"
        for h, e in found.errors.items()
    ]
    lines.append(
        f"0.05 and 0.01 s: {found.apart:.2e} L apart, of {found.travelled:.2f} L travelled"
    )
    conclude(lines, complaints(found))
