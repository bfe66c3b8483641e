"""The proof of the pudding: a natural shape, pushed away from its target, falls back onto it."""

from __future__ import annotations

import numpy as np
import pytest
from forward import settle
from meshes import cap, grid, rolled
from plain_shell import PlainShell

from casashell.contact.obstacles import Sphere
from casashell.engine.assembly import Assembly
from casashell.mesh import TriMesh
from casashell.problem import Problem
from casashell.result import Result
from casashell.solving import solve
from casashell.typing import IntArray


def _released(result: Result, shell: PlainShell, held: IntArray, push: float) -> float:
    """Largest distance from the target after settling from a random push, in edge lengths."""
    target = result.target
    free = np.ones(len(target.vertices), dtype=bool)
    free[held] = False
    noise = np.random.default_rng(0).standard_normal(target.vertices.shape)
    start = target.vertices + push * target.mean_edge_length * noise * free[:, None]
    assembly = Assembly(shell.terms(), len(free))
    settled = settle(assembly, start, result.rest, free)
    assert np.abs(start - target.vertices).max() > push * target.mean_edge_length
    return float(np.abs(settled - target.vertices).max() / target.mean_edge_length)


def _page() -> TriMesh:
    """A curved sheet that is clamped at one side and sags if its natural shape is its pose."""
    return rolled(grid(6, 3, 0.05, 0.05), 0.05, 0.12)


@pytest.mark.parametrize("push", [0.02, 0.1])
def test_clamped_page_returns(push: float) -> None:
    target = _page()
    shell = PlainShell(target, bend=3e-3)
    pins = np.arange(8)
    result = solve(Problem(target, shell.terms(), pinned=pins)).require()
    assert np.abs(result.rest - target.vertices).max() > 0.1 * target.mean_edge_length
    assert _released(result, shell, pins, push) <= 1e-6


def test_target_used_as_natural_shape_sags() -> None:
    """The control: without inversion the same page settles far from its target."""
    target = _page()
    shell = PlainShell(target, bend=3e-3)
    pins = np.arange(8)
    free = np.ones(28, dtype=bool)
    free[pins] = False
    settled = settle(Assembly(shell.terms(), 28), target.vertices, target.vertices, free)
    assert np.abs(settled - target.vertices).max() > 0.1 * target.mean_edge_length


def test_cap_on_a_ball_returns() -> None:
    """Contacts stick where they push; the brim is free."""
    target = cap(4, 0.2, 1.3)
    shell = PlainShell(target, bend=3e-3)
    head = Sphere((0.0, 0.0, 0.05), 0.15, friction=0.5)
    problem = Problem(target, shell.terms(), (head,), contact_tolerance=6e-3)
    result = solve(problem).require()
    assert 5 < len(result.contacts) < 30
    assert _released(result, shell, result.contacts.vertices, 0.05) <= 1e-6
