"""Step 2 of Ly 2018: bring the forces of a given pose into their cones by the natural shape alone.

Two ways.  "ipopt" finds the nearest natural shape, in the mean square, whose forces at the pose are
admissible (the program of `casashell.inverse.balance_nlp`).  "bfgs" lowers G = |G_K(F)|^2 / 2 as the
paper does (their Eq. 34), from the natural shape of Step 1, until it vanishes to rounding.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np
import scipy.sparse as sp

from casashell.contact.cone import project, split
from casashell.engine.sparse_solver import make_solver
from casashell.inverse.balance import balance, rounding
from casashell.inverse.balance_nlp import BalanceNlp
from casashell.inverse.cone_residual import BETA, ConeResidual, Kind
from casashell.inverse.forces import SHRINKS, project_reactions
from casashell.inverse.inverse_hessian import DenseBfgs, LimitedBfgs, QuasiNewton
from casashell.inverse.load_path import Report
from casashell.inverse.piece import Piece
from casashell.inverse.pulled import Pulled
from casashell.inverse.quasi_newton import descend
from casashell.result import Step
from casashell.typing import FloatArray

#: G in f0^2 at which the forces are admissible, and where BFGS stops if rounding lets it.
ADMISSIBLE: Final = 1e-16
GOAL: Final = 1e-20
#: Share of the cones that Ipopt uses: the drape that follows moves forces a little.
INSIDE: Final = 0.995
#: Vertices above which BFGS keeps its last steps instead of a matrix (0.5 GB at 2550).
DENSE_LIMIT: Final = 1500
#: Longest move of a natural vertex in one step of BFGS, in edge lengths.
LONGEST: Final = 0.2
IPOPT_ITERATIONS, BFGS_ITERATIONS = 200, 5000

Method = Literal["ipopt", "bfgs"]


@dataclass(frozen=True, eq=False)
class StepTwo:
    """What Step 2 found.

    rest            (n,3) m
    contact_forces  (C,3) N
    residual        G = |G_K(F)|^2 / 2 at the pose, in f0^2
    converged       whether residual is at most `ADMISSIBLE`, or what rounding leaves of it
    slack           largest force that balance lacks when there is no solution ("ipopt"), / f0
    reason          how the method ended, in words
    """

    rest: FloatArray
    contact_forces: FloatArray
    residual: float
    iterations: int
    seconds: float
    converged: bool
    slack: float
    reason: str


def step_two(
    piece: Piece,
    pose: FloatArray,
    rest: FloatArray,
    pull: float = 0.0,
    *,
    method: Method = "ipopt",
    kind: Kind = "kinked",
    beta: float = BETA,
    floor: float = 0.0,
    elastic: bool = True,
    scaled: bool = True,
    max_iterations: int | None = None,
    report: Report | None = None,
) -> StepTwo:
    """Natural shape near ``rest`` (n,3) for which the forces at ``pose`` (n,3) are admissible.

    pull    of the energy towards the target [N/m] (Ly 2018, Eq. 24)
    kind    h of G_K: of "bfgs", and of the residual in the answer
    beta    share of every friction coefficient that is used
    floor   least normal force / f0 of a contact, "ipopt" only
    elastic when there is no solution near by, answer with the one of least slack, "ipopt" only
    scaled  start BFGS from the Gauss-Newton matrix of G rather than from the identity
    Raises ValueError for an unknown method and arrays of the wrong shape.
    """
    if method not in get_args(Method):
        raise ValueError(f"method must be one of {', '.join(get_args(Method))}; got '{method}'")
    energy, cones = Pulled(piece, pull), ConeResidual(piece, kind, beta)
    program = BalanceNlp(energy, pose, rest, floor=floor, beta=INSIDE * beta)
    begin = time.perf_counter()
    left = 0.5 * len(program.dofs) * rounding(program) ** 2
    goal = max(ADMISSIBLE, left)
    felt = energy.gradient(pose, rest)
    found = _Found(program.reference, cones.contact_forces(felt), 0, "admissible from the start")
    if len(program.dofs) and (
        cones.value(felt)[0] > goal or not _pushing(cones, found.forces, floor)
    ):
        if method == "ipopt":
            limit = max_iterations or IPOPT_ITERATIONS
            found = _ipopt(program, cones, felt, elastic, limit, report)
        else:
            limit = max_iterations or BFGS_ITERATIONS
            found = _bfgs(program, cones, scaled, max(GOAL, left), limit, report)
    residual = cones.value(energy.gradient(pose, found.rest))[0]
    return StepTwo(
        rest=found.rest,
        contact_forces=found.forces,
        residual=residual,
        iterations=found.iterations,
        seconds=time.perf_counter() - begin,
        converged=residual <= goal,
        slack=found.slack,
        reason=found.reason,
    )


@dataclass(frozen=True, eq=False)
class _Found:
    rest: FloatArray
    forces: FloatArray
    iterations: int
    reason: str
    slack: float = 0.0


def _ipopt(
    program: BalanceNlp,
    cones: ConeResidual,
    felt: FloatArray,
    elastic: bool,
    max_iterations: int,
    report: Report | None,
) -> _Found:
    forces = first_forces(program, cones, felt)
    found = balance(
        program,
        program.reference,
        forces,
        elastic=elastic,
        max_iterations=max_iterations,
        report=report,
    )
    return _Found(
        found.rest, found.contact_forces, found.iterations, str(found.status), found.slack
    )


def _pushing(cones: ConeResidual, forces: FloatArray, floor: float) -> bool:
    """Whether every contact pushes with the least normal force asked for."""
    normal, _ = split(forces, cones.piece.contacts.normals)
    return floor == 0.0 or bool((normal >= floor * cones.piece.f0).all())


def first_forces(program: BalanceNlp, cones: ConeResidual, felt: FloatArray) -> FloatArray:
    """Admissible forces per contact (C,3) [N]: nearest to those at hand, balanced if that is possible.

    Balance as a whole, which no change of natural shape brings about, saves Ipopt half its way.
    """
    piece, contacts = cones.piece, cones.piece.contacts
    wanted = cones.contact_forces(felt)
    pull = program.energy.pull * (program.pose - piece.target)
    for shrink in SHRINKS:
        loads = piece.assembly.nodal_loads(program.reference) - pull
        balanced = project_reactions(piece, wanted, loads, shrink)
        if balanced is not None:
            return balanced
    return project(wanted, contacts.normals, cones.friction)


def _bfgs(
    program: BalanceNlp,
    cones: ConeResidual,
    scaled: bool,
    goal: float,
    max_iterations: int,
    report: Report | None,
) -> _Found:
    energy, pose, piece = program.energy, program.pose, program.piece
    dofs, start = program.dofs, program.reference

    def shape(u: FloatArray) -> FloatArray:
        found = start.ravel().copy()
        found[dofs] += piece.h * u
        return found.reshape(-1, 3)

    def residual(u: FloatArray) -> tuple[float, FloatArray]:
        value, slope = cones.at(energy, pose, shape(u))
        return value, piece.h * slope.ravel()[dofs]

    def each(iteration: int, u: FloatArray, value: float) -> None:
        if report is not None:
            report(Step("bfgs", 1.0, iteration, value, 0.0, rest=shape(u), pose=pose))

    end = descend(
        residual,
        np.zeros(len(dofs)),
        _first_metric(program, scaled),
        goal=goal,
        longest=LONGEST,
        max_iterations=max_iterations,
        report=each,
    )
    found = shape(end.x)
    forces = cones.contact_forces(energy.gradient(pose, found))
    return _Found(found, forces, end.iterations, end.reason)


def _first_metric(program: BalanceNlp, scaled: bool) -> QuasiNewton:
    """Inverse Hessian to begin with: of |F|^2 / 2, with every force counted, or the identity."""
    piece, dofs = program.piece, program.dofs
    dense = len(piece.target) <= DENSE_LIMIT
    if not scaled:
        return DenseBfgs(len(dofs)) if dense else LimitedBfgs()
    _, entries = program.energy.mixed(program.pose, program.reference)
    slope = piece.assembly.pattern.matrix(entries)[dofs][:, dofs] * (piece.h / piece.f0)
    matrix = sp.csr_array(slope.T @ slope)
    # Rigid motions of the natural shape change no force: a little of the identity holds them.
    shift = 1e-6 * float(matrix.diagonal().mean())
    matrix = sp.csr_array(matrix + shift * sp.eye_array(len(dofs)))
    if dense:
        return DenseBfgs(len(dofs), np.linalg.inv(matrix.toarray()))
    solver = make_solver(matrix.indptr, matrix.indices, "symmetric")
    solver.factor(matrix.data)
    return LimitedBfgs(solver.solve)
