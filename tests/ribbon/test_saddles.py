"""Symmetric states that the energy falls away from, and sizes from millimetres to kilometres."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from casashell.app.ribbon_setup import Course, Twist
from casashell.app.ribbon_shapes import wound
from casashell.ribbon.chain import reconstruct
from casashell.ribbon.dynamics import simulate
from casashell.ribbon.holds import Attachment
from casashell.ribbon.record import RunStatus
from casashell.ribbon.ribbon import Ribbon
from casashell.ribbon.scene import Body, Guide, Scene
from casashell.ribbon.statics import Setting, _aside, equilibrium
from formulations.ribbon import ribbon_physics

PHYSICS = ribbon_physics()
NONE = (0.0, 0.0, 0.0)


def test_a_flat_strip_twists_from_the_first_step() -> None:
    """Flat, every force vanishes by symmetry; the same side is taken in every run."""
    strip = Ribbon(10.0, 1.0, 20, 1.0, 1.0)
    twist = Twist(np.eye(3)[2], np.eye(3)[0], Course([0.0, 4.0], [0.0, 1.0]))
    scene = Scene((Body(strip, guides=(Guide((18, 19), twist, 100.0),)),), PHYSICS, NONE)
    first, second = (simulate(scene, 0.2, 0.05) for _ in range(2))
    assert first.status is RunStatus.COMPLETE
    assert np.abs(first.tracks[0].angles[1]).max() > 0.01
    assert np.abs(first.tracks[0].slopes[1]).max() > 0.01
    np.testing.assert_array_equal(first.tracks[0].angles, second.tracks[0].angles)


def test_a_flat_strip_at_rest_stays_flat() -> None:
    """No curvature is negative: there is nothing to leave."""
    sim = simulate(Scene((Body(Ribbon(10.0, 1.0, 20, 1.0, 1.0)),), PHYSICS, NONE), 0.2, 0.05)
    assert np.abs(sim.tracks[0].angles).max() < 1e-12


@pytest.mark.parametrize("held", [False, True])
def test_sizes_and_materials_make_no_difference(held: bool) -> None:
    """The same numbers without dimension, 1 mm to 1 km and over twelve decades of stiffness."""
    tips, counts = [], []
    for length, stiff in ((1.0, 1.0), (1e-3, 1e-6), (1e3, 1e6)):
        strip = Ribbon(length, 0.06 * length, 12, 0.01 * stiff * length**2, 0.08 * stiff)
        state = wound(strip, 0.1 * length, 0.3)
        time = float(np.sqrt(strip.density * length**4 / strip.stiffness))
        gravity = 20.0 * strip.stiffness / (strip.density * length**3)
        end = Attachment(length, 0.0, 0.9 * reconstruct(strip, state).middle[-1])
        setting = Setting(attachments=(end,) if held else ())
        scene = Scene((Body(strip, state, setting),), PHYSICS, (0.0, 0.0, -gravity))
        sim = simulate(scene, 0.2 * time, 0.02 * time)
        assert sim.status is RunStatus.COMPLETE, sim.message
        assert sim.parts.max() == 1
        tips.append(sim.tracks[0].middle[-1, 6] / length)
        counts.append(sim.inner.mean())
    np.testing.assert_allclose(tips[1:], [tips[0]] * 2, atol=1e-6)
    assert max(counts) < 1.5 * min(counts)


def test_a_start_beside_a_saddle_keeps_rulings_uncrossed() -> None:
    """Slopes that go to and fro by 0.05, where neighbours may differ by 0.045."""
    ribbon = Ribbon(1.0, 1.0, 40)
    rest = equilibrium(ribbon, PHYSICS)
    away = np.zeros_like(rest.stability.direction)
    away[: ribbon.segments - 1] = (-1.0) ** np.arange(ribbon.segments - 1)
    beside = _aside(replace(rest, stability=replace(rest.stability, direction=away)))
    assert np.abs(np.diff(beside.all_slopes)).max() < ribbon.most_turn
