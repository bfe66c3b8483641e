"""Closest points, continuous detection, triangulation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize
from strip_shapes import THICKNESS, flat, ring

from casashell.ribbon.bodies import Bodies, Pairs
from casashell.ribbon.closest import combine, segment_segment, vertex_triangle
from casashell.ribbon.strips import ribbon_strip, to_rims, to_vertices
from casashell.ribbon.sweep import approaches, separations
from casashell.typing import FloatArray


def smallest_sampled(a: FloatArray, b: FloatArray) -> float:
    """Distance of two hulls by a bounded minimiser over their barycentric weights."""

    def squared(w: FloatArray) -> float:
        p = w[: len(a)] @ a - w[len(a) :] @ b
        return float(p @ p)

    sums = [
        {"type": "eq", "fun": lambda w: w[: len(a)].sum() - 1.0},
        {"type": "eq", "fun": lambda w: w[len(a) :].sum() - 1.0},
    ]
    start = np.concatenate([np.full(len(a), 1.0 / len(a)), np.full(len(b), 1.0 / len(b))])
    bounds = [(0.0, 1.0)] * len(start)
    answer = minimize(squared, start, bounds=bounds, constraints=sums, tol=1e-14)
    return float(np.sqrt(answer.fun))


@pytest.mark.parametrize("sizes", [(1, 3), (2, 2)])
def test_closest_points_against_a_minimiser(sizes: tuple[int, int]) -> None:
    rng = np.random.default_rng(3)
    a, b = rng.standard_normal((20, sizes[0], 3)), rng.standard_normal((20, sizes[1], 3))
    closest = vertex_triangle if sizes[0] == 1 else segment_segment
    u, v = closest(a, b)
    assert min(u.min(), v.min()) >= 0.0
    np.testing.assert_allclose(u.sum(axis=1), 1.0)
    np.testing.assert_allclose(v.sum(axis=1), 1.0)
    found = np.linalg.norm(combine(u, a) - combine(v, b), axis=1)
    wanted = [smallest_sampled(p, q) for p, q in zip(a, b)]
    np.testing.assert_allclose(found, wanted, atol=2e-5)


def test_closest_points_of_degenerate_parts() -> None:
    """Closed forms: parallel segments 1 apart, a triangle that is a segment, a point segment."""
    line = np.array([[[0.0, 0, 0], [1, 0, 0]]])
    for other, wanted in (
        ([[0.5, 1, 0], [3, 1, 0]], 1.0),
        ([[2.0, 0, 0], [3, 0, 0]], 1.0),
        ([[0.3, 0, 2], [0.3, 0, 2]], 2.0),
    ):
        second = np.array([other])
        u, v = segment_segment(line, second)
        gap = np.linalg.norm(combine(u, line) - combine(v, second))
        np.testing.assert_allclose(gap, wanted)
    thin = np.array([[[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]])
    point = np.array([[[1.5, 0.7, 0]]])
    u, v = vertex_triangle(point, thin)
    np.testing.assert_allclose(np.linalg.norm(combine(u, point) - combine(v, thin)), 0.7)


def pair(first: int) -> Pairs:
    return Pairs(np.arange(first)[None], np.arange(first, 4)[None], np.zeros(1, dtype=np.bool_))


def test_time_of_impact_in_closed_form() -> None:
    """A point falls from 1 to -1 onto a triangle at 0: within 0.1 at time 0.45."""
    start = np.array([[0.2, 0.2, 1.0], [0, 0, 0], [1, 0, 0], [0, 1, 0]])
    end = start - [[0, 0, 2.0], [0, 0, 0], [0, 0, 0], [0, 0, 0]]
    hit = approaches(pair(1), start, end, np.array([0.1]))
    np.testing.assert_allclose(hit.time, 0.45, atol=0.1 * 0.05 / 2.0)
    np.testing.assert_allclose(hit.normal, [[0, 0, -1]], atol=1e-12)
    np.testing.assert_allclose(hit.weights, [[-1, 0.6, 0.2, 0.2]], atol=1e-12)
    assert len(approaches(pair(1), start, start - [0, 0, 5.0], np.array([0.1])).rows) == 0


def smallest_on_the_way(first: int, start: FloatArray, end: FloatArray) -> float:
    """Distance at 4001 times."""
    times = np.linspace(0.0, 1.0, 4001)[:, None, None]
    x = (start + times * (end - start)).reshape(-1, 3)
    ids = np.arange(len(x)).reshape(-1, 4)
    every = Pairs(ids[:, :first], ids[:, first:], np.zeros(len(ids), dtype=np.bool_))
    return float(separations(every, x)[2].min())


@pytest.mark.parametrize("first", [1, 2])
def test_no_crossing_is_missed(first: int) -> None:
    """Random ways, against the distance at many times: found when, and only when, it comes close."""
    rng = np.random.default_rng(first)
    level, found = 1e-3, 0
    for _ in range(80):
        start, end = rng.standard_normal((2, 4, 3))
        closest = smallest_on_the_way(first, start, end)
        hit = approaches(pair(first), start, end, np.array([level]))
        found += len(hit.rows)
        if closest < 0.9 * level:
            assert len(hit.rows) == 1
        if len(hit.rows):
            at = start + hit.time[0] * (end - start)
            assert separations(pair(first), at)[2][0] <= 1.06 * level
    assert found >= 3


def test_every_near_pair_comes_up_once() -> None:
    """Against all pairs of vertices and triangles, edges and edges, of two rings."""
    bodies = Bodies((ring((0, 0, 0), False, 6)[0], ring((0, 0, 0), True, 6)[0]))
    x = np.concatenate([ring((0, 0, 0), False, 6)[1], ring((0.05, 0, 0), True, 6)[1]])
    for pairs, total in zip(bodies.near(x, x, 10.0), (24 * 24, 36 * 35 // 2 + 36 * 36 // 2)):
        keys = np.concatenate([np.sort(pairs.first, axis=1), np.sort(pairs.second, axis=1)], axis=1)
        assert len(np.unique(keys, axis=0)) == len(pairs) < total
        assert not (pairs.first[:, :, None] == pairs.second[:, None, :]).any()
    faces, edges = bodies.faces, bodies.edges
    vt = sum(v not in face for v in range(24) for face in faces)
    ee = sum(not set(e) & set(f) for i, e in enumerate(edges) for f in edges[:i])
    assert [len(pairs) for pairs in bodies.near(x, x, 10.0)] == [vt, ee]


@pytest.mark.parametrize(("ends", "count"), [("open", 22), ("loop", 20), ("moebius", 20)])
def test_strips_by_euler_characteristic(ends: str, count: int) -> None:
    """V - E + F is 1 for a disc, 0 for an annulus and a Moebius band; mass is shared out."""
    strip, _ = ring((0, 0, 0), False, 10, ends=ends) if ends != "open" else flat(10)  # type: ignore[arg-type]
    assert len(strip.masses) == count
    euler = len(strip.masses) - len(strip.edges) + len(strip.faces)
    assert euler == (1 if ends == "open" else 0)
    np.testing.assert_allclose(strip.masses.sum(), 0.01 if ends == "open" else 0.005)
    sides = np.sort(strip.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    rims = (np.unique(sides, axis=0, return_counts=True)[1] == 1).sum()
    assert rims == (22 if ends == "open" else 20)


def test_rims_and_vertices_are_inverse() -> None:
    rng = np.random.default_rng(0)
    bottom, top = rng.standard_normal((2, 8, 3))
    for ends, last in (("open", None), ("loop", (0, 1)), ("moebius", (1, 0))):
        low, high = bottom.copy(), top.copy()
        if last is not None:
            rims = (bottom[0], top[0])
            low[-1], high[-1] = rims[last[0]], rims[last[1]]
        back = to_rims(to_vertices(low, high, ends), ends)  # type: ignore[arg-type]
        np.testing.assert_allclose(back, (low, high))


def test_shorter_diagonals() -> None:
    bottom = np.array([[0.0, 0, 0], [2, 0, 0]])
    for shift, diagonal in ((0.5, (1, 2)), (-0.5, (0, 3))):
        top = bottom + np.array([shift, 1.0, 0.0])
        strip = ribbon_strip(bottom, top, mass=1.0, thickness=THICKNESS)
        assert diagonal in {tuple(edge) for edge in strip.edges}


def test_strip_messages() -> None:
    bottom = np.array([[0.0, 0, 0], [2, 0, 0]])
    top = bottom + np.array([0.0, 1.0, 0.0])
    with pytest.raises(ValueError, match="thickness"):
        ribbon_strip(bottom, top, mass=1.0, thickness=0.0)
    with pytest.raises(ValueError, match="mass"):
        ribbon_strip(bottom, top, mass=-1.0, thickness=1e-3)
    with pytest.raises(ValueError, match="pinned stations"):
        ribbon_strip(bottom, top, mass=1.0, thickness=1e-3, pinned=[2])
    with pytest.raises(ValueError, match="more than 1 segments"):
        ribbon_strip(bottom, top, mass=1.0, thickness=1e-3, ends="loop")
