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

from casashell.engine.energy import Energy
from casashell.mesh import TriMesh
from casashell.typing import AnyArray, ArrayLike
from formulations.arguments import per_element


def length(x: ca.SX) -> ca.SX:
    """Length of the edge between columns 0 and 1 of ``x`` (3,2)."""
    return ca.sqrt(ca.sumsqr(x[:, 1] - x[:, 0]))


@cache
def density() -> ca.Function:
    """Energy [J] of one edge from x (3,2), r (3,2) [m] and p = (k_L) [N]."""
    x, r, p = ca.SX.sym("x", 3, 2), ca.SX.sym("r", 3, 2), ca.SX.sym("p", 1)
    rest = length(r)
    energy = p[0] / 2 * (length(x) - rest) ** 2 / rest
    return ca.Function("edge_stretch", [x, r, p], [energy])


@cache
def measure() -> ca.Function:
    """Strain measure of the term: the edge length [m]."""
    x = ca.SX.sym("x", 3, 2)
    return ca.Function("edge_length", [x], [length(x)])


def reference(r: AnyArray, p: AnyArray) -> Callable[[AnyArray], AnyArray]:
    """The same energy in plain NumPy: r (2,3,S), p (1,S) -> function of x (2,3,S), complex allowed."""
    rest = np.sqrt(((r[1] - r[0]) ** 2).sum(axis=0))
    return lambda x: 0.5 * p[0] * (np.sqrt(((x[1] - x[0]) ** 2).sum(axis=0)) / rest - 1) ** 2 * rest


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
    )
