"""The shell once more for checks: Ly 2018, Eqs. (9)-(12), by formulas worked out by hand.

Gradients are written with operations that allow complex numbers, so that one complex step makes
every column of a Hessian, exact to rounding.  Nothing here comes from ``formulations`` or the solver.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casashell.problem import Problem
from casashell.typing import AnyArray, FloatArray, IntArray

_IMAGINARY = 1e-40


def _dot(a: AnyArray, b: AnyArray) -> AnyArray:
    """Bilinear product, not the Hermitian one: complex steps have to pass through."""
    return np.asarray((a * b).sum(axis=-1))


def _cross(a: AnyArray, b: AnyArray) -> AnyArray:
    return np.cross(a, b)


def fold(x: AnyArray) -> AnyArray:
    """Dihedral angles (S,) of hinges x (S,4,3): ends, then opposite vertices; zero when flat."""
    edge = x[:, 1] - x[:, 0]
    first, second = _cross(edge, x[:, 2] - x[:, 0]), _cross(x[:, 3] - x[:, 0], edge)
    length = np.sqrt(_dot(edge, edge))
    sine, cosine = _dot(_cross(first, second), edge) / length, _dot(first, second)
    angle = np.arctan2(sine.real, cosine.real)
    if not np.iscomplexobj(sine):
        return np.asarray(angle)
    slope = cosine.real * sine.imag - sine.real * cosine.imag
    return np.asarray(angle + 1j * slope / (sine.real**2 + cosine.real**2))


def fold_gradient(x: AnyArray) -> AnyArray:
    """Its gradient (S,4,3): the opposite vertices move along their normals, the ends balance them."""
    edge, a, b = x[:, 1] - x[:, 0], x[:, 2] - x[:, 0], x[:, 3] - x[:, 0]
    square = _dot(edge, edge)
    first, second = _cross(edge, a), _cross(b, edge)
    length = np.sqrt(square)
    at_a = -first * (length / _dot(first, first))[:, None]
    at_b = -second * (length / _dot(second, second))[:, None]
    share_a, share_b = (_dot(a, edge) / square)[:, None], (_dot(b, edge) / square)[:, None]
    far = -(share_a * at_a + share_b * at_b)
    near = -at_a - at_b - far
    return np.stack([near, far, at_a, at_b], axis=1)


def areas(r: FloatArray, faces: IntArray) -> FloatArray:
    """Areas of triangles (F,)."""
    a, b, c = (r[faces[:, k]] for k in range(3))
    return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))


@dataclass(frozen=True, eq=False)
class Shell:
    """Connectivity and material of a problem, one value per element; SI."""

    edges: IntArray
    hinges: IntArray
    faces: IntArray
    stretch: FloatArray
    bend: FloatArray
    density: FloatArray
    gravity: FloatArray

    @staticmethod
    def of(problem: Problem) -> Shell:
        """From what the energy terms say about themselves; scalars are spread."""
        told: dict[str, AnyArray] = {}
        for term in problem.energies:
            told.update(term.material)
        faces = problem.target.faces

        def spread(name: str, count: int) -> FloatArray:
            return np.array(np.broadcast_to(told[name], (count,)), dtype=float)

        edges, hinges = np.asarray(told["edges"]), np.asarray(told["hinges"])
        return Shell(
            edges=edges,
            hinges=hinges,
            faces=faces,
            stretch=spread("stretch", len(edges)),
            bend=spread("bend", len(hinges)),
            density=spread("density", len(faces)),
            gravity=np.asarray(told["gravity"], dtype=float),
        )

    def weights(self, r: FloatArray) -> FloatArray:
        """Force of gravity on every vertex (V,3) [N] with the masses of natural shape r."""
        made = np.zeros_like(r)
        share = (self.density * areas(r, self.faces))[:, None] / 3.0 * self.gravity
        for corner in range(3):
            np.add.at(made, self.faces[:, corner], share)
        return made

    def _edge_forces(self, x: AnyArray, r: FloatArray) -> AnyArray:
        span = x[:, 1] - x[:, 0]
        rest = np.linalg.norm(r[self.edges[:, 1]] - r[self.edges[:, 0]], axis=1)
        length = np.sqrt(_dot(span, span))
        pull = (self.stretch * (length - rest) / (rest * length))[:, None] * span
        return np.stack([-pull, pull], axis=1)

    def _hinge_forces(self, x: AnyArray, r: FloatArray) -> AnyArray:
        corners = r[self.hinges]
        edge = corners[:, 1] - corners[:, 0]
        twice = sum(
            np.linalg.norm(np.cross(edge, corners[:, k] - corners[:, 0]), axis=1) for k in (2, 3)
        )
        moment = self.bend * 6.0 * _dot(edge, edge) / twice * (fold(x) - fold(corners))
        return np.asarray(moment[:, None, None] * fold_gradient(x))

    def forces(self, x: FloatArray, r: FloatArray) -> FloatArray:
        """dE/dx (V,3) [N] at pose x and natural shape r."""
        made = -self.weights(r)
        np.add.at(made, self.edges, self._edge_forces(x[self.edges], r))
        if len(self.hinges):
            np.add.at(made, self.hinges, self._hinge_forces(x[self.hinges], r))
        return made

    def stiffness(self, x: FloatArray, r: FloatArray) -> FloatArray:
        """d2E/dx2, dense (3V,3V) [N/m]; weight has none."""
        matrix = np.zeros((x.size, x.size))
        for stencils, forces in (
            (self.edges, self._edge_forces),
            (self.hinges, self._hinge_forces),
        ):
            if not len(stencils):
                continue
            now = x[stencils].astype(np.complex128)
            dofs = (3 * stencils[:, :, None] + np.arange(3)).reshape(len(stencils), -1)
            for column in range(dofs.shape[1]):
                corner, axis = divmod(column, 3)
                now[:, corner, axis] += 1j * _IMAGINARY
                slope = forces(now, r).imag.reshape(len(stencils), -1) / _IMAGINARY
                now[:, corner, axis] = x[stencils[:, corner], axis]
                np.add.at(matrix, (dofs, dofs[:, [column]]), slope)
        return 0.5 * (matrix + matrix.T)

    def rounding(self, x: FloatArray) -> float:
        """Force [N] that rounding of the coordinates x alone can make, worst vertex.

        A coordinate is known to half a unit in its last place; lengths and angles feel that, and
        the elements answer with their stiffness.
        """
        doubt = 0.5 * np.spacing(np.abs(x).max())
        stiff = np.zeros(len(x))
        span = np.linalg.norm(x[self.edges[:, 1]] - x[self.edges[:, 0]], axis=1)
        np.add.at(stiff, self.edges, (self.stretch / span)[:, None])
        if len(self.hinges):
            corners = x[self.hinges]
            edge = corners[:, 1] - corners[:, 0]
            heights = [
                np.linalg.norm(np.cross(edge, corners[:, k] - corners[:, 0]), axis=1)
                / np.linalg.norm(edge, axis=1)
                for k in (2, 3)
            ]
            thin = np.minimum(*heights)
            factor = self.bend * 6.0 * np.linalg.norm(edge, axis=1) / sum(heights)
            np.add.at(stiff, self.hinges, (factor / thin**2)[:, None])
        return float(doubt * stiff.max())
