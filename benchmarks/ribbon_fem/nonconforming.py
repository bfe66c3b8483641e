"""Non-conforming elements: triangles that keep their shape and share the midpoints of their edges.

English and Bridson 2008.  The unknowns are the midpoints of the edges (Crouzeix and Raviart): there are
about three coordinates for every two lengths to keep, so that a mesh that cannot stretch still bends in any
direction.  A triangle keeps its shape when its three midpoints keep their distances.

Bending is quadratic, as the discrete curvature energies of Wardetzky et al. 2007 on isometric surfaces:
with [f'] the jump of the slope of the two triangles at an edge of length L, and d the distance of their
centroids across the edge, 2/3 (A1 + A2) / L,

    E = D / 2 sum L / d (|[f' nu]|^2 + gap |[f' tau]|^2)

nu across and tau along the edge.  The first part is the square of a fold about the edge and of the turn of
the triangles in their plane.  The second vanishes on surfaces without gaps; without it every
discrete harmonic function is a free motion of a flat sheet with free edges, and no statics are possible.
With both weighing the same, chequered square cells have modulus D and Poisson's ratio 0 in
all directions.  Cells a long and b wide are 3/2 (a^2 + b^2) / (a^2 + 2 b^2) as stiff along the strip.
"""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np

from benchmarks.ribbon_fem.body import Body, nodal_mass
from benchmarks.ribbon_fem.forms import Forms
from benchmarks.ribbon_fem.guiding import guides
from benchmarks.ribbon_fem.patch import Patch
from casashell.engine.energy import Energy
from casashell.mesh import TriMesh
from casashell.typing import FloatArray, IntArray


@cache
def slope_jump() -> ca.Function:
    """|x P|^2 / 2 [J] of the midpoints x (3,5) of two triangles; p holds the columns of P (5,2)."""
    x, r, p = ca.SX.sym("x", 3, 5), ca.SX.sym("r", 3, 5), ca.SX.sym("p", 10)
    return ca.Function("slope_jump", [x, r, p], [ca.sumsqr(x @ ca.reshape(p, 5, 2)) / 2])


def nonconforming(patch: Patch, gap: float = 1.0) -> Body:
    """The patch as a body whose nodes are the midpoints of its edges; a third of a triangle's mass each.

    The mass matrix is the consistent one: on midpoints it is diagonal.
    Raises ValueError unless ``gap`` is finite and >= 0.
    """
    if not (np.isfinite(gap) and gap >= 0):
        raise ValueError(f"gap must be finite and >= 0, got {gap}")
    mesh = patch.mesh
    sides = mesh.topology.half_edge_edges.reshape(-1, 3)
    ends = patch.owner[mesh.edges]
    owner = np.where(ends[:, 0] == ends[:, 1], ends[:, 0], -1)
    pairs = np.stack([sides, np.roll(sides, -1, axis=1)], axis=2).reshape(-1, 2)
    pairs = pairs[np.any(owner[pairs] < 0, axis=1)]
    rest = mesh.vertices[mesh.edges].mean(axis=1)
    used = np.bincount(mesh.faces.ravel(), minlength=len(mesh.vertices))

    def corners(x: FloatArray) -> FloatArray:
        m = x[sides]
        return np.asarray(m + np.roll(m, 1, axis=1) - np.roll(m, -1, axis=1))

    def surface(x: FloatArray) -> FloatArray:
        every = corners(x).reshape(-1, 3)
        total = [np.bincount(mesh.faces.ravel(), column, len(used)) for column in every.T]
        return np.stack(total, axis=1) / used[:, None]

    return Body(
        patch=patch,
        rest=rest,
        mass=nodal_mass(patch, sides, len(rest)),
        owner=owner,
        energies=(_bending(patch, sides, gap), *guides(patch, sides)),
        forms=Forms.links(rest, pairs),
        corners=corners,
        surface=surface,
    )


def _slopes(mesh: TriMesh) -> FloatArray:
    """(F,3,2) slope of a triangle per value at the midpoint of side c, from corner c to c + 1."""
    corner = mesh.vertices[mesh.faces][:, :, :2]
    side = np.roll(corner, -1, axis=1) - corner
    twice = side[:, 0, 0] * side[:, 1, 1] - side[:, 0, 1] * side[:, 1, 0]
    outward = np.stack([side[:, :, 1], -side[:, :, 0]], axis=2)
    return np.asarray(2.0 * outward / twice[:, None, None])


def _bending(patch: Patch, sides: IntArray, gap: float) -> Energy:
    """Jump of slopes at every interior edge; stencil: the edge, then the other sides of its faces."""
    mesh = patch.mesh
    inner = np.flatnonzero(np.all(mesh.edge_faces >= 0, axis=1))
    along = np.diff(mesh.vertices[mesh.edges[inner]][:, :, :2], axis=1)[:, 0]
    slopes = _slopes(mesh)
    stencil = np.empty((len(inner), 5), dtype=np.int64)
    stencil[:, 0] = inner
    weight = np.zeros((len(inner), 5, 2))
    for number, sign in enumerate((1.0, -1.0)):
        face = mesh.edge_faces[inner, number]
        shared = np.argmax(sides[face] == inner[:, None], axis=1)
        weight[:, 0] += sign * slopes[face, shared]
        for turn in (1, 2):
            other = (shared + turn) % 3
            stencil[:, 2 * number + turn] = sides[face, other]
            weight[:, 2 * number + turn] = sign * slopes[face, other]
    area = mesh.face_areas[mesh.edge_faces[inner]].sum(axis=1)
    scale = np.sqrt(1.5 * patch.stiffness * patch.hinge_share / area)
    across = np.stack([along[:, 1], -along[:, 0]], axis=1)
    parts = [
        factor * scale[:, None] * np.einsum("skd,sd->sk", weight, direction)
        for factor, direction in ((1.0, across), (np.sqrt(gap), along))
    ]
    return Energy("bending", slope_jump(), stencil, np.concatenate(parts, axis=1))
