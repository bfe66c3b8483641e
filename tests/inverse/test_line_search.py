"""Weak Wolfe line search on functions of one variable."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from casashell.inverse.line_search import DECREASE, FLATTER, Trial, weak_wolfe

Curve = Callable[[float], tuple[float, float]]


def _trial(curve: Curve) -> Callable[[float], Trial]:
    return lambda t: Trial(t, *curve(t))


CURVES: dict[str, Curve] = {
    "parabola": lambda t: ((t - 1.0) ** 2, 2.0 * (t - 1.0)),
    "far": lambda t: ((t / 300.0 - 1.0) ** 2, (t / 300.0 - 1.0) / 150.0),
    "near": lambda t: ((1e3 * t - 1.0) ** 2, 2e3 * (1e3 * t - 1.0)),
    "kink": lambda t: (abs(t - 0.3), -1.0 if t < 0.3 else 1.0),
    "wall": lambda t: ((t - 0.2) ** 2, 2.0 * (t - 0.2)) if t < 0.25 else (np.nan, np.nan),
}


@pytest.mark.parametrize("name", CURVES)
def test_both_conditions_hold(name: str) -> None:
    evaluate = _trial(CURVES[name])
    here = evaluate(0.0)
    found = weak_wolfe(evaluate, here)
    assert found is not None
    assert found.value <= here.value + DECREASE * found.step * here.slope
    assert found.slope >= FLATTER * here.slope


def test_steps_stay_below_the_longest() -> None:
    found = weak_wolfe(_trial(CURVES["far"]), Trial(0.0, *CURVES["far"](0.0)), longest=3.0)
    assert found is not None
    assert found.step == 3.0


def test_low_point_before_a_jump_is_taken_soon() -> None:
    """Steeper and steeper down to the jump at 0.7: within 30 % of it is near enough."""
    calls: list[float] = []

    def jump(t: float) -> Trial:
        calls.append(t)
        return Trial(t, -t - t * t if t < 0.7 else 1e3, -1.0 - 2.0 * t)

    found = weak_wolfe(jump, jump(0.0))
    assert found is not None
    assert 0.5 <= found.step < 0.7
    assert len(calls) <= 6


def test_no_lower_point() -> None:
    """A slope that promises what the values do not keep."""
    assert weak_wolfe(lambda t: Trial(t, 1.0 + t, 1.0), Trial(0.0, 1.0, -1.0)) is None
    assert weak_wolfe(lambda t: Trial(t, np.nan, np.nan), Trial(0.0, 1.0, -1.0)) is None


def test_below_rounding_the_slope_decides() -> None:
    """Values that differ by rounding only: a flat point is accepted, a steep one is not."""

    def rounded(t: float) -> Trial:
        return Trial(t, 1.0 + 1e-15, 2e-9 * (t - 1.0))

    here = Trial(0.0, 1.0, -2e-9)
    assert weak_wolfe(rounded, here, noise=1e-14) == rounded(1.0)
    assert weak_wolfe(rounded, here, noise=0.0) is None
