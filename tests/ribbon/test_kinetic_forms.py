"""Two ways to tell a step what the last ones were: former shapes, or velocities of vertices."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from casashell.app.ribbon_shapes import wound
from casashell.ribbon.dynamics import simulate
from casashell.ribbon.record import RibbonSimulation, RunStatus
from casashell.ribbon.ribbon import Ribbon
from casashell.ribbon.scene import Body, Scene
from casashell.ribbon.step import Form, Rule
from casashell.typing import FloatArray
from formulations.ribbon import ribbon_physics

PHYSICS = ribbon_physics()


@cache
def unrolled(form: Form | None, h: float, seconds: float) -> RibbonSimulation:
    """The slow helix of Fig. 8, whose rulings move all the time."""
    strip = Ribbon(10.0, 0.6, 20, stiffness=0.1, density=0.08)
    scene = Scene((Body(strip, wound(strip, 1.0, 0.5)),), PHYSICS, (0.0, 0.0, 0.0))
    sim = simulate(scene, seconds, h, form=form)
    assert sim.status is RunStatus.COMPLETE, sim.message
    return sim


def rises(sim: RibbonSimulation) -> FloatArray:
    """(F-1,) gain of energy in each step, over the energy at first."""
    total = sim.energies.sum(axis=(1, 2))
    made: FloatArray = np.diff(total) / total[0]
    return made


def test_short_steps_gain_no_energy() -> None:
    """Both former shapes, resampled and divided by h^2, gain per cents; velocities do not."""
    kept = rises(unrolled(None, 0.0025, 0.2))
    assert kept.max() < 2e-4
    assert kept.sum() < 0.0
    paper = rises(unrolled("positions", 0.0025, 0.2))
    assert paper[paper > 0].sum() > 20 * max(kept[kept > 0].sum(), 1e-4)


def test_shorter_steps_come_nearer_to_each_other() -> None:
    ends = [unrolled(None, h, 0.2).tracks[0].middle[-1] for h in (0.02, 0.01, 0.005, 0.0025)]
    apart = [np.abs(a - b).max() for a, b in pairwise(ends)]
    assert apart[1] < 0.8 * apart[0]
    assert apart[2] < 0.8 * apart[1]


@pytest.mark.parametrize(("solver", "form"), [("ipopt", "velocities"), ("augmented", "positions")])
def test_what_suits_the_solver(solver: str, form: str) -> None:
    """The paper's solver comes with the paper's form."""
    assert Rule(solver=solver).kinetics == form
    assert Rule(solver=solver, form="velocities").kinetics == "velocities"
