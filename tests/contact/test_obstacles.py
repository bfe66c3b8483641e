"""Signed distances of analytic obstacles: closed forms, gradients, exactness, singular points."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from casashell.contact.obstacles import Capsule, Cone, Cylinder, Obstacle, Plane, Sphere, checked
from casashell.typing import FloatArray

TILT = (0.3, -0.5, 0.8)
SHAPES: list[Obstacle] = [
    Plane((1.0, 2.0, -2.0), 0.9),
    Sphere((0.1, -0.2, 0.3), 0.7),
    Cylinder((0.1, 0.2, -0.3), TILT, 0.4),
    Cylinder((0.1, 0.2, -0.3), TILT, 0.4, 0.9),
    Cylinder((0.1, 0.2, -0.3), TILT, 0.9, 0.2),
    Cone((0.1, 0.2, -0.3), TILT, 0.4),
    Cone((0.1, 0.2, -0.3), TILT, 0.4, 0.9),
    Cone((0.1, 0.2, -0.3), TILT, 1.3, 0.2),
    Capsule((-0.3, 0.1, 0.2), (0.5, 0.4, -0.1), 0.3),
    Capsule((-0.3, 0.1, 0.2), (-0.3, 0.1, 0.2), 0.3),
]
every_shape = pytest.mark.parametrize("shape", SHAPES, ids=lambda s: type(s).__name__)
FINITE = [shape for shape in SHAPES if shape.bounding_box() is not None]


def cloud(count: int = 4000, seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).uniform(-1.5, 1.5, (count, 3))


@every_shape
def test_normal_is_the_gradient(shape: Obstacle) -> None:
    x, h = cloud(), 1e-6
    _, normal = shape.signed_distance(x)
    gradient, smooth = np.empty_like(x), np.ones(len(x), dtype=bool)
    for k, step in enumerate(h * np.eye(3)):
        after, n_after = shape.signed_distance(x + step)
        before, n_before = shape.signed_distance(x - step)
        gradient[:, k] = (after - before) / (2.0 * h)
        # a kink between the two: central differences mean nothing there
        smooth &= np.linalg.norm(n_after - n_before, axis=1) < 1e-3
    assert smooth.mean() > 0.98
    # h^2 / 6 times a third derivative of order 1 / rho^2, and rounding 1e-16 / h
    assert np.abs(gradient - normal)[smooth].max() < 1e-6


@every_shape
def test_distance_is_exact(shape: Obstacle) -> None:
    """x - d n is on the surface at distance |d|, and nothing on the surface is nearer."""
    x = cloud()
    distance, normal = shape.signed_distance(x)
    assert np.linalg.norm(normal, axis=1) == pytest.approx(1.0, abs=1e-14)
    foot = x - distance[:, None] * normal
    assert np.abs(shape.signed_distance(foot)[0]).max() < 1e-14
    # a distance changes by no more than the way between two points
    i, j = np.random.default_rng(1).integers(0, len(x), (2, 20000))
    way = np.linalg.norm(x[i] - x[j], axis=1)
    assert (np.abs(distance[i] - distance[j]) <= way + 1e-14).all()
    assert (distance < 0.0).any()
    assert (distance > 0.0).any()


def profile_distance(profile: FloatArray, s: FloatArray, rho: FloatArray) -> FloatArray:
    """Unsigned distance to a polyline in the half-plane, by its points alone."""
    gaps = [np.hypot(profile[:, 0] - a, profile[:, 1] - b).min() for a, b in zip(s, rho)]
    return np.array(gaps)


def polyline(*corners: tuple[float, float]) -> FloatArray:
    ends = np.array(corners)
    share = np.linspace(0.0, 1.0, 8001)[:, None]
    return np.concatenate([a + share * (b - a) for a, b in pairwise(ends)])


@pytest.mark.parametrize(
    ("shape", "profile", "within"),
    [
        (
            Cylinder((0, 0, 0), (0, 0, 1), 0.4, 0.9),
            polyline((0.0, 0.0), (0.0, 0.4), (0.9, 0.4), (0.9, 0.0)),
            lambda s, rho: (s > 0.0) & (s < 0.9) & (rho < 0.4),
        ),
        (
            Cone((0, 0, 0), (0, 0, 1), math.atan(0.5), 0.8),
            polyline((0.0, 0.0), (0.8, 0.4), (0.8, 0.0)),
            lambda s, rho: (s < 0.8) & (rho < 0.5 * s),
        ),
        (
            Cone((0, 0, 0), (0, 0, 1), math.atan(4.0), 0.2),
            polyline((0.0, 0.0), (0.2, 0.8), (0.2, 0.0)),
            lambda s, rho: (s < 0.2) & (rho < 4.0 * s),
        ),
        (
            Cone((0, 0, 0), (0, 0, 1), math.atan(0.5)),
            polyline((0.0, 0.0), (4.0, 2.0)),
            lambda s, rho: rho < 0.5 * s,
        ),
    ],
)
def test_distance_against_the_sampled_profile(
    shape: Obstacle,
    profile: FloatArray,
    within: Callable[[FloatArray, FloatArray], FloatArray],
) -> None:
    """The surface of revolution, sampled along its meridian: needs no formula for the distance."""
    x = cloud(400)
    s, rho = x[:, 2], np.hypot(x[:, 0], x[:, 1])
    want = profile_distance(profile, s, rho) * np.where(within(s, rho), -1.0, 1.0)
    # samples are at most 4.5 / 8000 apart
    assert shape.signed_distance(x)[0] == pytest.approx(want, abs=3e-4)


def test_plane_by_hand() -> None:
    plane = Plane((0.0, 3.0, 4.0), 10.0)
    assert plane.normal == pytest.approx((0.0, 0.6, 0.8))
    assert plane.offset == pytest.approx(2.0)
    distance, normal = plane.signed_distance([[5.0, 2.0, 1.0], [0.0, 0.0, 0.0]])
    assert distance == pytest.approx([0.0, -2.0])
    assert normal == pytest.approx(np.tile([0.0, 0.6, 0.8], (2, 1)))
    assert Plane((0, 0, 1e-200), 3e-200).offset == pytest.approx(3.0)


def test_round_shapes_by_hand() -> None:
    assert Sphere((1, 0, 0), 2.0).signed_distance([[4.0, 4.0, 0.0]])[0] == pytest.approx([3.0])
    # corner of a capped cylinder: 3 beyond the cap, 4 beyond the side
    rod = Cylinder((0, 0, 0), (0, 0, 9.0), 1.0, 2.0)
    distance, normal = rod.signed_distance([[5.0, 0, 5.0], [0.0, 0.5, -1.0], [0, 0.9, 1.0]])
    assert distance == pytest.approx([5.0, 1.0, -0.1])
    assert normal == pytest.approx(np.array([[0.8, 0, 0.6], [0, 0, -1], [0, 1, 0]]))
    # a bar from (0,0,0) to (4,0,0): behind its end the end point counts
    bar = Capsule((0, 0, 0), (4, 0, 0), 0.5)
    distance, normal = bar.signed_distance([[-3.0, 4.0, 0.0], [2.0, 0.0, 0.2]])
    assert distance == pytest.approx([4.5, -0.3])
    assert normal == pytest.approx(np.array([[-0.6, 0.8, 0], [0, 0, 1]]))
    # 45 degrees: the point (s, rho) = (1, 2) is 1 / sqrt 2 off the side
    cone = Cone((0, 0, 0), (0, 0, 1), math.pi / 4)
    distance, normal = cone.signed_distance([[2.0, 0, 1.0], [0, 0, -3.0], [0, 0, 1.0]])
    assert distance == pytest.approx([math.sqrt(0.5), 3.0, -math.sqrt(0.5)])
    assert normal[:2] == pytest.approx(np.array([[math.sqrt(0.5), 0, -math.sqrt(0.5)], [0, 0, -1]]))


@every_shape
def test_singular_points_have_a_fixed_unit_normal(shape: Obstacle) -> None:
    axis = np.array(TILT) / np.linalg.norm(TILT)
    along = np.linspace(-1.0, 1.5, 11)[:, None] * axis + np.array([0.1, 0.2, -0.3])
    ends = np.array([[-0.3, 0.1, 0.2], [0.5, 0.4, -0.1]])
    x = np.concatenate([[[0.1, -0.2, 0.3]], along, ends, ends.mean(axis=0)[None]])
    distance, normal = shape.signed_distance(x)
    assert np.isfinite(distance).all()
    assert np.linalg.norm(normal, axis=1) == pytest.approx(1.0, abs=1e-14)
    assert np.array_equal(normal, shape.signed_distance(x.copy())[1])
    # the foot is still on the surface: any of the nearest points will do
    assert np.abs(shape.signed_distance(x - distance[:, None] * normal)[0]).max() < 1e-14


def test_edges_and_apex_have_a_normal() -> None:
    rod = Cylinder((0, 0, 0), (0, 0, 1), 1.0, 2.0)
    peak = Cone((0, 0, 0), (0, 0, 1), 0.5, 1.0)
    rim = [[math.tan(0.5), 0.0, 1.0]]
    for shape, x in ((rod, [[1.0, 0.0, 2.0]]), (peak, [[0.0, 0.0, 0.0]]), (peak, rim)):
        distance, normal = shape.signed_distance(x)
        assert distance == pytest.approx([0.0], abs=1e-15)
        assert np.linalg.norm(normal) == pytest.approx(1.0)
    assert peak.signed_distance([[0.0, 0.0, 0.0]])[1] == pytest.approx(np.array([[0, 0, -1.0]]))


@pytest.mark.parametrize("shape", FINITE, ids=lambda s: type(s).__name__)
def test_bounding_box_holds_the_shape_and_is_tight(shape: Obstacle) -> None:
    box = shape.bounding_box()
    assert box is not None
    lower, upper = box
    x = np.random.default_rng(3).uniform(-1.5, 1.5, (60000, 3))
    distance, normal = shape.signed_distance(x)
    surface = x - distance[:, None] * normal
    assert (surface >= lower - 1e-14).all()
    assert (surface <= upper + 1e-14).all()
    # sampled extremes come close to the box, not only near it
    assert surface.min(axis=0) == pytest.approx(lower, abs=0.02)
    assert surface.max(axis=0) == pytest.approx(upper, abs=0.02)


def test_unbounded_shapes_say_so() -> None:
    endless = [Plane((0, 0, 1)), Cylinder((0, 0, 0), TILT, 1.0), Cone((0, 0, 0), TILT, 0.3)]
    assert [shape.bounding_box() for shape in endless] == [None, None, None]


@every_shape
def test_empty_input_equality_and_pickle(shape: Obstacle) -> None:
    distance, normal = shape.signed_distance(np.zeros((0, 3)))
    assert distance.shape == (0,)
    assert normal.shape == (0, 3)
    assert pickle.loads(pickle.dumps(shape)) == shape
    assert isinstance(shape, Obstacle)
    assert hash(shape) == hash(pickle.loads(pickle.dumps(shape)))


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Plane((0, 0, 0)), "Plane normal is the zero vector"),
        (lambda: Plane((0, math.nan, 1)), "Plane normal must be finite"),
        (lambda: Plane((0, 1)), "Plane normal must be three numbers"),
        (lambda: Plane("up"), "Plane normal must be numbers"),
        (lambda: Plane((0, 0, 1), math.inf), "Plane offset must be finite"),
        (lambda: Plane((0, 0, 1), None), "Plane offset must be a number"),
        (lambda: Plane((0, 0, 1), friction=-0.1), "Plane friction must be zero or more, got -0.1"),
        (lambda: Sphere((0, 0, 0), 1.0, friction=math.nan), "Sphere friction must be finite"),
        (lambda: Sphere((0, 0, 0), -1.0), "Sphere radius must be a positive number, got -1.0"),
        (lambda: Sphere((0, 0, 0), 0.0), "Sphere radius must be a positive"),
        (lambda: Cylinder((0, 0, 0), (0, 0, 0), 1.0), "Cylinder axis is the zero vector"),
        (lambda: Cylinder((0, 0, 0), (0, 0, 1), 1.0, 0.0), "Cylinder length must be a positive"),
        (lambda: Cone((0, 0, 0), (0, 0, 1), 30.0), r"below pi/2 rad, got 30.0 \(degrees\?\)"),
        (lambda: Cone((0, 0, 0), (0, 0, 1), 0.0), "Cone half_angle must be a positive"),
        (lambda: Capsule((0, 0, 0), (0, 0, math.inf), 1.0), "Capsule b must be finite"),
    ],
)
def test_wrong_parameters_are_named(build: Callable[[], Obstacle], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        build()


def test_wrong_points_are_named() -> None:
    ball = Sphere((0, 0, 0), 1.0)
    with pytest.raises(ValueError, match="vertex 1 is not finite"):
        ball.signed_distance([[0, 0, 0], [0, math.nan, 0]])
    with pytest.raises(ValueError, match=r"shape \(N, 3\), got \(3,\)"):
        ball.signed_distance([0.0, 0.0, 0.0])


def test_what_is_no_obstacle_is_named() -> None:
    ball = Sphere((0, 0, 0), 1.0)
    assert checked([ball]) == (ball,)
    with pytest.raises(ValueError, match=r"must be a list, got one Sphere"):
        checked(ball)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"obstacle 1 is a str .* MeshObstacle\(mesh\)"):
        checked([ball, "body.obj"])  # type: ignore[list-item]
