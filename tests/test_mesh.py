"""TriMesh: geometry and connectivity against closed forms, and what the constructor refuses."""

from __future__ import annotations

import numpy as np
import pytest
from tiny_meshes import SQUARE, SQUARE_FACES, grid, moebius_band

from casashell.mesh import TriMesh


def test_square_has_five_edges_one_hinge_and_one_loop() -> None:
    mesh = TriMesh(SQUARE, SQUARE_FACES)
    assert mesh.edges.tolist() == [[0, 1], [0, 2], [0, 3], [1, 2], [2, 3]]
    # face 1 runs 0 -> 2 and has corner 3; face 0 runs 2 -> 0 and has corner 1
    assert mesh.hinges.tolist() == [[0, 2, 3, 1]]
    assert mesh.edge_faces.tolist() == [[0, -1], [1, 0], [-1, 1], [0, -1], [1, -1]]
    assert [loop.tolist() for loop in mesh.boundary_loops] == [[0, 1, 2, 3]]
    assert mesh.components[0] == 1
    np.testing.assert_allclose(mesh.face_areas, [0.5, 0.5])
    np.testing.assert_allclose(mesh.face_normals, [[0, 0, 1]] * 2)
    np.testing.assert_allclose(np.degrees(mesh.face_angles), [[45, 90, 45], [45, 45, 90]])
    assert mesh.bbox_diagonal == pytest.approx(np.sqrt(2))
    assert mesh.mean_edge_length == pytest.approx((4 + np.sqrt(2)) / 5)
    np.testing.assert_allclose(mesh.vertex_areas, [1 / 3, 1 / 6, 1 / 3, 1 / 6])


def test_counts_of_a_grid_follow_euler() -> None:
    n = 12
    mesh = grid(n)
    edges = 3 * n * n - 4 * n + 1  # V - E + F = 1 with F = 2 (n - 1)^2
    boundary = 4 * (n - 1)
    assert len(mesh.edges) == edges
    assert len(mesh.hinges) == edges - boundary
    assert [len(loop) for loop in mesh.boundary_loops] == [boundary]
    assert mesh.face_areas.sum() == pytest.approx((n - 1) ** 2)
    assert mesh.vertex_areas.sum() == pytest.approx((n - 1) ** 2)
    np.testing.assert_allclose(mesh.vertex_normals, np.tile([0, 0, 1], (n * n, 1)))


def test_hinges_state_the_side_of_each_opposite_vertex() -> None:
    mesh = grid(5)
    faces = {tuple(np.roll(face, -k)) for face in mesh.faces for k in range(3)}
    for i, j, k, m in mesh.hinges:
        assert i < j
        assert (i, j, k) in faces
        assert (j, i, m) in faces


def test_closed_surface_has_no_boundary() -> None:
    tetrahedron = TriMesh(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]
    )
    assert tetrahedron.boundary_loops == ()
    assert len(tetrahedron.hinges) == 6
    np.testing.assert_allclose(tetrahedron._cross.sum(axis=0), 0)  # the areas of a closed surface


def test_boundary_loop_keeps_the_surface_on_the_left() -> None:
    mesh = grid(3)
    loop = mesh.vertices[mesh.boundary_loops[0]][:, :2]
    after = np.roll(loop, -1, axis=0)
    area = 0.5 * (loop[:, 0] * after[:, 1] - loop[:, 1] * after[:, 0]).sum()
    assert area == pytest.approx(4.0)  # +: counter-clockwise around the 2 x 2 square


def test_components_count_lone_vertices_and_face_components_do_not() -> None:
    vertices = np.vstack([SQUARE, SQUARE + np.array([0, 0, 1]), [[9.0, 9, 9]]])
    mesh = TriMesh(vertices, np.vstack([SQUARE_FACES, SQUARE_FACES + 4]))
    count, labels = mesh.components
    assert count == 3
    assert labels.tolist() == [0, 0, 0, 0, 1, 1, 1, 1, 2]
    assert mesh.topology.face_components[0] == 2
    assert mesh.topology.unreferenced.tolist() == [8]
    assert mesh.bbox_diagonal == pytest.approx(np.sqrt(3))  # the lone vertex does not count


def test_bow_tie_vertex_is_non_manifold_and_has_two_loops_or_one_figure_of_eight() -> None:
    vertices = [[-1, -1, 0], [-1, 1, 0], [0, 0, 0], [1, -1, 0], [1, 1, 0]]
    mesh = TriMesh(vertices, [[0, 2, 1], [2, 3, 4]])
    assert mesh.topology.non_manifold_vertices.tolist() == [2]
    assert sum(len(loop) for loop in mesh.boundary_loops) == 6
    assert mesh.components[0] == 1


def test_edge_of_three_faces_is_named() -> None:
    mesh = TriMesh(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, -1, 0]], [[0, 1, 2], [1, 0, 3], [0, 1, 4]]
    )
    assert mesh.topology.non_manifold_edges.tolist() == [0]
    with pytest.raises(ValueError, match=r"edge 0 \(vertices 0, 1\).*faces 0, 1, 2.*repaired"):
        _ = mesh.hinges
    with pytest.raises(ValueError, match="more than two faces"):
        _ = mesh.edge_faces


def test_face_turned_over_is_named_and_found_as_the_minority() -> None:
    mesh = grid(4)
    faces = mesh.faces.copy()
    faces[7] = faces[7, ::-1]
    turned = TriMesh(mesh.vertices, faces)
    with pytest.raises(ValueError, match=r"opposite orientation: faces .*\b7\b"):
        _ = turned.hinges
    turn, one_sided = turned.topology.orientation
    assert np.flatnonzero(turn).tolist() == [7]
    assert not one_sided.any()
    assert len(turned.boundary_loops) == 1


def test_moebius_band_is_one_sided() -> None:
    band = moebius_band()
    assert band.topology.orientation[1].all()
    assert len(band.topology.conflicting_edges) == 1
    assert [len(loop) for loop in band.boundary_loops] == [18]  # a single edge curve


def test_moved_mesh_shares_the_connectivity_and_not_the_geometry() -> None:
    mesh = grid(4)
    larger = mesh.moved(2 * mesh.vertices)
    assert larger.topology is mesh.topology
    assert larger.hinges is mesh.hinges
    np.testing.assert_allclose(larger.face_areas, 4 * mesh.face_areas)
    with pytest.raises(ValueError, match="got 3 positions for a mesh of 16"):
        mesh.moved(mesh.vertices[:3])
    with pytest.raises(ValueError, match="vertex 5 is not finite"):
        mesh.moved(np.where(np.arange(16)[:, None] == 5, np.nan, mesh.vertices))


def test_arrays_are_read_only_copies() -> None:
    given = SQUARE.copy()
    mesh = TriMesh(given, SQUARE_FACES.astype(np.uint32))
    given[0] = 7
    assert mesh.vertices[0].tolist() == [0, 0, 0]
    assert mesh.faces.dtype == np.int64
    for array in (mesh.vertices, mesh.faces, mesh.face_areas, mesh.edges, mesh.hinges):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_zero_area_face_has_zero_normal_and_a_repeated_corner_spans_no_edge() -> None:
    mesh = TriMesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2], [0, 1, 1]])
    assert mesh.face_normals.tolist() == [[0, 0, 0], [0, 0, 0]]
    assert mesh.edges.tolist() == [[0, 1], [0, 2], [1, 2]]


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (SQUARE[:, :2], SQUARE_FACES, r"vertices must have shape \(V, 3\), got \(4, 2\)"),
        (SQUARE, [[0, 1, 2, 3]], r"faces must have shape \(F, 3\), got \(1, 4\)"),
        (SQUARE, [[0, 1, 2], [0, 1, 2, 3]], "split quads"),
        (SQUARE, [[0, 1, 4]], r"face 0 has vertices \[0, 1, 4\], outside 0\.\.3"),
        (SQUARE, [[0, 1, 2], [-1, 1, 2]], "face 1 has vertices"),
        (SQUARE, SQUARE_FACES * 1.0, "faces must be integers"),
        (np.zeros((0, 3)), np.zeros((0, 3), dtype=int), "empty: no vertices"),
        (SQUARE, np.zeros((0, 3), dtype=int), "empty: no faces"),
        ([[0, 0, 0], [1, 0, np.nan], [0, np.inf, 0]], [[0, 1, 2]], r"vertex 1 .*nan.*2 such"),
        ([[0, 0, 0], [1, 0, 0], [0, 1e200, 0]], [[0, 1, 2]], "vertex 2 is beyond all measure"),
        ([["a", "b", "c"]], [[0, 0, 0]], "array of numbers"),
    ],
)
def test_constructor_refuses(vertices: object, faces: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        TriMesh(vertices, faces)


def test_polygons_must_own_the_faces() -> None:
    assert TriMesh(SQUARE, SQUARE_FACES, ([0, 1, 2, 3],)).polygons == ((0, 1, 2, 3),)
    with pytest.raises(ValueError, match="do not match 2 faces"):
        TriMesh(SQUARE, SQUARE_FACES, ((0, 1, 2),))
    with pytest.raises(ValueError, match="face 1 uses a vertex that is not a corner of its polygo"):
        TriMesh(SQUARE, SQUARE_FACES, ((0, 1, 2), (0, 1, 3)))
