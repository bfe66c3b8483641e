"""Families about the mesh and its place in space."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.stress.case import Case, Twin, predicted, refused, soft, stiff_side
from benchmarks.stress.material import BASES
from benchmarks.stress.shapes import Setup, flag, page_on_table, rotation_about, sheet
from casashell.contact.obstacles import Capsule, Cone, Plane
from casashell.mesh import TriMesh
from casashell.typing import FloatArray


def slivers() -> list[Case]:
    """A face cut by a point near the middle of one side: two angles of so many degrees."""
    told = refused("smallest angle below 0.1 degrees: forces of such a face drown all others")
    cases = []
    for base in (page_on_table, flag):
        for angle in (30.0, 10.0, 3.0, 1.0, 0.3, 0.15, 0.11, 0.09, 0.03, 0.01, 1e-6):
            made = _with_sliver(base, np.radians(angle))
            name = f"{base.__name__} {angle:g} deg"
            cases.append(Case(name, angle, made, told if angle < 0.1 else predicted))
    return cases


def _with_sliver(base: Callable[[], Setup], angle: float) -> Callable[[], Setup]:
    def make() -> Setup:
        setup = base()
        mesh, face = setup.target, len(setup.target.faces) // 2
        p, q, r = (int(v) for v in mesh.faces[face])
        low, high, top = mesh.vertices[[p, q, r]]
        middle, inward = 0.5 * (low + high), top - 0.5 * (low + high)
        span = high - low
        inward = inward - span * (inward @ span) / (span @ span)
        height = 0.5 * np.linalg.norm(span) * np.tan(angle)
        new = middle + height * inward / np.linalg.norm(inward)
        n = len(mesh.vertices)
        faces = np.vstack([np.delete(mesh.faces, face, axis=0), [[p, q, n], [q, r, n], [r, p, n]]])
        return replace(setup, target=TriMesh(np.vstack([mesh.vertices, new]), faces))

    return make


def folds() -> list[Case]:
    """A sheet creased across the middle, pinned on one wing: from flat to folded over."""
    cases = []
    for degrees in (
        1e-6,
        1e-3,
        0.1,
        1.0,
        90.0,
        150.0,
        170.0,
        178.0,
        179.0,
        179.9,
        179.99,
        179.9999,
    ):
        for sign in (1.0, -1.0):
            made = _creased(sign * np.radians(degrees))
            cases.append(Case(f"{sign * degrees:g} deg", degrees, made, predicted))
    return cases


def _creased(angle: float) -> Callable[[], Setup]:
    def make() -> Setup:
        mesh = sheet(9, 7, 0.16, 0.12)
        x, _, z = mesh.vertices.T
        beyond = np.maximum(x - 0.08, 0.0)
        bent = np.minimum(x, 0.08) + beyond * np.cos(angle)
        points = np.stack([bent, beyond * np.sin(angle), z], axis=1)
        return Setup(mesh.moved(points), (), tuple(range(14)), stretch=2e3, bend=1.0)

    return make


def aspects() -> list[Case]:
    """Cells of a clamped sheet from 100 times as wide as deep to 100 times as deep as wide."""
    cases = []
    for aspect in (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0):
        for pins in ("edge", "both"):
            made = _anisotropic(aspect, pins)
            cases.append(Case(f"{pins} 1:{aspect:g}", aspect, made, predicted))
    return cases


def _anisotropic(aspect: float, pins: str) -> Callable[[], Setup]:
    def make() -> Setup:
        setup = flag(pins)
        stretched = setup.target.vertices.copy()
        # the arc steps of the page are 0.0188 m, its rows along z 0.0143 m apart
        stretched[:, 2] *= aspect * 0.0188 / 0.0143
        return setup.moved(stretched)

    return make


def noise() -> list[Case]:
    """Normal noise of so many edge lengths on every vertex that nothing holds."""
    cases = []
    for name, base in BASES.items():
        for exponent in range(-6, 0):
            for seed in (0, 1):
                made = _noisy(base, 10.0**exponent, seed)
                label = f"{name} 1e{exponent} seed {seed}"
                cases.append(Case(label, 10.0**exponent, made, predicted))
    return cases


def _noisy(base: Callable[[], Setup], amount: float, seed: int) -> Callable[[], Setup]:
    def make() -> Setup:
        setup = base()
        problem = setup.problem()
        free = np.ones(len(setup.target.vertices), dtype=bool)
        free[np.asarray(problem.pinned)] = free[problem.contacts.vertices] = False
        random = np.random.default_rng(seed).standard_normal(setup.target.vertices.shape)
        points = setup.target.vertices.copy()
        points[free] += amount * setup.target.mean_edge_length * random[free]
        return setup.moved(points)

    return make


def motions() -> list[Case]:
    """Random rigid motions of everything, gravity too: the same answer, moved."""
    cases = []
    for name, base in BASES.items():
        for seed in range(5):
            turn = _random_turn(seed)
            shift = np.random.default_rng(100 + seed).uniform(-3.0, 3.0, 3)
            made = _moved(base, turn, shift)
            # A coordinate of up to 3 m is known to 2e-16 m; K^-1 K does not magnify that by 1e5.
            twin = Twin(base, lambda rest, R=turn, t=shift: (rest - t) @ R, 1e-9)  # type: ignore[misc]
            cases.append(Case(f"{name} seed {seed}", float(seed), made, stiff_side, twin))
    return cases


def distances() -> list[Case]:
    """Far from the origin: rounding of the target's own coordinates is all it may cost."""
    cases = []
    for name, base in BASES.items():
        for exponent in (1, 2, 3, 4, 5, 6, 7, 8, 10):
            shift = 10.0**exponent * np.array([0.6, 0.48, -0.64])
            made = _moved(base, np.eye(3), shift)
            # The piece is solved near its middle; the shape's rounding shows in the certificate.
            told = stiff_side if exponent <= 2 else soft("target known to few digits: be honest")
            cases.append(Case(f"{name} 1e{exponent} m", 10.0**exponent, made, told))
    return cases


def _random_turn(seed: int) -> FloatArray:
    axis = np.random.default_rng(seed).standard_normal(3)
    return rotation_about(tuple(axis / np.linalg.norm(axis)), 0.5 + seed)


def _moved(base: Callable[[], Setup], turn: FloatArray, shift: FloatArray) -> Callable[[], Setup]:
    """x -> R x + t for shell, obstacles and gravity."""

    def make() -> Setup:
        setup = base()
        obstacles = tuple(_moved_obstacle(o, turn, shift) for o in setup.obstacles)
        gravity = _triple(turn @ np.asarray(setup.gravity))
        moved = setup.moved(setup.target.vertices @ turn.T + shift)
        return replace(moved, obstacles=obstacles, gravity=gravity)

    return make


def _triple(vector: FloatArray) -> tuple[float, float, float]:
    return (float(vector[0]), float(vector[1]), float(vector[2]))


def _moved_obstacle(
    obstacle: object, turn: FloatArray, shift: FloatArray
) -> Plane | Cone | Capsule:
    match obstacle:
        case Plane():
            normal = turn @ np.asarray(obstacle.normal)
            return replace(
                obstacle, normal=_triple(normal), offset=obstacle.offset + float(normal @ shift)
            )
        case Cone():
            apex = _triple(turn @ np.asarray(obstacle.apex) + shift)
            return replace(obstacle, apex=apex, axis=_triple(turn @ np.asarray(obstacle.axis)))
        case Capsule():
            a, b = (_triple(turn @ np.asarray(p) + shift) for p in (obstacle.a, obstacle.b))
            return replace(obstacle, a=a, b=b)
    raise ValueError(f"no rule to move a {type(obstacle).__name__}")
