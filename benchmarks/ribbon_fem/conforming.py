"""Conforming elements: linear triangles that share vertices, stiff in the plane, bending by angles.

In the plane each triangle has constant Green strain G and the energy A Y / 2 |G|^2 (Saint Venant and
Kirchhoff, Poisson's ratio 0), with Y [N/m] so large that the sheet hardly stretches.

Bending is one of two functions of the angles theta between triangles.

shape   D / 2 sum A |S|^2 with the shape operator of a triangle S = sum L theta / (2 A) n n^T over its
        edges, n the normal of an edge in the plane.  On a grid of parallelograms S is exact for any
        curvature, so that the sheet has modulus D and Poisson's ratio 0 in all directions.
hinge   `formulations.hinge_bending` with k = D / 3, which on a grid of right-angled triangles is
        D / 2 (L theta)^2 / A.  Cylinders along either side of the grid have the exact energy, and so have
        creases that are edges; but the mesh couples curvatures, and as long as the sheet may stretch a
        little it finds a way to bend that costs less.
"""

from __future__ import annotations

from functools import cache
from typing import Literal, TypeAlias

import casadi as ca
import numpy as np

from benchmarks.ribbon_fem.body import Body, nodal_mass
from benchmarks.ribbon_fem.forms import Forms
from benchmarks.ribbon_fem.guiding import guides
from benchmarks.ribbon_fem.patch import Patch
from casashell.engine.energy import Energy
from casashell.mesh import TriMesh
from casashell.typing import FloatArray
from formulations.hinge_bending import angle, hinge_bending

Bending: TypeAlias = Literal["shape", "hinge"]

#: Default Y W^2 / D: a sheet with W = 60 thicknesses.
MEMBRANE = 12.0 * 60.0**2
#: Columns (j, k, i, opposite) of the stencil of a triangle that make the hinge at each of its sides.
_HINGES = ((0, 1, 2, 3), (1, 2, 0, 4), (2, 0, 1, 5))


@cache
def shape_bending() -> ca.Function:
    """Energy [J] of a triangle and the corners across its sides, x, r (3,6) [m].

    p = (D, f0, f1, f2): plate modulus [J] and factors of the three angles.
    """
    x, r, p = ca.SX.sym("x", 3, 6), ca.SX.sym("r", 3, 6), ca.SX.sym("p", 4)
    normal = ca.cross(r[:, 1] - r[:, 0], r[:, 2] - r[:, 0])
    twice = ca.sqrt(ca.sumsqr(normal))
    shape = ca.SX.zeros(3, 3)
    for side, columns in enumerate(_HINGES):
        edge = r[:, columns[1]] - r[:, columns[0]]
        length = ca.sqrt(ca.sumsqr(edge))
        across = ca.cross(edge / length, normal / twice)
        theta = p[1 + side] * angle(x[:, list(columns)])
        shape += length * theta / twice * (across @ across.T)
    return ca.Function("shape_bending", [x, r, p], [twice / 4 * p[0] * ca.sumsqr(shape)])


def conforming(
    patch: Patch,
    membrane: float | None = None,
    *,
    bending: Bending = "shape",
    inextensible: bool = False,
) -> Body:
    """The patch as a body whose nodes are the vertices of its mesh; a third of a triangle's mass each.

    membrane      Y [N/m]; by default ``MEMBRANE`` times D over the square of the shorter side
    inextensible  every edge keeps its length instead, exactly
    Raises ValueError unless the membrane stiffness is positive.
    """
    mesh = patch.mesh
    rest = np.array(mesh.vertices)
    if membrane is None:
        membrane = MEMBRANE * patch.stiffness / float(np.ptp(rest[:, :2], axis=0).min()) ** 2
    if not (np.isfinite(membrane) and membrane > 0):
        raise ValueError(f"membrane stiffness must be finite and > 0, got {membrane}")
    edges = mesh.edges[np.any(patch.owner[mesh.edges] < 0, axis=1)]

    def corners(x: FloatArray) -> FloatArray:
        return np.asarray(x[mesh.faces])

    return Body(
        patch=patch,
        rest=rest,
        mass=nodal_mass(patch, mesh.faces, len(rest)),
        owner=patch.owner,
        energies=(_bending(patch, bending), *guides(patch, mesh.faces)),
        forms=Forms.links(rest, edges) if inextensible else green_strains(patch, membrane),
        corners=corners,
        surface=np.array,
    )


def _bending(patch: Patch, bending: Bending) -> Energy:
    if bending == "hinge":
        return hinge_bending(patch.mesh, patch.stiffness / 3.0 * patch.hinge_share)
    if bending != "shape":
        raise ValueError(f"bending must be 'shape' or 'hinge', got {bending!r}")
    mesh = patch.mesh
    inside = np.flatnonzero(~patch.outside)
    sides = mesh.topology.half_edge_edges.reshape(-1, 3)[inside]
    both = mesh.edge_faces[sides]  # (F,3,2)
    other = np.where(both[:, :, 0] == inside[:, None], both[:, :, 1], both[:, :, 0])
    here = mesh.faces[inside]
    across = mesh.faces[other].sum(axis=2) - mesh.edges[sides].sum(axis=2)
    # At a rim nothing is across: the own third corner holds the place, with factor 0.
    across = np.where(other >= 0, across, np.roll(here, -2, axis=1))
    factor = np.where(other < 0, 0.0, np.where(patch.outside[other], 2.0, 1.0))
    params = np.column_stack([np.full(len(inside), patch.stiffness), factor])
    return Energy("bending", shape_bending(), np.concatenate([here, across], axis=1), params)


def green_strains(patch: Patch, membrane: float) -> Forms:
    """G_xx, G_yy and sqrt(2) G_xy of every triangle of the sheet, with compliance 1 / (A Y)."""
    mesh = patch.mesh
    faces = mesh.faces[~patch.outside]
    slopes = _gradients(mesh)[~patch.outside]  # (F,3,2)
    first, second = slopes[:, :, 0], slopes[:, :, 1]
    twist = first[:, :, None] * second[:, None] + second[:, :, None] * first[:, None]
    weights = np.stack(
        [
            first[:, :, None] * first[:, None],
            second[:, :, None] * second[:, None],
            np.sqrt(0.5) * twist,
        ],
        axis=1,
    )
    soft = 1.0 / (membrane * mesh.face_areas[~patch.outside])
    nodes = np.repeat(faces, 3, axis=0)
    return Forms.on(np.array(mesh.vertices), nodes, weights.reshape(-1, 3, 3), np.repeat(soft, 3))


def _gradients(mesh: TriMesh) -> FloatArray:
    """(F,3,2) gradient of the linear function that is 1 at a corner and 0 at the others."""
    corner = mesh.vertices[mesh.faces][:, :, :2]
    facing = np.roll(corner, -2, axis=1) - np.roll(corner, -1, axis=1)
    twice = facing[:, 0, 0] * facing[:, 1, 1] - facing[:, 0, 1] * facing[:, 1, 0]
    inward = np.stack([-facing[:, :, 1], facing[:, :, 0]], axis=2)
    return np.asarray(inward / twice[:, None, None])
