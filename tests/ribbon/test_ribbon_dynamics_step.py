"""One implicit Euler step: derivatives, former shapes, and the forms of its kinetic term."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from casashell.ribbon.chain import reconstruct
from casashell.ribbon.coordinates import Coordinates
from casashell.ribbon.dynamics import StepFailed, Stepper, simulate
from casashell.ribbon.parallel import Workers
from casashell.ribbon.record import RunStatus
from casashell.ribbon.resample import Rims, abscissae, piece_of
from casashell.ribbon.ribbon import Ribbon, RibbonState
from casashell.ribbon.scene import Body, Scene
from casashell.ribbon.statics import Setting
from casashell.ribbon.step import Past, Rule, Task, advance, inertia, rim_points
from formulations.ribbon import ribbon_physics

PHYSICS = ribbon_physics()
RIBBON = Ribbon(1.0, 0.2, 9, density=0.3, ends="free", energy="wunderlich")


def moved(seed: int) -> RibbonState:
    rng = np.random.default_rng(seed)
    return RibbonState(np.cumsum(rng.normal(0, 0.02, 8)), rng.normal(0, 0.3, 8))


def task(h: float = 0.01, lapse: float = 0.01) -> Task:
    """A step from an arbitrary shape in arbitrary motion."""
    rng, state, other = np.random.default_rng(5), moved(1), moved(2)
    points = rim_points(reconstruct(RIBBON, state))
    former = points + rng.normal(0, 0.01, points.shape)
    past = Past(state, points, former, other.all_slopes, lapse)
    return Task(RIBBON, past, h, Setting(gravity=(0.0, 1.0, -9.81)))


@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_derivatives_of_a_step(mass: str) -> None:
    """Gradient and Hessian against central differences, all energies, floating frame."""
    job = task()
    space = Coordinates(RIBBON, job.past.state, floating=True)
    potential = job.setting.potential(RIBBON, PHYSICS, job.past.state)
    kinetic = inertia(job, PHYSICS, Rule(resample="hermite", mass=mass))
    potential = replace(potential, coordinates=space, terms=potential.terms.with_terms([kinetic]))
    rng = np.random.default_rng(7)
    z = space.pack(job.past.state) + rng.normal(0, 1e-3, space.size)
    step, unit = 1e-6, np.eye(space.size)
    rise = [potential.objective(z + s * step * e)[0] for e in unit for s in (1, -1)]
    slopes = [potential.objective(z + s * step * e)[1] for e in unit for s in (1, -1)]
    gradient = potential.objective(z)[1]
    hessian = potential.hessian(z, np.empty(0))
    differences = np.diff(np.reshape(rise, (-1, 2)))[:, 0] / (-2 * step)
    second = -np.diff(np.reshape(slopes, (-1, 2, space.size)), axis=1)[:, 0] / (2 * step)
    assert np.abs(gradient - differences).max() < 1e-8 * np.abs(gradient).max()
    assert np.abs(hessian - second).max() < 1e-8 * np.abs(hessian).max()
    np.testing.assert_allclose(hessian, hessian.T, atol=1e-12 * np.abs(hessian).max())


@pytest.mark.parametrize("resample", ["linear", "hermite"])
def test_former_shapes_are_interpolated(resample: str) -> None:
    """Through the knots; exact for linear and, with three-point tangents, for quadratic functions."""
    knots = abscissae(1.0, 0.2, moved(3).all_slopes)
    line = np.stack([2 * knots, 1 - knots, 0 * knots], axis=-1)
    curve = np.stack([knots**2, 1 - knots**2, knots], axis=-1)
    piece = piece_of(PHYSICS, resample)
    s = np.clip(knots + 0.03, 0.0, 1.0)
    np.testing.assert_allclose(Rims(knots, curve, piece).at(knots), curve, atol=1e-14)
    np.testing.assert_allclose(
        Rims(knots, line, piece).at(s), np.stack([2 * s, 1 - s, 0 * s], axis=-1), atol=1e-14
    )
    inner = slice(1, -2)  # away from the ends, whose tangents are one-sided
    off = Rims(knots, curve, piece).at(s)[:, inner, 0] - s[:, inner] ** 2
    assert np.abs(off).max() < (1e-14 if resample == "hermite" else 5e-3)
    assert resample == "hermite" or np.abs(off).max() > 1e-4


def test_both_forms_agree_where_rulings_rest() -> None:
    """With c^n = c^{n-1} the velocities are exact at the vertices, and both forms are one."""
    job = task()
    job = replace(job, past=replace(job.past, former_slopes=job.past.state.all_slopes))
    table = reconstruct(RIBBON, moved(4)).table
    values = [
        inertia(job, PHYSICS, Rule(form=form)).run("energy", table)[0].sum()
        for form in ("positions", "velocities")
    ]
    assert values[0] == pytest.approx(values[1], rel=1e-12)


def test_half_a_step_carries_the_velocity_on() -> None:
    """x^{n-1} was 0.02 s before, the step is 0.01 s: without forces it goes half as far."""
    state = RibbonState(np.zeros(8), np.zeros(8))
    points = rim_points(reconstruct(RIBBON, state))
    past = Past(state, points, points - np.array([0.02, 0.0, 0.0]), state.all_slopes, 0.02)
    for mass in ("consistent", "lumped"):
        end = advance(Task(RIBBON, past, 0.01, Setting()), PHYSICS, Rule(mass=mass))
        np.testing.assert_allclose(end.points - points, [[[0.01, 0, 0]] * 10] * 2, atol=1e-9)


def test_rules_are_checked() -> None:
    for wrong in ({"solver": "magic"}, {"mass": "none"}, {"form": "x"}, {"resample": "cubic"}):
        with pytest.raises(ValueError, match=f"{next(iter(wrong))} must be"):
            Rule(**wrong)
    with pytest.raises(ValueError, match="positive"):
        Rule(tolerance=-1.0)
    with pytest.raises(ValueError, match="proximal"):
        Rule(proximal=-1.0)
    assert Rule(solver="augmented").hold == 0.0
    assert Rule(solver="augmented").interpolant == "linear"
    assert Rule().interpolant == "hermite"


@dataclass(frozen=True, eq=False)
class Timid(Stepper):
    """Fails at any step longer than 0.01 s."""

    def _whole(self, pasts: tuple[Past, ...], t: float, h: float) -> object:
        if h > 0.011:
            raise StepFailed("too long")
        return super()._whole(pasts, t, h)


def test_a_step_that_fails_is_made_in_parts() -> None:
    """Free fall in four quarters h: g h^2 (1 + 2 + 3 + 4) (closed form)."""
    scene = Scene((Body(replace(RIBBON, energy="sadowsky")),), PHYSICS, (0.0, 0.0, -10.0))
    stepper = Timid(scene, Rule(), Workers(1), None)
    begin = stepper.begin(0.04)
    made = stepper.step(begin, 0.0, 0.04)
    assert made.parts == 4
    drop = begin[0].points[..., 2] - made.pasts[0].points[..., 2]
    np.testing.assert_allclose(drop, 10.0 * 0.01**2 * 10, atol=1e-9)
    with pytest.raises(StepFailed, match="too long"):
        stepper.step(begin, 0.0, 4.0)


def test_rulings_of_a_flat_strip_are_no_trouble() -> None:
    """A long strip, bent by a degree a crease, unbends: 170 iterations of a step without the term."""
    ribbon = Ribbon(1.2, 0.02, 60, 1e-4, 0.1, ends="free")
    body = Body(ribbon, RibbonState(np.zeros(59), np.full(59, 0.02)), spin=(1.0, 0.0, 0.0))
    scene = Scene((body,), PHYSICS, (0.0, 0.0, 0.0))
    sim = simulate(scene, 0.08, 0.01)
    assert sim.status is RunStatus.COMPLETE
    assert sim.inner.max() < 50
    stepper = Stepper(scene, Rule(proximal=0.0), Workers(1), None)
    pasts, hardest = stepper.begin(0.01), 0.0
    for k in range(3):
        made = stepper.step(pasts, 0.01 * k, 0.01)
        pasts, hardest = made.pasts, max(hardest, float(made.inner.max()))
    assert hardest > 80
    free = rim_points(reconstruct(ribbon, pasts[0].state)).mean(axis=(0, 1))
    held = sim.tracks[0].middle[3].mean(axis=0)
    np.testing.assert_allclose(held, free, atol=1e-3 * 1.2)
