"""The convex stress program: least strain energy that holds the target (Ly 2018's inverse problem
with rest lengths and rest angles as free unknowns).

At fixed pose and masses the force is linear in the tensions of the edges and the moments of the
hinges:  sum_s tau_s dq_s/dx = load + contact forces, with the contact forces in their cones.  The
minimiser of sum tau^2 / (2 c) is what the shell would do if its natural shape were free, c being the
stiffness of each element at rest.  Stability enters by linear cuts v.H(tau).v >= delta, H being affine
in tau.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from itertools import pairwise

import casadi as ca
import clarabel
import numpy as np
import scipy.sparse as sp

from casashell.engine.energy import Energy
from casashell.engine.kernels import get_kernel
from casashell.inverse.forces import (
    Block,
    Shrink,
    cone_rows,
    contact_frames,
    run_clarabel,
)
from casashell.inverse.piece import Piece
from casashell.typing import FloatArray, IntArray


@cache
def _as_density(serialized: str) -> ca.Function:
    """A strain measure q(x) as a density of (x, r, p), so that it gets the same kernels."""
    measure = ca.Function.deserialize(serialized)
    k = measure.size2_in(0)
    x, r, p = ca.SX.sym("x", 3, k), ca.SX.sym("r", 3, k), ca.SX.sym("p", 0)
    return ca.Function(f"{measure.name()}_measure", [x, r, p], [measure(x)])


@dataclass(frozen=True)
class Stress:
    """Outcome of the program: contact forces (C,3) [N] and the largest strains it needs.

    largest_strain  largest |q - q_r| per term name: elongation [m] of edges, fold [rad] of hinges
    strain_forces   (T,) tau of every element: tension [N] of an edge, moment [N m] of a hinge
    energy          least strain energy, sum tau^2 / (2 c) [J]
    """

    contact_forces: FloatArray
    largest_strain: dict[str, float]
    strain_forces: FloatArray
    energy: float


class StressProgram:
    """The program of one piece at its target pose; the rows are made once."""

    def __init__(self, piece: Piece, loads: FloatArray | None = None) -> None:
        self.piece = piece
        self.loads = piece.loads if loads is None else loads
        self.terms = [t for t in piece.assembly.energies if t.measure is not None and not t.load]

    @property
    def complete(self) -> bool:
        """Whether every energy that is not a load enters the program."""
        internal = [t for t in self.piece.assembly.energies if not t.load]
        return bool(self.terms) and len(self.terms) == len(internal)

    def _kernel(self, term: Energy, name: str, use_measure: bool) -> tuple[FloatArray, ...]:
        target, interpreted = self.piece.target, self.piece.assembly.interpreted
        if use_measure:
            if term.measure is None:
                raise ValueError(f"energy '{term.name}' has no strain measure")
            density = _as_density(term.measure.serialize())
            params = np.empty((len(term.stencils), 0))
        else:
            density, params = term.density, term.params
        kernel = get_kernel(density, name, interpreted=interpreted)
        return kernel(target, target, params, term.stencils, target)

    def measured(self, term: Energy) -> tuple[FloatArray, FloatArray]:
        """Slope dq/dx (S,3k) and curvature d2q/dx2 (S,3k,3k) of a strain measure at the target."""
        slope, curve = self._kernel(term, "hessian", True)
        return slope, curve.reshape(len(slope), slope.shape[1], slope.shape[1])

    @cached_property
    def stiffness(self) -> FloatArray:
        """c of every element: d2E/dx2 at rest is c dq dq^T."""
        parts = []
        for term in self.terms:
            slope = self._kernel(term, "gradient", True)[0]
            size = slope.shape[1]
            block = self._kernel(term, "hessian", False)[1].reshape(-1, size, size)
            bent = (block @ slope[:, :, None])[:, :, 0]
            parts.append((slope * bent).sum(axis=1) / (slope**2).sum(axis=1) ** 2)
        return np.concatenate(parts) if parts else np.empty(0)

    @cached_property
    def slopes(self) -> sp.csr_array:
        """dq/dx of every element, one column each, (3n, T)."""
        blocks = []
        for term in self.terms:
            slope = self._kernel(term, "gradient", True)[0]
            rows = (3 * term.stencils[:, :, None] + np.arange(3)).reshape(slope.shape)
            columns = np.broadcast_to(np.arange(len(slope))[:, None], slope.shape)
            blocks.append(
                sp.csr_array(
                    (slope.ravel(), (rows.ravel(), columns.ravel())),
                    shape=(self.piece.target.size, len(slope)),
                )
            )
        return sp.csr_array(sp.hstack(blocks))

    def cut(self, direction: FloatArray) -> FloatArray:
        """Coefficients a (T+1,) with v.H.v = a[:T].strain_force + a[T], for a direction v (n,3).

        H is the Hessian at the target: c dq dq^T + tau d2q, so that v.H.v is affine in tau.
        """
        parts, constant, begin = [], 0.0, 0
        for term in self.terms:
            slope, second = self.measured(term)
            v: FloatArray = direction[term.stencils].reshape(slope.shape)
            parts.append(((second @ v[:, :, None])[:, :, 0] * v).sum(axis=1))
            c = self.stiffness[begin : begin + len(v)]
            constant += float((c * (v * slope).sum(axis=1) ** 2).sum())
            begin += len(v)
        return np.concatenate([*parts, [constant]])

    def tangent(self, strain_forces: FloatArray) -> sp.csr_array:
        """Hessian c dq dq^T + tau d2q of the elements under stress (T,), (3n, 3n) [N/m]."""
        assembly = self.piece.assembly
        pattern = assembly.pattern
        total = np.zeros(pattern.nnz)
        for term, part in zip(self.terms, self.parts, strict=True):
            slope, curve = self._kernel(term, "hessian", True)
            rank_one = slope[:, :, None] * slope[:, None, :]
            blocks = self.stiffness[part, None, None] * rank_one
            blocks += strain_forces[part, None, None] * curve.reshape(rank_one.shape)
            place = assembly.scatter_map(term).ravel()
            total += np.bincount(place, blocks.ravel(), minlength=pattern.nnz)
        return pattern.matrix(total)

    @cached_property
    def parts(self) -> list[slice]:
        """Which elements belong to each term."""
        ends = np.cumsum([0, *(len(t.stencils) for t in self.terms)])
        return [slice(int(a), int(b)) for a, b in pairwise(ends)]

    @cached_property
    def scale(self) -> FloatArray:
        """tau (T,) per unit of the unknowns, which makes the objective the identity."""
        return np.sqrt(self.stiffness * self.piece.f0 * self.piece.h)

    @cached_property
    def frames(self) -> tuple[sp.csr_array, IntArray]:
        """Basis of the contact forces, see `contact_frames`."""
        return contact_frames(self.piece.contacts)

    @cached_property
    def loose(self) -> IntArray:
        """Degrees of freedom that are not pinned, whose forces have to balance."""
        free = np.ones(len(self.piece.target), dtype=bool)
        free[self.piece.pinned] = False
        return np.flatnonzero(np.repeat(free, 3))

    @cached_property
    def balance(self) -> sp.csr_array:
        """Forces / f0 on the loose degrees of freedom per unit of the unknowns (tau, contacts)."""
        piece, at = self.piece, self.piece.contacts.vertices
        column = (3 * at[:, None] + np.arange(3)).ravel()
        scatter = sp.csr_array(
            (np.ones(len(column)), (column, np.arange(len(column)))),
            shape=(piece.target.size, len(column)),
        )
        elastic = self.slopes @ sp.diags_array(self.scale / piece.f0)
        return sp.csr_array(sp.hstack([elastic, -(scatter @ self.frames[0])]))[self.loose]

    def solve(
        self,
        shrink: Shrink,
        cuts: list[FloatArray] | None = None,
        delta: float = 0.0,
        limit: FloatArray | None = None,
    ) -> Stress | None:
        """Forces of least strain energy in the shrunk cones; None when there are none.

        cuts   directions (n,3) along which the energy has to curve by at least ``delta`` [N/m]
        limit  largest |q - q_r| (T,) allowed to every element
        """
        frames, owner = self.frames
        elements, m = len(self.stiffness), frames.shape[1]
        weight = self.loads.ravel()[self.loose] / self.piece.f0
        blocks: list[Block] = [(self.balance, weight, [clarabel.ZeroConeT(len(self.loose))])]
        if m:
            inside, bound, cones = cone_rows(self.piece.contacts, owner, shrink, shrink.floor)
            empty = sp.csr_array((inside.shape[0], elements))
            blocks.append((sp.csr_array(sp.hstack([empty, inside])), bound, cones))
        if cuts:
            blocks.append(self._cut_rows(cuts, delta, m))
        if limit is not None:
            blocks.append(self._limit_rows(limit, m))
        quadratic = sp.diags_array(
            np.concatenate([np.ones(elements), np.full(m, 1e-9)]), format="csc"
        )
        found, _, _ = run_clarabel(quadratic, np.zeros(elements + m), blocks)
        if found is None:
            return None
        tau = found[:elements] * self.scale
        strain = np.abs(tau / self.stiffness)
        largest = {
            t.name: float(strain[part].max(initial=0.0))
            for t, part in zip(self.terms, self.parts, strict=True)
        }
        forces = np.asarray((frames @ found[elements:]).reshape(-1, 3) * self.piece.f0)
        return Stress(forces, largest, tau, float(0.5 * (tau**2 / self.stiffness).sum()))

    def _cut_rows(self, cuts: list[FloatArray], delta: float, others: int) -> Block:
        """v.H.v >= delta for every direction; ``others`` unknowns follow the stresses."""
        rows, bound = [], []
        for v in cuts:
            a = self.cut(v)
            size = float(np.abs(a[:-1] * self.scale).max()) or 1.0
            rows.append(np.concatenate([-a[:-1] * self.scale / size, np.zeros(others)]))
            bound.append((a[-1] - delta) / size)
        cones: list[object] = [clarabel.NonnegativeConeT(len(cuts))]
        return sp.csr_array(np.array(rows)), np.array(bound), cones

    def _limit_rows(self, limit: FloatArray, others: int) -> Block:
        """|tau| <= c limit for every element with a finite limit."""
        bound = limit * self.stiffness / self.scale
        chosen = np.flatnonzero(np.isfinite(bound))
        one = sp.eye_array(len(bound), len(bound) + others, format="csr")[chosen]
        # Divided by the bound, so that soft elements do not ask for more digits than others.
        one = sp.csr_array(sp.diags_array(1.0 / bound[chosen]) @ one)
        rows = sp.csr_array(sp.vstack([one, -one]))
        cones: list[object] = [clarabel.NonnegativeConeT(rows.shape[0])]
        return rows, np.ones(rows.shape[0]), cones
