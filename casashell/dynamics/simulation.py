"""What a simulation hands back: frames at fixed times, and how well every step was solved."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import StrEnum
from pathlib import Path

import numpy as np

from casashell.typing import BoolArray, FloatArray, IntArray

#: Arrays of frames.npz that other programs rely on.
FRAME_KEYS = ("times", "positions", "velocities", "contact", "faces")
#: Arrays that are written beside them.
EXTRA_KEYS = ("residuals", "kinetic", "potential", "steps")


class SimulationStatus(StrEnum):
    """How a simulation ended."""

    COMPLETE = "COMPLETE"
    INTERRUPTED = "INTERRUPTED"
    FAILED = "FAILED"

    @property
    def exit_code(self) -> int:
        """Exit code of the command line program."""
        return {"COMPLETE": 0, "INTERRUPTED": 130}.get(self.value, 1)


@dataclass(frozen=True)
class Frame:
    """What a callback receives at every frame.

    number      from 0, of ``count`` frames
    time        s
    positions, velocities  (V,3) m, m/s;  contact (V,): which vertices an obstacle pushes
    residual    largest residual of the natural map since the last frame, relative to the weight
    kinetic, potential  J
    steps       steps taken since the last frame; iterations: Newton iterations of these
    seconds     since the simulation began
    """

    number: int
    count: int
    time: float
    positions: FloatArray
    velocities: FloatArray
    contact: BoolArray
    residual: float
    kinetic: float
    potential: float
    steps: int
    iterations: int
    seconds: float


@dataclass(frozen=True, eq=False)
class Simulation:
    """Frames of a simulation; F of them, the first at time 0.

    times       (F,) s
    positions   (F,V,3) m
    velocities  (F,V,3) m/s
    contact     (F,V) True where an obstacle pushes the vertex
    faces       (T,3)
    residuals   (F,) residual of the natural map of contact and balance, the largest since the frame
                before, relative to the mean nodal weight
    kinetic, potential  (F,) J; their sum is ``energies``
    steps       (F,) steps taken since the frame before; more than ``substeps`` where one was halved
    status, advice  how it ended, and one sentence on what to do about it
    notes       what was noticed on the way
    seconds     wall time;  iterations, factorizations: of all steps
    """

    times: FloatArray
    positions: FloatArray
    velocities: FloatArray
    contact: BoolArray
    faces: IntArray
    residuals: FloatArray
    kinetic: FloatArray
    potential: FloatArray
    steps: IntArray
    status: SimulationStatus
    advice: str
    notes: tuple[str, ...] = ()
    seconds: float = 0.0
    iterations: int = 0
    factorizations: int = 0

    @property
    def energies(self) -> FloatArray:
        """Kinetic and potential energy together (F,) [J]."""
        return np.asarray(self.kinetic + self.potential)

    @property
    def size(self) -> float:
        """Diagonal of the bounding box of the first frame [m]."""
        return float(np.linalg.norm(np.ptp(self.positions[0], axis=0)))

    @property
    def drift(self) -> FloatArray:
        """Farthest a vertex is from where it started, (F,) in ``size``."""
        moved = np.linalg.norm(self.positions - self.positions[0], axis=2)
        return np.asarray(moved.max(axis=1) / (self.size or 1.0))

    @property
    def speeds(self) -> FloatArray:
        """Fastest vertex of every frame (F,) [m/s]."""
        return np.asarray(np.linalg.norm(self.velocities, axis=2).max(axis=1))

    def save(self, path: str | Path) -> Path:
        """Write ``path``, or frames.npz in it when it is a folder; returns the file.

        SI, no pickles: times (F,), positions (F,V,3), velocities (F,V,3), contact (F,V) bool,
        faces (T,3), and residuals, kinetic, potential, steps (F,).  Raises OSError for what the file
        system refuses.
        """
        file = Path(path)
        if file.is_dir() or not file.suffix:
            file.mkdir(parents=True, exist_ok=True)
            file = file / "frames.npz"
        arrays = {name: getattr(self, name) for name in (*FRAME_KEYS, *EXTRA_KEYS)}
        ending = {name: np.array(str(getattr(self, name))) for name in ("status", "advice")}
        np.savez_compressed(file, allow_pickle=False, **arrays, **ending)
        return file

    @staticmethod
    def load(path: str | Path) -> Simulation:
        """The simulation saved at ``path``, a file or a folder with frames.npz.

        Raises ValueError when it is not one, naming what is missing.
        """
        file = Path(path)
        file = file / "frames.npz" if file.is_dir() else file
        if not file.is_file():
            raise ValueError(f"{file} does not exist: it is written by Simulation.save")
        try:
            with np.load(file, allow_pickle=False) as stored:
                arrays = {key: stored[key] for key in stored.files}
        except (OSError, ValueError) as error:
            raise ValueError(f"{file} is not a file of frames: {error}") from None
        missing = [key for key in FRAME_KEYS if key not in arrays]
        if missing:
            raise ValueError(f"{file} has no {', '.join(missing)}: it is not a file of frames")
        frames = len(arrays["times"])
        for key in EXTRA_KEYS:
            arrays.setdefault(key, np.zeros(frames, dtype=np.int64 if key == "steps" else float))
        wanted = {entry.name for entry in fields(Simulation)} - {"status", "advice"}
        return Simulation(
            **{key: value for key, value in arrays.items() if key in wanted},
            status=SimulationStatus(str(arrays.get("status", "COMPLETE"))),
            advice=str(arrays.get("advice", "")),
        )
