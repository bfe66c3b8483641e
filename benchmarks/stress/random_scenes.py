"""Random scenes from fixed seeds: shape, mesh, material decades, friction, contacts, pins, pose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.stress.case import Case, predicted
from benchmarks.stress.shapes import Setup, page_on_table, rotation_about, sheet
from casashell.app.builtin import hat, page, skirt
from casashell.contact.obstacles import Obstacle, Plane, Sphere

Random = np.random.Generator


def _hat(rng: Random) -> Setup:
    scene = hat(int(rng.integers(3, 8)))
    return Setup(scene.target, scene.obstacles)


def _skirt(rng: Random) -> Setup:
    scene = skirt(int(rng.integers(3, 10)), int(rng.integers(12, 30)))
    return Setup(scene.target, scene.obstacles)


def _page(rng: Random) -> Setup:
    scene = page(int(rng.integers(5, 14)), int(rng.integers(4, 20)))
    return Setup(scene.target, scene.obstacles)


def _waved_sheet(rng: Random) -> Setup:
    """A sheet of random waves on a floor that touches its lowest vertices."""
    mesh = sheet(int(rng.integers(4, 12)), int(rng.integers(4, 12)), *rng.uniform(0.1, 0.5, 2))
    points = mesh.vertices.copy()
    wide, deep = np.ptp(points[:, 0]), np.ptp(points[:, 2])
    for _ in range(3):
        i, j = rng.integers(0, 3, 2)
        phase = rng.uniform(0.0, 2.0 * np.pi)
        wave = np.cos(np.pi * (i * points[:, 0] / wide + j * points[:, 2] / deep) + phase)
        points[:, 1] += 0.05 * rng.uniform() * wide * wave
    low = float(points[:, 1].min())
    floor = Plane((0.0, 1.0, 0.0), low)
    high = float(rng.uniform(1e-4, 0.5)) * float(np.ptp(points[:, 1]) or 1e-3)
    return Setup(mesh.moved(points), (floor,), tolerance=high)


def _propped_sheet(rng: Random) -> Setup:
    """A sheet on a few balls at random places, some of which miss its vertices."""
    side = int(rng.integers(4, 10))
    mesh = sheet(side, side, 0.2, 0.2)
    chosen = rng.choice(side * side, int(rng.integers(1, 7)), replace=False)
    balls: list[Obstacle] = []
    for vertex in chosen:
        centre = mesh.vertices[vertex] - np.array([0.0, 0.01, 0.0])
        balls.append(Sphere((float(centre[0]), float(centre[1]), float(centre[2])), 0.01))
    return Setup(mesh, tuple(balls))


def _draped_page(rng: Random) -> Setup:
    """The page hung by pins at random vertices."""
    setup = page_on_table(int(rng.integers(5, 12)), int(rng.integers(5, 15)))
    count = len(setup.target.vertices)
    pins = rng.choice(count, int(rng.integers(1, 12)), replace=False)
    return replace(setup, obstacles=(), pinned=tuple(int(p) for p in pins))


SHAPES: tuple[Callable[[Random], Setup], ...] = (
    _hat,
    _skirt,
    _page,
    _waved_sheet,
    _propped_sheet,
    _draped_page,
)


def setup(seed: int) -> Setup:
    """The scene of one seed."""
    rng = np.random.default_rng(seed)
    made = SHAPES[int(rng.integers(len(SHAPES)))](rng)
    made = replace(
        made,
        density=float(10.0 ** rng.uniform(-2.0, 1.0)),
        stretch=float(10.0 ** rng.uniform(-1.0, 4.0)),
        bend=float(10.0 ** rng.uniform(-5.0, 1.0)),
    )
    if rng.uniform() < 0.7:
        made = replace(made, friction=float(10.0 ** rng.uniform(-2.0, 1.0)))
    elif rng.uniform() < 0.3:
        made = replace(made, friction=0.0)
    if rng.uniform() < 0.2:
        count = int(rng.integers(1, 5))
        pins = rng.choice(len(made.target.vertices), count, replace=False)
        made = replace(made, pinned=tuple(sorted({*made.pinned, *(int(p) for p in pins)})))
    if rng.uniform() < 0.3:  # the pose is turned against gravity, obstacles with it
        axis = rng.standard_normal(3)
        turn = rotation_about(tuple(axis / np.linalg.norm(axis)), float(rng.normal(0.0, 0.3)))
        down = turn @ np.asarray(made.gravity)
        made = replace(made, gravity=(float(down[0]), float(down[1]), float(down[2])))
    if rng.uniform() < 0.3:
        amount = 10.0 ** rng.uniform(-6.0, -1.3) * made.target.mean_edge_length
        noise = rng.standard_normal(made.target.vertices.shape)
        made = made.moved(made.target.vertices + amount * noise)
    return made


def cases(count: int, first: int = 0) -> list[Case]:
    """Scenes of the seeds ``first`` .. ``first + count - 1``, judged by linear theory."""
    return [
        Case(f"seed {seed}", float(seed), lambda seed=seed: setup(seed), predicted)  # type: ignore[misc]
        for seed in range(first, first + count)
    ]
