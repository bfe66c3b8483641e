"""Ly 2018, Fig. 10: target, stretch and bending of the natural shapes of the nine examples.

Checked: every example is certified with its material of Table 1; compression prevails in most of them, and
some parts of Beret, Puff Sleeve and ClothCap Shirt are dilated.  Real garments are skipped where there is
no folder of them (``--data``), and named.
"""

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from casashell import Result, solve
from casashell.app.resimulation_scenes import Example, examples
from casashell.app.scene import Scene
from casashell.io.camera import framed
from casashell.io.colours import SHELL, SHELL_INSIDE, bending_map, stretch_map
from casashell.io.placing import placed
from casashell.io.sheet import ColourBar, Panel, write_sheet
from casashell.io.studio import Layer, Studio
from casashell.strain import Strain, strain

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
WIDE = 1.5  # of a picture
DILATED = ("Beret", "Puff Sleeve", "ClothCap Shirt")


@dataclass(frozen=True, eq=False)
class Natural:  # an example, and how its natural shape differs from the target
    title: str
    scene: Scene
    result: Result
    strains: Strain

    def __str__(self) -> str:
        short, long = np.quantile(self.strains.stretch, [0.01, 0.99])
        text = f"{self.title:16s} edges {100 * short:+6.2f} % .. {100 * long:+6.2f} %, mean "
        text += f"{100 * self.strains.stretch.mean():+6.2f} %, hinges up to "
        return text + f"{np.degrees(np.quantile(self.strains.bend, 0.99)):5.2f} degrees"


def inverted(example: Example) -> Natural:
    scene = example.make()
    result = solve(scene.problem).require()
    return Natural(example.title, scene, result, strain(result.target, result.rest))


def complaints(found: list[Natural]) -> list[str]:
    squeezed = sum(one.strains.stretch.mean() < 0.0 for one in found)
    wrong = [] if 2 * squeezed > len(found) else ["compression does not prevail"]
    for one in found:
        if one.title in DILATED and np.quantile(one.strains.stretch, 0.99) < 1e-3:
            wrong.append(f"{one.title}: nothing is dilated")
    return wrong


def row(studio: Studio, one: Natural, height: int = 300) -> list[Panel]:
    """Target, stretch and bending of one example, these two on the natural shape."""
    target, strains = one.scene.target, one.strains
    natural = target.moved(placed(target, one.result.rest))
    camera = framed(target.vertices, natural.vertices, up=one.scene.up_vector)
    back = max(1.0, camera.aspect / WIDE)  # far enough off to see all of what is wider
    place = camera.focus + back * (camera.position - camera.focus)
    camera = replace(camera, position=place, size=back * camera.size)
    stretch, bend = stretch_map(strains.stretch_vertices), bending_map(strains.bend_vertices)
    layers = [Layer(target, SHELL, SHELL_INSIDE, edges=True)]
    layers += [Layer(natural, stretch.rgb(strains.stretch_vertices))]
    layers += [Layer(natural, bend.rgb(strains.bend_vertices))]
    bars = [None, ColourBar(stretch, "stretch", "%", 100), ColourBar(bend, "bend", "deg", 57.3)]
    shots = [studio.shoot([layer], camera, (round(WIDE * height), height)) for layer in layers]
    return [Panel("", *drawn) for drawn in zip((one.title, "", ""), shots, bars)]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("."))
    parser.add_argument("--data", type=Path, default=DATA, help="folder of real garments")
    given = parser.parse_args()
    chosen, skipped = examples(given.data)
    found = [inverted(one) for one in chosen]
    print(*found, *skipped, sep="\n")
    given.out.mkdir(parents=True, exist_ok=True)
    with Studio() as studio:
        rows = [row(studio, one) for one in found]
    for name, some in {"fig10_strains": rows[:5], "fig10_strains_more": rows[5:]}.items():
        if some:
            write_sheet(some, given.out / f"{name}.png")
    if wrong := complaints(found):
        raise SystemExit("\n".join(wrong))
