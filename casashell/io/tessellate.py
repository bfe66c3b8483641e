"""Triangles for what is drawn: obstacles given by formulas, force arrows, coarse copies of meshes.

Nothing here is used by the solver.  Lengths in metres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from casashell.contact.obstacles import (
    Capsule,
    Cone,
    Cylinder,
    MeshObstacle,
    Obstacle,
    Plane,
    Sphere,
)
from casashell.typing import FloatArray, IntArray

_AROUND: Final = 64
_GRID: Final = 56


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles to draw: vertices (V,3) m, faces (F,3)."""

    vertices: FloatArray
    faces: IntArray


@dataclass(frozen=True, eq=False)
class Region:
    """The ball around the shell in which unbounded obstacles are shown."""

    center: FloatArray
    radius: float

    @staticmethod
    def around(*clouds: FloatArray, scale: float = 1.0) -> Region:
        """Ball around the bounding box of all points, its radius times ``scale``; never empty."""
        points = np.concatenate([cloud.reshape(-1, 3) for cloud in clouds])
        if not len(points):
            return Region(np.zeros(3), 1.0)
        low, high = points.min(axis=0), points.max(axis=0)
        radius = 0.5 * scale * float(np.linalg.norm(high - low))
        return Region(0.5 * (low + high), radius if radius > 0 else 1.0)


def sunk(surface: Surface, depth: float) -> Surface:
    """The surface moved inwards by ``depth`` [m] along its vertex normals.

    A shell's flat faces cut through a round obstacle that their corners touch; drawn a little smaller
    it stays below them.
    """
    corners = surface.vertices[surface.faces]
    face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal = np.zeros_like(surface.vertices)
    np.add.at(normal, surface.faces.ravel(), np.repeat(face, 3, axis=0))
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0.0)
    return Surface(surface.vertices - depth * normal, surface.faces)


def tessellate(obstacle: Obstacle, region: Region) -> Surface:
    """Surface of an obstacle; unbounded ones are cut off where they leave the region.

    An obstacle of an unknown kind is sampled: its zero level inside the region.
    """
    if isinstance(obstacle, MeshObstacle):
        return Surface(obstacle.mesh.vertices, obstacle.mesh.faces)
    if isinstance(obstacle, Plane):
        return _patch(obstacle, region)
    if isinstance(obstacle, Sphere):
        center = np.array(obstacle.center)
        return _capsule(center, center, obstacle.radius)
    if isinstance(obstacle, Capsule):
        return _capsule(np.array(obstacle.a), np.array(obstacle.b), obstacle.radius)
    if isinstance(obstacle, Cylinder):
        return _cylinder(obstacle, region)
    if isinstance(obstacle, Cone):
        return _cone(obstacle, region)
    return _sampled(obstacle, region)


def _patch(plane: Plane, region: Region) -> Surface:
    """Square piece of a plane below the region."""
    normal = np.array(plane.normal)
    first, second = across(normal)
    center = region.center - (region.center @ normal - plane.offset) * normal
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * region.radius
    vertices = center + corners[:, :1] * first + corners[:, 1:] * second
    return Surface(vertices, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int64))


def _capsule(a: FloatArray, b: FloatArray, radius: float) -> Surface:
    """Two half balls and the side between them; a ball when a == b."""
    length = float(np.linalg.norm(b - a))
    axis = (b - a) / length if length > 0 else np.array([0.0, 0.0, 1.0])
    angle = np.linspace(0.0, 0.5 * math.pi, _AROUND // 4 + 1)
    first = np.stack([-radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    second = np.stack([length - first[::-1, 0], first[::-1, 1]], axis=1)
    profile = np.concatenate([first, second if length > 0 else second[1:]])
    return revolve(profile, a, axis)


def _cylinder(cylinder: Cylinder, region: Region) -> Surface:
    base, axis, radius = np.array(cylinder.base), np.array(cylinder.axis), cylinder.radius
    if cylinder.length is None:
        middle = float((region.center - base) @ axis)
        profile = np.array([[middle - region.radius, radius], [middle + region.radius, radius]])
    else:
        end = cylinder.length
        profile = np.array([[0.0, 0.0], [0.0, radius], [end, radius], [end, 0.0]])
    return revolve(profile, base, axis)


def _cone(cone: Cone, region: Region) -> Surface:
    apex, axis = np.array(cone.apex), np.array(cone.axis)
    slope = math.tan(cone.half_angle)
    if cone.length is None:
        end = max(float((region.center - apex) @ axis), 0.0) + region.radius
        return revolve(np.array([[0.0, 0.0], [end, end * slope]]), apex, axis)
    end = cone.length
    return revolve(np.array([[0.0, 0.0], [end, end * slope], [end, 0.0]]), apex, axis)


def _sampled(obstacle: Obstacle, region: Region) -> Surface:
    """Zero level of the signed distance on a grid over the region (marching cubes)."""
    import igl  # only here: most scenes do without

    line = np.linspace(-region.radius, region.radius, _GRID)
    # libigl counts x fastest.
    z, y, x = np.meshgrid(line, line, line, indexing="ij")
    grid = region.center + np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    distance = np.ascontiguousarray(obstacle.signed_distance(grid)[0], dtype=np.float64)
    if distance.min() >= 0 or distance.max() <= 0:
        return Surface(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
    vertices, faces = igl.marching_cubes(distance, grid, _GRID, _GRID, _GRID, 0.0)[:2]
    return Surface(np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64))


def revolve(profile: FloatArray, origin: FloatArray, axis: FloatArray) -> Surface:
    """Surface of revolution of a profile (n,2) of pairs (along the axis, away from it)."""
    first, second = across(axis)
    angle = np.linspace(0.0, 2 * math.pi, _AROUND, endpoint=False)
    ring = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second
    vertices = origin + profile[:, 0, None, None] * axis + profile[:, 1, None, None] * ring
    step = np.arange(_AROUND)
    following = (step + 1) % _AROUND
    faces = []
    for row in range(len(profile) - 1):
        low, high = row * _AROUND, (row + 1) * _AROUND
        if profile[row, 1] > 0:
            faces.append(np.stack([low + step, low + following, high + step], axis=1))
        if profile[row + 1, 1] > 0:
            faces.append(np.stack([low + following, high + following, high + step], axis=1))
    return Surface(vertices.reshape(-1, 3), np.concatenate(faces).astype(np.int64))


def across(axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors that make a right-handed frame (first, second, axis)."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    first = np.cross(helper, axis)
    first = first / np.linalg.norm(first)
    return first, np.cross(axis, first)


def arrows(tails: FloatArray, vectors: FloatArray, width: float, sides: int = 10) -> Surface:
    """One closed arrow per tail (n,3) and vector (n,3); ``2 + 3 sides`` vertices each, in order.

    The head keeps its proportions on long arrows and shrinks with short ones; width is the
    diameter of the shaft.
    """
    length = np.linalg.norm(vectors, axis=1)
    radius = 0.5 * np.minimum(width, 0.12 * length)
    head = np.minimum(7.0 * radius, 0.5 * length)
    angle = np.linspace(0.0, 2 * math.pi, sides, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    zero = np.zeros_like(length)
    rings = ((zero, radius), (length - head, radius), (length - head, 2.6 * radius))
    vertices = np.zeros((len(tails), 2 + 3 * sides, 3))
    for n, (tail, vector) in enumerate(zip(tails, vectors)):
        axis = vector / length[n] if length[n] > 0 else np.array([0.0, 0.0, 1.0])
        spread = circle @ np.stack(across(axis))
        for row, (height, size) in enumerate(rings):
            band = slice(row * sides, (row + 1) * sides)
            vertices[n, band] = tail + height[n] * axis + size[n] * spread
        vertices[n, -2], vertices[n, -1] = tail, tail + vector
    faces = _arrow_faces(sides)
    start = (np.arange(len(tails)) * (2 + 3 * sides))[:, None, None]
    return Surface(vertices.reshape(-1, 3), (start + faces).reshape(-1, 3).astype(np.int64))


def _arrow_faces(sides: int) -> IntArray:
    """Faces of one arrow: butt, shaft, back of the head, head; outward oriented."""
    step = np.arange(sides)
    following = (step + 1) % sides
    butt, tip = np.full(sides, 3 * sides), np.full(sides, 3 * sides + 1)
    faces = [np.stack([butt, following, step], axis=1)]
    for low, high in ((0, sides), (sides, 2 * sides)):
        faces.append(np.stack([low + step, low + following, high + step], axis=1))
        faces.append(np.stack([low + following, high + following, high + step], axis=1))
    faces.append(np.stack([2 * sides + step, 2 * sides + following, tip], axis=1))
    return np.concatenate(faces).astype(np.int64)


def cropped(surface: Surface, region: Region) -> Surface:
    """The faces with a vertex inside the region; vertices renumbered."""
    near = np.linalg.norm(surface.vertices - region.center, axis=1) <= region.radius
    return _compact(surface.vertices, surface.faces[near[surface.faces].any(axis=1)])[0]


def thinned(surface: Surface, faces: int) -> tuple[Surface, IntArray]:
    """A copy with at most ``faces`` triangles, and the original id (n,) of every vertex kept.

    Vertices in one cell of a grid become the one nearest to their mean: crude, but it works on
    any mesh, and what is left keeps its identity, so values can be looked up.
    """
    identity = np.arange(len(surface.vertices), dtype=np.int64)
    if len(surface.faces) <= faces:
        return surface, identity
    low = surface.vertices.min(axis=0)
    extent = surface.vertices.max(axis=0) - low
    corners = surface.vertices[surface.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * float(np.linalg.norm(normals, axis=1).sum())
    # A surface fills about one cell per side^2, and has two faces per vertex.
    side = max(math.sqrt(2.0 * area / faces), 1e-4 * float(extent.max()), np.finfo(float).tiny)
    while True:
        chosen, ids = _clustered(surface, low, side)
        if len(chosen.faces) <= faces:
            return chosen, ids
        side *= 1.15


def _clustered(surface: Surface, low: FloatArray, side: float) -> tuple[Surface, IntArray]:
    """One vertex per grid cell; faces that collapse or coincide are dropped."""
    place = np.floor((surface.vertices - low) / side).astype(np.int64)
    cell = np.unique(place, axis=0, return_inverse=True)[1].ravel()
    size = np.bincount(cell)
    mean = np.stack([np.bincount(cell, surface.vertices[:, c]) / size for c in range(3)], axis=1)
    away = np.linalg.norm(surface.vertices - mean[cell], axis=1)
    order = np.lexsort((away, cell))
    keeper = order[np.searchsorted(cell[order], np.arange(len(size)))]
    faces = keeper[cell[surface.faces]]
    whole = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    faces = faces[whole]
    first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)[1]
    return _compact(surface.vertices, faces[np.sort(first)])


def _compact(vertices: FloatArray, faces: IntArray) -> tuple[Surface, IntArray]:
    """Only the vertices in use, and their old ids."""
    ids, inverse = np.unique(faces, return_inverse=True)
    renumbered = inverse.reshape(-1, 3).astype(np.int64)
    return Surface(vertices[ids], renumbered), ids.astype(np.int64)
