"""Inertia of a developable ribbon in an implicit Euler step, Pan 2016, Sec. 4.

    E = r^T M(c) r / (2 h^2),   r = x - 2 R(c; c^n, x^n) + R(c; c^{n-1}, x^{n-1})

R evaluates a former shape at the material points which the vertices occupy now: each rim is an
interpolant of its world positions over the material abscissa s = i l -+ c_i W/2.  M is the mass of
bilinear shape functions on the quads, so it depends on c; its derivative is part of the step.

In one interval an interpolant is a cubic in u = s - knot with coefficients (3,4), lowest power first:
`linear_piece` (the paper; kinks at the knots) or `hermite_piece` (three-point tangents, C1).
``lumped``: all mass on the centreline, whose stations are material points, so without resampling.
Densities are SX functions (x (3,k), r (3,k), p) -> J; r is not used.
"""

from __future__ import annotations

from functools import cache

import casadi as ca

HISTORY = 26  # parameters of one vertex: knot and 12 coefficients, for each of two former shapes


def _piece(name: str, coefficients: ca.SX, s: ca.SX, y: ca.SX) -> ca.Function:
    return ca.Function(name, [s, y], [coefficients])


@cache
def linear_piece() -> ca.Function:
    """Coefficients (3,4) between knots 1 and 2 of s (4,) with values y (3,4) [m]."""
    s, y = ca.SX.sym("s", 4), ca.SX.sym("y", 3, 4)
    slope = (y[:, 2] - y[:, 1]) / (s[2] - s[1])
    return _piece("linear_piece", ca.horzcat(y[:, 1], slope, ca.SX.zeros(3, 2)), s, y)


def _tangent(s: ca.SX, y: ca.SX, i: int) -> ca.SX:
    """Derivative at knot i of the parabola through knots i - 1, i, i + 1."""
    before, behind = s[i] - s[i - 1], s[i + 1] - s[i]
    first, second = (y[:, i] - y[:, i - 1]) / before, (y[:, i + 1] - y[:, i]) / behind
    return (behind * first + before * second) / (before + behind)


@cache
def hermite_piece() -> ca.Function:
    """Coefficients (3,4) between knots 1 and 2 of s (4,) with values y (3,4) [m]."""
    s, y = ca.SX.sym("s", 4), ca.SX.sym("y", 3, 4)
    run, rise = s[2] - s[1], y[:, 2] - y[:, 1]
    start, end = _tangent(s, y, 1), _tangent(s, y, 2)
    square = (3 * rise / run - 2 * start - end) / run
    cube = (start + end - 2 * rise / run) / run**2
    return _piece("hermite_piece", ca.horzcat(y[:, 1], start, square, cube), s, y)


def _former(p: ca.SX, s: ca.SX) -> ca.SX:
    """2 R^n - R^{n-1} at the abscissa s, from the `HISTORY` parameters of a vertex."""
    shapes = []
    for first in (0, HISTORY // 2):
        u, y = s - p[first], ca.reshape(p[first + 1 : first + 13], 3, 4)
        shapes.append(y[:, 0] + u * (y[:, 1] + u * (y[:, 2] + u * y[:, 3])))
    return 2 * shapes[0] - shapes[1]


@cache
def consistent() -> ca.Function:
    """One quad: x = (coordinates, coordinates, b, b, t, t), two stations of each.

    p = (rho, l, W, h, abscissa of the first station, then `HISTORY` numbers for each of b, b, t, t).
    """
    x, r = ca.SX.sym("x", 3, 6), ca.SX.sym("r", 3, 6)
    p = ca.SX.sym("p", 5 + 4 * HISTORY)
    rho, length, width, step, begin = (p[i] for i in range(5))
    residual = []
    for vertex in range(4):
        station, side = vertex % 2, 2 * (vertex // 2) - 1
        s = begin + station * length + side * x[0, station] * width / 2
        history = p[5 + HISTORY * vertex : 5 + HISTORY * (vertex + 1)]
        residual.append(x[:, 2 + vertex] - _former(history, s))
    run = width / 2 * (x[0, 1] - x[0, 0])
    below, above, mean = 4 * length - 2 * run, 4 * length + 2 * run, 2 * length
    # Along the rims [2 1; 1 2] / 6 couples the two stations.
    gram = [[_along(residual[i : i + 2], residual[j : j + 2]) for j in (0, 2)] for i in (0, 2)]
    moment = below * gram[0][0] + 2 * mean * gram[0][1] + above * gram[1][1]
    return ca.Function("ribbon_inertia", [x, r, p], [rho * width / 12 * moment / (2 * step**2)])


def _along(a: list[ca.SX], b: list[ca.SX]) -> ca.SX:
    diagonal = ca.dot(a[0], b[0]) + ca.dot(a[1], b[1])
    return diagonal / 3 + (ca.dot(a[0], b[1]) + ca.dot(a[1], b[0])) / 6


@cache
def lumped() -> ca.Function:
    """One station: x = (b, t), p = (mass [kg], h, former centre 2 y^n - y^{n-1} (3) [m])."""
    x, r, p = ca.SX.sym("x", 3, 2), ca.SX.sym("r", 3, 2), ca.SX.sym("p", 5)
    away = (x[:, 0] + x[:, 1]) / 2 - p[2:5]
    return ca.Function("ribbon_lumped", [x, r, p], [p[0] / (2 * p[1] ** 2) * ca.sumsqr(away)])
