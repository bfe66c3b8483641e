"""Stretch and bending measures against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from casashell.mesh import TriMesh
from casashell.strain import (
    angle_change,
    dihedral_angles,
    face_means,
    relative_stretch,
    strain,
    vertex_means,
)
from casashell.typing import FloatArray

# Two triangles over the unit square, sharing the edge 0-1 along x.
HINGE = np.array([[0, 1, 2, 3]])


def folded(angle: float) -> FloatArray:
    """Edge along x, first wing towards +y, the other turned up by ``angle`` from -y."""
    return np.array(
        [
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.3, 1.0, 0.0],
            [0.6, -np.cos(angle), np.sin(angle)],
        ]
    )


def roof(angle: float) -> TriMesh:
    return TriMesh(folded(angle), np.array([[0, 1, 2], [1, 0, 3]]))


@pytest.mark.parametrize("factor", [0.25, 0.9, 1.0, 3.0])
def test_uniform_scaling_stretches_by_factor_minus_one_and_does_not_bend(factor: float) -> None:
    # Closed form: every length scales by the factor, every angle stays.
    target = roof(0.7)
    measured = strain(target, factor * target.vertices + 5.0)
    for values in (measured.stretch, measured.stretch_vertices, measured.stretch_faces):
        np.testing.assert_allclose(values, factor - 1.0, atol=1e-13)
    for values in (measured.bend, measured.bend_vertices, measured.bend_faces):
        np.testing.assert_allclose(values, 0.0, atol=1e-13)


@pytest.mark.parametrize("angle", [-3.0, -1.0, -1e-9, 0.0, 1e-9, 0.5, 3.1])
def test_dihedral_angle_of_a_roof_is_the_fold(angle: float) -> None:
    # Closed form: the wing is turned about the edge by the angle; valley folds are negative here.
    theta = dihedral_angles(folded(angle), HINGE)[0]
    assert theta == pytest.approx(-angle, rel=1e-12, abs=1e-25)


def test_dihedral_angle_does_not_depend_on_size_or_motion() -> None:
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    theta = dihedral_angles(1e-4 * folded(0.4) @ turn.T + 3e-3, HINGE)
    assert theta[0] == pytest.approx(-0.4, rel=1e-9)


def test_bending_is_the_size_of_the_change() -> None:
    both = [angle_change(folded(a), folded(b), HINGE)[0] for a, b in ((0.2, 0.7), (0.7, 0.2))]
    np.testing.assert_allclose(both, 0.5, rtol=1e-12)


def test_stretch_has_the_sign_of_the_natural_shape() -> None:
    # Natural edge 1.5 against 1 along x: dilated by one half; along y 0.5: compressed by one half.
    target = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    rest = np.array([[0.0, 0.0, 0.0], [1.5, 0.0, 0.0], [0.0, 0.5, 0.0]])
    stretch = relative_stretch(target, rest, np.array([[0, 1], [0, 2]]))
    np.testing.assert_allclose(stretch, [0.5, -0.5])


def test_means_ignore_sides_without_a_value() -> None:
    # The hinge edge 0-1 belongs to both faces and to vertices 0 and 1 only.
    mesh = roof(0.0)
    measured = strain(mesh, folded(0.8))
    np.testing.assert_allclose(measured.bend_faces, [0.8, 0.8])
    np.testing.assert_allclose(measured.bend_vertices, [0.8, 0.8, 0.0, 0.0])


def test_vertex_mean_is_over_the_edges_that_meet() -> None:
    segments = np.array([[0, 1], [1, 2]])
    np.testing.assert_allclose(vertex_means(segments, np.array([1.0, 3.0]), 4), [1, 2, 3, 0])


def test_face_mean_finds_sides_in_either_direction() -> None:
    faces = np.array([[0, 1, 2], [2, 1, 3]])
    segments = np.array([[2, 1], [3, 1], [0, 2]])
    np.testing.assert_allclose(face_means(segments, np.array([2.0, 6.0, 4.0]), faces), [3, 4])


def test_mesh_without_hinges_has_no_bending() -> None:
    single = TriMesh(np.eye(3), np.array([[0, 1, 2]]))
    measured = strain(single, 2 * np.eye(3))
    assert measured.bend.shape == (0,)
    assert not measured.bend_faces.any()
    assert not measured.bend_vertices.any()


def test_edge_without_length_is_named() -> None:
    target = TriMesh(np.array([[0.0, 0, 0], [0, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    with pytest.raises(ValueError, match="vertices 0 and 1"):
        strain(target, np.eye(3))


def test_wrong_shape_is_named() -> None:
    with pytest.raises(ValueError, match=r"\(4, 3\)"):
        strain(roof(0.1), np.zeros((5, 3)))
