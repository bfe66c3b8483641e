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
from casashell.typing import FloatArray


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

    angle  largest |theta - theta_r| over hinges [rad], per term name
    """

    contact_forces: FloatArray
    largest_strain: dict[str, float]


class StressProgram:
    """The program of one piece at its target pose; the rows are made once."""

    def __init__(self, piece: Piece, loads: FloatArray | None = None) -> None:
        self.piece = piece
        self.loads = piece.loads if loads is None else loads
        self.terms = [
            t
            for t in (term.without_idle() for term in piece.energies)
            if t.measure is not None and not t.load and len(t.stencils)
        ]

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
            slope, curve = self._kernel(term, "hessian", True)
            v: FloatArray = direction[term.stencils].reshape(slope.shape)
            second = curve.reshape(len(v), v.shape[1], v.shape[1])
            parts.append(((second @ v[:, :, None])[:, :, 0] * v).sum(axis=1))
            c = self.stiffness[begin : begin + len(v)]
            constant += float((c * (v * slope).sum(axis=1) ** 2).sum())
            begin += len(v)
        return np.concatenate([*parts, [constant]])

    def solve(
        self, shrink: Shrink, cuts: list[FloatArray] | None = None, delta: float = 0.0
    ) -> Stress | None:
        """Forces of least strain energy in the shrunk cones; None when there are none.

        cuts   directions (n,3) along which the energy has to curve by at least ``delta`` [N/m]
        """
        piece = self.piece
        f0, contacts = piece.f0, piece.contacts
        frames, owner = contact_frames(contacts)
        elements, m = len(self.stiffness), frames.shape[1]
        # Unknowns: tau / sqrt(c f0 h), which makes the objective the identity, and forces / f0.
        scale = np.sqrt(self.stiffness * f0 * piece.h)
        free = np.ones(len(piece.target), dtype=bool)
        free[piece.pinned] = False
        rows = np.flatnonzero(np.repeat(free, 3))
        at = (3 * contacts.vertices[:, None] + np.arange(3)).ravel()
        scatter = sp.csr_array(
            (np.ones(len(at)), (at, np.arange(len(at)))), shape=(piece.target.size, len(at))
        )
        elastic = self.slopes @ sp.diags_array(scale / f0)
        balance = sp.csr_array(sp.hstack([elastic, -(scatter @ frames)]))[rows]
        weight = self.loads.ravel()[rows] / f0
        blocks: list[Block] = [(balance, weight, [clarabel.ZeroConeT(len(rows))])]
        if m:
            inside, bound, cones = cone_rows(contacts, owner, shrink, shrink.floor)
            empty = sp.csr_array((inside.shape[0], elements))
            blocks.append((sp.csr_array(sp.hstack([empty, inside])), bound, cones))
        for v in cuts or []:
            a = self.cut(v)
            size = float(np.abs(a[:-1] * scale).max()) or 1.0
            row = np.concatenate([-a[:-1] * scale / size, np.zeros(m)])[None, :]
            blocks.append(
                (
                    sp.csr_array(row),
                    np.array([(a[-1] - delta) / size]),
                    [clarabel.NonnegativeConeT(1)],
                )
            )
        quadratic = sp.diags_array(
            np.concatenate([np.ones(elements), np.full(m, 1e-9)]), format="csc"
        )
        found, _, _ = run_clarabel(quadratic, np.zeros(elements + m), blocks)
        if found is None:
            return None
        strain = np.abs(found[:elements] * scale / self.stiffness)
        ends = np.cumsum([0, *(len(t.stencils) for t in self.terms)])
        largest = {
            t.name: float(strain[a:b].max(initial=0.0))
            for t, a, b in zip(self.terms, ends[:-1], ends[1:], strict=True)
        }
        forces = np.asarray((frames @ found[elements:]).reshape(-1, 3) * f0)
        return Stress(forces, largest)
