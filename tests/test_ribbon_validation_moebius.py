"""Moebius bands over their width against Starostin and van der Heijden 2007, supplement.

In their text: U = 5.93 at half-width pi / 30 of length 2 pi, and that U diverges at pi / sqrt 3.  Their
figures of twist over width and of torsion over curvature, up to w = 1.5, fill the axes compared here.
"""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.ribbons_moebius import (
    CRITICAL,
    CURVED,
    TORSIONS,
    TWISTS,
    WIDTHS,
    U,
    band,
    divergence,
)


def test_energy_and_twist_at_the_published_width() -> None:
    found = band(np.pi / 30, 60)
    assert found.energy == pytest.approx(U, rel=2e-3)
    assert found.twist + found.writhe == pytest.approx(0.5, abs=1e-6)
    assert TWISTS[0] < found.twist < TWISTS[1]


def test_a_wide_band_has_the_published_curvature_and_torsion() -> None:
    """w = 1.5 reaches the ends of the axes of the diagram; half the energy is in three folds."""
    found = band(1.5, 60)
    assert found.curvature.max() == pytest.approx(CURVED, rel=0.05)
    assert TORSIONS[0] < found.torsion.min() < TORSIONS[0] + 1.0
    assert TORSIONS[1] - 1.0 < found.torsion.max() < TORSIONS[1]
    folds = found.density > 2.0
    rises = np.flatnonzero(np.diff(folds.astype(int)) == 1)
    assert len(rises) == 3
    assert found.density[folds].sum() > 0.5 * found.density.sum()


@pytest.mark.slow
def test_the_sweep_over_the_width() -> None:
    bands = [band(w, 120) for w in WIDTHS]
    energies, twists = [b.energy for b in bands], [b.twist for b in bands]
    assert energies[0] == pytest.approx(U, rel=1e-3)
    assert np.all(np.diff(energies) > 0)
    assert np.all(np.diff([b.densest_tenth for b in bands]) > -1e-3)
    assert TWISTS[0] < min(twists) < TWISTS[0] + 0.025
    assert WIDTHS[int(np.argmin(twists))] == 1.0
    assert max(twists) < TWISTS[1]
    assert divergence(bands[-3:]) == pytest.approx(CRITICAL, rel=0.02)
