"""Collision response of strips: no step may end with parts that pass through each other."""

from __future__ import annotations

import numpy as np
import pytest
from strip_shapes import THICKNESS, Placed, flat, linking, ring, turn

from casashell.contact.obstacles import Plane, Sphere
from casashell.ribbon.collide import Collider, Resolved
from casashell.ribbon.impacts import HIT, Moving
from casashell.ribbon.rigid_zones import Unresolved
from casashell.typing import FloatArray

QUARTER = turn((0.0, 0.0, 1.0), 0.5 * np.pi)
FLOOR = Plane((0.0, 0.0, 1.0))


def together(*placed: Placed, **options: object) -> tuple[Collider, list[FloatArray]]:
    collider = Collider(tuple(strip for strip, _ in placed), **options)  # type: ignore[arg-type]
    return collider, [x for _, x in placed]


def sound(collider: Collider, result: Resolved) -> None:
    """Nothing crosses, and the separations agree with that."""
    assert len(collider.crossings(result.positions)) == 0
    assert result.min_distance > 0.0


def strain(collider: Collider, before: FloatArray, after: FloatArray) -> float:
    """Largest relative change of an edge length."""
    i, j = collider.bodies.edges.T
    old, new = (np.linalg.norm(x[i] - x[j], axis=1) for x in (before, after))
    return float(np.abs(new / old - 1.0).max())


@pytest.mark.parametrize("speed", [2.0, 100.0, 1000.0])  # thicknesses a step, relative
@pytest.mark.parametrize("stiffness", [0.0, 100.0, 1e4])
def test_two_strips_head_on(speed: float, stiffness: float) -> None:
    lower, upper = flat(), flat(9, place=(0.0, 0.01, 2.5e-3), rotation=QUARTER)
    collider, x = together(lower, upper, stiffness=stiffness)
    move = np.array([0.0, 0.0, 0.5 * speed * THICKNESS])
    end = np.concatenate([x[0] + move, x[1] - move])
    assert speed < 5.0 or len(collider.crossings(end)) == 0  # fast ones tunnel completely
    result = collider.resolve(x, end)
    sound(collider, result)
    assert not result.fail_safe
    assert result.min_distance >= HIT * THICKNESS
    low, high = collider.bodies.split(result.positions)
    over, under = np.abs(upper[1][:, 1] - 0.01) < 0.03, np.abs(lower[1][:, 0]) < 0.01
    assert high[over, 2].mean() > low[under, 2].mean()  # the upper one stayed above


def test_edge_against_edge() -> None:
    """Two strips on their sides, crossed: only rims meet."""
    side = turn((1.0, 0.0, 0.0), 0.5 * np.pi)
    lower, upper = flat(7, rotation=side), flat(8, rotation=QUARTER @ side, place=(0, 0, 0.065))
    collider, x = together(lower, upper)
    result = collider.resolve(x, [x[0], x[1] - [0.0, 0.0, 0.03]])
    sound(collider, result)
    assert not result.fail_safe
    weights = result.contacts.weights
    assert ((weights < 0.0).sum(axis=1) == 2).any()
    assert ((weights > 0.0).sum(axis=1) == 2).any()


def test_momentum_and_complementarity() -> None:
    """Closed form: rows about pairs carry no net impulse, lam >= 0, lam (J x - bound) = 0."""
    collider, x = together(flat(), flat(9, place=(0.1, 0.02, 0.01), rotation=QUARTER))
    end = np.concatenate([x[0] + [0.0, 0.0, 0.02], x[1] - [0.0, 0.0, 0.04]])
    result = collider.resolve(x, end)
    moved = collider.bodies.masses[:, None] * (result.positions - end)
    assert np.abs(moved).sum() > 1e-5
    np.testing.assert_allclose(moved.sum(axis=0), 0.0, atol=1e-8 * np.abs(moved).sum())
    slack = result.contacts.values(result.positions) - result.contacts.bounds
    assert (result.multipliers > 0.0).all()
    scale = THICKNESS * result.multipliers.max()
    np.testing.assert_allclose(result.multipliers * slack / scale, 0.0, atol=1e-5)


def test_a_strip_on_its_side_falls_on_a_plane() -> None:
    side = turn((1.0, 0.0, 0.0), 0.5 * np.pi)
    collider, x = together(flat(20, rotation=side, place=(0, 0, 0.04)), obstacles=(FLOOR,))
    result = collider.resolve(x, [x[0] - [0.0, 0.0, 0.03]])
    sound(collider, result)
    np.testing.assert_allclose(result.min_gap, 0.5 * THICKNESS, rtol=1e-4)
    np.testing.assert_allclose(result.contacts.normals, [[0.0, 0.0, 1.0]] * 21)


def test_stiffness_keeps_edges_at_their_length() -> None:
    """A wavy strip pressed into a plane: the strain of the correction falls with k_s."""
    _, x = placed = flat(60, length=1.0, place=(0.0, 0.0, 0.02))
    end = x - [0.0, 0.0, 0.021]
    end[:, 2] += 2e-3 * np.sin(40.0 * x[:, 0])
    strains = []
    for stiffness in (0.0, 100.0, 1e5):
        collider, start = together(placed, obstacles=(FLOOR,), stiffness=stiffness)
        result = collider.resolve(start, end)
        assert result.min_gap >= 0.499 * THICKNESS
        strains.append(strain(collider, end, result.positions))
    assert strains[0] > 1.5 * strains[1] > 15.0 * strains[2]


def test_linked_loops_pulled_apart_stay_linked() -> None:
    collider, x = together(ring((0, 0, 0), False), ring((0.05, 0, 0), True))
    start = np.concatenate(x)
    before = linking(x[0][::2], x[1][::2])
    assert abs(abs(before) - 1.0) < 1e-9
    for _ in range(4):
        end = start.copy()
        end[collider.bodies.owner == 1] += [0.04, 0.0, 0.0]
        result = collider.resolve(start, end)
        sound(collider, result)
        start = result.positions
    low, high = collider.bodies.split(start)
    np.testing.assert_allclose(linking(low[::2], high[::2]), before, atol=1e-9)


def test_a_stack_of_ten_comes_to_rest() -> None:
    stack = [
        flat(8, place=(0, 0, 0.01 + 0.004 * k), rotation=turn((0, 0, 1), 0.3 * k))
        for k in range(10)
    ]
    collider, x = together(*stack, obstacles=(FLOOR,))
    start = np.concatenate(x)
    for _ in range(4):
        result = collider.resolve(start, start - [0.0, 0.0, 0.01])
        sound(collider, result)
        assert not result.fail_safe
        start = result.positions
    heights = [part[:, 2].mean() for part in collider.bodies.split(start)]
    assert (np.diff(heights) > HIT * THICKNESS).all()
    assert heights[-1] < 12.0 * THICKNESS


def test_a_proposal_that_undoes_the_correction_is_corrected_again() -> None:
    """The next step proposes the same colliding positions from the corrected ones."""
    collider, x = together(flat(), flat(9, place=(0.0, 0.01, 0.01), rotation=QUARTER))
    end = [x[0] + [0.0, 0.0, 0.01], x[1] - [0.0, 0.0, 0.01]]
    first = collider.resolve(x, end)
    again = collider.resolve(first.positions, end)
    assert first.rounds > 0
    assert again.rounds > 0
    sound(collider, again)
    np.testing.assert_allclose(again.positions, first.positions, atol=0.05 * THICKNESS)


def test_pinned_vertices_arrive_where_they_are_sent() -> None:
    held = flat(pinned=tuple(range(11)))
    collider, x = together(held, flat(9, place=(0, 0, 0.01), rotation=QUARTER))
    result = collider.resolve(x, [x[0] + [0.0, 0.0, 0.02], x[1]])
    sound(collider, result)
    np.testing.assert_array_equal(result.positions[: len(x[0])], x[0] + [0.0, 0.0, 0.02])


def test_pinned_strips_that_collide_are_reported() -> None:
    every = tuple(range(11))
    collider, x = together(flat(pinned=every), flat(place=(0, 0, 0.01), pinned=every))
    with pytest.raises(Unresolved, match="still cross"):
        collider.resolve(x, [x[0] + [0, 0, 0.01], x[1] @ turn((0, 1, 0), 0.3).T])


def test_obstacles_that_are_round_or_move() -> None:
    ball = Sphere((0.0, 0.0, 0.0), 0.05)
    collider, x = together(flat(20, place=(0.0, 0.0, 0.06)), obstacles=(ball,))
    result = collider.resolve(x, [x[0] - [0.0, 0.0, 0.2]])  # would pass right through
    assert result.min_gap >= HIT * 0.5 * THICKNESS
    assert result.positions[np.abs(x[0][:, 0]) < 1e-9, 2].min() > 0.0
    collider, x = together(flat(place=(0.0, 0.0, 0.01)))
    rising = Moving(FLOOR, after=(0.0, 0.0, 0.05))
    result = collider.resolve(x, x, moving=[rising])
    np.testing.assert_allclose(result.positions[:, 2], 0.05 + 0.5 * THICKNESS, rtol=1e-6)


@pytest.mark.parametrize("seed", range(6))
def test_adversarial_motions_never_interpenetrate(seed: int) -> None:
    assert adversarial(seed, rounds=20) == 0


def test_rigid_zones_take_over_after_the_last_round() -> None:
    assert sum(adversarial(seed, rounds=1) for seed in range(4)) > 0


def test_rigid_zones_when_rows_contradict() -> None:
    """Between two plates closer than the thickness no program is feasible: all stay in place."""
    plates = (FLOOR, Plane((0.0, 0.0, -1.0), -0.6 * THICKNESS))
    collider, x = together(flat(place=(0.0, 0.0, 0.3 * THICKNESS)), obstacles=plates)
    result = collider.resolve(x, [x[0] - [0.0, 0.0, 0.2 * THICKNESS]])
    assert result.fail_safe
    np.testing.assert_array_equal(result.positions, x[0])


def adversarial(seed: int, rounds: int) -> int:
    """Steps that needed the fail-safe when three strips are thrown at each other and twisted."""
    rng = np.random.default_rng(seed)
    placed = [
        flat(
            int(rng.integers(4, 10)),
            place=(0.0, 0.0, 0.3 + 0.55 * k),
            rotation=turn(tuple(rng.standard_normal(3)), rng.uniform(0.0, 3.0)),
        )
        for k in range(3)
    ]
    collider, x = together(*placed, obstacles=(FLOOR,), rounds=rounds)
    start, helped = np.concatenate(x), 0
    for _ in range(4):
        end = start.copy()
        for k in range(3):
            own = collider.bodies.owner == k
            middle = start[own].mean(axis=0)
            spin = turn(tuple(rng.standard_normal(3)), rng.normal(0.0, 0.5))
            pull = (start.mean(axis=0) - middle) * rng.uniform(0.2, 1.2)
            end[own] = (start[own] - middle) @ spin.T + middle + pull
        end += rng.choice([0.0, 0.005, 0.02]) * rng.standard_normal(end.shape) - [0, 0, 0.05]
        result = collider.resolve(start, end)
        sound(collider, result)
        assert result.min_gap > 0.0
        helped += result.fail_safe
        start = result.positions
    return helped


def test_nothing_near_nothing_done() -> None:
    collider, x = together(flat(), flat(place=(0.0, 0.0, 1.0)), obstacles=(FLOOR,))
    start = np.concatenate(x) + np.array([0.0, 0.0, 0.5])
    end = start + np.array([0.01, 0.0, -0.1])
    result = collider.resolve(start, end)
    assert (result.rounds, len(result.contacts), result.min_distance) == (0, 0, np.inf)
    np.testing.assert_array_equal(result.positions, end)


def test_messages() -> None:
    collider, x = together(flat(), flat(rotation=turn((1, 0, 0), 1.0), place=(0.02, 0, 0)))
    with pytest.raises(ValueError, match=r"start interpenetrates: face .* of strip 0 and face"):
        collider.resolve(x, x)
    with pytest.raises(ValueError, match=r"end: strip 1 must have shape \(22, 3\)"):
        collider.resolve(x, [x[0], x[1][:-1]])
    x[1][3] = np.nan
    with pytest.raises(ValueError, match="vertex 3 of strip 1"):
        collider.resolve(x, x)
    with pytest.raises(ValueError, match="stiffness"):
        Collider(collider.strips, stiffness=-1.0)
    with pytest.raises(ValueError, match="empty"):
        Collider(())
