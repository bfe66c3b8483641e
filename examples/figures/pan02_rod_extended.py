"""Pan 2016, Fig. 2: a rod extended along its transverse director is not isometric; a ribbon is.

A strip 10 x 1 wound on a cylinder with slanted rulings, and the surface that the transverse director of
its centreline spans: the same rod with the same torsion.  Checked: the area of the ribbon is L W to
rounding, that of the extended rod is too large, by what the integral of sqrt(1 + (tau y)^2) says.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from ribbon_stage import Piece, Shot, panels, piece
from stage import conclude, folder

from benchmarks.ribbon_fem.rod_extension import area_error, exact_error, extended
from casashell.app.ribbon_shapes import wound
from casashell.io.colours import ColourMap, stretch_map
from casashell.io.sheet import ColourBar, write_sheet
from casashell.ribbon import Ribbon
from casashell.ribbon.chain import Strip, reconstruct

LENGTH, WIDTH, SEGMENTS = 10.0, 1.0, 160
RADIUS, SLOPE = 0.55, 0.9  # of the cylinder, and cotangent between rulings and centreline
ACROSS = 10  # rows of the coloured surface


@dataclass(frozen=True)
class Measured:  # the strip, relative errors of area: ours, the rod's, and the rod's in closed form
    shape: Strip
    ours: float
    rod: float
    exact: float


def measure() -> Measured:
    ribbon = Ribbon(LENGTH, WIDTH, SEGMENTS)
    shape = reconstruct(ribbon, wound(ribbon, RADIUS, SLOPE))
    torsion = SLOPE / (RADIUS * (1.0 + SLOPE**2))
    # Where the slopes have left 0 at the ends: there the torsion is constant.
    inner = np.flatnonzero(np.isclose(shape.slopes, SLOPE))
    low, high = (rim[inner] for rim in extended(shape))
    area = (len(inner) - 1) * ribbon.segment * WIDTH
    return Measured(
        shape,
        area_error(shape.bottom, shape.top, LENGTH * WIDTH),
        area_error(low, high, area),
        exact_error(torsion, WIDTH),
    )


def complaints(found: Measured) -> list[str]:
    wrong = []
    if abs(found.ours) > 1e-13:
        wrong.append(f"the ribbon's area is off by {found.ours:.1e}")
    if found.rod < 0.01 or abs(found.rod / found.exact - 1.0) > 0.02:
        wrong.append(f"the rod's area is off by {found.rod:.4f}, not by {found.exact:.4f}")
    return wrong


def coloured(low: np.ndarray, high: np.ndarray, flat: np.ndarray, colours: ColourMap) -> Piece:
    """The ruled surface between rims (N+1,3), by its area over the flat one's (N, 2 or 1)."""
    plain, y = piece(low, high), np.linspace(0.0, 1.0, ACROSS + 1)[:, None, None]
    points = ((1.0 - y) * low + y * high).reshape(-1, 3)
    n = len(low)
    i, j = (a.ravel() for a in np.meshgrid(np.arange(ACROSS), np.arange(n - 1), indexing="ij"))
    a = i * n + j
    faces = np.concatenate([np.stack([a, a + 1, a + n + 1], 1), np.stack([a, a + n + 1, a + n], 1)])
    grid = points.reshape(ACROSS + 1, n, 3)
    along, across = np.gradient(grid, axis=1), np.gradient(grid, axis=0) * ACROSS
    density = np.linalg.norm(np.cross(along, across), axis=2) / flat
    return Piece(points, faces, plain.lines, colours.rgb((density - 1.0).ravel()))


def draw(found: Measured, path: Path) -> None:
    shape = found.shape
    colours = stretch_map(np.array([-0.15, 0.15]))
    step = LENGTH / SEGMENTS * WIDTH
    run = np.gradient(shape.slopes) * WIDTH * WIDTH * np.linspace(-0.5, 0.5, ACROSS + 1)[:, None]
    bar = ColourBar(colours, "change of area", "%", 100.0)
    label = f"ribbon: area error {abs(found.ours):.0e}"
    ours = Shot(label, [coloured(shape.bottom, shape.top, step + run, colours)], bar)
    label = f"rod, extended: area error {100 * found.rod:.1f} %"
    rod = Shot(label, [coloured(*extended(shape), np.array(step), colours)], bar)
    write_sheet([panels([ours, rod], view=(20.0, 25.0))], path)


if __name__ == "__main__":
    out, found = folder(__doc__), measure()
    draw(found, out / "pan02_rod_extended.png")
    conclude(
        [f"area: ribbon {found.ours:.1e}, rod {found.rod:.5f}, in closed form {found.exact:.5f}"],
        complaints(found),
    )
