"""Certified equilibria do not move; the same scenes without inversion do."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from meshes import grid
from posed import posed
from small_scenes import hat_on_ball

import casashell
from casashell.app.paper_scenes import synthetic_skirt
from casashell.contact.mesh_obstacle import MeshObstacle
from casashell.contact.obstacles import Plane, Sphere
from casashell.dynamics.setting import in_motion
from casashell.dynamics.simulate import simulate
from casashell.dynamics.simulation import SimulationStatus
from casashell.mesh import TriMesh
from casashell.problem import Problem
from casashell.result import Result
from formulations import discrete_shell, hinge_bending


@pytest.fixture(scope="module")
def skirt() -> Result:
    return casashell.solve(synthetic_skirt().problem).require()


def held(result: Result) -> float:
    run = simulate(result, 1.0)
    assert run.status is SimulationStatus.COMPLETE
    assert run.drift.max() <= 1e-12
    assert run.speeds.max() <= 1e-9
    assert np.isin(result.contacts.vertices, np.flatnonzero(run.contact.all(axis=0))).all()
    assert run.residuals.max() <= 1e-6
    assert (run.steps[1:] == 1).all()
    return float(run.drift.max())


def test_the_skirt_holds_and_falls_without_inversion(skirt: Result) -> None:
    drift = held(skirt)
    naive = simulate(skirt, 1.0, rest="target")
    assert naive.status is SimulationStatus.COMPLETE
    assert naive.drift.max() >= 1e3 * max(drift, 1e-12)


def test_a_hat_on_a_ball_holds() -> None:
    result = casashell.solve(hat_on_ball()).require()
    held(result)
    assert simulate(result, 0.5, rest="target").drift.max() >= 1e-4


def test_a_vertex_between_two_bodies_is_held_by_both() -> None:
    """A strip in a V of two planes: bottom vertices touch both, and stay."""

    mesh = grid(2, 4, 0.05, 0.05)
    up = np.stack([mesh.vertices[:, 2], mesh.vertices[:, 1], mesh.vertices[:, 0]], axis=1)
    mesh = mesh.moved(up)
    c = float(np.sqrt(0.5))
    walls = (Plane((c, 0.0, c), 0.0, 0.5), Plane((-c, 0.0, c), 0.0, 0.5))
    terms = discrete_shell(mesh, density=0.2, stretch=50.0, bend=1e-2)
    result = posed(Problem(mesh, terms, walls, contact_tolerance=1e-6))
    assert len(result.contacts) == 10
    run = simulate(result, 0.3)
    assert run.status is SimulationStatus.COMPLETE
    low = np.unique(result.contacts.vertices)
    moved = np.abs(run.positions[:, low] - run.positions[0, low]).max()
    assert moved <= 1e-9
    assert run.residuals.max() <= 1e-6


def test_gaps_of_the_target_are_kept(skirt: Result) -> None:
    """A target that floats off the body stays where it is: the gap is the vertex's thickness."""

    problem = hat_on_ball()
    head = problem.obstacles[0]
    assert isinstance(head, Sphere)
    smaller = replace(head, radius=head.radius - 4e-3)
    floating = Problem(problem.target, problem.energies, (smaller,), contact_tolerance=8e-3)
    result = casashell.solve(floating).require()
    assert result.contacts.gaps.min() > 1e-3
    held(result)


def test_a_real_hat_holds_for_ten_seconds(shared_data: Path) -> None:
    """Drift below 1e-6 of the bounding box and 1e-9 m/s at the end; without inversion it moves."""
    target = casashell.read_mesh(shared_data / "hat_on_sphere" / "shell.obj", unit=0.1)
    ball = casashell.read_mesh(shared_data / "hat_on_sphere" / "obstacle.obj", unit=0.1)
    terms = discrete_shell(target, density=0.2, stretch=20.0, bend=1e-3, gravity=(0.0, -9.81, 0.0))
    head = MeshObstacle(ball, friction=0.5)
    result = casashell.solve(Problem(target, terms, (head,), contact_tolerance=3.9e-3)).require()
    run = simulate(result, 10.0, fps=20)
    assert run.drift.max() <= 1e-12
    assert run.speeds[-20:].max() <= 1e-9
    naive = simulate(result, 0.5, fps=20, rest="target")
    assert naive.drift.max() >= 1e3 * max(float(run.drift.max()), 1e-6)


def test_a_crushed_start_keeps_its_bending() -> None:
    """Bending fades where triangles are crushed in motion; a shell that starts so must hold all the same.

    One row of faces of the natural strip is thirty times as long as in the pose.
    """
    x, y = np.meshgrid(np.linspace(0.0, 0.4, 5), np.linspace(0.0, 0.2, 3), indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), 0.02 * np.sin(20 * x.ravel())], axis=1)
    k = np.arange(15).reshape(5, 3)
    a, b, c, d = (part.ravel() for part in (k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:]))
    mesh = TriMesh(points, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))
    long = points.copy()
    long[long[:, 0] > 0.25, 0] += 3.0
    bending = discrete_shell(mesh, density=0.2, stretch=20.0, bend=1e-2)[1]
    kept, moved = (in_motion(bending, points, r) for r in (long, points))
    assert kept.density is bending.density
    assert moved.density is bending.in_motion


def test_a_natural_triangle_without_area_keeps_its_bending() -> None:
    """Its fading has no slopes: the plain density, which has, is kept."""
    x = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.8, 0.0], [0.5, -0.8, 0.2]])
    r = x.copy()
    r[3] = [0.5, 0.0, 0.0]
    bending = hinge_bending(TriMesh(x, np.array([[0, 1, 2], [1, 0, 3]])), 1e-2)
    assert in_motion(bending, x, r).density is bending.density
    assert in_motion(bending, x, x).density is bending.in_motion
