"""Gravity with the mass taken from the natural area, Ly 2018 Eqs. (11)-(12).

    E = -rho Abar / 3 * g . (x_1 + x_2 + x_3)          per triangle

Stencil: the corners of a triangle.  The mass of a vertex is a third of rho [kg/m2] times the rest
areas around it and therefore moves with the natural shape.  Smooth for non-degenerate rest triangles.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import casadi as ca
import numpy as np

from casashell.engine.energy import Energy, MetricForm
from casashell.mesh import TriMesh
from casashell.typing import AnyArray, ArrayLike
from formulations.arguments import finite_vector, per_element


@cache
def weighed() -> ca.Function:
    """Energy [J] of one triangle from x (3,3) [m], its natural area n [m2] and p = rho g (3) [N/m2]."""
    x, area, p = ca.SX.sym("x", 3, 3), ca.SX.sym("n", 1), ca.SX.sym("p", 3)
    energy = -area / 3 * ca.dot(p, x[:, 0] + x[:, 1] + x[:, 2])
    return ca.Function("area_weighed", [x, area, p], [energy])


@cache
def density() -> ca.Function:
    """Energy [J] of one triangle from x (3,3), r (3,3) [m] and p = rho g (3) [N/m2]."""
    x, r, p = ca.SX.sym("x", 3, 3), ca.SX.sym("r", 3, 3), ca.SX.sym("p", 3)
    normal = ca.cross(r[:, 1] - r[:, 0], r[:, 2] - r[:, 0])
    area = ca.sqrt(ca.sumsqr(normal)) / 2
    return ca.Function("area_gravity", [x, r, p], [weighed()(x, area, p)])


def reference(r: AnyArray, p: AnyArray) -> Callable[[AnyArray], AnyArray]:
    """The same energy in plain NumPy: r (3,3,S), p (3,S) -> function of x (3,3,S), complex allowed.

    The area comes from the Gram determinant.
    """
    u, v = r[1] - r[0], r[2] - r[0]
    area = 0.5 * np.sqrt((u * u).sum(0) * (v * v).sum(0) - (u * v).sum(0) ** 2)
    return metric_reference(area[None], p)


def metric_reference(n: AnyArray, p: AnyArray) -> Callable[[AnyArray], AnyArray]:
    """The same from the natural areas n (1,S)."""
    return lambda x: -n[0] / 3.0 * (p * (x[0] + x[1] + x[2])).sum(axis=0)


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
        metric=MetricForm(((0, 1, 2),), weighed(), metric_reference),
    )
