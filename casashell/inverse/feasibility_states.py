"""Stresses that hold a target: how large, how much friction, and whether they hold it stably."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from casashell.contact.cone import split as split_force
from casashell.engine.energy import Energy
from casashell.inverse.forces import Shrink
from casashell.inverse.outcome import pushing
from casashell.inverse.piece import Piece
from casashell.inverse.stability import NEUTRAL, free_dofs, lowest_eigenpairs
from casashell.inverse.stress import Stress, StressProgram
from casashell.typing import FloatArray

#: No mesh has hinges whose rest angle differs by more from that of a flat target [rad]; it hardly has
#: any that differ by more than half of it.
LARGEST_FOLD, LARGE_FOLD = np.pi, 0.5 * np.pi
#: Elongation / length beyond which edges are not what the model is for; -1 has no rest length.
LARGEST_STRETCH = 0.5
MAX_ROUNDS = 10


@dataclass(frozen=True, eq=False)
class StressState:
    """A set of stresses in balance with loads, contacts and pins.

    tensions, moments  largest of the forces along lengths [N] and about angles [N m]
    stretch            largest |L / L_r - 1| to first order; None without lengths among the measures
    fold               largest |theta - theta_r| [rad]; None without angles
    energy             strain energy [J]
    contact_forces     (C,3) N, on the shell
    friction_used      largest |f_T| / (mu f_N) over rough contacts that push; None without any
    strain_forces      (T,) every tension and moment, in the order of the energies
    """

    tension: float | None
    moment: float | None
    stretch: float | None
    fold: float | None
    energy: float
    contact_forces: FloatArray
    friction_used: float | None
    strain_forces: FloatArray

    @property
    def bearable(self) -> bool:
        """Whether a mesh can have the natural lengths and angles these stresses ask for."""
        return self.within(LARGEST_FOLD)

    def within(self, fold: float) -> bool:
        """Whether folds stay within ``fold`` [rad] and stretch within `LARGEST_STRETCH`."""
        near = 1.0 + 1e-6  # what an interior-point method leaves of a bound
        stretch = self.stretch or 0.0
        return stretch <= near * LARGEST_STRETCH and (self.fold or 0.0) <= near * fold


@dataclass(frozen=True)
class StabilityMargin:
    """Result of the stability cuts.

    eigenvalue  lowest of the Hessian under the last stresses [N/m]; None when no vertex is free
    scaled      the same times h / f0
    rounds      stress programs solved after the first, with `cuts` directions
    ended       "stable"; "no solution": no stress state meets the cuts; "rounds" or "time": not known
    """

    eigenvalue: float | None
    scaled: float | None
    rounds: int
    cuts: int
    ended: str

    @property
    def stable(self) -> bool:
        """A stress state was found under which the target is a strict minimum, contacts held."""
        return self.ended == "stable"


def measures_length(term: Energy, program: StressProgram) -> bool:
    """Whether the strain measure of a term scales with the mesh (a length) or not (an angle)."""
    slopes = program.slopes[:, program.parts[program.terms.index(term)]]
    size = np.sqrt(np.asarray(slopes.multiply(slopes).sum(axis=0)).ravel())
    corners = program.piece.target[term.stencils]
    reach = np.linalg.norm(corners - corners.mean(axis=1, keepdims=True), axis=(1, 2))
    return bool((_lengths(program, term) > 0.1 * size * reach).any())


def limits(program: StressProgram, fold: float) -> FloatArray:
    """Largest |q - q_r| (T,) of every element: ``fold`` [rad] for angles, `LARGEST_STRETCH`."""
    parts = [
        LARGEST_STRETCH * _lengths(program, term)
        if measures_length(term, program)
        else np.full(len(term.stencils), fold)
        for term in program.terms
    ]
    return np.concatenate(parts) if parts else np.empty(0)


def _lengths(program: StressProgram, term: Energy) -> FloatArray:
    """Value of a length-like measure: it equals its own growth rate (Euler)."""
    slopes = program.slopes[:, program.parts[program.terms.index(term)]]
    x = program.piece.target - program.piece.target.mean(axis=0)
    rate: FloatArray = np.abs(np.asarray(slopes.T @ x.ravel()))
    return rate


def state_of(program: StressProgram, stress: Stress) -> StressState:
    """What a solution of the program means."""
    tau = stress.strain_forces
    strain = np.abs(tau) / program.stiffness
    figures: dict[str, list[float]] = {"tension": [], "moment": [], "stretch": [], "fold": []}
    for term, part in zip(program.terms, program.parts, strict=True):
        if measures_length(term, program):
            figures["tension"].append(float(np.abs(tau[part]).max()))
            figures["stretch"].append(float((strain[part] / _lengths(program, term)).max()))
        else:
            figures["moment"].append(float(np.abs(tau[part]).max()))
            figures["fold"].append(float(strain[part].max()))
    largest = {name: max(values) if values else None for name, values in figures.items()}
    return StressState(
        energy=stress.energy,
        contact_forces=stress.contact_forces,
        friction_used=_friction_used(program.piece, stress.contact_forces),
        strain_forces=tau,
        tension=largest["tension"],
        moment=largest["moment"],
        stretch=largest["stretch"],
        fold=largest["fold"],
    )


def _friction_used(piece: Piece, forces: FloatArray) -> float | None:
    contacts = piece.contacts
    normal, across = split_force(forces, contacts.normals)
    # Below this the interior-point method leaves forces, not the balance.
    chosen = (contacts.friction > 0.0) & (normal > 1e-4 * piece.f0)
    if not chosen.any():
        return None
    slip = np.linalg.norm(across[chosen], axis=1)
    return float((slip / (contacts.friction[chosen] * normal[chosen])).max())


def least_stress(program: StressProgram, shrink: Shrink) -> tuple[Stress, FloatArray | None] | None:
    """Stresses of least energy, within `limits` if there are such; the limits used, or None."""
    found = program.solve(shrink)
    if found is None:
        return None
    state = state_of(program, found)
    for fold in (LARGE_FOLD, LARGEST_FOLD):
        if state.within(fold):
            return found, None
        bound = limits(program, fold)
        within = program.solve(shrink, limit=bound)
        if within is not None:
            return within, bound
    return found, None


def stability(
    program: StressProgram,
    stress: Stress,
    shrink: Shrink,
    limit: FloatArray | None,
    deadline: float,
) -> tuple[StabilityMargin, Stress]:
    """Cut along unstable directions until none is left; the margin and the stresses it belongs to.

    deadline  of `time.perf_counter`; the first eigenvalue is computed in any case
    """
    piece = program.piece
    cuts: list[FloatArray] = []
    wanted = 1e-3 * piece.f0 / piece.h
    rounds = 0
    while True:
        values, modes = _lowest(program, stress, 2 if rounds else 3)
        if np.isposinf(values[0]):
            return StabilityMargin(None, None, rounds, len(cuts), "stable"), stress
        sized = values * piece.h / piece.f0
        margin = StabilityMargin(float(values[0]), float(sized[0]), rounds, len(cuts), "stable")
        if sized[0] > NEUTRAL:
            return margin, stress
        if rounds == MAX_ROUNDS:
            return replace(margin, ended="rounds"), stress
        if time.perf_counter() > deadline:
            return replace(margin, ended="time"), stress
        cuts += [mode.reshape(-1, 3) for mode in modes.T[sized <= NEUTRAL]]
        found = program.solve(shrink, cuts, wanted, limit)
        if found is None:
            return replace(margin, ended="no solution", cuts=len(cuts)), stress
        stress, rounds = found, rounds + 1


def _lowest(program: StressProgram, stress: Stress, count: int) -> tuple[FloatArray, FloatArray]:
    """Lowest eigenpairs of the Hessian under stress: pins and pushing contacts held."""
    piece = program.piece
    dofs = free_dofs(piece, pushing(piece, stress.contact_forces))
    matrix = program.tangent(stress.strain_forces)
    values, vectors = lowest_eigenpairs(matrix[dofs][:, dofs], count)
    modes = np.zeros((piece.target.size, len(values)))
    if len(dofs):
        modes[dofs] = vectors
    return values, modes
