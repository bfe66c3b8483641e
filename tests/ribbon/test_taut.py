"""Two held points as far apart as when flat: the strip between them stays straight."""

from __future__ import annotations

import numpy as np
import pytest

from casashell.app.ribbon_chains import upright
from casashell.ribbon.bands import closed
from casashell.ribbon.chain import reconstruct
from casashell.ribbon.dynamics import simulate
from casashell.ribbon.holds import Attachment
from casashell.ribbon.record import RunStatus
from casashell.ribbon.ribbon import Ribbon, RibbonState
from casashell.ribbon.scene import Body, Scene
from casashell.ribbon.statics import Setting, equilibrium
from casashell.ribbon.taut import held_points
from casashell.typing import FloatArray
from formulations.ribbon import ribbon_physics

PHYSICS = ribbon_physics()
STRIP = Ribbon(0.4, 0.04, 16, stiffness=1e-3, density=0.1, ends="free")


def bent() -> RibbonState:
    """Rulings at a slant, bent everywhere."""
    slopes = 0.3 * np.minimum(np.arange(1, 16), np.arange(15, 0, -1)) / 8
    return RibbonState(slopes, np.full(15, 0.1))


def ends_of(ribbon: Ribbon, state: RibbonState, s: float, slope: float) -> tuple[Attachment, ...]:
    """Holds on both rims where a line of that slope meets them, in a quad or on a ruling."""
    shape, half = reconstruct(ribbon, state), 0.5 * ribbon.width
    stations = ribbon.segment * np.arange(ribbon.segments + 1)

    def place(y: float, rim: FloatArray) -> Attachment:
        knots, at = stations + y * state.all_slopes, s + slope * y
        return Attachment(at, y, [np.interp(at, knots, rim[:, i]) for i in range(3)])

    return place(-half, shape.bottom), place(half, shape.top)


def test_a_moebius_band_hangs_by_a_ruling() -> None:
    """Every step whole and to its tolerance, and the ruling where it is held."""
    band = Ribbon(0.3, 0.03, 40, 2.7e-4, 0.08, ends="moebius")
    state = upright(band, closed(band, PHYSICS).state, (0, 0, 1), (0, 1, 0))
    top = int(np.argmax(reconstruct(band, state).middle[:-1, 2]))
    pair = ends_of(band, state, top * band.segment, float(state.all_slopes[top]))
    scene = Scene((Body(band, state, Setting(attachments=pair)),), PHYSICS)
    sim = simulate(scene, 0.15, 0.01)
    assert sim.status is RunStatus.COMPLETE, sim.message
    assert sim.parts.max() == 1
    assert sim.violation.max() < 1e-8
    track = sim.tracks[0]
    np.testing.assert_allclose(track.slopes[:, top - 1], state.all_slopes[top], atol=1e-8)
    np.testing.assert_allclose(track.bottom[:, top] - track.bottom[0, top], 0.0, atol=1e-8)
    assert np.abs(track.middle[-1] - track.middle[0]).max() > 1e-3  # the rest moves


@pytest.mark.parametrize("inside", [0.3, 0.5])
def test_no_ruling_passes_a_line_held_within_a_quad(inside: float) -> None:
    """A bent strip hangs by a line across one quad; rulings push against it from both sides."""
    state = bent()
    s = (7 + inside) * STRIP.segment
    pair = ends_of(STRIP, state, s, 0.26)
    assert held_points(STRIP, pair, state.all_slopes).quads == (7, 7)
    scene = Scene((Body(STRIP, state, Setting(attachments=pair)),), PHYSICS)
    sim = simulate(scene, 0.2, 0.01)
    assert sim.status is RunStatus.COMPLETE, sim.message
    assert sim.parts.max() == 1
    for point in pair:
        before = 7 * STRIP.segment + sim.tracks[0].slopes[:, 6] * point.y
        behind = 8 * STRIP.segment + sim.tracks[0].slopes[:, 7] * point.y
        assert before.max() < point.s + 1e-8
        assert behind.min() > point.s - 1e-8
    assert sim.violation.max() < 1e-7


def test_which_points_are_taut() -> None:
    """Only at the distance of the flat strip, and only where one quad holds both."""
    state = bent()
    pair = ends_of(STRIP, state, 8 * STRIP.segment, float(state.all_slopes[8]))
    kept = held_points(STRIP, pair, state.all_slopes)
    assert kept.quads[0] == kept.quads[1]
    assert kept.rulings == ((8, pytest.approx(state.all_slopes[8])),)
    nearer = Attachment(pair[1].s, pair[1].y, 0.999 * np.asarray(pair[1].place))
    assert held_points(STRIP, (pair[0], nearer), state.all_slopes).rulings == ()
    far = ends_of(STRIP, state, 12 * STRIP.segment, float(state.all_slopes[12]))
    assert held_points(STRIP, (pair[0], far[1]), state.all_slopes).rulings == ()


def test_an_equilibrium_held_by_a_ruling() -> None:
    state = bent()
    pair = ends_of(STRIP, state, 8 * STRIP.segment, float(state.all_slopes[8]))
    setting = Setting(gravity=(0, 0, -9.81), attachments=pair)
    found = equilibrium(STRIP, PHYSICS, setting, start=state)
    assert found.converged
    assert found.state.all_slopes[8] == pytest.approx(state.all_slopes[8], abs=1e-9)
    weight = STRIP.density * STRIP.width * STRIP.length * 9.81
    np.testing.assert_allclose(sum(found.reactions[:2]), [0, 0, weight], atol=1e-5 * weight)
