"""Hinge bending, Ly 2018 Eq. (10); the discrete shell of Grinspun et al. 2003.

    E = k_theta / 2 * 3 Lbar^2 / Abar * (theta - thetabar)^2          per interior edge

Stencil (i, j, k, l): the two ends of the edge, then the opposite vertices; the triangles are
(i, j, k) and (j, i, l).  theta is the angle between their normals, zero when flat, in (-pi, pi];
Abar is the sum of the two rest areas.  ``k_theta`` [J] is an energy.  Smooth for non-degenerate
triangles away from the fully folded state theta = pi; the difference of angles is not wrapped.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import casadi as ca
import numpy as np

from casashell.engine.energy import Energy, MetricForm
from casashell.mesh import TriMesh
from casashell.typing import AnyArray, ArrayLike
from formulations.arguments import per_element

#: Natural numbers of a hinge: its angle, the length of its edge, the areas of its triangles.
_READS = ((0, 1, 2, 3), (0, 1), (0, 1, 2), (1, 0, 3))


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
def strained() -> ca.Function:
    """Energy [J] from the angle, n = natural angle, edge length, two areas and p = (k_theta) [J]."""
    now, n, p = ca.SX.sym("q"), ca.SX.sym("n", 4), ca.SX.sym("p", 1)
    stiffness = 3 * p[0] * n[1] ** 2 / (n[2] + n[3])
    return ca.Function("hinge_strained", [now, n, p], [stiffness / 2 * (now - n[0]) ** 2])


@cache
def density() -> ca.Function:
    """Energy [J] of one hinge from x (3,4), r (3,4) [m] and p = (k_theta) [J]."""
    x, r, p = ca.SX.sym("x", 3, 4), ca.SX.sym("r", 3, 4), ca.SX.sym("p", 1)
    edge, first, second = (ca.sqrt(ca.sumsqr(vector)) for vector in _normals(r))
    natural = ca.vertcat(angle(r), edge, first / 2, second / 2)
    return ca.Function("hinge_bending", [x, r, p], [strained()(angle(x), natural, p)])


@cache
def measure() -> ca.Function:
    """Strain measure of the term: the dihedral angle [rad]."""
    x = ca.SX.sym("x", 3, 4)
    return ca.Function("dihedral_angle", [x], [angle(x)])


def _cross(a: AnyArray, b: AnyArray) -> AnyArray:
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def _wings(x: AnyArray) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Unit edge and the parts of the two triangles orthogonal to it, for hinges x (4,3,S)."""
    edge, a, b = x[1] - x[0], x[2] - x[0], x[3] - x[0]
    edge = edge / np.sqrt((edge * edge).sum(axis=0))
    return edge, a - edge * (a * edge).sum(axis=0), b - edge * (b * edge).sum(axis=0)


def _fold(x: AnyArray) -> AnyArray:
    """Dihedral angle as pi minus the angle between the wings; complex-step safe atan2."""
    edge, a, b = _wings(x)
    cosine, sine = -(a * b).sum(axis=0), (_cross(b, a) * edge).sum(axis=0)
    turned = np.arctan2(sine.real, cosine.real)
    if not np.iscomplexobj(sine):
        return np.asarray(turned)
    slope = cosine.real * sine.imag - sine.real * cosine.imag
    return np.asarray(turned + 1j * slope / (sine.real**2 + cosine.real**2))


def reference(r: AnyArray, p: AnyArray) -> Callable[[AnyArray], AnyArray]:
    """The same energy in plain NumPy: r (4,3,S), p (1,S) -> function of x (4,3,S), complex allowed.

    Angle and area come from the wings of the hinge, not from its normals.
    """
    _, a, b = _wings(r)
    heights = np.sqrt((a * a).sum(axis=0)) + np.sqrt((b * b).sum(axis=0))
    length = np.sqrt(((r[1] - r[0]) ** 2).sum(axis=0))
    mean = 0.25 * length * heights
    return metric_reference(np.stack([_fold(r), length, mean, mean]), p)


def metric_reference(n: AnyArray, p: AnyArray) -> Callable[[AnyArray], AnyArray]:
    """The same from n (4,S): natural angle, length of the edge and the two areas."""
    return lambda x: 1.5 * p[0] * n[1] ** 2 / (n[2] + n[3]) * (_fold(x) - n[0]) ** 2


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
        metric=MetricForm(_READS, strained(), metric_reference),
    )
