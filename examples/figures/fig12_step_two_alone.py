"""Ly 2018, Fig. 12: a skirt inverted by Step 2 alone leaves its target when gravity changes by 1 %.

Targets are drapes of the paper's flat ring about a cone, at its bending stiffness 5e-3 J and below.  Step 2
alone starts from r = x_t.  Checked: its answers balance the target, and those that are unstable leave it;
those of Step 1 and Step 2 together are stable and stay.  Found, in mean edges h moved:

    k_theta   Ipopt alone  BFGS alone  BFGS, plain start  both steps
    5e-3 J    0.009        0.009       0.009              0.009       the paper's: all are stable
    3e-3 J    0.73 leaves  0.024       no balance         0.022
    2.5e-3 J  3.0 leaves   0.023       no balance         0.021
    2e-3 J    3.9 leaves   1.7 leaves  no balance         0.021

The paper gives no sizes; with those chosen here its claim holds below its stiffness, not at it.  Tried
besides and not run here: at 5e-3 J skirts 1.1 to 1.4 times as large are stable with all methods, but for
Ipopt alone at 1.3.  With the drape of 5e-3 J as target of softer skirts, Step 2 alone is unstable from
3.5e-3 J down (moved 0.5 to 3.8 h), but both steps end 0.05 to 0.8 h off the target at a barely stable
pose (0.2 to 0.4 h moved; at 2e-3 and 1e-3 J it may not come back).
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from skirt_released import ALONE, BOTH, Variant, invert, target

from casashell.io.camera import framed
from casashell.io.sheet import Panel, write_sheet
from casashell.io.studio import Curves, Layer, Studio
from casashell.io.tessellate import Region, tessellate

BENDS = (5e-3, 3e-3, 2.5e-3, 2e-3)  # J
PURPLE, BLUE = ("#9b59b6", "#6c3483"), ("#4f86c6", "#33598a")


def measure(
    bends: Sequence[float] = BENDS, methods: Sequence[str] = (*ALONE, BOTH)
) -> list[Variant]:
    """Every method on the drape of every bending stiffness."""
    return [invert(scene, method) for scene in map(target, bends) for method in methods]


def complaints(found: Sequence[Variant]) -> list[str]:
    """What the paper says and these do not show; only the plain start may miss the balance."""
    lost = [one for one in found if one.unbalanced > 1e-6]
    alone = [v for v in found if v.method != BOTH and v not in lost and v.eigenvalue < 0.0]
    both = [one for one in found if one.method == BOTH]
    odd = [f"no balance: {one}" for one in lost if one.method != ALONE[2]]
    odd += [f"unstable, but stays: {one}" for one in alone if one.released.stays]
    odd += [f"unstable: {one}" for one in both if one.eigenvalue <= 0.0 or not one.released.stays]
    return odd if alone else [*odd, "Step 2 alone is stable everywhere"]


def draw(alone: Variant, both: Variant, path: Path) -> None:
    """The target, and where the release of either inversion ended."""
    shape, up = alone.scene.target, alone.scene.up_vector
    cone = replace(alone.scene.obstacles[0], length=1.15)
    body = tessellate(cone, Region.around(shape.vertices))
    poses = {"target": shape.vertices}
    for one, name in ((alone, "Step 2 alone"), (both, "Step 1 + Step 2")):
        moved = one.released.moved / one.released.h
        poses[f"{name}, +1 % gravity: moved {moved:.2f} edges"] = one.released.pose
    camera = framed(body.vertices, *poses.values(), up=up, elevation=20)
    hem = Curves(tuple(shape.vertices[[*rim, rim[0]]] for rim in shape.boundary_loops), PURPLE[0])
    panels, size = [], (round(640 * camera.aspect), 640)
    with Studio() as studio:
        for label, pose in poses.items():
            skirt = Layer(shape.moved(pose), *(BLUE if panels else PURPLE), edges=True)
            shot = studio.shoot([Layer(body, "#c9c9c6", behind=True), skirt, hem], camera, size)
            panels.append(Panel("", label, shot))
    write_sheet([panels], path)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("."))
    folder, found = parser.parse_args().out, measure()
    print(*found, sep="\n")
    folder.mkdir(parents=True, exist_ok=True)
    draw(found[-3], found[-1], folder / "fig12_step_two_alone.png")
    if wrong := complaints(found):
        raise SystemExit("\n".join(wrong))
