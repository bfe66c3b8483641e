"""Ly 2018, Fig. 5: forces at the waist of a skirt after Step 1 and after Step 2, seen from above.

Step 1 holds the waist line, whatever forces that takes; Step 2 changes the natural shape until every
force lies strictly inside its friction cone.  Checked: after Step 1 forces lie outside their cones or pull
at the body; after Step 2 none does, and the target is in balance still.  Found, of 40: 40 outside and 40
pulling with up to 1.6 f0 after Step 1; none after Step 2, mu f_N - |f_T| at least 0.18 f0.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from casashell.app.builtin import skirt
from casashell.app.scene import Scene
from casashell.contact import cone
from casashell.inverse.outcome import judged
from casashell.inverse.piece import Piece, split
from casashell.inverse.pulled import Pulled
from casashell.inverse.step_one import StepOne
from casashell.inverse.step_two import step_two
from casashell.io.camera import framed
from casashell.io.sheet import Panel, write_sheet
from casashell.io.studio import Curves, Layer, Studio
from casashell.io.tessellate import arrows


@dataclass(frozen=True)
class Forces:
    """Contact forces (C,3), mu f_N - |f_T| and f_N (C,), largest free force at the target; in f0."""

    forces: np.ndarray
    margins: np.ndarray
    normal: np.ndarray
    free_force: float


def forces(piece: Piece, rest: np.ndarray) -> Forces:
    """What holds the target: of every contact the force at its vertex."""
    contacts = piece.contacts
    found = judged(piece, rest, 0.0 * contacts.normals, "waist")
    felt = found.contact_forces / piece.f0
    room = cone.margin(felt, contacts.normals, contacts.friction)
    return Forces(felt, room, cone.split(felt, contacts.normals)[0], found.missing)


def measure() -> tuple[Scene, list[Forces]]:
    """The skirt, and its forces after Step 1 and after Step 2."""
    scene = skirt()
    (piece,) = split(scene.problem)
    one = StepOne(Pulled(piece, 0.0), piece.held, method="newton").solve(piece.target)
    two = step_two(piece, piece.target, one.rest)
    return scene, [forces(piece, one.rest), forces(piece, two.rest)]


def draw(scene: Scene, steps: list[Forces], path: Path) -> None:
    """Normalised forces, red where outside their cone."""
    tails = scene.target.vertices[scene.problem.contacts.vertices]
    size = 0.45 * float(np.ptp(tails[:, 0]))
    waist = Curves((tails[[*range(len(tails)), 0]],), "#23272e", 2.0)
    camera = framed(scene.target.vertices, up=scene.up_vector, azimuth=0, elevation=89.9)
    panels = []
    with Studio() as studio:
        for step in steps:
            unit = step.forces / np.linalg.norm(step.forces, axis=1, keepdims=True)
            outside = step.margins < 0.0
            layers = [Layer(scene.target, "#dbe4ee", "#cfd8e3"), waist]
            for of, colour in ((outside, "#d0021b"), (~outside, "#2f8f5b")):
                drawn = arrows(tails[of] + [0, 0.01, 0], size * unit[of], 0.035 * size)
                layers.append(Layer(drawn, colour, bright=True))
            counts = f"{outside.sum()} of {len(tails)} outside, {(step.normal < 0).sum()} pull"
            shot = studio.shoot(layers, camera, (680, 680))
            panels.append(Panel("", f"after step {len(panels) + 1}: {counts}", shot))
    write_sheet([panels], path)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("."))
    folder, (scene, steps) = parser.parse_args().out, measure()
    for n, step in enumerate(steps, start=1):
        print(f"{n}: {(step.margins < 0).sum()} outside, {(step.normal < 0).sum()} pull, ", end="")
        print(f"margin >= {step.margins.min():.2f} f0, f_N >= {step.normal.min():.2f} f0, ", end="")
        print(f"free force {step.free_force:.1e} f0")
    folder.mkdir(parents=True, exist_ok=True)
    draw(scene, steps, folder / "fig05_forces.png")
    one, two = steps
    if one.margins.min() >= 0 or min(*two.margins, *two.normal) <= 0 or two.free_force > 1e-6:
        raise SystemExit("it is not Step 2 that brings the forces into their cones")
