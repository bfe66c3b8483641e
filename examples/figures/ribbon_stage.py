"""What the figures of ribbons share: strips with their rulings, in pictures and side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from casashell.contact.obstacles import Obstacle
from casashell.io.camera import Camera, framed
from casashell.io.colours import NATURAL, NATURAL_INSIDE, OBSTACLE, SHELL, SHELL_INSIDE
from casashell.io.sheet import ColourBar, Panel, write_sheet
from casashell.io.studio import Curves, Layer, Studio
from casashell.io.tessellate import Region, Surface, tessellate
from casashell.ribbon.record import RibbonSimulation

BLUE, ORANGE = (SHELL, SHELL_INSIDE), (NATURAL, NATURAL_INSIDE)
GREEN, RED = ("#7fb58a", "#5a8c66"), ("#d98080", "#b35c5c")
#: Chains change colours from ribbon to ribbon.
LINKS = (BLUE, ORANGE, GREEN)
INK = "#1f3f66"
_LIFT = 0.003


@dataclass(frozen=True, eq=False)
class Piece:
    """A surface: triangles, lines drawn on it (n,2,3), colours of front and back or of vertices."""

    points: np.ndarray
    faces: np.ndarray
    lines: np.ndarray
    colours: tuple[str, str] | np.ndarray = BLUE
    opacity: float = 1.0


@dataclass(frozen=True, eq=False)
class Shot:
    """One panel: its label, what is in it, and a colour bar."""

    label: str
    pieces: Sequence[Piece]
    bar: ColourBar | None = None


def piece(
    bottom: np.ndarray,
    top: np.ndarray,
    colours: tuple[str, str] = BLUE,
    *,
    rulings: bool = True,
    opacity: float = 1.0,
) -> Piece:
    """A strip between two rims (N+1,3) m, its rulings drawn; a Moebius band needs no seam."""
    count = len(bottom)
    a = np.arange(count - 1)
    b, c, d = a + 1, a + 1 + count, a + count
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    every = np.stack([bottom, top], axis=1)
    rims = [np.stack([rim[:-1], rim[1:]], axis=1) for rim in (bottom, top)]
    lines = np.concatenate([*rims, every] if rulings else rims)
    return Piece(np.concatenate([bottom, top]), faces, lines, colours, opacity)


def pieces(sim: RibbonSimulation, frame: int, *, rulings: bool = True) -> list[Piece]:
    """All ribbons of a frame; several of them in turn in three colours."""
    colours = LINKS if len(sim.tracks) > 1 else LINKS[:1]
    return [
        piece(t.bottom[frame], t.top[frame], colours[k % len(colours)], rulings=rulings)
        for k, t in enumerate(sim.tracks)
    ]


def panels(
    shots: Sequence[Shot],
    *,
    view: tuple[float, float] = (28.0, 14.0),
    up: Sequence[float] = (0.0, 0.0, 1.0),
    height: int = 420,
    obstacles: Sequence[Obstacle] = (),
    close: bool = False,
) -> list[Panel]:
    """One picture a shot; all with the same camera, unless ``close``: then each fills its panel."""
    azimuth, elevation = view
    clouds = [piece.points for shot in shots for piece in shot.pieces]
    camera = framed(*clouds, up=up, azimuth=azimuth, elevation=elevation)
    size = (2 * round(0.5 * height * camera.aspect), height)
    region = Region.around(*clouds, scale=1.1)
    grounds = [Layer(tessellate(one, region), OBSTACLE, behind=True) for one in obstacles]
    drawn = []
    with Studio() as studio:
        for shot in shots:
            own = camera
            if close:
                near = [piece.points for piece in shot.pieces]
                own = framed(*near, up=up, azimuth=azimuth, elevation=elevation)
                size = (2 * round(0.5 * height * own.aspect), height)
            layers: list[Layer | Curves] = [*grounds]
            for one in shot.pieces:
                layers += _layers(one, own)
            drawn.append(Panel("", shot.label, studio.shoot(layers, own, size), shot.bar))
    return drawn if obstacles else trimmed(drawn)


def write_grid(rows: Sequence[Sequence[Panel]], box: tuple[int, int], path: Path) -> None:
    """A sheet of pictures of any size, each fitted into a ``box`` of (width, height) pixels."""
    write_sheet([[_fitted(panel, box) for panel in row] for row in rows], path)


def _fitted(panel: Panel, box: tuple[int, int]) -> Panel:
    from PIL import Image, ImageOps

    ground = tuple(int(value) for value in panel.picture[0, 0])
    image = Image.fromarray(panel.picture)
    return replace(panel, picture=np.asarray(ImageOps.pad(image, box, color=ground)))


def trimmed(drawn: Sequence[Panel]) -> list[Panel]:
    """The same part of all, without the empty rim around what is in any of them."""
    ground = drawn[0].picture[0, 0].astype(np.int64)
    seen = np.any([np.abs(p.picture - ground).max(axis=2) > 3 for p in drawn], axis=0)
    rows, columns = (np.flatnonzero(seen.any(axis=axis)) for axis in (1, 0))
    edge = 24
    top, left = max(rows[0] - edge, 0), max(columns[0] - edge, 0)
    part = np.s_[top : rows[-1] + edge, left : columns[-1] + edge]
    return [replace(p, picture=np.ascontiguousarray(p.picture[part])) for p in drawn]


def _layers(one: Piece, camera: Camera) -> list[Layer | Curves]:
    surface = Surface(one.points, one.faces)
    toward = camera.position - one.lines
    away = np.linalg.norm(camera.position - camera.focus)
    lines = tuple(one.lines + _LIFT * camera.size / away * toward)
    if isinstance(one.colours, np.ndarray):
        return [Layer(surface, one.colours, opacity=one.opacity), Curves(lines, INK, 1.5)]
    front, back = one.colours
    skin = Layer(surface, front, back, opacity=one.opacity, bright=True, creases=True)
    return [skin, Curves(lines, INK, 1.5)]
