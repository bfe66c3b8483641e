"""Ly 2018, Fig. 7: Synthetic Skirt inverted with other materials, and what wind does to each.

Stretching stiffness halved, or bending stiffness doubled.  Skirt and cone are 0.7 times as large as in
Fig. 6: at that size half the stretching stiffness cannot carry the skirt.  Checked: with every material
the target is certified and does not move without wind, to rounding; the same wind moves each differently.
"""

from dataclasses import replace

import numpy as np
from stage import Pose, conclude, folder, panels

from casashell import Simulation, simulate, solve
from casashell.app.paper_scenes import synthetic_skirt
from casashell.app.resimulation_scenes import Spell
from casashell.app.scene import Scene
from casashell.io.sheet import write_sheet

CHANGES = {
    "k_L = 3 N, k_theta = 5 mJ": {},
    "k_L halved": {"stretch": 1.5},
    "k_theta doubled": {"bend": 1e-2},
}
SIZE = 0.7
WIND, SECONDS, SHOWN = Spell((3.0, 0.0, 0.0), onset=0.2), 1.0, 0.5


def measure() -> tuple[Scene, dict[str, tuple[Simulation, Simulation]]]:
    """The scene, and for every material the skirt at rest and in the wind."""
    scene, found = synthetic_skirt(), {}
    (cone,) = scene.obstacles
    smaller = replace(cone, apex=tuple(SIZE * np.array(cone.apex)))
    target = scene.target.moved(SIZE * scene.target.vertices)
    scene = replace(scene, target=target, obstacles=(smaller,))
    for name, change in CHANGES.items():
        other = replace(scene, material=replace(scene.material, **change))
        result = solve(other.problem).require()
        found[name] = simulate(result, SECONDS), simulate(result, SECONDS, wind=WIND)
    return scene, found


def apart(found: dict[str, tuple[Simulation, Simulation]]) -> dict[str, float]:
    """How far each material is from the first, in the size of the skirt: the largest of all frames."""
    first = next(iter(found.values()))[1]
    return {
        name: float(np.linalg.norm(blown.positions - first.positions, axis=2).max() / first.size)
        for name, (_, blown) in found.items()
    }


def complaints(found: dict[str, tuple[Simulation, Simulation]]) -> list[str]:
    """What the paper says and these do not show."""
    wrong = [
        f"{name}: moves by {still.drift.max():.1e} without wind"
        for name, (still, _) in found.items()
        if still.drift.max() > 1e-9
    ]
    _, soft, stiff = apart(found).values()
    return wrong + (["the wind treats all alike"] if min(soft, stiff) < 0.02 else [])


if __name__ == "__main__":
    out, (scene, found) = folder(__doc__), measure()
    away = apart(found)
    lines = [
        f"{name}: drift {still.drift.max():.1e} at rest, {blown.drift.max():.2f} in the wind, "
        f"{away[name]:.3f} away from the first"
        for name, (still, blown) in found.items()
    ]
    frame = round(60 * SHOWN)
    poses = [
        Pose(f"{name}, after {SHOWN:g} s of wind", blown.positions[frame])
        for name, (_, blown) in found.items()
    ]
    write_sheet([panels(scene, poses)], out / "fig07_materials.png", shrink=0.6)
    conclude(lines, complaints(found))
