"""Results that were never solved for, and shells that move in closed form."""

from __future__ import annotations

import numpy as np
from meshes import grid

from casashell.contact.obstacles import Obstacle, Plane
from casashell.inverse.certificate import no_certificate
from casashell.mesh import TriMesh
from casashell.problem import Problem
from casashell.result import Quality, Result
from casashell.status import Status
from casashell.typing import FloatArray
from formulations import discrete_shell

G = 9.81


def posed(problem: Problem) -> Result:
    """The target as a result: natural shape and pose are the target, there are no forces."""
    x = np.array(problem.target.vertices)
    contacts = problem.contacts
    return Result(
        status=Status.ITERATION_LIMIT,
        advice="",
        method="none",
        target=problem.target,
        rest=x,
        pose=x,
        contacts=contacts,
        pinned=np.asarray(problem.pinned),
        contact_forces=np.zeros((len(contacts), 3)),
        forces=np.zeros_like(x),
        material={},
        certificate=no_certificate(problem.target),
        quality=Quality(0.0, 0.0, 1.0, 0, 0),
        obstacles=problem.obstacles,
        contact_tolerance=problem.tolerance,
        energies=problem.energies,
    )


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
