"""Natural lengths, angles and areas as such, and energies that take them."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from meshes import cap
from plain_shell import PlainShell

from casashell.engine.assembly import Assembly
from casashell.engine.energy import Energy
from casashell.inverse.certificate import total_energy, total_forces
from casashell.metric import Metric, MetricIndex, heron, laid_out, thinness, with_metric
from formulations import discrete_shell, proximity


def test_heron_of_known_triangles() -> None:
    """3-4-5, equilateral, a needle of exact area, and sides that make no triangle."""
    needle = [1.0, 1.0, 1e-8]  # height of the isosceles triangle over its short side: 1 to 1e-16
    sides = np.array([[3.0, 4.0, 5.0], [5.0, 3.0, 4.0], [1.0, 1.0, 1.0], needle, [1.0, 1.0, 2.5]])
    np.testing.assert_allclose(heron(sides), [6, 6, np.sqrt(3) / 4, 0.5e-8, 0], rtol=1e-14)
    np.testing.assert_allclose(thinness(sides), [0.4, 0.4, 1.0, 1e-8, -0.2], rtol=1e-7)


def test_the_metric_of_a_mesh_gives_back_its_areas_and_corners() -> None:
    mesh = cap(4, 0.2, 1.3)
    metric = Metric.of(mesh, mesh.vertices)
    np.testing.assert_allclose(
        heron(metric.rest_length[MetricIndex(mesh).sides]), mesh.face_areas, rtol=1e-12
    )
    np.testing.assert_allclose(metric.corner_angles(mesh), mesh.face_angles, rtol=1e-10)


def test_areas_laid_out_in_the_plane() -> None:
    """The mesh's own areas whatever the metric says, and NaN where there is no triangle."""
    mesh = cap(2, 0.2, 1.3)
    metric = Metric.of(mesh, mesh.vertices)
    lengths = metric.rest_length.copy()
    wrong = replace(metric, rest_area=np.zeros(len(mesh.faces)))
    np.testing.assert_allclose(laid_out(mesh, wrong).rest_area, mesh.face_areas, rtol=1e-12)
    lengths[0] *= 3.0
    broken = laid_out(mesh, replace(metric, rest_length=lengths))
    around = (MetricIndex(mesh).sides == 0).any(axis=1)
    np.testing.assert_array_equal(np.isnan(broken.rest_area), around)


@pytest.mark.parametrize("interpreted", [True, False])
def test_a_metric_stands_for_the_mesh_it_is_of(interpreted: bool) -> None:
    """Energy and forces with the metric of r are those with r: in CasADi, NumPy and plain loops."""
    mesh = cap(3, 0.2, 1.3)
    rng = np.random.default_rng(0)
    rest = mesh.vertices + 0.01 * rng.standard_normal(mesh.vertices.shape)
    pose = mesh.vertices + 0.01 * rng.standard_normal(mesh.vertices.shape)
    shell = PlainShell(mesh)
    energies = (*shell.terms(), proximity(mesh, 2.0))
    bound = with_metric(energies, mesh, Metric.of(mesh, rest))
    wanted = Assembly(energies, len(pose), interpreted=interpreted).gradient(pose, rest)
    size = np.abs(wanted).max()
    made = Assembly(bound, len(pose), interpreted=interpreted).gradient(pose, pose)
    np.testing.assert_allclose(made, wanted, atol=1e-12 * size)
    np.testing.assert_allclose(total_forces(bound, pose, pose), wanted, atol=1e-12 * size)
    plain = with_metric(shell.terms(), mesh, Metric.of(mesh, rest))
    assert total_energy(plain, pose, pose) == pytest.approx(shell.energy(pose, rest), rel=1e-12)


def test_rest_angles_beyond_half_a_turn_are_not_wrapped() -> None:
    """Closed form: moment k (theta - theta_r), so a rest angle of 4 is not one of 4 - 2 pi."""
    mesh = cap(1, 0.2, 0.4)
    flat = Metric.of(mesh, mesh.vertices)
    (_, bend, _) = discrete_shell(mesh, density=0.0, stretch=1.0, bend=1.0)
    totals = []
    for turn in (4.0, 4.0 - 2.0 * np.pi):
        metric = Metric(
            flat.edges, flat.rest_length, flat.hinges, flat.rest_angle + turn, flat.rest_area
        )
        (term,) = with_metric((bend,), mesh, metric)
        totals.append(total_energy((term,), mesh.vertices, mesh.vertices))
    assert totals[0] / totals[1] == pytest.approx((4.0 / (4.0 - 2.0 * np.pi)) ** 2, rel=1e-12)


def test_a_term_without_metric_form_is_named() -> None:
    mesh = cap(1, 0.2, 0.4)
    x, r, p = ca.SX.sym("x", 3, 1), ca.SX.sym("r", 3, 1), ca.SX.sym("p", 0)
    term = Energy(
        "magnet",
        ca.Function("magnet", [x, r, p], [ca.sumsqr(x)]),
        np.array([[0]]),
        np.empty((1, 0)),
    )
    with pytest.raises(ValueError, match="'magnet' has no metric form"):
        with_metric((term,), mesh, Metric.of(mesh, mesh.vertices))


def test_elements_of_another_mesh_are_named() -> None:
    index = MetricIndex(cap(2, 0.2, 0.4))
    with pytest.raises(ValueError, match=r"no edge with vertices \[0, 18\]"):
        index.edges(np.array([[0, 18]]))
