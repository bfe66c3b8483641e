"""The linear system of a Newton iteration, with contact forces eliminated vertex by vertex.

The force on a vertex that touches is f_i = g_i (balance), so the linearised law P df + Q dd = -Phi
turns the rows i of A into P_i (rows i of A) + Q_i on the diagonal block: the pattern of A stays.  When
nothing slides P_i is a projector S_i and the matrix is S A S + Q, symmetric.  A vertex that touches
a second obstacle keeps that force as an unknown, eliminated on the spot with P + eps I: a proximal
step, as two obstacles that hold one vertex leave the split of the force open.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casashell.dynamics.system import System
from casashell.dynamics.touch import NaturalMap, Touches
from casashell.engine.sparse_solver import SparseSolver, Symmetry, make_solver
from casashell.typing import BoolArray, FloatArray, IntArray

#: Weight of the proximal term on the force of a second touch.
_PROXIMAL = 1e-6
_KINDS: dict[bool, Symmetry] = {True: "symmetric", False: "general"}


@dataclass(frozen=True, eq=False)
class Balance:
    """Residuals at (d, f): forces that are not balanced (V,3) and the natural map, both in N."""

    force: FloatArray
    law: NaturalMap

    @property
    def size(self) -> float:
        """Largest component [N]."""
        law = float(np.abs(self.law.value).max(initial=0.0))
        return max(self.force_size, law)

    @property
    def force_size(self) -> float:
        """Largest component of the forces that are not balanced [N]."""
        return float(np.abs(self.force).max(initial=0.0))


@dataclass(frozen=True, eq=False)
class Move:
    """Change of the displacements (V,3) [m] and of the forces (C,3) [N]."""

    d: FloatArray
    f: FloatArray


class LinearStep:
    """Factorised Newton matrices of a run: one symbolic analysis for each symmetry."""

    def __init__(self, system: System) -> None:
        self.system = system
        self.factorizations = 0
        self._solvers: dict[bool, SparseSolver] = {}
        self._factored: _Factored | None = None

    def prepare(self, entries: FloatArray) -> None:
        """Analyse with the entries of A at the start of the run, as every run of it does.

        What an analysis makes of the values decides rounding later: a run that is taken up again
        must begin as the first one did.
        """
        for symmetric in (True, False):
            self._solver(symmetric).factor(self._pinned(entries.copy(), entries))

    def _solver(self, symmetric: bool) -> SparseSolver:
        if symmetric not in self._solvers:
            pattern, kind = self.system.pattern, _KINDS[symmetric]
            self._solvers[symmetric] = make_solver(pattern.indptr, pattern.indices, kind)
        return self._solvers[symmetric]

    def forget(self) -> None:
        """The factor kept is of no use any more."""
        self._factored = None

    def fits(self, touches: Touches, law: NaturalMap, h: float) -> bool:
        """Whether the factor kept belongs to the same touches in the same states, and step."""
        kept = self._factored
        if kept is None or kept.h != h or len(kept.touches) != len(touches):
            return False
        same = np.array_equal(kept.touches.vertex, touches.vertex)
        same = same and np.array_equal(kept.touches.body, touches.body)
        return bool(same and np.array_equal(kept.law.state, law.state))

    def factor(self, entries: FloatArray, touches: Touches, law: NaturalMap, h: float) -> None:
        """Factor the matrix of A's ``entries`` under these touches; raises SingularMatrix."""
        self._factored = None
        symmetric = law.symmetric and bool(touches.first.all())
        made = _Factored(self.system, entries, touches, law, h, symmetric)
        data = self._pinned(made.matrix(), entries)
        self._solver(symmetric).factor(data)
        self.factorizations += 1
        self._factored = made

    def _pinned(self, data: FloatArray, entries: FloatArray) -> FloatArray:
        """``data`` with rows and columns of pinned vertices those of the identity."""
        system = self.system
        held = ~system.free
        if held.any():
            blocks = system.blocks
            data[blocks.place[held[blocks.row] | held[blocks.column]].ravel()] = 0.0
            scale = float(np.abs(entries[system.diagonal]).mean())
            data[system.diagonal[np.repeat(held, 3)]] = scale
        return data

    def factor_shell(self, entries: FloatArray) -> int | None:
        """Factor A alone, without contact; its negative eigenvalues where the solver counts them."""
        self._factored = None
        self._solver(True).factor(self._pinned(entries.copy(), entries))
        self.factorizations += 1
        return self._solver(True).negative_eigenvalues

    def push_shell(self, loads: FloatArray) -> FloatArray:
        """Displacements (3V,m) of the shell of `factor_shell` under ``loads`` (3V,m)."""
        loads = loads.copy()
        loads[np.repeat(~self.system.free, 3)] = 0.0
        return self._solver(True).solve(loads)

    @property
    def negative_eigenvalues(self) -> int | None:
        """Of the last symmetric factor; None for the others."""
        if self._factored is None or not self._factored.symmetric:
            return None
        return self._solver(True).negative_eigenvalues

    def solve(self, at: Balance) -> Move:
        """Newton's correction at these residuals, by the factor kept."""
        made = self._factored
        if made is None:
            raise RuntimeError("LinearStep.factor comes before solve")
        return made.back(at, self._solver(made.symmetric))


class _Factored:
    """What a factor was made of."""

    def __init__(
        self,
        system: System,
        entries: FloatArray,
        touches: Touches,
        law: NaturalMap,
        h: float,
        symmetric: bool,
    ) -> None:
        self.system, self.entries, self.touches = system, entries, touches
        self.law, self.h, self.symmetric = law, h, symmetric
        self.first: IntArray = np.flatnonzero(touches.first)
        self.other: IntArray = np.flatnonzero(~touches.first)
        loose = law.by_force[self.other] + _PROXIMAL * np.eye(3)
        self.inverse: FloatArray = np.asarray(np.linalg.inv(loose), dtype=np.float64)
        count = len(system.rest)
        self.held: BoolArray = np.zeros(count, dtype=bool)
        self.held[touches.vertex] = True
        self.by_force = np.tile(np.eye(3), (count, 1, 1))
        self.by_force[touches.vertex[self.first]] = law.by_force[self.first]
        self.by_motion = np.zeros((count, 3, 3))
        self.by_motion[touches.vertex[self.first]] = law.by_motion[self.first]
        if len(self.other):
            vertex = touches.vertex[self.other]
            soft = self.by_force[vertex] @ self.inverse @ law.by_motion[self.other]
            np.add.at(self.by_motion, vertex, soft)

    def matrix(self) -> FloatArray:
        """Entries of the eliminated matrix."""
        data = self.entries.copy()
        if not self.held.any():
            return data
        blocks = self.system.blocks
        rows = self.held[blocks.row]
        if self.symmetric:
            rows = rows | self.held[blocks.column]
        chosen = np.flatnonzero(rows)
        place = blocks.place[chosen]
        made = self.by_force[blocks.row[chosen]] @ data[place]
        if self.symmetric:
            made = made @ self.by_force[blocks.column[chosen]]
        data[place] = made
        data[blocks.place[blocks.diagonal]] += self.by_motion
        return data

    def back(self, at: Balance, solver: SparseSolver) -> Move:
        """Correction at the residuals ``at``."""
        touches, law = self.touches, at.law
        free = self.system.free
        rhs = -at.force
        vertex = touches.vertex[self.first]
        if len(self.other):
            extra = np.einsum("cij,cj->ci", self.inverse, law.value[self.other])
            np.subtract.at(rhs, touches.vertex[self.other], extra)
        rhs[vertex] = np.einsum("cij,cj->ci", self.by_force[vertex], rhs[vertex])
        if self.symmetric:
            d = self._symmetric(rhs, vertex, law.value[self.first], solver)
        else:
            rhs[vertex] -= law.value[self.first]
            rhs[~free] = 0.0
            d = solver.solve(rhs.ravel()).reshape(-1, 3)
        f = np.zeros((len(touches), 3))
        pulled = (self.system.pattern.matrix(self.entries) @ d.ravel()).reshape(-1, 3)
        f[self.first] = pulled[vertex] + at.force[vertex]
        if len(self.other):
            ids = touches.vertex[self.other]
            moved = np.einsum("cij,cj->ci", self.law.by_motion[self.other], d[ids])
            step = -np.einsum("cij,cj->ci", self.inverse, law.value[self.other] + moved)
            f[self.other] = step
            total = np.zeros_like(d)
            np.add.at(total, ids, step)
            f[self.first] -= total[vertex]
        return Move(d, f)

    def _symmetric(
        self, rhs: FloatArray, vertex: IntArray, phi: FloatArray, solver: SparseSolver
    ) -> FloatArray:
        """d = y + b with b the part that contact prescribes and y = S y the rest."""
        held, loose = self.law.by_motion[self.first], self.law.by_force[self.first]
        known = np.zeros_like(rhs)
        # Q + S is regular, and S leaves the prescribed part alone.
        known[vertex] = -np.linalg.solve(held + loose, phi[:, :, None])[:, :, 0]
        known[vertex] -= np.einsum("cij,cj->ci", loose, known[vertex])
        rhs[vertex] -= np.einsum("cij,cj->ci", loose, phi)
        if known.any():
            push = (self.system.pattern.matrix(self.entries) @ known.ravel()).reshape(-1, 3)
            push[vertex] = np.einsum("cij,cj->ci", self.by_force[vertex], push[vertex])
            rhs -= push
        rhs[~self.system.free] = 0.0
        return np.asarray(solver.solve(rhs.ravel()).reshape(-1, 3) + known)
