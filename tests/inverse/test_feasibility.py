"""Feasibility before the solve: closed forms, proofs that can be tampered with, invariance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import cap, grid, jittered, rotation
from plain_shell import PlainShell
from small_scenes import clamped_page, hat_on_ball, sheet_on_slope, upright_sheet

from casashell.contact.obstacles import Plane, Sphere
from casashell.inverse.feasibility import Feasibility, PartFeasibility, Verdict, feasibility
from casashell.inverse.feasibility_proof import AREA_FACTOR, STRENGTH, check_proof
from casashell.inverse.piece import split
from casashell.mesh import TriMesh
from casashell.problem import Problem
from casashell.solving import solve
from casashell.typing import FloatArray


def _only(found: Feasibility) -> PartFeasibility:
    (part,) = found.parts
    return part


def _overhang(supported: int, free: int, pinned: tuple[int, ...] = ()) -> Problem:
    """A strip whose first cells lie on a floor and whose other cells rise gently from it."""
    strip = grid(supported + free, 1)
    points = strip.vertices.copy()
    edge = 0.1 * supported
    points[:, 2] = 0.2 * np.maximum(points[:, 0] - edge, 0.0)
    sheet = strip.moved(points)
    floor = Plane((0, 0, 1), 0.0, friction=0.5)
    terms = PlainShell(sheet, bend=1.0, stretch=1e3).terms()
    return Problem(sheet, terms, (floor,), pinned=pinned, contact_tolerance=1e-6)


def _moments(supported: int, free: int) -> tuple[float, float, float]:
    """Moments of the areas about the edge of the support on either side; distance of their centre."""
    held = 0.01 * sum(0.1 * (i + 0.5) for i in range(supported))
    over = 0.01 * np.sqrt(1.04) * sum(0.1 * (i + 0.5) for i in range(free))
    area = 0.01 * (supported + np.sqrt(1.04) * free)
    return held, over, (over - held) / area


@pytest.mark.parametrize("degrees", [10.0, 42.0])
def test_slope_needs_its_tangent(degrees: float) -> None:
    """Closed form: a sheet on a slope needs mu >= tan(angle), whatever its masses."""
    tangent = np.tan(np.radians(degrees))
    slides = feasibility(sheet_on_slope(degrees, 0.99 * tangent))
    part = _only(slides)
    assert slides.verdict is Verdict.INFEASIBLE
    assert slides.exit_code == 3
    assert part.proof is not None
    assert part.proof.holds
    assert part.proof.rigid
    assert np.isinf(part.proof.area_factor)
    assert part.mending is not None
    assert part.mending.friction == pytest.approx(tangent, rel=0.02)  # 1 % bisection, 0.5 % inside
    assert len(part.mending.sliding) == 36
    assert len(part.mending.lifting) == 0
    rough = feasibility(sheet_on_slope(degrees, 1.02 * tangent))
    assert rough.verdict is Verdict.FEASIBLE
    state = _only(rough).state
    assert state is not None
    assert state.friction_used is not None
    assert 1.0 / 1.02 <= state.friction_used <= 1.0  # all vertices slide alike on average


@pytest.mark.parametrize(
    ("supported", "free", "verdict"),
    [
        (4, 3, Verdict.FEASIBLE),
        (3, 3, Verdict.UNSTABLE),  # only just: areas 1 % larger balance it on the edge
        (3, 5, Verdict.DOUBTFUL),
        (2, 6, Verdict.DOUBTFUL),
    ],
)
def test_overhang_needs_other_masses(supported: int, free: int, verdict: Verdict) -> None:
    """Closed form: the moments about the edge balance when areas differ by the root of their ratio."""
    held, over, beyond = _moments(supported, free)
    part = _only(feasibility(_overhang(supported, free)))
    assert part.verdict is verdict
    assert part.area_factor == pytest.approx(max(1.0, np.sqrt(over / held)), rel=1e-5)
    if verdict is Verdict.DOUBTFUL:
        assert part.mending is not None
        assert part.mending.friction is None  # no friction lifts it
        assert part.mending.off_support == pytest.approx(beyond, rel=1e-6)


def test_long_overhang_is_proved_and_pins_mend_it() -> None:
    """The moments differ by more than AREA_FACTOR squared: no areas within the factor will do."""
    held, over, beyond = _moments(1, 5)
    assert over / held > AREA_FACTOR**2
    part = _only(feasibility(_overhang(1, 5)))
    assert part.verdict is Verdict.INFEASIBLE
    assert part.proof is not None
    assert part.proof.area_factor == AREA_FACTOR
    assert part.mending is not None
    assert part.mending.off_support == pytest.approx(beyond, rel=1e-6)
    assert part.mending.pins_suffice
    mended = feasibility(_overhang(1, 5, pinned=part.mending.pins))
    assert mended.verdict is Verdict.FEASIBLE, mended.summary


def _bunting(height: float) -> Problem:
    """A vertical triangle pinned at two corners, the third ``height`` below them."""
    flag = TriMesh(np.array([[-0.3, 0.0, 0], [0.3, 0, 0], [0, 0, -height]]), np.array([[0, 2, 1]]))
    return Problem(flag, PlainShell(flag).terms(), pinned=[0, 1])


def test_hanging_triangle() -> None:
    """Tension w L / (2 height); as a pendulum it has the stiffness w / height."""
    weight = 0.2 * 0.3 * 0.4 * 9.81 / 3
    part = _only(feasibility(_bunting(0.4)))
    assert part.verdict is Verdict.FEASIBLE
    assert part.state is not None
    assert part.margin is not None
    tension = weight * 0.5 / 0.8
    assert part.state.tension == pytest.approx(tension, rel=1e-6)
    assert part.state.stretch == pytest.approx(tension / 20.0, rel=1e-6)
    assert part.state.energy == pytest.approx(2 * tension**2 * 0.5 / (2 * 20.0), rel=1e-6)
    assert part.state.fold is None
    assert part.margin.eigenvalue == pytest.approx(weight / 0.4, rel=1e-6)


def test_standing_triangle_falls_over() -> None:
    """The same pendulum upside down: compression holds it, and no cut can make it stable."""
    part = _only(feasibility(_bunting(-0.4)))
    assert part.verdict is Verdict.UNSTABLE
    assert part.margin is not None
    assert part.margin.ended == "no solution"
    assert part.margin.eigenvalue == pytest.approx(-0.2 * 0.12 * 9.81 / 3 / 0.4, rel=1e-6)


def test_sheet_without_bending_carries_nothing_across() -> None:
    """A horizontal sheet pinned at its rim: tensions in its plane lift nothing; a proof by hand."""
    flat = grid(3, 2)
    rim = [0, 1, 2, 3, 5, 6, 8, 9, 10, 11]
    limp = Problem(flat, PlainShell(flat, bend=0.0).terms(), pinned=rim)
    part = _only(feasibility(limp))
    assert part.verdict is Verdict.INFEASIBLE
    assert part.reason == "stresses"
    assert part.proof is not None
    assert not part.proof.rigid
    z = part.proof.motion
    along = np.einsum("ei,ei->e", *(_ends(flat.vertices, flat), _ends(z, flat)))
    assert np.abs(along).max() <= 1e-9  # no edge changes its length
    assert np.abs(z[rim]).max() == 0.0
    assert z[:, 2].min() < -0.5  # and something falls
    assert part.mending is not None
    assert set(part.mending.pins) == {4, 7}  # only these two were free
    assert part.mending.pins_suffice
    stiff = Problem(flat, PlainShell(flat, bend=1.0).terms(), pinned=rim)
    assert feasibility(stiff).verdict is Verdict.FEASIBLE


def _ends(values: FloatArray, mesh: TriMesh) -> FloatArray:
    return np.asarray(values[mesh.edges[:, 1]] - values[mesh.edges[:, 0]])


def test_tampered_proofs_are_refused() -> None:
    problem = sheet_on_slope(42.0, 0.5)
    (piece,) = split(problem)
    proof = _only(feasibility(problem)).proof
    assert proof is not None
    bent = proof.motion.copy()
    bent[7] += 1e-5
    rough = piece.touching(replace(piece.contacts, friction=np.full(len(piece.contacts), 1.0)))
    for factor in (np.inf, AREA_FACTOR):
        assert check_proof(piece, 7.0 * proof.motion, factor).holds  # its size does not matter
        assert not check_proof(piece, -proof.motion, factor).holds
        assert not check_proof(piece, np.zeros_like(proof.motion), factor).holds
        refused = check_proof(piece, bent, factor)
        assert not refused.holds
        assert not refused.rigid
        assert refused.strength < STRENGTH
        assert not check_proof(rough, proof.motion, factor).holds


def test_bounds_of_the_masses_are_part_of_the_proof() -> None:
    """The same tilt proves nothing for any masses, and nothing when the supported side is longer."""
    (long,), (short,) = split(_overhang(1, 5)), split(_overhang(1, 3))
    proof = _only(feasibility(_overhang(1, 5))).proof
    assert proof is not None
    assert not check_proof(long, proof.motion, np.inf).holds
    edge = 2  # the first vertices are the same ones in both; the tilt is about vertices 2 and 3
    tilt = np.zeros_like(short.target)
    tilt[:, 2] = short.target[edge, 0] - short.target[:, 0]
    tilt[:, 0] = short.target[:, 2] - short.target[edge, 2]
    assert not check_proof(short, tilt, AREA_FACTOR).holds


def test_soft_material_is_told_from_no_solution() -> None:
    """Folds grow as one over the bending stiffness until no mesh can have them."""
    stiff = _only(feasibility(clamped_page(bend=3e-1)))
    soft = _only(feasibility(clamped_page(bend=1e-4)))
    assert stiff.verdict is Verdict.FEASIBLE
    assert soft.verdict is Verdict.TOO_SOFT
    assert stiff.state is not None
    assert soft.state is not None
    assert stiff.state.fold is not None
    assert soft.state.fold is not None
    assert soft.state.fold > np.pi > 0.1 > stiff.state.fold


def test_what_is_skipped_is_said() -> None:
    weightless = _only(feasibility(clamped_page(gravity=(0.0, 0.0, 0.0))))
    assert weightless.verdict is Verdict.FEASIBLE
    assert any("no weight" in note for note in weightless.notes)
    flat = grid(2, 2)
    nailed = Problem(flat, PlainShell(flat).terms(), pinned=range(9))
    found = feasibility(nailed)
    assert found.verdict is Verdict.FEASIBLE
    assert any("pinned" in sentence for sentence in found.summary)
    hanging = _only(feasibility(upright_sheet([4, 24])))
    assert any("no contacts" in note for note in hanging.notes)


def test_unsupported_shell_falls() -> None:
    flat = grid(2, 2)
    part = _only(feasibility(Problem(flat, PlainShell(flat).terms())))
    assert part.verdict is Verdict.INFEASIBLE
    assert part.mending is not None
    assert part.mending.pins_suffice
    assert part.mending.friction is None


def test_energies_without_measure_are_not_decided() -> None:
    problem = hat_on_ball()
    stretch, bend, gravity = problem.energies
    opaque = (stretch, replace(bend, measure=None), gravity)
    part = _only(feasibility(replace(problem, energies=opaque)))
    assert part.verdict is Verdict.DOUBTFUL
    assert part.reason == "measures"


def test_worst_part_decides() -> None:
    """One square on the floor, one in the air."""
    low = grid(1, 1)
    faces = np.concatenate([low.faces, low.faces + 4])
    points = np.concatenate([low.vertices, low.vertices + np.array([0.0, 0.0, 1.0])])
    pair = TriMesh(points, faces)
    floor = Plane((0, 0, 1), 0.0, friction=0.5)
    found = feasibility(Problem(pair, PlainShell(pair).terms(), (floor,), contact_tolerance=1e-6))
    assert [part.verdict for part in found.parts] == [Verdict.FEASIBLE, Verdict.INFEASIBLE]
    assert found.verdict is Verdict.INFEASIBLE
    assert found.summary[0].startswith("Part with vertex 4 (4 vertices): Proved")
    assert found.record["parts"][1]["mending"]["pins"][0] >= 4


def test_bad_time_is_refused() -> None:
    with pytest.raises(ValueError, match="seconds must be a positive number"):
        feasibility(hat_on_ball(), seconds=0.0)


def _turned(problem: Problem, turn: FloatArray, shift: FloatArray, unit: float) -> Problem:
    """The hat elsewhere, in units of length ``unit`` and of mass 3."""
    target = problem.target.moved(unit * problem.target.vertices @ turn.T + shift)
    g = unit * turn @ np.array([0.0, 0.0, -9.81])
    shell = PlainShell(
        target,
        density=3.0 * 0.2 / unit**2,
        stretch=3.0 * 20.0 * unit,
        bend=3.0 * 3e-3 * unit**2,
        gravity=(float(g[0]), float(g[1]), float(g[2])),
    )
    centre = unit * turn @ np.array([0.0, 0.0, 0.05]) + shift
    head = Sphere(tuple(map(float, centre)), 0.15 * unit, friction=0.5)  # type: ignore[arg-type]
    tolerance = unit * (problem.contact_tolerance or 0.0)
    return Problem(target, shell.terms(), (head,), contact_tolerance=tolerance)


@pytest.mark.parametrize("unit", [1.0, 1e-2, 30.0])
def test_place_and_units_do_not_matter(unit: float) -> None:
    problem = hat_on_ball()
    turn, shift = rotation(1), np.array([1.0, -2.0, 0.5])
    here = _only(feasibility(problem))
    there = _only(feasibility(_turned(problem, turn, shift, unit)))
    assert here.verdict is there.verdict is Verdict.FEASIBLE
    assert here.state is not None
    assert there.state is not None
    assert here.margin is not None
    assert there.margin is not None
    assert there.state.fold == pytest.approx(here.state.fold, rel=1e-4)
    assert there.state.stretch == pytest.approx(here.state.stretch, rel=1e-4)
    assert there.state.energy == pytest.approx(3.0 * unit**2 * here.state.energy, rel=1e-4)
    assert there.margin.scaled == pytest.approx(here.margin.scaled, rel=1e-3)


@settings(max_examples=12, deadline=None, derandomize=True)
@given(
    friction=st.floats(0.02, 1.0),
    tilt=st.floats(0.0, 0.9),
    bend=st.sampled_from([3e-4, 3e-3, 3e-2]),
    seed=st.integers(0, 99),
)
def test_agrees_with_the_solver(friction: float, tilt: float, bend: float, seed: int) -> None:
    """What is solved is feasible; what is proved infeasible is not solved."""
    target = jittered(cap(3, 0.2, 1.2), 5e-4, seed)
    g = 9.81 * np.array([np.sin(tilt), 0.0, -np.cos(tilt)])
    shell = PlainShell(target, bend=bend, gravity=(float(g[0]), 0.0, float(g[2])))
    head = Sphere((0.0, 0.0, 0.05), 0.15, friction=friction)
    problem = Problem(target, shell.terms(), (head,), contact_tolerance=8e-3)
    said, done = feasibility(problem), solve(problem)
    if done.status.certified:
        assert said.verdict is Verdict.FEASIBLE, said.summary
    if said.verdict is Verdict.INFEASIBLE:
        assert not done.status.certified
