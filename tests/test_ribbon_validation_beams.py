"""Beams: the heavy cantilever over its load, and the speed from which a spinning strip bends."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from casashell.ribbon import Body, Ribbon, RibbonState, Scene, Setting, equilibrium, simulate
from casashell.typing import FloatArray
from formulations import ribbon_physics

PHYSICS = ribbon_physics()
#: First bending frequency of a free beam, sqrt(D / rho) / L^2: root of cos x cosh x = 1, squared.
FREE = 4.730040745**2


def elastica(load: float) -> FloatArray:
    """Tip (x, z) / L of theta'' = -q (1 - s) cos theta, theta(0) = 0, theta'(1) = 0."""
    s = np.linspace(0.0, 1.0, 401)

    def slope(s: FloatArray, y: FloatArray) -> FloatArray:
        return np.stack([y[1], -load * (1 - s) * np.cos(y[0]), np.cos(y[0]), -np.sin(y[0])])

    def ends(a: FloatArray, b: FloatArray) -> FloatArray:
        return np.array([a[0], b[1], a[2], a[3]])

    guess = np.stack([1.4 * s, 1.0 - s, 0.5 * s, -0.9 * s])
    found = solve_bvp(slope, ends, s, guess, tol=1e-9, max_nodes=20000)
    assert found.success
    return np.asarray(found.y[2:, -1])


def test_the_elastica_is_the_known_one() -> None:
    assert elastica(23.2533) == pytest.approx((0.404640, -0.848116), abs=2e-6)


@pytest.mark.parametrize("load", [1.0, 5.0, 100.0])
def test_heavy_cantilevers(load: float) -> None:
    """Clamp crease, second order: the error falls by 4 from 40 to 80 segments."""
    exact, errors = elastica(load), []
    for segments in (40, 80):
        strip = Ribbon(1.0, 0.1, segments, density=load / 10, clamp_crease=True, regulariser=1e-6)
        found = equilibrium(strip, PHYSICS, Setting(gravity=(0, 0, -10))).require()
        errors.append(np.linalg.norm(found.strip().middle[-1, [0, 2]] - exact))
    assert errors[1] < 5e-4
    assert np.log2(errors[0] / errors[1]) > 1.9


def growth(ratio: float) -> float:
    """Of the bending of a strip that spins about its centreline, ``ratio`` times `FREE` fast."""
    n, bend = 12, 1e-3
    ribbon = Ribbon(1.0, 0.1, n, ends="free")
    shape = bend * np.sin(np.pi * np.arange(1, n) / n) ** 2
    body = Body(ribbon, RibbonState(np.zeros(n - 1), shape), spin=(ratio * FREE, 0.0, 0.0))
    h = 0.04 / (ratio * FREE)
    sim = simulate(Scene((body,), PHYSICS, (0.0, 0.0, 0.0)), 40 * h, h)
    size = np.abs(sim.tracks[0].angles).sum(axis=1)
    return float(size[-1] / size[0])


def test_a_spinning_strip_bends_from_its_first_frequency_on() -> None:
    """Fig. 11 of Pan 2016 as a threshold: rho (w'' - Omega^2 w) + D w'''' = 0 of a free beam."""
    assert growth(0.9) < 1.0
    assert growth(1.1) > 1.1
