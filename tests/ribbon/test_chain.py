"""The map from slopes and angles to a strip, its adjoint, and the two other gradients."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from casashell.ribbon.chain import pull_back, reconstruct, running_products
from casashell.ribbon.gradients import by_chain_rule, by_two_passes
from casashell.ribbon.ribbon import Ribbon, RibbonState
from casashell.typing import FloatArray
from formulations import ruling_bending

LENGTH, WIDTH = 1.3, 0.2


def random_state(ribbon: Ribbon, seed: int = 0, bend: float = 0.3) -> RibbonState:
    """A state with rulings in every direction; placed anywhere."""
    random = np.random.default_rng(seed)
    n = ribbon.segments
    turns = 0.3 * ribbon.most_turn * random.uniform(-1, 1, n)
    slopes = np.cumsum(turns - turns.mean())[:-1]
    return RibbonState(
        slopes,
        bend * random.uniform(-1, 1, n - 1),
        Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix(),
        np.array([1.0, 2.0, 3.0]),
        start_angle=0.2 if ribbon.clamp_crease else 0.0,
    )


def symbolic(ribbon: Ribbon, state: RibbonState) -> tuple[FloatArray, ...]:
    """Bottom, top and normals by the formulation."""
    angles = state.angles
    if ribbon.clamp_crease:
        angles = np.concatenate([[state.start_angle], angles])
    w = Rotation.from_matrix(state.frame).as_rotvec()
    made = ruling_bending(ribbon.segments, ribbon.clamp_crease)(
        state.slopes, angles, w, state.origin, ribbon.length, ribbon.width
    )
    return tuple(np.array(part).T for part in made)


@pytest.mark.parametrize("clamp_crease", [False, True])
def test_numbers_and_symbols_agree(clamp_crease: bool) -> None:
    ribbon = Ribbon(LENGTH, WIDTH, 30, clamp_crease=clamp_crease)
    state = random_state(ribbon)
    strip = reconstruct(ribbon, state)
    for found, wanted in zip((strip.bottom, strip.top, strip.normals), symbolic(ribbon, state)):
        np.testing.assert_allclose(found, wanted, rtol=0, atol=5e-15)


def test_positive_angles_turn_a_flat_strip_down() -> None:
    strip = reconstruct(Ribbon(2.0, 0.1, 2), RibbonState(np.zeros(1), np.array([0.5])))
    np.testing.assert_allclose(strip.middle[2], [1 + np.cos(0.5), 0, -np.sin(0.5)], atol=1e-15)


@pytest.mark.parametrize("segments", [20, 1000])
def test_the_map_is_an_isometry_onto_planar_quads(segments: int) -> None:
    ribbon = Ribbon(10.0, 0.1, segments)
    state = random_state(ribbon, bend=1.0)
    strip = reconstruct(ribbon, state)
    half = 0.5 * ribbon.width
    s = np.arange(segments + 1) * ribbon.segment
    flat = {
        -1: np.stack([s - half * state.all_slopes, np.full_like(s, -half)], axis=1),
        1: np.stack([s + half * state.all_slopes, np.full_like(s, half)], axis=1),
    }
    bent = {-1: strip.bottom, 1: strip.top}
    pairs = [(i, j, shift) for i in (-1, 1) for j in (-1, 1) for shift in (0, 1)]
    for first, second, shift in pairs:
        end = segments + 1 - shift
        wanted = np.linalg.norm(flat[second][shift:] - flat[first][:end], axis=1)
        found = np.linalg.norm(bent[second][shift:] - bent[first][:end], axis=1)
        assert np.abs(found - wanted).max() < 1e-14
    edges = [strip.bottom[1:], strip.top[:-1], strip.top[1:]]
    volume = np.linalg.det(np.stack([e - strip.bottom[:-1] for e in edges], axis=1))
    assert np.abs(volume).max() < 1e-15


def test_a_constant_field_lies_on_a_cylinder() -> None:
    """Constant (c, beta): radius l / (beta sqrt(1 + c^2)), from the formulas of the map."""
    ribbon, c, radius = Ribbon(0.5, 0.02, 50), 0.5, 0.1
    beta = ribbon.segment / (radius * np.sqrt(1 + c * c))
    strip = reconstruct(ribbon, RibbonState(np.full(49, c), np.full(49, beta)))
    axis = np.array([c, 1.0, 0.0]) / np.sqrt(1 + c * c)
    across = np.cross(axis, [0.0, 0.0, 1.0])
    points = np.concatenate([strip.bottom[1:-1], strip.top[1:-1]])
    flat = np.stack([points @ across, points[:, 2]], axis=1)
    system = np.column_stack([2 * flat, np.ones(len(flat))])
    centre = np.linalg.lstsq(system, (flat**2).sum(axis=1))[0]
    distances = np.linalg.norm(flat - centre[:2], axis=1)
    assert np.ptp(distances) < 1e-13
    # Rulings are tangent to a cylinder of radius R at mid-quad, so they lie on R / cos(turn / 2).
    assert distances.mean() == pytest.approx(radius, rel=2e-3)


@pytest.mark.parametrize("clamp_crease", [False, True])
def test_the_adjoint_is_the_derivative(clamp_crease: bool) -> None:
    """Against automatic differentiation of the formulation; then differences, then the other ways."""
    n = 40
    ribbon = Ribbon(LENGTH, WIDTH, n, clamp_crease=clamp_crease)
    state = random_state(ribbon)
    strip = reconstruct(ribbon, state)
    force = np.random.default_rng(1).normal(size=(n + 1, 4, 3))
    force[:, 0] = 0.0
    force[-1, 3] = 0.0
    found = pull_back(strip, force.reshape(-1, 3))
    c, beta = ca.SX.sym("c", n - 1), ca.SX.sym("beta", n - 1 + clamp_crease)
    w, t = Rotation.from_matrix(state.frame).as_rotvec(), ca.SX.sym("t", 3)
    bottom, top, normals = ruling_bending(n, clamp_crease)(c, beta, w, t, LENGTH, WIDTH)
    work = ca.dot(bottom, force[:, 1].T) + ca.dot(top, force[:, 2].T)
    work += ca.dot(normals, force[:-1, 3].T)
    slopes = ca.Function("g", [c, beta, t], [ca.gradient(work, v) for v in (c, beta, t)])
    first = 0 if clamp_crease else 1
    wanted = slopes(state.slopes, state.all_angles[first:-1], state.origin)
    size = np.abs(found.creases).max()
    np.testing.assert_allclose(
        found.creases[1:-1, 0], np.array(wanted[0]).ravel(), atol=4e-15 * size
    )
    np.testing.assert_allclose(
        found.creases[first:-1, 1], np.array(wanted[1]).ravel(), rtol=0, atol=4e-15 * size
    )
    np.testing.assert_allclose(found.force, np.array(wanted[2]).ravel(), atol=1e-13)
    for other in (
        by_chain_rule(strip, force.reshape(-1, 3)),
        by_two_passes(LENGTH, strip, force.reshape(-1, 3)),
    ):
        np.testing.assert_allclose(other, found.creases, rtol=0, atol=4e-14 * size)

    def energy(step: float) -> float:
        moved = RibbonState(
            state.slopes + step,
            state.angles + 2 * step,
            state.frame,
            state.origin,
            state.start_angle,
        )
        table = reconstruct(ribbon, moved).table
        return float(np.sum(table * force.reshape(-1, 3)))

    along = found.creases[1:-1] @ [1.0, 2.0]
    measured = (energy(1e-6) - energy(-1e-6)) / 2e-6
    assert along.sum() == pytest.approx(measured, rel=1e-7)


def test_running_products_are_products_in_order() -> None:
    factors = Rotation.random(37, random_state=3).as_matrix()
    first = Rotation.random(random_state=4).as_matrix()
    found = running_products(first, factors)
    product = first
    for i, factor in enumerate(factors):
        np.testing.assert_allclose(found[i], product, atol=1e-14)
        product = product @ factor
    np.testing.assert_allclose(found[-1], product, atol=1e-14)
