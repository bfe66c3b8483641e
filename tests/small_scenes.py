"""Small scenes of every kind for whole solves, and what a certified result has to satisfy."""

from __future__ import annotations

import numpy as np
from meshes import cap, grid, rolled
from plain_shell import PlainShell

from casashell.contact.obstacles import Obstacle, Plane, Sphere
from casashell.problem import Problem
from casashell.result import Result

HEAD = Sphere((0.0, 0.0, 0.05), 0.15, friction=0.5)
DOWN = (0.0, 0.0, -9.81)


def hat_on_ball(
    obstacles: tuple[Obstacle, ...] = (HEAD,), pinned: tuple[int, ...] = (), bend: float = 3e-3
) -> Problem:
    """A cap on a ball of the same pole; the brim hangs free."""
    target = cap(4, 0.2, 1.3)
    terms = PlainShell(target, bend=bend).terms()
    return Problem(target, terms, obstacles, pinned=pinned, contact_tolerance=6e-3)


def clamped_page(gravity: tuple[float, float, float] = DOWN, bend: float = 3e-3) -> Problem:
    """A curved sheet clamped along two rows."""
    target = rolled(grid(5, 3, 0.05, 0.05), 0.05, 0.12)
    shell = PlainShell(target, bend=bend, gravity=gravity)
    return Problem(target, shell.terms(), pinned=range(8))


def upright_sheet(pinned: list[int]) -> Problem:
    """A flat square in the plane y = 0; vertex 5 i + j sits at x = 0.1 i, z = 0.1 j."""
    flat = grid(4, 4)
    sheet = flat.moved(flat.vertices[:, [0, 2, 1]])
    return Problem(sheet, PlainShell(sheet, bend=1e-1).terms(), pinned=pinned)


def sheet_on_slope(degrees: float, friction: float) -> Problem:
    angle = np.radians(degrees)
    turn = np.array(
        [[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]]
    )
    flat = grid(5, 5)
    sheet = flat.moved(flat.vertices @ turn.T)
    plane = Plane((-np.sin(angle), 0.0, np.cos(angle)), 0.0, friction=friction)
    return Problem(sheet, PlainShell(sheet).terms(), (plane,), contact_tolerance=1e-6)


def assert_certified(result: Result) -> None:
    """Thresholds of a certified result, read from the certificate and from the forces."""
    c = result.certificate
    assert c.free_force is not None
    assert c.free_force <= 1e-9  # what is aimed for, a thousand times inside the threshold
    assert (c.cone_margin is None) == (c.min_normal_force is None) == (len(result.contacts) == 0)
    assert min(c.cone_margin or 0.0, c.min_normal_force or 0.0) >= 0.0
    assert c.min_eigenvalue is None or c.min_eigenvalue > 0.0
    assert c.target_distance == 0.0
    held = np.zeros(len(result.target.vertices), dtype=bool)
    held[result.pinned] = held[result.contacts.vertices] = True
    assert np.abs(result.forces[~held]).max(initial=0.0) <= 1e-9 * c.f0
