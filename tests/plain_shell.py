"""The shell energy once more, as loops over elements: what the certificate is held against."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casashell.engine.energy import Energy
from casashell.mesh import TriMesh
from casashell.typing import FloatArray
from formulations import discrete_shell


def dihedral(x: FloatArray, hinge: tuple[int, int, int, int]) -> float:
    """Signed angle between the normals of (i, j, k) and (j, i, l)."""
    i, j, k, el = hinge
    edge = x[j] - x[i]
    first, second = np.cross(edge, x[k] - x[i]), np.cross(x[el] - x[i], edge)
    sine = np.cross(first, second) @ edge / np.linalg.norm(edge)
    return float(np.arctan2(sine, first @ second))


@dataclass(frozen=True)
class PlainShell:
    """Edges, hinges and faces of ``mesh`` with one material."""

    mesh: TriMesh
    density: float = 0.2
    stretch: float = 20.0
    bend: float = 1e-3
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)

    def terms(self) -> tuple[Energy, ...]:
        """The same shell from `formulations`."""
        return discrete_shell(
            self.mesh,
            density=self.density,
            stretch=self.stretch,
            bend=self.bend,
            gravity=self.gravity,
        )

    def energy(self, x: FloatArray, r: FloatArray) -> float:
        """Ly 2018, Eqs. 9, 10 and 12 [J]."""
        total = 0.0
        for i, j in self.mesh.edges:
            rest = float(np.linalg.norm(r[j] - r[i]))
            total += self.stretch / 2 * (float(np.linalg.norm(x[j] - x[i])) - rest) ** 2 / rest
        for row in self.mesh.hinges:
            i, j, k, el = (int(v) for v in row)
            edge = r[j] - r[i]
            area = np.linalg.norm(np.cross(edge, r[k] - r[i])) / 2
            area += np.linalg.norm(np.cross(edge, r[el] - r[i])) / 2
            turn = dihedral(x, (i, j, k, el)) - dihedral(r, (i, j, k, el))
            total += self.bend / 2 * 3 * (edge @ edge) / area * turn**2
        for a, b, c in self.mesh.faces:
            area = np.linalg.norm(np.cross(r[b] - r[a], r[c] - r[a])) / 2
            total -= self.density * area / 3 * (x[a] + x[b] + x[c]) @ np.array(self.gravity)
        return float(total)

    def forces(self, x: FloatArray, r: FloatArray, step: float = 1e-6) -> FloatArray:
        """dE/dx (V,3) by central differences [N]."""
        made = np.zeros_like(x)
        for index in np.ndindex(*x.shape):
            moved = np.zeros_like(x)
            moved[index] = step
            made[index] = (self.energy(x + moved, r) - self.energy(x - moved, r)) / (2.0 * step)
        return made
