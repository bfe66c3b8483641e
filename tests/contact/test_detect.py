"""Contact detection: which vertices, in which order, with which gap; real garments."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import igl
import numpy as np
import pytest

from casashell.contact.detect import Contacts, describe, detect
from casashell.contact.obstacles import MeshObstacle, Plane, Sphere
from casashell.typing import FloatArray, IntArray

FLOOR = Plane((0, 0, 1), 0.0, friction=0.3, name="floor")
BALL = Sphere((0, 0, 1.0), 1.0, friction=0.7)


@dataclass
class Triangles:
    vertices: FloatArray
    faces: IntArray


@dataclass
class Counting:
    """A user's own obstacle: the unit ball around the origin, counting queried points."""

    friction: float = 0.5
    name: str = "mine"
    normal_length: float = 1.0
    asked: list[int] = field(default_factory=list)

    def signed_distance(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        self.asked.append(len(points))
        length = np.linalg.norm(points, axis=1)
        return length - 1.0, self.normal_length * points / length[:, None]

    def bounding_box(self) -> tuple[FloatArray, FloatArray] | None:
        return np.full(3, -1.0), np.full(3, 1.0)


def test_contacts_by_hand() -> None:
    """Order by obstacle then vertex; a vertex twice; gaps kept with their sign."""
    x = [[0, 0, -0.02], [5, 0, 0.5], [0, 0, 2.01], [0.0, 0.0, 0.005], [7, 0, 0.04]]
    contacts = detect(x, [BALL, FLOOR], 0.05)
    assert contacts.vertices.tolist() == [0, 2, 3, 0, 3, 4]
    assert contacts.obstacle.tolist() == [0, 0, 0, 1, 1, 1]
    assert contacts.gaps == pytest.approx([0.02, 0.01, -0.005, -0.02, 0.005, 0.04])
    assert contacts.friction.tolist() == [0.7, 0.7, 0.7, 0.3, 0.3, 0.3]
    down, up = [0.0, 0.0, -1.0], [0.0, 0.0, 1.0]
    assert contacts.normals == pytest.approx(np.array([down, up, down, up, up, up]))
    assert len(contacts) == 6


def test_tolerance_is_strict_and_zero_means_penetration() -> None:
    x = [[0, 0, -0.1], [0, 0, 0.0], [0, 0, 0.25]]
    assert detect(x, [FLOOR], 0.25).vertices.tolist() == [0, 1]
    assert detect(x, [FLOOR], 0.0).vertices.tolist() == [0]


def test_excluded_vertices_are_never_in_contact() -> None:
    x = np.zeros((4, 3))
    assert detect(x, [FLOOR, FLOOR], 0.1, np.array([2, 0])).vertices.tolist() == [1, 3, 1, 3]
    assert len(detect(x, [FLOOR], 0.1, [0, 1, 2, 3])) == 0


def test_nothing_to_touch() -> None:
    for contacts in (detect(np.zeros((3, 3)), [], 0.1), Contacts.empty()):
        assert len(contacts) == 0
        assert contacts.normals.shape == (0, 3)
        assert contacts.tangents[1].shape == (0, 3)
    assert len(detect(np.zeros((0, 3)), [FLOOR, BALL], 0.1)) == 0


def test_far_points_are_not_queried_and_none_is_missed() -> None:
    x = np.random.default_rng(0).uniform(-10.0, 10.0, (20000, 3))
    mine = Counting()
    contacts = detect(x, [mine], 0.5)
    want = np.flatnonzero(np.linalg.norm(x, axis=1) < 1.5)
    assert np.array_equal(contacts.vertices, want)
    # the box of edge 3 in a box of edge 20 holds 0.34 % of the points
    assert mine.asked == [pytest.approx(67, abs=30)]


def test_same_contacts_with_and_without_the_box() -> None:
    x = np.random.default_rng(1).uniform(-2.0, 3.0, (5000, 3))
    vertices, faces = igl.icosahedron()
    body = MeshObstacle(Triangles(vertices, np.asarray(faces, dtype=np.int64)))
    gap, normal = body.signed_distance(x)
    contacts = detect(x, [body], 0.2)
    assert np.array_equal(contacts.vertices, np.flatnonzero(gap < 0.2))
    assert np.array_equal(contacts.gaps, gap[contacts.vertices])
    assert np.array_equal(contacts.normals, normal[contacts.vertices])


def test_subset_and_tangents() -> None:
    contacts = detect([[0, 0, -0.02], [0, 0, 2.01]], [BALL, FLOOR], 0.05)
    floor = contacts.subset(contacts.obstacle == 1)
    assert floor.vertices.tolist() == [0]
    assert floor.friction.tolist() == [0.3]
    assert contacts.subset(np.array([2, 0])).obstacle.tolist() == [1, 0]
    t1, t2 = contacts.tangents
    assert np.cross(t1, t2) == pytest.approx(contacts.normals, abs=1e-15)


def test_contacts_are_read_only_copies() -> None:
    gaps = np.array([0.1])
    contacts = Contacts(
        np.array([3]), np.array([[0, 0, 1.0]]), np.array([0.5]), gaps, np.array([0])
    )
    gaps[0] = 9.0
    assert contacts.gaps.tolist() == [0.1]
    with pytest.raises(ValueError, match="read-only"):
        contacts.normals[0, 0] = 1.0


def test_summaries_by_hand() -> None:
    obstacles = [BALL, FLOOR, Plane((1, 0, 0), -9.0)]
    x = [[0, 0, -0.02], [5, 0, -0.03], [0, 0, 2.01], [7, 0, 0.04]]
    ball, floor, wall = describe(detect(x, obstacles, 0.05), obstacles)
    assert (ball.obstacle, ball.label, ball.count, ball.penetrating) == (0, "Sphere 0", 2, 0)
    assert (ball.deepest, ball.deepest_vertex) == (0.0, None)
    assert ball.largest_gap == pytest.approx(0.02)
    assert (floor.label, floor.count, floor.penetrating, floor.deepest_vertex) == ("floor", 3, 2, 1)
    assert floor.deepest == pytest.approx(0.03)
    assert floor.largest_gap == pytest.approx(0.04)
    assert (wall.label, wall.count, wall.largest_gap) == ("Plane 2", 0, 0.0)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda x: detect(x, [FLOOR], -0.1), "contact tolerance must be zero or more, got -0.1"),
        (lambda x: detect(x, [FLOOR], np.nan), "contact tolerance must be finite"),
        (lambda x: detect(x, [FLOOR], 0.1, [3]), "exclude names vertex 3; ids run from 0 to 2"),
        (lambda x: detect(x, [FLOOR], 0.1, [0.5]), "exclude must be integer vertex ids"),
        (lambda x: detect(x[:, :2], [FLOOR], 0.1), r"points must have shape \(N, 3\)"),
        (lambda x: detect(x * np.inf, [FLOOR], 0.1), "vertex 0 is not finite"),
        (lambda x: detect(x, FLOOR, 0.1), "obstacles must be a list, got one Plane"),
        (lambda x: detect(x, [FLOOR, "body.obj"], 0.1), "obstacle 1 is a str"),
        (lambda x: detect(x, [Counting(friction=-1.0)], 0.1), "obstacle 0 friction must be zero"),
        (
            lambda x: detect(x, [Counting(normal_length=2.0)], 0.1),
            "mine at vertex 0: normal has length 2",
        ),
        (
            lambda x: detect(0.0 * x, [Counting(normal_length=np.nan)], 0.1),
            "mine at vertex 0: normal has length nan",
        ),
    ],
)
def test_wrong_input_is_named(call: Callable[[FloatArray], Contacts], message: str) -> None:
    with np.errstate(invalid="ignore"), pytest.raises(ValueError, match=message):
        call(np.full((3, 3), 0.1))


def test_wrong_contact_arrays_are_named() -> None:
    with pytest.raises(ValueError, match=r"Contacts.gaps must have shape \(1,\), got \(2,\)"):
        Contacts(np.array([3]), np.array([[0, 0, 1.0]]), np.ones(1), np.ones(2), np.zeros(1, int))


# Reference runs: contact counts with these tolerances in the files' units.  brimmed_hat_avatar has
# vertices within rounding of its tolerance, hence the range.
REAL = [
    ("hat_on_sphere", 0.039, {62}),
    ("skirt_8panel_smpl", 0.0045, {41}),
    ("skirt_4panel_smpl", 0.0039, {39}),
    ("long_skirt_makehuman", 0.069, {79}),
    ("top_avatar", 0.033, {105}),
    ("sleeve_avatar", 0.040, {38}),
    ("shirt_avatar", 0.085, {161}),
    ("pants_avatar", 0.049, {221}),
    ("dress_avatar", 0.048, {171}),
    ("knit_cap_avatar", 0.091, {29}),
    ("brimmed_hat_avatar", 0.057, {170, 171, 172}),
    ("sheet_on_slope_576", 0.01, {549}),
]


@pytest.mark.parametrize(("folder", "tolerance", "counts"), REAL, ids=[r[0] for r in REAL])
def test_real_garments(shared_data: Path, folder: str, tolerance: float, counts: set[int]) -> None:
    if not (shared_data / folder).is_dir():
        pytest.skip(f"no {folder} in the shared data")
    shell, _ = igl.read_triangle_mesh(str(shared_data / folder / "shell.obj"))
    vertices, faces = igl.read_triangle_mesh(str(shared_data / folder / "obstacle.obj"))
    body = MeshObstacle(Triangles(vertices, np.asarray(faces, dtype=np.int64)), name="body")
    contacts = detect(shell, [body], tolerance)
    assert len(contacts) in counts
    assert body.closed
    # the same in metres; independent distances and normals from libigl
    metres = MeshObstacle(Triangles(0.1 * vertices, body.mesh.faces))
    assert np.array_equal(
        detect(0.1 * shell, [metres], 0.1 * tolerance).vertices, contacts.vertices
    )
    near = shell[contacts.vertices]
    kind = igl.SignedDistanceType.SIGNED_DISTANCE_TYPE_PSEUDONORMAL
    distance, _, foot, _ = igl.signed_distance(near, vertices, body.mesh.faces, kind)
    assert contacts.gaps == pytest.approx(distance, abs=1e-12)
    on_surface = near - contacts.gaps[:, None] * contacts.normals
    assert on_surface == pytest.approx(foot, abs=2e-6 * body.surface.size)
    winding = igl.winding_number(vertices, body.mesh.faces, near)
    assert np.array_equal(winding > 0.5, contacts.gaps < 0.0)
