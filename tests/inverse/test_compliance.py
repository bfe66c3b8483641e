"""Forces of least energy on the contacts alone, against the program with all stresses."""

from __future__ import annotations

import numpy as np
import pytest

from casashell.inverse.compliance import least_energy_forces
from casashell.inverse.forces import SHRINKS
from casashell.inverse.piece import Piece, split
from casashell.inverse.stress import StressProgram
from casashell.problem import Problem
from tests.small_scenes import hat_on_ball, sheet_on_slope


def _piece(problem: Problem) -> Piece:
    (piece,) = split(problem, interpreted=False)
    return piece


@pytest.mark.parametrize("problem", [hat_on_ball(), sheet_on_slope(20.0, 0.6)])
def test_the_condensed_program_finds_the_forces_of_the_full_one(problem: Problem) -> None:
    """The two programs are one after elimination of the stresses (derived in the module)."""
    piece = _piece(problem)
    wanted = StressProgram(piece).solve(SHRINKS[0])
    found = least_energy_forces(piece, SHRINKS[0])
    assert wanted is not None
    assert found is not None
    size = float(np.abs(wanted.contact_forces).max())
    np.testing.assert_allclose(found, wanted.contact_forces, atol=2e-3 * size)


def test_forces_balance_the_weight_and_stay_in_the_cones() -> None:
    piece = _piece(hat_on_ball())
    found = least_energy_forces(piece, SHRINKS[0])
    assert found is not None
    np.testing.assert_allclose(found.sum(axis=0), -piece.loads.sum(axis=0), atol=1e-6 * piece.f0)
    normal = (found * piece.contacts.normals).sum(axis=1)
    slip = np.linalg.norm(found - normal[:, None] * piece.contacts.normals, axis=1)
    assert np.all(slip <= piece.contacts.friction * normal)


def test_a_slope_too_steep_has_no_forces() -> None:
    assert least_energy_forces(_piece(sheet_on_slope(45.0, 0.5)), SHRINKS[0]) is None
