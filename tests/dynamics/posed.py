"""Results that were never solved for, and shells that move in closed form."""

from __future__ import annotations

import numpy as np
from meshes import grid

from benchmarks.dynamics import unsolved as posed
from casashell.contact.obstacles import Obstacle, Plane
from casashell.mesh import TriMesh
from casashell.problem import Problem
from casashell.result import Result
from casashell.typing import FloatArray
from formulations import discrete_shell

__all__ = ["G", "posed", "sheet", "sheet_on_incline", "tilted"]

G = 9.81


def sheet(
    mesh: TriMesh,
    obstacles: tuple[Obstacle, ...] = (),
    gravity: tuple[float, float, float] = (0.0, 0.0, -G),
    pinned: tuple[int, ...] = (),
    bend: float | FloatArray = 1e-3,
    stretch: float = 20.0,
) -> Result:
    """A shell of 0.2 kg/m2 at rest in ``mesh``."""
    terms = discrete_shell(mesh, density=0.2, stretch=stretch, bend=bend, gravity=gravity)
    problem = Problem(mesh, terms, obstacles, pinned, contact_tolerance=1e-6)
    return posed(problem)


def tilted(degrees: float) -> FloatArray:
    """Rotation (3,3) about +y that takes +x to a direction ``degrees`` above the horizontal."""
    a = np.radians(degrees)
    return np.array([[np.cos(a), 0, -np.sin(a)], [0, 1, 0], [np.sin(a), 0, np.cos(a)]])


def sheet_on_incline(degrees: float, friction: float, cells: int = 4) -> tuple[Result, FloatArray]:
    """A flat sheet on a slope, and the direction (3,) down the slope."""
    turn, flat = tilted(degrees), grid(cells, cells, 0.05, 0.05)
    normal = turn @ np.array([0.0, 0.0, 1.0])
    slope = Plane((normal[0], normal[1], normal[2]), 0.0, friction=friction)
    return sheet(flat.moved(flat.vertices @ turn.T), (slope,)), -turn[:, 0]
