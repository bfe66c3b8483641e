"""The function G_K of Ly 2018, Sec. 6: zero exactly where every force lies in its cone.

Forces are dE/dx, which is what the obstacle has to exert.  At a free vertex the cone is {0} and G_K is
the force itself; at a pinned vertex every force is admissible; at a contact it is one number

    kinked  h(u) = g(u_N) + g(mu' u_N - |u_T|),           g(t) = -t   for t < 0, else 0
    smooth  h(u) = g(u_N) + g(mu'^2 u_N^2 - |u_T|^2),     g(t) = t^2  for t < 0, else 0

with mu' = 0.975 mu (their Sec. 7.2).  A vertex with several contacts has the sum of their cones, for
which the paper has no h: it gets the vector to the nearest admissible force.  Forces are measured in
f0, so that G = |G_K|^2 / 2 is a pure number.
"""

from __future__ import annotations

from typing import Final, Literal, get_args

import numpy as np

from casashell.contact.cone import project, split
from casashell.inverse.piece import Piece
from casashell.inverse.pulled import Pulled
from casashell.typing import BoolArray, FloatArray, IntArray

#: Share beta of the friction coefficient that is used (Ly 2018, Sec. 7.2).
BETA: Final = 0.975

Kind = Literal["kinked", "smooth"]

#: Alternating projections onto two cones; a right angle between them takes two.
_MAX_SWEEPS = 2000


class ConeResidual:
    """G_K of one piece as a function of forces (n,3) [N], and of the natural shape.

    kind  which h: "kinked", the paper's default, or "smooth"
    beta  share of every friction coefficient that is used
    """

    def __init__(self, piece: Piece, kind: Kind = "kinked", beta: float = BETA) -> None:
        if kind not in get_args(Kind):
            raise ValueError(f"kind must be one of {', '.join(get_args(Kind))}; got '{kind}'")
        if not 0.0 < beta <= 1.0:
            raise ValueError(f"beta must be above 0 and at most 1, got {beta}")
        self.piece, self.kind = piece, kind
        contacts = piece.contacts
        self.friction: FloatArray = beta * contacts.friction
        count = len(piece.target)
        touches = np.bincount(contacts.vertices, minlength=count)
        self._single: IntArray = np.flatnonzero(touches[contacts.vertices] == 1)
        self._several: IntArray = np.flatnonzero(touches[contacts.vertices] > 1)
        self._corners: IntArray = np.flatnonzero(touches > 1)
        free = touches == 0
        free[piece.pinned] = False
        self._free: BoolArray = free

    def components(self, forces: FloatArray) -> FloatArray:
        """G_K at forces (n,3) [N]: 3 numbers a free vertex, 1 a contact, 3 a vertex with several."""
        u = forces / self.piece.f0
        at = self.piece.contacts.vertices[self._single]
        h, _ = self._h(u[at])
        return np.concatenate([u[self._free].ravel(), h, self._misses(u)[0].ravel()])

    def value(self, forces: FloatArray) -> tuple[float, FloatArray]:
        """G = |G_K|^2 / 2 and its slope by the forces (n,3) [1/N]; a subgradient at kinks."""
        f0 = self.piece.f0
        u = forces / f0
        slope = np.where(self._free[:, None], u, 0.0)
        at = self.piece.contacts.vertices[self._single]
        h, by_force = self._h(u[at])
        slope[at] = h[:, None] * by_force
        slope[self._corners] = self._misses(u)[0]
        total = 0.5 * float((u[self._free] ** 2).sum() + (h**2).sum())
        return total + 0.5 * float((slope[self._corners] ** 2).sum()), slope / f0

    def at(self, energy: Pulled, x: FloatArray, r: FloatArray) -> tuple[float, FloatArray]:
        """G at pose x and natural shape r, and its slope by r (n,3) [1/m], zero at pins."""
        forces, entries = energy.mixed(x, r)
        total, slope = self.value(forces)
        by_rest = self.piece.assembly.pattern.matrix(entries).T @ slope.ravel()
        by_rest = by_rest.reshape(-1, 3)
        by_rest[self.piece.pinned] = 0.0
        return total, by_rest

    def contact_forces(self, forces: FloatArray) -> FloatArray:
        """Force of every contact (C,3) [N]; a vertex with several gets its nearest admissible sum."""
        found = forces[self.piece.contacts.vertices].copy()
        found[self._several] = self._misses(forces / self.piece.f0)[1] * self.piece.f0
        return found

    def _h(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """h (S,) and dh/du (S,3) of the vertices with one contact."""
        n, mu = self.piece.contacts.normals[self._single], self.friction[self._single]
        normal, tangent = split(u, n)
        slip = np.linalg.norm(tangent, axis=1)
        pulls = np.minimum(normal, 0.0)
        if self.kind == "kinked":
            outside = np.minimum(mu * normal - slip, 0.0)
            along = tangent / np.where(slip > 0.0, slip, 1.0)[:, None]
            by_force = np.where((pulls < 0.0)[:, None], -n, 0.0)
            by_force -= (outside < 0.0)[:, None] * (mu[:, None] * n - along)
            return -pulls - outside, by_force
        outside = np.minimum((mu * normal) ** 2 - slip**2, 0.0)
        by_force = 2.0 * pulls[:, None] * n
        by_force += 4.0 * outside[:, None] * ((mu**2 * normal)[:, None] * n - tangent)
        return pulls**2 + outside**2, by_force

    def _misses(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """For vertices with several contacts: vector from the sum of cones, and the part of each.

        The nearest sum by turns: each contact takes the best force given those of the others.
        """
        contacts, chosen = self.piece.contacts, self._several
        if not len(chosen):
            return np.zeros((0, 3)), np.zeros((0, 3))
        corner = np.searchsorted(self._corners, contacts.vertices[chosen])
        order = np.argsort(corner, kind="stable")
        turn = np.empty(len(chosen), dtype=np.int64)
        first = np.searchsorted(corner[order], corner[order])
        turn[order] = np.arange(len(chosen)) - first
        parts = np.zeros((len(chosen), 3))
        left = u[self._corners].copy()
        for _ in range(_MAX_SWEEPS):
            moved = 0.0
            for k in range(int(turn.max()) + 1):
                mine = np.flatnonzero(turn == k)
                c = chosen[mine]
                wanted = left[corner[mine]] + parts[mine]
                new = project(wanted, contacts.normals[c], self.friction[c])
                moved = max(moved, float(np.abs(new - parts[mine]).max()))
                left[corner[mine]] = wanted - new
                parts[mine] = new
            if moved <= 1e-15 * (1.0 + float(np.abs(u[self._corners]).max())):
                break
        return left, parts
