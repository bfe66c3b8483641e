"""Meshes as obstacles: against exact shapes, sign at sharp edges, dirty and open input."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import dataclass

import igl
import numpy as np
import pytest

from casashell.contact.obstacles import MeshObstacle, Obstacle, Sphere
from casashell.typing import FloatArray, IntArray


@dataclass
class Triangles:
    """The least a mesh must offer."""

    vertices: FloatArray
    faces: IntArray


CORNERS = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
CUBE = np.array([t for a, b, c, d in QUADS for t in ((a, b, c), (a, c, d))])


def cube(size: FloatArray | float = 1.0, at: FloatArray | float = 0.0) -> Triangles:
    """Box from ``at`` to ``at + size``, its faces outwards."""
    return Triangles(CORNERS * size + at, CUBE.copy())


def joined(*parts: Triangles) -> Triangles:
    offsets = np.cumsum([0] + [len(part.vertices) for part in parts])
    faces = [part.faces + offset for part, offset in zip(parts, offsets)]
    return Triangles(np.concatenate([p.vertices for p in parts]), np.concatenate(faces))


def icosphere(radius: float, rounds: int) -> Triangles:
    vertices, faces = igl.icosahedron()
    for _ in range(rounds):
        vertices, faces = igl.upsample(vertices, faces)
        vertices /= np.linalg.norm(vertices, axis=1)[:, None]
    return Triangles(radius * vertices, np.asarray(faces, dtype=np.int64))


def exact_box(x: FloatArray, size: FloatArray | float) -> FloatArray:
    """Closed form of the signed distance to a box from the origin to ``size``."""
    half = 0.5 * np.broadcast_to(size, (3,))
    q = np.abs(x - half) - half
    return np.asarray(np.linalg.norm(np.maximum(q, 0.0), axis=1) + np.minimum(q.max(axis=1), 0.0))


def cloud(count: int = 3000, low: float = -1.0, high: float = 2.0, seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).uniform(low, high, (count, 3))


@pytest.mark.parametrize("size", [1.0, (2.0, 0.01, 0.5)])
def test_box_is_exact(size: float) -> None:
    mesh = MeshObstacle(cube(np.array(size)))
    x = cloud()
    distance, normal = mesh.signed_distance(x)
    assert distance == pytest.approx(exact_box(x, size), abs=1e-14)
    assert np.linalg.norm(normal, axis=1) == pytest.approx(1.0, abs=1e-12)
    foot = x - distance[:, None] * normal
    assert np.abs(exact_box(foot, size)).max() < 1e-13
    assert mesh.closed
    assert mesh.notes == ()
    assert isinstance(mesh, Obstacle)


def test_icosphere_is_the_sphere_up_to_its_sagitta() -> None:
    """Vertices on the sphere: the surfaces are nowhere farther apart than the sagitta."""
    radius = 0.7
    body = icosphere(radius, 4)
    edges = np.diff(body.vertices[body.faces[:, [0, 1, 2, 0]]], axis=1)
    # circumradius of an acute triangle: at most its longest edge / sqrt 3
    reach = np.linalg.norm(edges, axis=2).max() / np.sqrt(3.0)
    sagitta = radius - np.sqrt(radius**2 - reach**2)
    x = cloud(low=-1.0, high=1.0)
    distance, normal = MeshObstacle(body).signed_distance(x)
    exact, radial = Sphere((0, 0, 0), radius).signed_distance(x)
    assert (distance >= exact - 1e-14).all()
    assert (distance <= exact + sagitta).all()
    assert sagitta < 0.002
    away = np.abs(exact) > 0.05
    # nearest points are within sqrt(2 R sagitta) of each other
    assert (
        np.linalg.norm(normal - radial, axis=1)[away].max() < np.sqrt(2 * radius * sagitta) / 0.05
    )


def test_normal_is_the_gradient() -> None:
    body = MeshObstacle(icosphere(0.7, 2))
    x, h = cloud(1500, -1.0, 1.0), 1e-6
    _, normal = body.signed_distance(x)
    gradient, smooth = np.empty_like(x), np.ones(len(x), dtype=bool)
    for k, step in enumerate(h * np.eye(3)):
        after, n_after = body.signed_distance(x + step)
        before, n_before = body.signed_distance(x - step)
        gradient[:, k] = (after - before) / (2.0 * h)
        smooth &= np.linalg.norm(n_after - n_before, axis=1) < 1e-4
    assert smooth.mean() > 0.95
    assert np.abs(gradient - normal)[smooth].max() < 1e-6


def test_sign_at_sharp_corners_is_that_of_the_winding_number() -> None:
    """A needle: at its tip single face normals give the wrong side; solid angles do not."""
    tip = np.array([[0, 0, 0], [0.05, 0, 0], [0, 0.05, 0], [0.4, 0.3, 1.0]])
    needle = Triangles(tip, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]))
    x = cloud(6000, -0.2, 1.2)
    x = np.concatenate([x, tip[3] + 0.1 * cloud(3000, -1.0, 1.0)])
    inner = tip.T @ np.random.default_rng(2).dirichlet(np.ones(4), 500).T
    x = np.concatenate([x, inner.T])
    distance, _ = MeshObstacle(needle).signed_distance(x)
    winding = igl.winding_number(needle.vertices, needle.faces, x)
    assert np.array_equal(distance < 0.0, winding > 0.5)
    assert (distance < 0.0).sum() > 400
    # this check can fail: the normal of the nearest face alone gets points wrong
    _, face, nearest = igl.point_mesh_squared_distance(x, needle.vertices, needle.faces)
    a, b, c = (needle.vertices[needle.faces[face, k]] for k in range(3))
    assert ((np.cross(b - a, c - a) * (x - nearest)).sum(axis=1) < 0.0).sum() > 600


def test_normal_on_the_surface_is_the_pseudonormal() -> None:
    """On the surface and within 1e-6 of the size: face normal, edge sum, angle-weighted sum."""
    body = MeshObstacle(cube())
    x = np.array([[0.3, 0.2, 1.0], [0.3, 0.2, 1.0 - 1e-9], [1.0, 0.3, 1.0], [1.0, 1.0, 1.0]])
    distance, normal = body.signed_distance(x)
    assert distance == pytest.approx([0.0, -1e-9, 0.0, 0.0], abs=1e-15)
    # three right angles at a corner of a cube, however its faces are split
    want = np.array([[0, 0, 1], [0, 0, 1], [np.sqrt(0.5), 0, np.sqrt(0.5)], [1 / np.sqrt(3)] * 3])
    assert normal == pytest.approx(want, abs=1e-12)


def test_dirty_faces_and_vertices_do_not_matter() -> None:
    """Split vertices, repeated faces' corners, slivers, stray and doubled vertices."""
    box = cube()
    soup = Triangles(box.vertices[box.faces].reshape(-1, 3), np.arange(36).reshape(-1, 3))
    vertices = np.concatenate([soup.vertices, [[9.0, 9.0, 9.0]], [[0.5, 0.0, 0.0]]])
    extra = np.array([[0, 0, 5], [3, 3, 3]])
    body = MeshObstacle(Triangles(vertices, np.concatenate([soup.faces, extra])))
    x = cloud()
    assert body.signed_distance(x)[0] == pytest.approx(exact_box(x, 1.0), abs=1e-14)
    assert body.closed
    assert body.notes == (
        "28 vertices joined with one at the same place",
        "2 vertices without a face left out",
        "2 faces with a repeated corner left out",
    )
    box_of_body = body.bounding_box()
    assert box_of_body is not None
    assert np.array_equal(box_of_body[1], [1.0, 1.0, 1.0])


def test_collinear_face_in_an_edge_keeps_the_mesh_closed() -> None:
    """A triangle of no height fills the crack of a T-junction."""
    box = cube()
    vertices = np.concatenate([box.vertices, [[0.0, 0.0, 0.5]]])
    # vertex 8 halves the edge 0-1 in the face (0, 1, 3) only; (0, 1, 8) closes the crack
    faces = [f for f in box.faces.tolist() if f != [0, 1, 3]]
    faces += [[0, 8, 3], [8, 1, 3], [0, 1, 8]]
    body = MeshObstacle(Triangles(vertices, np.array(faces)))
    x = cloud()
    assert body.closed
    assert body.notes == ("1 faces without area left out",)
    assert body.signed_distance(x)[0] == pytest.approx(exact_box(x, 1.0), abs=1e-14)


def test_an_inside_out_mesh_is_refused_and_can_be_flipped() -> None:
    box = cube()
    inside_out = Triangles(box.vertices, box.faces[:, ::-1])
    with pytest.raises(ValueError, match=r"'table' is inside out.*volume -1\).*flip=True"):
        MeshObstacle(inside_out, name="table")
    x = cloud(200)
    flipped = MeshObstacle(inside_out, flip=True)
    assert flipped.signed_distance(x)[0] == pytest.approx(exact_box(x, 1.0), abs=1e-14)
    with pytest.raises(ValueError, match="leave out flip"):
        MeshObstacle(box, flip=True)


def test_one_part_inside_out_is_found_but_a_cavity_is_allowed() -> None:
    hole = cube(0.5, 0.25)
    hole.faces = hole.faces[:, ::-1]
    beside = Triangles(hole.vertices + 3.0, hole.faces)
    with pytest.raises(ValueError, match="inside out in the part with face 12"):
        MeshObstacle(joined(cube(), beside))
    shell = MeshObstacle(joined(cube(), hole))
    distance, _ = shell.signed_distance([[0.5, 0.5, 0.5], [0.1, 0.5, 0.5], [-0.1, 0.5, 0.5]])
    assert distance == pytest.approx([0.25, -0.1, 0.1])


def test_faces_that_wind_against_each_other_are_named() -> None:
    box = cube()
    box.faces[7] = box.faces[7, ::-1]
    with pytest.raises(ValueError, match=r"at 3 edges, first faces \d+ and \d+") as caught:
        MeshObstacle(box)
    assert "7" in str(caught.value)


def test_open_mesh_is_one_sided_and_says_so() -> None:
    """A table top: below it is inside, beside it is free."""
    top = Triangles(
        np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]])
    )
    table = MeshObstacle(top)
    assert not table.closed
    assert table.bounding_box() is None
    assert table.notes == ("open mesh, 4 border edges: points behind its faces count as inside",)
    x = np.array([[0.5, 0.4, 0.1], [0.5, 0.4, -0.1], [1.5, 0.5, -0.1], [1.01, 0.5, -0.5]])
    distance, normal = table.signed_distance(x)
    assert distance[:3] == pytest.approx([0.1, -0.1, np.hypot(0.5, 0.1)])
    assert normal[:2] == pytest.approx(np.tile([0.0, 0, 1], (2, 1)))
    assert normal[2] == pytest.approx(np.array([0.5, 0, -0.1]) / np.hypot(0.5, 0.1))
    # under the rim, within 45 degrees of straight down, still counts as behind
    assert distance[3] == pytest.approx(-np.hypot(0.01, 0.5))
    turned = MeshObstacle(top, flip=True)
    assert turned.signed_distance(x[:2])[0] == pytest.approx([-0.1, 0.1])


def test_open_body_far_below_its_cut_is_outside() -> None:
    """A tube open at both ends: hanging cloth far below the cut must not count as inside."""
    turn = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    ring = np.column_stack([np.cos(turn), np.sin(turn)])
    vertices = np.concatenate([np.column_stack([ring, np.full(24, z)]) for z in (0.0, 4.0)])
    i, j = np.arange(24), (np.arange(24) + 1) % 24
    faces = np.concatenate([np.column_stack([i, j, j + 24]), np.column_stack([i, j + 24, i + 24])])
    tube = MeshObstacle(Triangles(vertices, faces))
    distance, _ = tube.signed_distance([[0.1, 0, -5.0], [0.1, 0, 2.0], [0.9, 0, -0.01], [2, 0, 1]])
    assert (distance > 0.0).tolist() == [True, False, False, True]


def test_more_than_two_faces_at_an_edge_is_a_note() -> None:
    touching = joined(cube(), cube(1.0, np.array([1.0, 1.0, 0.0])))
    body = MeshObstacle(touching)
    assert body.closed
    assert body.notes[-1] == "1 edges with more than two faces: the side is uncertain there"
    assert body.signed_distance([[0.5, 0.5, 0.9], [1.5, 1.5, 0.9]])[0] == pytest.approx(
        [-0.1, -0.1]
    )


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        (
            lambda: Triangles(np.array([[0, 0, 0], [1, np.nan, 0], [0, 1, 0]]), np.eye(3)),
            "vertices of obstacle 'body': vertex 1 is not finite",
        ),
        (lambda: Triangles(CORNERS, np.array([[0, 1, 8]])), r"face 0 .* run from 0 to 7"),
        (lambda: Triangles(CORNERS, np.zeros((0, 3), dtype=int)), r"shape \(F, 3\) with F > 0"),
        (lambda: Triangles(CORNERS, np.array(QUADS)), r"shape \(F, 3\) with F > 0, got \(6, 4\)"),
        (lambda: Triangles(CORNERS, CUBE + 0.5), "must be integer vertex ids"),
        (lambda: Triangles(CORNERS * (0, 0, 1), CUBE), "has no face with an area"),
        (lambda: "body.obj", "got str; read a file with casashell.read_mesh"),
    ],
)
def test_wrong_meshes_are_named(mesh: Callable[[], Triangles], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        MeshObstacle(mesh(), name="body")


def test_friction_and_points_are_checked() -> None:
    with pytest.raises(ValueError, match="obstacle 'body' friction must be zero or more"):
        MeshObstacle(cube(), friction=-1.0, name="body")
    with pytest.raises(ValueError, match="vertex 0 is not finite"):
        MeshObstacle(cube()).signed_distance([[np.inf, 0.0, 0.0]])
    distance, normal = MeshObstacle(cube()).signed_distance(np.zeros((0, 3)))
    assert distance.shape == (0,)
    assert normal.shape == (0, 3)


def test_pickle_after_a_query() -> None:
    body = MeshObstacle(cube(), friction=0.3, name="block")
    x = cloud(50)
    want = body.signed_distance(x)
    copy = pickle.loads(pickle.dumps(body))
    got = copy.signed_distance(x)
    assert np.array_equal(got[0], want[0])
    assert np.array_equal(got[1], want[1])
    assert (copy.friction, copy.name) == (0.3, "block")


def test_size_and_place_do_not_matter() -> None:
    """The same body in micrometres a kilometre away (float64 keeps 1e-13 m there)."""
    x = cloud(500)
    want = exact_box(x, 1.0)
    tiny = MeshObstacle(cube(1e-6)).signed_distance(x * 1e-6)[0]
    assert tiny == pytest.approx(want * 1e-6, abs=1e-20)
    far = MeshObstacle(cube(1.0, 1000.0)).signed_distance(x + 1000.0)[0]
    assert far == pytest.approx(want, abs=1e-12)
