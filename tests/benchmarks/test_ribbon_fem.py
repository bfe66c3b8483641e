"""The finite elements that ribbons are compared with, against closed forms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_bvp
from scipy.sparse.linalg import eigsh

from benchmarks.ribbon_fem import (
    Body,
    FastProjection,
    Guide,
    ImplicitEuler,
    Patch,
    StepFailed,
    conforming,
    drift,
    last_column,
    nonconforming,
    simulate,
    still,
    strip,
)
from benchmarks.ribbon_fem.rod_extension import area_error, exact_error, extended
from casashell.ribbon.chain import Strip
from casashell.ribbon.chain import strip as ribbon_strip
from casashell.typing import FloatArray

Q = 5.0
Build = Callable[[Patch], Body]
BUILDS = pytest.mark.parametrize("build", [conforming, nonconforming])


def cantilever(columns: int, rows: int, weight: float = Q) -> Patch:
    """Strip 1 x 0.1 with D = rho = 1 that hangs from x = 0."""
    return strip(1.0, 0.1, columns, rows, 1.0, 1.0, gravity=(0, 0, -weight), begin=still)


def tip(body: Body, x: FloatArray) -> FloatArray:
    rest = body.patch.mesh.vertices[:, 0]
    made: FloatArray = body.surface(x)[np.isclose(rest, rest.max())].mean(axis=0)
    return made


def elastica(q: float) -> FloatArray:
    """(x, z) of the end of a heavy inextensible cantilever of length 1."""

    def slope(s: FloatArray, y: FloatArray) -> FloatArray:
        return np.stack([y[1], q * (1 - s) * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])])

    def ends(a: FloatArray, b: FloatArray) -> FloatArray:
        return np.array([a[0], b[1], a[2], a[3]])

    s = np.linspace(0, 1, 200)
    made = solve_bvp(slope, ends, s, np.stack([-s, 0 * s, s, 0 * s]), tol=1e-9)
    assert made.success
    end: FloatArray = made.y[2:, -1]
    return end


def at_rest(body: Body) -> FloatArray:
    """Nodes in equilibrium: a damped fall, then one step so long that inertia is nothing."""
    way = ImplicitEuler(body)
    state = way.begin()
    for h in (0.05, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 3.0, 10.0):
        state = way.step(state, h)
    return way.step(replace(state, v=0.0 * state.v), 1000.0).x


@BUILDS
def test_a_heavy_cantilever_converges_to_the_elastica_with_second_order(build: Build) -> None:
    expected = elastica(Q)
    errors = []
    for columns, rows in ((10, 1), (20, 2)):
        body = build(cantilever(columns, rows))
        end = tip(body, at_rest(body))
        assert abs(end[1]) < 1e-3
        errors.append(np.linalg.norm(end[[0, 2]] - expected))
    assert errors[1] < 1.5e-3
    assert np.log2(errors[0] / errors[1]) > 1.8


def test_hinges_alone_let_a_mesh_that_stretches_bend_too_easily() -> None:
    """Dihedral angles on the same mesh sag by 3.8 % of the length more: regression."""
    body = conforming(cantilever(20, 2), bending="hinge")
    sag = elastica(Q)[1] - tip(body, at_rest(body))[2]
    assert sag == pytest.approx(0.0382, abs=2e-3)


@BUILDS
def test_the_first_frequency_of_a_cantilever(build: Build) -> None:
    """1.875104^2 sqrt(D / rho) / L^2, Euler and Bernoulli."""
    body = build(cantilever(40, 4, 0.0))
    _, entries = body.assembly.hessian(body.rest, body.rest)
    out = 3 * np.flatnonzero(body.free) + 2
    stiffness = body.assembly.pattern.matrix(entries)[out][:, out].tocsc()
    inverse = 1.0 / np.sqrt(body.mass[body.free])
    scaled = stiffness.multiply(inverse[:, None]).multiply(inverse).tocsc()
    lowest = float(eigsh(scaled, k=1, sigma=-1.0, return_eigenvectors=False)[0])
    assert np.sqrt(lowest) == pytest.approx(1.875104**2, rel=0.01)


@pytest.mark.parametrize("bending", ["shape", "hinge"])
@pytest.mark.parametrize("diagonals", ["chequered", "parallel"])
def test_a_cylinder_has_its_bending_energy(bending: str, diagonals: str) -> None:
    """D A / (2 R^2); chords make the mesh a little shorter than the arc, not its angles."""
    columns, radius = 40, 0.7
    patch = strip(
        1.0,
        0.1,
        columns,
        3,
        2.0,
        1.0,
        begin=still,
        end=still,
        diagonals=diagonals,
    )
    body = conforming(patch, bending=bending)
    chord = 2.0 * radius * np.sin(0.5 / columns / radius)
    turn = body.rest[:, 0] / radius
    scale = chord * columns
    x = body.rest.copy()
    x[:, 0], x[:, 2] = radius * np.sin(turn), radius * np.cos(turn)
    # Both clamps follow the cylinder as tangents from the middle of their first cell.
    for side, at in ((body.rest[:, 0] < -1e-9, 0.0), (body.rest[:, 0] > 1 + 1e-9, 1.0)):
        along = (body.rest[side, 0] - at)[:, None] * np.array(
            [np.cos(at / radius), 0.0, -np.sin(at / radius)]
        )
        x[side] = (
            np.array([radius * np.sin(at / radius), 0.0, radius * np.cos(at / radius)]) + along
        )
        x[side, 1] = body.rest[side, 1]
    bent = body.energy(x) - body.forms.energy(x)
    assert scale == pytest.approx(1.0, rel=1e-4)
    assert bent == pytest.approx(2.0 * 0.1 / (2 * radius**2), rel=1e-3)


def test_membranes_cost_the_energy_of_green_strain() -> None:
    """A Y / 2 |G|^2 of the deformation x -> F x, G = (F^T F - 1) / 2."""
    body = conforming(strip(1.0, 0.4, 4, 3, 1.0, 1.0), membrane=30.0)
    slope = np.array([[1.1, 0.2, 0.0], [-0.1, 0.9, 0.0], [0.3, 0.1, 1.0]])
    strain = 0.5 * (slope.T @ slope - np.eye(3))[:2, :2]
    expected = 0.4 * 30.0 / 2 * float((strain**2).sum())
    assert body.forms.energy(body.rest @ slope.T) == pytest.approx(expected, rel=1e-12)


def test_nonconforming_triangles_do_not_change_and_conforming_ones_hardly() -> None:
    for body, least in (
        (nonconforming(cantilever(20, 2)), 1e-12),
        (conforming(cantilever(20, 2)), 1e-5),
    ):
        film = simulate(ImplicitEuler(body), 20, 0.02)
        assert film.elements.max() < least
        assert np.all(film.moves <= 1e-8)
        assert film.seconds.shape == film.iterations.shape == (20,)
        assert tip(body, film.nodes[-1])[2] < -0.1


def test_the_surface_drawn_from_midpoints_is_not_isometric() -> None:
    """Fast projection keeps the triangles; averaged vertices change lengths (Pan et al. 2016, Sec. 6)."""
    body = nonconforming(cantilever(20, 2))
    film = simulate(FastProjection(body), 20, 0.02)
    assert film.elements.max() < 1e-7
    assert 1e-4 < film.drawn[-1, 0] < 0.1
    reference = simulate(ImplicitEuler(body), 20, 0.02)
    away = np.linalg.norm(tip(body, film.nodes[-1]) - tip(body, reference.nodes[-1]))
    assert away < 5e-3


def test_free_fall_is_that_of_implicit_euler() -> None:
    """g h^2 n (n + 1) / 2, no deformation."""
    for build in (conforming, nonconforming):
        body = build(strip(1.0, 0.2, 5, 1, 1.0, 1.0, gravity=(0, 0, -10.0)))
        film = simulate(ImplicitEuler(body), 4, 0.1)
        fallen = film.nodes[-1] - body.rest
        np.testing.assert_allclose(fallen, np.broadcast_to([0, 0, -1.0], fallen.shape), atol=1e-9)


def test_guided_normals_twist_a_strip_by_as_much() -> None:
    """The end turns to the direction asked for, up to what the stiffness of the strip resists."""
    patch = strip(2.0, 0.2, 10, 1, 1e-3, 1.0, begin=still)

    def normal(time: float) -> FloatArray:
        angle = 0.5 * min(time, 1.0)
        return np.array([0.0, -np.sin(angle), np.cos(angle)])

    body = conforming(replace(patch, guides=(Guide(last_column(patch), normal, 10.0),)))
    film = simulate(ImplicitEuler(body), 30, 0.1)
    corners = body.corners(film.nodes[-1])[last_column(patch)]
    n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).sum(axis=0)
    np.testing.assert_allclose(n / np.linalg.norm(n), normal(3.0), atol=0.02)
    assert drift(body, body.corners(film.nodes[-1])).length < 1e-3


def twisted(segments: int, torsion: float, curvature: float, width: float) -> Strip:
    """A ribbon of length 1 wrapped on a cylinder: constant slopes and angles."""
    c = np.full(segments + 1, torsion / curvature)
    beta = np.full(segments + 1, curvature * np.sqrt(1 + c[0] ** 2) / segments)
    c[0] = c[-1] = beta[0] = beta[-1] = 0.0
    return ribbon_strip(1.0, width, c, beta, np.eye(3), np.zeros(3))


def test_a_strip_extended_from_its_rod_has_too_much_area() -> None:
    """Torsion 4, W = 0.2: (tau W)^2 / 24 = 2.7 % to first order; the ribbon's own area is exact."""
    shape = twisted(400, 4.0, 8.0, 0.2)
    inner = slice(5, -5)
    length = 390 / 400
    wrong = area_error(*(rim[inner] for rim in extended(shape)), length * 0.2)
    assert wrong == pytest.approx(exact_error(4.0, 0.2), rel=0.02)
    assert exact_error(4.0, 0.2) == pytest.approx(0.64 / 24, rel=0.05)
    ours = area_error(shape.bottom[inner], shape.top[inner], length * 0.2)
    assert abs(ours) < 1e-12


def test_what_cannot_be_asked_for() -> None:
    patch = cantilever(4, 2)
    with pytest.raises(ValueError, match="no links"):
        FastProjection(conforming(patch))
    with pytest.raises(ValueError, match="membrane"):
        conforming(patch, membrane=0.0)
    with pytest.raises(ValueError, match="gap"):
        nonconforming(patch, gap=-1.0)
    with pytest.raises(ValueError, match="positive sizes"):
        strip(1.0, 0.0, 4, 2, 1.0, 1.0)
    with pytest.raises(ValueError, match="nodes"):
        ImplicitEuler(conforming(patch)).begin(np.zeros((3, 3)))
    squeezed = strip(
        1.0, 0.1, 4, 1, 1.0, 1.0, begin=still, end=lambda t: (np.eye(3), np.array([0.5 * t, 0, 0]))
    )
    way = ImplicitEuler(nonconforming(squeezed))
    with pytest.raises(StepFailed):
        way.step(way.begin(), 0.1)
