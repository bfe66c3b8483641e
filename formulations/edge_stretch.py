"""Edge stretching, Ly 2018 Eq. (9).

    E = k_L / 2 * (L - Lbar)^2 / Lbar          per edge

Stencil: the two ends of an edge.  ``k_L`` [N] is a force, so the in-plane response stiffens when the
mesh is refined (Ly 2018, Sec. 4.1).  Smooth wherever the edge has a length.
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


def length(x: ca.SX) -> ca.SX:
    """Length of the edge between columns 0 and 1 of ``x`` (3,2)."""
    return ca.sqrt(ca.sumsqr(x[:, 1] - x[:, 0]))


@cache
def strained() -> ca.Function:
    """Energy [J] of one edge from its length, its natural length [m] and p = (k_L) [N]."""
    now, rest, p = ca.SX.sym("q"), ca.SX.sym("n", 1), ca.SX.sym("p", 1)
    return ca.Function("edge_strained", [now, rest, p], [p[0] / 2 * (now - rest) ** 2 / rest])


@cache
def density() -> ca.Function:
    """Energy [J] of one edge from x (3,2), r (3,2) [m] and p = (k_L) [N]."""
    x, r, p = ca.SX.sym("x", 3, 2), ca.SX.sym("r", 3, 2), ca.SX.sym("p", 1)
    return ca.Function("edge_stretch", [x, r, p], [strained()(length(x), length(r), p)])


@cache
def measure() -> ca.Function:
    """Strain measure of the term: the edge length [m]."""
    x = ca.SX.sym("x", 3, 2)
    return ca.Function("edge_length", [x], [length(x)])


def _size(x: AnyArray) -> AnyArray:
    return np.asarray(np.sqrt(((x[1] - x[0]) ** 2).sum(axis=0)))


def reference(r: AnyArray, p: AnyArray) -> Callable[[AnyArray], AnyArray]:
    """The same energy in plain NumPy: r (2,3,S), p (1,S) -> function of x (2,3,S), complex allowed."""
    return metric_reference(_size(r)[None], p)


def metric_reference(n: AnyArray, p: AnyArray) -> Callable[[AnyArray], AnyArray]:
    """The same from the natural lengths n (1,S)."""
    return lambda x: 0.5 * p[0] * (_size(x) / n[0] - 1) ** 2 * n[0]


def edge_stretch(mesh: TriMesh, stretch: ArrayLike) -> Energy:
    """Stretching of every edge of ``mesh`` with stiffness ``stretch`` [N], scalar or (E,)."""
    edges = mesh.edges
    value, stiffness = per_element("stretch", stretch, len(edges), "edge", minimum=0.0, strict=True)
    return Energy(
        name="stretch",
        density=density(),
        stencils=edges,
        params=stiffness[:, None],
        measure=measure(),
        reference=reference,
        material={"edges": edges, "stretch": value},
        metric=MetricForm(((0, 1),), strained(), metric_reference),
    )
