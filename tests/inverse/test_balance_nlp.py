"""The balance program: derivatives, certified answers, and slack where there is no answer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from small_scenes import clamped_page, hat_on_ball, sheet_on_slope, upright_sheet

from casashell.app.builtin import page, skirt
from casashell.contact.cone import margin, split
from casashell.contact.obstacles import Sphere
from casashell.inverse.advice import status_of
from casashell.inverse.balance import Balance
from casashell.inverse.balance_nlp import BalanceNlp
from casashell.inverse.certificate import certify
from casashell.inverse.one_shot import NlpSolver, one_shot
from casashell.inverse.piece import Piece
from casashell.inverse.piece import split as split_pieces
from casashell.inverse.pulled import Pulled
from casashell.problem import Problem
from casashell.result import Certificate, Step
from casashell.status import Status


def _certificate(problem: Problem, piece: Piece, found: Balance) -> Certificate:
    assert len(piece.vertices) == len(problem.target.vertices)
    certificate, _ = certify(
        problem.energies,
        problem.target.vertices,
        problem.target.vertices,
        found.rest + piece.origin,
        problem.contacts,
        found.contact_forces,
        np.asarray(problem.pinned),
        float(problem.target.mean_edge_length),
    )
    return certificate


SMOOTH_HEAD = Sphere((0.0, 0.0, 0.05), 0.15, friction=0.0)

#: Scenes and the iterations they took, with room for other versions of Ipopt and its linear solver.
SCENES = {
    "skirt": (lambda: skirt(8, 26).problem, 7),
    "page": (lambda: page(13, 15).problem, 14),
    "hat": (hat_on_ball, 7),
    "hat without friction": (lambda: hat_on_ball((SMOOTH_HEAD,)), 13),
    "hat with a pin": (lambda: hat_on_ball(pinned=(0,)), 8),
    "pins only": (clamped_page, 15),
    "neither contacts nor weight": (lambda: clamped_page(gravity=(0.0, 0.0, 0.0)), 0),
    "two pins": (lambda: upright_sheet([4, 24]), 3),
}


@pytest.mark.parametrize("name", SCENES)
def test_one_shot_is_certified(name: str) -> None:
    """Thresholds of the project; the certificate shares no code with the program."""
    make, iterations = SCENES[name]
    problem = make()
    (piece,) = split_pieces(problem)
    found = one_shot(piece)
    print(f"{name}: {found.iterations} iterations, {found.seconds:.2f} s, {found.residual:.1e} f0")
    assert found.converged
    assert found.residual <= 1e-8
    assert found.slack == 0.0
    assert found.iterations <= 2 * iterations
    assert np.array_equal(found.rest[piece.pinned], piece.target[piece.pinned])
    certificate = _certificate(problem, piece, found)
    assert certificate.free_force is not None
    assert certificate.free_force <= 1e-8
    if len(piece.contacts):
        room = margin(found.contact_forces, piece.contacts.normals, piece.contacts.friction)
        rough = piece.contacts.friction > 0.0
        assert room[rough].min(initial=np.inf) > 0.0
        assert (certificate.min_normal_force or 0.0) >= 1e-2 * (1.0 - 1e-6)  # the default floor
    assert status_of(certificate) is Status.SOLVED


def test_rounding_does_not_decide_without_friction() -> None:
    """No force turns a smooth hat about its axis: one constraint depends on the others."""
    (piece,) = split_pieces(hat_on_ball((SMOOTH_HEAD,)))
    rng = np.random.default_rng(1)
    for _ in range(4):
        noise = 1.0 + 1e-15 * rng.normal(size=piece.target.shape)
        found = one_shot(replace(piece, target=piece.target * noise))
        assert found.converged
        assert found.iterations <= 30


def test_without_load_the_target_is_its_own_natural_shape() -> None:
    (piece,) = split_pieces(clamped_page(gravity=(0.0, 0.0, 0.0)))
    assert np.array_equal(one_shot(piece).rest, piece.target)


@pytest.mark.parametrize("weight", [None, 2.0])
@pytest.mark.parametrize("friction", [0.5, 0.0])
def test_derivatives_of_the_program(friction: float, weight: float | None) -> None:
    """Gradient, Jacobian and Hessian of the Lagrangian against central differences."""
    head = Sphere((0.0, 0.0, 0.05), 0.15, friction=friction)
    (piece,) = split_pieces(hat_on_ball((head,), pinned=(40,)))
    rng = np.random.default_rng(0)
    pose = piece.target + 1e-2 * piece.h * rng.standard_normal(piece.target.shape)
    program = BalanceNlp(Pulled(piece, 5.0), pose, piece.target, weight=weight)
    forces = piece.f0 * (
        piece.contacts.normals + 0.1 * rng.standard_normal((len(piece.contacts), 3))
    )
    start = program.unknowns(piece.target, forces)
    nlp = program.nlp(start)
    x = start + 1e-2 * rng.standard_normal(len(start))
    y, way = rng.standard_normal(len(nlp.constraint_lower)), rng.standard_normal(len(x))
    step = 1e-6

    def jacobian_transposed(at: np.ndarray) -> np.ndarray:
        total = 0.7 * nlp.objective_gradient(at)
        np.add.at(total, nlp.jacobian_columns, nlp.jacobian(at) * y[nlp.jacobian_rows])
        return total

    def lagrangian(at: np.ndarray) -> float:
        return 0.7 * nlp.objective(at) + float(y @ nlp.constraints(at))

    slope = (lagrangian(x + step * way) - lagrangian(x - step * way)) / (2.0 * step)
    assert jacobian_transposed(x) @ way == pytest.approx(slope, rel=1e-6)
    entries, product = nlp.hessian(x, 0.7, y), np.zeros(len(x))
    rows, columns = nlp.hessian_rows, nlp.hessian_columns
    np.add.at(product, rows, entries * way[columns])
    off = rows != columns
    np.add.at(product, columns[off], entries[off] * way[rows[off]])
    ahead, behind = (jacobian_transposed(x + e * way) for e in (step, -step))
    change = (ahead - behind) / (2.0 * step)
    assert np.abs(product - change).max() <= 1e-6 * np.abs(change).max()


def test_unknowns_are_read_back() -> None:
    (piece,) = split_pieces(hat_on_ball())
    program = BalanceNlp(Pulled(piece, 0.0), piece.target, piece.target)
    rng = np.random.default_rng(1)
    rest = piece.target + 1e-2 * piece.h * rng.standard_normal(piece.target.shape)
    forces = piece.f0 * (
        piece.contacts.normals + 0.1 * rng.standard_normal((len(piece.contacts), 3))
    )
    assert margin(forces, piece.contacts.normals, 0.8 * piece.contacts.friction).min() > 0.0
    found = program.unknowns(rest, forces)
    assert program.rest(found) == pytest.approx(rest, abs=1e-15)
    assert program.contact_forces(found) == pytest.approx(forces, abs=1e-14 * piece.f0)


@pytest.mark.parametrize("friction", [0.1, 0.0])
def test_slippery_slope_needs_slack_and_says_how_much(friction: float) -> None:
    """The cones of 0.975 mu leave sin a - 0.975 mu cos a of the weight to the slack, on average."""
    (piece,) = split_pieces(sheet_on_slope(20.0, friction))
    found = one_shot(piece)
    angle = np.radians(20.0)
    expected = np.sin(angle) - 0.975 * friction * np.cos(angle)
    assert not found.converged
    assert found.status.converged  # the program with slack is solved
    # shrinking sheds a little weight
    assert found.slack == pytest.approx(expected, rel=0.1)
    assert found.residual == pytest.approx(found.slack, rel=1e-6)
    normal, _ = split(found.contact_forces, piece.contacts.normals)
    assert normal.min() >= 0.0
    room = margin(found.contact_forces, piece.contacts.normals, piece.contacts.friction)
    assert room.min() >= -1e-12 * piece.f0
    solver = NlpSolver(piece, lambda step: None)
    outcome = solver.run()
    assert outcome.rung == "nlp with slack"
    assert outcome.obstruction is not None
    assert any("balance lacks" in note for note in solver.notes)


def test_rough_slope_holds() -> None:
    """The control: tan 5 degrees is less than the friction."""
    (piece,) = split_pieces(sheet_on_slope(5.0, 0.5))
    assert one_shot(piece).converged


def test_nothing_that_holds_is_proved_at_once() -> None:
    (piece,) = split_pieces(hat_on_ball(()))
    solver = NlpSolver(piece, lambda step: None)
    outcome = solver.run()
    assert outcome.obstruction is not None
    assert solver.iterations == 0


def test_interrupt_keeps_the_last_iterate() -> None:
    def report(step: Step) -> None:
        if step.iteration == 4:
            raise KeyboardInterrupt

    (piece,) = split_pieces(hat_on_ball())
    solver = NlpSolver(piece, report)
    with pytest.raises(KeyboardInterrupt):
        solver.run()
    outcome = solver.salvage()
    assert not np.array_equal(outcome.rest, piece.target)
    assert 1e-8 < outcome.residual < 1.0
    assert solver.iterations == 4


def test_outcome_of_a_solver_is_good() -> None:
    (piece,) = split_pieces(hat_on_ball())
    solver = NlpSolver(piece, lambda step: None)
    assert solver.run().good
    assert solver.best.good
    assert solver.iterations == solver.factorizations <= 14  # regression: 7


def test_bad_arguments_are_refused() -> None:
    (piece,) = split_pieces(hat_on_ball())
    program = BalanceNlp(Pulled(piece, 0.0), piece.target, piece.target)
    with pytest.raises(ValueError, match="pose must have shape"):
        replace(program, pose=piece.target[:-1])
    with pytest.raises(ValueError, match="floor"):
        replace(program, floor=-1.0)
    with pytest.raises(ValueError, match="beta"):
        replace(program, beta=1.5)
    with pytest.raises(ValueError, match="slack"):
        program.softened(0.0)
