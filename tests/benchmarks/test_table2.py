"""The parts of the Table 2 benchmark that are not measurements."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks import table2_runs
from benchmarks.plots import FIGURES, draw, drawn
from benchmarks.recording import Clock, Recorder, StepClocks, Yardstick, cone_violation
from benchmarks.table2 import LIMIT, best_of_two, goals, report, wanted
from benchmarks.table2_runs import WAYS, Run, Runs, problem_of
from benchmarks.table2_text import (
    PUBLISHED,
    brief,
    certified,
    distance,
    paper_preset,
    two_step_row,
)
from casashell.app.builtin import skirt
from casashell.problem import Problem
from casashell.result import Step
from casashell.solving import solve

NUMBERS = {
    **{"vertices": 200, "contacts": 20, "status": "SOLVED", "certified": True, "seconds": 2.0},
    **{"iterations": 30, "J": 1e-20, "G": 1e-22, "floor": 1e-21, "G_true": 0.0, "energy": 0.1},
    **{"G_newtons": 1e-26, "free_force": 1e-11, "cone_margin": 0.1, "min_normal_force": 1.0},
    **{"eigenvalue": 0.1, "target_distance": 0.0, "max_stretch": 0.1, "max_fold": 0.1, "h": 0.1},
    **{"size": 2.0, "notes": [], "interrupted": False, "memory": 100.0, "load": 0.5, "passes": 2},
    **{"seconds_one": 1.0, "seconds_two": 0.5, "iterations_one": 8, "iterations_two": 20},
}


def run(**changes: object) -> Run:
    """A run with made-up numbers."""
    curve = np.array([[0.1, 1.0, 2.0, 0.1], [2.0, 1e-11, 0.0, 0.0]])
    return Run({**NUMBERS, **changes}, np.eye(3), curve)


@pytest.fixture(scope="module")
def problem() -> Problem:
    return skirt(6, 20).problem


def step(seconds: float, stage: str = "bfgs", value: float = 0.0) -> Step:
    rest = np.full((4, 3), value)
    return Step(stage, 1.0, 0, 0.0, seconds, rest=rest, pose=np.ones((4, 3)))


def test_recorder_thins_out_but_keeps_the_last_of_every_stage() -> None:
    record = Recorder()
    for k in range(1000):
        record(step(1.0 + 1e-3 * k, value=k))
    record(step(2.0, "step one", value=-1.0))
    record(replace(step(3.0), rest=None))
    times = [each.seconds for each in record.iterates]
    # 2 % apart from 1 to 2 s: log 2 / log 1.02 = 35 of a thousand.
    assert 30 <= len(times) <= 40
    assert times == sorted(times)
    assert times[0] == 1.0
    assert times[-2:] == [1.999, 2.0]
    assert record.iterates[-2].rest[0, 0] == 999.0
    assert record.iterates[-1].pose is record.iterates[0].pose


def test_a_recorder_without_shapes_has_no_iterates() -> None:
    record = Recorder()
    record(Step("stress program", 0.0, 0, np.nan, 0.1))
    assert record.iterates == []


def test_clock_counts_calls_that_are_interrupted_too() -> None:
    clock = Clock()
    whole = clock.around(lambda: SimpleNamespace(iterations=7))

    def broken() -> None:
        raise KeyboardInterrupt

    whole()
    with pytest.raises(KeyboardInterrupt):
        clock.around(broken)()
    assert (clock.calls, clock.iterations) == (2, 7)
    assert clock.seconds > 0.0


def test_clocks_see_both_steps_and_leave_the_solver_as_it_was(problem: Problem) -> None:
    from casashell.inverse import two_step
    from casashell.inverse.step_one import StepOne

    before = StepOne.solve, two_step.step_two  # type: ignore[attr-defined]
    with StepClocks() as clocks:
        result = solve(problem, "two-step")
    assert (StepOne.solve, two_step.step_two) == before  # type: ignore[attr-defined]
    assert clocks.one.calls >= 1
    assert clocks.two.calls >= 1
    assert clocks.one.iterations + clocks.two.iterations == result.iterations
    assert clocks.one.seconds + clocks.two.seconds <= result.seconds


def test_yardstick_agrees_with_the_certificate(problem: Problem) -> None:
    result = solve(problem, "two-step", step2="bfgs")
    stick = Yardstick(problem)
    free, outside, away = stick.errors(result.rest, result.pose)
    assert free == pytest.approx(result.certificate.free_force, abs=1e-9)
    assert outside == 0.0
    assert away == result.certificate.target_distance
    assert stick.cone_residual(result.rest, result.pose) <= 1e-15
    piece = stick.pieces[0]
    newtons = stick.cone_residual_in_newtons(result.rest, result.pose)
    assert newtons == pytest.approx(piece.f0**2 * stick.cone_residual(result.rest, result.pose))
    assert 0.0 < stick.rounding_floor(result.rest, result.pose) < 1e-16


def test_yardstick_at_the_target_itself_sees_the_weight(problem: Problem) -> None:
    """Without strain every vertex needs its own weight and no more."""
    target = problem.target.vertices
    stick = Yardstick(problem)
    free, outside, away = stick.errors(target, target)
    piece = stick.pieces[0]
    loose = np.setdiff1d(np.arange(len(target)), piece.held)
    assert free == pytest.approx(np.abs(piece.loads[loose]).max() / piece.f0, rel=1e-9)
    assert outside > 0.0  # a slope needs friction, here more than there is
    assert away == 0.0
    assert stick.elastic_energy(target, target) == pytest.approx(0.0, abs=1e-25)
    moved = target + np.array([0.0, 0.1, 0.0])
    assert stick.distance(moved) == pytest.approx(0.5 * len(target) * 0.01)  # J = n d^2 / 2


@pytest.mark.parametrize(
    ("normal", "tangent", "violation"),
    [(2.0, 0.0, 0.0), (-3.0, 0.0, 3.0), (0.0, 1.5, 1.5), (1.0, 5.0, None)],
)
def test_violation_of_a_cone(
    problem: Problem, normal: float, tangent: float, violation: float | None
) -> None:
    """|f_T| - mu f_N, or the pull; None: |f_T| - mu f_N with the scene's own mu."""
    from casashell.contact.cone import tangents

    piece = Yardstick(problem).pieces[0]
    contacts = piece.contacts
    side, _ = tangents(contacts.normals[:1])
    forces = piece.spread(piece.f0 * contacts.normals)
    at = contacts.vertices[0]
    forces[at] = piece.f0 * (normal * contacts.normals[0] + tangent * side[0])
    if violation is None:
        violation = tangent - float(contacts.friction[0]) * normal
    elif normal < 0.0:
        violation = max(violation, -float(contacts.friction[0]) * normal)
    assert cone_violation(piece, forces) == pytest.approx(violation, abs=1e-12)


def test_distance_forgets_rigid_motions() -> None:
    points = np.random.default_rng(0).standard_normal((20, 3))
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert distance(points @ turn.T + 3.0, points) == pytest.approx((0.0, 0.0), abs=1e-12)
    farthest, mean = distance(np.diag([2.0, 0.0, 0.0]), np.zeros((3, 3)))
    # Points (2,0,0), 0, 0 less their mean against three points in one place.
    assert farthest == pytest.approx(4.0 / 3.0)
    assert mean == pytest.approx(np.sqrt(8.0 / 9.0))


def test_runs_survive_the_disk(tmp_path: Path) -> None:
    one = run()
    one.save(tmp_path / "one.npz")
    two = Run.load(tmp_path / "one.npz")
    assert two.numbers == one.numbers
    assert np.array_equal(two.rest, one.rest)
    assert np.array_equal(two.curve, one.curve)


def test_published_shares_of_the_two_steps_add_up() -> None:
    """Table 2 of Ly 2018, as printed: the shares are of the whole, rounded."""
    for numbers in PUBLISHED.values():
        assert 99 <= numbers[2] + numbers[4] <= 101


def test_rows_say_what_was_measured() -> None:
    assert "| 50 | 4 | 25 | 10 | 2.00 s |" in two_step_row("skirt", "two-step ipopt", run())
    assert "not finished in 2.00 s" in two_step_row("s", "w", run(interrupted=True))
    assert "killed" in two_step_row("s", "w", None)
    widths = {two_step_row("s", "w", found).count("|") for found in (run(), None)}
    assert widths == {paper_preset({}, 1.0).splitlines()[2].count("|")}


def test_numbers_in_brief() -> None:
    found = [brief(value) for value in (None, 0, 1.234e-5, 0.1234, -12.3, 1e6)]
    assert found == ["–", "0", "1.2e-05", "0.12", "-12", "1.0e+06"]


@pytest.mark.parametrize(
    ("seconds", "kept", "calls"),
    [((2.0, 1.0), 1.0, 2), ((1.0, 2.0), 1.0, 2), ((90.0, 1.0), 90.0, 1)],
)
def test_the_faster_of_two_runs_is_kept(
    seconds: tuple[float, ...],
    kept: float,
    calls: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    times = iter(seconds)

    def made(scene: str, way: str, limit: float, file: Path) -> Run:
        found = run(seconds=next(times))
        found.save(file)
        return found

    monkeypatch.setattr(table2_runs, "run", made)
    file = tmp_path / "run.npz"
    found = best_of_two("scene", "way", 100.0, file)
    assert found is not None
    assert found.numbers["seconds"] == Run.load(file).numbers["seconds"] == kept
    assert len(list(times)) == len(seconds) - calls


def test_goals_count_what_did_not_finish_as_missed() -> None:
    good: Runs = {key: run() for key in wanted()}
    assert all(goal.met for goal in goals(good))
    for bad in (None, run(interrupted=True, certified=False, G=1e-3)):
        missed = [goal for goal in goals(dict.fromkeys(good, bad)) if not goal.met]
        names = " ".join(goal.name for goal in missed)
        assert "synthetic-skirt, two-step bfgs" in names
        assert "certificate" in names
        assert "above 1e-20" in names
        assert max(goal.value for goal in missed) == LIMIT


def test_softer_scenes_have_the_same_target_and_less_stiffness() -> None:
    base, soft = problem_of("synthetic-skirt"), problem_of("synthetic-skirt, 3 x softer")
    assert np.array_equal(base.target.vertices, soft.target.vertices)
    one, two = (
        {key: value for term in problem.energies for key, value in term.material.items()}
        for problem in (base, soft)
    )
    for key, ratio in (("stretch", 1.0 / 3.0), ("bend", 1.0 / 3.0), ("density", 1.0)):
        assert np.allclose(np.asarray(two[key]), ratio * np.asarray(one[key]), rtol=1e-12)


def test_shapes_of_failed_runs_are_not_compared() -> None:
    runs: Runs = {("a", way): run(certified=way == "direct") for way in WAYS}
    assert list(certified(runs, "a")) == ["direct"]


def test_report_names_every_scene_and_picture() -> None:
    runs: Runs = {key: run() for key in wanted()}
    text = report(runs, goals(runs))
    for scene, way in wanted():
        assert f"| {scene} | {way} |" in text or f"| {scene} | SOLVED, 2.00 s |" in text
    for figure in FIGURES:
        assert f"table2-{figure.name}.png" in text


def test_log_axes_get_no_zeros() -> None:
    values = drawn(np.array([0.0, 1.0, np.inf, np.nan, 1e9]), 1e-5, 1e3)
    assert np.array_equal(values, [1e-5, 1.0, np.nan, np.nan, 1e3], equal_nan=True)


def test_figures_are_drawn(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    runs: Runs = {("scene", way): run() for way in WAYS}
    file = draw(FIGURES[0], runs, tmp_path)
    assert file.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert file.stat().st_size < 300_000
