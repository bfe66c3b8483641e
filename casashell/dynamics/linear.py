"""The linear system of a Newton iteration, with contact forces eliminated vertex by vertex.

The force on a vertex that touches is f_i = g_i (balance), so the linearised law P df + Q dd = -Phi
turns the rows i of A into P_i (rows i of A) + Q_i on the diagonal block: the pattern of A stays.  When
nothing slides P_i is a projector S_i and the matrix is S A S + Q, symmetric.  A vertex that touches
a second obstacle keeps that force as an unknown, eliminated on the spot with P + eps I: a proximal
step, as two obstacles that hold one vertex leave the split of the force open.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from casashell.dynamics.patch import Patch
from casashell.dynamics.system import System
from casashell.dynamics.touch import SLIDE, STICK, NaturalMap, Touches
from casashell.engine.sparse_solver import SingularMatrix, SparseSolver, Symmetry, make_solver
from casashell.typing import FloatArray, IntArray

#: Weight of the proximal term on the force of a second touch.
_PROXIMAL = 1e-6
#: Matrices of every run.
_USUAL: tuple[Symmetry, ...] = ("symmetric", "unpivoted")
#: Vertices whose rows may differ from what was factored, and of which at a time they may be new.
_CHANGED, _NEW = 60, 40
#: Residual of a solution without pivoting, in parts of the right side, that calls for pivoting.
_POOR = 1e-6


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
        self._solvers: dict[Symmetry, SparseSolver] = {}
        self._factored: _Factored | None = None
        self._base: _Factored | None = None  # whose factor the solver has
        self._patch: Patch | None = None  # of that factor
        self._recent: tuple[Balance, _Factored, FloatArray] | None = None

    def prepare(self, entries: FloatArray) -> None:
        """Analyse with the entries of A at the start of the run, as every run of it does.

        What an analysis makes of the values decides rounding later: a run that is taken up again
        must begin as the first one did.
        """
        for kind in _USUAL:
            with suppress(SingularMatrix):  # the steps will say so
                self._solver(kind).factor(self._pinned(entries.copy(), entries))

    def _solver(self, kind: Symmetry) -> SparseSolver:
        if kind not in self._solvers:
            pattern = self.system.pattern
            self._solvers[kind] = make_solver(pattern.indptr, pattern.indices, kind)
        return self._solvers[kind]

    def forget(self) -> None:
        """The factor kept is of no use any more."""
        self._factored = self._base = self._patch = self._recent = None

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
        self.forget()
        rubs = bool((touches.friction > 0.0).any()) or not touches.first.all()
        kind: Symmetry = "unpivoted" if rubs else "symmetric"
        made = _Factored(self.system, entries, touches, law, h, kind)
        made.data = self._pinned(made.matrix(), entries)
        self._factor(made)

    def adapt(self, touches: Touches, law: NaturalMap, h: float) -> bool:
        """Take other branches of the law with the A that was factored; False when there is none."""
        base = self._base
        if base is None or base.kind == "symmetric" or base.h != h:
            return False
        made = _Factored(self.system, base.entries, touches, law, h, "unpivoted")
        force, motion = made.by_force - base.by_force, made.by_motion - base.by_motion
        changed = np.flatnonzero((force != 0.0).any(axis=(1, 2)) | (motion != 0.0).any(axis=(1, 2)))
        if self._patch is None:
            matrix = self.system.pattern.matrix(base.entries)
            self._patch = Patch(matrix, self._solver(base.kind).solve)
        if len(changed) > _CHANGED or len(self._patch.missing(changed)) > _NEW:
            self.factor(base.entries, touches, law, h)
            return True
        made.kind = base.kind
        try:
            self._patch.change(changed, force[changed], motion[changed])
        except np.linalg.LinAlgError:
            return False
        self._factored = made
        return True

    def _factor(self, made: _Factored) -> None:
        try:
            self._solver(made.kind).factor(made.data)
        except SingularMatrix:
            if made.kind != "unpivoted":
                raise
            self._pivot(made)
        self.factorizations += 1
        self._factored = self._base = made

    def _pivot(self, made: _Factored) -> None:
        """Factor once more, now with pivots from anywhere; analysed anew, see `prepare`."""
        self._solvers.pop("general", None)
        self._solver("general").factor(made.data)
        self.factorizations += 1
        made.kind = "general"

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
        self.forget()
        self._solver("symmetric").factor(self._pinned(entries.copy(), entries))
        self.factorizations += 1
        return self._solver("symmetric").negative_eigenvalues

    def push_shell(self, loads: FloatArray) -> FloatArray:
        """Displacements (3V,m) of the shell of `factor_shell` under ``loads`` (3V,m)."""
        loads = loads.copy()
        loads[np.repeat(~self.system.free, 3)] = 0.0
        return self._solver("symmetric").solve(loads)

    def solve(self, at: Balance) -> Move:
        """Newton's correction at these residuals, by the factor kept."""
        d = self.solve_motion(at)
        return Move(d, self._kept().forces(at, d))

    def solve_motion(self, at: Balance) -> FloatArray:
        """The displacements (V,3) [m] of Newton's correction alone."""
        made = self._kept()
        if self._recent is not None and self._recent[0] is at and self._recent[1] is made:
            return self._recent[2]  # a move that was tried is often the next one made
        rhs, known = made.right_side(at)
        flat = rhs.ravel()
        if made is not self._base and self._patch is not None:
            d = self._patch.solve(flat)
        else:
            d = self._solve_exactly(made, flat)
        moved = np.asarray(d.reshape(-1, 3) if known is None else d.reshape(-1, 3) + known)
        self._recent = at, made, moved
        return moved

    def _solve_exactly(self, made: _Factored, flat: FloatArray) -> FloatArray:
        d = self._solver(made.kind).solve(flat)
        if made.kind == "unpivoted":
            off = np.abs(self.system.pattern.matrix(made.data) @ d - flat).max()
            if not off <= _POOR * np.abs(flat).max():
                self._pivot(made)
                d = self._solver(made.kind).solve(flat)
        return d

    def _kept(self) -> _Factored:
        if self._factored is None:
            raise RuntimeError("LinearStep.factor comes before solve")
        return self._factored


class _Factored:
    """What a factor was made of.

    kind  how it was factored;  data: the entries that were
    """

    data: FloatArray

    def __init__(
        self,
        system: System,
        entries: FloatArray,
        touches: Touches,
        law: NaturalMap,
        h: float,
        kind: Symmetry,
    ) -> None:
        self.system, self.entries, self.touches = system, entries, touches
        self.law, self.h, self.kind = law, h, kind
        self.first: IntArray = np.flatnonzero(touches.first)
        self.other: IntArray = np.flatnonzero(~touches.first)
        loose = law.by_force[self.other] + _PROXIMAL * np.eye(3)
        self.inverse: FloatArray = np.asarray(np.linalg.inv(loose), dtype=np.float64)
        count = len(system.rest)
        self.by_force = np.tile(np.eye(3), (count, 1, 1))
        self.by_force[touches.vertex[self.first]] = law.by_force[self.first]
        self.by_motion = np.zeros((count, 3, 3))
        self.by_motion[touches.vertex[self.first]] = law.by_motion[self.first]
        state = np.zeros(count, dtype=np.int64)
        state[touches.vertex[self.first]] = law.state[self.first]
        self.stuck, self.slides = state == STICK, state == SLIDE
        if len(self.other):
            vertex = touches.vertex[self.other]
            soft = self.by_force[vertex] @ self.inverse @ law.by_motion[self.other]
            np.add.at(self.by_motion, vertex, soft)

    def matrix(self) -> FloatArray:
        """Entries of the eliminated matrix."""
        data = self.entries.copy()
        blocks = self.system.blocks
        gone, turned = self.stuck[blocks.row], self.slides[blocks.row]
        if self.kind == "symmetric":
            gone = gone | self.stuck[blocks.column]
            turned = (turned | self.slides[blocks.column]) & ~gone
        if gone.any():
            data[blocks.place[gone]] = 0.0
        if turned.any():
            chosen = np.flatnonzero(turned)
            place = blocks.place[chosen]
            made = self.by_force[blocks.row[chosen]] @ data[place]
            if self.kind == "symmetric":
                made = made @ self.by_force[blocks.column[chosen]]
            data[place] = made
        data[blocks.place[blocks.diagonal]] += self.by_motion
        return data

    def right_side(self, at: Balance) -> tuple[FloatArray, FloatArray | None]:
        """Right side (V,3) [N] of the eliminated system, and what contact prescribes of d, if any.

        In the symmetric case d = y + known with y = S y the solution of the system.
        """
        law, vertex = at.law, self.touches.vertex[self.first]
        rhs = -at.force
        if len(self.other):
            extra = np.einsum("cij,cj->ci", self.inverse, law.value[self.other])
            np.subtract.at(rhs, self.touches.vertex[self.other], extra)
        rhs[vertex] = np.einsum("cij,cj->ci", self.by_force[vertex], rhs[vertex])
        known = None
        if self.kind == "symmetric":
            known = self._prescribed(rhs, vertex, law.value[self.first])
        else:
            rhs[vertex] -= law.value[self.first]
        rhs[~self.system.free] = 0.0
        return rhs, known

    def _prescribed(self, rhs: FloatArray, vertex: IntArray, phi: FloatArray) -> FloatArray | None:
        """The displacements that contact prescribes (V,3) [m], if any; takes them from ``rhs``."""
        held, loose = self.law.by_motion[self.first], self.law.by_force[self.first]
        known = np.zeros_like(rhs)
        # Q + S is regular, and S leaves the prescribed part alone.
        known[vertex] = -np.linalg.solve(held + loose, phi[:, :, None])[:, :, 0]
        known[vertex] -= np.einsum("cij,cj->ci", loose, known[vertex])
        rhs[vertex] -= np.einsum("cij,cj->ci", loose, phi)
        if not known.any():
            return None
        push = (self.system.pattern.matrix(self.entries) @ known.ravel()).reshape(-1, 3)
        push[vertex] = np.einsum("cij,cj->ci", self.by_force[vertex], push[vertex])
        rhs -= push
        return known

    def forces(self, at: Balance, d: FloatArray) -> FloatArray:
        """Change of the forces (C,3) [N] that goes with the correction d (V,3) [m]."""
        touches, vertex = self.touches, self.touches.vertex[self.first]
        f = np.zeros((len(touches), 3))
        pulled = (self.system.pattern.matrix(self.entries) @ d.ravel()).reshape(-1, 3)
        f[self.first] = pulled[vertex] + at.force[vertex]
        if len(self.other):
            ids = touches.vertex[self.other]
            moved = np.einsum("cij,cj->ci", self.law.by_motion[self.other], d[ids])
            step = -np.einsum("cij,cj->ci", self.inverse, at.law.value[self.other] + moved)
            f[self.other] = step
            total = np.zeros_like(d)
            np.add.at(total, ids, step)
            f[self.first] -= total[vertex]
        return f
