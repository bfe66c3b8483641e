"""What repair does, what it leaves alone, and that it says so."""

from __future__ import annotations

import numpy as np
import pytest
from tiny_meshes import SQUARE, SQUARE_FACES, grid, moebius_band

from casashell.io.polygons import triangulated
from casashell.mesh import TriMesh
from casashell.mesh_checks import inspect_mesh
from casashell.repair import repaired

RIGHT = np.array([1.0, 0.0, 0.0])
CORNER = np.array([1.0, 1.0, 0.0])
UP = np.array([0.0, 0.0, 1.0])


def soup(mesh: TriMesh) -> TriMesh:
    """Every face with vertices of its own, as from a file without connectivity."""
    return TriMesh(
        mesh.vertices[mesh.faces].reshape(-1, 3), np.arange(mesh.faces.size).reshape(-1, 3)
    )


def test_sound_mesh_comes_back_itself() -> None:
    mesh = grid(4)
    repair = repaired(mesh)
    assert repair.mesh is mesh
    assert repair.report == ()
    assert repair.remaining == ()
    assert repair.vertex_map.tolist() == list(range(16))


def test_open_seam_is_welded_and_the_input_left_alone() -> None:
    mesh = TriMesh(np.vstack([SQUARE, SQUARE + RIGHT]), np.vstack([SQUARE_FACES, SQUARE_FACES + 4]))
    before = mesh.vertices.copy(), mesh.faces.copy()
    repair = repaired(mesh)
    assert repair.vertex_map.tolist() == [0, 1, 2, 3, 1, 4, 5, 2]
    assert repair.mesh.vertices.tolist() == [*SQUARE.tolist(), [2, 0, 0], [2, 1, 0]]
    assert repair.mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2]]
    assert repair.report == ("welded 2 vertices (4, 7) to a lower-numbered one in the same place",)
    assert inspect_mesh(repair.mesh) == ()
    np.testing.assert_array_equal(mesh.vertices, before[0])
    np.testing.assert_array_equal(mesh.faces, before[1])


def test_every_old_vertex_is_found_where_the_map_says() -> None:
    mesh = soup(grid(5))
    repair = repaired(mesh)
    assert inspect_mesh(repair.mesh) == ()
    assert len(repair.mesh.vertices) == 25
    np.testing.assert_array_equal(repair.mesh.vertices[repair.vertex_map], mesh.vertices)
    np.testing.assert_array_equal(repair.mesh.faces, repair.vertex_map[mesh.faces])


def test_closed_strip_becomes_a_tube() -> None:
    # a strip rolled up so that its ends coincide: two rims after welding, one before
    angle = np.linspace(0, 2 * np.pi, 9)
    angle[-1] = 0.0
    ring = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    vertices = np.stack([ring, ring + UP], axis=1).reshape(-1, 3)
    faces = [f for k in range(0, 16, 2) for f in ([k, k + 2, k + 1], [k + 1, k + 2, k + 3])]
    mesh = TriMesh(vertices, np.array(faces))
    assert len(mesh.boundary_loops) == 1
    assert len(repaired(mesh).mesh.boundary_loops) == 2


@pytest.mark.parametrize(
    ("vertices", "faces"),
    [
        # three wings on one edge, each with vertices of its own: an edge with three faces
        (
            np.vstack(
                [[[0, 0, 0], [0, 0, 1], tip] for tip in ([1, 0, 0], [-1, 1, 0], [-1, -1, 0])]
            ),
            [[0, 1, 2], [3, 4, 5], [6, 7, 8]],
        ),
        # two squares that meet in a corner only: a ball joint
        (
            np.vstack([SQUARE, SQUARE + CORNER]),
            np.vstack([SQUARE_FACES, SQUARE_FACES + 4]),
        ),
        # one sheet exactly on another: folding one onto the other
        (np.vstack([SQUARE, SQUARE]), np.vstack([SQUARE_FACES, SQUARE_FACES[:, ::-1] + 4])),
    ],
)
def test_welding_that_spoils_the_surface_is_left_undone_and_said(
    vertices: np.ndarray, faces: np.ndarray
) -> None:
    mesh = TriMesh(vertices, faces)
    repair = repaired(mesh)
    assert repair.mesh is mesh
    assert len(repair.report) == 1
    assert "unwelded although coincident" in repair.report[0]
    assert repair.sound


def test_half_twisted_strip_is_not_closed_to_a_moebius_band() -> None:
    band = moebius_band(9)
    ends = np.vstack([band.vertices, band.vertices[[1, 0]]])  # the ring cut open at its joint
    faces = band.faces.copy()
    faces[-2:] = [[16, 17, 18], [18, 17, 19]]
    strip = TriMesh(ends, faces)
    assert not strip.topology.orientation[1].any()
    repair = repaired(strip)
    assert repair.mesh is strip
    assert "4 vertices (0, 1, 18, 19) unwelded" in repair.report[0]


def test_weld_keeps_what_it_can_beside_what_it_cannot() -> None:
    # two squares along an open seam, and a third that meets the second in a corner only
    third = SQUARE + RIGHT + CORNER
    mesh = TriMesh(
        np.vstack([SQUARE, SQUARE + RIGHT, third]),
        np.vstack([SQUARE_FACES, SQUARE_FACES + 4, SQUARE_FACES + 8]),
    )
    repair = repaired(mesh)
    assert [line.split(" (")[0] for line in repair.report] == [
        "welded 2 vertices",
        "left 2 vertices",
    ]
    assert repair.mesh.topology.face_components[0] == 2
    assert len(repair.mesh.topology.non_manifold_vertices) == 0


def test_vertices_near_each_other_are_welded_on_request_only() -> None:
    shifted = SQUARE + RIGHT + 1e-7
    mesh = TriMesh(np.vstack([SQUARE, shifted]), np.vstack([SQUARE_FACES, SQUARE_FACES + 4]))
    assert repaired(mesh).mesh is mesh
    repair = repaired(mesh, tolerance=1e-6)
    assert repair.vertex_map.tolist() == [0, 1, 2, 3, 1, 4, 5, 2]
    assert "in the same place within 1e-06 m" in repair.report[0]
    np.testing.assert_array_equal(repair.mesh.vertices[:4], SQUARE)  # the lower number stays
    for tolerance in (-1.0, float("nan")):
        with pytest.raises(ValueError, match="tolerance must be a length"):
            repaired(mesh, tolerance)


def test_needle_between_coincident_vertices_closes() -> None:
    # two triangles joined by a face without area, whose short side has no length
    vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0]]
    mesh = TriMesh(vertices, [[0, 1, 2], [1, 3, 2], [3, 4, 2]])
    repair = repaired(mesh)
    assert repair.mesh.faces.tolist() == [[0, 1, 2], [1, 3, 2]]
    assert repair.vertex_map.tolist() == [0, 1, 2, 1, 3]
    assert repair.report[1] == "dropped 1 face (1) without area"
    assert inspect_mesh(repair.mesh) == ()


def test_flat_face_goes_from_the_rim_but_not_from_the_middle() -> None:
    vertices = np.vstack([SQUARE, [[0.5, 0, 0], [0.5, -1, 0]]])
    # face 0 is flat: 0-4-1 lie on a line.  Neighbours on both sides, above it only, below it only
    above, below = [[0, 1, 2], [0, 2, 3]], [[4, 0, 5], [1, 4, 5]]
    middle = TriMesh(vertices, [[0, 4, 1], *above, *below])
    repair = repaired(middle)
    assert repair.mesh is middle
    assert repair.report[0].startswith("still wrong: 1 face without area (0)")
    assert not repair.sound
    for rest in (above, below):
        used = np.unique([[0, 4, 1], *rest])
        rim = TriMesh(vertices[used], np.searchsorted(used, [[0, 4, 1], *rest]))
        repair = repaired(rim)
        assert repair.report[0] == "dropped 1 face (0) without area"
        assert repair.sound


def test_copies_are_dropped_and_faces_turned_to_the_majority() -> None:
    mesh = grid(4)
    faces = np.vstack([mesh.faces, mesh.faces[[3]][:, [1, 0, 2]]])
    faces[[5, 8]] = faces[[5, 8]][:, ::-1]
    repair = repaired(TriMesh(mesh.vertices, faces))
    assert repair.report == (
        "dropped 1 face (18) with the vertices of an earlier one",
        "turned over 2 faces (5, 8) to agree with the neighbours",
    )
    assert repair.remaining == ()
    np.testing.assert_allclose(repair.mesh.face_normals, np.tile(UP, (18, 1)))


def test_unused_vertices_are_dropped_and_mapped_to_minus_one() -> None:
    vertices = np.insert(SQUARE, 2, 9.0, axis=0)
    mesh = TriMesh(vertices, [[0, 1, 3], [0, 3, 4]])
    repair = repaired(mesh)
    assert repair.vertex_map.tolist() == [0, 1, -1, 2, 3]
    assert repair.report == ("dropped 1 vertex (2) in no face",)
    np.testing.assert_array_equal(repair.mesh.vertices, SQUARE)


def test_one_sided_band_is_left_and_reported() -> None:
    band = moebius_band()
    repair = repaired(band)
    assert repair.mesh is band
    assert repair.report[0].startswith("still wrong: a one-sided (Moebius) piece of 18 faces")


def test_nothing_left_is_an_error() -> None:
    line = TriMesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]])
    with pytest.raises(ValueError, match="none of the 1 faces has an area"):
        repaired(line)


def quads(vertices: np.ndarray, *polygons: tuple[int, ...]) -> TriMesh:
    return TriMesh(vertices, triangulated(np.asarray(vertices), polygons), polygons)


def test_polygons_follow_the_weld_the_turn_and_the_renumbering() -> None:
    lone = np.vstack([[[9, 9, 9]], SQUARE, SQUARE + RIGHT])
    repair = repaired(quads(lone, (1, 2, 3, 4), (8, 7, 6, 5)))
    assert repair.mesh.polygons == ((0, 1, 2, 3), (2, 1, 4, 5))
    assert inspect_mesh(repair.mesh) == ()
    # the second quad was turned over: it runs against its old direction
    assert "turned over 2 faces (2, 3)" in repair.report[1]
    np.testing.assert_allclose(repair.mesh.face_normals, np.tile(UP, (4, 1)))


def test_quad_with_a_collapsed_side_becomes_a_triangle() -> None:
    vertices = np.vstack([SQUARE, [[2, 0, 0], [1, 0, 0]]])
    repair = repaired(quads(vertices, (0, 1, 2, 3), (1, 5, 4, 2)))
    assert repair.mesh.polygons == ((0, 1, 2, 3), (1, 4, 2))
    assert repair.report[1].startswith("dropped 1 face")
    assert inspect_mesh(repair.mesh) == ()


def test_quad_that_loses_a_triangle_leaves_the_other() -> None:
    # the second quad 1-4-5-2 has a straight corner at 4 on the rim, and vertex 4 goes with it
    vertices = np.vstack([SQUARE, [[1.5, 0, 0], [2, 0, 0]]])
    faces = [[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2]]
    repair = repaired(TriMesh(vertices, faces, ((0, 1, 2, 3), (1, 4, 5, 2))))
    assert repair.mesh.polygons == ((0, 1, 2, 3), (1, 4, 2))  # 5 is 4 now
    assert repair.vertex_map.tolist() == [0, 1, 2, 3, -1, 4]
    assert repair.report == (
        "dropped 1 face (2) without area",
        "dropped 1 vertex (4) in no face",
    )
