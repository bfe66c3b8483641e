"""Densities of a ribbon: closed forms of one crease, one quad, one interval."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from formulations import ribbon_energy, ribbon_inertia
from formulations.ribbon_energy import EDGE


def value(density: ca.Function, x: object, p: object) -> float:
    """A density at x (3,k) with parameters p."""
    columns = np.asarray(x, dtype=float)
    return float(density(columns, 0 * columns, np.asarray(p, dtype=float)))


def wunderlich(y: float) -> float:
    """Factor of the density over Sadowsky's at y = W/2 dc/ds, for W = 1, span = 1."""
    x = np.zeros((3, 3))
    x[0, 0], x[0, 2], x[1, 1] = -y, y, 1.0
    return value(ribbon_energy.wunderlich(), x, [1, 1, 1, 0, 1]) / 0.5


@pytest.mark.parametrize("y", [0.0, 1e-4, 0.01, 0.0316, 0.032, 0.2, 0.7, 0.969])
def test_wunderlich_is_the_integral_over_the_ruling(y: float) -> None:
    """The mean of 1 / (1 + 2 y v) over -1/2 < v < 1/2 is atanh(y) / y."""
    wanted = np.arctanh(y) / y if y else 1.0
    assert wunderlich(y) == pytest.approx(wanted, rel=1e-14)


def test_wunderlich_goes_on_beyond_crossing_rulings() -> None:
    """Value and slope in y^2 go on across the edge; no NaN at or beyond |y| = 1."""
    at, step = EDGE**2, 1e-6
    below, edge, above = (wunderlich(np.sqrt(at + k * step)) for k in (-1, 0, 1))
    assert above - edge == pytest.approx(edge - below, rel=1e-3)
    assert np.isfinite([wunderlich(1.0), wunderlich(1.5)]).all()
    assert wunderlich(1.5) > wunderlich(1.0) > wunderlich(0.99) > wunderlich(EDGE)


def test_sadowsky_of_one_crease() -> None:
    """D W / (2 h) (beta - betabar)^2 (1 + c^2)."""
    x = np.array([[0.5], [0.3], [0.0]])
    found = value(ribbon_energy.sadowsky(), x, [2.0, 0.1, 0.05, 0.1])
    assert found == pytest.approx(2.0 * 0.1 / 0.1 * 0.2**2 * 1.25, rel=1e-15)


def quad(first: float, second: float, length: float, width: float) -> np.ndarray:
    """Columns (c, c, b, b, t, t) of a flat quad that begins at the origin."""
    x = np.zeros((3, 6))
    x[0, :2] = first, second
    for column, station, side in ((2, 0, -1), (3, 1, -1), (4, 0, 1), (5, 1, 1)):
        c = (first, second)[station]
        x[:2, column] = station * length + side * c * width / 2, side * width / 2
    return x


def polygon_moments(x: np.ndarray) -> tuple[float, np.ndarray]:
    """Area and first moments (2,) of the quad by the shoelace formulas."""
    p = x[:2, [2, 3, 5, 4]].T
    q = np.roll(p, -1, axis=0)
    crossed = p[:, 0] * q[:, 1] - q[:, 0] * p[:, 1]
    return crossed.sum() / 2, ((p + q) * crossed[:, None]).sum(axis=0) / 6


def test_gravity_is_exact_for_a_trapezoid() -> None:
    x = quad(0.3, -0.2, 0.1, 0.2)
    area, moments = polygon_moments(x)
    assert area == pytest.approx(0.1 * 0.2, rel=1e-14)
    for axis in range(2):
        g = np.eye(3)[axis]
        found = value(ribbon_energy.gravity(), x, [3.0, 0.1, 0.2, *g])
        assert found == pytest.approx(-3.0 * moments[axis], rel=1e-13)


def motion(x: np.ndarray, field: np.ndarray, length: float, width: float, rho: float) -> float:
    """Kinetic term with h = 1 of a quad whose points have moved by field @ (s, y, 1)."""
    history = []
    for side in (-1, -1, 1, 1):
        # The former shapes: material points minus half the motion each, as 2 x^n - x^{n-1}.
        offset = np.array([0.0, side * width / 2, 0.0])
        moved = field @ np.array([0.0, side * width / 2, 1.0])
        piece = np.zeros((3, 4))
        piece[:, 0], piece[:, 1] = offset - moved, np.array([1.0, 0, 0]) - field[:, 0]
        still = np.zeros((3, 4))
        still[:, 0], still[:, 1] = piece[:, 0], piece[:, 1]
        history += [0.0, *piece.ravel(order="F"), 0.0, *still.ravel(order="F")]
    p = [rho, length, width, 1.0, 0.0, *history]
    return value(ribbon_inertia.consistent(), x, p)


def test_inertia_is_exact_for_rigid_motions() -> None:
    """Translation gives the mass, rotation about the origin the polar moment of the trapezoid."""
    length, width, rho = 0.1, 0.2, 3.0
    x = quad(0.3, -0.2, length, width)
    translation = np.zeros((3, 3))
    translation[2, 2] = 1.0
    assert motion(x, translation, length, width, rho) == pytest.approx(rho * 0.02 / 2, rel=1e-13)
    spin = np.zeros((3, 3))
    spin[0, 1], spin[1, 0] = -1.0, 1.0
    # Integral of s^2 + y^2: rulings s0(y) = 0.3 y and s1(y) = 0.1 - 0.2 y.
    y, w = np.polynomial.legendre.leggauss(8)
    y, w = y * width / 2, w * width / 2
    begin, end = 0.3 * y, length - 0.2 * y
    polar = w @ ((end**3 - begin**3) / 3 + y**2 * (end - begin))
    assert motion(x, spin, length, width, rho) == pytest.approx(rho * polar / 2, rel=1e-13)


def test_lumped_mass_sees_the_centre_only() -> None:
    x = np.array([[0.0, 2.0], [1.0, -1.0], [0.0, 0.0]])
    found = value(ribbon_inertia.lumped(), x, [2.0, 0.5, 0.0, 0.0, 0.0])
    assert found == pytest.approx(2.0 / (2 * 0.25) * 1.0)


def test_pieces_reproduce_polynomials() -> None:
    """Linear: straight lines.  Hermite with three-point tangents: parabolas, on uneven knots."""
    s = np.array([-0.3, 0.1, 0.4, 1.1])
    line = np.stack([1 + 2 * s, -s, 3 + 0 * s])
    parabola = line + np.stack([s**2, 2 * s**2, -(s**2)])
    u = np.array([0.0, 0.1, 0.3])
    for piece, shape in (
        (ribbon_inertia.linear_piece(), line),
        (ribbon_inertia.hermite_piece(), parabola),
    ):
        found = np.array(piece(s, shape)) @ np.stack([u**k for k in range(4)])
        wanted = np.stack([np.polyval(np.polyfit(s, row, 2), s[1] + u) for row in shape])
        np.testing.assert_allclose(found, wanted, atol=1e-13)
