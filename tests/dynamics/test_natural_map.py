"""The natural map of contact: its derivatives, and its zeros, against Coulomb's law written out."""

from __future__ import annotations

import numpy as np
import pytest

from casashell.dynamics.touch import OPEN, SLIDE, STICK, Touches, natural_map
from casashell.typing import FloatArray

COUNT = 60


def scene(seed: int) -> tuple[Touches, FloatArray, FloatArray]:
    """Random touches, forces (C,3) and displacements (C,3) in all three branches."""
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=(COUNT, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    touches = Touches(
        vertex=np.arange(COUNT),
        body=np.zeros(COUNT, dtype=np.int64),
        normal=normal,
        friction=np.where(np.arange(COUNT) % 5 == 0, 0.0, rng.uniform(0.2, 1.0, COUNT)),
        gap=0.3 * rng.normal(size=COUNT),
        carried=0.1 * rng.normal(size=(COUNT, 3)),
        normal_stiffness=rng.uniform(0.5, 2.0, COUNT),
        tangent_stiffness=rng.uniform(0.5, 2.0, COUNT),
        first=np.ones(COUNT, dtype=bool),
    )
    push = rng.uniform(-0.5, 2.0, COUNT)[:, None] * normal
    return touches, push + 0.3 * rng.normal(size=(COUNT, 3)), 0.2 * rng.normal(size=(COUNT, 3))


@pytest.mark.parametrize("seed", range(3))
def test_derivatives_are_those_of_differences(seed: int) -> None:
    """P and Q column by column, where no branch changes within the step of the difference."""
    touches, f, d = scene(seed)
    law, step = natural_map(touches, f, d), 1e-6
    assert set(law.state.tolist()) == {OPEN, STICK, SLIDE}
    for column in range(3):
        move = np.zeros(3)
        move[column] = step
        for which, slope in (("force", law.by_force), ("motion", law.by_motion)):
            pair = [
                natural_map(touches, f + s * move, d)
                if which == "force"
                else natural_map(touches, f, d + s * move)
                for s in (1.0, -1.0)
            ]
            same = (pair[0].state == law.state) & (pair[1].state == law.state)
            assert same.sum() > COUNT - 5
            found = (pair[0].value - pair[1].value) / (2.0 * step)
            assert found[same] == pytest.approx(slope[same][:, :, column], abs=1e-8)


@pytest.mark.parametrize("state", [OPEN, STICK, SLIDE])
def test_states_of_coulomb_are_zeros_and_others_are_not(state: int) -> None:
    """Open without force, sticking within the cone, sliding against the motion at its rim."""
    touches, _, d = scene(7)
    n, mu = touches.normal, touches.friction
    rng = np.random.default_rng(2)
    slip = np.cross(n, rng.normal(size=n.shape))
    way = slip / np.linalg.norm(slip, axis=1, keepdims=True)
    apart = 0.1 if state == OPEN else 0.0
    moved = slip if state != STICK else 0.0 * slip
    d = touches.carried + moved + (apart - touches.gap)[:, None] * n
    force = {
        OPEN: 0.0 * n,
        STICK: 2.0 * n + (0.9 * 2.0 * mu)[:, None] * way,
        SLIDE: 2.0 * n - (2.0 * mu)[:, None] * way,
    }[state]
    made = natural_map(touches, force, d)
    rough = mu > 0.0
    assert np.abs(made.value).max() <= 1e-14
    assert (made.state[rough] == state).all()
    if state == STICK:
        return
    # A pull through the air, or less friction than slides with, is no solution.
    wrong = force + (0.1 * n if state == OPEN else mu[:, None] * way)
    chosen = np.ones(COUNT, dtype=bool) if state == OPEN else rough
    assert (np.abs(natural_map(touches, wrong, d).value).max(axis=1)[chosen] > 1e-2).all()
