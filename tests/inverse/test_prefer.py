"""A preferred natural shape: found where the contacts leave the choice, refused where they do not."""

from __future__ import annotations

import numpy as np
import pytest
from small_scenes import clamped_page, hat_on_ball

import casashell
from casashell.app.paper_scenes import _circles, synthetic_skirt
from casashell.mesh import aligned
from casashell.typing import FloatArray


def _flat_ring() -> FloatArray:
    """What the Synthetic Skirt was draped from, turned and moved away."""
    ring, angle = _circles([20] * 10)
    out = 0.2 + 0.7 * ring / 9.0
    flat = np.stack([out * np.cos(angle), np.zeros(200), out * np.sin(angle)], axis=1)
    turn = np.array([[0.0, -0.6, 0.8], [1.0, 0.0, 0.0], [0.0, 0.8, 0.6]])
    return np.asarray(flat @ turn.T + [3.0, -2.0, 1.0])


def _apart(a: FloatArray, b: FloatArray) -> float:
    return float(np.linalg.norm(aligned(a, b) - b, axis=1).max())


def test_the_ring_that_a_skirt_was_made_of_is_recovered() -> None:
    """Known answer: the flat ring holds the skirt by construction, by normal forces alone.

    Ly 2018, Sec. 8.2 and Fig. 6 do not recover it: "not perfectly flat".
    """
    problem, flat = synthetic_skirt().problem, _flat_ring()
    h = problem.target.mean_edge_length
    plain = casashell.solve(problem).require()
    found = casashell.solve(problem, prefer=flat).require()
    assert _apart(plain.rest, flat) > 0.2 * h
    assert _apart(found.rest, flat) <= 1e-6 * h
    assert any("edge lengths away" in note for note in found.notes)


def test_the_answer_comes_nearer_to_what_cannot_be_had() -> None:
    """A shape that does not hold the hat: the answer is nearer to it than without, and certified."""
    problem = hat_on_ball()
    plain = casashell.solve(problem).require()
    wanted = plain.rest * np.array([1.02, 0.97, 1.01])
    found = casashell.solve(problem, prefer=wanted).require()
    assert _apart(found.rest, wanted) > 1e-6
    rms = [np.linalg.norm(aligned(wanted, result.rest) - result.rest) for result in (plain, found)]
    assert rms[1] < 0.999 * rms[0]


def test_what_was_found_is_found_again() -> None:
    problem = hat_on_ball()
    plain = casashell.solve(problem).require()
    again = casashell.solve(problem, prefer=plain.rest).require()
    h = problem.target.mean_edge_length
    assert _apart(again.rest, plain.rest) <= 1e-3 * h  # to the least normal forces of either


def test_without_contacts_there_is_no_choice() -> None:
    problem = clamped_page()
    found = casashell.solve(problem, prefer=problem.target.vertices)
    assert any("nothing to choose" in note for note in found.notes)
    assert np.array_equal(found.rest, casashell.solve(problem).rest)


def test_a_shape_that_does_not_fit_is_refused() -> None:
    problem = hat_on_ball()
    points = problem.target.vertices.copy()
    with pytest.raises(ValueError, match="one position a vertex"):
        casashell.solve(problem, prefer=points[:-1])
    points[3, 1] = np.nan
    with pytest.raises(ValueError, match="vertex 3 is not finite"):
        casashell.solve(problem, prefer=points)
