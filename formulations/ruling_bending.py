"""The map of Pan 2016, Sec. 3: slopes of the rulings and bending angles to a developable strip.

    P_0 = [exp([w]) t; 0 1],  P_i = P_{i-1} G(c_i, beta_i),  b_i = P_i B_i,  t_i = P_i T_i,  n_e = P_e e_z
    B_i, T_i = (i l -+ c_i W/2, -+W/2, 0)          material end points of ruling i, c_0 = c_N = 0

A strip of length L and width W in N quads of length l = L/N.  c_i is the cotangent of the angle
between ruling i and the centreline, beta_i the bending angle across it; G rotates by beta_i about the
material line through B_i and T_i.  beta > 0 with c = 0 turns the strip toward -z.  The map is an
isometry for every (c, beta), and smooth.
"""

from __future__ import annotations

from functools import cache

import casadi as ca

FLAT = 1e-24  # added to the square of an angle, so that the series of exp is smooth at zero


def crease(c: ca.SX, beta: ca.SX, s: ca.SX) -> ca.SX:
    """Transformation G (4,4) of the crease with slope c and angle beta [rad] at the abscissa s [m]."""
    length = 1 + c**2
    a2, ab, b2 = c**2 / length, c / length, 1 / length
    a, b = c / ca.sqrt(length), 1 / ca.sqrt(length)
    turn, sine = 1 - ca.cos(beta), ca.sin(beta)
    return ca.vertcat(
        ca.horzcat(1 - b2 * turn, ab * turn, b * sine, s * b2 * turn),
        ca.horzcat(ab * turn, 1 - a2 * turn, -a * sine, -s * ab * turn),
        ca.horzcat(-b * sine, a * sine, 1 - turn, s * b * sine),
        ca.horzcat(0, 0, 0, 1),
    )


def frame(w: ca.SX, t: ca.SX) -> ca.SX:
    """Rigid motion (4,4): rotation vector w (3,) [rad], then the translation t (3,) [m]."""
    angle = ca.sqrt(ca.sumsqr(w) + FLAT)
    cross = ca.skew(w)
    rotation = (
        ca.SX.eye(3)
        + ca.sin(angle) / angle * cross
        + 2 * (ca.sin(angle / 2) / angle) ** 2 * (cross @ cross)
    )
    return ca.vertcat(ca.horzcat(rotation, t), ca.horzcat(0, 0, 0, 1))


@cache
def ruling_bending(segments: int, clamp_crease: bool = False) -> ca.Function:
    """The whole map for ``segments`` quads, of any size.

    Inputs:  slopes (N-1,), angles (N-1,) [rad], rotation vector (3,) [rad], translation (3,) [m],
             length and width [m]; with ``clamp_crease`` angles is (N,), the first one across an extra
             crease at the very beginning of the strip, which bends what the first half segment would.
    Outputs: bottom (3,N+1), top (3,N+1) [m], normals (3,N).

    Linear in size and cost; never emit C of it, compilers take minutes.
    """
    slopes = ca.SX.sym("slopes", segments - 1)
    angles = ca.SX.sym("angles", segments - 1 + clamp_crease)
    w, t = ca.SX.sym("w", 3), ca.SX.sym("t", 3)
    length, width = ca.SX.sym("length"), ca.SX.sym("width")
    c = ca.vertcat(0, slopes, 0)
    beta = ca.vertcat(angles, 0) if clamp_crease else ca.vertcat(0, angles, 0)
    placed = frame(w, t)
    bottom, top, normals = [], [], []
    for i in range(segments + 1):
        s = i * length / segments
        if i < segments and (i > 0 or clamp_crease):
            placed = ca.mtimes(placed, crease(c[i], beta[i], s))
        run = c[i] * width / 2
        bottom.append((placed @ ca.vertcat(s - run, -width / 2, 0, 1))[:3])
        top.append((placed @ ca.vertcat(s + run, width / 2, 0, 1))[:3])
        normals.append(placed[:3, 2])
    return ca.Function(
        f"ruling_bending_{segments}",
        [slopes, angles, w, t, length, width],
        [ca.horzcat(*bottom), ca.horzcat(*top), ca.horzcat(*normals[:-1])],
        ["slopes", "angles", "w", "t", "length", "width"],
        ["bottom", "top", "normals"],
    )


@cache
def link() -> ca.Function:
    """One quad, without a chain: y . (end of the quad - what its begin makes of it).

    x = (coordinates, b, t, n) of the stations before and behind, p = (y (9), l, W, unit of length);
    n is the normal behind a station.  The nine conditions are on b / unit, t / unit and n.
    """
    x, r, p = ca.SX.sym("x", 3, 8), ca.SX.sym("r", 3, 8), ca.SX.sym("p", 12)
    length, width, unit = p[9], p[10], p[11]
    across, normal, c = (x[:, 2] - x[:, 1]) / width, x[:, 3], x[0, 0]
    # across = c e_x + e_y with e_y = n x e_x
    e_x = (c * across - ca.cross(normal, across)) / (1 + c**2)
    e_y = across - c * e_x
    ruling = x[0, 4] * e_x + e_y
    middle = (x[:, 1] + x[:, 2]) / 2 + length * e_x
    size = ca.sqrt(1 + x[0, 4] ** 2)
    turned = ca.cos(x[1, 4]) * normal + ca.sin(x[1, 4]) * ca.cross(ruling / size, normal)
    gaps = ca.vertcat(
        (x[:, 5] - middle + width / 2 * ruling) / unit,
        (x[:, 6] - middle - width / 2 * ruling) / unit,
        x[:, 7] - turned,
    )
    return ca.Function("ribbon_link", [x, r, p], [ca.dot(p[:9], gaps)])


@cache
def rigid_begin() -> ca.Function:
    """x = (b, t, n), p = (y (3), W): y . (|t - b|^2 / W^2 - 1, n . (t - b) / W, |n|^2 - 1)."""
    x, r, p = ca.SX.sym("x", 3, 3), ca.SX.sym("r", 3, 3), ca.SX.sym("p", 4)
    across = (x[:, 1] - x[:, 0]) / p[3]
    gaps = ca.vertcat(ca.sumsqr(across) - 1, ca.dot(across, x[:, 2]), ca.sumsqr(x[:, 2]) - 1)
    return ca.Function("ribbon_rigid_begin", [x, r, p], [ca.dot(p[:3], gaps)])
