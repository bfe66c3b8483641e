"""The natural shape as a nonlinear program: balance at a given pose, forces in their cones.

    minimise    |u|^2 / 2 + central/2 |(a, b)|^2              u = (r - r_ref) / h
    subject to  (dE/dx(x, r) - S f) / f0 = 0                  at every vertex that is not pinned
                f_c = f0 N_c (n + mu' (a t1 + b t2)),  N_c >= floor,  a^2 + b^2 <= 1

Pinned vertices take any reaction and keep their natural position; frictionless contacts have N alone.
Cones in this form keep their constraint qualification at the apex and measure a violation of friction
in units of mu f_N, however small the force.  The elastic version adds a slack s to every balance row
and weight/2 |s|^2 to the objective: it always has a solution, and says by how much balance fails.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from casashell.contact.cone import split, tangents
from casashell.engine.nlp import Nlp
from casashell.inverse.cone_residual import BETA
from casashell.inverse.piece import Piece
from casashell.inverse.pulled import Pulled
from casashell.typing import FloatArray, IntArray

#: Weight of |(a, b)|^2, which makes a, b defined where N = 0, and one that also keeps forces off the rim
#: of their cones.  With that the program is better posed: the beret of Ly 2018 takes 31 iterations rather
#: than 171, if it converges at all.  But then some contacts carry nothing.
FAINT, CENTRAL = 1e-6, 1.0


@dataclass(frozen=True, eq=False)
class BalanceNlp:
    """The program of one piece at pose x (n,3) near the natural shape ``reference`` (n,3).

    energy   potential energy with the pull of Ly 2018, Eq. 24 (0 for the plain one)
    floor    least normal force / f0 of a contact
    beta     share of every friction coefficient that is used
    central  weight of |(a, b)|^2
    weight   of the slack; None for the program without slack
    """

    energy: Pulled
    pose: FloatArray
    reference: FloatArray
    floor: float = 0.0
    beta: float = BETA
    central: float = FAINT
    weight: float | None = None

    def __post_init__(self) -> None:
        shape = self.piece.target.shape
        for name in ("pose", "reference"):
            if np.shape(getattr(self, name)) != shape:
                raise ValueError(f"{name} must have shape {shape}")
        if not (np.isfinite(self.floor) and self.floor >= 0.0):
            raise ValueError(f"floor must be a share of f0 >= 0, got {self.floor}")
        if not 0.0 < self.beta <= 1.0:
            raise ValueError(f"beta must be above 0 and at most 1, got {self.beta}")
        if self.weight is not None and not self.weight > 0.0:
            raise ValueError(f"the weight of the slack must be positive, got {self.weight}")

    @property
    def piece(self) -> Piece:
        """What is to be balanced."""
        return self.energy.piece

    @property
    def elastic(self) -> bool:
        """Whether balance rows have a slack."""
        return self.weight is not None

    @cached_property
    def dofs(self) -> IntArray:
        """Degrees of freedom of the unpinned vertices (d,): unknowns and balance rows."""
        loose = np.setdiff1d(np.arange(len(self.piece.target)), self.piece.pinned)
        return np.asarray((3 * loose[:, None] + np.arange(3)).ravel())

    @cached_property
    def _rough(self) -> IntArray:
        return np.flatnonzero(self.piece.contacts.friction > 0.0)

    @cached_property
    def _axes(self) -> tuple[FloatArray, FloatArray]:
        """mu' t1 and mu' t2 of the rough contacts, each (R,3)."""
        contacts = self.piece.contacts
        mu = self.beta * contacts.friction[self._rough, None]
        t1, t2 = tangents(contacts.normals[self._rough])
        return mu * t1, mu * t2

    @cached_property
    def _starts(self) -> IntArray:
        """Where u, N, a, b and s begin, and their end."""
        d, c, rough = len(self.dofs), len(self.piece.contacts), len(self._rough)
        return np.cumsum([0, d, c, rough, rough, d if self.elastic else 0])

    @cached_property
    def _row(self) -> IntArray:
        """First balance row of the vertex of every contact (C,)."""
        place = np.full(self.piece.target.size, -1, dtype=np.int64)
        place[self.dofs] = np.arange(len(self.dofs))
        return place[3 * self.piece.contacts.vertices]

    def unknowns(self, rest: FloatArray, forces: FloatArray) -> FloatArray:
        """Unknowns (N,) for a natural shape (n,3) and contact forces (C,3) [N]; no slack."""
        piece = self.piece
        u = ((rest - self.reference) / piece.h).ravel()[self.dofs]
        normal, tangent = split(forces, piece.contacts.normals)
        push = np.maximum(normal, 1e-12 * piece.f0)[self._rough, None]
        first, second = self._axes
        mu2 = (first**2).sum(axis=1)
        share = [(tangent[self._rough] / push * axis).sum(axis=1) / mu2 for axis in (first, second)]
        size = np.maximum(1.0, np.hypot(*share) / 0.9)  # into the disc
        slack = np.zeros(len(u) if self.elastic else 0)
        return np.concatenate(
            [u, np.maximum(normal / piece.f0, self.floor), *(s / size for s in share), slack]
        )

    def _parts(self, unknowns: FloatArray) -> list[FloatArray]:
        """u, N, a, b, s."""
        return np.split(unknowns, self._starts[1:-1])

    def rest(self, unknowns: FloatArray) -> FloatArray:
        """Natural shape (n,3) [m]; pinned vertices as in the reference."""
        found = self.reference.ravel().copy()
        found[self.dofs] += self.piece.h * unknowns[: len(self.dofs)]
        return found.reshape(-1, 3)

    def contact_forces(self, unknowns: FloatArray) -> FloatArray:
        """Forces of the contacts (C,3) [N]."""
        _, push, *_ = self._parts(unknowns)
        return self.piece.f0 * push[:, None] * self._directions(unknowns)

    def slack(self, unknowns: FloatArray) -> float:
        """Largest slack / f0; zero for the program without."""
        return float(np.abs(self._parts(unknowns)[4]).max(initial=0.0))

    def _directions(self, unknowns: FloatArray) -> FloatArray:
        """n + mu' (a t1 + b t2) of every contact (C,3)."""
        _, _, a, b, _ = self._parts(unknowns)
        first, second = self._axes
        found = self.piece.contacts.normals.copy()
        found[self._rough] += a[:, None] * first + b[:, None] * second
        return found

    def nlp(self, start: FloatArray) -> Nlp:
        """The program from ``start`` (see `unknowns`)."""
        _, n, a, b, end = self._starts[1:]
        lower, upper = np.full(end, -np.inf), np.full(end, np.inf)
        lower[self._starts[1] : n] = self.floor
        d, cones = len(self.dofs), len(self._rough)
        rows, columns = self._jacobian_pattern
        hessian_rows, hessian_columns = self._hessian_pattern
        del a, b
        return Nlp(
            start=start,
            lower=lower,
            upper=upper,
            constraint_lower=np.concatenate([np.zeros(d), np.full(cones, -np.inf)]),
            constraint_upper=np.concatenate([np.zeros(d), np.ones(cones)]),
            objective=lambda x: 0.5 * float(self._weights @ (x * x)),
            objective_gradient=lambda x: self._weights * x,
            constraints=self._constraints,
            jacobian=self._jacobian,
            jacobian_rows=rows,
            jacobian_columns=columns,
            hessian=self._hessian,
            hessian_rows=hessian_rows,
            hessian_columns=hessian_columns,
        )

    @cached_property
    def _weights(self) -> FloatArray:
        """Diagonal of the objective."""
        sizes = np.diff(self._starts)
        return np.repeat([1.0, 0.0, self.central, self.central, self.weight or 0.0], sizes)

    def _constraints(self, unknowns: FloatArray) -> FloatArray:
        piece = self.piece
        _, _, a, b, slack = self._parts(unknowns)
        forces = self.energy.gradient(self.pose, self.rest(unknowns))
        gap = (forces - piece.spread(self.contact_forces(unknowns))).ravel()[self.dofs] / piece.f0
        if self.elastic:
            gap = gap - slack
        return np.concatenate([gap, a * a + b * b])

    @cached_property
    def _chosen(self) -> tuple[IntArray, IntArray, IntArray]:
        """Entries of the assembly's pattern between unknowns, with their rows and columns here."""
        pattern = self.piece.assembly.pattern
        place = np.full(pattern.size, -1, dtype=np.int64)
        place[self.dofs] = np.arange(len(self.dofs))
        rows, columns = place[pattern.rows], place[pattern.indices]
        chosen = np.flatnonzero((rows >= 0) & (columns >= 0))
        return chosen, rows[chosen], columns[chosen]

    @cached_property
    def _jacobian_pattern(self) -> tuple[IntArray, IntArray]:
        _, rows, columns = self._chosen
        d = len(self.dofs)
        starts, axis = self._starts, np.arange(3)
        at, mine = self._row[:, None] + axis, np.arange(len(self._row))
        on, rough = at[self._rough], np.arange(len(self._rough))
        slack = np.arange(d if self.elastic else 0)
        return (
            np.concatenate([rows, at.ravel(), on.ravel(), on.ravel(), d + rough, d + rough, slack]),
            np.concatenate(
                [
                    columns,
                    np.repeat(starts[1] + mine, 3),
                    np.repeat(starts[2] + rough, 3),
                    np.repeat(starts[3] + rough, 3),
                    starts[2] + rough,
                    starts[3] + rough,
                    starts[4] + slack,
                ]
            ),
        )

    def _jacobian(self, unknowns: FloatArray) -> FloatArray:
        piece = self.piece
        _, push, a, b, slack = self._parts(unknowns)
        _, entries = self.energy.mixed(self.pose, self.rest(unknowns))
        first, second = self._axes
        share = push[self._rough, None]
        return np.concatenate(
            [
                entries[self._chosen[0]] * (piece.h / piece.f0),
                -self._directions(unknowns).ravel(),
                -(share * first).ravel(),
                -(share * second).ravel(),
                2.0 * a,
                2.0 * b,
                np.full(len(slack), -1.0),
            ]
        )

    @cached_property
    def _upper(self) -> IntArray:
        """Which of the chosen entries lie in the upper triangle."""
        _, rows, columns = self._chosen
        return np.flatnonzero(rows <= columns)

    @cached_property
    def _hessian_pattern(self) -> tuple[IntArray, IntArray]:
        _, rows, columns = self._chosen
        starts, rough = self._starts, np.arange(len(self._rough))
        diagonal = np.arange(starts[-1])
        return (
            np.concatenate(
                [rows[self._upper], starts[1] + self._rough, starts[1] + self._rough, diagonal]
            ),
            np.concatenate([columns[self._upper], starts[2] + rough, starts[3] + rough, diagonal]),
        )

    def _hessian(self, unknowns: FloatArray, scale: float, multipliers: FloatArray) -> FloatArray:
        piece = self.piece
        d = len(self.dofs)
        on_balance, on_cones = multipliers[:d], multipliers[d:]
        spread = np.zeros(piece.target.size)
        spread[self.dofs] = on_balance
        by_vertex = spread.reshape(-1, 3)
        entries = piece.assembly.lagrangian(self.pose, self.rest(unknowns), by_vertex)
        felt = by_vertex[piece.contacts.vertices[self._rough]]
        diagonal = scale * self._weights
        diagonal[self._starts[2] : self._starts[4]] += 2.0 * np.tile(on_cones, 2)
        return np.concatenate(
            [
                entries[self._chosen[0]][self._upper] * (piece.h**2 / piece.f0),
                *(-(felt * axis).sum(axis=1) for axis in self._axes),
                diagonal,
            ]
        )

    def softened(self, weight: float) -> BalanceNlp:
        """The elastic version."""
        return replace(self, weight=weight)

    def centred(self) -> BalanceNlp:
        """The version that keeps contact forces off the rim of their cones."""
        return replace(self, central=CENTRAL)
