"""The status that a certificate supports, and the sentence that goes with a failure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from meshes import grid
from plain_shell import PlainShell

from casashell.contact.obstacles import Plane
from casashell.inverse.advice import needed_friction, status_of
from casashell.inverse.piece import Piece, split
from casashell.problem import Problem
from casashell.result import Certificate
from casashell.status import Status

GOOD = Certificate(
    free_force=1e-10,
    cone_margin=0.1,
    min_normal_force=0.2,
    min_eigenvalue=0.5,
    min_eigenvalue_scaled=3.0,
    target_distance=0.0,
    f0=0.01,
    h=0.1,
)
NO_CONTACTS = replace(GOOD, cone_margin=None, min_normal_force=None)


@pytest.mark.parametrize(
    "certificate",
    [
        GOOD,
        NO_CONTACTS,
        replace(GOOD, cone_margin=0.0, min_normal_force=0.0),
        replace(GOOD, free_force=1e-6),
        replace(GOOD, target_distance=1e-3),
        replace(GOOD, min_eigenvalue=None, min_eigenvalue_scaled=None),  # nothing is free to move
    ],
)
def test_thresholds_that_are_met_are_solved(certificate: Certificate) -> None:
    assert status_of(certificate) is Status.SOLVED


@pytest.mark.parametrize(
    ("entry", "value", "status"),
    [
        ("free_force", 1.001e-6, Status.ITERATION_LIMIT),
        ("free_force", 1e3, Status.ITERATION_LIMIT),
        ("free_force", np.inf, Status.NONFINITE),
        ("free_force", np.nan, Status.NONFINITE),
        ("free_force", None, Status.NONFINITE),
        ("cone_margin", -1e-11, Status.CONE_VIOLATED),
        ("cone_margin", -np.inf, Status.CONE_VIOLATED),
        ("min_normal_force", -1e-11, Status.CONE_VIOLATED),
        ("min_eigenvalue_scaled", -1.0, Status.UNSTABLE),
        ("min_eigenvalue_scaled", 0.0, Status.UNSTABLE),
        ("min_eigenvalue_scaled", 1e-8, Status.UNSTABLE),  # neutral, not stable
        ("min_eigenvalue_scaled", -np.inf, Status.UNSTABLE),
        ("target_distance", 1.1e-3, Status.SOLVED_NEARBY),
        ("target_distance", None, Status.SOLVED_NEARBY),
    ],
)
def test_one_entry_that_fails_decides(entry: str, value: float | None, status: Status) -> None:
    changed: dict[str, float | None] = {entry: value}
    assert status_of(replace(GOOD, **changed)) is status  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "worse",
    [
        {"cone_margin": -1.0},
        {"min_normal_force": -1.0},
        {"min_eigenvalue": -1.0, "min_eigenvalue_scaled": -1.0},
        {"free_force": 1.0},
    ],
)
def test_a_distant_pose_does_not_hide_a_violation(worse: dict[str, float]) -> None:
    far = replace(GOOD, target_distance=0.5)
    assert not status_of(replace(far, **worse)).certified  # type: ignore[arg-type]


def test_exit_codes() -> None:
    """0 certified, 1 not solved, 3 proved infeasible, 130 interrupted."""
    codes = {status.value: status.exit_code for status in Status}
    assert codes == {
        "SOLVED": 0,
        "SOLVED_NEARBY": 0,
        "UNSTABLE": 1,
        "CONE_VIOLATED": 1,
        "INFEASIBLE": 3,
        "TOO_SOFT": 1,
        "ITERATION_LIMIT": 1,
        "INTERRUPTED": 130,
        "NONFINITE": 1,
    }


def _slope(degrees: float, friction: float) -> Piece:
    angle = np.radians(degrees)
    turn = np.array(
        [[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]]
    )
    flat = grid(2, 2)
    sheet = flat.moved(flat.vertices @ turn.T)
    plane = Plane((-np.sin(angle), 0.0, np.cos(angle)), 0.0, friction=friction)
    problem = Problem(sheet, PlainShell(sheet).terms(), (plane,), contact_tolerance=1e-6)
    (piece,) = split(problem)
    return piece


@pytest.mark.parametrize("friction", [0.0, 0.1, 0.5])
def test_needed_friction_of_a_slope(friction: float) -> None:
    """tan(angle), to the 1 % of the bisection and the 0.5 % the solver stays inside the cones."""
    needed = needed_friction(_slope(42.0, friction))
    assert needed is not None
    assert needed == pytest.approx(np.tan(np.radians(42.0)), rel=0.02)
    assert needed >= np.tan(np.radians(42.0))


def test_no_friction_holds_on_a_ceiling() -> None:
    assert needed_friction(_slope(179.0, 0.5)) is None
