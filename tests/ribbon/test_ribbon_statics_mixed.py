"""The sparse program without a chain ends where the dense one does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from casashell.ribbon.bands import refined
from casashell.ribbon.forces import PointLoad
from casashell.ribbon.holds import Attachment, HeldEnd
from casashell.ribbon.loops import circle, moebius
from casashell.ribbon.ribbon import Ribbon, RibbonState
from casashell.ribbon.statics import Setting, equilibrium
from formulations import ribbon_physics

PHYSICS = ribbon_physics()
N = 16
HANGING = Setting(gravity=(0, 0, -9.81), loads=(PointLoad(1.0, 0.05, (0, 0.2, 0)),))
HINGES = [Attachment(s, y, (0.9 * s, y, 0)) for s in (0, 1) for y in (-0.05, 0.05)]


def bump(amplitude: float) -> RibbonState:
    """Planar; both ends keep their direction for a cosine."""
    return RibbonState(np.zeros(N - 1), amplitude / N * np.sin(np.pi * np.arange(1, N) / N))


def beside(state: RibbonState) -> RibbonState:
    """Near enough to fall back: most of these problems have a mirror image, some more minima."""
    return replace(state, slopes=0.97 * state.slopes, angles=0.97 * state.angles)


def both(ribbon: Ribbon, setting: Setting, start: RibbonState) -> None:
    """Same energy, state and reactions by two programs that share only the densities."""
    dense = equilibrium(ribbon, PHYSICS, setting, start=start, method="exact").require()
    away = beside(dense.state)
    sparse = equilibrium(ribbon, PHYSICS, setting, start=away, method="mixed").require()
    assert sparse.outcome.inner > 2
    assert sparse.energy == pytest.approx(dense.energy, rel=1e-9, abs=1e-12)
    np.testing.assert_allclose(sparse.state.angles, dense.state.angles, atol=1e-6)
    np.testing.assert_allclose(sparse.strip().middle, dense.strip().middle, atol=1e-6)
    for found, wanted in zip(sparse.reactions, dense.reactions, strict=True):
        np.testing.assert_allclose(found, wanted, atol=1e-5 * max(1, np.abs(wanted).max()))


@pytest.mark.parametrize("clamp_crease", [False, True])
def test_a_loaded_cantilever(clamp_crease: bool) -> None:
    frame = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    ribbon = Ribbon(1.0, 0.1, N, energy="wunderlich", clamp_crease=clamp_crease)
    start = RibbonState(np.zeros(N - 1), np.zeros(N - 1), frame, np.array([1.0, 2, 3]))
    both(ribbon, HANGING, start)


def test_a_clamped_column() -> None:
    ribbon = Ribbon(1.0, 0.1, N, clamp_crease=True, end_crease=True)
    angles = 0.8 / N * np.cos(2 * np.pi * np.arange(1, N) / N)
    both(
        ribbon,
        Setting(end=HeldEnd((0.95, 0, 0), np.eye(3))),
        RibbonState(np.zeros(N - 1), angles),
    )


@pytest.mark.parametrize("clamp_crease", [False, True])
def test_a_hinged_ribbon_that_floats(clamp_crease: bool) -> None:
    ribbon = Ribbon(1.0, 0.1, N, ends="free", clamp_crease=clamp_crease)
    setting = Setting(gravity=(0, 0, -9.81), attachments=HINGES)
    # Two attachments of one ruling repeat its width: reactions are not unique, all else is.
    dense = equilibrium(ribbon, PHYSICS, setting, start=bump(1.5), method="exact").require()
    away = beside(dense.state)
    sparse = equilibrium(ribbon, PHYSICS, setting, start=away, method="mixed").require()
    assert sparse.energy == pytest.approx(dense.energy, rel=1e-9)
    np.testing.assert_allclose(sparse.strip().middle, dense.strip().middle, atol=1e-6)
    held = sum(np.asarray(r)[2] for r in sparse.reactions)
    assert held == pytest.approx(9.81 * 0.1, rel=1e-6)


def test_closed_ribbons() -> None:
    loop = Ribbon(1.0, 0.05, N, ends="loop")
    heavy = Setting(gravity=(0, 0, -9.81))
    both(loop, heavy, circle(loop))
    band = Ribbon(1.0, 0.05, N, ends="moebius", energy="wunderlich", margin=0.02)
    both(band, Setting(), moebius(band)[0])


def test_the_sparse_program_finishes_what_a_coarse_one_began() -> None:
    """Refined from 20 to 120 segments; the elastica of the statics tests, one decimal more."""
    ribbon = Ribbon(1.0, 0.1, 20, density=2.32533, clamp_crease=True)
    setting = Setting(gravity=(0, 0, -10))
    coarse = equilibrium(ribbon, PHYSICS, setting).require()
    finer, start = refined(ribbon, coarse.state, 120)
    found = equilibrium(finer, PHYSICS, setting, start=start, method="mixed").require()
    wanted = (0.404640, -0.848116)
    np.testing.assert_allclose(found.strip().middle[-1, [0, 2]], wanted, atol=6e-5)


@pytest.mark.parametrize("weight", [1e3, 1e5])
@pytest.mark.parametrize("direction", [(0, 0, -1), (-1, 0, 0), (0.5, 0.3, -1)])
def test_extreme_loads_end_at_rest(weight: float, direction: tuple[float, ...]) -> None:
    """rho g L^3 / D up to 1e5, across the strip, against it and askew: certified, never NaN."""
    ribbon = Ribbon(1.0, 0.1, N, density=weight, clamp_crease=True)
    found = equilibrium(ribbon, PHYSICS, Setting(gravity=direction)).require()
    assert np.isfinite(found.strip().table).all()
    # It hangs below the clamp, not lower than a chain would.
    hanging = -0.5 * weight * 0.1 * np.linalg.norm(direction)
    assert hanging < found.energy < 0.3 * hanging
