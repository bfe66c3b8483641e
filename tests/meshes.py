"""Small procedural meshes and rigid motions shared by the tests."""

from __future__ import annotations

import numpy as np

from casashell.mesh import TriMesh
from casashell.typing import AnyArray, FloatArray, IntArray


def grid(nx: int, ny: int, a: float = 0.1, b: float = 0.1) -> TriMesh:
    """nx x ny cells of size a x b in the plane z = 0; the diagonals go from (0, 0) to (a, b).

    Vertex (i, j) has the id i (ny + 1) + j and sits at (i a, j b, 0).
    """
    i, j = np.meshgrid(np.arange(nx + 1), np.arange(ny + 1), indexing="ij")
    vertices = np.stack([i * a, j * b, 0.0 * i], axis=-1).reshape(-1, 3)
    number = np.arange(len(vertices)).reshape(nx + 1, ny + 1)
    corner = [number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]]
    o, east, far, north = (ids.ravel() for ids in corner)
    faces = np.concatenate([np.stack([o, east, far], 1), np.stack([o, far, north], 1)])
    return TriMesh(vertices, faces)


def rolled(mesh: TriMesh, step: float, fold: float) -> TriMesh:
    """Flat ``grid`` with cells ``step`` wide, bent by ``fold`` [rad] at every line x = const.

    The strips between the lines stay flat and congruent: no edge changes its length.
    """
    column = np.rint(mesh.vertices[:, 0] / step).astype(int)
    slope = fold * np.arange(column.max())
    x = np.concatenate([[0.0], np.cumsum(step * np.cos(slope))])
    z = np.concatenate([[0.0], np.cumsum(step * np.sin(slope))])
    return mesh.moved(np.stack([x[column], mesh.vertices[:, 1], z[column]], axis=1))


def jittered(mesh: TriMesh, amount: float, seed: int = 0) -> TriMesh:
    """Every vertex moved by a normal random vector of standard deviation ``amount`` [m]."""
    noise = np.random.default_rng(seed).standard_normal(mesh.vertices.shape)
    return mesh.moved(mesh.vertices + amount * noise)


def cap(rings: int, radius: float, opening: float, spokes: int = 6) -> TriMesh:
    """Part of a sphere around the origin within the angle ``opening`` [rad] of +z, pole first.

    Ring q has q * spokes vertices; the triangles are close to equilateral for spokes = 6.
    """
    points = [[0.0, 0.0, radius]]
    start = [0]
    for ring in range(1, rings + 1):
        start.append(len(points))
        polar = opening * ring / rings
        for turn in 2.0 * np.pi * np.arange(ring * spokes) / (ring * spokes):
            across = np.sin(polar)
            points.append([across * np.cos(turn), across * np.sin(turn), np.cos(polar)])
            points[-1] = [radius * value for value in points[-1]]
    faces = []
    for ring in range(1, rings + 1):
        outer, inner = ring * spokes, max((ring - 1) * spokes, 1)
        for spoke in range(spokes):
            for k in range(ring):
                a = start[ring] + (spoke * ring + k) % outer
                b = start[ring] + (spoke * ring + k + 1) % outer
                c = start[ring - 1] + (spoke * (ring - 1) + k) % inner
                faces.append([a, b, c])
                if k < ring - 1:
                    d = start[ring - 1] + (spoke * (ring - 1) + k + 1) % inner
                    faces.append([c, b, d])
    return TriMesh(np.array(points), np.array(faces))


def joined(first: TriMesh, second: TriMesh) -> TriMesh:
    """Both meshes as one, the vertices of ``second`` behind those of ``first``."""
    return TriMesh(
        np.vstack([first.vertices, second.vertices]),
        np.vstack([first.faces, second.faces + len(first.vertices)]),
    )


def renumbered(mesh: TriMesh, new_of_old: IntArray) -> TriMesh:
    """The same surface with vertex i called ``new_of_old[i]``."""
    vertices = np.empty_like(mesh.vertices)
    vertices[new_of_old] = mesh.vertices
    return TriMesh(vertices, new_of_old[mesh.faces])


def rotation(seed: int) -> FloatArray:
    """A random proper rotation (3,3)."""
    q, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    return np.asarray(q * np.sign(np.linalg.det(q)))


def rigid_motion(points: AnyArray, seed: int) -> FloatArray:
    """``points`` (N,3) turned by `rotation` and moved by a fixed vector."""
    return np.asarray(points @ rotation(seed).T + np.array([0.3, -1.1, 0.7]))
