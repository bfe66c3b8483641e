"""How soft a material may be: closed forms, regressions on real garments, and what is promised."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from meshes import grid
from plain_shell import PlainShell
from small_scenes import clamped_page, hat_on_ball, sheet_on_slope

from casashell.contact.mesh_obstacle import MeshObstacle
from casashell.inverse.material_range import MaterialRange, material_range
from casashell.inverse.piece import split
from casashell.inverse.softest import RESOLUTION, Softest, SoftestSearch
from casashell.io.meshes import read_mesh
from casashell.problem import Problem
from casashell.result import Step
from casashell.solving import solve
from casashell.status import Status


def _search(problem: Problem, *softened: str) -> SoftestSearch:
    (piece,) = split(problem)
    return SoftestSearch(piece, lambda step: None, frozenset(softened) or None)


def _upright(bend: float) -> Problem:
    """A strip that stands on its clamped foot, 0.5 high: a column under its own weight."""
    flat = grid(20, 4, 0.025, 0.025)
    standing = flat.moved(flat.vertices[:, [1, 2, 0]])
    shell = PlainShell(standing, density=0.2, stretch=2e3, bend=bend)
    return Problem(standing, shell.terms(), pinned=range(10))


def test_a_column_buckles_under_its_own_weight() -> None:
    """Greenhill: w L^3 / B = 7.837 for a clamped column of weight w per length and width.

    With all diagonals in one direction the hinges of this grid store
    k_theta / 2 (3 (Hxx + Hxy)^2 + 3 (Hyy + Hxy)^2 + 12 Hxy^2) per area; a narrow strip is free to twist
    and to curve across, which leaves B = 2.4 k_theta.  The clamp takes half a cell of the first hinge.
    """
    bend, length = 1e-2, 0.5 - 1.5 * 0.025 + 0.025
    expected = 7.837 * 2.4 * bend / (0.2 * 9.81 * length**3)
    found = _search(_upright(bend)).run()
    assert found.reason == "unstable"
    assert found.failed is not None
    assert found.factor <= 1.02 * expected
    assert 0.98 * expected <= found.failed <= RESOLUTION**2 * found.factor


def test_the_path_is_the_material() -> None:
    """Twice as stiff a material may be made twice as much softer: the factor times 1 / stiffness."""
    soft, stiff = _search(_upright(1e-2)), _search(_stiffer(_upright(1e-2), 2.0))
    one, two = soft.run(), stiff.run()
    assert two.factor == pytest.approx(2.0 * one.factor, rel=RESOLUTION - 1.0)


def _stiffer(problem: Problem, factor: float) -> Problem:
    energies = tuple(
        term if term.load else replace(term, params=factor * term.params)
        for term in problem.energies
    )
    return replace(problem, energies=energies)


@pytest.mark.parametrize("softened", [(), ("bend",)])
def test_what_is_reported_can_be_solved(softened: tuple[str, ...]) -> None:
    """A problem made of the softest material has the shape that was found as a certified answer."""
    problem = hat_on_ball()
    search = _search(problem, *softened)
    found = search.run()
    assert found.factor > 1.0
    assert found.held is not None
    piece = search.softer(found.factor)
    force = piece.assembly.gradient(piece.target, found.held.point.rest)
    free = np.setdiff1d(np.arange(len(piece.target)), piece.held)
    assert np.abs(force[free]).max() <= 1e-6 * piece.f0
    softer = tuple(
        replace(t, params=t.params / found.factor) if t.name in search.softened else t
        for t in problem.energies
    )
    assert solve(replace(problem, energies=softer)).status is Status.SOLVED


def test_below_one_a_factor_says_how_much_stiffer() -> None:
    found = _search(clamped_page(bend=3e-5)).run()
    assert 0.0 < found.factor < 1.0
    stiffer = _stiffer(clamped_page(bend=3e-5), 1.0 / found.factor)
    assert solve(stiffer).status is Status.SOLVED


def test_a_sheet_that_slides_has_no_softest_material() -> None:
    found = _search(sheet_on_slope(40.0, 0.5)).run()
    assert (found.factor, found.reason) == (0.0, "no contact forces")


def test_an_unknown_term_is_named() -> None:
    with pytest.raises(ValueError, match="no elastic term is called shear"):
        _search(clamped_page(), "shear")


def test_friction_of_a_slope() -> None:
    """A sheet on a slope of 20 degrees holds down to tan 20 = 0.364, and no further: proved."""
    found = material_range(sheet_on_slope(20.0, 0.6))
    assert found.complete
    assert found.friction is not None
    least = np.tan(np.radians(20.0)) / 0.6
    assert least <= found.friction.solved <= 1.12 * least
    assert 0.97 * least <= found.friction.impossible <= least


def test_an_interrupt_keeps_what_is_known() -> None:
    known = MaterialRange()

    def stop(name: str, step: Step) -> None:
        if name != "together":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        material_range(clamped_page(), stop, known)
    assert known.holds
    assert not known.complete
    assert known.alone == {}


def _garment(folder: Path) -> Problem:
    target = read_mesh(folder / "shell.obj")
    body = MeshObstacle(read_mesh(folder / "obstacle.obj"), friction=0.5)
    shell = PlainShell(target, gravity=(0.0, -9.81, 0.0))
    return Problem(target, shell.terms(), (body,), contact_tolerance=0.0045)


def test_a_real_skirt_may_be_nine_times_softer(shared_data: Path) -> None:
    """Regression: searched finely the path ends between 9.0 and 9.2, with forces of least strain energy."""
    found: Softest = _search(_garment(shared_data / "skirt_8panel_smpl")).run()
    assert found.reason == "no equilibrium"
    assert found.failed is not None
    assert 8.5 <= found.factor <= 9.2
    assert found.failed <= 9.7
