"""Stress scenes: statuses that theory allows, and answers that survive a second opinion.

Expectations stand in benchmarks/stress next to the scenes, each with its reason.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.stress import random_scenes
from benchmarks.stress.case import Case, run, within
from benchmarks.stress.families import FAMILIES
from benchmarks.stress.oracle import CERTIFIED, expected
from benchmarks.stress.physics import Shell, fold, fold_gradient
from benchmarks.stress.recheck import balances, complaints
from benchmarks.stress.shapes import Setup, flag, page_on_table, sheet_on_floor, skirt_on_waist
from casashell.engine.assembly import Assembly
from casashell.status import Status

#: Families whose cases take next to no time.
QUICK = ("cone boundary", "number of contacts", "pins", "two obstacles")


@pytest.mark.parametrize("family", QUICK)
def test_quick_families(family: str) -> None:
    assert [(r.label, r.faults) for r in _rows(FAMILIES[family]()) if r.faults] == []


@pytest.mark.slow
@pytest.mark.parametrize("family", [name for name in FAMILIES if name not in QUICK])
def test_slow_families(family: str) -> None:
    assert [(r.label, r.faults) for r in _rows(FAMILIES[family]()) if r.faults] == []


@pytest.mark.slow
@pytest.mark.parametrize("first", range(0, 300, 50))
def test_random_scenes(first: int) -> None:
    rows = _rows(random_scenes.cases(50, first))
    assert [(r.label, r.faults) for r in rows if r.faults] == []
    assert sum(r.status == "SOLVED" for r in rows) >= 10  # not all hopeless: half of them solve


@settings(max_examples=15, deadline=None, derandomize=True)
@given(seed=st.integers(10_000, 2**31))
def test_any_random_scene_is_answered_honestly(seed: int) -> None:
    (row,) = _rows(random_scenes.cases(1, seed))
    assert row.faults == ()


def _rows(cases: list[Case]) -> list:  # type: ignore[type-arg]
    return [run("test", case) for case in cases]


@pytest.mark.parametrize("base", [page_on_table, skirt_on_waist, flag])
def test_second_opinion_knows_the_physics(base: Callable[[], Setup]) -> None:
    """Formulas by hand against CasADi's derivatives of the formulations."""
    problem = base().problem()
    shell, x = Shell.of(problem), problem.target.vertices
    rest = x + 1e-3 * np.random.default_rng(0).standard_normal(x.shape)
    assembly = Assembly(problem.energies, len(x))
    forces = assembly.gradient(x, rest)
    assert np.abs(shell.forces(x, rest) - forces).max() <= 1e-12 * np.abs(forces).max()
    matrix = assembly.pattern.matrix(assembly.hessian(x, rest)[1]).toarray()
    assert np.abs(shell.stiffness(x, rest) - matrix).max() <= 1e-12 * np.abs(matrix).max()


def test_gradient_of_the_fold_is_orthogonal_to_rigid_motions() -> None:
    x = np.random.default_rng(3).standard_normal((20, 4, 3))
    slope = fold_gradient(x)
    assert np.abs(slope.sum(axis=1)).max() <= 1e-12 * np.abs(slope).max()
    assert np.abs(np.cross(x, slope).sum(axis=1)).max() <= 1e-12 * np.abs(slope).max()
    step = 1e-6 * np.random.default_rng(4).standard_normal(x.shape)
    change = fold(x + step) - fold(x - step)
    wanted = 2.0 * (slope * step).sum(axis=(1, 2))
    assert change == pytest.approx(wanted, abs=1e-9 * np.abs(slope).max())


def test_second_opinion_refuses_what_is_wrong() -> None:
    """Each number of a certified result spoiled in turn."""
    problem = skirt_on_waist().problem()
    result = within(20.0, problem)
    assert result.status is Status.SOLVED
    assert complaints(problem, result) == []
    spoiled = [
        replace(result, rest=result.rest * (1.0 + 1e-6 * np.arange(3))),
        replace(result, contact_forces=result.contact_forces * (1.0 + 1e-5)),
        replace(result, contact_forces=-result.contact_forces),
        replace(result, rest=np.full_like(result.rest, np.nan)),
        replace(result, pose=result.pose + 0.1, rest=result.rest + 0.1),
        replace(result, status=Status.INFEASIBLE),
    ]
    for wrong in spoiled:
        assert complaints(problem, wrong) != []


@pytest.mark.parametrize("tilt", [0.0, 0.2, 0.45, 0.48, 0.6, 1.2])
def test_linear_program_knows_the_friction_angle(tilt: float) -> None:
    """A sheet on a slope stays up to tan(tilt) = 0.5, at 0.4636 rad; polygons differ by 1 %."""
    problem = sheet_on_floor(0.5, tilt).problem()
    for outer in (False, True):
        assert balances(problem, outer=outer) == (tilt < np.arctan(0.5))


def test_oracle_promises_nothing_for_soft_shells() -> None:
    stiff = skirt_on_waist()
    assert expected(stiff.problem()).allowed == CERTIFIED
    soft = replace(stiff, stretch=0.2, bend=1e-4)
    assert Status.TOO_SOFT in expected(soft.problem()).allowed


def test_stiff_shell_with_little_weight_is_not_called_soft() -> None:
    """Stiffness 1e12: rounding hides the weight, and the advice says so."""
    for base in (flag, skirt_on_waist):
        result = within(20.0, replace(base(), stretch=1e12, bend=1e9).problem())
        assert result.status is Status.ITERATION_LIMIT
        assert "so stiff for its weight that rounding" in result.advice


def test_pins_without_contacts_get_advice_from_every_method() -> None:
    """A curved sheet on two pins, far too soft: friction has no part in it."""
    small = page_on_table(5, 4)
    soft = replace(small, obstacles=(), pinned=(0, 3), stretch=0.1, bend=1e-5)
    result = within(20.0, soft.problem(), "nlp")
    assert not result.status.certified
    assert "pins alone" in result.advice
