"""What `Problem` refuses, with the name of the culprit, and what it derives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest
from meshes import grid, joined
from plain_shell import PlainShell

from casashell.contact.obstacles import Plane, Sphere
from casashell.mesh import TriMesh
from casashell.mesh_checks import MeshError
from casashell.problem import Problem
from formulations import edge_stretch

MESH = grid(3, 2)  # 12 vertices
TERMS = PlainShell(MESH).terms()
FLOOR = Plane((0, 0, 1), 0.0)


@pytest.mark.parametrize(
    ("pins", "message"),
    [
        ([12], r"pinned vertex 12 does not exist: ids go from 0 to 11"),
        ([3, -1], r"pinned vertex -1 does not exist"),
        ([0.5], r"pinned must be a list of vertex ids"),
        ([[0, 1]], r"pinned must be a list of vertex ids"),
        ([True, False], r"pinned must be a list of vertex ids"),
    ],
)
def test_pins_have_to_be_vertices(pins: Sequence[int], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Problem(MESH, TERMS, pinned=pins)


@pytest.mark.parametrize("pins", [[4, 2, 4, 2], np.array([2, 4]), range(2, 6, 2), (4, 2)])
def test_pins_are_sorted_and_unique(pins: Sequence[int]) -> None:
    assert np.asarray(Problem(MESH, TERMS, pinned=pins).pinned).tolist() == [2, 4]


def test_no_pins() -> None:
    assert len(np.asarray(Problem(MESH, TERMS).pinned)) == 0


@pytest.mark.parametrize("tolerance", [-1e-3, np.nan, np.inf])
def test_tolerance_is_a_length(tolerance: float) -> None:
    with pytest.raises(ValueError, match=r"contact_tolerance must be a length >= 0 m"):
        Problem(MESH, TERMS, (FLOOR,), contact_tolerance=tolerance)


@pytest.mark.parametrize("wrong", [FLOOR, (3,), (FLOOR, None)], ids=["one", "number", "None"])
def test_obstacles_are_checked_at_construction(wrong: tuple[Plane, ...]) -> None:
    with pytest.raises(ValueError, match="obstacle"):
        Problem(MESH, TERMS, wrong)


def test_energies_have_to_be_there_and_differ() -> None:
    with pytest.raises(ValueError, match="at least one energy"):
        Problem(MESH, ())
    with pytest.raises(ValueError, match=r"different names, got stretch, stretch"):
        Problem(MESH, (TERMS[0], edge_stretch(MESH, 3.0)))


def test_energy_of_a_larger_mesh_is_noticed() -> None:
    with pytest.raises(ValueError, match=r"energy 'stretch' refers to vertex 24.*another mesh"):
        Problem(MESH, (edge_stretch(grid(4, 4), 3.0),))
    negative = replace(TERMS[0], stencils=-TERMS[0].stencils)
    with pytest.raises(ValueError, match=r"energy 'stretch' refers to vertex"):
        Problem(MESH, (negative,))


def test_mesh_that_cannot_be_simulated_is_refused() -> None:
    """A face folded onto a line, two faces of opposite orientation, three faces on an edge."""
    line = TriMesh(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), np.array([[0, 1, 2]]))
    with pytest.raises(MeshError, match="face"):
        Problem(line, (edge_stretch(line, 1.0),))
    book = TriMesh(
        np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]]),
        np.array([[0, 1, 2], [1, 0, 3], [1, 0, 4]]),
    )
    with pytest.raises(MeshError, match="edge"):
        Problem(book, (edge_stretch(book, 1.0),))


def test_contacts_of_pinned_vertices_are_left_out() -> None:
    problem = Problem(MESH, TERMS, (FLOOR,), pinned=[0, 5], contact_tolerance=1e-6)
    wanted = np.setdiff1d(np.arange(12), [0, 5])
    assert problem.contacts.vertices.tolist() == wanted.tolist()
    assert problem.contacts is problem.contacts  # found once


def test_contacts_of_several_obstacles() -> None:
    """The floor touches all, the ball the corner it stands at: that vertex is in contact twice."""
    ball = Sphere((0.0, 0.0, -0.05), 0.05, friction=0.9)
    contacts = Problem(MESH, TERMS, (FLOOR, ball), contact_tolerance=1e-4).contacts
    assert contacts.vertices.tolist() == [*range(12), 0]
    assert contacts.obstacle.tolist() == [0] * 12 + [1]
    assert contacts.friction.tolist() == [0.5] * 12 + [0.9]


def test_without_obstacles_there_are_no_contacts() -> None:
    assert len(Problem(MESH, TERMS).contacts) == 0


def test_default_tolerance_is_half_a_per_cent_of_the_diagonal() -> None:
    assert Problem(MESH, TERMS).tolerance == pytest.approx(0.005 * np.hypot(0.3, 0.2), rel=1e-12)
    assert Problem(MESH, TERMS, contact_tolerance=0.0).tolerance == 0.0


def test_problem_is_frozen_and_keeps_tuples() -> None:
    problem = Problem(MESH, list(TERMS), [FLOOR])  # type: ignore[arg-type]
    assert isinstance(problem.energies, tuple)
    assert isinstance(problem.obstacles, tuple)
    with pytest.raises(FrozenInstanceError):
        problem.target = grid(1, 1)  # type: ignore[misc]


def test_warnings_about_the_mesh_are_kept() -> None:
    assert Problem(MESH, TERMS).findings == ()
    apart = joined(MESH, MESH.moved(MESH.vertices + np.array([0.0, 0.0, 1.0])))
    findings = Problem(apart, PlainShell(apart).terms()).findings
    assert all(finding.severity == "warning" for finding in findings)
