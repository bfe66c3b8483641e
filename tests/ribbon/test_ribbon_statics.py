"""Equilibria against closed forms: elastica, buckling, forceless strips, attachments."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from casashell.ribbon.forces import PointLoad, custom, guiding
from casashell.ribbon.holds import Attachment, HeldEnd
from casashell.ribbon.ribbon import Ribbon, RibbonState
from casashell.ribbon.statics import Equilibrium, Method, Setting, equilibrium
from formulations import ribbon_physics

PHYSICS = ribbon_physics()
WIDTH = 0.1


def cantilever(
    segments: int, load: float, *, clamp_crease: bool, method: Method = "exact"
) -> Equilibrium:
    """L = D = 1 under its weight, rho g L^3 / D = ``load``."""
    ribbon = Ribbon(
        1.0, WIDTH, segments, density=load / 10, clamp_crease=clamp_crease, regulariser=1e-6
    )
    found = equilibrium(ribbon, PHYSICS, Setting(gravity=(0, 0, -10)), method=method)
    return found.require()


#: Tip of theta'' = -q (1 - s) cos theta, theta(0) = 0, theta'(1) = 0 by scipy's solve_bvp, tol 1e-10.
ELASTICA = {23.2533: (0.404640, -0.848116)}


@pytest.mark.parametrize(("clamp_crease", "order"), [(False, 0.9), (True, 1.9)])
def test_heavy_cantilever_converges_to_the_elastica(clamp_crease: bool, order: float) -> None:
    """Half a segment stays rigid at the clamp with the paper's creases: first order only."""
    load, tip = next(iter(ELASTICA.items()))
    errors = []
    for segments in (10, 20, 40):
        strip = cantilever(segments, load, clamp_crease=clamp_crease).strip()
        errors.append(np.linalg.norm(strip.middle[-1, [0, 2]] - tip))
        assert np.abs(strip.middle[:, 1]).max() < 1e-9
    assert np.all(np.log2(np.divide(errors[:-1], errors[1:])) > order)
    assert errors[-1] < (6e-4 if clamp_crease else 3e-2)


def test_small_loads_bend_as_beams() -> None:
    """Tip deflection q / 8 of the clamped beam under its weight; 2nd order in q and l."""
    found = cantilever(80, 0.01, clamp_crease=True)
    assert found.strip().middle[-1, 2] == pytest.approx(-0.01 / 8, rel=3e-4)


def test_both_methods_find_the_same_rest() -> None:
    exact, paper = (
        cantilever(20, 23.2533, clamp_crease=True, method=method)
        for method in ("exact", "augmented")
    )
    assert paper.energy == pytest.approx(exact.energy, rel=1e-8)
    np.testing.assert_allclose(paper.state.angles, exact.state.angles, atol=1e-5)


def bump(segments: int, angles: np.ndarray) -> RibbonState:
    """A planar start."""
    return RibbonState(np.zeros(segments - 1), angles)


def clamped_column(segments: int, shortened: float) -> Equilibrium:
    """Both ends clamped, the second one moved inward."""
    ribbon = Ribbon(1.0, WIDTH, segments, clamp_crease=True, end_crease=True)
    start = bump(segments, 0.6 / segments * np.cos(2 * np.pi * np.arange(1, segments) / segments))
    setting = Setting(end=HeldEnd((1 - shortened, 0, 0), np.eye(3)))
    return equilibrium(ribbon, PHYSICS, setting, start=start).require()


def test_buckling_load_of_a_clamped_strip() -> None:
    """P = 4 pi^2 D W / L^2 (1 + shortening / 2), which is the classical post-buckling expansion."""
    wanted = 4 * np.pi**2 * WIDTH
    errors = []
    for segments in (20, 40):
        found = clamped_column(segments, 1e-3)
        errors.append(abs(-found.reactions[0][0] / (wanted * (1 + 0.5e-3)) - 1))
        assert np.abs(found.reactions[0][1:3]).max() < 1e-6 * wanted
    assert np.log2(errors[0] / errors[1]) > 1.9
    assert errors[1] < 2.5e-3


def test_buckling_load_of_a_hinged_strip() -> None:
    """P = pi^2 D W / L^2, ends attached along their rulings and free to turn about them."""
    n, shortened, half = 40, 1e-3, 0.5 * WIDTH
    ribbon = Ribbon(1.0, WIDTH, n, ends="free")
    hinges = [Attachment(s, y, (s * (1 - shortened), y, 0)) for s in (0, 1) for y in (-half, half)]
    start = bump(n, 0.14 / n * np.sin(np.pi * np.arange(1, n) / n))
    found = equilibrium(ribbon, PHYSICS, Setting(attachments=hinges), start=start).require()
    pushed = found.reactions[2][0] + found.reactions[3][0]
    assert -pushed == pytest.approx(np.pi**2 * WIDTH, rel=1.5e-3)
    held = found.reactions[0] + found.reactions[1] + found.reactions[2] + found.reactions[3]
    assert np.abs(held).max() < 1e-6


def test_a_straight_column_beyond_its_load_is_left_at_once() -> None:
    """The straight state under 1.2 P is an equilibrium and unstable; the search goes on from there."""
    ribbon = Ribbon(1.0, WIDTH, 30, clamp_crease=True)
    load = 1.2 * np.pi**2 / 4 * WIDTH
    setting = Setting(loads=(PointLoad(1.0, 0.0, (-load, 0, 0)),))
    found = equilibrium(ribbon, PHYSICS, setting).require()
    assert found.saddles >= 1
    assert np.abs(found.strip().middle[-1, 2]) > 0.1


@pytest.mark.parametrize("segments", [20, 40])
def test_strips_without_end_forces_are_spherical(segments: int) -> None:
    """Sadowsky strips held by end moments alone (Starostin and van der Heijden 2018)."""
    ribbon = Ribbon(1.0, 0.02, segments, regulariser=1e-6)
    axis = np.array([np.sin(1.0), 0.45, np.cos(1.0)])
    term = guiding(ribbon, PHYSICS, [segments - 1], axis / np.linalg.norm(axis), 10.0)
    start = bump(segments, np.full(segments - 1, 0.5 / segments))
    found = equilibrium(ribbon, PHYSICS, Setting(terms=(term,)), start=start).require()
    points = found.strip().middle
    system = np.column_stack([2 * points, np.ones(len(points))])
    fit = np.linalg.lstsq(system, (points**2).sum(axis=1))[0]
    radius = np.sqrt(fit[3] + fit[:3] @ fit[:3])
    assert np.abs(np.linalg.norm(points - fit[:3], axis=1) / radius - 1).max() < 1e-6
    # Truly in space, not a planar arc: the sagitta out of the best plane counts.
    assert np.linalg.svd(points - points.mean(axis=0))[1][2] > 5e-3


def test_loads_act_at_their_material_point() -> None:
    """A force off the centreline twists; virtual work of the load equals force times displacement."""
    ribbon = Ribbon(1.0, WIDTH, 16, clamp_crease=True)
    found = equilibrium(
        ribbon, PHYSICS, Setting(loads=(PointLoad(1.0, 0.05, (0, 0, -0.1)),))
    ).require()
    strip = found.strip()
    moved = strip.top[-1] - np.array([1.0, 0.05, 0.0])
    bent = found.energy - 0.1 * strip.top[-1, 2]
    # Clapeyron for small loads: elastic energy is half of the work.
    assert bent == pytest.approx(0.5 * -0.1 * moved[2], rel=0.05)
    assert np.abs(found.state.slopes).max() > 1e-3


def test_any_energy_of_the_user_takes_part() -> None:
    """A spring from the tip to a point: its pull is what bends the strip, so forces balance there."""
    ribbon = Ribbon(1.0, WIDTH, 20, clamp_crease=True)
    spring = custom(
        ribbon,
        lambda c, beta, bottom, top, normal: (
            5 * ca.sumsqr((bottom + top) / 2 - ca.DM([1.0, 0.0, 0.5]))
        ),
        stations=[20],
    )
    found = equilibrium(ribbon, PHYSICS, Setting(terms=(spring,))).require()
    tip = found.strip().middle[-1]
    pull = 10 * (np.array([1.0, 0.0, 0.5]) - tip)
    same = equilibrium(
        ribbon, PHYSICS, Setting(loads=(PointLoad(1.0, 0.0, pull),)), start=found.state
    ).require()
    np.testing.assert_allclose(same.strip().middle[-1], tip, atol=1e-7)
    assert tip[2] > 0.1


def test_natural_angles_and_target_rulings_are_kept() -> None:
    """Without loads a ribbon rests at its natural angles, and its rulings where they are wanted."""
    n = 12
    wanted = 0.4 * np.sin(np.pi * np.arange(1, n) / n)
    ribbon = Ribbon(1.0, WIDTH, n, rest_angles=0.2, target_rulings=wanted)
    found = equilibrium(ribbon, PHYSICS).require()
    np.testing.assert_allclose(found.state.angles, 0.2, atol=1e-9)
    np.testing.assert_allclose(found.state.slopes, wanted, atol=1e-5)
    assert found.energy == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("attachments", "words"),
    [
        ([Attachment(1.0, 0.0, (0.5, 0, 0)), Attachment(1.0, 0.0, (0.5, 0, 0.1))], "attachment 1"),
        ([Attachment(1.0, 0.0, (1.2, 0, 0))], "clamped begin"),
        ([Attachment(0.5, 0.0, (0, 0, 0.1)), Attachment(0.6, 0.0, (0, 0, 0.3))], "0.1 m between"),
    ],
)
def test_contradictory_holds_are_refused(attachments: list[Attachment], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        equilibrium(Ribbon(1.0, WIDTH, 10), PHYSICS, Setting(attachments=attachments))


def test_bad_ribbons_and_states_are_refused() -> None:
    with pytest.raises(ValueError, match="segments must be a whole number >= 2"):
        Ribbon(1.0, 0.1, 1)
    with pytest.raises(ValueError, match="width must be a finite number > 0"):
        Ribbon(1.0, float("nan"), 10)
    with pytest.raises(ValueError, match="sqrt"):
        Ribbon(1.73, 1.0, 40, ends="moebius")
    crossing = RibbonState(np.array([0.8, 1.6, 2.4, 0.1, 0, 0, 0, 0, 0]), np.zeros(9))
    with pytest.raises(ValueError, match="rulings 3 and 4 cross"):
        crossing.checked(Ribbon(1.0, 0.2, 10))
    with pytest.raises(ValueError, match="rotation"):
        RibbonState(np.zeros(3), np.zeros(3), frame=2 * np.eye(3))
    with pytest.raises(ValueError, match="lies outside of the strip"):
        equilibrium(
            Ribbon(1.0, 0.1, 10), PHYSICS, Setting(loads=(PointLoad(0.5, 0.06, (0, 0, 1)),))
        )
    with pytest.raises(ValueError, match="rest_angles of crease 2 must be finite"):
        Ribbon(1.0, 0.1, 3, rest_angles=[0.0, np.inf])
