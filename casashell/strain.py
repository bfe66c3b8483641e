"""How far a natural shape is from its target: relative stretch and change of dihedral angle.

The two measures of Fig. 10 of Ly et al. 2018, per edge and per hinge, and their means on faces and
vertices for colouring.  Positions are ``(V,3)`` in metres, angles in radians.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casashell.mesh import TriMesh
from casashell.typing import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Strain:
    """Deformation of a natural shape with respect to its target.

    stretch           (E,) signed (Lbar - L) / L per edge; negative: compressed, positive: dilated
    stretch_vertices  (V,), stretch_faces (F,): means over the edges that meet there
    bend              (H,) |thetabar - theta| per hinge, rad
    bend_vertices     (V,), bend_faces (F,): means over the hinges that meet there, 0 without one
    """

    stretch: FloatArray
    stretch_vertices: FloatArray
    stretch_faces: FloatArray
    bend: FloatArray
    bend_vertices: FloatArray
    bend_faces: FloatArray


def strain(target: TriMesh, rest: FloatArray) -> Strain:
    """Measure the natural shape ``rest`` (V,3) m against ``target``.

    ValueError: ``rest`` has another shape than the target's vertices, or an edge of the target has
    no length.
    """
    if rest.shape != target.vertices.shape:
        raise ValueError(f"rest has shape {rest.shape}, the target has {target.vertices.shape}")
    edges, folds = target.edges, target.hinges[:, :2]
    stretch = relative_stretch(target.vertices, rest, edges)
    bend = angle_change(target.vertices, rest, target.hinges)
    count = len(rest)
    return Strain(
        stretch=stretch,
        stretch_vertices=vertex_means(edges, stretch, count),
        stretch_faces=face_means(edges, stretch, target.faces),
        bend=bend,
        bend_vertices=vertex_means(folds, bend, count),
        bend_faces=face_means(folds, bend, target.faces),
    )


def edge_lengths(points: FloatArray, edges: IntArray) -> FloatArray:
    """Length (E,) of each edge (E,2), in the unit of ``points``."""
    difference: FloatArray = points[edges[:, 1]] - points[edges[:, 0]]
    lengths: FloatArray = np.linalg.norm(difference, axis=1)
    return lengths


def relative_stretch(target: FloatArray, rest: FloatArray, edges: IntArray) -> FloatArray:
    """Signed (Lbar - L) / L per edge (E,): natural length against target length.

    ValueError: an edge of the target has no length.
    """
    length = edge_lengths(target, edges)
    if not np.all(length > 0):
        bad = int(np.flatnonzero(~(length > 0))[0])
        i, j = edges[bad]
        raise ValueError(
            f"edge {bad} of the target (vertices {i} and {j}) has no length; repair the mesh"
        )
    return edge_lengths(rest, edges) / length - 1.0


def dihedral_angles(points: FloatArray, hinges: IntArray) -> FloatArray:
    """Signed angle (H,) rad in (-pi, pi] between the two faces of each hinge; 0 where flat.

    hinges (H,4): edge ends i, j, then the opposite vertices k of face (i,j,k) and l of (j,i,l).
    Positive where the faces fold away from the side their normals point to.  atan2 keeps full
    precision at small angles, where acos of the normals' product loses half the digits.
    """
    i, j, k, side = (points[hinges[:, column]] for column in range(4))
    edge = j - i
    first = np.cross(edge, k - i)
    second = np.cross(side - i, edge)
    length = np.sqrt(np.einsum("ij,ij->i", edge, edge))
    # n1 x n2 is parallel to the edge; its signed length is |edge| times this triple product.
    sine = np.einsum("ij,ij->i", np.cross(first, second), edge)
    cosine = np.einsum("ij,ij->i", first, second) * length
    angle: FloatArray = np.arctan2(sine, cosine)
    return angle


def angle_change(target: FloatArray, rest: FloatArray, hinges: IntArray) -> FloatArray:
    """|thetabar - theta| per hinge (H,), rad; not wrapped, as in the bending energy."""
    change: FloatArray = np.abs(dihedral_angles(rest, hinges) - dihedral_angles(target, hinges))
    return change


def vertex_means(segments: IntArray, values: FloatArray, count: int) -> FloatArray:
    """Mean (count,) over the segments (n,2) that end in each vertex; 0 where none does."""
    ends = segments.ravel()
    total = np.bincount(ends, weights=np.repeat(values, 2), minlength=count)
    number = np.bincount(ends, minlength=count)
    return total / np.maximum(number, 1)


def face_means(segments: IntArray, values: FloatArray, faces: IntArray) -> FloatArray:
    """Mean (F,) over the sides of each face that are among the segments (n,2); 0 where none is."""
    count = int(max(faces.max(initial=-1), segments.max(initial=-1))) + 1
    known = _keys(segments, count)
    order = np.argsort(known, kind="stable")
    wanted = np.stack([_keys(faces[:, [a, (a + 1) % 3]], count) for a in range(3)], axis=1)
    if not len(known):
        return np.zeros(len(faces))
    place = np.minimum(np.searchsorted(known[order], wanted), len(known) - 1)
    found = known[order][place] == wanted
    total = np.where(found, values[order][place], 0.0).sum(axis=1)
    mean: FloatArray = total / np.maximum(found.sum(axis=1), 1)
    return mean


def _keys(segments: IntArray, count: int) -> IntArray:
    """One number per undirected segment."""
    keys: IntArray = segments.min(axis=1) * count + segments.max(axis=1)
    return keys
