"""Energies of a developable ribbon, Pan 2016, Sec. 4, as densities of one crease or one quad.

    bending      D/2 W/h (beta - betabar)^2 (1 + c^2) g(y)        per crease, h its share of the length
                 g = 1 (Sadowsky, the paper) or atanh(y)/y (Wunderlich), y = W/2 dc/ds
    rulings      m/2 (c - cbar)^2                                  regulariser, target rulings
    gravity      -m_b g.b - m_t g.t                                per quad, exact for planar quads
    guiding      k/2 |n - nstar|^2                                 normal of a quad
    load         -f.x                                              at a material point
    attachment   y.(x - xstar)                                     linear in the multiplier y

Every density is an SX function (x (3,k), r (3,k), p) -> J.  A station i of the ribbon has four columns:
its coordinates (c_i, beta_i, 0), the points b_i and t_i [m], the normal n_i of the quad behind it.
D [J] is the plate modulus: the paper's k, defined with the mean curvature, is 2 D.  r is not used.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import atanh

import casadi as ca

#: |y| beyond which g goes on linearly in y^2; only infeasible trial points get there.
EDGE = 0.97


def _density(name: str, k: int, m: int, form: Callable[[ca.SX, ca.SX], ca.SX]) -> ca.Function:
    x, r, p = ca.SX.sym("x", 3, k), ca.SX.sym("r", 3, k), ca.SX.sym("p", m)
    return ca.Function(name, [x, r, p], [form(x, p)])


def _factor(y2: ca.SX) -> ca.SX:
    """atanh(y)/y as a function of y^2 >= 0; finite with finite derivatives everywhere."""
    limit, small = EDGE**2, 1e-3
    y = ca.sqrt(ca.fmax(ca.fmin(y2, limit), small))
    value, at = ca.atanh(y) / y, atanh(EDGE) / EDGE
    slope = (1 / (1 - limit) - at) / (2 * limit)
    series = 1 + sum(y2**n / (2 * n + 1) for n in range(1, 7))
    return ca.if_else(y2 < small, series, ca.if_else(y2 > limit, at + slope * (y2 - limit), value))


@cache
def sadowsky() -> ca.Function:
    """One crease: x = (coordinates), p = (D, W, h, betabar)."""

    def form(x: ca.SX, p: ca.SX) -> ca.SX:
        return p[0] * p[1] / (2 * p[2]) * (x[1, 0] - p[3]) ** 2 * (1 + x[0, 0] ** 2)

    return _density("ribbon_sadowsky", 1, 4, form)


@cache
def wunderlich() -> ca.Function:
    """One crease: x = (coordinates of three creases, itself the second), p = (D, W, h, betabar, span)."""

    def form(x: ca.SX, p: ca.SX) -> ca.SX:
        y = p[1] / 2 * (x[0, 2] - x[0, 0]) / p[4]
        plain = p[0] * p[1] / (2 * p[2]) * (x[1, 1] - p[3]) ** 2 * (1 + x[0, 1] ** 2)
        return plain * _factor(y**2)

    return _density("ribbon_wunderlich", 3, 5, form)


@cache
def rulings() -> ca.Function:
    """One crease: x = (coordinates), p = (m [J], cbar)."""
    return _density("ribbon_rulings", 1, 2, lambda x, p: p[0] / 2 * (x[0, 0] - p[1]) ** 2)


@cache
def gravity() -> ca.Function:
    """One quad: x = (coordinates, coordinates, b, b, t, t), p = (rho, l, W, g (3))."""

    def form(x: ca.SX, p: ca.SX) -> ca.SX:
        run = p[2] / 2 * (x[0, 1] - x[0, 0])
        below, above = p[1] - run, p[1] + run
        share = p[0] * p[2] / 12
        bottom, top = x[:, 2] + x[:, 3], x[:, 4] + x[:, 5]
        moment = (2 * below + above) * bottom + (below + 2 * above) * top
        return -share * ca.dot(p[3:6], moment)

    return _density("ribbon_gravity", 6, 6, form)


@cache
def guiding() -> ca.Function:
    """One quad: x = (normal), p = (k [J], nstar (3)).  No force at n = -nstar: turn it by steps."""
    return _density("ribbon_guiding", 1, 4, lambda x, p: p[0] / 2 * ca.sumsqr(x[:, 0] - p[1:4]))


def material_point(x: ca.SX, s: ca.SX, y: ca.SX, begin: ca.SX, run: ca.SX, width: ca.SX) -> ca.SX:
    """World position of the material point (s, y) of the quad that begins at ``begin``."""
    before, behind = begin + x[0, 0] * y, begin + run + x[0, 1] * y
    along, across = (s - before) / (behind - before), y / width + 0.5
    first = (1 - across) * x[:, 2] + across * x[:, 4]
    second = (1 - across) * x[:, 3] + across * x[:, 5]
    return (1 - along) * first + along * second


@cache
def load() -> ca.Function:
    """One quad, x as for `gravity`, p = (f (3) [N], s, y, begin, l, W)."""

    def form(x: ca.SX, p: ca.SX) -> ca.SX:
        return -ca.dot(p[:3], material_point(x, p[3], p[4], p[5], p[6], p[7]))

    return _density("ribbon_load", 6, 8, form)


@cache
def attachment() -> ca.Function:
    """One quad, x as for `gravity`, p = (multiplier (3) [N], xstar (3), s, y, begin, l, W)."""

    def form(x: ca.SX, p: ca.SX) -> ca.SX:
        return ca.dot(p[:3], material_point(x, p[6], p[7], p[8], p[9], p[10]) - p[3:6])

    return _density("ribbon_attachment", 6, 11, form)
