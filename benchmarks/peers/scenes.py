"""A result in plain arrays for programs that know nothing of casashell."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from casashell.contact.obstacles import Cone, Obstacle, Plane, Sphere
from casashell.io.results import load_result
from casashell.io.tessellate import Region, Surface, sunk, tessellate
from casashell.mesh import TriMesh
from casashell.result import Result
from casashell.typing import AnyArray, FloatArray
from formulations.calibration import calibrate

FPS: Final = 60
#: Distance a peer keeps between shell and body [m].  Bodies are sunk by it, so that nothing moves.
THICKNESS: Final = 0.002
#: Newton's own default [N/m].
CONTACT_STIFFNESS: Final = 1e3
_KINDS: Final = {Plane: 1, Cone: 2, Sphere: 3}

Arrays = dict[str, AnyArray]


@dataclass(frozen=True, eq=False)
class PeerScene:
    """A solved scene.

    sink  how far Blender's body is moved inwards [m], beyond which its triangles and those of the
          shell are nowhere nearer than the thickness
    """

    name: str
    folder: Path
    result: Result
    sink: float

    @staticmethod
    def read(folder: Path) -> PeerScene:
        """Raises ValueError for a folder without a certified result, or more than one friction."""
        result = load_result(folder)
        if not result.status.certified:
            raise ValueError(f"{folder}: status {result.status}: nothing that should hold")
        frictions = {float(obstacle.friction) for obstacle in result.obstacles}
        if len(frictions) > 1 or "vertex_friction" in result.material:
            raise ValueError(f"{folder}: these programs know one friction for all: {frictions}")
        for key in ("density", "stretch", "bend"):
            if np.ptp(np.asarray(result.material[key])) > 0.0:
                raise ValueError(f"{folder}: {key} differs between elements; give one value")
        return PeerScene(folder.name, folder, result, THICKNESS - least_distance(result))

    def value(self, key: str) -> float:
        """Density [kg/m2], stretch [N] or bend [J]."""
        return float(np.mean(np.asarray(self.result.material[key])))

    @property
    def size(self) -> float:
        """Diagonal of the bounding box [m]."""
        return float(self.result.target.bbox_diagonal)

    @property
    def vertex_mass(self) -> float:
        """Mean mass of a vertex [kg]."""
        area = float(TriMesh(self.result.rest, self.result.target.faces).face_areas.sum())
        return self.value("density") * area / len(self.result.rest)

    def common(self, rest: str, seconds: float) -> Arrays:
        """What both programs are told; ``rest`` is "natural" or "target"."""
        mesh = self.result.target
        natural = self.result.rest if rest == "natural" else mesh.vertices
        friction = self.result.obstacles[0].friction if self.result.obstacles else 0.0
        return {
            "start": self.result.pose if rest == "natural" else mesh.vertices,
            "rest": natural,
            "faces": mesh.faces,
            "pinned": self.result.pinned,
            "gravity": np.asarray(self.result.material["gravity"]).reshape(3),
            "friction": np.array(friction),
            "thickness": np.array(THICKNESS),
            "colliders": np.array(len(self.result.obstacles)),
            "frames": np.array(round(seconds * FPS)),
            "fps": np.array(FPS),
        }

    def for_blender(self, rest: str, seconds: float, settings: Arrays) -> Arrays:
        """Bodies as triangles; ``settings`` are those of `benchmarks.peers.blender_stiffness`."""
        made = self.common(rest, seconds) | settings
        for number, obstacle in enumerate(self.result.obstacles):
            surface = sunk(self._surface(obstacle), self.sink)
            made |= {f"vertices_{number}": surface.vertices, f"faces_{number}": surface.faces}
        return made

    def for_newton(
        self, rest: str, seconds: float, *, springs: bool, slow: float = 1e-2, steps: int = 10
    ) -> Arrays:
        """Analytic bodies where there are; contacts pressed from the start as in the design.

        A contact is as thick as its gap and as deep in Newton's elastic layer as its normal force
        asks for, so that friction can act in the first step.  ``slow`` [m/s] is the speed below
        which its friction is less than Coulomb's; 0.01 is its default.
        """
        made = self.common(rest, seconds)
        radii = np.full(len(made["start"]), THICKNESS)
        contacts = self.result.contacts
        pushed = (self.result.contact_forces * contacts.normals).sum(axis=1)
        radii[contacts.vertices] += contacts.gaps + pushed / CONTACT_STIFFNESS
        made |= newton_material(self, np.asarray(made["rest"])) | {
            "radii": radii,
            "contact_ke": np.array(CONTACT_STIFFNESS),
            "springs": np.array(springs),
            "friction_epsilon": np.array(slow),
            "substeps": np.array(steps),
            "iterations": np.array(10),
        }
        for number, obstacle in enumerate(self.result.obstacles):
            surface = sunk(self._surface(obstacle), THICKNESS)
            made |= {
                f"kind_{number}": np.array(_KINDS.get(type(obstacle), 0)),
                f"values_{number}": shrunk(obstacle, THICKNESS),
                f"vertices_{number}": surface.vertices,
                f"faces_{number}": surface.faces,
            }
        return made

    def _surface(self, obstacle: Obstacle) -> Surface:
        return tessellate(obstacle, Region.around(self.result.target.vertices, scale=3.0))


def newton_material(scene: PeerScene, rest: FloatArray) -> Arrays:
    """The discrete shell on the natural shape ``rest`` in the terms of Newton.

    Hinges and springs are then those of `formulations.discrete_shell` exactly; the membrane
    stiffness [N/m] of the sheet it stands for is that of `formulations.calibration`.
    """
    mesh = TriMesh(rest, scene.result.target.faces)
    i, j, k, el = (rest[column] for column in mesh.hinges.T)
    length = np.linalg.norm(j - i, axis=1)
    area = 0.5 * sum(np.linalg.norm(np.cross(j - i, apex - i), axis=1) for apex in (k, el))
    edge = np.linalg.norm(rest[mesh.edges[:, 1]] - rest[mesh.edges[:, 0]], axis=1)
    return {
        "density": np.array(scene.value("density")),
        "membrane": np.array(scene.value("stretch") / calibrate(mesh).stretch),
        "hinges": mesh.hinges,
        "edge_ke": scene.value("bend") * 3.0 * length / area,
        "edges": mesh.edges,
        "spring_ke": scene.value("stretch") / edge,
    }


def shrunk(obstacle: Obstacle, depth: float) -> FloatArray:
    """Numbers of a plane, cone or sphere whose surface lies ``depth`` [m] deeper; none for others."""
    if isinstance(obstacle, Plane):
        return np.array([*obstacle.normal, obstacle.offset - depth])
    if isinstance(obstacle, Cone):
        apex = np.array(obstacle.apex) + depth / math.sin(obstacle.half_angle) * np.array(
            obstacle.axis
        )
        length = 100.0 if obstacle.length is None else obstacle.length
        return np.array([*apex, *obstacle.axis, obstacle.half_angle, length])
    if isinstance(obstacle, Sphere):
        return np.array([*obstacle.center, obstacle.radius - depth])
    return np.zeros(0)


def least_distance(result: Result, parts: int = 6) -> float:
    """Least distance [m] of points all over the triangles of the design to the bodies."""
    shares = [
        (a / parts, b / parts, 1.0 - (a + b) / parts)
        for a in range(parts + 1)
        for b in range(parts + 1 - a)
    ]
    corners = result.target.vertices[result.target.faces]
    points = np.einsum("sk,fkd->sfd", np.array(shares), corners).reshape(-1, 3)
    found = [float(body.signed_distance(points)[0].min()) for body in result.obstacles]
    return min(found, default=0.0)
