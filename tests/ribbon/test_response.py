"""Velocities after collisions: no rebound, no energy from nowhere, momentum kept."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from casashell.app.ribbon_scenes import builtin_setup
from casashell.ribbon.dynamics import simulate
from casashell.ribbon.record import RibbonSimulation, RunStatus
from casashell.ribbon.ribbon import Ribbon, RibbonState
from casashell.ribbon.rigid_zones import Unresolved
from casashell.ribbon.scene import Body, Scene, vertex_masses
from casashell.ribbon.step import Mass
from casashell.typing import FloatArray
from formulations.ribbon import ribbon_physics

PHYSICS = ribbon_physics()
RIBBON = Ribbon(0.3, 0.03, 6, stiffness=1e-3, density=0.1, ends="free", rest_angles=0.02)
H = 0.01
NONE = (0.0, 0.0, 0.0)


def body(height: float, speed: float, along: float = 0.0) -> Body:
    """Level, slightly bent, its middle near (along, 0, height), moving up with ``speed``."""
    state = RibbonState(np.zeros(5), np.full(5, 0.02), origin=np.array([along, 0.0, height]))
    return Body(RIBBON, state, velocity=(0.0, 0.0, speed))


def momentum(sim: RibbonSimulation, k: int) -> FloatArray:
    """(3,) of all ribbons in the step to frame k; rulings hardly turn here."""
    mass = vertex_masses(RIBBON, np.zeros(7)) / H
    ways = [np.stack([t.bottom[k] - t.bottom[k - 1], t.top[k] - t.top[k - 1]]) for t in sim.tracks]
    return np.asarray(sum(np.einsum("ri,ria->a", mass, way) for way in ways))


@pytest.mark.parametrize("along", [0.0, 0.12])
@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_a_pair_that_collides_gains_no_energy(along: float, mass: Mass) -> None:
    """Central and off centre: beyond what resampling blurs, the energy never rises."""
    scene = Scene((body(0.0, 0.5), body(0.02, -0.5, along)), PHYSICS, NONE, thickness=2e-3)
    sim = simulate(scene, 12 * H, H, mass=mass, workers=1)
    assert sim.status is RunStatus.COMPLETE, sim.message
    total = sim.energies[:, :, :2].sum(axis=(1, 2))
    assert np.all(np.diff(total) < 1e-5 * total[0])
    assert total[-1] < 0.9 * total[0]  # they met
    np.testing.assert_allclose(momentum(sim, -1), 0.0, atol=2e-2 * 9e-4 * 0.5)


def heights(speed: float, change: Callable[[FloatArray, FloatArray], FloatArray]) -> FloatArray:
    """(5,) of the middle; the second of four steps ends where ``change`` of (start, end) says."""
    calls = 0

    def collide(start: Sequence[FloatArray], end: Sequence[FloatArray]) -> Sequence[FloatArray]:
        nonlocal calls
        calls += 1
        return [change(start[0], end[0])] if calls == 3 else end  # the first call is a check

    sim = simulate(Scene((body(0.0, speed),), PHYSICS, NONE, collide=collide), 4 * H, H)
    assert sim.status is RunStatus.COMPLETE, sim.message
    made: FloatArray = sim.tracks[0].middle[:, :, 2].mean(axis=1)
    made -= made[0]
    return made


def test_a_push_is_no_kick() -> None:
    """Moved by 1 mm from rest, the ribbon stays there: its least kinetic energy is zero."""
    moved = heights(0.0, lambda start, end: end + np.array([0.0, 0.0, 1e-3]))
    np.testing.assert_allclose(moved, [0.0, 0.0, 1e-3, 1e-3, 1e-3], atol=1e-8)


@pytest.mark.parametrize(("share", "left"), [(0.5, 0.5), (1.0, 0.0), (3.0, 0.0)])
def test_an_impact_stops_and_does_not_rebound(share: float, left: float) -> None:
    """Held back by ``share`` of the way of a step, it keeps the rest of its speed, never below 0."""
    moved = heights(0.4, lambda start, end: end - share * (end - start))
    np.testing.assert_allclose(np.diff(moved)[2:] / H, 0.4 * left, atol=1e-6)
    np.testing.assert_allclose(np.diff(moved)[1] / H, 0.4 * (1.0 - share), atol=1e-6)


def test_a_response_that_fails_is_tried_in_parts() -> None:
    """No way out of a motion above 3 mm a step: 8 mm are made in quarters."""

    def collide(start: Sequence[FloatArray], end: Sequence[FloatArray]) -> Sequence[FloatArray]:
        if np.abs(end[0] - start[0]).max() > 3e-3:
            raise Unresolved("too far")
        return end

    sim = simulate(Scene((body(0.0, 0.8),), PHYSICS, NONE, collide=collide), 2 * H, H)
    assert sim.status is RunStatus.COMPLETE, sim.message
    np.testing.assert_array_equal(sim.parts[1:], 4.0)
    rise = np.diff(sim.tracks[0].middle[:, :, 2].mean(axis=1))
    np.testing.assert_allclose(rise, 0.8 * H, atol=1e-6)


def test_two_chains_of_loops_with_twice_their_step() -> None:
    """Past 0.12 s, where links first pull on each other, every step whole and nothing gained."""
    scene = builtin_setup("double-chain").scene
    sim = simulate(scene, 0.14, 0.02)
    assert sim.status is RunStatus.COMPLETE, sim.message
    assert sim.parts.max() == 1
    total = sim.energies.sum(axis=(1, 2))
    assert np.all(np.diff(total) < 0.0)
