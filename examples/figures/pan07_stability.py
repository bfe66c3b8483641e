"""Pan 2016, Fig. 7: extreme torsion and extreme dragging.

Torsion: the built-in scene, a strip 10 x 1, pulled and twisted at its end by one turn.
Dragging: a loop 10 x 1 pulled apart at opposite points by forces of 500 D W / L^2.
Checked: every step is made, whole; lengths stay to rounding; hard steps take at most ten times the
iterations of the mean one; the twisted end follows its guide, a spring, to 5 degrees; the loop at rest
has the curvature sqrt(F / (D W)) where it is pulled (closed form of a long loop), within 3 %.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from ribbon_stage import Shot, panels, pieces, write_grid
from stage import conclude, folder

from casashell.app.ribbon_measures import isometry_error
from casashell.app.ribbon_scenes import builtin_setup
from casashell.ribbon import Body, PointLoad, Ribbon, RibbonSimulation, Scene, Setting, simulate
from casashell.ribbon.loops import circle
from formulations import ribbon_physics

LOOP = Ribbon(10.0, 1.0, 60, stiffness=1.0, density=0.1, ends="loop")
FORCE = 500.0 * LOOP.stiffness * LOOP.width / LOOP.length**2  # [N]
H, STEPS, PULLING = 0.05, 100, 40  # time step [s], steps, and those in which the force grows


@dataclass(frozen=True)
class Run:  # a simulation and how it ended
    sim: RibbonSimulation
    off: float  # lengths, relative
    hardest: float  # iterations of the hardest step over those of the mean one

    @staticmethod
    def of(sim: RibbonSimulation, steps: int) -> "Run":
        if len(sim.times) != steps + 1 or sim.parts.max() > 1:
            raise SystemExit(f"not every step was made whole: {sim.message}")
        inner = sim.inner[1:, 0]
        off = float(isometry_error(sim.tracks[0]).max())
        return Run(sim, off, float(inner.max() / inner.mean()))


def torsion() -> tuple[Run, float]:
    """The run, and how far the end's normal is from its guide [degrees]."""
    setup = builtin_setup("torsion")
    # Contact would leave the developable shapes for a step; the strip does not need it here.
    sim = simulate(replace(setup.scene, thickness=0.0), setup.seconds, setup.step)
    run, track = Run.of(sim, setup.steps), sim.tracks[0]
    normal = np.cross(
        track.middle[-1, -1] - track.middle[-1, -2], track.top[-1, -1] - track.bottom[-1, -1]
    )
    guide = setup.scene.bodies[0].guides[0]
    wanted = np.asarray(guide.normal(setup.seconds) if callable(guide.normal) else guide.normal)
    angle = np.degrees(np.arccos(np.clip(normal @ wanted / np.linalg.norm(normal), -1.0, 1.0)))
    return run, float(angle)


def dragging() -> tuple[Run, float]:
    """The run, and the largest curvature at its end over that of a long loop."""

    def pulled(t: float) -> Setting:
        force = FORCE * min(t / (H * PULLING), 1.0)
        places = ((0.0, force), (0.5 * LOOP.length, -force))  # it hangs below its begin
        return Setting(loads=tuple(PointLoad(s, 0.0, (0.0, 0.0, f)) for s, f in places))

    scene = Scene((Body(LOOP, circle(LOOP), pulled),), ribbon_physics(), (0.0, 0.0, 0.0))
    run = Run.of(simulate(scene, H * STEPS, H), STEPS)
    track = run.sim.tracks[0]
    curvature = np.abs(track.angles[-1] * np.sqrt(1.0 + track.slopes[-1] ** 2)).max() / LOOP.segment
    return run, float(curvature / np.sqrt(FORCE / (LOOP.stiffness * LOOP.width)))


def complaints(twist: Run, angle: float, loop: Run, curvature: float) -> list[str]:
    checks = {
        f"lengths are off by {max(twist.off, loop.off):.1e}": max(twist.off, loop.off) > 1e-12,
        f"the twisted end is {angle:.1f} degrees from its guide": angle > 5.0,
        f"the loop's curvature is {curvature:.3f} of the long loop's": abs(curvature - 1.0) > 0.03,
        "a step takes ten times the mean iterations": max(twist.hardest, loop.hardest) > 10.0,
    }
    return [text for text, wrong in checks.items() if wrong]


def draw(twist: Run, loop: Run, path: Path) -> None:
    turns, pulls = (0.25, 0.5, 1.0), (0, PULLING // 4, STEPS)
    frames = [*(round(4.0 * t / twist.sim.times[1]) for t in turns[:-1]), -1]
    twists = [
        Shot(f"twisted by {t:g} of a turn", pieces(twist.sim, k)) for t, k in zip(turns, frames)
    ]
    shown = [FORCE * min(k / PULLING, 1.0) for k in pulls]
    loops = [Shot(f"pulled by {f:.3g} N", pieces(loop.sim, k)) for f, k in zip(shown, pulls)]
    sides = [panels(shots, view=(25.0, 20.0), height=520) for shots in (twists, loops)]
    write_grid(list(zip(*sides)), (620, 330), path)


if __name__ == "__main__":
    out = folder(__doc__)
    (twist, angle), (loop, curvature) = torsion(), dragging()
    draw(twist, loop, out / "pan07_stability.png")
    lines = [
        f"{name}: lengths off by {run.off:.1e}; {run.sim.inner[1:].mean():.1f} iterations a step, at "
        f"most {run.sim.inner.max():.0f}; {run.sim.seconds[1:].mean():.3f} s a step"
        for name, run in (("torsion", twist), ("dragging", loop))
    ]
    lines.append(f"twisted end {angle:.2f} degrees from its guide")
    lines.append(f"loop under {FORCE:g} N: {curvature:.4f} of the curvature of a long loop")
    conclude(lines, complaints(twist, angle, loop, curvature))
