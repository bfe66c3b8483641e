"""Newton on the natural shape: convergence, and shapes that are known beforehand."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from forward import settle
from meshes import grid
from plain_shell import PlainShell

from casashell.contact.obstacles import Plane
from casashell.engine.assembly import Assembly
from casashell.engine.energy import Energy
from casashell.inverse.load_path import TIGHT, LoadPath, longest_step
from casashell.inverse.piece import Piece, split
from casashell.mesh import TriMesh
from casashell.problem import Problem
from casashell.result import Step
from casashell.solving import solve
from casashell.typing import FloatArray

# The example of Ly 2018, Sec. 4.2: the left face is fixed, vertex 3 hangs.  Soft in its plane, so
# that the hanging face is visibly stretched.
FLAT = TriMesh(
    np.array([[0.0, 0, 0], [0, 0.1, 0], [0.1, 0, 0], [0.1, 0.1, 0]]),
    np.array([[0, 2, 1], [1, 2, 3]]),
)
SOFT = PlainShell(FLAT, stretch=0.5, bend=1e-4)
FREE = np.array([False, False, False, True])


def _hanging() -> TriMesh:
    """The pose that ``FLAT`` takes under its own weight."""
    start = FLAT.vertices - np.array([0.0, 0.0, 1e-3]) * FREE[:, None]
    pose = settle(Assembly(SOFT.terms(), 4), start, FLAT.vertices, FREE)
    assert pose[3, 2] < -0.02  # it hangs by a quarter of an edge
    return FLAT.moved(pose)


def _frozen_weight(mesh: TriMesh) -> Energy:
    """Weight with the masses of ``mesh`` itself, whatever its natural shape."""
    x, r, p = ca.SX.sym("x", 3, 1), ca.SX.sym("r", 3, 1), ca.SX.sym("p", 3)
    density = ca.Function("frozen_weight", [x, r, p], [-ca.dot(p, x)])
    weight = 0.2 * mesh.vertex_areas[:, None] * np.array([0.0, 0.0, -9.81])
    return Energy("gravity", density, np.arange(4)[:, None], weight, load=True)


def test_two_triangles_with_natural_masses_are_recovered() -> None:
    target = _hanging()
    result = solve(Problem(target, replace(SOFT, mesh=target).terms(), pinned=[0, 1, 2])).require()
    assert np.abs(result.rest - FLAT.vertices).max() <= 1e-8 * FLAT.mean_edge_length


def test_two_triangles_with_frozen_masses_are_not_recovered() -> None:
    """Masses of the stretched pose are too large: the shape found is bent upwards.

    Regression: the free vertex comes out 7.7e-4 edges away from the flat original, all of it up.
    """
    target = _hanging()
    terms = (*replace(SOFT, mesh=target).terms()[:2], _frozen_weight(target))
    result = solve(Problem(target, terms, pinned=[0, 1, 2])).require()
    off = (result.rest[3] - FLAT.vertices[3]) / FLAT.mean_edge_length
    assert np.linalg.norm(off) == pytest.approx(7.7e-4, rel=0.05)
    assert off[2] > 0.99 * np.linalg.norm(off)
    assert target.face_areas[1] > FLAT.face_areas[1]


def _clamped(n: int = 4, bend: float = 1e-2) -> Piece:
    """A flat square clamped along two rows of vertices at one side."""
    flat = grid(n, n, 0.05, 0.05)
    pins = np.arange(2 * (n + 1))
    (piece,) = split(Problem(flat, PlainShell(flat, bend=bend).terms(), pinned=pins))
    return piece


def test_newton_converges_quadratically() -> None:
    """Residuals at full load: e_next <= e^2 (in units of f0) until rounding, and strictly falling."""
    steps: list[Step] = []
    piece = _clamped()
    path = LoadPath(piece, steps.append)
    point = path.follow(np.zeros_like(piece.target))
    assert point.load == 1.0
    assert point.residual <= TIGHT
    at_full = [step.residual for step in steps if step.load == 1.0]
    small = [e for e in at_full if e < 0.3]
    assert len(small) >= 3
    for before, after in pairwise(small):
        assert after <= max(before**2, TIGHT)
    assert path.iterations == len(steps)
    assert path.factorizations <= path.iterations


def test_equilibrium_is_one() -> None:
    """dE/dx vanishes at free vertices, pins do not move, and without load nothing changes."""
    piece = _clamped()
    point = LoadPath(piece, lambda step: None).follow(np.zeros_like(piece.target))
    force = piece.assembly.gradient(piece.target, point.rest)
    free = np.setdiff1d(np.arange(25), piece.pinned)
    assert np.abs(force[free]).max() <= 1e-9 * piece.f0  # the aim of the project
    assert np.array_equal(point.rest[piece.pinned], piece.target[piece.pinned])
    assert point.rest[free, 2].max() > 0.0  # the natural shape rises against the weight
    assert point.rest[free, 2].min() >= 0.0


@pytest.mark.parametrize("load", [0.25, 0.5])
def test_points_on_the_way_balance_their_share(load: float) -> None:
    piece = _clamped()
    path = LoadPath(piece, lambda step: None)
    nothing = np.zeros_like(piece.target)
    point = path.newton(piece.target, np.zeros(path.border.shape[1]), nothing, load, TIGHT)
    assert point is not None
    force = piece.assembly.gradient(piece.target, point.rest, load)
    free = np.setdiff1d(np.arange(25), piece.pinned)
    assert np.abs(force[free]).max() <= 1e-9 * piece.f0  # the aim of the project


def test_path_of_a_soft_sheet_ends_early_and_says_where() -> None:
    """Without enough bending stiffness the path stops below full load, within its budget."""
    piece = _clamped(bend=1e-7)
    path = LoadPath(piece, lambda step: None)
    point = path.follow(np.zeros_like(piece.target))
    assert 0.0 <= point.load < 1.0
    assert np.all(np.isfinite(point.rest))


def test_prescribed_forces_are_met() -> None:
    """Upward dead forces at one vertex of a floating sheet: dE/dx equals them there, after balance."""
    flat = grid(4, 4, 0.05, 0.05)
    floor = Plane((0, 0, 1), 0.0, friction=0.5)
    problem = Problem(flat, PlainShell(flat, bend=1e-2).terms(), (floor,), contact_tolerance=1e-6)
    (piece,) = split(problem)
    forces: FloatArray = -piece.loads.copy()
    forces[12] += [0.0, 0.0, 2.0 * piece.f0]
    for vertex in (0, 4, 20, 24):  # four corners take it back, without a moment
        forces[vertex] -= [0.0, 0.0, 0.5 * piece.f0]
    point = LoadPath(piece, lambda step: None).follow(forces)
    assert point.load == 1.0
    found = piece.assembly.gradient(piece.target, point.rest)
    masses_moved = piece.assembly.nodal_loads(point.rest).sum(axis=0) - piece.loads.sum(axis=0)
    slack = 1e-9 * piece.f0 + np.abs(masses_moved).max()  # what the multipliers had to add
    assert np.abs(found - forces).max() <= slack


def test_longest_step_halves_the_edge_that_changes_most() -> None:
    """By hand: edges of length 1 and 2; the move changes them by 4 and 1, so 0.5 * 1 / 4 is allowed."""
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 2.0, 0.0]])
    move = np.array([[0.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 5.0, 0.0]])
    edges = np.array([[0, 1], [1, 2]])
    assert longest_step(points, move, edges) == pytest.approx(0.125)
    assert longest_step(points, np.ones((3, 3)), edges) == np.inf
