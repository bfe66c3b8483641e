"""Draping: closed forms, saddle points, several minima, robustness."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from chains import chain, with_nodes
from meshes import grid
from plain_shell import PlainShell
from scipy.optimize import brentq
from small_scenes import clamped_page

from casashell.engine import sparse_solver
from casashell.inverse import free_system
from casashell.inverse.drape import METHODS, Draped, DrapeMethod, Draper, drape
from casashell.inverse.piece import Piece, split
from casashell.inverse.pulled import Pulled
from casashell.problem import Problem
from casashell.solving import solve
from casashell.typing import FloatArray, IntArray

LINK, STRETCH, WEIGHT = 0.1, 2.0, 0.05
both = pytest.mark.parametrize("method", METHODS)


def _hung(n: int, sign: float) -> FloatArray:
    """Chain of n links below (sign -1) or above (+1) node 0, each carrying the nodes beyond it."""
    carried = WEIGHT * np.arange(n, 0, -1)
    lengths = LINK * (1.0 - sign * carried / STRETCH)
    height = sign * np.concatenate([[0.0], np.cumsum(lengths)])
    return np.stack([0.0 * height, 0.0 * height, height], axis=1)


def _chain(n: int) -> tuple[Piece, FloatArray, IntArray]:
    piece, rest = chain(np.full(n, LINK), STRETCH, WEIGHT)
    return piece, rest, np.append(piece.pinned, 0)


@both
def test_hanging_chain_is_stretched_by_its_own_weight(method: DrapeMethod) -> None:
    """Link j from below carries j nodes: it is longer by LINK j WEIGHT / STRETCH."""
    piece, rest, fixed = _chain(8)
    known = _hung(8, -1.0)
    start = with_nodes(piece, known * 0.7 + 0.02 * np.sin(np.arange(9.0))[:, None] * [1, 1, 0])
    start[0] = known[0]
    draped = drape(Pulled(piece, 0.0), rest, start, fixed, method=method)
    assert draped.good
    assert draped.residual <= 1e-9
    assert np.abs(draped.pose[:9] - known).max() <= 1e-8 * LINK
    assert np.array_equal(draped.pose[fixed], start[fixed])


@both
def test_saddle_start_is_left(method: DrapeMethod) -> None:
    """A chain that stands on its end is in balance, but only hanging is it a minimum."""
    piece, rest, fixed = _chain(6)
    start = with_nodes(piece, _hung(6, 1.0))
    pulled = Pulled(piece, 0.0)
    force = np.delete(pulled.gradient(start, rest), fixed, axis=0)
    assert np.abs(force).max() <= 1e-12 * WEIGHT  # in balance indeed
    draped = drape(pulled, rest, start, fixed, method=method)
    assert draped.good
    assert np.abs(draped.pose[:7] - _hung(6, -1.0)).max() <= 1e-7 * LINK


def _sag(n: int) -> float:
    """Sag of a nearly inextensible chain of n links, 1 m long, over a span of 0.6 m.

    The stiffest links strain by 1e-5 at most; they start from the pose of softer ones.
    """
    s = np.linspace(-1.0, 1.0, n + 1)
    nodes = np.stack([0.3 * s, 0.0 * s, 0.2 * (s * s - 1.0)], axis=1)
    for stretch in (1e2, 1e4, 1e6):
        piece, rest = chain(np.full(n, 1.0 / n), stretch, 1.0 / n)
        fixed = np.concatenate([piece.pinned, [0, n]])
        draped = drape(Pulled(piece, 0.0), rest, with_nodes(piece, nodes), fixed)
        assert draped.good
        nodes = draped.pose[: n + 1]
    return float(-nodes[:, 2].min())


def test_chain_tends_to_the_catenary() -> None:
    """Length 2 c sinh(a / 2c) = 1 over the span a = 0.6; the sag converges with order 2."""
    c = brentq(lambda c: 2.0 * c * np.sinh(0.3 / c) - 1.0, 0.05, 1.0)
    exact = c * (np.cosh(0.3 / c) - 1.0)
    errors = [abs(_sag(n) - exact) for n in (8, 16, 32)]
    for coarse, fine in pairwise(errors):
        assert coarse / fine == pytest.approx(4.0, rel=0.1)


@both
def test_drape_of_a_found_shape_returns_to_the_target(method: DrapeMethod) -> None:
    problem = clamped_page()
    rest = solve(problem).require().rest
    (piece,) = split(problem)
    noise = 0.1 * piece.h * np.random.default_rng(0).standard_normal(piece.target.shape)
    noise[piece.pinned] = 0.0
    draped = drape(
        Pulled(piece, 0.0), rest - piece.origin, piece.target + noise, piece.held, method=method
    )
    assert draped.good
    assert np.abs(draped.pose - piece.target).max() <= 1e-7 * piece.h


class _Watched(Pulled):
    """Records the energy of every pose that is stepped to: those whose Hessian is asked for."""

    energies: list[float]

    def hessian(self, x: FloatArray, r: FloatArray) -> tuple[FloatArray, FloatArray]:
        self.energies.append(self.energy(x, r))
        return super().hessian(x, r)


def _cloth(pull: float = 0.0) -> _Watched:
    """A flat cloth that lies on the nine vertices in its middle."""
    flat = grid(8, 8, 0.05, 0.05)
    middle = [9 * i + j for i in (3, 4, 5) for j in (3, 4, 5)]
    terms = PlainShell(flat, density=0.3, stretch=30.0, bend=3e-4).terms()
    (piece,) = split(Problem(flat, terms, pinned=middle))
    watched = _Watched(piece, pull)
    watched.energies = []
    return watched


def _folded(piece: Piece, waves: float, phase: float) -> FloatArray:
    """The cloth with waves around its middle."""
    flat = piece.target - piece.target[piece.pinned].mean(axis=0)
    away = np.maximum(np.linalg.norm(flat, axis=1) - 0.075, 0.0)
    pose = piece.target.copy()
    turn = np.arctan2(flat[:, 1], flat[:, 0])
    pose[:, 2] += away * (0.4 * np.cos(waves * turn + phase) - 0.5)
    pose[piece.pinned] = piece.target[piece.pinned]
    return pose


@both
def test_energy_never_rises(method: DrapeMethod) -> None:
    cloth = _cloth()
    drape(cloth, cloth.piece.target, _folded(cloth.piece, 4, 0.3), cloth.piece.held, method=method)
    assert len(cloth.energies) > 5
    assert np.diff(cloth.energies).max() <= 1e-13 * abs(cloth.energies[-1])


def _two_drapes(cloth: Pulled) -> tuple[Draped, Draped]:
    """Drapes from a start folded about one axis, and from the same start folded about the other."""
    draper = Draper(cloth, cloth.piece.held)
    rest = cloth.piece.target
    first = draper.drape(rest, _folded(cloth.piece, 2, 0.0))
    second = draper.drape(rest, _folded(cloth.piece, 2, np.pi))
    assert first.good
    assert second.good
    return first, second


def test_one_natural_shape_has_several_drapes() -> None:
    """The situation of Ly 2018, Fig. 4: the start decides which pose is found.

    The starts are mirror images in x = y, as the mesh is of itself; so the poses must be too.
    """
    cloth = _cloth()
    first, second = _two_drapes(cloth)
    assert np.abs(first.pose - second.pose).max() > 2.0 * cloth.piece.h
    ids = np.arange(81).reshape(9, 9).T.ravel()
    mirrored = (first.pose - first.pose[40])[ids][:, [1, 0, 2]] + first.pose[40]
    assert np.abs(mirrored - second.pose).max() <= 1e-8


def test_strong_pull_leaves_one_drape() -> None:
    """The pull makes the energy convex around the target (Ly 2018, Sec. 5.3)."""
    first, second = _two_drapes(_cloth(1000.0))
    assert np.abs(first.pose - second.pose).max() <= 1e-9


def test_both_methods_end_in_the_same_minimum() -> None:
    cloth = _cloth()
    start = _folded(cloth.piece, 2, 0.0)
    near = drape(cloth, cloth.piece.target, start, cloth.piece.held).pose
    poses = [
        drape(cloth, cloth.piece.target, near + 1e-3 * (start - near), cloth.piece.held, method=m)
        for m in METHODS
    ]
    assert all(found.good for found in poses)
    assert np.abs(poses[0].pose - poses[1].pose).max() <= 1e-8


def test_one_analysis_for_all_drapes(monkeypatch: pytest.MonkeyPatch) -> None:
    made = []

    def counted(*args: object) -> sparse_solver.SparseSolver:
        made.append(args)
        return sparse_solver.make_solver(*args)  # type: ignore[arg-type]

    monkeypatch.setattr(free_system, "make_solver", counted)
    cloth = _cloth()
    draper = Draper(cloth, cloth.piece.held)
    start = _folded(cloth.piece, 2, 0.0)
    first = draper.drape(cloth.piece.target, start)
    draper.pulled = Pulled(cloth.piece, 5.0)
    second = draper.drape(cloth.piece.target * 1.01, first.pose, method="newton-cg")
    assert len(made) == 1
    assert draper.factorizations == first.factorizations + second.factorizations


@both
def test_near_a_minimum_few_factorizations_do(method: DrapeMethod) -> None:
    """A clamped page released under a tenth of its weight: regression, 5 and 2 when written."""
    (piece,) = split(clamped_page(gravity=(0.0, 0.0, -1.0)))
    draped = drape(Pulled(piece, 0.0), piece.target, piece.target, piece.held, method=method)
    assert draped.good
    assert draped.factorizations <= {"newton": 7, "newton-cg": 3}[method]


@both
def test_what_is_not_finite_is_reported(method: DrapeMethod) -> None:
    (piece,) = split(clamped_page())
    pulled = Pulled(piece, 0.0)
    broken = piece.target.copy()
    broken[-1] = np.nan
    collapsed = np.zeros_like(piece.target)
    for rest, start in ((piece.target, broken), (collapsed, piece.target)):
        draped = drape(pulled, rest, start, piece.held, method=method)
        assert not draped.good
        assert not draped.converged
        assert draped.residual == np.inf


class _Walled(Pulled):
    """The energy is not a number beyond a wall, here one that a hanging chain swings against."""

    met = 0

    def energy(self, x: FloatArray, r: FloatArray) -> float:
        if x[:9, 2].min() < -0.95:
            self.met += 1
            return np.nan
        return super().energy(x, r)


@both
def test_steps_into_nan_are_cut(method: DrapeMethod) -> None:
    """The chain hangs down to -0.89 m; on its way from a horizontal start it would overshoot."""
    piece, rest, fixed = _chain(8)
    assert -0.95 < _hung(8, -1.0)[-1, 2] < -0.85
    start = with_nodes(piece, _hung(8, -1.0)[:, [2, 1, 0]] * [-0.5, 1.0, 1.0])
    start[:9, 2] = -1e-3 * np.arange(9)
    walled = _Walled(piece, 0.0)
    draped = drape(walled, rest, start, fixed, method=method)
    assert walled.met > 0
    assert draped.good
    assert np.abs(draped.pose[:9] - _hung(8, -1.0)).max() <= 1e-7 * LINK


def test_nothing_holds_the_shell() -> None:
    """A sheet in free fall has no pose; with a pull it has one."""
    flat = grid(3, 3)
    (piece,) = split(Problem(flat, PlainShell(flat).terms()))
    falling = drape(Pulled(piece, 0.0), piece.target, piece.target, [])
    assert not falling.good
    held = drape(Pulled(piece, 1.0), piece.target, piece.target, [])
    assert held.good
    sunk = (held.pose - piece.target)[:, 2].sum()  # pull 1 N/m: the weight in newtons is the sum
    assert sunk == pytest.approx(piece.loads[:, 2].sum(), rel=1e-6)


def test_everything_fixed_is_a_pose() -> None:
    (piece,) = split(clamped_page())
    draped = drape(Pulled(piece, 0.0), piece.target, piece.target, np.arange(len(piece.target)))
    assert draped.good
    assert draped.residual == 0.0


def test_arguments_are_checked() -> None:
    (piece,) = split(clamped_page())
    with pytest.raises(ValueError, match="fixed vertex 99 does not exist"):
        Draper(Pulled(piece, 0.0), [99])
    with pytest.raises(ValueError, match="drape method must be one of newton, newton-cg"):
        drape(Pulled(piece, 0.0), piece.target, piece.target, [0], method="euler")  # type: ignore[arg-type]
