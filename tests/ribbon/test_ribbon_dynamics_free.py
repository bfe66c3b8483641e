"""Ribbons in free flight: what implicit Euler does to rigid motion has closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from casashell.ribbon.dynamics import simulate
from casashell.ribbon.record import RibbonSimulation, RunStatus
from casashell.ribbon.ribbon import Ribbon, RibbonState
from casashell.ribbon.scene import Body, Scene, centre_of_mass, vertex_masses
from casashell.typing import FloatArray
from formulations.ribbon import ribbon_physics

PHYSICS = ribbon_physics()
SOLVERS = ["ipopt", "augmented"]


def bent(ribbon: Ribbon, curl: float = 0.1, slope: float = 0.0) -> RibbonState:
    n = ribbon.segments
    i = np.arange(1, n)
    c = np.minimum(slope, np.minimum(i, n - i) * 0.8 * ribbon.most_turn)
    return RibbonState(c, np.full(n - 1, curl))


def momentum(sim: RibbonSimulation, h: float) -> FloatArray:
    """(F-1,3) sum of the mass of each vertex times its velocity, rulings at rest (c constant)."""
    track = sim.tracks[0]
    points = np.stack([track.bottom, track.top], axis=1)
    mass = vertex_masses(track.ribbon, np.pad(track.slopes[0], 1))
    return np.einsum("ri,fria->fa", mass, np.diff(points, axis=0)) / h


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_free_fall_is_exact(solver: str, mass: str) -> None:
    """A flat strip drops by g h^2 n (n + 1) / 2 in n implicit Euler steps (closed form)."""
    h, steps, g = 0.01, 8, 9.81
    ribbon = Ribbon(0.5, 0.05, 8, stiffness=1e-3, density=0.1, ends="free")
    sim = simulate(
        Scene((Body(ribbon),), PHYSICS, (0.0, 0.0, -g)), h * steps, h, solver=solver, mass=mass
    )
    assert sim.status is RunStatus.COMPLETE
    n = np.arange(steps + 1)
    drop = 0.5 * g * h**2 * n * (n + 1)
    # Within what the tolerance of the gradient leaves.
    middle = sim.tracks[0].middle
    fall = middle - middle[:1] + drop[:, None, None] * np.array([0.0, 0.0, 1.0])
    assert np.abs(fall).max() < (1e-5 if solver == "augmented" else 1e-8)


@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_momentum_is_kept(mass: str) -> None:
    """No external force: linear momentum stays what it was while the strip unbends and turns.

    Rulings that stay where they are: resampling would add its own error.
    """
    h = 0.01
    ribbon = Ribbon(0.5, 0.05, 12, stiffness=1e-3, density=0.1, ends="free")
    body = Body(ribbon, bent(ribbon, 0.05), velocity=(0.3, -0.2, 0.1), spin=(0.0, 1.0, 0.0))
    sim = simulate(Scene((body,), PHYSICS, (0, 0, 0)), 20 * h, h, tolerance=1e-9, mass=mass)
    assert sim.status is RunStatus.COMPLETE
    assert np.abs(sim.tracks[0].angles[-1]).max() < 0.02  # it has unbent
    total = ribbon.density * ribbon.width * ribbon.length
    velocity = momentum(sim, h) / total
    assert np.abs(velocity - np.array([0.3, -0.2, 0.1])).max() < 1e-7


def test_a_fast_spin_keeps_the_frame_a_rotation() -> None:
    """1.2 rad a step, many turns: the base frame follows, the strip stays isometric."""
    h = 0.01
    ribbon = Ribbon(0.5, 0.05, 6, stiffness=1.0, density=0.1, ends="free")
    body = Body(ribbon, spin=(0.0, 0.0, 60.0))
    sim = simulate(Scene((body,), PHYSICS, (0, 0, 0)), 30 * h, h, tolerance=1e-9)
    assert sim.status is RunStatus.COMPLETE
    edges = np.linalg.norm(np.diff(sim.tracks[0].middle, axis=1), axis=2)
    np.testing.assert_allclose(edges, ribbon.segment, rtol=1e-9)
    centres = [
        centre_of_mass(ribbon, np.stack([b, t]), np.zeros(7))
        for b, t in zip(sim.tracks[0].bottom, sim.tracks[0].top)
    ]
    assert np.abs(np.array(centres) - centres[0]).max() < 1e-7


def test_the_solvers_agree() -> None:
    """Same steps, same minima: the tips agree to 1e-4 of the length."""
    h = 0.01
    ribbon = Ribbon(0.5, 0.03, 8, stiffness=2.7e-3, density=0.08)
    tips = []
    for solver in SOLVERS:
        sim = simulate(
            Scene((Body(ribbon, bent(ribbon, 0.1, 0.3)),), PHYSICS),
            3 * h,
            h,
            solver=solver,
            resample="hermite",
            tolerance=1e-6 if solver == "augmented" else None,
        )
        assert sim.status is RunStatus.COMPLETE, sim.message
        tips.append(sim.tracks[0].middle[-1, -1])
    np.testing.assert_allclose(tips[1], tips[0], atol=1e-4 * 0.5)
