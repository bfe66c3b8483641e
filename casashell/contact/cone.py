"""Coulomb's friction cone, its polar and the exact projection onto it.

    K(n, mu)  = { f : |f_T| <= mu f_N },   f_N = f . n,  f_T = f - f_N n
    K*(n, mu) = { g : g . f <= 0 for all f in K } = { g : mu |g_T| <= -g_N }     (the polar cone)

n is the unit normal out of the obstacle into the shell, so f is the force on the shell and f_N > 0
pushes.  Arrays: forces f and normals n are (C, 3), mu is a number or (C,), finite, zero or more.
With the half angle phi of the cone, tan phi = mu, everything is written in cos phi and sin phi,
which keeps mu = 0 (a ray) and very large mu (nearly a half-space) exact.
"""

from __future__ import annotations

import numpy as np

from casashell.typing import ArrayLike, BoolArray, FloatArray

#: how far from 1 the length of a normal may be
UNIT = 1e-6


def split(f: ArrayLike, n: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Normal component f_N (C,) and tangential part f_T (C, 3) of forces; ValueError on shapes."""
    force, normal = _pair(f, n)
    f_n = np.einsum("ij,ij->i", force, normal)
    return f_n, force - f_n[:, None] * normal


def margin(f: ArrayLike, n: ArrayLike, mu: ArrayLike) -> FloatArray:
    """mu f_N - |f_T| (C,) in the unit of f: zero or more inside the cone.  ValueError on bad mu."""
    f_n, f_t = split(f, n)
    room: FloatArray = _friction(mu, len(f_n)) * f_n - np.linalg.norm(f_t, axis=1)
    return room


def inside(f: ArrayLike, n: ArrayLike, mu: ArrayLike, tolerance: float = 0.0) -> BoolArray:
    """True (C,) where f lies in K, or within ``tolerance`` (distance, unit of f) of it."""
    f_n, slip, cos, sin = _meridian(f, n, mu)
    return _distance(f_n, slip, cos, sin) <= tolerance


def in_polar(g: ArrayLike, n: ArrayLike, mu: ArrayLike, tolerance: float = 0.0) -> BoolArray:
    """True (C,) where g lies in the polar cone, or within ``tolerance`` of it.

    The polar is the cone of half angle pi/2 - phi around -n.
    """
    g_n, slip, cos, sin = _meridian(g, n, mu)
    return _distance(-g_n, slip, sin, cos) <= tolerance


def project(f: ArrayLike, n: ArrayLike, mu: ArrayLike) -> FloatArray:
    """Nearest force in the cone (C, 3), in the Euclidean norm.

    f itself inside the cone, zero inside the polar cone, otherwise the foot of the perpendicular
    on the nearest generator d = cos(phi) n + sin(phi) f_T / |f_T|, which is (f . d) d.
    """
    force, normal = _pair(f, n)
    f_n, f_t = split(force, normal)
    slip = np.linalg.norm(f_t, axis=1)
    cos, sin = _angle(mu, len(f_n))
    within = slip * cos <= f_n * sin
    # mu = 0: the line above also holds for f_N < 0, and the ray needs f_N >= 0
    within &= f_n >= 0.0
    along = np.where(within, 0.0, np.maximum(f_n * cos + slip * sin, 0.0))
    stretch = along * sin / np.where(slip > 0.0, slip, 1.0)
    foot = (along * cos)[:, None] * normal + stretch[:, None] * f_t
    nearest: FloatArray = np.where(within[:, None], force, foot)
    return nearest


def tangents(normals: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Orthonormal t1, t2 (C, 3) with t1 x t2 = n for unit normals (C, 3).

    Duff et al. 2017, "Building an orthonormal basis, revisited", JCGT 6(1): smooth in n within
    each half n_z > 0 and n_z < 0, with a jump only across n_z = 0.
    Raises ValueError naming the first normal that is not a unit vector.
    """
    n, _ = _pair(normals, normals)
    check_unit(n, "normals")
    x, y, z = n.T
    sign = np.where(z < 0.0, -1.0, 1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    t1 = np.column_stack([1.0 + sign * x * x * a, sign * b, -sign * x])
    t2 = np.column_stack([b, sign + y * y * a, -y])
    return t1, t2


def check_unit(normals: FloatArray, what: str) -> None:
    """ValueError naming the first row of (C, 3) that is not a unit vector."""
    length = np.linalg.norm(normals, axis=1)
    bad = np.flatnonzero(~(np.abs(length - 1.0) <= UNIT))
    if bad.size:
        raise ValueError(
            f"{what}: row {int(bad[0])} is not a unit vector, its length is {length[bad[0]]:.6g}; "
            "divide each normal by its length"
        )


def _meridian(
    f: ArrayLike, n: ArrayLike, mu: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """f_N, |f_T|, cos phi, sin phi, each (C,)."""
    f_n, f_t = split(f, n)
    cos, sin = _angle(mu, len(f_n))
    return f_n, np.linalg.norm(f_t, axis=1), cos, sin


def _distance(
    axial: FloatArray, across: FloatArray, cos: FloatArray, sin: FloatArray
) -> FloatArray:
    """Distance (C,) from (axial, across >= 0) to the wedge around the axis; 0 or less inside."""
    beyond = across * cos - axial * sin
    # behind the apex, past the perpendicular of the generator, the apex is nearest
    behind = axial * cos + across * sin < 0.0
    away: FloatArray = np.where(behind, np.hypot(axial, across), beyond)
    return away


def _angle(mu: ArrayLike, count: int) -> tuple[FloatArray, FloatArray]:
    """cos phi and sin phi (C,) of the half angle phi = arctan mu."""
    friction = _friction(mu, count)
    cos = 1.0 / np.hypot(1.0, friction)
    return cos, friction * cos


def _friction(mu: ArrayLike, count: int) -> FloatArray:
    friction = np.asarray(mu, dtype=np.float64)
    if friction.shape not in ((), (1,), (count,)):
        raise ValueError(f"friction must be one number or ({count},), got {friction.shape}")
    bad = np.flatnonzero(~(np.isfinite(friction) & (friction >= 0.0)))
    if bad.size:
        value = friction.reshape(-1)[bad[0]]
        raise ValueError(f"friction of contact {int(bad[0])} must be finite and >= 0, got {value}")
    return np.broadcast_to(friction, (count,))


def _pair(f: ArrayLike, n: ArrayLike) -> tuple[FloatArray, FloatArray]:
    force, normal = np.asarray(f, dtype=np.float64), np.asarray(n, dtype=np.float64)
    if force.ndim != 2 or force.shape[1] != 3 or force.shape != normal.shape:
        raise ValueError(
            f"forces and normals must both have shape (C, 3), got {force.shape} and {normal.shape}"
        )
    return force, normal
