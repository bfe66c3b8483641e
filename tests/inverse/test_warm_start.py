"""Solving again from an earlier result: the same answers with less work, or none lost."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from meshes import grid, joined, rigid_motion
from plain_shell import PlainShell
from small_scenes import HEAD, assert_certified, clamped_page, hat_on_ball

from casashell.contact.mesh_obstacle import MeshObstacle
from casashell.contact.obstacles import Sphere
from casashell.inverse.load_path import LoadPath
from casashell.io.meshes import read_mesh
from casashell.mesh import TriMesh
from casashell.problem import Problem
from casashell.result import Result
from casashell.solving import solve
from casashell.status import Status

USED, USELESS = "started from the earlier natural shape", "no good start"


def _said(result: Result, words: str) -> bool:
    return any(words in note for note in result.notes)


@pytest.mark.parametrize("scene", [clamped_page, hat_on_ball])
@pytest.mark.parametrize("method", ["auto", "direct"])
def test_nothing_is_left_to_do_for_the_same_problem(
    scene: Callable[[], Problem], method: str
) -> None:
    first = solve(scene())
    again = solve(scene(), method, start=first)
    assert_certified(again)
    assert _said(again, USED)
    assert again.factorizations == 0 < first.factorizations
    assert np.abs(again.rest - first.rest).max() <= 1e-12
    assert np.abs(again.contact_forces - first.contact_forces).max(initial=0.0) <= 1e-9
    assert not _said(first, "earlier")


def test_all_energies_doubled_double_the_forces() -> None:
    """Then the natural shape stays: by the homogeneity of the equilibrium in E."""
    first = solve(hat_on_ball())
    problem = hat_on_ball()
    shell = PlainShell(problem.target, density=0.4, stretch=40.0, bend=6e-3)
    again = solve(replace(problem, energies=shell.terms()), start=first)
    assert_certified(again)
    assert again.factorizations == 0
    assert np.abs(again.rest - first.rest).max() <= 1e-12
    scale = np.abs(first.contact_forces).max()
    assert np.abs(again.contact_forces - 2.0 * first.contact_forces).max() <= 1e-9 * scale


@pytest.mark.parametrize("bend", [5e-4, 3e-2])
def test_a_far_start_still_ends_with_the_answer(bend: float) -> None:
    """Six times softer, ten times stiffer: more work than without it at times, the same shape."""
    page = solve(clamped_page(bend=bend))
    again = solve(clamped_page(bend=bend), start=solve(clamped_page()))
    assert_certified(again)
    assert np.abs(again.rest - page.rest).max() <= 1e-9  # pins leave no choice of forces


@pytest.mark.parametrize("bend", [2e-3, 4e-3])
def test_another_material_takes_no_more_factorisations(bend: float) -> None:
    cold = solve(hat_on_ball(bend=bend))
    warm = solve(hat_on_ball(bend=bend), start=solve(hat_on_ball()))
    assert_certified(warm)
    assert _said(warm, USED)
    assert warm.factorizations <= cold.factorizations
    page = solve(clamped_page(bend=bend))
    again = solve(clamped_page(bend=bend), start=solve(clamped_page()))
    assert_certified(again)
    assert again.factorizations <= page.factorizations
    assert np.abs(again.rest - page.rest).max() <= 1e-9


def test_load_steps_are_left_out_on_a_garment(shared_data: Path) -> None:
    """Regression: the top needs 15 factorisations along the load path, 5 from a stiffer top."""
    first, cold = solve(_top(shared_data, 1e-3)), solve(_top(shared_data, 7e-4))
    warm = solve(_top(shared_data, 7e-4), start=first)
    assert warm.status is cold.status is Status.SOLVED
    assert _said(warm, USED)
    assert warm.factorizations <= 0.6 * cold.factorizations


def _top(folder: Path, bend: float) -> Problem:
    """The top on an avatar, dm, with the material of a light cloth."""
    shell, body = (
        read_mesh(folder / "top_avatar" / name, unit=0.1) for name in ("shell.obj", "obstacle.obj")
    )
    terms = PlainShell(shell, bend=bend, gravity=(0.0, -9.81, 0.0)).terms()
    return Problem(shell, terms, (MeshObstacle(body, friction=0.5),), contact_tolerance=3.3e-3)


def test_contacts_and_pins_may_differ() -> None:
    first = solve(hat_on_ball(pinned=(40, 50)))
    more = solve(hat_on_ball(), start=first)
    assert_certified(more)
    pinned = solve(hat_on_ball(pinned=(4, 40)), start=first)
    assert_certified(pinned)
    assert len(pinned.contacts) < len(first.contacts)
    assert np.array_equal(pinned.rest[[4, 40]], first.target.vertices[[4, 40]])


def test_another_friction_and_a_target_that_moved() -> None:
    first, slide = solve(hat_on_ball()), np.array([0.3, -0.2, 0.1])
    problem = hat_on_ball()
    ball = Sphere(HEAD.center + slide, HEAD.radius, friction=0.3)
    target = problem.target.moved(problem.target.vertices + slide)
    terms = PlainShell(target, bend=3e-3).terms()
    warm = solve(Problem(target, terms, (ball,), contact_tolerance=6e-3), start=first)
    assert_certified(warm)


def test_where_the_earlier_shape_lies_does_not_matter() -> None:
    first = solve(hat_on_ball())
    away = replace(first, rest=first.rest + np.array([1.0, 2.0, 3.0]))
    warm = solve(hat_on_ball(), start=away)
    assert_certified(warm)
    assert _said(warm, USED)
    assert np.abs(warm.rest - first.rest).max() <= 1e-3 * first.target.mean_edge_length


@pytest.mark.parametrize("kind", ["turned", "scattered", "flat", "not finite"])
def test_a_useless_start_costs_no_answer(kind: str) -> None:
    first = solve(hat_on_ball())
    bad = {
        "turned": rigid_motion(first.rest, seed=3),
        "scattered": np.random.default_rng(0).standard_normal(first.rest.shape),
        "flat": np.zeros_like(first.rest),
        "not finite": np.full_like(first.rest, np.nan),
    }[kind]
    result = solve(hat_on_ball(), start=replace(first, rest=bad))
    assert_certified(result)
    if not _said(result, USED):
        assert _said(result, USELESS) == (kind != "not finite")
        assert np.array_equal(result.rest, first.rest)


def test_forces_that_do_not_fit_are_given_up() -> None:
    """Forces that pull: nothing admissible is near them, the ladder finds the answer as ever."""
    first = solve(hat_on_ball())
    pulling = replace(first, contact_forces=-first.contact_forces, forces=np.zeros_like(first.rest))
    result = solve(hat_on_ball(), start=pulling)
    assert_certified(result)


def test_a_start_that_fails_leaves_the_ladder_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    first = solve(hat_on_ball(bend=1e-3))
    monkeypatch.setattr(LoadPath, "resume", lambda *_: None)
    result, cold = solve(hat_on_ball(), start=first), solve(hat_on_ball())
    assert _said(result, USELESS)
    assert np.array_equal(result.rest, cold.rest)
    assert result.factorizations == cold.factorizations


def test_what_cannot_be_held_is_still_said() -> None:
    first = solve(clamped_page())
    cold, warm = solve(clamped_page(bend=1e-6)), solve(clamped_page(bend=1e-6), start=first)
    assert not cold.status.certified
    assert warm.status is cold.status
    alone = solve(hat_on_ball(obstacles=()), start=solve(hat_on_ball()))
    assert alone.status is Status.INFEASIBLE


def test_without_weight_there_is_nothing_to_start() -> None:
    first = solve(clamped_page())
    result = solve(clamped_page(gravity=(0.0, 0.0, 0.0)), start=first)
    assert result.status is Status.SOLVED
    assert result.rest == pytest.approx(result.target.vertices, abs=1e-12)
    assert not _said(result, "earlier")


def test_each_part_starts_from_its_own() -> None:
    page = clamped_page()
    other = page.target.moved(page.target.vertices + np.array([1.0, 0.0, 0.0]))
    both = joined(page.target, other)
    pins = [*range(8), *(len(page.target.vertices) + np.arange(8))]

    def hung(bend: float) -> Problem:
        return Problem(both, PlainShell(both, bend=bend).terms(), pinned=pins)

    first = solve(hung(3e-3))
    assert _said(first, "2 independent parts")
    assert not _said(solve(page), "independent")
    again = solve(hung(3e-3), start=first)
    assert_certified(again)
    assert again.factorizations == 0


def test_another_mesh_is_refused_and_named() -> None:
    first = solve(clamped_page())
    with pytest.raises(ValueError, match="start has 24 vertices, the target 20"):
        solve(_flat(grid(4, 3)), start=first)
    target = first.target
    with pytest.raises(ValueError, match=r"start has 30 faces, the target 29"):
        solve(_flat(TriMesh(target.vertices, target.faces[:-1])), start=first)
    faces = target.faces.copy()
    faces[4] = np.roll(faces[4], 1)
    with pytest.raises(ValueError, match=r"in face 4, the target .*same mesh"):
        solve(_flat(TriMesh(target.vertices, faces)), start=first)


def _flat(mesh: TriMesh) -> Problem:
    return Problem(mesh, PlainShell(mesh).terms(), pinned=range(8))


@pytest.mark.parametrize("method", ["two-step", "nlp", "free-pose"])
def test_methods_without_a_start_say_so(method: str) -> None:
    with pytest.raises(ValueError, match=f"auto, direct only, not '{method}'"):
        solve(clamped_page(), method, start=solve(clamped_page()))
