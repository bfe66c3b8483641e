"""Strips that are stretched and bent by their weight, to compare stiffnesses of different programs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import casadi as ca
import numpy as np

from casashell.contact.obstacles import Plane
from casashell.engine.assembly import Assembly
from casashell.engine.energy import Energy
from casashell.inverse.nonpenetration import settle
from casashell.mesh import TriMesh
from casashell.strain import dihedral_angles
from casashell.typing import FloatArray, IntArray
from formulations.edge_stretch import edge_stretch
from formulations.hinge_bending import hinge_bending

ROWS: Final = 8
DOWN: Final[FloatArray] = np.array([0.0, -1.0, 0.0])
ALONG: Final[FloatArray] = np.array([1.0, 0.0, 0.0])


@dataclass(frozen=True, eq=False)
class Strip:
    """A flat strip along +x in the plane y = 0, three vertices wide; its first rows are pinned."""

    mesh: TriMesh
    pinned: IntArray

    @staticmethod
    def of(edge: float) -> Strip:
        """Equilateral triangles with sides of ``edge`` [m]."""
        i, j = (index.ravel() for index in np.mgrid[: ROWS + 1, :3])
        height = 0.5 * math.sqrt(3.0) * edge
        points = np.stack([height * i, 0.0 * i, edge * (j + 0.5 * (i % 2))], axis=1)
        faces: list[tuple[int, int, int]] = []
        for a in range(ROWS):
            for b in range(2):
                p, q = 3 * a + b, 3 * a + b + 3
                odd = a % 2
                faces += (
                    [(p, q, q + 1), (p, q + 1, p + 1)]
                    if odd
                    else [(p, q, p + 1), (p + 1, q, q + 1)]
                )
        return Strip(TriMesh(points, np.array(faces, dtype=np.int64)), np.arange(6))

    @property
    def free_length(self) -> float:
        """From the last pinned row to the end [m]."""
        return float(self.mesh.vertices[-1, 0] - self.mesh.vertices[3, 0])

    def at_rest(self, weight: float, stretch: float, bend: float, down: FloatArray) -> FloatArray:
        """Our pose (V,3) when every vertex weighs ``weight`` [N]: programs with one mass for all."""
        count = len(self.mesh.vertices)
        x, r, p = ca.SX.sym("x", 3), ca.SX.sym("r", 3), ca.SX.sym("p", 3)
        loads = Energy(
            name="even weight",
            density=ca.Function("even_weight", [x, r, p], [-ca.dot(p, x)]),
            stencils=np.arange(count)[:, None],
            params=np.tile(weight * down, (count, 1)),
            load=True,
        )
        terms = (edge_stretch(self.mesh, stretch), hinge_bending(self.mesh, bend), loads)
        far = Plane((0.0, 1.0, 0.0), -100.0 * self.free_length)
        flat = self.mesh.vertices
        found = settle(Assembly(terms, count), flat, far, pinned=self.pinned, tolerance=1e-6)
        if not found.converged:
            raise RuntimeError(f"the strip did not come to rest: residual {found.residual:.1e}")
        return found.pose

    def longer(self, pose: FloatArray) -> float:
        """How much longer the free part is, as a share."""
        return float((pose[-3:, 0] - self.mesh.vertices[-3:, 0]).mean()) / self.free_length

    def sag(self, pose: FloatArray) -> float:
        """How far the end hangs below the clamp, in free lengths."""
        return float(-pose[-3:, 1].mean()) / self.free_length

    def rolled(self, fold: float) -> FloatArray:
        """The strip (V,3) rolled up by ``fold`` [rad] from row to row, all edges as long as before."""
        x, _, z = self.mesh.vertices.T
        angle = fold * np.arange(ROWS + 1).repeat(3)
        radius = 0.5 * (x[3] - x[0]) / math.sin(0.5 * fold)
        return np.stack([radius * np.sin(angle), radius * (np.cos(angle) - 1.0), z], axis=1)

    def mean_fold(self, pose: FloatArray) -> float:
        """Mean angle [rad] of the hinges that the roll folds and the pins leave free."""
        hinges = self.mesh.hinges[(self.mesh.hinges >= 6).any(axis=1)]
        flat = np.abs(dihedral_angles(self.rolled(0.1), hinges)) > 1e-6
        return float(dihedral_angles(pose, hinges[flat]).mean())
