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

from casashell.engine.energy import Energy, MetricForm
from casashell.mesh import TriMesh
from casashell.typing import ArrayLike
from formulations.arguments import per_element
from formulations.hinge_reference import metric_reference, reference

#: Natural numbers of a hinge: its angle, the length of its edge, the areas of its triangles.
_READS = ((0, 1, 2, 3), (0, 1), (0, 1, 2), (1, 0, 3))
#: Share of its natural area below which a triangle in motion counts as crushed.
_CRUSHED = 0.1


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


def _natural(r: ca.SX) -> ca.SX:
    """The natural numbers that positions r (3,4) give."""
    edge, first, second = (ca.sqrt(ca.sumsqr(vector)) for vector in _normals(r))
    return ca.vertcat(angle(r), edge, first / 2, second / 2)


@cache
def density() -> ca.Function:
    """Energy [J] of one hinge from x (3,4), r (3,4) [m] and p = (k_theta) [J]."""
    x, r, p = ca.SX.sym("x", 3, 4), ca.SX.sym("r", 3, 4), ca.SX.sym("p", 1)
    return ca.Function("hinge_bending", [x, r, p], [strained()(angle(x), _natural(r), p)])


@cache
def fading() -> ca.Function:
    """Energy [J] from x (3,4) and n, p of `strained`, which fades where a triangle is crushed.

    The angle of a triangle without area is anything, and forces grow like one over its height; springs
    on edges do not keep a triangle from there.  With t = (10 A / Abar)^2 < 1 the energy is scaled
    by t^3 (10 - 15 t + 6 t^2) for each triangle; at t = 1 that is 1, with two slopes of zero.
    """
    x, n, p = ca.SX.sym("x", 3, 4), ca.SX.sym("n", 4), ca.SX.sym("p", 1)
    energy = strained()(angle(x), n, p)
    for k, normal in enumerate(_normals(x)[1:]):
        t = ca.fmin(ca.sumsqr(normal) / (2 * _CRUSHED * n[2 + k]) ** 2, 1)
        energy *= t**3 * (10 - 15 * t + 6 * t**2)
    return ca.Function("hinge_fading", [x, n, p], [energy])


@cache
def in_motion() -> ca.Function:
    """The energy of `fading` from x (3,4), r (3,4) [m] and p = (k_theta) [J]."""
    x, r, p = ca.SX.sym("x", 3, 4), ca.SX.sym("r", 3, 4), ca.SX.sym("p", 1)
    return ca.Function("hinge_in_motion", [x, r, p], [fading()(x, _natural(r), p)])


@cache
def measure() -> ca.Function:
    """Strain measure of the term: the dihedral angle [rad]."""
    x = ca.SX.sym("x", 3, 4)
    return ca.Function("dihedral_angle", [x], [angle(x)])


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
        metric=MetricForm(_READS, strained(), metric_reference, fading()),
        in_motion=in_motion(),
    )
