"""Bending in motion: the same as at rest until a triangle is crushed, and smooth when it is."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from casashell.mesh import TriMesh
from casashell.metric import Metric, with_metric
from casashell.typing import FloatArray
from formulations.hinge_bending import density, hinge_bending, in_motion

NATURAL = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.8, 0.1], [0.4, -0.7, 0.3]]).T


def _squeezed(share: float) -> FloatArray:
    """The hinge with the height of one of its triangles scaled to ``share``."""
    x = NATURAL.copy()
    foot = np.array([0.5, 0.0, 0.0])
    x[:, 2] = foot + share * (x[:, 2] - foot)
    return x


def _derivatives(made: ca.Function) -> ca.Function:
    x, r, p = ca.SX.sym("x", 3, 4), ca.SX.sym("r", 3, 4), ca.SX.sym("p", 1)
    e = made(x, r, p)
    hessian, gradient = ca.hessian(e, x)
    return ca.Function("d", [x, r, p], [e, gradient, hessian])


@pytest.mark.parametrize("share", [0.1001, 0.3, 1.0, 4.0])
def test_nothing_changes_above_a_tenth_of_the_area(share: float) -> None:
    x = _squeezed(share)
    for a, b in zip(
        _derivatives(density())(x, NATURAL, 2.0), _derivatives(in_motion())(x, NATURAL, 2.0)
    ):
        assert np.array(a) == pytest.approx(np.array(b), rel=1e-13, abs=1e-13)


def test_forces_stay_bounded_through_a_flat_triangle() -> None:
    """The plain energy pushes like one over the height; the faded one comes to nothing."""
    heights = [1e-1, 1e-3, 1e-6]
    bend = NATURAL.copy()
    bend[2, 2] += 0.5
    plain, faded = [], []
    for share in heights:
        x = _squeezed(share)
        plain.append(float(np.abs(np.array(_derivatives(density())(x, bend, 1.0)[1])).max()))
        faded.append(float(np.abs(np.array(_derivatives(in_motion())(x, bend, 1.0)[1])).max()))
    assert plain[2] > 1e2 * plain[1] > 1e3 * plain[0]
    assert max(faded) <= 1.0001 * plain[0]
    assert faded[2] < 1e-20


def test_slopes_join_where_fading_begins() -> None:
    """Energy, force and stiffness on both sides of a tenth of the area."""
    bend = NATURAL.copy()
    bend[2, 2] += 0.5
    run = _derivatives(in_motion())
    for below, above in zip(
        run(_squeezed(0.1 - 1e-7), bend, 1.0), run(_squeezed(0.1 + 1e-7), bend, 1.0)
    ):
        size = float(np.abs(np.array(above)).max())
        assert np.array(below) == pytest.approx(np.array(above), abs=1e-4 * size)


def test_a_natural_metric_fades_alike() -> None:
    """The term bound to the metric of its natural shape is the term itself, crushed or not."""
    mesh = TriMesh(NATURAL.T.copy(), np.array([[0, 1, 2], [1, 0, 3]]))
    term = hinge_bending(mesh, 0.5)
    bound = with_metric((term,), mesh, Metric.of(mesh, mesh.vertices))[0]
    assert term.in_motion is not None
    assert bound.in_motion is not None
    stencil = term.stencils[0]
    for share in (0.02, 0.07, 0.5):
        x = _squeezed(share)
        x[2, 3] += 0.4
        x = np.ascontiguousarray(x[:, stencil])
        one = float(term.in_motion(x, NATURAL[:, stencil], term.params[0]))
        two = float(bound.in_motion(x, NATURAL[:, stencil], bound.params[0]))
        assert one == pytest.approx(two, rel=1e-12)
        assert one > 0.0
