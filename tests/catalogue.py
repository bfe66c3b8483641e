"""Every formulation on one small curved mesh, for tests that loop over all of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from meshes import grid, jittered, rolled

from casashell.engine.energy import Energy
from casashell.engine.kernels import get_kernel
from casashell.mesh import TriMesh
from casashell.typing import FloatArray
from formulations import area_gravity, edge_stretch, hinge_bending, proximity

GRAVITY = np.array([1.0, -2.0, -9.0])
NAMES = ("stretch", "bend", "gravity", "proximity")


@dataclass(frozen=True)
class Case:
    """A term with generic positions: no two stencils alike, strains of some ten per cent."""

    term: Energy
    x: FloatArray
    r: FloatArray
    w: FloatArray

    def run(
        self, kernel: str, x: FloatArray, r: FloatArray, *, interpreted: bool = False
    ) -> tuple[FloatArray, ...]:
        """Outputs of a kernel, one row a stencil."""
        run = get_kernel(self.term.density, kernel, interpreted=interpreted)
        return run(x, r, self.term.params, self.term.stencils, self.w)


def build(name: str, mesh: TriMesh, gravity: FloatArray = GRAVITY, scale: float = 1.0) -> Energy:
    """The formulation ``name`` on ``mesh``; ``scale`` multiplies its stiffness or density."""
    if name == "stretch":
        return edge_stretch(mesh, scale * np.linspace(10.0, 20.0, len(mesh.edges)))
    if name == "bend":
        return hinge_bending(mesh, scale * np.linspace(1e-3, 2e-3, len(mesh.hinges)))
    if name == "gravity":
        return area_gravity(mesh, scale * np.linspace(0.1, 0.3, len(mesh.faces)), gravity)
    return proximity(mesh, scale * np.linspace(1.0, 5.0, len(mesh.vertices)))


def case(name: str) -> Case:
    """The formulation ``name`` with a natural shape, a pose and multipliers."""
    flat = grid(3, 2)
    natural = jittered(rolled(flat, 0.1, 0.4), 0.006, seed=1)
    pose = jittered(rolled(flat, 0.1, 0.7), 0.006, seed=2).vertices
    w = np.random.default_rng(3).standard_normal(pose.shape)
    return Case(build(name, natural), pose, natural.vertices, w)
