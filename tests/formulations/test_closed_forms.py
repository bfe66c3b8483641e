"""Energies and forces known by hand."""

from __future__ import annotations

import numpy as np
import pytest
from meshes import grid, jittered, rolled

from casashell.engine.assembly import Assembly
from casashell.mesh import TriMesh
from formulations import area_gravity, discrete_shell, edge_stretch, hinge_bending, proximity

TRIANGLE = TriMesh(np.array([[0.0, 0, 0], [2.0, 0, 0], [0, 1.0, 0]]), np.array([[0, 1, 2]]))
# Edge 0-1 of length 2, opposite corners at heights 0.5 (k) and 1.5 (l) on the two sides.
HINGE = TriMesh(
    np.array([[0.0, 0, 0], [2.0, 0, 0], [1.0, 0.5, 0], [0.4, -1.5, 0]]),
    np.array([[0, 1, 2], [1, 0, 3]]),
)


def _opened(angle: float) -> TriMesh:
    """``HINGE`` with its second triangle turned about the edge by ``angle``."""
    x = HINGE.vertices.copy()
    x[3] = [0.4, -1.5 * np.cos(angle), -1.5 * np.sin(angle)]
    return HINGE.moved(x)


def test_stretched_edge() -> None:
    """E = k/2 (L - Lbar)^2 / Lbar and a tension k (L - Lbar) / Lbar along the edge."""
    k, pull = 20.0, 0.3
    x = TRIANGLE.vertices.copy()
    x[1, 0] += pull
    x[2] = [0.0, 1.0, 0.0]
    term = edge_stretch(TRIANGLE, np.array([k, 0.0 + 1e-300, 1e-300]))  # edges 01, 02, 12
    assembly = Assembly([term], 3)
    rest = TRIANGLE.vertices
    assert assembly.energy(x, rest) == pytest.approx(k / 2 * pull**2 / 2.0, rel=1e-13)
    tension = np.zeros((3, 3))
    tension[1, 0], tension[0, 0] = k * pull / 2.0, -k * pull / 2.0
    assert assembly.gradient(x, rest) == pytest.approx(tension, rel=1e-13, abs=1e-15)


@pytest.mark.parametrize("angle", [-3.0, -1.2, -1e-4, 1e-6, 0.5, 2.0, 3.1])
def test_hinge_of_known_angle(angle: float) -> None:
    """E = k/2 * 3 L^2 / A * theta^2, A the sum of both areas: L = 2, A = 1/2 + 3/2 = 2."""
    k = 1.5e-3
    energy = Assembly([hinge_bending(HINGE, k)], 4).energy(_opened(angle).vertices, HINGE.vertices)
    assert energy == pytest.approx(k / 2 * 3 * 4.0 / 2.0 * angle**2, rel=1e-9)


def test_hinge_bent_at_rest_counts_the_difference() -> None:
    """theta - thetabar is not wrapped: -2.5 against 2.5 is a change of 5 rad."""
    k = 2e-3
    term = hinge_bending(HINGE, k)
    pose, rest = _opened(2.5).vertices, _opened(-2.5).vertices
    assert Assembly([term], 4).energy(pose, rest) == pytest.approx(k / 2 * 6.0 * 25.0, rel=1e-12)


def test_turning_all_triangles_over_keeps_the_energy() -> None:
    """The angle changes sign with the orientation, its square does not."""
    pose, rest = _opened(0.8).vertices, _opened(0.3).vertices
    over = TriMesh(HINGE.vertices, HINGE.faces[:, ::-1])
    one = Assembly([hinge_bending(HINGE, 1e-3)], 4).energy(pose, rest)
    other = Assembly([hinge_bending(over, 1e-3)], 4).energy(pose, rest)
    assert other == pytest.approx(one, rel=1e-13)
    assert one == pytest.approx(0.5e-3 * 6.0 * 0.25, rel=1e-12)


@pytest.mark.parametrize("aspect", [0.5, 1.0, 3.0])
def test_rolled_sheet_bends_only_at_its_lines(aspect: float) -> None:
    """nx - 1 lines of ny hinges, each 3k/2 b^2/(ab) fold^2; flat strips: no other term."""
    a, nx, ny, k, fold = 0.1, 5, 3, 1e-3, 0.2
    flat = grid(nx, ny, a, aspect * a)
    pose = rolled(flat, a, fold).vertices
    count = len(pose)
    bending = Assembly([hinge_bending(flat, k)], count).energy(pose, flat.vertices)
    assert bending == pytest.approx((nx - 1) * ny * 1.5 * k * aspect * fold**2, rel=1e-12)
    stretching = Assembly([edge_stretch(flat, 20.0)], count).energy(pose, flat.vertices)
    assert stretching == pytest.approx(0.0, abs=1e-28)


def test_cylinder_energy_converges_to_the_continuum() -> None:
    """Rolled along its lines the model is a plate of energy 3k/2 kappa^2 per area.

    With fold = kappa a the sum above is 3k/2 kappa^2 (area) (1 - 1/nx): first order, from the half
    cells at the two free edges.
    """
    k, length, width, kappa = 1e-3, 1.0, 0.2, 1.3
    limit = 1.5 * k * kappa**2 * length * width
    errors, sizes = [], []
    for nx in (5, 10, 20, 40):
        a = length / nx
        flat = grid(nx, 2, a, width / 2)
        pose = rolled(flat, a, kappa * a).vertices
        energy = Assembly([hinge_bending(flat, k)], len(pose)).energy(pose, flat.vertices)
        errors.append(limit - energy)
        sizes.append(a)
    order = np.polyfit(np.log(sizes), np.log(errors), 1)[0]
    assert order == pytest.approx(1.0, abs=1e-6)
    assert 2.0 * (limit - errors[-1]) - (limit - errors[-2]) == pytest.approx(limit, rel=1e-10)


def test_sheet_weighs_density_times_area() -> None:
    """Total dE/dx = -rho A g, whatever the pose; the area is the natural one."""
    mesh = grid(4, 3, 0.1, 0.2)  # 0.4 m x 0.6 m
    g = np.array([0.5, 0.0, -9.81])
    pose = jittered(mesh, 0.02).vertices
    term = area_gravity(mesh, 0.25, g)
    force = Assembly([term], len(pose)).gradient(pose, mesh.vertices)
    assert force.sum(axis=0) == pytest.approx(-0.25 * 0.24 * g, rel=1e-12)
    assert term.load


def test_mass_of_a_vertex_is_a_third_of_the_faces_around_it() -> None:
    mesh = jittered(grid(2, 2), 0.01)
    density = np.linspace(0.1, 0.8, len(mesh.faces))
    mass = np.zeros(len(mesh.vertices))
    for face, rho, area in zip(mesh.faces, density, mesh.face_areas, strict=True):
        mass[face] += rho * area / 3.0
    loads = Assembly([area_gravity(mesh, density)], 9).nodal_loads(mesh.vertices)
    assert loads[:, 2] == pytest.approx(-9.81 * mass, rel=1e-12)
    assert np.all(loads[:, :2] == 0.0)


def test_spring_of_proximity() -> None:
    mesh = grid(1, 1)
    pull = np.array([1.0, 0.0, 2.0, 3.0])
    x = mesh.vertices + np.array([0.1, 0.2, -0.2])  # 0.3 m away
    assembly = Assembly([proximity(mesh, pull)], 4)
    assert assembly.energy(x, mesh.vertices) == pytest.approx(0.5 * 6.0 * 0.09, rel=1e-13)


def test_shell_is_its_three_terms() -> None:
    mesh = grid(2, 2)
    pose, rest = jittered(mesh, 0.01).vertices, jittered(mesh, 0.005, seed=1).vertices
    shell = discrete_shell(mesh, density=0.2, stretch=20.0, bend=1e-3, gravity=(0, -9.81, 0))
    assert [term.name for term in shell] == ["stretch", "bend", "gravity"]
    assert [term.load for term in shell] == [False, False, True]
    parts = [Assembly([term], 9).energy(pose, rest) for term in shell]
    assert Assembly(shell, 9).energy(pose, rest) == pytest.approx(sum(parts), rel=1e-13)
