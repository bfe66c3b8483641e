"""What has to come out of a scene, from linear theory alone and before anything is solved.

1. Forces inside the cones that balance the weight of the target: a linear program.  When even
   polygons around the cones have none, and the shell is stiff (masses stay those of the target),
   there is no equilibrium at the target.
2. Strain of the sag.  With contacts held, K s = w gives the sag s to first order.  Where it strains
   edges and bends hinges by next to nothing and K less its geometric part stays positive, Newton's
   iteration converges (Kantorovich) and the equilibrium is stable: it must be found.
3. Rounding.  Where rounding of coordinates makes forces above the certificate's threshold no proof
   in double precision can be had, so that failure is honest.
Between these anything but a wrong certificate or a wrong proof is allowed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.stress.physics import Shell, fold_gradient
from benchmarks.stress.recheck import FREE_FORCE, balances, parts, scale, turning
from casashell.contact.detect import Contacts
from casashell.problem import Problem
from casashell.status import Status

S = Status
CERTIFIED = frozenset({S.SOLVED})
FAILED = frozenset({S.UNSTABLE, S.CONE_VIOLATED, S.TOO_SOFT, S.ITERATION_LIMIT})
UNHELD = frozenset({S.INFEASIBLE, S.CONE_VIOLATED, S.UNSTABLE, S.ITERATION_LIMIT})
SOFT = CERTIFIED | FAILED
ANYTHING = SOFT | {S.INFEASIBLE, S.NONFINITE}

#: Strain of an edge and turn of a hinge [rad] that linear theory is trusted with.
SMALL_STRAIN, SMALL_TURN = 1e-2, 3e-2
#: Friction cones are narrowed, and contacts made to push, by this much (in nodal
#: weights) before success is promised: a support that just so balances has contacts without force.
COMFORT = 0.85
PUSH = 0.02


@dataclass(frozen=True)
class Expected:
    """Allowed statuses and why; ``raises`` when the scene must be refused."""

    allowed: frozenset[Status]
    because: str
    raises: bool = False


def expected(problem: Problem) -> Expected:
    """What theory says about a scene."""
    shell = Shell.of(problem)
    target = problem.target.vertices
    f0 = scale(shell, target, np.zeros_like(target), np.zeros(len(target), bool))
    doubt = shell.rounding(target - target.mean(axis=0)) / f0
    if doubt > 0.1 * FREE_FORCE:
        return Expected(ANYTHING, f"rounding makes forces of {doubt:.0e} f0")
    strain, turn, ratio = linear_sag(problem)
    stiff = strain <= SMALL_STRAIN and turn <= SMALL_TURN
    if not shell.weights(target).any():
        return _without_weight(problem, shell)
    if not balances(problem, outer=True):
        if stiff:
            return Expected(UNHELD, "no forces in the cones balance the weight")
        return Expected(ANYTHING, "unbalanced, soft: masses may move")
    if ratio <= 0.0:
        return Expected(SOFT, "held vertices leave a soft or free motion")
    if stiff and ratio > 0.3 and _comfortable(problem):
        return Expected(CERTIFIED, "stiff, and forces well inside the cones balance the weight")
    if stiff:
        return Expected(SOFT | {S.INFEASIBLE}, "a support that only just balances, or frictionless")
    return Expected(SOFT | {S.INFEASIBLE}, f"strain {strain:.0e}, turn {turn:.0e}: no theorem")


def _without_weight(problem: Problem, shell: Shell) -> Expected:
    """The target is its own natural shape; stable when the pins alone leave no rigid motion."""
    held = np.zeros(len(problem.target.vertices), dtype=bool)
    held[np.asarray(problem.pinned)] = True
    x = problem.target.vertices
    if turning(shell, x, x, held):
        return Expected(frozenset({S.UNSTABLE}), "no weight and a free rigid motion: neutral")
    return Expected(SOFT, "no weight: the target itself, if it has no mechanism")


def _comfortable(problem: Problem) -> bool:
    """Forces inside narrower cones balance the weight, every contact pushing a little."""
    contacts = problem.contacts
    if not len(contacts):
        return True
    if (contacts.friction == 0.0).any():
        return False
    return balances(_narrowed(problem), outer=False, push=PUSH)


class _Narrowed:
    """A problem seen with other contacts."""

    def __init__(self, problem: Problem, contacts: Contacts) -> None:
        self.target, self.energies, self.pinned = problem.target, problem.energies, problem.pinned
        self.contacts = contacts


def _narrowed(problem: Problem) -> Problem:
    c = problem.contacts
    narrow = Contacts(c.vertices, c.normals, COMFORT * c.friction, c.gaps, c.obstacle)
    return _Narrowed(problem, narrow)  # type: ignore[return-value]


def linear_sag(problem: Problem) -> tuple[float, float, float]:
    """Largest edge strain and hinge turn [rad] of the sag with contacts held, and a stability ratio.

    The ratio compares the lowest eigenvalue with the weight on (natural shape raised by the sag) to
    that without weight; infinite values where K is singular.
    """
    shell, x = Shell.of(problem), problem.target.vertices
    held = np.zeros(len(x), dtype=bool)
    held[np.asarray(problem.pinned)] = held[problem.contacts.vertices] = True
    labels = parts(shell, len(x))
    if len(np.unique(labels[held])) <= labels.max() or turning(shell, x, x, held):
        return np.inf, np.inf, 0.0
    dofs = np.flatnonzero(np.repeat(~held, 3))
    if not len(dofs):
        return 0.0, 0.0, 1.0
    matrix = shell.stiffness(x, x)[np.ix_(dofs, dofs)]
    lowest = float(np.linalg.eigvalsh(matrix)[0])
    if lowest <= 1e-13 * len(dofs) * np.abs(matrix).max():
        return np.inf, np.inf, 0.0
    sag = np.zeros(x.shape)
    sag.ravel()[dofs] = np.linalg.solve(matrix, shell.weights(x).ravel()[dofs])
    i, j = shell.edges.T
    strain = np.linalg.norm(sag[j] - sag[i], axis=1) / np.linalg.norm(x[j] - x[i], axis=1)
    turn = np.zeros(1)
    if len(shell.hinges):
        turn = np.abs((fold_gradient(x[shell.hinges]) * sag[shell.hinges]).sum(axis=(1, 2)))
    largest, bent = float(strain.max()), float(turn.max())
    if largest > 0.1 or bent > 1.0:
        return largest, bent, 0.0
    loaded = shell.stiffness(x, x - sag)[np.ix_(dofs, dofs)]
    return largest, bent, float(np.linalg.eigvalsh(loaded)[0]) / lowest
