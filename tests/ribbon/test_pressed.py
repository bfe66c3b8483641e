"""Strips pressed against themselves and against obstacles: contacts as conditions of the step."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import casashell.ribbon.dynamics as dynamics
import casashell.ribbon.pressed as pressed
from casashell.app.ribbon_setup import Actions, Course, Load, Twist
from casashell.app.ribbon_shapes import waved
from casashell.ribbon.augmented import augmented
from casashell.ribbon.chain import BOTTOM, TOP, reconstruct
from casashell.ribbon.coordinates import Coordinates
from casashell.ribbon.dynamics import simulate
from casashell.ribbon.exact import exact
from casashell.ribbon.physics import RibbonPhysics
from casashell.ribbon.potential import Potential
from casashell.ribbon.record import RibbonSimulation, RunStatus
from casashell.ribbon.ribbon import Ribbon, RibbonState
from casashell.ribbon.scene import Body, Guide, Scene
from casashell.ribbon.statics import Setting
from casashell.ribbon.step import Proposed, Rule, Task, advance
from casashell.ribbon.touch import Touch
from casashell.typing import FloatArray
from formulations.ribbon import ribbon_physics

PHYSICS = ribbon_physics()
TURNED = 3.0  # s


def twisted(turns: float) -> Scene:
    """The built-in torsion, faster, and so far that the strip writhes and touches itself."""
    strip = Ribbon(10.0, 1.0, 20, 1.0, 1.0)
    pull = Load(strip.length, 0.0, Course.constant((20.0, 0.0, 0.0)))
    twist = Twist(np.eye(3)[2], np.eye(3)[0], Course([0.0, TURNED], [0.0, turns]))
    guides = (Guide((18, 19), twist, 100.0),)
    body = Body(strip, waved(strip, 0.01, 2.5, 0.1), Actions(loads=(pull,)), guides=guides)
    return Scene((body,), PHYSICS, gravity=(0.0, 0.0, 0.0), thickness=0.02)


def energies(scene: Scene, sim: RibbonSimulation) -> FloatArray:
    """(F,) [J] kinetic, elastic, of the load and of the guide."""
    body, track = scene.bodies[0], sim.tracks[0]
    made = sim.energies[:, 0, 0].copy()
    for k, t in enumerate(sim.times):
        state = replace(body.initial, slopes=track.slopes[k], angles=track.angles[k])
        potential = body.at(t, np.zeros(3)).potential(body.ribbon, PHYSICS, state)
        terms = potential.terms.with_terms(body.terms(t, PHYSICS))
        made[k] += terms.energy(reconstruct(body.ribbon, state).table)
    return made


def gained(scene: Scene, sim: RibbonSimulation) -> float:
    """[J] largest rise of the energy above what it was before, once nothing drives it any more."""
    late = energies(scene, sim)[sim.times > TURNED - 1e-9]
    return float((late - np.minimum.accumulate(late)).max())


def test_a_strip_pressed_against_itself_gains_no_energy(monkeypatch: pytest.MonkeyPatch) -> None:
    """2 % of the 33 J of bending at most; 97 J with vertices moved after the step alone."""
    scene = twisted(1.8)
    sim = simulate(scene, 4.0, 0.05)
    assert sim.status is RunStatus.COMPLETE, sim.message
    assert gained(scene, sim) < 0.6
    monkeypatch.setattr(pressed, "ROUNDS", 0)
    assert gained(scene, simulate(scene, 4.0, 0.05)) > 20.0


def test_a_step_is_made_again_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """What one solve with contacts leaves is the response's: three of them cost most of a step."""
    solved = list[bool]()

    def counted(task: Task, physics: RibbonPhysics, rule: Rule) -> Proposed:
        solved.append(task.touch is not None)
        return advance(task, physics, rule)

    monkeypatch.setattr(dynamics, "advance", counted)
    sim = simulate(twisted(1.8), 4.0, 0.05)
    assert sim.status is RunStatus.COMPLETE, sim.message
    assert sum(solved) > 2
    assert not any(one and two for one, two in pairwise(solved))


STRIP = Ribbon(1.0, 0.1, 8, density=1.0)


def floored(ends: str = "clamped") -> Potential:
    """A heavy strip whose far half may not sink below -0.1; one row about three points at once."""
    ribbon = replace(STRIP, ends=ends)
    base = RibbonState(np.zeros(7), np.full(7, 0.05))
    potential = Setting(gravity=(0, 0, -9.81)).potential(ribbon, PHYSICS, base)
    stations = np.arange(4, 9)
    rows = np.concatenate([4 * stations + BOTTOM, 4 * stations + TOP])[:, None] + np.zeros(4, int)
    pushes = np.zeros((len(rows), 4, 3))
    pushes[:, 0, 2] = 1.0
    rows[0], pushes[0, :, 2] = [13, 14, 17, 18], [0.2, 0.3, 0.4, 0.1]
    return replace(potential, touch=Touch(rows, pushes, np.full(len(rows), -0.1), 1.0))


def test_derivatives_of_contacts() -> None:
    """Rows and curvature against central differences."""
    potential = floored("free")
    space = potential.coordinates
    assert isinstance(space, Coordinates)
    rng = np.random.default_rng(3)
    z = rng.normal(0, 0.05, space.size)
    y = rng.uniform(0, 1, 10)
    step, unit = 1e-6, np.eye(space.size)
    ways = [[potential.contacts(z + s * step * e) for s in (1, -1)] for e in unit]
    slopes = np.stack([(a[0] - b[0]) / (2 * step) for a, b in ways], axis=1)
    np.testing.assert_allclose(potential.contacts(z)[1], slopes, atol=1e-8)
    second = np.stack([y @ (a[1] - b[1]) / (2 * step) for a, b in ways])
    found = potential.hessian(z, y) - potential.hessian(z, np.zeros(10))
    np.testing.assert_allclose(found, second, atol=1e-7)


def test_both_methods_keep_contacts() -> None:
    """The strip lies on the floor: forces only where it touches, the same minimum."""
    potential = floored()
    program = potential.program(potential.coordinates.pack(RibbonState(*np.zeros((2, 7)))))
    one, two = exact(program, gradient=1e-9), augmented(program)
    gaps = -program.inequalities(one.z)[2:]
    force = one.multipliers.inequality[2:]
    assert gaps.min() > -1e-8
    assert force.max() > 1e-3
    assert np.abs(gaps * force).max() < 1e-7
    assert two.objective == pytest.approx(one.objective, abs=1e-7)
    assert max(one.violation, two.violation) < 1e-7
