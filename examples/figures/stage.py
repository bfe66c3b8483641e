"""What the figures of moving shells share: poses on obstacles, side by side, and how a figure ends."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from casashell.app.scene import Scene
from casashell.dynamics.motion import RigidMotion
from casashell.io.camera import framed
from casashell.io.colours import OBSTACLE, SHELL, SHELL_INSIDE
from casashell.io.sheet import Panel
from casashell.io.studio import Curves, Dots, Layer, Studio
from casashell.io.tessellate import Region, Surface, sunk, tessellate


@dataclass(frozen=True, eq=False)
class Pose:
    """A pose (V,3) m, what to call it, when it is (for bodies that move), and its colours.

    dots (n,3) are red; of ``outline`` (V,3), another pose, the rims are drawn.
    """

    label: str
    points: np.ndarray
    time: float = 0.0
    colours: tuple[str, str] = (SHELL, SHELL_INSIDE)
    dots: np.ndarray | None = None
    outline: np.ndarray | None = None


def panels(
    scene: Scene,
    poses: Sequence[Pose],
    *,
    motion: RigidMotion | None = None,
    view: tuple[float, float] = (28.0, 14.0),
    height: int = 560,
    bodies: bool = True,
) -> list[Panel]:
    """One picture a pose, all with one camera (azimuth, elevation in degrees) that sees every pose."""
    clouds = [pose.points for pose in poses]
    azimuth, elevation = view
    camera = framed(*clouds, up=scene.up_vector, azimuth=azimuth, elevation=elevation)
    size = (2 * round(0.5 * height * camera.aspect), height)
    region = Region.around(*clouds, scale=1.1)
    made = [tessellate(one, region) for one in scene.obstacles] if bodies else []
    depth = 0.1 * float(scene.target.mean_edge_length)
    drawn = []
    with Studio() as studio:
        for pose in poses:
            turn, shift = np.eye(3), np.zeros(3)
            if motion is not None:
                turn, shift = motion.at(pose.time)
            layers: list[Layer | Dots | Curves] = []
            for body in made:
                moved = sunk(Surface(body.vertices @ turn.T + shift, body.faces), depth)
                layers.append(Layer(moved, OBSTACLE, behind=True))
            layers.append(Layer(scene.target.moved(pose.points), *pose.colours, edges=True))
            if pose.dots is not None:
                layers.append(Dots(pose.dots, "#d0021b", 11.0))
            if pose.outline is not None:
                rims = [pose.outline[[*rim, rim[0]]] for rim in scene.target.boundary_loops]
                layers.append(Curves(tuple(rims), "#9b59b6", 2.0))
            drawn.append(Panel("", pose.label, studio.shoot(layers, camera, size)))
    return drawn


def folder(doc: str | None) -> Path:
    """The folder of ``--out``, made if it is not there."""
    parser = argparse.ArgumentParser(description=doc)
    parser.add_argument("--out", type=Path, default=Path("."))
    made: Path = parser.parse_args().out
    made.mkdir(parents=True, exist_ok=True)
    return made


def conclude(lines: Sequence[str], wrong: Sequence[str]) -> None:
    """Print what was found; SystemExit with what is not as claimed."""
    print(*lines, sep="\n")
    if wrong:
        raise SystemExit("\n".join(wrong))
