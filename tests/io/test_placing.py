"""Natural shapes are drawn on the target, wherever they are."""

from __future__ import annotations

import numpy as np
from drawn_result import dome

from casashell.io.placing import placed
from casashell.mesh import TriMesh


def turned(points: np.ndarray, seed: int) -> np.ndarray:
    """The points after a random rigid motion."""
    random = np.random.default_rng(seed)
    q, _ = np.linalg.qr(random.standard_normal((3, 3)))
    q[:, 0] *= np.sign(np.linalg.det(q))
    return np.asarray(points @ q + random.uniform(-20.0, 20.0, 3))


def test_every_piece_returns_to_its_place() -> None:
    one = dome()
    count = len(one.vertices)
    two = TriMesh(
        np.concatenate([one.vertices, one.vertices + np.array([3.0, 0.0, 0.0])]),
        np.concatenate([one.faces, one.faces + count]),
    )
    rest = np.concatenate([turned(two.vertices[:count], 1), turned(two.vertices[count:], 2)])
    np.testing.assert_allclose(placed(two, rest), two.vertices, atol=1e-12)


def test_shape_and_handedness_are_kept() -> None:
    mesh = dome()
    flat = mesh.vertices * [1.0, 0.0, 1.0]
    shown = placed(mesh, turned(flat, 3))
    assert np.ptp(shown[:, 1]) < 1e-12  # still flat, and level
    mirrored = mesh.vertices * [1.0, 1.0, -1.0]
    lengths = mesh.moved(placed(mesh, mirrored)).edge_lengths
    np.testing.assert_allclose(lengths, mesh.edge_lengths, rtol=1e-12)
    assert not np.allclose(placed(mesh, mesh.vertices * [0.9, -1.0, 1.0]), mesh.vertices, atol=0.05)


def test_a_shape_in_place_stays() -> None:
    mesh = dome()
    np.testing.assert_allclose(placed(mesh, mesh.vertices), mesh.vertices, atol=1e-14)
