"""Pan 2016, Fig. 6: a collision response that resists stretching keeps triangles whole.

Two loops with 20 segments, linked, are thrown apart.  Every step of the motion is corrected twice from
the same start and the same proposed positions: with the stiffness of the edges in the quadratic program,
which is what goes on, and without.  Checked: nothing passes through anything either way, and in every step
with an impact the largest strain of an edge is smaller with stiffness, over all by a factor of two or more.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from ribbon_stage import LINKS, Shot, panels, piece
from stage import conclude, folder

from casashell.app.ribbon_chains import upright
from casashell.app.ribbon_measures import strip_of
from casashell.io.sheet import write_sheet
from casashell.ribbon import Body, Ribbon, Scene, simulate
from casashell.ribbon.collide import Collider
from casashell.ribbon.loops import circle
from casashell.ribbon.strips import to_rims, to_vertices
from formulations import ribbon_physics

LOOP = Ribbon(0.3, 0.012, 20, stiffness=1e-3, density=0.15, ends="loop")
SPEED, THICKNESS, H, STEPS = 4.0, 1e-3, 0.01, 12  # m/s apart, m, s
STIFFNESS = {"without stiffness": 0.0, "with stiffness": 100.0}


@dataclass(frozen=True)
class Corrected:
    """One step: what was proposed, and both corrections (V,3); largest edge strains; faces crossing."""

    proposed: np.ndarray
    made: dict[str, np.ndarray]
    strains: dict[str, float]
    crossings: int


def bodies() -> tuple[Body, ...]:
    """Two round loops, each through the other."""
    state, made = circle(LOOP), []
    radius = LOOP.length / (2.0 * np.pi)
    for side, axis in ((-1.0, (0.0, 1.0, 0.0)), (1.0, (0.0, 0.0, 1.0))):
        placed = upright(LOOP, state, (1.0, 0.0, 0.0), axis)
        shift = np.array([0.75 * side * radius, 0.0, 0.0])
        moved = type(placed)(placed.slopes, placed.angles, placed.frame, placed.origin + shift)
        made.append(Body(LOOP, moved, velocity=(0.5 * side * SPEED, 0.0, 0.0)))
    return tuple(made)


def measure() -> list[Corrected]:
    both = bodies()
    strips = tuple(strip_of(body, THICKNESS) for body in both)
    colliders = {name: Collider(strips, stiffness=k) for name, k in STIFFNESS.items()}
    size, steps = len(strips[0].masses), []
    edges = colliders["with stiffness"].bodies.edges

    def lengths(x: np.ndarray) -> np.ndarray:
        return np.linalg.norm(x[edges[:, 0]] - x[edges[:, 1]], axis=1)

    def collide(start, end):
        before, after = (
            np.concatenate([to_vertices(*rims, "loop") for rims in places])
            for places in (start, end)
        )
        found = {name: one.resolve(before, after).positions for name, one in colliders.items()}
        if any(np.abs(x - after).max() > 1e-9 for x in found.values()):
            strains = {
                name: float(np.abs(lengths(x) / lengths(after) - 1.0).max())
                for name, x in found.items()
            }
            crossing = sum(len(c.crossings(found[name])) for name, c in colliders.items())
            steps.append(Corrected(after, found, strains, crossing))
        chosen = found["with stiffness"]
        return [np.stack(to_rims(x, "loop")) for x in (chosen[:size], chosen[size:])]

    scene = Scene(both, ribbon_physics(), (0.0, 0.0, 0.0), collide=collide)
    sim = simulate(scene, H * STEPS, H)
    if len(sim.times) != STEPS + 1:
        raise SystemExit(sim.message)
    return [step for step in steps if max(step.strains.values()) > 0.0]


def complaints(steps: list[Corrected]) -> list[str]:
    soft, stiff = (np.array([step.strains[name] for step in steps]) for name in STIFFNESS)
    wrong = []
    if len(steps) == 0 or any(step.crossings for step in steps):
        return [f"{len(steps)} steps with impacts, {sum(s.crossings for s in steps)} crossings"]
    if np.any(stiff > soft):
        wrong.append(f"stiffness stretches more in {(stiff > soft).sum()} of {len(steps)} steps")
    if soft.max() < 2.0 * stiff.max():
        wrong.append(f"largest strain {soft.max():.2e} without, {stiff.max():.2e} with stiffness")
    return wrong


def draw(steps: list[Corrected], path: Path) -> None:
    worst = max(steps, key=lambda step: step.strains["without stiffness"])
    shots, half = [], len(worst.proposed) // 2
    for name, x in worst.made.items():
        loops = [
            piece(*to_rims(part, "loop"), LINKS[k]) for k, part in enumerate((x[:half], x[half:]))
        ]
        shots.append(Shot(f"{name}: edges strained by {100 * worst.strains[name]:.1f} %", loops))
    write_sheet([panels(shots, view=(25.0, 25.0), height=620)], path)


if __name__ == "__main__":
    out, steps = folder(__doc__), measure()
    lines = [
        "edges strained by " + ", ".join(f"{100 * s:.2f} % {n}" for n, s in step.strains.items())
        for step in steps
    ]
    if steps:
        draw(steps, out / "pan06_stiff_correction.png")
    conclude(lines, complaints(steps))
