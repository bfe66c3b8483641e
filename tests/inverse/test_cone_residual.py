"""G_K of Ly 2018: its definition, its zeros and its slopes."""

from __future__ import annotations

import numpy as np
import pytest
from meshes import grid
from plain_shell import PlainShell
from small_scenes import hat_on_ball

from casashell.contact.cone import inside, margin, project, split
from casashell.contact.obstacles import Plane
from casashell.inverse.cone_residual import BETA, ConeResidual, Kind
from casashell.inverse.piece import Piece
from casashell.inverse.piece import split as split_pieces
from casashell.inverse.pulled import Pulled
from casashell.problem import Problem
from casashell.typing import FloatArray

KINDS: tuple[Kind, ...] = ("kinked", "smooth")


def _hat() -> Piece:
    (piece,) = split_pieces(hat_on_ball(pinned=(40,)))
    assert len(piece.contacts) > 5
    return piece


def _corner(friction: tuple[float, float] = (0.5, 0.5)) -> Piece:
    """A flat sheet on a floor z = 0 and against a wall x = 0: vertices 0..2 touch both."""
    flat = grid(2, 2)
    obstacles = (
        Plane((0, 0, 1), 0.0, friction=friction[0]),
        Plane((1, 0, 0), 0.0, friction=friction[1]),
    )
    problem = Problem(flat, PlainShell(flat).terms(), obstacles, contact_tolerance=1e-6)
    (piece,) = split_pieces(problem)
    assert len(piece.contacts) == 12
    return piece


def _random_forces(piece: Piece, seed: int) -> FloatArray:
    rng = np.random.default_rng(seed)
    return piece.f0 * 3.0 * rng.standard_normal(piece.target.shape)


@pytest.mark.parametrize("kind", KINDS)
def test_components_follow_the_definition(kind: Kind) -> None:
    """Loops over vertices and contacts, as Sec. 6 writes them, in units of f0."""
    piece = _hat()
    forces = _random_forces(piece, 0)
    expected = [
        forces[i, axis] / piece.f0
        for i in range(len(forces))
        if i not in piece.contacts.vertices and i not in piece.pinned
        for axis in range(3)
    ]
    for vertex, n, mu in zip(
        piece.contacts.vertices, piece.contacts.normals, piece.contacts.friction, strict=True
    ):
        u = forces[vertex] / piece.f0
        normal = u @ n
        slip = np.linalg.norm(u - normal * n)
        if kind == "kinked":
            h = max(-normal, 0.0) + max(slip - BETA * mu * normal, 0.0)
        else:
            h = min(normal, 0.0) ** 2 + min((BETA * mu * normal) ** 2 - slip**2, 0.0) ** 2
        expected.append(h)
    found = ConeResidual(piece, kind).components(forces)
    assert found == pytest.approx(np.array(expected), rel=1e-12, abs=1e-12)
    value, _ = ConeResidual(piece, kind).value(forces)
    assert value == pytest.approx(0.5 * float(found @ found), rel=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_zero_exactly_in_the_cones(kind: Kind) -> None:
    """Against the projection: zero for projected forces, and only where projecting moves nothing."""
    piece = _hat()
    cones = ConeResidual(piece, kind)
    contacts = piece.contacts
    outside = 0
    for seed in range(20):
        forces = np.zeros_like(piece.target)
        wanted = _random_forces(piece, seed)[contacts.vertices]
        nearest = project(wanted, contacts.normals, 0.999 * BETA * contacts.friction)
        forces[contacts.vertices] = nearest
        assert cones.value(forces)[0] <= 1e-30
        forces[contacts.vertices] = wanted
        h = cones.components(forces)[-len(contacts) :]
        admissible = inside(wanted, contacts.normals, BETA * contacts.friction)
        assert np.array_equal(h == 0.0, admissible)
        outside += int((~admissible).sum())
    assert 0 < outside < 20 * len(contacts)


def test_pins_take_any_force_and_free_vertices_none() -> None:
    piece = _hat()
    forces = np.zeros_like(piece.target)
    forces[40] = [5.0, -3.0, 2.0]
    assert ConeResidual(piece).value(forces)[0] == 0.0
    forces[41] = [0.0, 0.0, 1e-3 * piece.f0]
    assert ConeResidual(piece).value(forces)[0] == pytest.approx(0.5e-6)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("make", [_hat, _corner])
def test_slope_by_forces_away_from_kinks(kind: Kind, make: type) -> None:
    """Central differences; random forces are away from the kinks, steps are 1e-6 f0."""
    piece = make()
    cones = ConeResidual(piece, kind)
    forces = _random_forces(piece, 3)
    rng = np.random.default_rng(4)
    _, slope = cones.value(forces)
    for _ in range(10):
        way = rng.standard_normal(forces.shape) * piece.f0
        ahead, behind = (cones.value(forces + e * way)[0] for e in (1e-6, -1e-6))
        assert np.vdot(slope, way) == pytest.approx((ahead - behind) / 2e-6, rel=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_slope_by_natural_shape(kind: Kind) -> None:
    piece = _hat()
    cones, energy = ConeResidual(piece, kind), Pulled(piece, 3.0)
    rng = np.random.default_rng(5)
    pose = piece.target + 1e-3 * piece.h * rng.standard_normal(piece.target.shape)
    rest = piece.target + 1e-3 * piece.h * rng.standard_normal(piece.target.shape)
    _, slope = cones.at(energy, pose, rest)
    assert np.array_equal(slope[40], np.zeros(3))
    way = piece.h * rng.standard_normal(rest.shape)
    way[40] = 0.0
    ahead, behind = (cones.at(energy, pose, rest + e * way)[0] for e in (1e-7, -1e-7))
    assert np.vdot(slope, way) == pytest.approx((ahead - behind) / 2e-7, rel=1e-5)


def test_vertices_with_two_contacts_use_the_sum_of_cones() -> None:
    """Floor and wall without friction: the sum of the rays is the quarter plane x, z >= 0."""
    piece = _corner((0.0, 0.0))
    cones = ConeResidual(piece)
    forces = np.zeros_like(piece.target)
    forces[0] = [2.0 * piece.f0, 0.0, 3.0 * piece.f0]
    assert cones.value(forces)[0] <= 1e-28
    forces[0] = [2.0 * piece.f0, 0.5 * piece.f0, -1.0 * piece.f0]
    assert cones.value(forces)[0] == pytest.approx(0.5 * (0.25 + 1.0), rel=1e-12)


def test_contact_forces_of_a_corner_are_admissible_and_add_up() -> None:
    piece = _corner()
    cones = ConeResidual(piece)
    forces = np.zeros_like(piece.target)
    forces[:] = [0.0, 0.0, piece.f0]
    forces[:3] = [0.4 * piece.f0, 0.1 * piece.f0, piece.f0]
    found = cones.contact_forces(forces)
    assert np.abs(piece.spread(found) - forces).max() <= 1e-12 * piece.f0
    assert margin(found, piece.contacts.normals, piece.contacts.friction).min() >= 0.0
    assert split(found, piece.contacts.normals)[0].min() >= 0.0


def test_bad_arguments_are_refused() -> None:
    with pytest.raises(ValueError, match="kind must be one of kinked, smooth"):
        ConeResidual(_corner(), "rough")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="beta"):
        ConeResidual(_corner(), beta=0.0)
