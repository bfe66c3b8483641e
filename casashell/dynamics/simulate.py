"""The front door: `simulate` lets time pass for a shell with the natural shape of a result."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from casashell.dynamics.air import Wind
from casashell.dynamics.checkpoint import Checkpoint, fingerprint
from casashell.dynamics.newton import StepSolver
from casashell.dynamics.run import Run
from casashell.dynamics.setting import (
    Motions,
    Setting,
    bodies_of,
    check_start,
    in_motion,
    setting_of,
    watches_of,
)
from casashell.dynamics.simulation import Frame, Simulation
from casashell.dynamics.stepper import State, Stepper
from casashell.dynamics.system import Damping, System
from casashell.dynamics.touching import Detector, Watch
from casashell.problem import Problem
from casashell.result import Result
from casashell.typing import AnyArray, ArrayLike, FloatArray

Callback = Callable[[Frame], None]

#: Error of a linearised gap that is let pass, in mean edge lengths.
_SLACK = 0.05


def simulate(
    result: Result,
    seconds: float,
    *,
    problem: Problem | None = None,
    fps: float = 60.0,
    substeps: int = 1,
    rest: str | ArrayLike = "natural",
    wind: Wind | None = None,
    motion: Motions = None,
    damping: Damping | None = None,
    mass: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    callback: Callback | None = None,
    checkpoint: str | Path | None = None,
    interpreted: bool = False,
) -> Simulation:
    """Let ``seconds`` of time pass, by implicit Euler with Signorini-Coulomb contact and exact stick.

    problem     what the result was solved for; needed for results that were read from files
    fps         frames a second;  substeps: steps a frame, more where a step has to be halved
    rest        "natural": natural shape and pose of the result; "target": the target is start and
                natural shape, as without inversion; or natural positions (V,3) m
    wind        see `formulations.wind`
    motion      `RigidMotion`, `MeshSequence` or the like for all obstacles, or by number or name
    damping     `Damping`; none by default
    mass        kg, a number or (V,); by default from the density of the material and natural areas
    velocity    m/s at the start, (3,) or (V,3); at rest by default
    callback    called with a `Frame`; an exception from it ends the simulation
    checkpoint  folder to keep the frames in; a run that was killed goes on from there and makes the
                same frames.  ``seconds`` may be longer than before
    interpreted run kernels by CasADi's virtual machine

    A KeyboardInterrupt ends the run with the frames it has and status INTERRUPTED; a step that fails
    however short it is made ends it with status FAILED.  Raises ValueError before the first step for
    what cannot be simulated: shapes that do not fit, a start deep inside a body, motions that end too
    early or name no obstacle, a checkpoint of another run.
    """
    began = time.perf_counter()
    length, rate = _number(seconds, "seconds"), _number(fps, "fps")
    frames = round(length * rate)
    if frames < 1:
        raise ValueError(f"seconds * fps must be at least one frame, got {length:g} * {rate:g}")
    if substeps != int(substeps) or substeps < 1:
        raise ValueError(f"substeps must be a whole number >= 1, got {substeps}")
    if wind is not None and not isinstance(wind, Wind):
        raise ValueError("wind must have a density and parameters; see formulations.wind.FaceWind")
    setting = setting_of(result, problem, rest, mass)
    moving = _velocity(velocity, setting)
    watches = watches_of(setting, bodies_of(setting.obstacles, motion, frames / rate))
    check_start(setting, watches, result.contact_tolerance)
    system = _system(setting, wind, damping, interpreted)
    stepper = _stepper(system, setting, watches, 1.0 / (rate * substeps))
    state = State(0.0, setting.start.copy(), moving.copy(), setting.forces.copy())
    run = Run(stepper, state, setting.target.faces, frames + 1, int(substeps), rate, began)
    run.notes += _notes(result, system, rest)
    if checkpoint is not None:
        key = _fingerprint(setting, moving, watches, wind, system.damping, rate, int(substeps))
        run.use(Checkpoint(checkpoint, key, run.record))
    return run.go(callback)


def _system(
    setting: Setting, wind: Wind | None, damping: Damping | None, interpreted: bool
) -> System:
    energies = [
        in_motion(term, setting.start, setting.rest, interpreted=interpreted)
        for term in setting.energies
    ]
    shell = (energies, setting.rest, setting.mass, setting.pinned, setting.target.faces)
    return System(*shell, wind, damping or Damping(), interpreted=interpreted)


def _stepper(system: System, setting: Setting, watches: list[Watch], step: float) -> Stepper:
    edge = float(setting.target.mean_edge_length)
    reach = float(np.abs(setting.start).max(initial=0.0))
    solver = StepSolver(system, setting.weight, reach)
    return Stepper(system, Detector(watches, edge, _SLACK * edge), solver, step)


def _notes(result: Result, system: System, rest: str | ArrayLike) -> list[str]:
    """What is worth saying before the first step."""
    notes = []
    if not system.compiled:
        notes.append("no C compiler: kernels are interpreted (about ten times slower)")
    if isinstance(rest, str) and rest == "natural" and not result.status.certified:
        notes.append(f"the result is no certified equilibrium ({result.status}): it will move")
    return notes


def _number(value: float, what: str) -> float:
    number = float(value)
    if not (math.isfinite(number) and number > 0.0):
        raise ValueError(f"{what} must be a positive number, got {value}")
    return number


def _velocity(velocity: ArrayLike | None, setting: Setting) -> FloatArray:
    """Velocities (V,3) at the start; pinned vertices have none."""
    given = np.asarray(0.0 if velocity is None else velocity, dtype=np.float64)
    shape = setting.start.shape
    if given.shape not in ((), (3,), shape) or (given.shape == () and given != 0.0):
        raise ValueError(f"velocity must have shape (3,) or {shape}, got {given.shape}")
    made = np.array(np.broadcast_to(given, shape))
    wrong = np.flatnonzero(~np.isfinite(made).all(axis=1))
    if wrong.size:
        raise ValueError(f"velocity of vertex {int(wrong[0])} is not finite")
    made[setting.pinned] = 0.0
    return made


def _fingerprint(
    setting: Setting,
    moving: FloatArray,
    watches: list[Watch],
    wind: Wind | None,
    damping: Damping,
    rate: float,
    substeps: int,
) -> str:
    """Digest of a run; obstacles and wind are known by what they do to the start at a few times."""
    faces, x = setting.target.faces, setting.start
    arrays: list[AnyArray] = [
        faces,
        x,
        moving,
        setting.rest,
        setting.mass,
        setting.pinned,
        setting.forces,
    ]
    texts = [repr((rate, substeps, damping))]
    for term in setting.energies:
        arrays += [term.stencils, term.params]
        texts.append(term.density.serialize())
    for moment in (0.0, 0.37, 1.91):
        for watch in watches:
            arrays += [watch.friction, watch.offset, *watch.body.signed_distance(x, moment)]
        if wind is not None:
            centres = x[faces].mean(axis=1)
            arrays.append(wind.parameters(moment, 1.0, centres, np.zeros_like(centres)))
    texts.append(wind.density.serialize() if wind is not None else "")
    return fingerprint(arrays, texts)


__all__ = ["Callback", "Damping", "simulate"]
