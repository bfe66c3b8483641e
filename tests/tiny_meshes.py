"""Meshes of a few faces with known properties."""

from __future__ import annotations

import numpy as np

from casashell.mesh import TriMesh

# a unit square cut along 0-2, counter-clockwise seen from +z
SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
SQUARE_FACES = np.array([[0, 1, 2], [0, 2, 3]])


def grid(n: int) -> TriMesh:
    """n x n vertices on [0, n - 1]^2, two triangles a cell."""
    ids = np.arange(n * n).reshape(n, n)
    a, b, c, d = ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:]
    faces = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    x, y = np.meshgrid(np.arange(n, dtype=float), np.arange(n, dtype=float), indexing="ij")
    return TriMesh(np.column_stack([x.ravel(), y.ravel(), np.zeros(n * n)]), faces)


def moebius_band(n: int = 9) -> TriMesh:
    """Band of 2 n triangles with a half twist: consistent orientation is impossible."""
    angle = 2 * np.pi * np.arange(n) / n
    middle = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)])
    tilt = np.column_stack([np.cos(angle / 2)] * 2 + [np.zeros(n)]) * middle
    tilt[:, 2] = np.sin(angle / 2)
    vertices = np.stack([middle + 0.3 * tilt, middle - 0.3 * tilt], axis=1).reshape(-1, 3)
    faces = []
    for k in range(n):
        a, b = 2 * k, 2 * k + 1
        c, d = (a + 2, b + 2) if k < n - 1 else (1, 0)
        faces += [[a, b, c], [c, b, d]]
    return TriMesh(vertices, np.array(faces))
