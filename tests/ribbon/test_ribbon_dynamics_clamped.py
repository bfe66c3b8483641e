"""Clamped and spinning ribbons against closed forms of beams."""

from __future__ import annotations

import numpy as np
import pytest

from casashell.ribbon.dynamics import simulate
from casashell.ribbon.record import RunStatus
from casashell.ribbon.ribbon import Ribbon, RibbonState
from casashell.ribbon.scene import Body, Scene
from casashell.ribbon.statics import Setting, equilibrium
from formulations.ribbon import ribbon_physics

PHYSICS = ribbon_physics()
STILL = (0.0, 0.0, 0.0)


@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_a_hanging_ribbon_settles_in_its_equilibrium(mass: str) -> None:
    """Large implicit Euler steps damp the motion; what is left is the static problem's minimum."""
    ribbon = Ribbon(0.3, 0.03, 8, stiffness=1e-3, density=0.1)
    sim = simulate(Scene((Body(ribbon),), PHYSICS), 12.0, 0.5, mass=mass)
    assert sim.status is RunStatus.COMPLETE
    rest = equilibrium(ribbon, PHYSICS, Setting(gravity=(0.0, 0.0, -9.81))).require().strip()
    np.testing.assert_allclose(sim.tracks[0].middle[-1], rest.middle, atol=1e-6 * ribbon.length)
    assert sim.energies[-1, 0, 0] < 1e-12


def test_the_first_frequency_of_a_cantilever() -> None:
    """omega = 1.875104^2 sqrt(D/rho)/L^2 (Euler-Bernoulli); 0.2 % at N = 16 with the clamp crease.

    A mode of a linear system obeys (1 + omega^2 h^2) x'' = 2 x' - x exactly under implicit Euler, so
    omega follows from the tip without measuring periods; higher modes have decayed before.
    """
    n = 16
    ribbon = Ribbon(1.0, 0.1, n, stiffness=1.0, density=1.0, clamp_crease=True)
    omega = 1.875104**2
    h = 2 * np.pi / omega / 100
    bend = 1e-4 * (1.0 - np.arange(n) / n) ** 2
    start = RibbonState(np.zeros(n - 1), bend[1:], start_angle=0.5 * bend[0])
    sim = simulate(Scene((Body(ribbon, start),), PHYSICS, STILL), 60 * h, h, tolerance=1e-12)
    tip = sim.tracks[0].middle[20:, -1, 2]
    rate = (2 * tip[1:-1] - tip[:-2]) @ tip[2:] / (tip[2:] @ tip[2:]) - 1.0
    assert np.sqrt(rate) / h / omega == pytest.approx(1.0, abs=2e-3)


def _spun(ratio: float, mass: str, bend: float) -> tuple[float, float]:
    """Growth of the bending and drift of the centreline, of a strip that spins about its centreline."""
    n = 12
    ribbon = Ribbon(1.0, 0.1, n, ends="free")
    spin = ratio * 22.373  # times the first frequency of a free beam, sqrt(D/rho)/L^2 = 1
    h = 0.04 / spin
    shape = bend * np.sin(np.pi * np.arange(1, n) / n) ** 2
    body = Body(ribbon, RibbonState(np.zeros(n - 1), shape), spin=(spin, 0.0, 0.0))
    sim = simulate(Scene((body,), PHYSICS, STILL), 40 * h, h, mass=mass)
    assert sim.status is RunStatus.COMPLETE
    size = np.abs(sim.tracks[0].angles).sum(axis=1)
    away = np.abs(sim.tracks[0].middle - sim.tracks[0].middle[0]).max()
    return float(size.max() / max(bend * n / 2, 1e-300)), float(away)


def test_spinning_about_the_centreline_bends_only_what_has_mass_beside_it() -> None:
    """Pan 2016, Fig. 11, made quantitative: bending grows above 22.373 sqrt(D/rho)/L^2 (closed form).

    A lumped strip has no inertia about its centreline and stays where it is.
    """
    assert _spun(0.5, "consistent", 1e-3)[0] < 1.05
    assert _spun(2.0, "consistent", 1e-3)[0] > 1.8
    assert _spun(2.0, "lumped", 0.0) == (0.0, pytest.approx(0.0, abs=1e-12))
