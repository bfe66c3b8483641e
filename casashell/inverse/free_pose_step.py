"""One step towards the target among stable poses: a convex program in pose, shape and forces.

    minimise    |w + w_0|^2 / 2 + smooth/2 |u + u_0|^2 + kappa/2 (|w|^2 + |u|^2) + steep t
    subject to  (g + H h w + M h u) / f0 = S f / f0            at every vertex that is not pinned
                f in the cones of mu' with floor, widened by t >= 0
                V^T (H + dH) V h / f0 >= delta I               on the lowest modes V (a matrix inequality)

w, u are changes of pose and natural shape in h; w_0, u_0 their distance from the target and from the
reference.  The equilibrium rows are dE/dx to first order.  dH is first order too: v_i.H v_j changes by
(C(v_i) v_j).dx + (B(v_i) v_j).dr, see `casashell.engine.kernels`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import clarabel
import numpy as np
import scipy.sparse as sp

from casashell.inverse.forces import Block, Shrink, cone_rows, contact_frames
from casashell.inverse.free_system import FreeSystem
from casashell.inverse.piece import Piece
from casashell.inverse.stability import lowest_eigenpairs
from casashell.typing import FloatArray, IntArray

#: Weights of the change of the natural shape and of forces outside their cones (in f0).
SMOOTH: Final = 1e-3
STEEP: Final = 1e4
#: Least eigenvalue h / f0 asked for, and how far inside the cones forces have to stay.
DELTA: Final = 1e-3
INSIDE: Final = Shrink(0.95 * 0.975, 1e-2)


@dataclass(frozen=True)
class PoseStep:
    """Changes of pose and natural shape (n,3) [m], and contact forces (C,3) [N] after them."""

    pose: FloatArray
    rest: FloatArray
    contact_forces: FloatArray
    widened: float


class PoseProgram:
    """The program of one piece; its patterns and maps are made once."""

    def __init__(self, piece: Piece) -> None:
        self.piece = piece
        count, contacts = len(piece.target), piece.contacts
        self.system = FreeSystem(piece.assembly.pattern, piece.held, "symmetric")
        self.free: IntArray = self.system.dofs
        loose = np.setdiff1d(np.arange(count), piece.pinned)
        self.loose: IntArray = np.asarray((3 * loose[:, None] + np.arange(3)).ravel())
        self.frames, self._owner = contact_frames(contacts)
        at = (3 * contacts.vertices[:, None] + np.arange(3)).ravel()
        spread = sp.csr_array(
            (np.ones(len(at)), (at, np.arange(len(at)))), shape=(3 * count, len(at))
        )
        self._spread = sp.csr_array(spread @ self.frames)[self.loose]
        self._ends = np.cumsum([len(self.free), len(self.loose), self._spread.shape[1], 1])

    def step(
        self, pose: FloatArray, rest: FloatArray, kappa: float, modes: int = 0
    ) -> PoseStep | None:
        """The step from an equilibrium (n,3), (n,3); None when the program could not be solved.

        kappa  weight of the step itself;  modes  how many lowest modes are to stay stable
        """
        piece, h, f0 = self.piece, self.piece.h, self.piece.f0
        matrix = piece.assembly.pattern.matrix
        gradient, entries = piece.assembly.hessian(pose, rest)
        stiffness = sp.csr_array(matrix(entries))
        mixed = matrix(piece.assembly.mixed(pose, rest)[1])
        rows = [
            stiffness[self.loose][:, self.free] * (h / f0),
            mixed[self.loose][:, self.loose] * (h / f0),
            -self._spread,
            sp.csr_array((len(self.loose), 1)),
        ]
        balance = sp.csr_array(sp.hstack(rows))
        bound = -gradient.ravel()[self.loose] / f0
        blocks: list[Block] = [(balance, bound, [clarabel.ZeroConeT(len(bound))])]
        blocks.append(self._cones())
        if modes:
            blocks.append(self._stability(pose, rest, stiffness, modes))
        found = self._solve(pose, rest, kappa, blocks)
        if found is None:
            return None
        w, u, forces, _ = np.split(found, self._ends[:-1])
        by_rest = np.zeros(pose.size)
        by_rest[self.loose] = h * u
        return PoseStep(
            self.system.extend(h * w),
            by_rest.reshape(-1, 3),
            np.asarray((self.frames @ forces).reshape(-1, 3) * f0),
            float(found[-1]),
        )

    def _solve(
        self, pose: FloatArray, rest: FloatArray, kappa: float, blocks: list[Block]
    ) -> FloatArray | None:
        target, h = self.piece.target, self.piece.h
        nf, nr, m, _ = np.diff(self._ends, prepend=0)
        weights = [np.full(nf, 1.0 + kappa), np.full(nr, SMOOTH + kappa), np.full(m + 1, 1e-8)]
        w0 = (pose - target).ravel()[self.free] / h
        u0 = (rest - target).ravel()[self.loose] / h
        settings = clarabel.DefaultSettings()
        settings.verbose, settings.max_iter = False, 50
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-6
        settings.direct_solve_method = "qdldl"  # the others take three times as long here
        settings.presolve_enable = settings.chordal_decomposition_enable = False
        solver = clarabel.DefaultSolver(
            sp.diags_array(np.concatenate(weights), format="csc"),
            np.concatenate([w0, SMOOTH * u0, np.zeros(m), [STEEP]]),
            sp.csc_matrix(sp.vstack([b[0] for b in blocks], format="csc")),
            np.concatenate([b[1] for b in blocks]),
            [cone for b in blocks for cone in b[2]],
            settings,
        )
        found = solver.solve()
        return np.array(found.x) if str(found.status) in ("Solved", "AlmostSolved") else None

    def _cones(self) -> Block:
        """Cone rows with the column of t; its own row first."""
        contacts, size = self.piece.contacts, int(self._ends[-1])
        own = np.zeros((1, size))
        own[0, -1] = -1.0
        if len(contacts) == 0:
            return sp.csr_array(own), np.zeros(1), [clarabel.NonnegativeConeT(1)]
        rows, bound, cones = cone_rows(contacts, self._owner, INSIDE, INSIDE.floor)
        wider = np.zeros((rows.shape[0], 1))
        wider[: len(contacts)] = -1.0
        wider[len(contacts) :: 3] = -1.0
        before = sp.csr_array((rows.shape[0], int(self._ends[1])))
        widened = sp.hstack([before, rows, sp.csr_array(wider)])
        return (
            sp.csr_array(sp.vstack([sp.csr_array(own), widened])),
            np.concatenate([[0.0], bound]),
            [clarabel.NonnegativeConeT(1), *cones],
        )

    def _stability(
        self, pose: FloatArray, rest: FloatArray, stiffness: sp.csr_array, count: int
    ) -> Block:
        """Rows of V^T (H + dH) V - delta I as a positive semidefinite triangle."""
        piece, unit = self.piece, self.piece.h / self.piece.f0
        matrix, assembly = piece.assembly.pattern.matrix, piece.assembly
        inner = sp.csr_array(stiffness[self.free][:, self.free]) * unit
        values, vectors = lowest_eigenpairs(inner, count)
        modes = [self.system.extend(v) for v in vectors.T]
        by_rest = [matrix(assembly.lagrangian_mixed(pose, rest, v)) for v in modes]
        by_pose = [matrix(assembly.lagrangian_pose(pose, rest, v)) for v in modes]
        least = min(DELTA, 0.5 * float(values[0]))
        rows, bound = [], []
        rest_of_row = np.zeros(int(self._ends[-1] - self._ends[1]))
        for j, v in enumerate(modes):
            for i in range(j + 1):
                scale = -(1.0 if i == j else np.sqrt(2.0)) * unit * piece.h
                change = (by_pose[i] @ v.ravel())[self.free], (by_rest[i] @ v.ravel())[self.loose]
                rows.append(np.concatenate([scale * change[0], scale * change[1], rest_of_row]))
                bound.append(float(values[i]) - least if i == j else 0.0)
        return (
            sp.csr_array(np.array(rows)),
            np.array(bound),
            [clarabel.PSDTriangleConeT(len(modes))],
        )
