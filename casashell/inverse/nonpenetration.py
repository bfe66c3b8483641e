"""Static equilibrium of a shell of given natural shape that may touch, but not enter, an obstacle.

    min E(x, r)   subject to   d(x_v) >= 0 for every vertex v,

d being the signed distance to a frictionless obstacle.  In the coordinates (d, u) of a vertex, u along
the obstacle, this is a problem with bounds, solved by the projected Newton method of Bertsekas (1982,
SIAM J. Control Optim. 20, 221): vertices on the obstacle that the shell presses against it keep d = 0,
the others take a Newton step, and where the step would enter the obstacle it ends on the surface.
The surface bends the coordinates, which adds -f_N d2d/dx2 to the Hessian of a vertex pressed with f_N.
The Hessian is shifted until its factors show no negative eigenvalue, so that steps go downhill; an
equilibrium with negative curvature is left along it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from casashell.contact.cone import tangents
from casashell.contact.obstacles import Obstacle
from casashell.engine.assembly import Assembly
from casashell.engine.sparse_solver import SingularMatrix, make_solver
from casashell.inverse.stability import lowest_eigenpairs
from casashell.typing import ArrayLike, BoolArray, FloatArray, IntArray

#: Gap / mean edge length below which a vertex lies on the obstacle.
TOUCHING = 1e-12
#: Shift / mean diagonal of the Hessian that is always there: what contact without friction leaves
#: neutral, such as turning a skirt about its cone, has no stiffness of its own.
LEAST_SHIFT = 1e-10
#: Share of the predicted decrease of energy that a step has to bring about.
SUFFICIENT = 1e-4
MAX_HALVINGS = 30


@dataclass(frozen=True)
class Resting:
    """A shell at rest on a frictionless obstacle.

    pose           (n,3) m
    gaps           (n,) m, signed distance to the obstacle
    normal_forces  (n,) N, of the obstacle on each vertex, along its normal
    residual       largest force that nothing balances, / mean nodal weight
    stable         no direction of negative curvature; None when the solver does not tell
    """

    pose: FloatArray
    gaps: FloatArray
    normal_forces: FloatArray
    energy: float
    residual: float
    iterations: int
    converged: bool
    stable: bool | None


@dataclass(frozen=True)
class _State:
    """Pose with what the obstacle and the energy say there."""

    pose: FloatArray
    gaps: FloatArray
    normals: FloatArray
    energy: float


@dataclass(frozen=True)
class _System:
    """Newton's matrix and gradient in the m free coordinates, and the way back to positions."""

    matrix: sp.csr_array
    slope: FloatArray
    basis: sp.csr_array  # (3n, m)

    def spread(self, free: FloatArray) -> FloatArray:
        """Motion of the vertices (n,3) of free coordinates (m,)."""
        return np.asarray((self.basis @ free).reshape(-1, 3))


class _Settling:
    """Constants of one problem, and the parts of a Newton step."""

    def __init__(
        self, assembly: Assembly, rest: FloatArray, obstacle: Obstacle, pinned: IntArray
    ) -> None:
        self.assembly, self.rest, self.obstacle = assembly, rest, obstacle
        self.loose = np.ones(assembly.count, dtype=bool)
        self.loose[pinned] = False
        weight = float(np.linalg.norm(assembly.nodal_loads(rest), axis=1).mean())
        self.f0 = weight if weight > 0.0 else 1.0
        pairs = np.concatenate([t.stencils[:, :2] for t in assembly.energies if t.size >= 2])
        self.h = float(np.linalg.norm(rest[pairs[:, 0]] - rest[pairs[:, 1]], axis=1).mean())
        self.shift = LEAST_SHIFT

    def state(self, pose: FloatArray, onto: BoolArray) -> _State:
        """``pose`` with the vertices ``onto`` and those inside the obstacle put on its surface."""
        gaps, normals = self.obstacle.signed_distance(pose)
        moved = self.loose & (onto | (gaps < 0.0))
        if moved.any():
            pose = np.where(moved[:, None], pose - gaps[:, None] * normals, pose)
            gaps, normals = self.obstacle.signed_distance(pose)
        return _State(pose, gaps, normals, self.assembly.energy(pose, self.rest))

    def pressed(self, state: _State, gradient: FloatArray) -> tuple[BoolArray, FloatArray]:
        """Vertices held by the obstacle (n,), and the forces f_N (n,) [N] it holds them with."""
        force = (gradient * state.normals).sum(axis=1)
        rounding = 8.0 * np.finfo(np.float64).eps * np.abs(state.pose).max(axis=1)
        held = self.loose & (state.gaps <= TOUCHING * self.h + rounding) & (force > 0.0)
        return held, np.where(held, force, 0.0)

    def curvature(self, state: _State, force: FloatArray) -> sp.csr_array:
        """-f_N d2d/dx2 (3n,3n) [N/m], from differences of the normals."""
        at = np.flatnonzero(force)
        step = 1e-5 * self.h
        blocks = np.zeros((self.assembly.count, 3, 3))
        for axis in range(3):
            ahead = step * np.eye(3)[axis]
            fore, back = (
                self.obstacle.signed_distance(state.pose[at] + move)[1] for move in (ahead, -ahead)
            )
            blocks[at, :, axis] = -force[at, None] * (fore - back) / (2.0 * step)
        return _block_diagonal(0.5 * (blocks + blocks.transpose(0, 2, 1)))

    def system(self, state: _State, held: BoolArray, force: FloatArray) -> _System:
        """Gradient and Hessian in the coordinates that ``held`` on the surface leave free."""
        gradient, entries = self.assembly.hessian(state.pose, self.rest)
        frames = np.stack([state.normals, *tangents(state.normals)], axis=2)
        turn = sp.csc_array(_block_diagonal(frames))
        free = np.repeat(self.loose[:, None], 3, axis=1)
        free[held, 0] = False
        dofs = np.flatnonzero(free.ravel())
        whole = self.assembly.pattern.matrix(entries) + self.curvature(state, force)
        matrix = sp.csr_array(sp.csr_array(turn.T @ whole @ turn)[dofs][:, dofs])
        matrix = sp.csr_array(matrix + sp.diags_array(np.zeros(len(dofs))))
        matrix.sort_indices()
        return _System(matrix, (turn.T @ gradient.ravel())[dofs], turn[:, dofs])

    def newton(self, system: _System) -> tuple[FloatArray, bool | None]:
        """-(H + shift)^-1 gradient (n,3) [m] with the least convex shift tried; whether H is convex."""
        matrix, slope = system.matrix, system.slope
        solver = make_solver(matrix.indptr, matrix.indices, "symmetric")
        rows = np.repeat(np.arange(len(slope)), np.diff(matrix.indptr))
        diagonal = np.flatnonzero(rows == matrix.indices)
        scale = float(np.abs(matrix.data[diagonal]).mean())
        first: bool | None = None
        shift = LEAST_SHIFT
        while shift < 1e6:
            data = matrix.data.copy()
            data[diagonal] += shift * scale
            try:
                solver.factor(data)
                negative = solver.negative_eigenvalues
                step = -solver.solve(slope)
            except SingularMatrix:
                negative, step = 1, slope
            known = negative is not None
            if shift == LEAST_SHIFT and known:
                first = negative == 0
            if not negative and (known or float(step @ slope) <= 0.0):
                break
            # Shifts drop slowly from one step to the next: most are needed again.
            shift = max(0.25 * self.shift, 1e-6) if shift == LEAST_SHIFT else 4.0 * shift
        self.shift = shift
        return system.spread(step), first

    def escape(self, state: _State, system: _System, held: BoolArray) -> _State | None:
        """A point of lower energy along the softest direction of a saddle; None if there is none."""
        values, modes = lowest_eigenpairs(system.matrix, 1)
        if values[0] >= 0.0:
            return None
        mode = system.spread(modes[:, 0])
        mode *= 0.1 * self.h / float(np.linalg.norm(mode, axis=1).max())
        for length in 2.0 ** -np.arange(8):
            found = [self.state(state.pose + sign * length * mode, held) for sign in (1.0, -1.0)]
            lower = min(found, key=lambda one: one.energy)
            if lower.energy < state.energy:
                return lower
        return None

    def search(
        self, state: _State, held: BoolArray, step: FloatArray, slope: FloatArray
    ) -> _State | None:
        """First point of the halved steps that lowers the energy enough; None when none does."""
        longest = float(np.linalg.norm(step, axis=1).max(initial=0.0))
        length = min(1.0, self.h / longest) if longest > 0.0 else 1.0
        noise = 1e-13 * (abs(state.energy) + self.f0 * self.h * self.assembly.count)
        for _ in range(MAX_HALVINGS):
            tried = self.state(state.pose + length * step, held)
            # against the distance moved, since steps into the obstacle were cut short
            gain = float((slope * (state.pose - tried.pose)).sum())
            if tried.energy <= state.energy - SUFFICIENT * max(gain, 0.0) + noise:
                return tried
            length *= 0.5
        return None


def settle(
    assembly: Assembly,
    rest: FloatArray,
    obstacle: Obstacle,
    *,
    start: FloatArray | None = None,
    pinned: Sequence[int] | ArrayLike = (),
    tolerance: float = 1e-9,
    max_iterations: int = 400,
) -> Resting:
    """Let the shell of natural shape ``rest`` (n,3) [m] settle on ``obstacle`` without friction.

    start      (n,3) m, by default ``rest``; vertices inside the obstacle are first put on its surface
    pinned     vertices that stay where they start, wherever that is
    tolerance  residual, as a multiple of the mean nodal weight, that ends the search

    Deterministic.  Ends early, with ``converged`` False, when no step lowers the energy any more.
    Raises ValueError for positions of the wrong shape or not finite, and for a pin that is no vertex.
    """
    pins = np.unique(np.asarray(pinned, dtype=np.int64))
    wrong = pins[(pins < 0) | (pins >= assembly.count)]
    if wrong.size:
        raise ValueError(
            f"pinned vertex {int(wrong[0])} does not exist: there are {assembly.count}"
        )
    begin = rest if start is None else start
    for name, points in (("rest", rest), ("start", begin)):
        if np.shape(points) != (assembly.count, 3) or not np.all(np.isfinite(points)):
            raise ValueError(f"{name} must be finite positions of shape ({assembly.count}, 3)")
    problem = _Settling(assembly, np.asarray(rest), obstacle, pins)
    state = problem.state(np.asarray(begin, dtype=np.float64), np.zeros(assembly.count, dtype=bool))
    for iteration in range(max_iterations + 1):
        gradient = assembly.gradient(state.pose, problem.rest)
        held, force = problem.pressed(state, gradient)
        unbalanced = gradient - force[:, None] * state.normals
        residual = float(np.abs(unbalanced[problem.loose]).max(initial=0.0)) / problem.f0
        system = problem.system(state, held, force)
        step, convex = problem.newton(system)
        done = residual <= tolerance
        if not done:
            following = problem.search(state, held, step, gradient)
        else:
            following = problem.escape(state, system, held) if convex is False else None
        if following is None or iteration == max_iterations:
            break
        state = following
    return Resting(state.pose, state.gaps, force, state.energy, residual, iteration, done, convex)


def _block_diagonal(blocks: FloatArray) -> sp.csr_array:
    """Sparse matrix (3n,3n) of blocks (n,3,3)."""
    count = len(blocks)
    index = np.arange(count)
    return sp.csr_array(sp.bsr_array((blocks, index, np.arange(count + 1)), shape=(3 * count,) * 2))
