"""Hinge bending, Ly 2018 Eq. (10); the discrete shell of Grinspun et al. 2003.

    E = k_theta / 2 * 3 Lbar^2 / Abar * (theta - thetabar)^2          per interior edge

Stencil (i, j, k, l): the two ends of the edge, then the opposite vertices; the triangles are
(i, j, k) and (j, i, l).  theta is the angle between their normals, zero when flat, in (-pi, pi];
Abar is the sum of the two rest areas.  ``k_theta`` [J] is an energy.  Smooth for non-degenerate
triangles away from the fully folded state theta = pi; the difference of angles is not wrapped.
"""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np

from casashell.engine.energy import Energy
from casashell.mesh import TriMesh
from casashell.typing import AnyArray, ArrayLike
from formulations.arguments import per_element


def _normals(x: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    edge = x[:, 1] - x[:, 0]
    first = ca.cross(edge, x[:, 2] - x[:, 0])
    second = ca.cross(x[:, 3] - x[:, 0], edge)
    return edge, first, second


def angle(x: ca.SX) -> ca.SX:
    """Signed dihedral angle [rad] of the hinge with vertices in the columns of ``x`` (3,4)."""
    edge, first, second = _normals(x)
    sine = ca.dot(ca.cross(first, second), edge) / ca.sqrt(ca.sumsqr(edge))
    return ca.atan2(sine, ca.dot(first, second))


@cache
def density() -> ca.Function:
    """Energy [J] of one hinge from x (3,4), r (3,4) [m] and p = (k_theta) [J]."""
    x, r, p = ca.SX.sym("x", 3, 4), ca.SX.sym("r", 3, 4), ca.SX.sym("p", 1)
    edge, first, second = _normals(r)
    area = (ca.sqrt(ca.sumsqr(first)) + ca.sqrt(ca.sumsqr(second))) / 2
    energy = p[0] / 2 * 3 * ca.sumsqr(edge) / area * (angle(x) - angle(r)) ** 2
    return ca.Function("hinge_bending", [x, r, p], [energy])


@cache
def measure() -> ca.Function:
    """Strain measure of the term: the dihedral angle [rad]."""
    x = ca.SX.sym("x", 3, 4)
    return ca.Function("dihedral_angle", [x], [angle(x)])


def _angle_and_factor(x: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Dihedral angle and 3 L^2 / A of hinges x (S,4,3), through the cotangents of the two triangles."""
    edge, a, b = x[:, 1] - x[:, 0], x[:, 2] - x[:, 0], x[:, 3] - x[:, 0]
    squared = (edge * edge).sum(axis=-1)
    # Components of the two wings orthogonal to the edge: their angle is pi minus the dihedral angle.
    a_out = a - edge * ((a * edge).sum(axis=-1) / squared)[:, None]
    b_out = b - edge * ((b * edge).sum(axis=-1) / squared)[:, None]
    size = np.sqrt(squared)
    cosine = -(a_out * b_out).sum(axis=-1)
    sine = (np.cross(b_out, a_out) * edge).sum(axis=-1) / size
    turned = np.arctan2(sine.real, cosine.real) + 0j
    if np.iscomplexobj(sine):  # first-order part of atan2, exact for complex-step derivatives
        turned += 1j * (cosine.real * sine.imag - sine.real * cosine.imag) / (
            sine.real**2 + cosine.real**2
        )
    height = np.sqrt((a_out * a_out).sum(axis=-1)) + np.sqrt((b_out * b_out).sum(axis=-1))
    return (turned if np.iscomplexobj(sine) else turned.real), 6.0 * size / height


def reference(x: AnyArray, r: AnyArray, p: AnyArray) -> AnyArray:
    """The same energy in plain NumPy: x, r (S,4,3), p (S,1) -> (S,); complex input allowed."""
    now, _ = _angle_and_factor(x)
    rest, factor = _angle_and_factor(r)
    return np.asarray(0.5 * p[:, 0] * factor * (now - rest) ** 2)


def hinge_bending(mesh: TriMesh, bend: ArrayLike) -> Energy:
    """Bending of every interior edge of ``mesh`` with stiffness ``bend`` [J], scalar or (H,)."""
    hinges = mesh.hinges
    value, stiffness = per_element("bend", bend, len(hinges), "hinge", minimum=0.0)
    return Energy(
        name="bend",
        density=density(),
        stencils=hinges,
        params=stiffness[:, None],
        measure=measure(),
        reference=reference,
        material={"hinges": hinges, "bend": value},
    )
