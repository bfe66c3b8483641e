"""Scenes made by formula: a hat on a head, a skirt on a waist, a book page on a table.

Up is +y, lengths are m.  Every surface is smooth and analytic (profile curves of circular arcs and
lines), touches its obstacle exactly, and is meshed with triangles near equilateral.  Materials are
in the spirit of Ly 2018, Table 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from casashell.app.scene import Material, Scene
from casashell.contact.obstacles import Capsule, Cone, Plane
from casashell.mesh import TriMesh
from casashell.typing import FloatArray, IntArray

#: Contact tolerance [m]: the surfaces touch exactly, so rounding is all it has to cover.
TOUCHING: Final = 1e-5


def hat(rings: int = 15) -> Scene:
    """A sun hat with a waved brim on a head; 1 + 3 n (n + 1) vertices for n rings.

    Head: capsule of radius 0.1, its upper centre in the origin.  Crown: the sphere from the top
    down to 65 degrees.  Then an arc of radius 0.04 turns outwards, and a brim 0.07 wide falls at
    20 degrees, waved by up to 8 mm.
    """
    radius, crown, turn, brim, slope = 0.1, math.radians(65.0), 0.04, 0.07, math.radians(20.0)
    arcs = np.array([radius * crown, turn * (crown - slope), brim])
    ends = np.concatenate([[0.0], np.cumsum(arcs)])

    def profile(s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distance from the axis and height at arc length s from the top."""
        first = np.clip(s, 0.0, ends[1]) / radius
        second = crown - np.clip(s - ends[1], 0.0, arcs[1]) / turn
        third = np.clip(s - ends[2], 0.0, None)
        out = radius * np.sin(first) + turn * (np.sin(crown) - np.sin(second))
        down = radius * np.cos(first) - turn * (np.cos(second) - np.cos(crown))
        return out + third * math.cos(slope), down - third * math.sin(slope)

    ring, angle, faces = _disc(rings)
    s = ends[-1] * ring / rings
    out, height = profile(s)
    outer = np.clip((s - ends[1]) / (ends[-1] - ends[1]), 0.0, 1.0)
    height = height + 0.008 * outer**3 * np.cos(2.0 * angle)
    target = TriMesh(_round(out, angle, height), faces)
    head = Capsule((0.0, 0.0, 0.0), (0.0, -0.15, 0.0), radius, friction=0.6, name="head")
    material = Material(density=2.5, stretch=5.0, bend=2e-3)
    return Scene("hat", target, (head,), material, tolerance=TOUCHING)


def skirt(rows: int = 12, around: int = 40) -> Scene:
    """A flared, waved skirt around a waist; ``rows * around`` vertices.

    Waist: a cone of half angle 20 degrees about the vertical axis, apex up.  The waist line, a
    circle of radius 0.13, lies on the cone.  From there the skirt falls 0.45 along an arc whose
    angle to the vertical grows from 25 to 40 degrees, away from the cone, with six waves that
    reach 30 mm at the hem.
    """
    waist, length, steep = 0.13, 0.45, math.radians(20.0)
    start, end = math.radians(25.0), math.radians(40.0)
    row, column, faces = _tube(rows, around)
    angle = 2.0 * math.pi * (column + 0.5 * row) / around
    s = length * row / (rows - 1)
    bent = (end - start) / length
    flare = start + bent * s
    out = waist + (math.cos(start) - np.cos(flare)) / bent
    height = -(np.sin(flare) - math.sin(start)) / bent
    wave = 0.03 * (s / length) ** 2 * np.cos(6.0 * angle)
    target = TriMesh(
        _round(out + wave * np.cos(flare), angle, height + wave * np.sin(flare)), faces
    )
    apex = (0.0, waist / math.tan(steep), 0.0)
    body = Cone(apex, (0.0, -1.0, 0.0), steep, length=1.0, friction=0.6, name="waist")
    material = Material(density=0.1, stretch=3.0, bend=1e-3)
    return Scene("skirt", target, (body,), material, tolerance=TOUCHING)


def page(across: int = 19, along: int = 43) -> Scene:
    """A book page bent to a half cylinder on a table; ``across * along`` vertices.

    Page: 0.15 along the arc (radius 0.15 / pi), 0.2 along the axis.  Table: the plane y = 0; the
    two long edges stand on it.  Coarse strips that are longer along the axis than the arc steps are
    wide (``along`` well below ``across``) make the page unstable.
    """
    arc, depth = 0.15, 0.2
    radius = arc / math.pi
    i, j, faces = _grid(across, along)
    turn = math.pi * i / (across - 1)
    x = -radius * np.cos(turn)
    y = radius * np.sin(turn)
    y[(i == 0) | (i == across - 1)] = 0.0
    z = depth * (j / (along - 1) - 0.5)
    target = TriMesh(np.stack([x, y, z], axis=1), faces)
    table = Plane((0.0, 1.0, 0.0), 0.0, friction=0.4, name="table")
    material = Material(density=10.0, stretch=5.0, bend=2e-3)
    return Scene("page", target, (table,), material, tolerance=TOUCHING)


#: Scenes by name.
BUILTIN: Final[Mapping[str, Callable[[], Scene]]] = {"hat": hat, "skirt": skirt, "page": page}


def _round(out: FloatArray, angle: FloatArray, height: FloatArray) -> FloatArray:
    """Points (N,3) about the y axis; angle turns from +z to +x."""
    return np.stack([out * np.sin(angle), height, out * np.cos(angle)], axis=1)


def _disc(rings: int) -> tuple[FloatArray, FloatArray, IntArray]:
    """Hexagonal disc: ring number and angle of every vertex, faces.  Ring k has 6 k vertices."""
    ring, angle, faces = [np.zeros(1)], [np.zeros(1)], []
    for k in range(1, rings + 1):
        ring.append(np.full(6 * k, float(k)))
        angle.append(2.0 * math.pi * np.arange(6 * k) / (6 * k))
        faces.extend(_ring_faces(k))
    return np.concatenate(ring), np.concatenate(angle), np.array(faces, dtype=np.int64)


def _ring_faces(k: int) -> list[tuple[int, int, int]]:
    """Triangles between rings k - 1 and k of the disc, wound so that the disc faces up."""
    inner_start, outer_start = (1 + 3 * (k - 1) * (k - 2) if k > 1 else 0), 1 + 3 * k * (k - 1)
    inner_count, outer_count = max(6 * (k - 1), 1), 6 * k
    faces = []
    for sector in range(6):
        for step in range(k):
            outer = [outer_start + (sector * k + step + n) % outer_count for n in (0, 1)]
            inner = [inner_start + (sector * (k - 1) + step + n) % inner_count for n in (0, 1)]
            faces.append((inner[0], outer[0], outer[1]))
            if step < k - 1:
                faces.append((inner[0], outer[1], inner[1]))
    return faces


def _tube(rows: int, around: int) -> tuple[FloatArray, FloatArray, IntArray]:
    """Tube of staggered rows: row and column of every vertex, faces.

    Row r is turned by half a column against row r - 1, which makes the triangles isosceles.
    """
    row, column = (index.ravel() for index in np.mgrid[:rows, :around])
    r, c = (index.ravel() for index in np.mgrid[: rows - 1, :around])
    upper, upper_next = r * around + c, r * around + (c + 1) % around
    lower, lower_last = upper + around, (r + 1) * around + (c - 1) % around
    first = np.stack([upper, lower, upper_next], axis=1)
    second = np.stack([upper, lower_last, lower], axis=1)
    return row * 1.0, column * 1.0, np.concatenate([first, second])


def _grid(across: int, along: int) -> tuple[FloatArray, FloatArray, IntArray]:
    """Rectangle with diagonals in alternating directions: both indices, faces."""
    i, j = (index.ravel() for index in np.mgrid[:across, :along])
    a, b = (index.ravel() for index in np.mgrid[: across - 1, : along - 1])
    p00 = a * along + b
    p10, p01, p11 = p00 + along, p00 + 1, p00 + along + 1
    even = ((a + b) % 2 == 0)[:, None]
    first = np.where(even, np.stack([p00, p01, p11], axis=1), np.stack([p00, p01, p10], axis=1))
    second = np.where(even, np.stack([p00, p11, p10], axis=1), np.stack([p01, p11, p10], axis=1))
    return i * 1.0, j * 1.0, np.concatenate([first, second])
