"""Proximity to a target pose, the regulariser of Ly 2018 Eq. (24).

    E = lambda / 2 * |x - x_t|^2          per vertex

At a given pose it is a dead load that no natural shape changes, and is marked as one.
Stencil: one vertex.  ``lambda`` [N/m] is the pull towards the target.  Independent of the rest shape.
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


@cache
def pulled() -> ca.Function:
    """Energy [J] of one vertex from x (3,1), no natural numbers and p = (lambda, x_t) [N/m, m]."""
    x, none, p = ca.SX.sym("x", 3, 1), ca.SX.sym("n", 0), ca.SX.sym("p", 4)
    return ca.Function("proximity_pulled", [x, none, p], [p[0] / 2 * ca.sumsqr(x - p[1:4])])


@cache
def density() -> ca.Function:
    """Energy [J] of one vertex from x (3,1), r (3,1) [m] and p = (lambda, x_t) [N/m, m]."""
    x, r, p = ca.SX.sym("x", 3, 1), ca.SX.sym("r", 3, 1), ca.SX.sym("p", 4)
    return ca.Function("proximity", [x, r, p], [pulled()(x, ca.SX(0, 1), p)])


def reference(r: AnyArray, p: AnyArray) -> Callable[[AnyArray], AnyArray]:
    """The same energy in plain NumPy: r (1,3,S), p (4,S) -> function of x (1,3,S), complex allowed."""
    return lambda x: 0.5 * p[0] * ((x[0] - p[1:]) ** 2).sum(axis=0)


def proximity(mesh: TriMesh, pull: ArrayLike) -> Energy:
    """Springs from every vertex to its place in ``mesh`` with stiffness ``pull`` [N/m]."""
    count = len(mesh.vertices)
    value, stiffness = per_element("pull", pull, count, "vertex", minimum=0.0)
    return Energy(
        name="proximity",
        density=density(),
        stencils=np.arange(count, dtype=np.int64)[:, None],
        params=np.column_stack([stiffness, mesh.vertices]),
        load=True,
        reference=reference,
        material={"pull": value},
        metric=MetricForm((), pulled(), reference),
    )
