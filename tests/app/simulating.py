"""A solved page on a mesh, as a result folder in centimetres, and what moves below it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from casashell.app.builtin import page
from casashell.contact.mesh_obstacle import MeshObstacle
from casashell.contact.obstacles import Sphere
from casashell.io.meshes import write_mesh
from casashell.io.results import save_result
from casashell.mesh import TriMesh
from casashell.solving import solve
from casashell.typing import FloatArray

#: Metres per unit of the folder.
UNIT = 0.01


def table() -> TriMesh:
    """A closed box, its top a square of 0.4 m at y = 0."""
    corners = np.array([[x, y, z] for y in (-0.05, 0.0) for x in (-0.2, 0.2) for z in (-0.2, 0.2)])
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return TriMesh(corners, np.array(faces))


def solved_page(folder: Path) -> Path:
    """A page of 42 vertices that stands on ``table`` beside a ball that it does not touch."""
    scene = page(7, 6)
    friction = scene.obstacles[0].friction
    bodies = (
        MeshObstacle(table(), friction, "table"),
        Sphere((0.5, 0.5, 0.0), 0.05, friction=0.3, name="ball"),
    )
    scene = replace(scene, obstacles=bodies, unit=UNIT)
    result = replace(solve(scene.problem), contact_tolerance=scene.problem.tolerance)
    assert result.status.certified
    save_result(result, folder, unit=UNIT, name=scene.name)
    return folder


def write_sequence(folder: Path, shifts: FloatArray, name: str = "table_{:03d}.obj") -> Path:
    """The table at shifts (K,3) [m] as numbered meshes from 1, in centimetres."""
    folder.mkdir(parents=True, exist_ok=True)
    mesh = table()
    for number, shift in enumerate(shifts, start=1):
        write_mesh(folder / name.format(number), mesh, mesh.vertices + shift, unit=UNIT)
    return folder


def steady(frames: int, step: float) -> FloatArray:
    """Shifts (frames,3) along x, ``step`` [m] a frame."""
    shifts: FloatArray = np.outer(np.arange(frames), [step, 0.0, 0.0])
    return shifts
