"""Energy and mass of whole ribbons against closed forms, and derivatives against differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from casashell.ribbon import forces
from casashell.ribbon.chain import reconstruct
from casashell.ribbon.conditions import Condition
from casashell.ribbon.coordinates import Coordinates
from casashell.ribbon.holds import Attachment, attached
from casashell.ribbon.potential import Potential
from casashell.ribbon.ribbon import Ribbon, RibbonState, flat
from casashell.ribbon.statics import Setting
from casashell.ribbon.terms import Term, Terms
from casashell.typing import FloatArray
from formulations import ribbon_physics

PHYSICS = ribbon_physics()


def test_energy_of_a_strip_on_a_cylinder() -> None:
    """D/2 A / R^2 with the area of the creases' shares, for every N; c = 0.5, R = 0.1."""
    for segments in (20, 77):
        ribbon = Ribbon(0.5, 0.03, segments, stiffness=2.7e-4)
        beta = ribbon.segment / (0.1 * np.sqrt(1.25))
        state = RibbonState(np.full(segments - 1, 0.5), np.full(segments - 1, beta))
        term = forces.bending(ribbon, PHYSICS)
        found = term.run("energy", reconstruct(ribbon, state).table)[0].sum()
        wanted = 0.5 * 2.7e-4 * 0.03 * (0.5 - ribbon.segment) / 0.1**2
        assert found == pytest.approx(wanted, rel=1e-12)


def test_energies_meet_where_rulings_are_parallel() -> None:
    ribbon = Ribbon(1.0, 0.1, 20, clamp_crease=True, end_crease=True)
    wide = Ribbon(1.0, 0.1, 20, energy="wunderlich", clamp_crease=True, end_crease=True)
    state = RibbonState(np.zeros(19), np.full(19, 0.2), start_angle=0.1, end_angle=0.1)
    table = reconstruct(ribbon, state).table
    first = forces.bending(ribbon, PHYSICS).run("energy", table)[0].sum()
    second = forces.bending(wide, PHYSICS).run("energy", table)[0].sum()
    assert first == pytest.approx(second, rel=1e-14)
    # Uniform curvature 0.2 / l over the whole length, the end creases with half a share.
    assert first == pytest.approx(0.5 * 0.1 * (0.2 * 20) ** 2, rel=1e-14)


def frequencies(segments: int, clamp_crease: bool) -> FloatArray:
    """Lowest three angular frequencies of a flat cantilever with L = D = rho = 1."""
    ribbon = Ribbon(1.0, 0.1, segments, clamp_crease=clamp_crease)
    n, width = segments, ribbon.width
    history = []
    for side in (-1, -1, 1, 1):  # both former shapes are the flat strip
        piece = np.zeros((3, 4))
        piece[1, 0], piece[0, 1] = side * width / 2, 1.0
        history += 2 * [0.0, *piece.ravel(order="F")]
    params = np.tile([1.0, ribbon.segment, width, 1.0, 0.0, *history], (n, 1))
    params[:, 4] = np.arange(n) * ribbon.segment
    inertia = Term(PHYSICS.consistent, forces.quads(n), params)
    space = Coordinates(ribbon, flat(ribbon))
    z = np.zeros(space.size)
    matrices = [
        Potential(space, Terms(n + 1, (term,)), 1.0).hessian(z, np.empty(0))[n - 1 :, n - 1 :]
        for term in (forces.bending(ribbon, PHYSICS), inertia)
    ]
    return np.sqrt(eigh(*matrices, eigvals_only=True)[:3])


@pytest.mark.parametrize(("clamp_crease", "order"), [(False, 0.9), (True, 1.9)])
def test_frequencies_of_a_cantilever(clamp_crease: bool, order: float) -> None:
    """Euler-Bernoulli: (1.875104, 4.694091, 7.854757)^2."""
    exact = np.array([1.875104069, 4.694091133, 7.854757438]) ** 2
    errors = [np.abs(frequencies(n, clamp_crease) / exact - 1) for n in (20, 40, 80)]
    assert np.all(np.log2(errors[0] / errors[1]) > order)
    assert np.all(np.log2(errors[1] / errors[2]) > order)
    assert np.all(errors[2] < (1e-3 if clamp_crease else 2e-2))


def differences(
    function: Callable[[FloatArray], FloatArray | float], z: FloatArray, step: float
) -> FloatArray:
    """Central differences, one row per unknown."""
    rows = [
        (np.asarray(function(z + step * e)) - np.asarray(function(z - step * e))) / (2 * step)
        for e in np.eye(len(z))
    ]
    return np.array(rows)


@pytest.mark.parametrize("increments", [True, False])
def test_derivatives_of_everything_at_once(increments: bool) -> None:
    """Gradient, Jacobian and Hessian of all terms and conditions, floating, both end creases."""
    n = 9
    ribbon = Ribbon(
        1.3, 0.2, n, ends="free", energy="wunderlich", clamp_crease=True, end_crease=True
    )
    random = np.random.default_rng(0)
    turns = 0.4 * ribbon.most_turn * random.uniform(-1, 1, n)
    state = RibbonState(
        np.cumsum(turns - turns.mean())[:-1],
        0.5 * random.uniform(-1, 1, n - 1),
        Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix(),
        np.array([1.0, 2.0, 3.0]),
        start_angle=0.2,
        end_angle=0.3,
    )
    base = RibbonState(state.slopes, state.angles, start_angle=0.2, end_angle=0.3)
    space = Coordinates(ribbon, base, floating=True, increments=increments)
    setting = Setting(gravity=(1, 2, -9.81), loads=(forces.PointLoad(0.77, 0.05, (1, 2, 3)),))
    plain = setting.potential(ribbon, PHYSICS, base, slopes=state.all_slopes)
    guided = forces.guiding(ribbon, PHYSICS, [2, 4], (0, 0, 1), 0.7)
    ends = forces.ends(n)
    held = Attachment(0.5, 0.03, (0, 0, 0))
    quad, _ = forces.material(ribbon, 0.5, 0.03, state.all_slopes)
    potential = Potential(
        space,
        plain.terms.with_terms([guided]),
        ribbon.energy_unit,
        far=(Term(PHYSICS.junction, ends, np.array([[1, 0.2, 0.05, 0.1, 1.0]])),),
        conditions=(
            Condition(PHYSICS.smooth, ends[0], np.array([1.3])),
            attached(ribbon, PHYSICS, held, quad),
        ),
    )
    z, y = space.pack(state), random.normal(size=9)
    again = space.state(z)
    np.testing.assert_allclose(again.frame, state.frame, atol=1e-14)
    np.testing.assert_allclose(again.slopes, state.slopes, atol=1e-14)

    gradient = potential.objective(z)[1]
    found = differences(lambda v: potential.objective(v)[0], z, 1e-6)
    np.testing.assert_allclose(found, gradient, atol=1e-8 * np.abs(gradient).max())
    jacobian = potential.equalities(z)[1]
    found = differences(lambda v: potential.equalities(v)[0], z, 1e-6)
    np.testing.assert_allclose(found.T, jacobian, atol=1e-8)
    hessian = potential.hessian(z, y)
    assert np.abs(hessian - hessian.T).max() < 1e-13 * np.abs(hessian).max()

    def pull(v: FloatArray) -> FloatArray:
        return potential.objective(v)[1] + y @ potential.equalities(v)[1]

    error = [np.abs(differences(pull, z, h) - hessian).max() for h in (1e-3, 5e-4)]
    assert np.log2(error[0] / error[1]) == pytest.approx(2.0, abs=0.1)
    assert error[1] < 1e-4 * np.abs(hessian).max()


def test_boxes_describe_crossing_rulings() -> None:
    """Increments within the box and the left-over rows: no neighbouring rulings too close."""
    ribbon = Ribbon(1.0, 0.1, 12)
    space = Coordinates(ribbon, flat(ribbon))
    random = np.random.default_rng(5)
    seen = {True: 0, False: 0}
    for _ in range(200):
        z = np.zeros(space.size)
        z[:11] = 1.1 * ribbon.most_turn * random.uniform(-1, 1, 11)
        z[:11] -= random.uniform(0, 1.1) * z[:11].mean()
        inside = bool(
            np.all(z <= space.upper)
            and np.all(z >= space.lower)
            and np.all(space.matrix @ z <= space.bound)
        )
        turned = np.diff(space.state(z).all_slopes)
        assert inside == bool(np.abs(turned).max() <= ribbon.most_turn)
        seen[inside] += 1
    assert min(seen.values()) > 5
