"""Gravity with the mass taken from the natural area, Ly 2018 Eqs. (11)-(12).

    E = -rho Abar / 3 * g . (x_1 + x_2 + x_3)          per triangle

Stencil: the corners of a triangle.  The mass of a vertex is a third of rho [kg/m2] times the rest
areas around it and therefore moves with the natural shape.  Smooth for non-degenerate rest triangles.
"""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np

from casashell.engine.energy import Energy
from casashell.mesh import TriMesh
from casashell.typing import AnyArray, ArrayLike
from formulations.arguments import finite_vector, per_element


@cache
def density() -> ca.Function:
    """Energy [J] of one triangle from x (3,3), r (3,3) [m] and p = rho g (3) [N/m2]."""
    x, r, p = ca.SX.sym("x", 3, 3), ca.SX.sym("r", 3, 3), ca.SX.sym("p", 3)
    normal = ca.cross(r[:, 1] - r[:, 0], r[:, 2] - r[:, 0])
    area = ca.sqrt(ca.sumsqr(normal)) / 2
    energy = -area / 3 * ca.dot(p, x[:, 0] + x[:, 1] + x[:, 2])
    return ca.Function("area_gravity", [x, r, p], [energy])


def reference(x: AnyArray, r: AnyArray, p: AnyArray) -> AnyArray:
    """The same energy in plain NumPy (area by Gram determinant): (S,3,3), (S,3,3), (S,3) -> (S,)."""
    u, v = r[:, 1] - r[:, 0], r[:, 2] - r[:, 0]
    uu, vv, uv = (u * u).sum(-1), (v * v).sum(-1), (u * v).sum(-1)
    area = 0.5 * np.sqrt(uu * vv - uv * uv)
    return np.asarray(-area * (p * x.mean(axis=1)).sum(axis=-1))


def area_gravity(
    mesh: TriMesh, surface_density: ArrayLike, gravity: ArrayLike = (0.0, 0.0, -9.81)
) -> Energy:
    """Weight of every face of ``mesh``: ``surface_density`` [kg/m2], scalar or (F,); gravity [m/s2]."""
    faces = mesh.faces
    value, rho = per_element("density", surface_density, len(faces), "face", minimum=0.0)
    g = finite_vector("gravity", gravity)
    return Energy(
        name="gravity",
        density=density(),
        stencils=faces,
        params=rho[:, None] * g,
        load=True,
        reference=reference,
        material={"density": value, "gravity": g},
    )
