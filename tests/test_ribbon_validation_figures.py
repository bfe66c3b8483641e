"""Fig. 11 of Pan, Huang and Bao 2016: the triangles of a strip that is turned at its begin."""

from __future__ import annotations

import numpy as np
import pytest
from test_ribbon_figures import FOLDER, ROOT


def test_a_turned_strip_twists_by_triangles(monkeypatch: pytest.MonkeyPatch) -> None:
    """17 of 19 are a regression; with the mass on the centreline all of it turns along, flat."""
    monkeypatch.syspath_prepend(str(FOLDER))
    monkeypatch.syspath_prepend(str(ROOT))
    import pan11_spinning as figure  # type: ignore[import-not-found]

    steps = figure.PATTERN
    lumped, ours = (figure.turned(mass, steps) for mass in ("lumped", "consistent"))
    assert figure.complaints_of_turned(lumped, ours) == []
    assert lumped.bent.max() < 1e-12
    normal = lumped.sim.tracks[0].top[-1, 0] - lumped.sim.tracks[0].bottom[-1, 0]
    turn = np.arctan2(normal[2], normal[1])  # of the first ruling, which was along y
    assert turn == pytest.approx(figure.SPEED * figure.H * steps, abs=0.02)
    assert figure.triangles(ours, steps) >= 12
    assert len(figure.complaints_of_turned(ours, lumped)) == 2
