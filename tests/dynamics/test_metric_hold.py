"""A natural metric that no mesh has is simulated with its lengths and angles."""

from __future__ import annotations

import numpy as np
from small_scenes import hat_on_ball

from casashell import simulate, solve


def test_a_shell_too_soft_for_a_natural_mesh_is_held_by_its_metric() -> None:
    problem = hat_on_ball(bend=5e-5)
    result = solve(problem, natural="metric").require()
    assert result.natural == "metric"
    held = simulate(result, 0.2, problem=problem)
    assert held.drift.max() < 1e-10
    nearest = simulate(result, 0.2, problem=problem, rest=result.rest)
    assert nearest.drift.max() > 1e3 * held.drift.max()
    assert np.isfinite(nearest.positions).all()
