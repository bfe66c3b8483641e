"""Natural angles and rulings for a given pose, checked by letting the ribbon go."""

from __future__ import annotations

import numpy as np
import pytest

from casashell.ribbon.chain import reconstruct
from casashell.ribbon.holds import HeldEnd
from casashell.ribbon.inverse import natural_ribbon
from casashell.ribbon.loops import circle
from casashell.ribbon.ribbon import BendingEnergy, Ribbon, RibbonState
from casashell.ribbon.statics import Setting, equilibrium
from casashell.status import Status
from formulations import ribbon_physics

PHYSICS = ribbon_physics()
WEIGHT = Setting(gravity=(0, 0, -9.81))


def arch(segments: int) -> RibbonState:
    """Planar, S-shaped."""
    s = np.arange(1, segments) / segments
    angles = 2.5 / segments * np.sin(6 * s)
    return RibbonState(np.zeros(segments - 1), angles, start_angle=1 / segments)


def helix(segments: int) -> RibbonState:
    """Tilted rulings with ramps at the ends."""
    s = np.arange(1, segments) / segments
    slopes = 0.8 * np.minimum(1, 6 * np.minimum(s, 1 - s))
    return RibbonState(slopes, np.full(segments - 1, 3 / segments), start_angle=1 / segments)


@pytest.mark.parametrize("energy", ["sadowsky", "wunderlich"])
@pytest.mark.parametrize("pose", [arch(24), helix(24)], ids=["arch", "helix"])
def test_the_ribbon_found_rests_in_the_pose(energy: BendingEnergy, pose: RibbonState) -> None:
    """The forward solve starts elsewhere and knows nothing of the pose."""
    ribbon = Ribbon(1.0, 0.1, 24, density=0.5, energy=energy, clamp_crease=True)
    found = natural_ribbon(ribbon, PHYSICS, pose, WEIGHT).require()
    assert found.residual < 1e-12
    away = RibbonState(0.9 * pose.slopes, 0.8 * pose.angles)
    rest = equilibrium(found.ribbon, PHYSICS, WEIGHT, start=away).require()
    np.testing.assert_allclose(rest.state.angles, pose.angles, atol=1e-7)
    np.testing.assert_allclose(rest.state.slopes, pose.slopes, atol=1e-5)
    # Without the answer the ribbon hangs elsewhere.
    sagged = equilibrium(ribbon, PHYSICS, WEIGHT, start=away).strip()
    assert np.abs(sagged.middle[-1] - reconstruct(ribbon, pose).middle[-1]).max() > 0.04


def test_planar_answers_have_a_closed_form() -> None:
    """betabar = beta - l m / (D W), m the moment of the weight behind the crease (statics by hand)."""
    n = 24
    ribbon, pose = Ribbon(1.0, 0.1, n, density=0.5, clamp_crease=True), arch(n)
    found = natural_ribbon(ribbon, PHYSICS, pose, WEIGHT).require()
    middle = reconstruct(ribbon, pose).middle
    centres = 0.5 * (middle[1:, 0] + middle[:-1, 0])
    weight = 0.5 * 0.1 / n * 9.81
    moments = np.array([weight * np.sum(centres[i:] - middle[i, 0]) for i in range(1, n)])
    wanted = pose.angles - moments / n / 0.1
    np.testing.assert_allclose(found.ribbon.rest_angles, wanted, atol=1e-12)


def test_a_held_end_takes_what_it_can() -> None:
    """With the far end held reactions are free: natural angles need not leave the pose so far."""
    n = 24
    ribbon, pose = Ribbon(1.0, 0.1, n, density=0.5, clamp_crease=True), arch(n)
    strip = reconstruct(ribbon, pose)
    end = HeldEnd(strip.middle[-1], strip.behind[-2])
    held = Setting(gravity=(0, 0, -9.81), end=end)
    free = natural_ribbon(ribbon, PHYSICS, pose, WEIGHT).require().ribbon
    found = natural_ribbon(ribbon, PHYSICS, pose, held).require()
    left, right = (np.linalg.norm(r.rest_angles - pose.angles) for r in (found.ribbon, free))
    assert left < 0.2 * right
    rest = equilibrium(found.ribbon, PHYSICS, held, start=pose).require()
    np.testing.assert_allclose(rest.state.angles, pose.angles, atol=1e-7)


def test_a_heavy_loop_keeps_round() -> None:
    ribbon = Ribbon(1.0, 0.05, 24, density=2.0, ends="loop")
    pose = circle(ribbon)
    found = natural_ribbon(ribbon, PHYSICS, pose, WEIGHT).require()
    rest = equilibrium(found.ribbon, PHYSICS, WEIGHT, start=pose).require()
    np.testing.assert_allclose(rest.state.angles, pose.angles, atol=1e-7)
    sagged = equilibrium(ribbon, PHYSICS, WEIGHT, start=pose)
    assert np.abs(sagged.state.angles - pose.angles).max() > 0.01


def test_what_cannot_be_is_said() -> None:
    pose = arch(24)
    heavy = Ribbon(1.0, 0.1, 24, density=500.0, clamp_crease=True)
    assert natural_ribbon(heavy, PHYSICS, pose, WEIGHT).status is Status.TOO_SOFT
    loose = Ribbon(1.0, 0.1, 24, ends="free", clamp_crease=True)
    assert natural_ribbon(loose, PHYSICS, pose, WEIGHT).status is Status.INFEASIBLE
    upright = RibbonState(
        np.zeros(23), np.zeros(23), np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]])
    )
    # A column twice beyond its greatest height, q = 7.837: in balance, and it would fall.
    column = Ribbon(1.0, 0.1, 24, density=16 / 9.81, clamp_crease=True)
    answer = natural_ribbon(column, PHYSICS, upright, WEIGHT)
    assert answer.status is Status.UNSTABLE
    with pytest.raises(RuntimeError, match="UNSTABLE"):
        answer.require()
    away = Setting(end=HeldEnd((0.3, 0, 0), np.eye(3)))
    with pytest.raises(ValueError, match="misses its holds"):
        natural_ribbon(Ribbon(1.0, 0.1, 24, clamp_crease=True), PHYSICS, pose, away)
