"""Admissible contact forces: balance, cones, nearest, and proofs that there are none."""

from __future__ import annotations

import numpy as np
import pytest
from meshes import cap, grid, joined
from plain_shell import PlainShell

from casashell.contact.cone import margin
from casashell.contact.obstacles import Plane, Sphere
from casashell.inverse.forces import (
    SHRINKS,
    Shrink,
    bilateral_reactions,
    contact_frames,
    is_obstruction,
    project_reactions,
    rigid_obstruction,
)
from casashell.inverse.piece import Piece, split
from casashell.problem import Problem
from casashell.typing import FloatArray

WIDE = Shrink(1.0, 0.0)


def _slope(degrees: float, friction: float, n: int = 3) -> Piece:
    """A sheet all of whose vertices lie on a plane inclined by ``degrees``."""
    angle = np.radians(degrees)
    flat = grid(n, n)
    turn = np.array(
        [[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]]
    )
    sheet = flat.moved(flat.vertices @ turn.T)
    plane = Plane((-np.sin(angle), 0.0, np.cos(angle)), 0.0, friction=friction)
    problem = Problem(sheet, PlainShell(sheet).terms(), (plane,), contact_tolerance=1e-6)
    (piece,) = split(problem)
    assert len(piece.contacts) == len(sheet.vertices)
    return piece


def _hat(friction: float = 0.5) -> Piece:
    """A cap whose inner rings rest on a slightly smaller ball of the same pole."""
    ball = cap(3, 0.2, 1.2)
    head = Sphere((0.0, 0.0, 0.05), 0.15, friction=friction)
    (piece,) = split(Problem(ball, PlainShell(ball).terms(), (head,), contact_tolerance=6e-3))
    assert len(piece.contacts) == 7
    return piece


def _resultant(piece: Piece, forces: FloatArray) -> FloatArray:
    """Sum and moment of contact forces and weight."""
    at = piece.target[piece.contacts.vertices]
    moment = np.cross(at, forces).sum(axis=0) + np.cross(piece.target, piece.loads).sum(axis=0)
    return np.concatenate([forces.sum(axis=0) + piece.loads.sum(axis=0), moment])


def test_bilateral_reactions_carry_the_weight() -> None:
    piece = _hat()
    assert np.abs(_resultant(piece, bilateral_reactions(piece))).max() <= 1e-9 * piece.f0


def test_vertices_that_all_touch_carry_their_own_weight() -> None:
    piece = _slope(20.0, 0.5)
    wanted = bilateral_reactions(piece)
    assert wanted == pytest.approx(-piece.loads, rel=1e-12, abs=1e-15)
    found = project_reactions(piece, wanted, piece.loads, SHRINKS[0])  # admissible: unchanged
    assert found == pytest.approx(wanted, rel=1e-6, abs=1e-6 * piece.f0)


@pytest.mark.parametrize("shrink", SHRINKS)
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_projected_forces_balance_and_stay_inside(shrink: Shrink, friction: float) -> None:
    piece = _hat(friction)
    loads = 1.3 * piece.loads  # other masses than the target's
    found = project_reactions(piece, bilateral_reactions(piece), loads, shrink)
    assert found is not None
    contacts = piece.contacts
    at = piece.target[contacts.vertices]
    force = found.sum(axis=0) + loads.sum(axis=0)
    moment = np.cross(at, found).sum(axis=0) + np.cross(piece.target, loads).sum(axis=0)
    assert np.abs(np.concatenate([force, moment])).max() <= 1e-6 * piece.f0
    normal = (found * contacts.normals).sum(axis=1)
    assert normal.min() >= (shrink.floor - 1e-6) * piece.f0
    inner = margin(found, contacts.normals, shrink.factor * contacts.friction)
    assert inner.min() >= -1e-6 * piece.f0


@pytest.mark.parametrize("shrink", SHRINKS)
def test_contact_that_wants_to_pull_pushes_by_the_floor(shrink: Shrink) -> None:
    piece = _hat()
    wanted = bilateral_reactions(piece)
    wanted[0] = -5.0 * piece.f0 * piece.contacts.normals[0]
    found = project_reactions(piece, wanted, piece.loads, shrink)
    assert found is not None
    pushes = (found * piece.contacts.normals).sum(axis=1) / piece.f0
    assert pushes[0] == pytest.approx(shrink.floor, abs=1e-6)


def test_projection_is_the_nearest_admissible_choice() -> None:
    """No admissible mixture with another admissible choice is nearer to what was wanted."""
    piece = _hat()
    rng = np.random.default_rng(0)
    wanted = bilateral_reactions(piece)
    best = project_reactions(piece, wanted, piece.loads, WIDE)
    assert best is not None
    distance = np.linalg.norm(best - wanted)
    assert distance > 1e-3 * piece.f0  # the bilateral reactions are not admissible themselves
    for _ in range(10):
        other = wanted + piece.f0 * rng.standard_normal(wanted.shape)
        another = project_reactions(piece, other, piece.loads, WIDE)
        assert another is not None
        for t in (0.01, 0.1, 0.5):
            mixed = (1.0 - t) * best + t * another
            assert np.linalg.norm(mixed - wanted) >= distance * (1.0 - 1e-6)


@pytest.mark.parametrize("degrees", [10.0, 42.0])
def test_slope_holds_exactly_above_its_tangent(degrees: float) -> None:
    """Closed form: a sheet on a slope needs mu >= tan(angle)."""
    tangent = np.tan(np.radians(degrees))
    held, slips = _slope(degrees, 1.01 * tangent), _slope(degrees, 0.99 * tangent)
    assert project_reactions(held, -held.loads, held.loads, WIDE) is not None
    assert rigid_obstruction(held) is None
    assert project_reactions(slips, -slips.loads, slips.loads, WIDE) is None
    motion = rigid_obstruction(slips)
    assert motion is not None
    assert is_obstruction(slips, motion)


def test_obstruction_by_hand() -> None:
    """The proof itself: a rigid motion along which weight works and no contact force resists."""
    piece = _slope(42.0, 0.5)
    motion = rigid_obstruction(piece)
    assert motion is not None
    arm = piece.target[:, None] - piece.target[None]
    stretched = np.einsum("ijc,ijc->ij", arm, motion[:, None] - motion[None])
    assert np.abs(stretched).max() <= 1e-12  # it is rigid
    assert np.all(motion[:, 2] < 0.0)  # every vertex falls, whatever its mass
    rng = np.random.default_rng(1)
    normals = piece.contacts.normals
    for _ in range(200):  # random forces on the boundary of the cones and inside
        f_n = rng.exponential(size=len(normals))
        across = np.cross(normals, rng.standard_normal(normals.shape))
        across /= np.linalg.norm(across, axis=1)[:, None]
        forces = f_n[:, None] * (normals + 0.5 * rng.choice([0.3, 1.0]) * across)
        assert (forces * motion[piece.contacts.vertices]).sum() >= 0.0


def test_is_obstruction_refuses_what_proves_nothing() -> None:
    piece = _slope(42.0, 0.5)
    motion = rigid_obstruction(piece)
    assert motion is not None
    assert not is_obstruction(piece, -motion)
    assert not is_obstruction(piece, np.zeros_like(motion))
    rougher = piece.touching(_slope(42.0, 1.0).contacts)
    assert not is_obstruction(rougher, motion)
    rises = motion.copy()
    rises[0, 2] = 1.0
    assert not is_obstruction(piece, rises)


def test_ball_under_a_sheet_cannot_pull() -> None:
    """A plane above a sheet can only push it down: proved without any friction that helps."""
    flat = grid(2, 2)
    ceiling = Plane((0, 0, -1), 0.0, friction=0.5)
    (piece,) = split(Problem(flat, PlainShell(flat).terms(), (ceiling,), contact_tolerance=1e-6))
    assert project_reactions(piece, -piece.loads, piece.loads, WIDE) is None
    assert rigid_obstruction(piece) is not None


def test_pins_on_a_line_with_all_weight_to_one_side_are_a_proof() -> None:
    """A flat sheet held along one side turns down about it; held along its middle it might not."""
    flat = grid(4, 2)  # vertex 3 i + j at x = 0.1 i
    terms = PlainShell(flat).terms()
    for pinned in ([0, 1, 2], [0, 2]):  # vertex 1 lies on the axis of the two pins
        (piece,) = split(Problem(flat, terms, pinned=pinned))
        motion = rigid_obstruction(piece)
        assert motion is not None
        assert np.all(motion[3:, 2] < 0.0)
        assert not motion[:3].any()
    (piece,) = split(Problem(flat, terms, pinned=[6, 7, 8]))
    assert rigid_obstruction(piece) is None


def test_two_walls_hold_by_friction() -> None:
    """A sheet clamped between opposite planes: the vertex has two contacts that press each other.

    Both planes touch all nine vertices; upright sheet, so friction alone carries the weight.
    """
    flat = grid(2, 2)
    upright = flat.moved(flat.vertices[:, [2, 0, 1]])
    walls = (Plane((1, 0, 0), 0.0, friction=0.3), Plane((-1, 0, 0), 0.0, friction=0.3))
    (piece,) = split(Problem(upright, PlainShell(upright).terms(), walls, contact_tolerance=1e-6))
    assert len(piece.contacts) == 18
    found = project_reactions(piece, bilateral_reactions(piece), piece.loads, SHRINKS[0])
    assert found is not None
    assert piece.spread(found).sum(axis=0) == pytest.approx(-piece.loads.sum(axis=0), abs=1e-8)
    assert margin(found, piece.contacts.normals, piece.contacts.friction).min() > 0.0


def test_frames_span_what_a_contact_can_exert() -> None:
    """Columns n, t1, t2 for a rough contact, n alone for a smooth one; orthonormal."""
    flat = joined(grid(1, 1), grid(1, 1).moved(grid(1, 1).vertices + np.array([0.0, 5.0, 0.0])))
    tilted = Plane((0.0, 0.6, 0.8), 3.0, friction=0.0)
    floor = Plane((0, 0, 1), 0.0, friction=0.5)
    problem = Problem(flat, PlainShell(flat).terms(), (floor, tilted), contact_tolerance=1e-3)
    frames, owner = contact_frames(problem.contacts)
    dense = frames.toarray()
    smooth = int((problem.contacts.friction == 0.0).sum())
    assert smooth > 0
    assert dense.shape == (3 * len(problem.contacts), 3 * len(problem.contacts) - 2 * smooth)
    assert dense.T @ dense == pytest.approx(np.eye(dense.shape[1]), abs=1e-12)
    first = np.flatnonzero(np.diff(owner, prepend=-1))
    for contact, column in enumerate(first):
        own = dense[3 * contact : 3 * contact + 3, column]
        assert own == pytest.approx(problem.contacts.normals[contact])
