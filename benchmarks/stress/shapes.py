"""Small scenes that sweeps start from: built-in shapes, and sheets on their connectivity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from casashell.app.builtin import hat, page, skirt
from casashell.contact.obstacles import Obstacle, Plane
from casashell.mesh import TriMesh
from casashell.problem import Problem
from casashell.typing import FloatArray
from formulations import discrete_shell


@dataclass(frozen=True)
class Setup:
    """All that makes a problem, as numbers that a sweep can replace; up is +y, SI."""

    target: TriMesh
    obstacles: tuple[Obstacle, ...] = ()
    pinned: tuple[int, ...] = ()
    density: float | FloatArray = 0.2
    stretch: float | FloatArray = 20.0
    bend: float | FloatArray = 1e-2
    gravity: tuple[float, float, float] = (0.0, -9.81, 0.0)
    tolerance: float | None = 1e-5
    friction: float | None = None

    def problem(self) -> Problem:
        """The problem; ValueError as `Problem` and the energies say."""
        energies = discrete_shell(
            self.target,
            density=self.density,
            stretch=self.stretch,
            bend=self.bend,
            gravity=self.gravity,
        )
        return Problem(
            self.target,
            energies,
            self.obstacles,
            pinned=self.pinned,
            contact_tolerance=self.tolerance,
            friction=self.friction,
        )

    def moved(self, points: FloatArray) -> Setup:
        """The same with other target positions."""
        return replace(self, target=self.target.moved(points))


def hat_on_head(rings: int = 5) -> Setup:
    """Contacts only: a hat hung on a capsule."""
    scene = hat(rings)
    return Setup(scene.target, scene.obstacles, density=2.5, stretch=2e3, bend=1.0)


def skirt_on_waist(rows: int = 6, around: int = 20) -> Setup:
    """Contacts only: the waist line of a skirt on a cone."""
    scene = skirt(rows, around)
    return Setup(scene.target, scene.obstacles, density=0.1, stretch=200.0, bend=1e-1)


def page_on_table(across: int = 9, along: int = 15) -> Setup:
    """Contacts only: a page bent to a half cylinder, both long edges on a table."""
    scene = page(across, along)
    return Setup(scene.target, scene.obstacles, density=1.0, stretch=2e3, bend=1.0)


def flag(pins: str = "edge") -> Setup:
    """Pins only: the same page held along one of its long edges, or both, in the air."""
    page_ = page_on_table()
    along, count = 15, len(page_.target.vertices)
    first, last = range(along), range(count - along, count)
    held = {"edge": (*first, *range(along, 2 * along)), "both": (*first, *last)}[pins]
    return replace(page_, obstacles=(), pinned=tuple(held))


def sheet(across: int, along: int, wide: float, deep: float) -> TriMesh:
    """Flat rectangle in the plane y = 0; vertex i * along + j at x = i wide / (across - 1)."""
    flat = page(across, along).target
    i, j = np.divmod(np.arange(len(flat.vertices)), along)
    x, z = wide * i / (across - 1), deep * j / (along - 1)
    # x to the right, z towards the viewer: the normal of page's faces points up
    return flat.moved(np.stack([x, 0.0 * x, z], axis=1))


def sheet_on_floor(friction: float = 0.5, tilt: float = 0.0) -> Setup:
    """Every vertex in contact: a flat sheet on a plane tilted by ``tilt`` [rad]."""
    target = sheet(6, 7, 0.25, 0.3)
    turn = rotation_about((0.0, 0.0, 1.0), tilt)
    normal = (-float(np.sin(tilt)), float(np.cos(tilt)), 0.0)
    floor = Plane(normal, 0.0, friction=friction)
    return Setup(target.moved(target.vertices @ turn.T), (floor,))


def rotation_about(axis: Sequence[float], angle: float) -> FloatArray:
    """Rotation matrix (3,3) by Rodrigues' formula; ``axis`` a unit vector."""
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * skew @ skew)


def together(first: Setup, second: Setup, offset: Sequence[float]) -> Setup:
    """Two shells of the first one's material as disconnected pieces of one mesh."""
    count = len(first.target.vertices)
    points = np.vstack([first.target.vertices, second.target.vertices + np.asarray(offset)])
    faces = np.vstack([first.target.faces, second.target.faces + count])
    return replace(
        first,
        target=TriMesh(points, faces),
        pinned=(*first.pinned, *(count + p for p in second.pinned)),
    )
