"""Coulomb contact of one point in closed form, and swept over many points (Gauss-Seidel).

Motion and force of a contact in its axes (N, T1, T2): u = W f + b with W (3,3) positive definite.

    b_N >= 0                  f = 0
    f = -W^-1 b in the cone   it sticks
    otherwise                 it slides: u_N = 0, u_T = -alpha f_T, |f_T| = mu f_N, alpha > 0

Sliding leaves f_T(alpha) = -(S + alpha I)^-1 c after f_N is eliminated, and |f_T|^2 = mu^2 f_N^2 is a
quartic in alpha (Bonnefon and Daviet 2011, "Quartic formulation of Coulomb 3D frictional contact").
"""

from __future__ import annotations

import numpy as np

from casashell.typing import FloatArray

#: Sweeps over all contacts, and the relative change of the forces that ends them.
SWEEPS, SETTLED = 20000, 1e-13


def one_contact(w: FloatArray, b: FloatArray, mu: float) -> FloatArray:
    """Force (3,) in the axes (N, T1, T2) of one contact with u = w f + b."""
    if b[0] >= 0.0:
        return np.zeros(3)
    stuck = -np.linalg.solve(w, b)
    if np.hypot(stuck[1], stuck[2]) <= mu * stuck[0]:
        return np.asarray(stuck)
    if mu == 0.0:
        return np.array([-b[0] / w[0, 0], 0.0, 0.0])
    return _sliding(w, b, mu)


def _sliding(w: FloatArray, b: FloatArray, mu: float) -> FloatArray:
    row = w[0, 1:]
    s = w[1:, 1:] - np.outer(row, row) / w[0, 0]
    c = b[1:] - row * (b[0] / w[0, 0])
    scale = float(np.trace(s)) / 2.0
    s, c = s / scale, c / scale
    # f_T = -q(alpha) / det(alpha) with q = adj(S + alpha I) c, both polynomials in alpha.
    adjugate = np.array([[s[1, 1], -s[0, 1]], [-s[1, 0], s[0, 0]]]) @ c
    determinant = np.array([1.0, s[0, 0] + s[1, 1], s[0, 0] * s[1, 1] - s[0, 1] * s[1, 0]])
    q = [np.array([c[k], adjugate[k]]) for k in range(2)]
    along = np.polyadd(row[0] * q[0], row[1] * q[1])
    normal = np.polysub(along, b[0] * determinant) / w[0, 0]  # f_N times the determinant
    quartic = np.polysub(
        np.polyadd(np.polymul(q[0], q[0]), np.polymul(q[1], q[1])),
        mu**2 * np.polymul(normal, normal),
    )
    best, chosen = np.inf, np.zeros(3)
    for root in np.roots(quartic):
        alpha = float(root.real)
        if alpha < 0.0:
            continue
        det = float(np.polyval(determinant, alpha))
        f_t = -np.array([np.polyval(part, alpha) for part in q]) / det
        f_n = float(np.polyval(normal, alpha)) / det
        error = abs(float(np.hypot(*f_t)) - mu * f_n) + abs(float(root.imag))
        if f_n > 0.0 and error < best:
            best, chosen = error, np.array([f_n, *f_t])
    return chosen


def sweep(
    w: FloatArray,
    b: FloatArray,
    friction: FloatArray,
    f: FloatArray,
    sweeps: int = SWEEPS,
    settled: float = SETTLED,
) -> FloatArray:
    """Forces (C,3) of all contacts with u = W f + b, W (3C,3C), b (C,3), from a first guess f (C,3).

    Block Gauss-Seidel with `one_contact`; warm starts cost nothing.
    sweeps, settled  most sweeps, and the relative change of the forces that ends them
    """
    f, count = np.array(f), len(f)
    motion = (w @ f.ravel()).reshape(-1, 3) + b
    places = [slice(3 * i, 3 * i + 3) for i in range(count)]
    blocks = [w[place, place] for place in places]
    compliance = np.array([np.trace(block) / 3.0 for block in blocks])
    known = np.full((count, 3), np.inf)
    limit = 0.0
    for _ in range(sweeps):
        change = 0.0
        for i in range(count):
            alone = motion[i] - blocks[i] @ f[i]
            if np.abs(alone - known[i]).max() <= compliance[i] * limit:
                continue  # it would be solved as last time
            known[i] = alone
            step = one_contact(blocks[i], alone, float(friction[i])) - f[i]
            if step.any():
                motion += (w[:, places[i]] @ step).reshape(-1, 3)
                f[i] += step
                change = max(change, float(np.abs(step).max()))
        limit = 0.1 * settled * float(np.abs(f).max(initial=0.0))
        if change <= 10.0 * limit:
            break
    return f
