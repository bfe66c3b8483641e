"""Crossing faces: against libigl pair by pair, on closed forms and on real garments."""

from __future__ import annotations

import time
from itertools import combinations
from pathlib import Path

import igl
import numpy as np
import pytest
from tiny_meshes import SQUARE, SQUARE_FACES, grid, moebius_band

from casashell.io.meshes import read_mesh
from casashell.self_intersections import overlapping_boxes, self_intersections


@pytest.mark.parametrize("seed", range(6))
def test_random_triangles_agree_with_libigl_on_every_pair(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners = rng.random((40, 1, 3)) + 0.8 * (rng.random((40, 3, 3)) - 0.5)
    found = self_intersections(corners.reshape(-1, 3), np.arange(120).reshape(40, 3))
    points = [[point[None].copy() for point in triangle] for triangle in corners]
    expected = [
        (f, g)
        for f, g in combinations(range(40), 2)
        if igl.tri_tri_intersection_test_3d(*points[f], *points[g])[0]
    ]
    assert len(expected) > 10  # the test would prove nothing otherwise
    assert found.tolist() == [list(pair) for pair in expected]


def test_boxes_agree_with_brute_force() -> None:
    rng = np.random.default_rng(5)
    for count in (1, 2, 3, 17, 100):
        low = rng.random((count, 3))
        high = low + 0.5 * rng.random((count, 3)) ** 3
        meet = (low[:, None] <= high).all(axis=2)
        expected = np.argwhere(np.triu(meet & meet.T, k=1))
        found = overlapping_boxes(low, high)
        assert sorted(found.tolist()) == expected.tolist()


def test_smooth_and_flat_meshes_have_none() -> None:
    for mesh in (grid(9), moebius_band(12)):
        assert self_intersections(mesh.vertices, mesh.faces).shape == (0, 2)


@pytest.mark.parametrize("shift", [0.0, 1e3])
def test_sheet_through_a_sheet_is_found_face_by_face(shift: float) -> None:
    # a unit square pierced by a vertical triangle whose lower tip is at z = -1
    vertices = np.vstack([SQUARE, [[0.6, 0.2, -1], [0.5, 0.1, 1], [0.7, 0.3, 1]]]) + shift
    faces = np.vstack([SQUARE_FACES, [[4, 5, 6]]])
    assert self_intersections(vertices, faces).tolist() == [[0, 2]]  # x > y is face 0


def test_touching_is_not_crossing() -> None:
    # two squares sharing an open seam (own vertices), one sharing only a corner, one on top
    seam = SQUARE[:, [2, 1, 0]]  # stands on the edge x = 0
    corner = SQUARE[:, [0, 2, 1]] + np.array([1, 1, 0])
    vertices = np.vstack([SQUARE, seam, corner])
    faces = np.vstack([SQUARE_FACES, SQUARE_FACES + 4, SQUARE_FACES + 8])
    assert len(self_intersections(vertices, faces)) == 0


def test_faces_with_a_common_vertex_can_cross() -> None:
    # around vertex 0: the far edge of face 1 passes through face 0
    vertices = [[0, 0, 0], [2, -1, 0], [2, 1, 0], [1, 0, -1], [1, 0, 1.0]]
    assert self_intersections(vertices, [[0, 1, 2], [0, 3, 4]]).tolist() == [[0, 1]]


def test_face_folded_flat_onto_its_neighbour_overlaps() -> None:
    vertices = [[0, 0, 0], [1, 0, 0], [0.2, 1, 0], [0.6, 0.7, 0]]
    assert self_intersections(vertices, [[0, 1, 2], [1, 0, 3]]).tolist() == [[0, 1]]
    unfolded = [*vertices[:3], [0.6, -0.7, 0]]
    assert len(self_intersections(unfolded, [[0, 1, 2], [1, 0, 3]])) == 0


def test_copies_and_faces_without_area_do_not_count() -> None:
    vertices = np.vstack([SQUARE, [[2, 0, 0]]])
    assert len(self_intersections(vertices, [[0, 1, 2], [1, 2, 0], [0, 1, 4]])) == 0


# edge-triangle crossings counted by whoever collected the meshes: 119 and 11
@pytest.mark.parametrize(
    ("name", "pairs"), [("tshirt1900-folding-triFolded.obj", 117), ("swimming03.obj", 11)]
)
def test_crossing_garments(shared_data: Path, name: str, pairs: int) -> None:
    mesh = read_mesh(shared_data / "nasty" / name)
    assert len(self_intersections(mesh.vertices, mesh.faces)) == pairs  # regression


def test_forty_thousand_faces_take_less_than_three_seconds() -> None:
    mesh = grid(142)
    wavy = mesh.vertices + np.sin(mesh.vertices[:, [1, 2, 0]] / 9)
    start = time.perf_counter()
    assert len(self_intersections(wavy, mesh.faces)) == 0
    assert time.perf_counter() - start < 3.0
