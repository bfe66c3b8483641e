"""The quadratic program of impacts: what is known from the last round saves work, not exactness."""

from __future__ import annotations

import numpy as np
import pytest

from casashell.ribbon.collide import Collider, Resolved
from casashell.ribbon.impact_qp import Correction, ImpactProgram
from casashell.ribbon.impacts import Rows
from casashell.ribbon.strips import ribbon_strip, to_vertices
from casashell.typing import BoolArray, FloatArray


def crumpled(monkeypatch: pytest.MonkeyPatch, forget: bool) -> tuple[Resolved, int]:
    """A coil crushed to a tenth in one step, and how many programs were solved for it."""
    turn = np.linspace(0.0, 6.0 * np.pi, 37)
    middle = np.stack([0.03 * np.cos(turn), 0.03 * np.sin(turn), 0.002 * turn], axis=1)
    half = np.array([0.0, 0.0, 0.004])
    low, high = middle - half, middle + half
    strip = ribbon_strip(low, high, mass=1e-3, thickness=1e-3)
    start = to_vertices(low, high)
    end = 0.1 * start + np.random.default_rng(0).normal(0.0, 0.003, start.shape)
    one, whole, count = ImpactProgram._solve, ImpactProgram.solve, 0

    def counted(self: ImpactProgram, rows: Rows, x: FloatArray) -> Correction | None:
        nonlocal count
        count += 1
        return one(self, rows, x)

    def without(
        self: ImpactProgram, rows: Rows, x: FloatArray, known: BoolArray | None = None
    ) -> Correction | None:
        return whole(self, rows, x)

    with monkeypatch.context() as patch:
        patch.setattr(ImpactProgram, "_solve", counted)
        if forget:
            patch.setattr(ImpactProgram, "solve", without)
        return Collider((strip,)).resolve(start, end), count


def test_rows_that_carried_something_are_taken_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fewer programs, the same correction up to their tolerance."""
    quick, few = crumpled(monkeypatch, forget=False)
    slow, many = crumpled(monkeypatch, forget=True)
    assert quick.rounds > 1
    assert not quick.fail_safe
    assert few < 0.8 * many
    np.testing.assert_allclose(quick.positions, slow.positions, atol=0.05 * 1e-3)
