"""Shells at rest on frictionless obstacles: closed forms and the conditions of an optimum."""

from __future__ import annotations

import time

import numpy as np
import pytest
from meshes import grid
from plain_shell import PlainShell

from casashell.app.builtin import _round, _tube
from casashell.contact.obstacles import Capsule, Cone, Obstacle, Plane, Sphere
from casashell.engine.assembly import Assembly
from casashell.inverse.nonpenetration import Resting, settle
from casashell.mesh import TriMesh
from casashell.typing import FloatArray, IntArray
from formulations import discrete_shell

NONE = np.empty(0, dtype=np.int64)


def assert_optimal(
    found: Resting,
    assembly: Assembly,
    rest: FloatArray,
    obstacle: Obstacle,
    pinned: IntArray = NONE,
) -> None:
    """First-order conditions from the pose alone, to 1e-8 of a nodal weight."""
    f0 = float(np.linalg.norm(assembly.nodal_loads(rest), axis=1).mean())
    h = float(np.linalg.norm(rest[1] - rest[0]))
    gap, normal = obstacle.signed_distance(found.pose)
    force = assembly.gradient(found.pose, rest)
    loose = np.setdiff1d(np.arange(len(rest)), pinned)
    assert found.converged
    assert found.stable
    assert gap[loose].min() >= -1e-15
    push = (force * normal).sum(axis=1)
    away = loose[gap[loose] > 1e-12 * h]
    on = np.setdiff1d(loose, away)
    assert np.abs(force[away]).max(initial=0.0) <= 1e-8 * f0
    assert np.abs((force - push[:, None] * normal)[on]).max(initial=0.0) <= 1e-8 * f0
    assert push[on].min(initial=0.0) >= -1e-8 * f0
    assert (found.normal_forces * gap)[loose].max() <= 1e-8 * f0 * h
    np.testing.assert_allclose(found.normal_forces[on], push[on], atol=1e-8 * f0)
    assert found.energy == pytest.approx(assembly.energy(found.pose, rest), rel=1e-12)


def _sheet(steps: int = 6, bend: float = 1e-3) -> tuple[FloatArray, Assembly]:
    mesh = grid(steps, steps)
    return mesh.vertices, Assembly(PlainShell(mesh, bend=bend).terms(), len(mesh.vertices))


def _skirt(
    rows: int = 10, around: int = 20, width: float = 0.5
) -> tuple[FloatArray, FloatArray, Assembly, Cone]:
    """Flat annulus of inner radius 0.2 m, a start with waves of 1 mm, and its cone."""
    row, column, faces = _tube(rows, around)
    angle = 2.0 * np.pi * (column + 0.5 * row) / around
    out = 0.2 + width * row / (rows - 1)
    flat = _round(out, angle, 0.0 * row)
    waved = _round(out, angle, 1e-3 * np.cos(5.0 * angle) * row / (rows - 1))
    cone = Cone((0.0, 0.2 / np.tan(0.35), 0.0), (0.0, -1.0, 0.0), 0.35)
    energies = discrete_shell(
        TriMesh(flat, faces), density=0.1, stretch=3.0, bend=5e-3, gravity=(0.0, -9.81, 0.0)
    )
    return flat, waved, Assembly(energies, len(flat)), cone


def test_dropped_sheet_lies_and_every_vertex_carries_its_weight() -> None:
    rest, assembly = _sheet()
    floor = Plane((0, 0, 1), 0.0)
    tilted = rest + [[0.0, 0.0, 0.05]] + 0.3 * rest[:, :1] * [[0.0, 0.0, 1.0]]
    found = settle(assembly, rest, floor, start=tilted)
    assert_optimal(found, assembly, rest, floor)
    assert found.energy < assembly.energy(tilted, rest)
    weight = -assembly.nodal_loads(rest)[:, 2]
    np.testing.assert_allclose(found.normal_forces, weight, rtol=1e-6)
    assert np.abs(found.gaps).max() == 0.0


def test_sheet_on_a_slope_presses_with_the_cosine() -> None:
    """A flat sheet held at its upper edge: the plane feels w cos(slope) of every vertex."""
    rest, assembly = _sheet()
    slope = 0.5
    down = np.array([np.cos(slope), 0.0, -np.sin(slope)])
    plane = Plane((np.sin(slope), 0.0, np.cos(slope)), 0.0)
    lying = rest[:, :1] * down + rest[:, 1:2] * [[0.0, 1.0, 0.0]]
    upper = np.flatnonzero(rest[:, 0] == rest[:, 0].min())
    found = settle(assembly, rest, plane, start=lying, pinned=upper)
    assert_optimal(found, assembly, rest, plane, upper)
    weight = -assembly.nodal_loads(rest)[:, 2] * np.cos(slope)
    weight[upper] = 0.0
    np.testing.assert_allclose(found.normal_forces, weight, atol=1e-9 * weight.max())
    np.testing.assert_array_equal(found.pose[upper], lying[upper])


@pytest.mark.parametrize("bend", [1e-5, 1e-2], ids=["limp", "stiff"])
def test_sheet_over_a_ball(bend: float) -> None:
    """Pinned on the pole.  The limp sheet wraps the ball, the stiff one touches near the pole."""
    rest, assembly = _sheet(8, bend)
    rest = rest - rest.mean(axis=0)
    ball = Sphere((0.0, 0.0, -0.3), 0.3)
    pole = np.array([int(np.argmin(np.linalg.norm(rest, axis=1)))])
    found = settle(assembly, rest, ball, pinned=pole)
    assert_optimal(found, assembly, rest, ball, pole)
    assert found.energy < assembly.energy(rest, rest)
    touching = int((found.normal_forces > 0.0).sum())
    assert touching > 20 if bend < 1e-3 else touching < 20


def test_skirt_hangs_on_its_cone() -> None:
    flat, waved, assembly, cone = _skirt()
    begin = time.perf_counter()
    found = settle(assembly, flat, cone, start=waved)
    assert time.perf_counter() - begin < 3.0
    assert_optimal(found, assembly, flat, cone)
    assert found.energy < assembly.energy(waved, flat)
    # global balance: the cone carries the weight, 0.1 kg/m2 on a polygonal annulus
    area = 10.0 * np.sin(0.1 * np.pi) * (0.7**2 - 0.2**2)
    lift = found.normal_forces.sum() * np.sin(0.35)
    assert lift == pytest.approx(0.1 * 9.81 * area, rel=1e-2)
    assert (found.normal_forces > 0.0).sum() == 20  # the waist line, nothing else


def test_start_inside_the_obstacle_is_put_outside() -> None:
    flat, waved, assembly, cone = _skirt(5, 12)
    sunk = waved - np.array([0.0, 0.05, 0.0])
    assert cone.signed_distance(sunk)[0].min() < 0.0
    found = settle(assembly, flat, cone, start=sunk)
    assert_optimal(found, assembly, flat, cone)
    again = settle(assembly, flat, cone, start=waved)
    assert found.energy == pytest.approx(again.energy, rel=1e-9)


def test_saddle_is_left() -> None:
    """A limp strip that stands exactly upright is in balance, but not at a minimum."""
    mesh = grid(1, 8)
    strip = mesh.moved(mesh.vertices[:, [0, 2, 1]])
    assembly = Assembly(PlainShell(strip, bend=1e-3).terms(), len(strip.vertices))
    foot = np.flatnonzero(strip.vertices[:, 2] < 0.15)
    wall = Capsule((0.0, 1.0, 0.0), (0.1, 1.0, 0.0), 0.3)
    upright = settle(assembly, strip.vertices, wall, pinned=foot, max_iterations=6)
    found = settle(assembly, strip.vertices, wall, pinned=foot)
    assert_optimal(found, assembly, strip.vertices, wall, foot)
    assert found.energy < upright.energy
    assert found.pose[:, 2].min() < -0.3  # it hangs from its foot, 0.7 m long


def test_same_bits_every_time() -> None:
    flat, waved, assembly, cone = _skirt(5, 12)
    one, two = (settle(assembly, flat, cone, start=waved) for _ in range(2))
    np.testing.assert_array_equal(one.pose, two.pose)


def test_few_iterations_are_reported_as_such() -> None:
    flat, waved, assembly, cone = _skirt(5, 12)
    found = settle(assembly, flat, cone, start=waved, max_iterations=1)
    assert not found.converged
    assert found.iterations == 1
    assert found.residual > 1e-9


def test_wrong_input_is_named() -> None:
    rest, assembly = _sheet(2)
    floor = Plane((0, 0, 1), 0.0)
    with pytest.raises(ValueError, match="pinned vertex 9 "):
        settle(assembly, rest, floor, pinned=[9])
    with pytest.raises(ValueError, match="start must be finite"):
        settle(assembly, rest, floor, start=rest[:-1])
    with pytest.raises(ValueError, match="rest must be finite"):
        settle(assembly, rest * np.nan, floor)
