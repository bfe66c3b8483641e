"""Coulomb cone: closed forms, optimality of the projection, frames."""

from __future__ import annotations

import clarabel
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import sparse

from casashell.contact.cone import in_polar, inside, margin, project, split, tangents
from casashell.typing import FloatArray

UP = np.array([[0.0, 0.0, 1.0]])
component = st.floats(-1e3, 1e3, allow_subnormal=False)
vector = st.tuples(component, component, component).map(lambda v: np.array([v]))
friction = st.one_of(st.just(0.0), st.floats(1e-9, 1e9), st.floats(0.05, 3.0))
direction = vector.filter(lambda v: float(np.linalg.norm(v)) > 1e-3).map(
    lambda v: v / np.linalg.norm(v)
)


def generators(n: FloatArray, mu: float, count: int = 24) -> FloatArray:
    """Unit vectors of the cone: its edge, its axis and some between."""
    t1, t2 = tangents(n)
    turn = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)[:, None]
    rays = [n + share * mu * (np.cos(turn) * t1 + np.sin(turn) * t2) for share in (0.0, 0.5, 1.0)]
    stacked = np.concatenate(rays)
    return np.asarray(stacked / np.linalg.norm(stacked, axis=1)[:, None])


def test_split_and_margin_by_hand() -> None:
    # by hand: f = (3, 4, 10) on a floor has f_N = 10, |f_T| = 5, so 0.7 * 10 - 5 = 2
    f = np.array([[3.0, 4.0, 10.0]])
    f_n, f_t = split(f, UP)
    assert f_n == pytest.approx(10.0)
    assert f_t == pytest.approx(np.array([[3.0, 4.0, 0.0]]))
    assert margin(f, UP, 0.7) == pytest.approx(2.0)
    assert margin(f, UP, 0.4) == pytest.approx(-1.0)
    assert margin(f, UP, np.array([0.5])) == pytest.approx(0.0)


def test_projection_by_hand() -> None:
    # mu = 1, cone of 45 degrees: (1, 0, 0) falls on the generator (1, 0, 1) / sqrt 2, at half
    f = np.array([[1.0, 0, 0], [0.2, 0, 1.0], [0.5, 0, -2.0], [0, 0, -1.0], [0, 0, 0]])
    want = np.array([[0.5, 0, 0.5], [0.2, 0, 1.0], [0, 0, 0], [0, 0, 0], [0, 0, 0]])
    assert project(f, np.repeat(UP, 5, axis=0), 1.0) == pytest.approx(want, abs=1e-15)


def test_frictionless_projection_keeps_the_push_only() -> None:
    f = np.array([[3.0, 4.0, 10.0], [3.0, 4.0, -10.0], [0.0, 0.0, -1.0]])
    want = np.array([[0.0, 0.0, 10.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    assert np.array_equal(project(f, np.repeat(UP, 3, axis=0), 0.0), want)


@pytest.mark.parametrize("mu", [1e12, 1e200, np.finfo(float).max])
def test_huge_friction_is_a_half_space(mu: float) -> None:
    f = np.array([[3.0, 4.0, 1.0], [3.0, 4.0, -1.0], [0.0, 0.0, -1.0]])
    want = np.array([[3.0, 4.0, 1.0], [3.0, 4.0, 0.0], [0.0, 0.0, 0.0]])
    assert project(f, np.repeat(UP, 3, axis=0), mu) == pytest.approx(want, abs=1e-11)
    assert in_polar(np.array([[0.0, 0.0, -1.0]]), UP, mu).all()


@given(f=vector, n=direction, mu=friction)
def test_projection_is_moreaus(f: FloatArray, n: FloatArray, mu: float) -> None:
    """p in K, f - p in K*, p . (f - p) = 0: necessary and sufficient for the nearest point."""
    p = project(f, n, mu)
    scale = float(np.linalg.norm(f)) + 1e-30
    assert np.isfinite(p).all()
    assert inside(p, n, mu, 1e-13 * scale).all()
    assert in_polar(f - p, n, mu, 1e-13 * scale).all()
    assert abs(float(np.vdot(p, f - p))) <= 1e-13 * scale**2
    # the same without in_polar: no generator of the cone makes progress from p
    assert (generators(n, mu) @ (f - p)[0]).max() <= 1e-12 * scale


@given(f=vector, g=vector, n=direction, mu=friction)
def test_projection_is_idempotent_and_shrinks(
    f: FloatArray, g: FloatArray, n: FloatArray, mu: float
) -> None:
    p, q = project(f, n, mu), project(g, n, mu)
    size = float(np.linalg.norm(f) + np.linalg.norm(g)) + 1e-30
    assert project(p, n, mu) == pytest.approx(p, abs=1e-13 * size)
    assert np.linalg.norm(p - q) <= np.linalg.norm(f - g) + 1e-13 * size


@given(f=vector, n=direction, mu=st.floats(0.05, 3.0))
def test_distance_used_by_inside_is_that_of_the_projection(
    f: FloatArray, n: FloatArray, mu: float
) -> None:
    gap = float(np.linalg.norm(f - project(f, n, mu)))
    slack = 1e-12 * (float(np.linalg.norm(f)) + 1e-30)
    assert inside(f, n, mu, gap + slack).all()
    if gap > 4.0 * slack:
        assert not inside(f, n, mu, gap - 2.0 * slack).any()


def test_projection_agrees_with_a_conic_solver() -> None:
    """Clarabel minimises |x - f|^2 / 2 over the second-order cone, knowing no closed form."""
    rng = np.random.default_rng(7)
    f = rng.normal(size=(40, 3))
    n = rng.normal(size=(40, 3))
    n /= np.linalg.norm(n, axis=1)[:, None]
    mu = rng.uniform(0.0, 2.0, 40)
    t1, t2 = tangents(n)
    rows = np.stack([mu[:, None] * n, t1, t2], axis=1)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix(np.eye(120)),
        -f.reshape(-1),
        sparse.csc_matrix(-sparse.block_diag(list(rows))),
        np.zeros(120),
        [clarabel.SecondOrderConeT(3)] * 40,
        settings,
    )
    reference = np.array(solver.solve().x).reshape(40, 3)
    # interior point accuracy; ecosystem experience is 1e-5 at the default tolerances
    assert project(f, n, mu) == pytest.approx(reference, abs=2e-5)
    moved = np.linalg.norm(reference - f, axis=1) > 1e-3
    assert 5 < moved.sum() < 40


@given(n=direction)
def test_tangents_are_a_right_handed_frame(n: FloatArray) -> None:
    t1, t2 = tangents(n)
    frame = np.concatenate([t1, t2, n])
    assert frame @ frame.T == pytest.approx(np.eye(3), abs=1e-14)
    assert np.linalg.det(frame) == pytest.approx(1.0, abs=1e-14)


def test_tangents_on_the_axes_and_nearby() -> None:
    n = np.concatenate([np.eye(3), -np.eye(3), [[1.0, 0.0, -0.0]]])
    t1, t2 = tangents(n)
    assert np.cross(t1, t2) == pytest.approx(n, abs=1e-15)
    # continuous about -z, where simpler frames jump
    turn = 1e-6 * np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0], [0, -1.0, 0]])
    near = turn - np.array([0.0, 0.0, 1.0])
    t1, _ = tangents(near / np.linalg.norm(near, axis=1)[:, None])
    assert np.ptp(t1, axis=0).max() < 1e-5


@pytest.mark.parametrize(
    ("mu", "message"),
    [
        (-0.1, "contact 0 must be finite and >= 0"),
        (np.nan, "contact 0 must be finite"),
        (np.inf, "contact 0 must be finite"),
        (np.array([0.5, -1.0]), "contact 1 must be finite"),
        (np.array([0.5, 0.5, 0.5]), r"one number or \(2,\)"),
    ],
)
def test_bad_friction_is_named(mu: float, message: str) -> None:
    f = np.ones((2, 3))
    with pytest.raises(ValueError, match=message):
        project(f, np.repeat(UP, 2, axis=0), mu)


def test_bad_shapes_and_normals_are_named() -> None:
    with pytest.raises(ValueError, match=r"shape \(C, 3\)"):
        split(np.ones((2, 3)), UP)
    with pytest.raises(ValueError, match="row 1 is not a unit vector"):
        tangents(np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]]))
    with pytest.raises(ValueError, match="row 0 is not a unit vector"):
        tangents(np.array([[np.nan, 0.0, 1.0]]))


def test_no_contacts_is_no_special_case() -> None:
    none = np.zeros((0, 3))
    assert project(none, none, 0.5).shape == (0, 3)
    assert margin(none, none, np.zeros(0)).shape == (0,)
    assert tangents(none)[0].shape == (0, 3)
