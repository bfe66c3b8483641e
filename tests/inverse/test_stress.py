"""The convex stress program on problems that can be solved by hand."""

from __future__ import annotations

import numpy as np
import pytest
from meshes import cap, grid, jittered, rolled
from plain_shell import PlainShell, dihedral

from casashell.contact.cone import margin
from casashell.contact.obstacles import Plane, Sphere
from casashell.engine.assembly import Assembly
from casashell.inverse.forces import SHRINKS, Shrink
from casashell.inverse.piece import Piece, split
from casashell.inverse.stress import StressProgram
from casashell.mesh import TriMesh
from casashell.problem import Problem
from casashell.typing import FloatArray

WIDE = Shrink(1.0, 0.0)


def _piece(problem: Problem) -> Piece:
    (only,) = split(problem)
    return only


def _bunting(width: float, height: float) -> tuple[Piece, float]:
    """A vertical triangle hanging from its two upper corners, and the weight of the lower one."""
    flag = TriMesh(
        np.array([[-width, 0.0, 0], [width, 0, 0], [0, 0, -height]]), np.array([[0, 2, 1]])
    )
    problem = Problem(flag, PlainShell(flag).terms(), pinned=[0, 1])
    return _piece(problem), 0.2 * width * height * 9.81 / 3


def test_hanging_triangle() -> None:
    """Statically determinate: tension w L / (2 height) in both edges, elongation tension L / k_L."""
    width, height = 0.3, 0.4
    piece, weight = _bunting(width, height)
    length = 0.5
    found = StressProgram(piece).solve(WIDE)
    assert found is not None
    elongation = weight * length / (2.0 * height) * length / 20.0
    assert found.largest_strain["stretch"] == pytest.approx(elongation, rel=1e-6)
    assert found.contact_forces.shape == (0, 3)


def test_loads_can_be_given() -> None:
    piece, _ = _bunting(0.3, 0.4)
    one, three = StressProgram(piece).solve(WIDE), StressProgram(piece, 3 * piece.loads).solve(WIDE)
    assert one is not None
    assert three is not None
    assert three.largest_strain["stretch"] == pytest.approx(
        3 * one.largest_strain["stretch"], rel=1e-6
    )


def test_sheet_that_lies_carries_itself() -> None:
    """All vertices on a floor: no stress at all, every vertex has its own weight."""
    flat = grid(3, 3)
    floor = Plane((0, 0, 1), 0.0, friction=0.5)
    piece = _piece(Problem(flat, PlainShell(flat).terms(), (floor,), contact_tolerance=1e-6))
    found = StressProgram(piece).solve(Shrink(1.0, 1e-3))
    assert found is not None
    assert found.contact_forces == pytest.approx(-piece.loads, rel=1e-5, abs=1e-6 * piece.f0)
    assert max(found.largest_strain.values()) <= 1e-6


def test_slope_too_steep_has_no_stress_that_holds() -> None:
    angle = np.radians(42.0)
    turn = np.array(
        [[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]]
    )
    flat = grid(2, 2)
    sheet = flat.moved(flat.vertices @ turn.T)
    for friction, feasible in ((0.85, False), (0.95, True)):  # tan 42 degrees = 0.9004
        plane = Plane((-np.sin(angle), 0.0, np.cos(angle)), 0.0, friction=friction)
        problem = Problem(sheet, PlainShell(sheet).terms(), (plane,), contact_tolerance=1e-6)
        assert (StressProgram(_piece(problem)).solve(WIDE) is not None) == feasible


def test_unsupported_mechanism_has_no_stress_that_holds() -> None:
    """A horizontal flat sheet without bending: no tension in its plane lifts anything."""
    flat = grid(3, 2)
    rim = [v for v in range(12) if v in (0, 1, 2, 9, 10, 11)]
    limp = _piece(Problem(flat, PlainShell(flat, bend=0.0).terms(), pinned=rim))
    stiff = _piece(Problem(flat, PlainShell(flat).terms(), pinned=rim))
    assert StressProgram(limp).solve(WIDE) is None
    assert StressProgram(stiff).solve(WIDE) is not None


def _hat(bend: float = 1e-3) -> Piece:
    ball = cap(3, 0.2, 1.2)
    head = Sphere((0.0, 0.0, 0.05), 0.15, friction=0.5)
    terms = PlainShell(ball, bend=bend).terms()
    return _piece(Problem(ball, terms, (head,), contact_tolerance=6e-3))


def test_stiffness_of_the_elements_is_the_hessian_at_rest() -> None:
    """c = k_L / L for an edge and 3 k_theta L^2 / A for a hinge."""
    piece = _hat()
    program = StressProgram(piece)
    ball = cap(3, 0.2, 1.2)
    lengths = np.linalg.norm(np.diff(ball.vertices[ball.edges], axis=1)[:, 0], axis=1)
    assert program.stiffness[: len(lengths)] == pytest.approx(20.0 / lengths, rel=1e-9)
    i, j, k, el = ball.vertices[ball.hinges].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(j - i, k - i), axis=1) / 2
    area += np.linalg.norm(np.cross(j - i, el - i), axis=1) / 2
    wanted = 3e-3 * ((j - i) ** 2).sum(axis=1) / area
    assert program.stiffness[len(lengths) :] == pytest.approx(wanted, rel=1e-9)


def test_forces_are_admissible_and_balance() -> None:
    piece = _hat()
    found = StressProgram(piece).solve(SHRINKS[0])
    assert found is not None
    total = found.contact_forces.sum(axis=0) + piece.loads.sum(axis=0)
    assert np.abs(total).max() <= 1e-5 * piece.f0
    inner = margin(found.contact_forces, piece.contacts.normals, piece.contacts.friction)
    assert inner.min() >= 0.0


def _curvature(mesh: TriMesh, v: FloatArray, tension: FloatArray, moment: FloatArray) -> float:
    """Second difference of sum tau q(x + t v) in t, q = edge lengths and hinge angles."""

    def measured(x: FloatArray) -> float:
        lengths = np.linalg.norm(x[mesh.edges[:, 1]] - x[mesh.edges[:, 0]], axis=1)
        angles = np.array([dihedral(x, tuple(map(int, row))) for row in mesh.hinges])  # type: ignore[arg-type]
        return float(tension @ lengths + moment @ angles)

    t, x = 1e-4, mesh.vertices
    return (measured(x + t * v) - 2.0 * measured(x) + measured(x - t * v)) / t**2


def test_cut_is_the_curvature_along_its_direction() -> None:
    """v.H.v is affine in the stresses: the constant is the Hessian at rest, the rest d2q along v."""
    mesh = jittered(rolled(grid(3, 2), 0.1, 0.4), 0.004)
    piece = _piece(Problem(mesh, PlainShell(mesh).terms(), pinned=[0]))
    mesh = mesh.moved(piece.target)
    rng = np.random.default_rng(0)
    v = rng.standard_normal(mesh.vertices.shape)
    coefficients = StressProgram(piece).cut(v)
    at_rest = Assembly(piece.energies[:2], 12)
    matrix = at_rest.pattern.matrix(at_rest.hessian(piece.target, piece.target)[1])
    assert coefficients[-1] == pytest.approx(v.ravel() @ (matrix @ v.ravel()), rel=1e-9)
    edges, hinges = len(mesh.edges), len(mesh.hinges)
    tension, moment = rng.standard_normal(edges), rng.standard_normal(hinges)
    tau = np.concatenate([tension, moment])
    assert coefficients[:-1] @ tau == pytest.approx(_curvature(mesh, v, tension, moment), rel=1e-4)


@pytest.mark.parametrize(("share", "feasible"), [(0.99, True), (1.01, False)])
def test_cuts_bound_the_curvature(share: float, feasible: bool) -> None:
    """The hanging triangle is a pendulum of stiffness weight / height, whatever its tensions."""
    piece, weight = _bunting(0.3, 0.4)
    aside = np.zeros((3, 3))
    aside[2, 1] = 1.0
    found = StressProgram(piece).solve(WIDE, [aside], share * weight / 0.4)
    assert (found is not None) == feasible


def test_cuts_change_the_forces_as_little_as_needed() -> None:
    """A cut that is met anyway changes nothing; a steeper one does."""
    piece = _hat(bend=1e-4)
    program = StressProgram(piece)
    v = np.random.default_rng(2).standard_normal(piece.target.shape)
    constant = float(program.cut(v)[-1])
    free, idle, active = (
        program.solve(SHRINKS[0], cuts, delta)
        for cuts, delta in ((None, 0.0), ([v], 0.5 * constant), ([v], 1.01 * constant))
    )
    assert free is not None
    assert idle is not None
    assert active is not None
    assert np.abs(idle.contact_forces - free.contact_forces).max() <= 5e-3 * piece.f0
    assert np.abs(active.contact_forces - free.contact_forces).max() > 0.1 * piece.f0
