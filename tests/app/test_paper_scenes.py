"""Scenes of Ly 2018: materials and counts of its tables, the sizes of the docstrings, solved."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from casashell import solve
from casashell.app.builtin import BUILTIN
from casashell.app.paper_scenes import PAPER
from casashell.app.scene import Scene
from casashell.inverse.forces import SHRINKS
from casashell.inverse.piece import split
from casashell.inverse.stress import StressProgram
from casashell.status import Status

# Ly 2018, Table 1: density [kg/m2], k_L [N], k_theta [J], mu; Table 2: vertices, contacts
PUBLISHED = {
    "synthetic-skirt": (0.1, 3.0, 5e-3, 0.6, 200, 19),
    "book-page": (10.0, 5.0, 2e-3, 0.4, 817, 143),
    "puff-sleeve": (1.0, 0.1, 1e-3, 0.7, 402, 67),
    "beret": (0.25, 0.05, 5e-4, 0.3, 846, 69),
    "floppy-hat": (2.5, 5.0, 5e-4, 0.6, 876, 178),
}
# from the docstrings: vertices, contacts, and regression values of the largest fold [rad]
BUILT = {
    "synthetic-skirt": (200, 20, 0.0898),
    "book-page": (817, 129, 0.0297),
    "puff-sleeve": (396, 72, 0.0538),
    "beret": (847, 72, 0.0592),
    "floppy-hat": (873, 169, 0.0461),
}


@cache
def _scene(name: str) -> Scene:
    return PAPER[name]()


def test_names() -> None:
    assert list(PAPER) == list(PUBLISHED)
    assert all(_scene(name).name == name for name in PAPER)
    assert not set(PAPER) & set(BUILTIN)


@pytest.mark.parametrize("name", PAPER)
def test_materials_and_counts_are_those_of_the_paper(name: str) -> None:
    scene = _scene(name)
    density, stretch, bend, friction, vertices, contacts = PUBLISHED[name]
    material = scene.material
    assert (material.density, material.stretch, material.bend) == (density, stretch, bend)
    assert material.friction is None
    assert {obstacle.friction for obstacle in scene.obstacles} == {friction}
    assert set(scene.problem.contacts.friction) == {friction}
    assert scene.gravity == (0.0, -9.81, 0.0)
    built = (len(scene.target.vertices), len(scene.problem.contacts))
    assert built == BUILT[name][:2]
    assert built[0] == pytest.approx(vertices, rel=0.05)
    assert built[1] == pytest.approx(contacts, rel=0.25)


@pytest.mark.parametrize("name", PAPER)
def test_mesh_is_sound_and_touches_exactly(name: str) -> None:
    scene = _scene(name)
    mesh, problem = scene.target, scene.problem
    assert problem.findings == ()
    assert mesh.components[0] == 1
    assert np.degrees(mesh.face_angles.min()) > 15.0
    assert mesh.face_normals.mean(axis=0)[1] > -1e-12  # wound to face up and out
    assert np.abs(problem.contacts.gaps).max() < 1e-15
    distance, _ = scene.obstacles[0].signed_distance(mesh.vertices)
    held = np.union1d(problem.contacts.vertices, problem.pinned)
    assert np.delete(distance, held).min() > 50.0 * problem.tolerance


def test_sizes() -> None:
    size = {name: np.ptp(_scene(name).target.vertices, axis=0) for name in PAPER}
    margin = math.pi * 0.05 / 16.0
    np.testing.assert_allclose(size["book-page"], [0.1 + 2 * margin, 0.05, 0.2], rtol=1e-12)
    beret = _scene("beret").target.vertices
    # a dome 115 mm above the centre of the head, leaning by 25 degrees
    assert np.linalg.norm(beret[0]) == pytest.approx(0.115)
    assert math.degrees(math.atan2(-beret[0, 0], beret[0, 1])) == pytest.approx(25.0)
    turn = 0.028 * (math.sin(math.radians(55.0)) - 0.5)
    reach = 0.07 * math.sin(math.radians(55.0)) + turn + 0.06 * math.cos(math.radians(30.0))
    hat = _scene("floppy-hat").target.vertices
    assert np.hypot(hat[:, 0], hat[:, 2]).max() == pytest.approx(reach)
    hem = hat[-84:, 1]
    assert np.ptp(hem) == pytest.approx(0.02)
    sleeve = _scene("puff-sleeve")
    assert sleeve.obstacles[0].signed_distance(sleeve.target.vertices)[0].max() == pytest.approx(
        0.032, rel=0.01
    )


def test_skirt_hangs_from_its_waist_line() -> None:
    skirt = _scene("synthetic-skirt")
    assert skirt.problem.contacts.vertices.tolist() == list(range(20))
    points = skirt.target.vertices
    # regressions of the drape: the hole has widened from 0.2, the hem hangs 0.44 below it
    waist = np.hypot(points[:20, 0], points[:20, 2])
    assert waist == pytest.approx(0.264, abs=1e-3)
    assert points[:20, 1].mean() - points[-20:, 1].mean() == pytest.approx(0.444, abs=2e-3)


def test_page_is_held_at_its_spine() -> None:
    page = _scene("book-page")
    spine = page.target.vertices[list(page.pinned)]
    assert len(spine) == 43
    assert (spine[:, 1] == 0.0).all()
    assert (spine[:, 0] == page.target.vertices[:, 0].min()).all()


@pytest.mark.parametrize("name", PAPER)
def test_rest_folds_stay_small(name: str) -> None:
    (piece,) = split(_scene(name).problem)
    found = StressProgram(piece).solve(SHRINKS[0])
    assert found is not None
    assert found.largest_strain["bend"] < 0.5
    assert found.largest_strain["bend"] == pytest.approx(BUILT[name][2], rel=0.05)


@pytest.mark.parametrize("name", PAPER)
def test_solved_with_the_materials_of_the_paper(name: str) -> None:
    result = solve(_scene(name).problem, "direct")
    assert result.status is Status.SOLVED, result.advice
    assert result.certificate.free_force is not None
    assert result.certificate.free_force <= 1e-9
    assert result.quality.flipped_faces == 0
    assert result.quality.rest_self_intersections == 0
    assert result.quality.max_rest_fold < 0.5


def test_scenes_are_fresh_but_the_drape_is_computed_once() -> None:
    one, two = PAPER["synthetic-skirt"](), PAPER["synthetic-skirt"]()
    assert one is not two
    np.testing.assert_array_equal(one.target.vertices, two.target.vertices)
