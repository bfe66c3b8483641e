"""Sheet properties on a mesh against closed forms and against relaxed (homogenised) stiffness."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse.linalg as spla
from meshes import grid
from scipy.spatial import Delaunay

from casashell.engine.assembly import Assembly
from casashell.mesh import TriMesh
from casashell.typing import FloatArray
from formulations import edge_stretch, hinge_bending
from formulations.calibration import calibrate


def _equilateral(n: int, side: float) -> TriMesh:
    """A rhombus of equilateral triangles."""
    mesh = grid(n, n, side, side)
    x, y, z = mesh.vertices.T
    return mesh.moved(np.stack([x - 0.5 * y, np.sqrt(0.75) * y, z], axis=1))


def _random(count: int, seed: int) -> TriMesh:
    """Delaunay triangles of random points in the unit square, a regular frame around them."""
    side = np.linspace(0.0, 1.0, int(np.sqrt(count)))
    edges = [np.stack([side, 0 * side + w], axis=1) for w in (0.0, 1.0)]
    edges += [edge[1:-1, ::-1] for edge in edges]
    inside = 0.04 + 0.92 * np.random.default_rng(seed).random((count, 2))
    points = np.concatenate([*edges, inside])
    faces = Delaunay(points).simplices
    a, b = points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]]
    turned = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    faces = faces[np.abs(turned) > 1e-9]
    swap = turned[np.abs(turned) > 1e-9] < 0.0
    faces[swap] = faces[swap][:, [0, 2, 1]]
    return TriMesh(np.column_stack([points, np.zeros(len(points))]), faces)


def _cylinder(mesh: TriMesh, direction: float, curvature: float) -> FloatArray:
    """The flat ``mesh`` wrapped isometrically around a cylinder."""
    x, y, _ = mesh.vertices.T
    along = x * np.cos(direction) + y * np.sin(direction)
    across = -x * np.sin(direction) + y * np.cos(direction)
    turn = curvature * along
    return np.stack([np.sin(turn), curvature * across, 1.0 - np.cos(turn)], axis=1) / curvature


@pytest.mark.parametrize("side", [0.1, 0.01])
def test_equilateral_triangles_have_the_closed_form(side: float) -> None:
    """k_theta = B / 3 exactly; k_L = sqrt(3)/2 a Y up to the rim, whose edges count in full."""
    found = calibrate(_equilateral(30, side))
    assert found.bend == pytest.approx(1.0 / 3.0, rel=1e-9)
    assert found.stretch == pytest.approx(np.sqrt(0.75) * side, rel=0.03)
    assert found.bend_range == pytest.approx((1.0, 1.0))


@pytest.mark.parametrize("direction", [0.0, 0.3, 0.7, np.pi / 2])
def test_bent_to_a_cylinder_it_stores_half_rigidity_times_curvature_squared(
    direction: float,
) -> None:
    """B kappa^2 / 2 per area, B = 2e-4, up to O((kappa h)^2); a third of each triangle per hinge."""
    flat, rigidity, curvature = _equilateral(16, 0.02), 2e-4, 0.7
    term = hinge_bending(flat, rigidity * calibrate(flat).bend)
    bent = Assembly([term], len(flat.vertices)).energy(
        _cylinder(flat, direction, curvature), flat.vertices
    )
    i, j, k, el = (flat.vertices[column] for column in flat.hinges.T)
    area = np.linalg.norm(np.cross(j - i, k - i), axis=1) + np.linalg.norm(
        np.cross(j - i, el - i), axis=1
    )
    # Rim edges are no hinges: directions differ a little in what they lose there.
    assert bent == pytest.approx(0.5 * rigidity * curvature**2 * area.sum() / 6.0, rel=0.04)


@pytest.mark.parametrize("stretches", [(1e-4, 0.0), (1e-4, 1e-4), (1e-4, -1e-4)])
def test_stretched_it_stores_the_membrane_energy(stretches: tuple[float, float]) -> None:
    """Plane stress with nu = 1/3: Y / (2 (1 - nu^2)) (e1^2 + e2^2 + 2 nu e1 e2) per area."""
    flat, membrane = _equilateral(60, 0.02), 900.0
    term = edge_stretch(flat, membrane * calibrate(flat).stretch)
    pose = flat.vertices * (1.0 + np.array([*stretches, 0.0]))
    stored = Assembly([term], len(flat.vertices)).energy(pose, flat.vertices)
    e1, e2 = stretches
    density = membrane / (2.0 * (1.0 - 1.0 / 9.0)) * (e1**2 + e2**2 + 2.0 / 3.0 * e1 * e2)
    assert stored == pytest.approx(density * flat.face_areas.sum(), rel=0.02)


def test_refinement_of_any_one_mesh_leaves_bending_alone_and_scales_stretching() -> None:
    """Scaling a mesh by s: k_theta the same, k_L times s; exactly, by dimension."""
    mesh = _random(150, 3)
    fine = calibrate(mesh.moved(0.1 * mesh.vertices))
    coarse = calibrate(mesh)
    assert fine.bend == pytest.approx(coarse.bend, rel=1e-9)
    assert fine.stretch == pytest.approx(0.1 * coarse.stretch, rel=1e-9)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_irregular_meshes_are_as_stiff_as_their_relaxed_sheet(seed: int) -> None:
    """Cylinders are imposed near the rim only and the inside finds its own balance.

    Measured on random Delaunay triangles: the map is 3 to 5 % off, and slivers would make the
    arithmetic mean 20 % too stiff.
    """
    mesh = _random(400, seed)
    x = mesh.vertices
    margin = 1.2 * mesh.mean_edge_length
    fixed = np.any((x[:, :2] < margin) | (x[:, :2] > 1.0 - margin), axis=1)
    inner = (~fixed)[mesh.hinges].any(axis=1)
    whole = hinge_bending(mesh, calibrate(mesh).bend)  # for a rigidity of 1
    assembly = Assembly([whole.restricted(inner, np.arange(len(x)))], len(x))
    _, entries = assembly.hessian(x, x)
    height = assembly.pattern.matrix(entries).tocsc()[2::3][:, 2::3]
    corners = x[mesh.hinges[inner]]
    wings = [
        corners[:, 1] - corners[:, 0],
        corners[:, 2] - corners[:, 0],
        corners[:, 3] - corners[:, 0],
    ]
    area = sum(np.linalg.norm(np.cross(wings[0], w), axis=1).sum() for w in wings[1:]) / 6.0
    stored = []
    for direction in np.pi * np.arange(6) / 6:
        z = 0.5 * (x[:, 0] * np.cos(direction) + x[:, 1] * np.sin(direction)) ** 2
        inside = height[~fixed]
        z[~fixed] = -spla.spsolve(inside[:, ~fixed], inside[:, fixed] @ z[fixed])
        stored.append(z @ (height @ z) / area)
    assert np.mean(stored) == pytest.approx(1.0, rel=0.08)


def test_a_single_triangle_cannot_be_calibrated() -> None:
    one = TriMesh(np.eye(3), np.array([[0, 1, 2]]))
    with pytest.raises(ValueError, match="without interior edges"):
        calibrate(one)
