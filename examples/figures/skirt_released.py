"""The skirt of Ly 2018, Fig. 12, inverted one way or another, and let go under 1 % more gravity."""

from dataclasses import dataclass, replace

import numpy as np

from casashell import solve
from casashell.app.paper_scenes import synthetic_skirt
from casashell.app.scene import Scene
from casashell.engine.assembly import Assembly
from casashell.inverse.nonpenetration import settle
from casashell.inverse.outcome import judged
from casashell.inverse.piece import split
from casashell.inverse.release import Released, release
from casashell.inverse.step_two import step_two

ALONE = ("ipopt", "bfgs", "bfgs, plain start")  # Step 2 from r = x_t at x = x_t
BOTH = "both steps"


@dataclass(frozen=True)
class Variant:
    """One inversion: what is left of balance [f0], lowest eigenvalue [f0/h], and the release."""

    scene: Scene
    method: str
    unbalanced: float
    eigenvalue: float
    released: Released

    def __str__(self) -> str:
        went = self.released
        text = f"{self.scene.material.bend:.1e} J  {self.method:18s} {self.unbalanced:7.0e} f0 "
        text += f"{self.eigenvalue:7.3f} f0/h  moved {went.moved / went.h:6.3f} h, back to "
        return text + f"{went.back / went.h:7.1e} h: {'stays' if went.stays else 'LEAVES'}"


def target(bend: float) -> Scene:
    """The paper's ring, 0.2 to 0.9 m in radius, at rest on the cone without friction."""
    paper = synthetic_skirt()
    ring, place = np.divmod(np.arange(200), 20)
    angle, out = 2.0 * np.pi * (place + 0.5 * (ring % 2)) / 20.0, 0.2 + 0.7 * ring / 9.0
    flat = np.stack([out * np.sin(angle), 0.0 * out, out * np.cos(angle)], axis=1)
    waved = flat + np.outer(1e-3 * ring / 9.0 * np.cos(5.0 * angle), [0.0, 1.0, 0.0])
    scene = replace(paper, material=replace(paper.material, bend=bend))
    cloth = replace(scene, target=paper.target.moved(flat), obstacles=()).problem.energies
    found = settle(Assembly(cloth, 200), flat, scene.obstacles[0], start=waved)
    if not (found.converged and found.stable):
        raise SystemExit(f"the ring of {bend:g} J did not come to rest")
    return replace(scene, target=paper.target.moved(found.pose))


def invert(scene: Scene, method: str) -> Variant:
    """The drape of ``scene`` inverted by one of ``ALONE`` or by ``BOTH``."""
    problem = scene.problem
    (piece,) = split(problem)
    if method == BOTH:
        result = solve(problem, "two-step").require()
        rest, pose, forces = result.rest, result.pose, result.contact_forces
    else:
        how = "ipopt" if method == "ipopt" else "bfgs"
        found = step_two(piece, piece.target, piece.target, method=how, scaled=method == "bfgs")
        rest, pose, forces = found.rest + piece.origin, scene.target.vertices, found.contact_forces
    seen = judged(piece, rest - piece.origin, forces, method, pose=pose - piece.origin)
    released = release(problem, rest, pose, seen.contact_forces)
    return Variant(scene, method, seen.missing, seen.eigenvalue, released)
