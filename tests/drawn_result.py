"""A small result to draw: a dome on a ball, its natural shape shrunk by a known factor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from casashell.contact.detect import Contacts
from casashell.contact.obstacles import Sphere
from casashell.mesh import TriMesh
from casashell.result import Certificate, Quality, Result, Step
from casashell.status import Status


def dome(rows: int = 9) -> TriMesh:
    """Paraboloid over a square of 1 m, 2 (rows - 1)^2 triangles, y up."""
    line = np.linspace(-0.5, 0.5, rows)
    z, x = np.meshgrid(line, line, indexing="ij")
    vertices = np.stack([x.ravel(), 0.3 - 0.6 * (x**2 + z**2).ravel(), z.ravel()], axis=1)
    corner = (np.arange(rows - 1)[:, None] * rows + np.arange(rows - 1)).ravel()
    one = np.stack([corner, corner + rows, corner + 1], axis=1)
    two = np.stack([corner + 1, corner + rows, corner + rows + 1], axis=1)
    return TriMesh(vertices, np.concatenate([one, two]))


def sample(factor: float = 0.9, rows: int = 9, *, contacts: bool = True) -> Result:
    """A result whose natural shape is the target scaled by ``factor`` about the origin."""
    target = dome(rows)
    middle = len(target.vertices) // 2
    touching = Contacts.empty()
    forces = np.zeros((0, 3))
    if contacts:
        touching = Contacts(
            vertices=np.array([middle, middle + 1]),
            normals=np.array([[0.0, 1.0, 0.0], [0.0, 1.0, 0.0]]),
            friction=np.array([0.5, 0.5]),
            gaps=np.array([0.0, 1e-4]),
            obstacle=np.array([0, 0]),
        )
        # The first uses half of its friction, the second twice as much as there is.
        forces = np.array([[0.25, 1.0, 0.0], [0.5, 0.5, 0.0]])
    return Result(
        status=Status.SOLVED,
        advice="Nothing <to> do & enjoy.",
        method="direct",
        target=target,
        rest=factor * target.vertices,
        pose=np.array(target.vertices),
        contacts=touching,
        pinned=np.zeros(0, dtype=np.int64),
        contact_forces=forces,
        forces=np.zeros_like(target.vertices),
        material={
            "stretch": np.full(len(target.edges), 20.0),
            "density": np.array(0.2),
            "gravity": np.array([0.0, -9.81, 0.0]),
        },
        certificate=Certificate(3.25e-12, 0.0125, 0.2, 12.5, 0.45, 2.1e-7, 0.015, 0.03),
        quality=Quality(abs(factor - 1.0), 0.25, 0.5, 0, 3),
        obstacles=(Sphere((0.0, -0.2, 0.0), 0.5, name="ball <b>&</b>"),) if contacts else (),
        history=(
            Step("stress program", 0.0, 0, np.nan, 0.01),
            Step("newton", 0.5, 1, 1e-2, 0.2),
            Step("newton", 1.0, 2, 1e-9, 0.3, "done <i>"),
        ),
        notes=("a note with <script>alert(1)</script>",),
        seconds=0.3,
        iterations=2,
        factorizations=5,
        timings={"solve": 0.3},
    )


def failed() -> Result:
    """A result that stopped before anything could be certified."""
    none = Certificate(None, None, None, None, None, None, 1.0, 0.1)
    return replace(
        sample(1.0, contacts=False),
        status=Status.ITERATION_LIMIT,
        certificate=none,
        material={},
        history=(),
        timings={},
        notes=(),
    )
