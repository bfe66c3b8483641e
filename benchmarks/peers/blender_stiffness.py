"""Blender's cloth made as stiff as ours on strips: it knows neither SI units nor shell moduli.

Three strips of the scene's edge length tell it: one falls freely (how much time a frame is), one hangs
(stretching), one sticks out sideways (bending).  Stiffnesses are searched until length and sag are ours.
A fourth, flat and without weight, tells whether rest angles count.

Blender's damping is in absolute terms and made for vertices of 0.3 kg, its default: with the masses of a
real cloth it is honey.  Vertices therefore weigh 0.3 kg and stiffnesses grow by as much, which moves
the same.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.peers.programs import run_script
from benchmarks.peers.scenes import FPS, THICKNESS, Arrays, PeerScene
from benchmarks.peers.strips import ALONG, DOWN, Strip
from casashell.typing import FloatArray

#: Wanted of the strips: they hang this much longer, and sag by this share of their length.
LONGER: Final = 0.02
SAG: Final = 0.3
HEAD: Final = (
    "| scene | time scale | tension | bending | hangs / ours | sags / ours | rest angle taken on |"
)
#: Mass of every vertex in Blender [kg], its default.
MASS: Final = 0.3
_GRAVITY: Final = 9.81
#: Stiffness in bending while the strip hangs: too little to matter.
_LIMP: Final = 0.01
_DAMPED: Final = {"air_damping": 3.0}


@dataclass(frozen=True)
class BlenderStiffness:
    """Settings for a scene, and how well the strips agree in the end.

    time_scale   that makes a frame 1/60 s
    tension, bending  stiffnesses in Blender's terms, were masses the real ones
    longer, sag  of Blender's strips over ours
    rest_angle   share of its rest angles that a flat strip takes on
    """

    time_scale: float
    tension: float
    bending: float
    longer: float
    sag: float
    rest_angle: float

    def settings(self, scene: PeerScene) -> Arrays:
        """For `PeerScene.for_blender`."""
        heavier = MASS / scene.vertex_mass
        return {
            "time_scale": np.array(self.time_scale),
            "vertex_mass": np.array(MASS),
            "tension": np.array(heavier * self.tension),
            "bending": np.array(heavier * self.bending),
        }

    def row(self, scene: str) -> str:
        """The line under `HEAD`."""
        numbers = (self.time_scale, self.tension, self.bending, self.longer, self.sag)
        cells = [f"{value:.3g}" for value in (*numbers, self.rest_angle)]
        return "| " + " | ".join([scene, *cells]) + " |"


@dataclass(frozen=True, eq=False)
class _BlenderStrip:
    """A strip in Blender."""

    strip: Strip
    python: Path

    def run(
        self, down: FloatArray, frames: int, rest: FloatArray | None = None, **settings: float
    ) -> FloatArray:
        """Positions (F,V,3) under gravity along ``down``."""
        mesh = self.strip.mesh
        arrays: Arrays = {
            "start": mesh.vertices,
            "rest": mesh.vertices if rest is None else rest,
            "faces": mesh.faces,
            "pinned": self.strip.pinned,
            "gravity": _GRAVITY * down,
            "friction": np.array(0.0),
            "thickness": np.array(THICKNESS),
            "colliders": np.array(0),
            "frames": np.array(frames),
            "fps": np.array(FPS),
        }
        arrays["vertex_mass"] = np.array(MASS)
        arrays |= {key: np.array(value) for key, value in settings.items()}
        return run_script(self.python, "blender", arrays).positions

    def at_rest(self, down: FloatArray, **settings: float) -> FloatArray:
        """Mean pose of the last second of five, strongly damped."""
        found = self.run(down, 5 * FPS, **_DAMPED, **settings)
        return np.asarray(found[-FPS:].mean(axis=0))

    def time_scale(self) -> float:
        """Time scale that makes a frame 1/60 s, from the acceleration of free fall."""
        settings = {"tension": 1.0, "bending": _LIMP, "time_scale": 1.0}
        loose = _BlenderStrip(_Loose(self.strip.mesh), self.python)
        found = loose.run(DOWN, 12, air_damping=0.0, damping=0.0, **settings)
        fallen = -float(np.diff(found[:, :, 1].mean(axis=1), 2)[2:].mean())
        return 1.0 / (FPS * math.sqrt(fallen / _GRAVITY))


class _Loose(Strip):
    """A strip without pins."""

    @property
    def pinned(self) -> FloatArray:  # type: ignore[override]
        return np.zeros(0, dtype=np.int64)


def calibrated(scene: PeerScene, python: Path) -> BlenderStiffness:
    """Settings for the material of a scene at its mean edge length."""
    strip = Strip.of(float(scene.result.target.mean_edge_length))
    stretch, bend = scene.value("stretch"), scene.value("bend")
    other = _BlenderStrip(strip, python)
    scale = other.time_scale()

    def hangs(weight: float) -> float:
        return strip.longer(strip.at_rest(weight, stretch, bend, ALONG))

    def sags(weight: float) -> float:
        return strip.sag(strip.at_rest(weight, stretch, bend, DOWN))

    pull = searched(hangs, LONGER / 20.0 * stretch, LONGER)
    load = searched(sags, bend / strip.free_length, SAG)

    heavier = MASS * _GRAVITY / pull

    def hangs_there(tension: float) -> float:
        settings = {"tension": heavier * tension, "bending": _LIMP, "time_scale": scale}
        return strip.longer(other.at_rest(ALONG, **settings))

    tension = searched(hangs_there, 1e-3 * stretch, LONGER)
    loaded = MASS * _GRAVITY / load

    def bent(bending: float) -> dict[str, float]:
        return {"tension": loaded * tension, "bending": loaded * bending, "time_scale": scale}

    def sags_there(bending: float) -> float:
        return strip.sag(other.at_rest(DOWN, **bent(bending)))

    bending = searched(sags_there, 1e-2 * bend, SAG)
    rolled = strip.rolled(0.1)
    curled = strip.mean_fold(other.at_rest(0.0 * DOWN, rest=rolled, **bent(bending)))
    share = curled / strip.mean_fold(rolled)
    ratios = (hangs_there(tension) / LONGER, sags_there(bending) / SAG)
    return BlenderStiffness(scale, tension, bending, *ratios, share)


def searched(
    measure: Callable[[float], float], start: float, wanted: float, tolerance: float = 0.02
) -> float:
    """Positive number at which ``measure`` is ``wanted``, by secants of the logarithms.

    Raises RuntimeError when twelve measurements do not suffice.
    """
    found: list[tuple[float, float]] = []
    x = math.log(start)
    for _ in range(12):
        value = measure(math.exp(x))
        miss = math.log(max(value, 1e-6) / wanted)
        if abs(miss) <= tolerance:
            return math.exp(x)
        found.append((x, miss))
        if len(found) == 1:
            x += 0.7
            continue
        (a, fa), (b, fb) = found[-2:]
        slope = (fb - fa) / (b - a) if fb != fa else 1.0
        x = b - max(-3.0, min(3.0, fb / slope))
    raise RuntimeError(f"nothing within reach measures {wanted}: last {value:.3g}")
