"""Normals of triangles drawn to a direction, as the ends of the twisted ribbons are."""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np

from benchmarks.ribbon_fem.patch import Patch
from casashell.engine.energy import Energy
from casashell.typing import FloatArray, IntArray


@cache
def normal_guiding() -> ca.Function:
    """k/2 |n - nstar|^2 [J] of one triangle x (3,3) [m]; p = (k, nstar)."""
    x, r, p = ca.SX.sym("x", 3, 3), ca.SX.sym("r", 3, 3), ca.SX.sym("p", 4)
    normal = ca.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    away = normal / ca.sqrt(ca.sumsqr(normal)) - p[1:]
    return ca.Function("normal_guiding", [x, r, p], [p[0] / 2 * ca.sumsqr(away)])


def guides(patch: Patch, nodes: IntArray) -> tuple[Energy, ...]:
    """The guides of a patch at t = 0; ``nodes`` (F,3) span its triangles."""
    return tuple(
        Energy(
            f"guide {number}",
            normal_guiding(),
            nodes[guide.faces],
            guided(len(guide.faces), guide.weight, guide.normal(0.0)),
            load=True,
        )
        for number, guide in enumerate(patch.guides)
    )


def guided(count: int, weight: float, normal: FloatArray) -> FloatArray:
    """(count,4) parameters of a guide whose weight is shared by ``count`` triangles."""
    return np.tile(np.concatenate([[weight / count], normal]), (count, 1))
