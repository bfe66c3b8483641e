"""A triangle mesh as an obstacle.

    d(x)  distance to the nearest point c of the mesh, negative when (x - c) . N(c) < 0
    n(x)  (x - c) / d(x); the pseudonormal N(c) where |d| < 1e-6 of the obstacle's size

N(c) is the face normal inside a face, the sum of the two face normals on an edge, the
angle-weighted sum of face normals at a vertex: with it the sign is exact for closed meshes
(Baerentzen and Aanaes 2005, IEEE TVCG 11(3)).  Nearest points come from libigl's AABB tree.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol, runtime_checkable

import numpy as np

from casashell.contact.mesh_surface import Surface
from casashell.contact.validation import friction_coefficient, points3
from casashell.typing import ArrayLike, BoolArray, FloatArray, IntArray

#: distance, relative to the obstacle's size, below which the direction x - c is not trusted
_NEAR = 1e-6
#: a nearest point this close (barycentric) to an edge or a vertex counts as on it.  Generous is
#: safe: the pseudonormal of an edge gives the right sign beside the edge too, not the reverse
_ON_EDGE = 1e-7
#: over a rim of an open mesh "inside" means within 45 degrees of the inward normal; farther
#: round, the point is beside the surface, not behind it
_BEHIND_RIM = math.sqrt(0.5)


@runtime_checkable
class Triangles(Protocol):
    """Anything with vertices (V, 3) m and triangles (F, 3)."""

    @property
    def vertices(self) -> FloatArray: ...

    @property
    def faces(self) -> IntArray: ...


@dataclass(frozen=True, eq=False)
class MeshObstacle:
    """Solid bounded by a triangle mesh whose faces wind counter-clockwise seen from outside.

    mesh      anything with ``vertices`` (V, 3) m and ``faces`` (F, 3)
    friction  Coulomb coefficient
    name      label for reports and errors
    flip      reverse every face first: for meshes that come inside out

    Coincident vertices are joined for queries, degenerate faces and unreferenced vertices are
    left out; ``notes`` says what was done.  An open mesh is accepted (``closed`` is False): points
    facing the back of its surface count as inside, at any depth.

    Raises ValueError for non-finite vertices, faces without area, neighbouring faces that wind
    against each other, and closed meshes that are inside out.
    """

    mesh: Triangles = field(repr=False)
    friction: float = 0.5
    name: str = ""
    flip: bool = False
    surface: Surface = field(init=False, repr=False)

    def __post_init__(self) -> None:
        label = f"obstacle '{self.name}'" if self.name else "mesh obstacle"
        if not isinstance(self.mesh, Triangles):
            raise ValueError(
                f"{label} needs a mesh with vertices and faces, got {type(self.mesh).__name__}; "
                "read a file with casashell.read_mesh"
            )
        object.__setattr__(self, "friction", friction_coefficient(self.friction, label))
        surface = Surface.build(self.mesh.vertices, self.mesh.faces, flip=self.flip, label=label)
        object.__setattr__(self, "surface", surface)

    @property
    def closed(self) -> bool:
        """True when the faces bound a volume, so that inside and outside are exact."""
        return self.surface.closed

    @property
    def notes(self) -> tuple[str, ...]:
        """What was left out or joined, and whether the sign is exact; for reports."""
        return self.surface.notes

    def bounding_box(self) -> tuple[FloatArray, FloatArray] | None:
        """Box of a closed mesh; None for an open one, whose inside has no bound."""
        if not self.closed:
            return None
        corners = self.surface.vertices
        return corners.min(axis=0), corners.max(axis=0)

    def signed_distance(self, points: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Distance (N,) m and normal (N, 3) at points (N, 3)."""
        x = points3(points)
        if len(x) == 0:
            return np.zeros(0), np.zeros((0, 3))
        surface = self.surface
        _, face, nearest = self._tree.squared_distance(surface.vertices, surface.faces, x)
        pseudonormal, rim = self._pseudonormals(np.asarray(face, dtype=np.int64), nearest)
        arm = x - nearest
        length = np.linalg.norm(arm, axis=1)
        height = np.einsum("ij,ij->i", arm, pseudonormal)
        behind = np.where(rim, height < -_BEHIND_RIM * length, height < 0.0)
        sign = np.where(behind, -1.0, 1.0)
        far = length >= _NEAR * surface.size
        direction = (sign / np.where(far, length, 1.0))[:, None] * arm
        normal: FloatArray = np.where(far[:, None], direction, pseudonormal)
        return sign * length, normal

    def _pseudonormals(self, face: IntArray, nearest: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Unit pseudonormals (N, 3) at nearest points on faces; True where they lie on a rim."""
        surface = self.surface
        weights = surface.barycentric(face, nearest)
        small = weights < _ON_EDGE
        count = small.sum(axis=1)
        normal = surface.face_normals[face].copy()
        rim = np.zeros(len(face), dtype=bool)
        on_edge = np.flatnonzero(count == 1)
        edge = surface.face_edges[face[on_edge], np.argmax(small[on_edge], axis=1)]
        normal[on_edge], rim[on_edge] = surface.edge_normals[edge], surface.edge_rim[edge]
        on_corner = np.flatnonzero(count >= 2)
        corner = surface.faces[face[on_corner], np.argmax(weights[on_corner], axis=1)]
        normal[on_corner], rim[on_corner] = (
            surface.vertex_normals[corner],
            surface.vertex_rim[corner],
        )
        return normal, rim

    @cached_property
    def _tree(self) -> Any:
        import igl

        tree = igl.AABB()
        tree.init(self.surface.vertices, self.surface.faces)
        return tree

    def __getstate__(self) -> dict[str, Any]:
        """Everything but the tree, which libigl cannot pickle; it is rebuilt on demand."""
        return {key: value for key, value in self.__dict__.items() if key != "_tree"}
