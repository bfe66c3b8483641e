"""What a simulation of ribbons leaves behind: frames, counts, and a file to go on from."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, fields
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from casashell.ribbon import forces
from casashell.ribbon.chain import BOTTOM, TOP, reconstruct
from casashell.ribbon.program import Multipliers
from casashell.ribbon.response import kinetic_energy
from casashell.ribbon.ribbon import Ribbon, RibbonState
from casashell.ribbon.scene import Body, Scene
from casashell.ribbon.step import Past, Rule
from casashell.ribbon.terms import Terms
from casashell.typing import AnyArray, FloatArray

Counts = tuple[tuple[FloatArray, FloatArray, FloatArray, FloatArray], tuple[float, float]]


class RunStatus(StrEnum):
    """How a simulation ended."""

    COMPLETE = "COMPLETE"
    INTERRUPTED = "INTERRUPTED"
    FAILED = "FAILED"


@dataclass(frozen=True, eq=False)
class Frame:
    """One moment of K ribbons.

    points, slopes, angles  one array a ribbon: (2,N+1,3) [m] after collision response, (N-1,), (N-1,)
    energies                (K,3) [J]: kinetic, elastic with the regulariser, weight
    inner, outer, residual, violation  (K,) of the step that led here
    seconds, parts          it took, and how many parts it was made in
    """

    time: float
    points: tuple[FloatArray, ...]
    slopes: tuple[FloatArray, ...]
    angles: tuple[FloatArray, ...]
    energies: FloatArray
    inner: FloatArray
    outer: FloatArray
    residual: FloatArray
    violation: FloatArray
    seconds: float
    parts: float

    @staticmethod
    def of(
        scene: Scene, rule: Rule, pasts: Sequence[Past], t: float, counts: Counts | None
    ) -> Frame:
        """The frame at the end of a step."""
        none = np.zeros(len(pasts))
        numbers, took = counts or ((none, none, none, none), (0.0, 0.0))
        energies = [_energies(scene, body, past, rule) for body, past in zip(scene.bodies, pasts)]
        return Frame(
            t,
            tuple(past.points for past in pasts),
            tuple(past.state.slopes for past in pasts),
            tuple(past.state.angles for past in pasts),
            np.array(energies),
            *numbers,
            *took,
        )


def _energies(scene: Scene, body: Body, past: Past, rule: Rule) -> tuple[float, float, float]:
    """Kinetic, elastic and weight [J]."""
    ribbon, physics = body.ribbon, scene.physics
    table = reconstruct(ribbon, past.state).table.copy()
    table[BOTTOM::4], table[TOP::4] = past.points

    def total(*terms: Any) -> float:
        return Terms(ribbon.segments + 1, terms).energy(table)

    elastic = total(*forces.elastic(ribbon, physics))
    weight = total(forces.gravity(ribbon, physics, scene.gravity)) if np.any(scene.gravity) else 0.0
    return kinetic_energy(ribbon, physics, rule, past), elastic, weight


@dataclass(frozen=True)
class Progress:
    """After step ``step`` of ``steps``."""

    step: int
    steps: int
    frame: Frame


@dataclass(frozen=True, eq=False)
class Track:
    """One ribbon over F frames: bottom, top (F,N+1,3) [m], slopes, angles (F,N-1)."""

    ribbon: Ribbon
    name: str
    bottom: FloatArray
    top: FloatArray
    slopes: FloatArray
    angles: FloatArray

    @property
    def middle(self) -> FloatArray:
        """(F,N+1,3) [m] centreline."""
        return 0.5 * (self.bottom + self.top)


@dataclass(frozen=True, eq=False)
class RibbonSimulation:
    """F frames of K ribbons.

    times      (F,) [s]
    tracks     one a ribbon
    energies   (F,K,3) [J]: kinetic, elastic with the regulariser, weight
    inner, outer, residual, violation  (F,K) of each step; zero for the first frame
    seconds, parts  (F,) time a step took, and the parts it was made in
    message    one sentence about the end
    """

    times: FloatArray
    tracks: tuple[Track, ...]
    energies: FloatArray
    inner: FloatArray
    outer: FloatArray
    residual: FloatArray
    violation: FloatArray
    seconds: FloatArray
    parts: FloatArray
    status: RunStatus
    message: str

    @staticmethod
    def of(
        bodies: Sequence[Body], frames: Sequence[Frame], status: RunStatus, message: str
    ) -> RibbonSimulation:
        """Stack frames."""
        tracks = []
        for k, body in enumerate(bodies):
            points = np.stack([frame.points[k] for frame in frames])
            tracks.append(
                Track(
                    body.ribbon,
                    body.name,
                    points[:, 0],
                    points[:, 1],
                    np.stack([frame.slopes[k] for frame in frames]),
                    np.stack([frame.angles[k] for frame in frames]),
                )
            )
        series = ("energies", "inner", "outer", "residual", "violation", "seconds", "parts")
        stacked = {name: np.array([getattr(f, name) for f in frames]) for name in series}
        times = np.array([frame.time for frame in frames])
        return RibbonSimulation(times, tuple(tracks), **stacked, status=status, message=message)

    @property
    def arrays(self) -> dict[str, AnyArray]:
        """``times``, and for ribbon k ``bottom_k`` and so on."""
        made: dict[str, AnyArray] = {"times": self.times}
        for k, track in enumerate(self.tracks):
            made |= {
                f"bottom_{k}": track.bottom,
                f"top_{k}": track.top,
                f"slopes_{k}": track.slopes,
                f"angles_{k}": track.angles,
                f"length_{k}": np.array(track.ribbon.length),
                f"width_{k}": np.array(track.ribbon.width),
                f"stiffness_{k}": np.array(track.ribbon.stiffness),
            }
        return made

    def save(self, path: str | Path) -> Path:
        """Write `arrays` as a compressed npz file and return where."""
        target = Path(path)
        if target.suffix != ".npz":
            raise ValueError(f"frames go into an .npz file, got {target.name}")
        arrays: dict[str, Any] = dict(self.arrays)
        np.savez_compressed(target, **arrays)
        return target


_STATE = ("slopes", "angles", "frame", "origin", "start_angle", "end_angle")
_COUNTS = ("energies", "inner", "outer", "residual", "violation", "seconds", "parts")


def save_checkpoint(path: Path, pasts: Sequence[Past], frames: Sequence[Frame], h: float) -> None:
    """Everything a run goes on from; an interrupt leaves the old file or the new one."""
    made: dict[str, Any] = {"step": h, "times": np.array([f.time for f in frames])}
    for name in _COUNTS:
        made[name] = np.array([getattr(f, name) for f in frames])
    for k, past in enumerate(pasts):
        for name in ("points", "slopes", "angles"):
            made[f"{name}_{k}"] = np.stack([getattr(f, name)[k] for f in frames])
        for name in ("former", "former_slopes", "lapse"):
            made[f"{name}_{k}"] = getattr(past, name)
        made[f"last_{k}"] = past.points
        states = {"state": past.state, "earlier": past.earlier}
        for label, state in states.items():
            if state is not None:
                made |= {f"{label}_{name}_{k}": getattr(state, name) for name in _STATE}
        if past.pushed is not None:
            made[f"pushed_{k}"] = past.pushed
        if past.multipliers is not None:
            for entry in fields(past.multipliers):
                made[f"multiplier_{entry.name}_{k}"] = getattr(past.multipliers, entry.name)
    partial = path.with_name(path.name + ".part")
    with partial.open("wb") as file:
        np.savez(file, **made)
    os.replace(partial, path)


def load_checkpoint(
    path: Path, bodies: Sequence[Body], h: float
) -> tuple[tuple[Past, ...], list[Frame]]:
    """What `save_checkpoint` wrote.  ValueError for another scene or step."""
    with np.load(path) as file:
        found = dict(file)
    sizes = [body.ribbon.segments + 1 for body in bodies]
    kept = [found[f"last_{k}"].shape[1] for k in range(len(found)) if f"last_{k}" in found]
    if kept != sizes or float(found["step"]) != h:
        raise ValueError(
            f"checkpoint {path.name} is of a run with {kept} stations and steps of "
            f"{float(found['step']):g} s, this scene has {sizes} and {h:g} s"
        )
    frames = []
    for f, t in enumerate(found["times"]):
        series: dict[str, Any] = {
            name: tuple(found[f"{name}_{k}"][f] for k in range(len(bodies))) for name in _SHAPES
        }
        series |= {name: found[name][f] for name in _COUNTS}
        frames.append(Frame(time=float(t), **series))
    return tuple(_past(found, k) for k in range(len(bodies))), frames


_SHAPES = ("points", "slopes", "angles")


def _past(found: dict[str, AnyArray], k: int) -> Past:
    def state(label: str) -> RibbonState | None:
        if f"{label}_slopes_{k}" not in found:
            return None
        values: dict[str, Any] = {name: found[f"{label}_{name}_{k}"] for name in _STATE}
        values |= {name: float(values[name]) for name in ("start_angle", "end_angle")}
        return RibbonState(**values)

    last = state("state")
    if last is None:
        raise ValueError(f"the checkpoint has no state of ribbon {k}")
    multipliers = None
    if f"multiplier_penalty_{k}" in found:
        values = [found[f"multiplier_{entry.name}_{k}"] for entry in fields(Multipliers)]
        multipliers = Multipliers(values[0], values[1], float(values[2]))
    return Past(
        state=last,
        points=found[f"last_{k}"],
        former=found[f"former_{k}"],
        former_slopes=found[f"former_slopes_{k}"],
        lapse=float(found[f"lapse_{k}"]),
        earlier=state("earlier"),
        pushed=found.get(f"pushed_{k}"),
        multipliers=multipliers,
    )
