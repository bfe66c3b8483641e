"""A strip made by extending a rod, Pan, Huang and Bao 2016, Fig. 2: it is not isometric.

The points m(s) + y d(s), d the transverse director of the rod and abs(y) <= W/2, span an area of
sqrt(1 + (tau y)^2) per ds dy where the rod has torsion tau and bends about d only: the area is too large by
(tau W)^2 / 24 to first order.
"""

from __future__ import annotations

import numpy as np

from casashell.ribbon.chain import Strip
from casashell.typing import FloatArray

_POINTS = 4


def exact_error(torsion: float, width: float) -> float:
    """area / (L W) - 1 of a rod of constant torsion [1/m] that bends about its director only."""
    z = 0.5 * abs(torsion) * width
    if z < 1e-4:
        return z * z / 6.0
    return float(0.5 * (np.sqrt(1.0 + z * z) + np.arcsinh(z) / z) - 1.0)


def extended(shape: Strip) -> tuple[FloatArray, FloatArray]:
    """Ends (N+1,3) [m] of the transverse lines through the centreline of a ribbon.

    The director of a station is the mean of the quads before and behind it.
    """
    director = shape.before[:, :, 1] + shape.behind[:, :, 1]
    director /= np.linalg.norm(director, axis=1)[:, None]
    return shape.middle - 0.5 * shape.width * director, shape.middle + 0.5 * shape.width * director


def area_error(bottom: FloatArray, top: FloatArray, area: float) -> float:
    """Area / area - 1 of the bilinear patches between rims (N+1,3), by Gauss quadrature.

    Exact for planar quads, as those of a developable ribbon.
    """
    nodes, weights = np.polynomial.legendre.leggauss(_POINTS)
    along, total = 0.5 + 0.5 * nodes, 0.0
    across = top - bottom
    for u, wu in zip(along, weights, strict=True):
        rise = (1.0 - u) * across[:-1] + u * across[1:]
        for v, wv in zip(along, weights, strict=True):
            run = (1.0 - v) * np.diff(bottom, axis=0) + v * np.diff(top, axis=0)
            density = np.linalg.norm(np.cross(run, rise), axis=1)
            total += 0.25 * wu * wv * float(density.sum())
    return total / area - 1.0
