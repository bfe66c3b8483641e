"""Blender's cloth made as stiff as ours on strips: it knows neither SI units nor shell moduli.

Three strips of the scene's edge length tell it: one falls freely (how much time a frame is), one hangs
(stretching), one sticks out sideways (bending).  Stiffnesses are searched until length and sag are ours.
A fourth, flat and without weight, tells whether rest angles count.

Blender's damping is in absolute terms and made for vertices of 0.3 kg, its default: with the masses of a
real cloth it is honey.  Vertices therefore weigh 0.3 kg and stiffnesses grow by as much, which moves
the same.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
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
#: Steps a frame; with its default of 5 stiff strips swing for ever or stop where they should not.
QUALITY: Final = 20
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
            "quality": np.array(QUALITY),
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
        self,
        down: FloatArray,
        frames: int,
        settings: Mapping[str, float],
        rest: FloatArray | None = None,
    ) -> FloatArray:
        """Positions (F,V,3) under gravity along ``down``; ``rest`` is flat by default."""
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
        arrays |= {"vertex_mass": np.array(MASS), "quality": np.array(QUALITY)}
        arrays |= {key: np.array(value) for key, value in settings.items()}
        return run_script(self.python, "blender", arrays).positions

    def at_rest(
        self, down: FloatArray, settings: Mapping[str, float], rest: FloatArray | None = None
    ) -> FloatArray:
        """Mean pose of the last second of five, strongly damped."""
        found = self.run(down, 5 * FPS, {**_DAMPED, **settings}, rest)
        return np.asarray(found[-FPS:].mean(axis=0))

    def time_scale(self) -> float:
        """Time scale that makes a frame 1/60 s, from the acceleration of free fall."""
        settings = {"tension": 1.0, "bending": _LIMP, "time_scale": 1.0}
        loose = _BlenderStrip(Strip(self.strip.mesh, np.zeros(0, dtype=np.int64)), self.python)
        found = loose.run(DOWN, 12, {**settings, "air_damping": 0.0, "damping": 0.0})
        fallen = -float(np.diff(found[:, :, 1].mean(axis=1), 2)[2:].mean())
        return 1.0 / (FPS * math.sqrt(fallen / _GRAVITY))


def calibrated(scene: PeerScene, python: Path) -> BlenderStiffness:
    """Settings for the material of a scene at its mean edge length."""
    edge = float(scene.result.target.mean_edge_length)
    strip = Strip.of(edge)
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
        return strip.longer(other.at_rest(ALONG, settings))

    tension = searched(hangs_there, 1e-3 * stretch, LONGER)
    loaded = MASS * _GRAVITY / load

    def bent(bending: float) -> dict[str, float]:
        return {"tension": loaded * tension, "bending": loaded * bending, "time_scale": scale}

    def sags_there(bending: float) -> float:
        return strip.sag(other.at_rest(DOWN, bent(bending)))

    # Near where it is on other meshes.
    bending = searched(sags_there, 0.12 * bend / edge**2, SAG)
    rolled = strip.rolled(0.1)
    curled = strip.mean_fold(other.at_rest(0.0 * DOWN, bent(bending), rolled))
    share = curled / strip.mean_fold(rolled)
    ratios = (hangs_there(tension) / LONGER, sags_there(bending) / SAG)
    return BlenderStiffness(scale, tension, bending, *ratios, share)


def searched(
    measure: Callable[[float], float], start: float, wanted: float, tolerance: float = 0.02
) -> float:
    """Positive number at which a monotonous ``measure`` is ``wanted``, by logarithms.

    Raises RuntimeError when it is further off than a factor of 4000.
    """
    from scipy.optimize import brentq

    def miss(x: float) -> float:
        found = math.log(max(measure(math.exp(x)), 1e-6) / wanted)
        return 0.0 if abs(found) <= tolerance else found

    low = high = math.log(start)
    below = above = miss(low)
    if below == 0.0:
        return start
    for _ in range(5):
        low, high = low - math.log(5.0), high + math.log(5.0)
        for x, known in ((high, above), (low, below)):
            found = miss(x)
            if found * known <= 0.0:
                inner = x - math.copysign(math.log(5.0), x - math.log(start))
                return math.exp(brentq(miss, inner, x, xtol=1e-3, maxiter=20))
            if x == high:
                above = found
            else:
                below = found
    raise RuntimeError(f"nothing within a factor of 4000 of {start:.3g} measures {wanted}")


def kept(scene: PeerScene, python: Path, folder: Path) -> BlenderStiffness:
    """The settings of an earlier run in ``folder``, or new ones, which are kept there."""
    file = folder / f"{scene.name}-blender.json"
    if file.is_file():
        return BlenderStiffness(**json.loads(file.read_text(encoding="utf-8")))
    found = calibrated(scene, python)
    folder.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(asdict(found), indent=1), encoding="utf-8")
    return found
