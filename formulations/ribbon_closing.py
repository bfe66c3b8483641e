"""Joining the two ends of a ribbon, Pan 2016, Sec. 4: loops and Moebius bands.

Columns x = (b_0, t_0, n_0, b_N, t_N, n_N).  With the frames F = (along, across, normal) of the first
and last quad, R = F_0^T F_N and the mid points m of the end rulings (``held``: F_0 and m_0 are given):

    smooth, held  y . (m_N - m_0, R_21, R_31, R_32)   the quads at the junction are in one plane
    crease        y . (m_N - m_0, R_12, R_32)         the end rulings meet, the strip may bend there
    junction      D W / (2 h) (beta - betabar)^2      bending across that crease
    ruling        y (c - cbar)                        one ruling does not turn, x = (coordinates)

Independent conditions: b_N = b_0, t_N = t_0 are six of which one repeats the width.  They hold for
R_33 > 0 (a loop) and R_33 < 0 (a Moebius band) alike; a solution near one stays there.
"""

from __future__ import annotations

from functools import cache

import casadi as ca


def _end(x: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Mid point and frame of an end with the columns (b, t, n)."""
    across = x[:, 1] - x[:, 0]
    across = across / ca.sqrt(ca.sumsqr(across))
    return (x[:, 0] + x[:, 1]) / 2, ca.horzcat(ca.cross(across, x[:, 2]), across, x[:, 2])


def _frames(x: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Mid point of the last end ruling seen from the first one, and the frames F_0, F_N."""
    (begin, first), (end, last) = _end(x[:, :3]), _end(x[:, 3:])
    return end - begin, first, last


def _condition(name: str, entries: tuple[tuple[int, int], ...]) -> ca.Function:
    x, r, p = ca.SX.sym("x", 3, 6), ca.SX.sym("r", 3, 6), ca.SX.sym("p", 4 + len(entries))
    gap, start, end = _frames(x)
    turned = ca.mtimes(start.T, end)
    values = ca.vertcat(gap / p[-1], *(turned[i, j] for i, j in entries))
    return ca.Function(name, [x, r, p], [ca.dot(p[:-1], values)])


@cache
def smooth() -> ca.Function:
    """p = (multipliers (6), L): the gap is measured in lengths of the ribbon."""
    return _condition("ribbon_closing_smooth", ((1, 0), (2, 0), (2, 1)))


@cache
def crease() -> ca.Function:
    """p = (multipliers (5), L)."""
    return _condition("ribbon_closing_crease", ((0, 1), (2, 1)))


@cache
def held() -> ca.Function:
    """x = (b, t, n), p = (multipliers (6), m (3), F (9) column by column, L)."""
    x, r, p = ca.SX.sym("x", 3, 3), ca.SX.sym("r", 3, 3), ca.SX.sym("p", 19)
    middle, frame = _end(x)
    turned = ca.mtimes(ca.reshape(p[9:18], 3, 3).T, frame)
    values = ca.vertcat((middle - p[6:9]) / p[18], turned[1, 0], turned[2, 0], turned[2, 1])
    return ca.Function("ribbon_held", [x, r, p], [ca.dot(p[:6], values)])


@cache
def junction() -> ca.Function:
    """Bending at the junction [J], p = (D, W, h, betabar, side); side is 1 for a loop, -1 for Moebius."""
    x, r, p = ca.SX.sym("x", 3, 6), ca.SX.sym("r", 3, 6), ca.SX.sym("p", 5)
    _, start, end = _frames(x)
    turned = p[4] * ca.mtimes(start.T, end)[2, :]
    beta = ca.atan2(turned[0], turned[2])
    return ca.Function(
        "ribbon_junction", [x, r, p], [p[0] * p[1] / (2 * p[2]) * (beta - p[3]) ** 2]
    )


@cache
def ruling() -> ca.Function:
    """x = (coordinates), p = (multiplier, cbar)."""
    x, r, p = ca.SX.sym("x", 3, 1), ca.SX.sym("r", 3, 1), ca.SX.sym("p", 2)
    return ca.Function("ribbon_ruling", [x, r, p], [p[0] * (x[0, 0] - p[1])])
