"""Built-in scenes: the sizes their docstrings state, exact contact, good triangles, solved."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from casashell import solve
from casashell.app.builtin import BUILTIN, hat, page, skirt
from casashell.app.scene import Scene
from casashell.status import Status

# vertices and contacts from the docstrings: the hat's crown reaches ring 6 of 15, for ring 7 is
# at 7 / 15 of the arc length 0.1 * 65 deg + 0.04 * 45 deg + 0.07 = 0.2149, past 0.1134
COUNTS = {
    "hat": (1 + 3 * 15 * 16, 1 + 3 * 7 * 8),
    "skirt": (12 * 40, 40),
    "page": (19 * 43, 2 * 43),
}


@pytest.mark.parametrize("name", BUILTIN)
def test_counts_contacts_and_triangles(name: str) -> None:
    scene = BUILTIN[name]()
    mesh, contacts = scene.target, scene.problem.contacts
    assert (len(mesh.vertices), len(contacts)) == COUNTS[name]
    assert np.abs(contacts.gaps).max() < 1e-15
    # a vertex either touches or is clear of the obstacle
    distance, _ = scene.obstacles[0].signed_distance(mesh.vertices)
    assert np.delete(distance, contacts.vertices).min() > 2.0 * scene.problem.tolerance
    assert scene.problem.findings == ()
    assert np.degrees(mesh.face_angles.min()) > 25.0
    assert mesh.face_normals.mean(axis=0)[1] > 0.3  # wound to face up and out


def test_sizes() -> None:
    turn = np.radians(65.0)
    brim = 0.1 * np.sin(turn) + 0.04 * (np.sin(turn) - np.sin(np.radians(20.0)))
    brim += 0.07 * np.cos(np.radians(20.0))
    points = hat().target.vertices
    assert np.hypot(points[:, 0], points[:, 2]).max() == pytest.approx(brim)
    assert points[:, 1].max() == pytest.approx(0.1)
    waist = skirt().target.vertices[:40]
    np.testing.assert_allclose(np.hypot(waist[:, 0], waist[:, 2]), 0.13, rtol=1e-12)
    lower, upper = page().target.vertices.min(axis=0), page().target.vertices.max(axis=0)
    np.testing.assert_allclose(upper - lower, [0.3 / np.pi, 0.15 / np.pi, 0.2], rtol=1e-12)


@pytest.mark.parametrize("name", BUILTIN)
def test_solved_as_shipped(name: str) -> None:
    scene = BUILTIN[name]()
    result = solve(scene.problem, scene.method)
    assert result.status is Status.SOLVED, result.advice
    assert result.quality.flipped_faces == 0
    assert result.quality.rest_self_intersections == 0
    # the natural shape is another shape: gravity does something
    assert result.quality.max_rest_fold > 0.01


@pytest.mark.parametrize(
    "scene",
    [lambda: hat(rings=6), lambda: skirt(rows=6, around=20), lambda: page(across=9, along=13)],
)
def test_solved_when_coarse(scene: Callable[[], Scene]) -> None:
    assert solve(scene().problem).status is Status.SOLVED
