"""Headless pictures of a result: target, contact forces, natural shape, its stretch and bending."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from casashell.io.camera import Camera, framed
from casashell.io.colours import (
    NATURAL,
    NATURAL_INSIDE,
    OBSTACLE,
    PINNED,
    SHELL,
    SHELL_INSIDE,
    TOO_MUCH,
    ColourMap,
    bending_map,
    friction_map,
    stretch_map,
)
from casashell.io.forces import BEYOND, ForceArrows, force_arrows
from casashell.io.placing import placed
from casashell.io.sheet import ColourBar, Panel, write_panel, write_sheet
from casashell.io.studio import Curves, Dots, Layer, PicturesUnavailable, Studio
from casashell.io.tessellate import Region, tessellate
from casashell.mesh import TriMesh
from casashell.result import Result
from casashell.strain import strain
from casashell.typing import AnyArray, FloatArray

__all__ = ["PicturesUnavailable", "write_pictures"]

# Pixels of the square with the same area as a panel.
_PANEL: Final = 780


@dataclass(frozen=True, eq=False)
class _Scene:
    """What all pictures of one result share."""

    result: Result
    natural: TriMesh
    camera: Camera
    size: tuple[int, int]
    obstacles: tuple[Layer, ...]
    arrows: ForceArrows

    @property
    def pins(self) -> Dots:
        return Dots(self.result.target.vertices[self.result.pinned], PINNED, 13.0)


def write_pictures(
    result: Result, directory: Path, *, up: Sequence[float] = (0.0, 1.0, 0.0)
) -> tuple[Path, ...]:
    """Write target, forces, natural, compare, stretch, bending and overview ``.png``; return paths.

    directory  is made if it is not there
    up         the scene's up axis, as in the input

    PicturesUnavailable (an ImportError): pyvista or matplotlib is missing; nothing is written.
    ValueError: ``up`` has no direction, or the natural shape is not finite.
    """
    if not np.all(np.isfinite(result.rest)):
        bad = int(np.flatnonzero(~np.isfinite(result.rest).all(axis=1))[0])
        raise ValueError(f"cannot draw the natural shape: vertex {bad} is not finite")
    scene = _scene(result, up)
    with Studio() as studio:
        panels = [
            _target(studio, scene),
            _forces(studio, scene),
            _compare(studio, scene),
            _natural(studio, scene),
            *_strains(studio, scene),
        ]
    folder = Path(directory)
    folder.mkdir(parents=True, exist_ok=True)
    paths = [write_panel(panel, folder / f"{panel.name}.png") for panel in panels]
    paths.append(write_sheet([panels[:3], panels[3:]], folder / "overview.png", shrink=0.75))
    return tuple(paths)


def _scene(result: Result, up: Sequence[float]) -> _Scene:
    target = result.target
    used = np.unique(target.faces)
    drawn, natural = force_arrows(result), placed(target, result.rest)
    camera = framed(target.vertices[used], natural[used], drawn.surface.vertices, up=up)
    width = round(_PANEL * math.sqrt(camera.aspect))
    region = Region.around(target.vertices[used], scale=1.25)
    obstacles = tuple(
        Layer(tessellate(obstacle, region), OBSTACLE, behind=True) for obstacle in result.obstacles
    )
    return _Scene(
        result,
        target.moved(natural),
        camera,
        (width, round(width / camera.aspect)),
        obstacles,
        drawn,
    )


def _target(studio: Studio, scene: _Scene) -> Panel:
    shell = Layer(scene.result.target, SHELL, SHELL_INSIDE, edges=True)
    picture = studio.shoot([*scene.obstacles, shell, scene.pins], scene.camera, scene.size)
    return Panel("target", _with_pins("target", scene), picture)


def _natural(studio: Studio, scene: _Scene) -> Panel:
    shell = Layer(scene.natural, NATURAL, NATURAL_INSIDE, edges=True)
    return Panel("natural", "natural shape", studio.shoot([shell], scene.camera, scene.size))


def _compare(studio: Studio, scene: _Scene) -> Panel:
    target, natural = scene.result.target, scene.natural
    layers: list[Layer | Dots | Curves] = [
        Layer(natural, NATURAL, NATURAL_INSIDE),
        Layer(target, SHELL, opacity=0.22),
        Curves(_rims(target), "#2f5f93"),
        Curves(_rims(natural), "#8a5a14"),
    ]
    picture = studio.shoot(layers, scene.camera, scene.size)
    return Panel("compare", "natural shape (orange), target (blue)", picture)


def _forces(studio: Studio, scene: _Scene) -> Panel:
    drawn = scene.arrows
    colours = friction_map(drawn.use)
    per_contact = colours.rgb(np.minimum(drawn.use, 1.0))
    per_contact[drawn.use > BEYOND] = _hex(TOO_MUCH)
    contacts = scene.result.target.vertices[scene.result.contacts.vertices]
    layers: list[Layer | Dots | Curves] = [
        *scene.obstacles,
        Layer(scene.result.target, "#e4eaf1", "#cfd8e3", edges=True),
        Layer(drawn.surface, per_contact[drawn.owner], bright=True),
        Dots(contacts, "#23272e", 4.0),
        scene.pins,
    ]
    picture = studio.shoot(layers, scene.camera, scene.size)
    bar = ColourBar(colours, "friction in use", "%", 100.0) if len(drawn.use) else None
    return Panel("forces", drawn.legend, picture, bar)


def _strains(studio: Studio, scene: _Scene) -> tuple[Panel, Panel]:
    measured = strain(scene.result.target, scene.result.rest)
    stretch, bend = stretch_map(measured.stretch_vertices), bending_map(measured.bend_vertices)

    def shot(colours: ColourMap, values: AnyArray) -> AnyArray:
        layer = Layer(scene.natural, colours.rgb(values), edges=True)
        return studio.shoot([layer], scene.camera, scene.size)

    return (
        Panel(
            "stretch",
            "stretch of the natural shape",
            shot(stretch, measured.stretch_vertices),
            ColourBar(stretch, "change of edge length", "%", 100.0),
        ),
        Panel(
            "bending",
            "bending of the natural shape",
            shot(bend, measured.bend_vertices),
            ColourBar(bend, "change of dihedral angle", "deg", math.degrees(1.0)),
        ),
    )


def _rims(mesh: TriMesh) -> tuple[FloatArray, ...]:
    """The boundary curves, closed."""
    return tuple(mesh.vertices[np.append(loop, loop[0])] for loop in mesh.boundary_loops)


def _with_pins(label: str, scene: _Scene) -> str:
    count = len(scene.result.pinned)
    where = " on its obstacle" if len(scene.obstacles) == 1 else ""
    where = " on its obstacles" if len(scene.obstacles) > 1 else where
    return label + where + (f", {count} pinned" if count else "")


def _hex(colour: str) -> tuple[int, int, int]:
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)
