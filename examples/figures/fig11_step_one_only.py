"""Ly 2018, Fig. 11: a book page inverted with contacts as fixed points only (Step 1, no Step 2).

The page is that of Fig. 1, enlarged 1.5 times, on slippery pages: mu = 0.1.  (With the paper's 0.4 the
forces of Step 1 leave their cones at the corners only, and the page moves by 1e-4 of its size; Step 1 knows
of no friction.)  Checked: with friction the page of Step 1 slides and sags, that of both steps stays; with
fixed points it stays as well, but wind cannot move them, while the page of both steps slides.
"""

from dataclasses import replace

import numpy as np
from stage import Pose, conclude, folder, panels

from casashell import Result, Simulation, simulate, solve
from casashell.app.paper_scenes import book_page
from casashell.app.resimulation_scenes import Spell
from casashell.app.scene import Scene
from casashell.inverse.piece import split
from casashell.inverse.pulled import Pulled
from casashell.inverse.step_one import StepOne
from casashell.io.sheet import write_sheet

ENLARGED, FRICTION, SECONDS = 1.5, 0.1, 1.0
WIND = Spell((5.0, 0.0, 0.0), onset=0.2)


def measure() -> tuple[Scene, Result, dict[str, Simulation]]:
    """The page, the result of both steps, and Step 1 with friction, pinned, and pinned in the wind."""
    paper = book_page()
    (pages,) = paper.obstacles
    scene = replace(
        paper,
        target=paper.target.moved(ENLARGED * paper.target.vertices),
        obstacles=(replace(pages, friction=FRICTION),),
    )
    both = solve(scene.problem).require()
    (piece,) = split(scene.problem)
    found = StepOne(Pulled(piece, 0.0), piece.held, method="newton").solve(piece.target)
    one = replace(both, rest=found.rest + piece.origin, contact_forces=0.0 * both.contact_forces)
    touching = np.union1d(both.contacts.vertices, scene.pinned)
    fixed = replace(scene, pinned=tuple(touching.tolist()), obstacles=())
    held = replace(one, pinned=touching, contacts=fixed.problem.contacts, obstacles=())
    held = replace(held, contact_forces=np.zeros((0, 3)))
    runs = {
        "friction": simulate(one, SECONDS),
        "fixed": simulate(held, SECONDS),
        "both steps": simulate(both, SECONDS),
        "fixed, wind": simulate(held, 0.5, wind=WIND),
        "both steps, wind": simulate(both, 0.5, wind=WIND),
    }
    return scene, both, runs


def complaints(result: Result, runs: dict[str, Simulation]) -> list[str]:
    """What the paper says and these do not show."""
    ids = result.contacts.vertices
    moved = {
        name: float(np.linalg.norm(run.positions[:, ids] - run.positions[0, ids], axis=2).max())
        / run.size
        for name, run in runs.items()
    }
    wrong = [] if runs["friction"].drift[-1] > 0.01 else ["Step 1 alone holds with friction"]
    wrong += [] if runs["fixed"].drift.max() < 1e-9 else ["Step 1 does not hold with fixed points"]
    wrong += [] if runs["both steps"].drift.max() < 1e-9 else ["both steps do not hold"]
    wrong += [] if moved["fixed, wind"] == 0.0 else ["fixed points moved"]
    wrong += [] if runs["fixed, wind"].drift.max() > 0.01 else ["the wind does nothing"]
    wrong += [] if moved["both steps, wind"] > 0.01 else ["the page does not slide"]
    return wrong


if __name__ == "__main__":
    out, (scene, both, runs) = folder(__doc__), measure()
    friction, _, both_steps, wind, _ = runs.values()
    poses = [
        Pose("target", scene.target.vertices),
        Pose(f"Step 1 only, friction: after {SECONDS:g} s", friction.positions[-1]),
        Pose("Step 1 only, fixed points, wind", wind.positions[-1]),
        Pose(f"both steps, friction: after {SECONDS:g} s", both_steps.positions[-1]),
    ]
    pictures = panels(scene, poses, height=440)
    write_sheet([pictures[:2], pictures[2:]], out / "fig11_step_one_only.png", shrink=0.75)
    lines = [f"{name}: drift {run.drift[-1]:.2e}" for name, run in runs.items()]
    conclude(lines, complaints(both, runs))
