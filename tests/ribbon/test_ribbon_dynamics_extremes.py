"""Far beyond ordinary scenes: finite, isometric and uncrossed, or a clear refusal."""

from __future__ import annotations

import numpy as np
import pytest

from casashell.ribbon.dynamics import simulate
from casashell.ribbon.record import RibbonSimulation, RunStatus
from casashell.ribbon.ribbon import Ribbon, RibbonState
from casashell.ribbon.scene import Body, Guide, Scene
from formulations.ribbon import ribbon_physics

PHYSICS = ribbon_physics()


def require_sound(sim: RibbonSimulation) -> None:
    """Every number finite, quads planar rectangles' pieces of the right length, rulings uncrossed."""
    for track in sim.tracks:
        ribbon = track.ribbon
        for array in (track.bottom, track.top, track.slopes, track.angles, sim.energies):
            assert np.all(np.isfinite(array))
        turn = np.diff(np.pad(track.slopes, ((0, 0), (1, 1))), axis=1)
        assert np.abs(turn).max() <= ribbon.most_turn + 1e-6
        middle = np.linalg.norm(np.diff(track.middle, axis=1), axis=2)
        np.testing.assert_allclose(middle, ribbon.segment, rtol=1e-9)
        across = np.linalg.norm(track.top - track.bottom, axis=2)[:, 1:-1]
        np.testing.assert_allclose(across, ribbon.width * np.hypot(1, track.slopes), rtol=1e-9)


@pytest.mark.parametrize("energy", ["sadowsky", "wunderlich"])
@pytest.mark.parametrize(("step", "g"), [(0.1, 9.81), (0.1, 981.0), (0.001, 981.0)])
def test_large_steps_and_a_hundred_g(step: float, g: float, energy: str) -> None:
    """Paper in a gravity across and along its width."""
    ribbon = Ribbon(0.3, 0.03, 10, stiffness=2.7e-4, density=0.08, energy=energy)
    bend = RibbonState(np.zeros(9), np.full(9, 0.1))
    scene = Scene((Body(ribbon, bend),), PHYSICS, (0.0, 0.3 * g, -g))
    sim = simulate(scene, 5 * step, step)
    require_sound(sim)
    assert sim.status is RunStatus.COMPLETE or sim.message


@pytest.mark.slow
def test_twenty_full_twists() -> None:
    """The far end's normal is turned twenty times around, 80 degrees a step."""
    ribbon = Ribbon(10.0, 1.0, 20)
    rate = np.deg2rad(80.0) / 0.1

    def normal(t: float) -> tuple[float, float, float]:
        return (0.0, float(np.sin(rate * t)), float(np.cos(rate * t)))

    guide = Guide((19,), normal, 1e3)
    scene = Scene((Body(ribbon, guides=(guide,)),), PHYSICS, (0.0, 0.0, 0.0))
    sim = simulate(scene, 9.0, 0.1)
    require_sound(sim)
    assert sim.status is RunStatus.COMPLETE or sim.message
