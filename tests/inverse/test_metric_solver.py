"""Natural metrics where no mesh will do: found by the program, judged by plain code."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from meshes import cap
from plain_shell import PlainShell, dihedral
from small_scenes import HEAD, assert_certified, clamped_page, hat_on_ball

from casashell.inverse.certificate import certify
from casashell.inverse.forces import SHRINKS
from casashell.inverse.metric_cuts import StiffnessMap
from casashell.inverse.metric_fit import nearest_mesh
from casashell.inverse.metric_mode import MetricMode
from casashell.inverse.metric_program import Balanced, MetricProgram
from casashell.inverse.metric_solver import MetricSolver
from casashell.inverse.metric_state import MetricState, area_slopes
from casashell.inverse.piece import split
from casashell.inverse.stress import StressProgram
from casashell.metric import Metric, heron, with_metric
from casashell.problem import Problem
from casashell.result import Result
from casashell.solving import solve
from casashell.status import Status
from casashell.typing import FloatArray


def soft_hat(bend: float = 5e-5) -> Problem:
    """A cap on a ball that is too soft for a natural mesh."""
    return hat_on_ball(bend=bend)


@pytest.fixture(scope="module")
def soft() -> Result:
    return solve(soft_hat(), natural="metric")


def _state(problem: Problem) -> MetricState:
    (piece,) = split(problem)
    return MetricState(piece, problem.target)


def _plain_forces(problem: Problem, shell: PlainShell, metric: Metric) -> FloatArray:
    """dE/dx (V,3) from lengths and angles, by loops and central differences of each strain."""
    x = problem.target.vertices
    made, step = np.zeros_like(x), 1e-6
    length = dict(zip(map(tuple, metric.edges.tolist()), metric.rest_length, strict=True))
    for (i, j), rest in length.items():
        edge = x[j] - x[i]
        now = float(np.linalg.norm(edge))
        pull = shell.stretch * (now / rest - 1.0) * edge / now
        made[j] += pull
        made[i] -= pull
    area = {}
    for (a, b, c), rest_area in zip(problem.target.faces.tolist(), metric.rest_area, strict=True):
        sides = [length[tuple(sorted(pair))] for pair in ((a, b), (b, c), (c, a))]
        s = sum(sides) / 2.0
        area[frozenset((a, b, c))] = heron_area = float(
            np.sqrt(s * (s - sides[0]) * (s - sides[1]) * (s - sides[2]))
        )
        assert heron_area == pytest.approx(rest_area, rel=1e-9)
        made[[a, b, c]] -= shell.density * heron_area / 3.0 * np.array(shell.gravity)
    for row, rest in zip(metric.hinges.tolist(), metric.rest_angle, strict=True):
        i, j, k, el = row
        areas = area[frozenset((i, j, k))] + area[frozenset((i, j, el))]
        stiffness = 3.0 * shell.bend * length[i, j] ** 2 / areas
        moment = stiffness * (dihedral(x, (i, j, k, el)) - rest)
        for vertex in row:
            for axis in range(3):
                ahead, behind = x.copy(), x.copy()
                ahead[vertex, axis] += step
                behind[vertex, axis] -= step
                change = dihedral(ahead, (i, j, k, el)) - dihedral(behind, (i, j, k, el))
                made[vertex, axis] += moment * change / (2.0 * step)
    return made


def test_a_metric_holds_what_no_mesh_can(soft: Result) -> None:
    """The direct solver finds no mesh; the metric is certified by the same thresholds."""
    assert not solve(soft_hat(), method="direct").status.certified
    assert soft.status is Status.SOLVED
    assert soft.natural == "metric"
    assert_certified(soft)
    assert "metric.npz" in soft.advice


def test_the_forces_of_the_metric_by_plain_loops(soft: Result) -> None:
    assert soft.metric is not None
    problem = soft_hat()
    forces = _plain_forces(problem, PlainShell(problem.target, bend=5e-5), soft.metric)
    np.testing.assert_allclose(forces, soft.forces, atol=1e-6 * soft.certificate.f0)


@pytest.mark.parametrize("what", ["rest_length", "rest_angle"])
def test_the_certificate_sees_a_metric_that_is_a_little_wrong(soft: Result, what: str) -> None:
    """One number off by a thousandth: out of balance by much more than the threshold."""
    assert soft.metric is not None
    numbers = getattr(soft.metric, what).copy()
    numbers[7] *= 1.001
    problem = soft_hat()
    terms = with_metric(problem.energies, soft.target, replace(soft.metric, **{what: numbers}))
    x = soft.target.vertices
    certificate, _ = certify(
        terms, x, x, x, soft.contacts, soft.contact_forces, soft.pinned, soft.certificate.h
    )
    assert certificate.free_force is not None
    assert certificate.free_force > 1e-5


def test_no_mesh_near_by_has_these_numbers(soft: Result) -> None:
    """The nearest mesh, which is ``rest``, is off in its angles: that is why there is no mesh."""
    assert soft.metric is not None
    nearest = Metric.of(soft.target, soft.rest)
    assert np.abs(nearest.rest_angle - soft.metric.rest_angle).max() > 1e-3


def test_a_natural_mesh_is_used_where_there_is_one() -> None:
    result = solve(clamped_page(), natural="metric")
    assert result.status is Status.SOLVED
    assert result.natural == "mesh"
    assert result.metric is not None
    wanted = Metric.of(result.target, result.rest)
    np.testing.assert_array_equal(result.metric.rest_angle, wanted.rest_angle)
    assert solve(clamped_page()).metric is None


def test_infeasible_stays_infeasible() -> None:
    """A shell above everything: a metric does not help, and none is claimed."""
    target = cap(2, 0.2, 1.0)
    lifted = target.moved(target.vertices + np.array([0.0, 0.0, 1.0]))
    terms = PlainShell(lifted).terms()
    result = solve(Problem(lifted, terms, (HEAD,)), natural="metric")
    assert not result.status.certified
    assert result.natural == "mesh"


def test_unknown_kind_of_natural_shape() -> None:
    with pytest.raises(ValueError, match="mesh, metric"):
        solve(clamped_page(), natural="angles")


def test_saved_and_restored(soft: Result, tmp_path: Path) -> None:
    """No file is called natural.obj that is not the natural shape."""
    soft.save(tmp_path / "out")
    names = {item.name for item in (tmp_path / "out").iterdir()}
    assert "natural.obj" not in names
    assert {"nearest.obj", "metric.npz"} <= names
    assert "NOT the natural shape" in (tmp_path / "out" / "nearest.obj").read_text()
    again = Result.load(tmp_path / "out")
    assert again.natural == "metric"
    assert again.metric is not None
    assert soft.metric is not None
    np.testing.assert_array_equal(again.metric.rest_length, soft.metric.rest_length)
    np.testing.assert_array_equal(again.metric.rest_angle, soft.metric.rest_angle)
    (tmp_path / "out" / "metric.npz").unlink()
    with pytest.raises(ValueError, match=r"metric\.npz is missing"):
        Result.load(tmp_path / "out")


def test_strain_forces_and_metric_determine_each_other() -> None:
    """Also far from the target: tensions of up to 3 k, lengths and angles to rounding."""
    state = _state(soft_hat())
    rng = np.random.default_rng(0)
    start = state.start
    lengths = start.rest_length * rng.uniform(0.8, 1.2, len(start.rest_length))
    areas = heron(lengths[state.index.sides])
    angles = start.rest_angle + rng.uniform(-6.0, 6.0, len(start.rest_angle))
    metric = replace(start, rest_length=lengths, rest_angle=angles, rest_area=areas)
    found = state.realised(start, state.strained(metric).tau)
    np.testing.assert_allclose(found.rest_length, lengths, rtol=1e-13)
    np.testing.assert_allclose(found.rest_angle, angles, atol=1e-12)
    np.testing.assert_allclose(found.rest_area, areas, rtol=1e-12)


def test_slopes_of_herons_area() -> None:
    """Against central differences."""
    sides, step = np.array([[3.0, 4.0, 5.5], [1.0, 1.2, 0.9]]), 1e-5
    for side in range(3):
        ahead, behind = sides.copy(), sides.copy()
        ahead[:, side] += step
        behind[:, side] -= step
        wanted = (heron(ahead) - heron(behind)) / (2.0 * step)
        np.testing.assert_allclose(area_slopes(sides)[:, side], wanted, rtol=1e-8)


def test_the_linearised_balance_is_the_slope_of_the_balance() -> None:
    """Second-order error: a step ten times smaller leaves a hundredth."""
    state = _state(soft_hat())
    program = MetricProgram(state)
    direction = (
        1e-2
        * state.strained(state.start).c
        * np.concatenate(
            [
                m if k == 2 else np.ones_like(m)
                for m, k in zip(state.measures, state.kinds, strict=True)
            ]
        )
    )
    none, left = np.zeros(program.frames.shape[1]), []
    for step in (1.0, 0.1):
        program.at(state.start)
        y = np.concatenate([step * direction / program.scale, none])
        predicted = program._jacobian() @ y + program._constant()
        program.at(state.realised(state.start, step * direction))
        left.append(np.abs(program.residual(none) - predicted).max())
    assert 60.0 < left[0] / left[1] < 160.0


def test_the_stiffness_map_is_the_hessian(soft: Result) -> None:
    """At the metric, and affine in the strain forces of the hinges whose stiffness is constant."""
    problem = soft_hat()
    state = _state(problem)
    program = MetricProgram(state)
    hessian = StiffnessMap(state, state.start, program.now).matrix.toarray()
    (piece,) = split(problem)
    _, entries = piece.assembly.hessian(piece.target, piece.target)
    wanted = piece.assembly.pattern.matrix(entries).toarray()
    np.testing.assert_allclose(hessian, wanted, atol=1e-9 * np.abs(wanted).max())


def test_without_cuts_the_first_round_is_the_stress_program() -> None:
    """Same stresses as the program with frozen masses when weight does not follow the areas."""
    problem = clamped_page(gravity=(0.0, 0.0, 0.0))
    state = _state(problem)
    program = MetricProgram(state)
    found = program.solve(SHRINKS[0])
    assert found is not None
    assert np.abs(found.tau / program.scale).max() < 1e-6  # no load: no stress
    polished = program.polished(Balanced(found.tau, found.columns))
    assert np.abs(polished.tau).max() <= np.abs(found.tau).max() + 1e-12
    assert StressProgram(state.piece).complete


def test_the_nearest_mesh_of_a_mesh_is_itself() -> None:
    """A metric that is embedded near the target is found to rounding of the fit."""
    problem = soft_hat()
    state = _state(problem)
    rng = np.random.default_rng(1)
    rest = state.piece.target + 1e-3 * rng.standard_normal(state.piece.target.shape)
    metric = Metric.of(problem.target, rest)
    found = Metric.of(problem.target, nearest_mesh(state, metric))
    np.testing.assert_allclose(found.rest_length, metric.rest_length, rtol=1e-6)
    np.testing.assert_allclose(found.rest_angle, metric.rest_angle, atol=1e-4)


def test_two_pieces_one_of_them_by_metric(soft: Result) -> None:
    """Numbers of a piece that has a mesh stay those of its mesh."""
    mode = MetricMode(soft_hat())
    (piece,) = split(soft_hat())
    mode.solve(0, piece, lambda step: None)
    metric = mode.metric([piece], soft.target.vertices)
    assert metric is not None
    assert not metric.embedded
    assert soft.metric is not None
    np.testing.assert_allclose(metric.rest_angle, soft.metric.rest_angle, atol=1e-9)
    solver = MetricSolver(piece, soft.target, lambda step: None)
    assert solver.run() is not None
    assert solver.rounds >= 1
