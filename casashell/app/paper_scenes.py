"""Five scenes of Ly 2018, Sec. 8, made by formula: names, materials and counts of its tables.

Up is +y, lengths are m.  Materials are those of Table 1 exactly, counts of vertices and contacts those
of Table 2 nearly.  The paper gives no sizes: those here keep the rest folds small that its materials
need.  Fold is the largest |theta - theta_r| of the stress program of least strain energy:

    scene            vertices (paper)  contacts (paper)  size                           fold, rad
    Synthetic Skirt  200 (200)         20 (19)           hole 0.4 across, cloth 0.7     0.09
    Book Page        817 (817)         129 (143)         arch 0.1 across, 0.2 deep      0.03
    Puff Sleeve      396 (402)         72 (67)           arm 0.08 across, sleeve 0.08   0.05
    Beret            847 (846)         72 (69)           head 0.2 across                0.06
    Floppy Hat       873 (876)         169 (178)         head 0.14 across, brim 0.06    0.05
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from itertools import pairwise
from typing import Final

import numpy as np

from casashell.app.builtin import TOUCHING, _grid, _round
from casashell.app.scene import Material, Scene
from casashell.contact.obstacles import Capsule, Cone, Plane, Sphere
from casashell.engine.assembly import Assembly
from casashell.inverse.nonpenetration import settle
from casashell.mesh import TriMesh
from casashell.typing import FloatArray, IntArray


def synthetic_skirt() -> Scene:
    """A flat ring that has come to rest around a cone: 10 circles of 20 vertices.

    Ring: inner radius 0.2, outer radius 0.9.  Cone: half angle 20 degrees, apex up, 0.2 in radius where
    the ring starts.  Without friction the ring slides down, widens its hole until the hoop carries
    the weight, and hangs; the waist line alone touches.  The drape is computed at the first call.
    """
    mesh = TriMesh(_draped_ring(), _ring_faces([20] * 10))
    return Scene("synthetic-skirt", mesh, (_SKIRT_CONE,), _SKIRT_MATERIAL, tolerance=TOUCHING)


def book_page() -> Scene:
    """A page that arches over the other pages of an open book; 19 rows of 43 vertices.

    Arch: half a cylinder of radius 0.05 and depth 0.2, rows 1 to 17.  Both its long edges lie on the
    pages y = 0 and run out into a margin as wide as a row, 0.0098; the outer row of one margin is the
    spine and pinned, the other three rows touch.
    """
    radius, depth, rows, along = 0.05, 0.2, 19, 43
    i, j, faces = _grid(rows, along)
    last = rows - 3
    turn = np.clip(i - 1, 0, last)
    margin = math.pi * radius / last
    x = -radius * np.cos(math.pi * turn / last) + margin * (i - 1 - turn)
    y = radius * np.sin(math.pi * turn / last)
    y[(turn == 0) | (turn == last)] = 0.0
    z = depth * (j / (along - 1) - 0.5)
    mesh = TriMesh(np.stack([x, y, z], axis=1), faces)
    pages = Plane((0.0, 1.0, 0.0), 0.0, friction=0.4, name="pages")
    material = Material(density=10.0, stretch=5.0, bend=2e-3)
    spine = tuple(range(along))
    return Scene("book-page", mesh, (pages,), material, pinned=spine, tolerance=TOUCHING)


def puff_sleeve() -> Scene:
    """A puffed sleeve that friction alone holds around an arm; 22 circles of 18 vertices.

    Arm: capsule of radius 0.04, 25 degrees from the vertical.  Sleeve: 0.08 long, with two circles on
    the arm at either end; between them the radius swells by 0.032 along half a sine.
    """
    radius, length, puff, rows, around = 0.04, 0.08, 0.032, 22, 18
    row, angle = _circles([around] * rows)
    swollen = np.clip((row - 1.0) / (rows - 3.0), 0.0, 1.0)
    out = radius + puff * np.sin(math.pi * swollen)
    out[(row <= 1) | (row >= rows - 2)] = radius
    tilt = _tilted(25.0)
    points = _round(out, angle, -length * row / (rows - 1)) @ tilt.T
    down = tilt @ np.array([0.0, -1.0, 0.0])
    shoulder, hand = -radius * down, (length + radius) * down
    arm = Capsule(_vector(shoulder), _vector(hand), radius, friction=0.7, name="arm")
    material = Material(density=1.0, stretch=0.1, bend=1e-3)
    mesh = TriMesh(points, _ring_faces([around] * rows))
    return Scene("puff-sleeve", mesh, (arm,), material, tolerance=TOUCHING)


def beret() -> Scene:
    """A beret slanted by 25 degrees on a head; 1 + 6 + 12 + .. + 36 vertices, then 20 circles of 36.

    Head: sphere of radius 0.1.  In its axes the band, two circles that touch, starts 55 degrees from
    the pole; the underside widens to a round rim of radius 0.016 that reaches 0.123 from the axis,
    80 mm above the centre of the head; a dome closes the top, 115 mm above the centre.
    """
    head, band, rim, reach, middle, top = 0.1, math.radians(55.0), 0.016, 0.123, 0.08, 0.115
    counts = [1, *range(6, 36, 6), *[36] * 21]
    s = np.linspace(0.0, 1.0, 2000)
    bend = math.pi * (0.5 - s)
    shape = np.concatenate(
        [
            np.stack([(reach - rim) * s, middle + rim + (top - middle - rim) * (1 - s**2)], axis=1),
            np.stack([reach - rim + rim * np.cos(bend), middle + rim * np.sin(bend)], axis=1)[1:],
            [[head * math.sin(band), head * math.cos(band)]],
        ]
    )
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(shape, axis=0), axis=1))])
    stations = np.linspace(0.0, arc[-1], len(counts) - 1)
    out, height = np.interp(stations, arc, shape[:, 0]), np.interp(stations, arc, shape[:, 1])
    below = band + stations[1] / head
    out = np.append(out, head * math.sin(below))
    height = np.append(height, head * math.cos(below))
    ring, angle = _circles(counts)
    points = _round(out[ring], angle, height[ring]) @ _tilted(25.0).T
    ball = Sphere((0.0, 0.0, 0.0), head, friction=0.3, name="head")
    material = Material(density=0.25, stretch=0.05, bend=5e-4)
    mesh = TriMesh(points, _ring_faces(counts))
    return Scene("beret", mesh, (ball,), material, tolerance=TOUCHING)


def floppy_hat() -> Scene:
    """A hat with a wavy brim on a head; 1 + 6 + 12 + .. + 42 vertices that touch, then 11 circles.

    Head: capsule of radius 0.07.  Crown: its upper sphere down to 55 degrees from the top.  An arc of
    radius 0.028 turns outwards to the brim, which falls at 30 degrees over 0.06 and is waved by up to
    10 mm, twice around.  The circles beyond the crown have 44, 48, .. 84 vertices.
    """
    head, turn, brim, wave = 0.07, 0.028, 0.06, 0.01
    crown, slope = math.radians(55.0), math.radians(30.0)
    counts = [1, *range(6, 43, 6), *range(44, 85, 4)]
    on_head = head * crown * np.arange(8) / 7.0
    beyond = (turn * (crown - slope) + brim) * np.arange(1, 12) / 11.0
    s = np.concatenate([np.zeros(8), beyond])
    first = np.concatenate([on_head / head, np.full(11, crown)])
    second = np.clip(crown - s / turn, slope, crown)
    third = np.clip(s - turn * (crown - slope), 0.0, None)
    out = head * np.sin(first) + turn * (math.sin(crown) - np.sin(second)) + third * math.cos(slope)
    height = head * np.cos(first) - turn * (np.cos(second) - math.cos(crown))
    height = height - third * math.sin(slope)
    ring, angle = _circles(counts)
    outer = s / s[-1]
    waved = height[ring] + wave * outer[ring] ** 3 * np.cos(2.0 * angle)
    mesh = TriMesh(_round(out[ring], angle, waved), _ring_faces(counts))
    ball = Capsule((0.0, 0.0, 0.0), (0.0, -1.5 * head, 0.0), head, friction=0.6, name="head")
    material = Material(density=2.5, stretch=5.0, bend=5e-4)
    return Scene("floppy-hat", mesh, (ball,), material, tolerance=TOUCHING)


#: Scenes of the paper by name.
PAPER: Final[Mapping[str, Callable[[], Scene]]] = {
    "synthetic-skirt": synthetic_skirt,
    "book-page": book_page,
    "puff-sleeve": puff_sleeve,
    "beret": beret,
    "floppy-hat": floppy_hat,
}

_SKIRT_MATERIAL: Final = Material(density=0.1, stretch=3.0, bend=5e-3)
_SKIRT_CONE: Final = Cone(
    (0.0, 0.2 / math.tan(math.radians(20.0)), 0.0),
    (0.0, -1.0, 0.0),
    math.radians(20.0),
    length=2.5,
    friction=0.6,
    name="cone",
)


@cache
def _draped_ring() -> FloatArray:
    """Vertices (200,3) of the skirt at rest, from a start with five waves of 1 mm at the hem."""
    ring, angle = _circles([20] * 10)
    share: FloatArray = np.asarray(ring / 9.0, dtype=np.float64)
    out: FloatArray = 0.2 + 0.7 * share
    flat = TriMesh(_round(out, angle, np.zeros(len(ring))), _ring_faces([20] * 10))
    terms = Scene("ring", flat, (), _SKIRT_MATERIAL).problem.energies
    waved = _round(out, angle, 1e-3 * share * np.cos(5.0 * angle))
    found = settle(Assembly(terms, len(ring)), flat.vertices, _SKIRT_CONE, start=waved)
    if not found.converged or found.stable is False:
        raise RuntimeError(f"the skirt did not come to rest: residual {found.residual:.1e}")
    return found.pose


def _circles(counts: Sequence[int]) -> tuple[IntArray, FloatArray]:
    """Circle and angle of every vertex; every other circle is turned by half a step."""
    turned = [(np.arange(n) + 0.5 * (k % 2)) / n for k, n in enumerate(counts)]
    ring = np.repeat(np.arange(len(counts), dtype=np.int64), counts)
    return ring, 2.0 * math.pi * np.concatenate(turned)


def _ring_faces(counts: Sequence[int]) -> IntArray:
    """Triangles between circles of `_circles`, wound to face up where they widen."""
    faces: list[tuple[int, int, int]] = []
    begin = 0
    for k, (m, n) in enumerate(pairwise(counts)):
        after = begin + m
        i = j = 0
        inner, outer = 0.5 * (k % 2), 0.5 * ((k + 1) % 2)
        while (i < m and m > 1) or j < n:
            ahead = (outer + j + 1.0) / n <= (inner + i + 1.0) / m + 1e-9
            a, b = begin + i % m, after + j % n
            if j < n and (ahead or i == m or m == 1):
                faces.append((a, b, after + (j + 1) % n))
                j += 1
            else:
                faces.append((a, b, begin + (i + 1) % m))
                i += 1
        begin = after
    return np.array(faces, dtype=np.int64)


def _tilted(degrees: float) -> FloatArray:
    """Rotation (3,3) about +z that leans +y towards -x."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _vector(point: FloatArray) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in point)
    return x, y, z
