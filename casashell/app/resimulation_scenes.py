"""What happens to the nine examples of Ly 2018, Sec. 8, once their natural shapes are known.

Materials are those of Table 1 exactly.  Five scenes are made by formula (`paper_scenes`).  Four are real
meshes, nearest in kind and size to those of the paper, from a folder of garments and bodies; the paper
gives no sizes, and two of them are dolls' clothes here, for at full size its material is too soft:

    example         mesh               vertices (paper)  contacts (paper)  body
    Top             top_avatar         903 (900)         105 (116)         0.83 m tall
    Saroual         pants_avatar       1640 (2500)       221 (61)          1.66 m tall
    Gored Skirt     skirt_8panel_smpl  330 (1255)        41 (168)          1.66 m tall
    ClothCap Shirt  shirt_avatar       1355 (2550)       161 (931)         0.83 m tall

Every example has acts, a wind or a body that turns, that start from the target at rest, and of every
act some numbers are claimed; see `measured`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from casashell.app.paper_scenes import PAPER
from casashell.app.scene import Material, Scene
from casashell.contact.mesh_obstacle import MeshObstacle
from casashell.dynamics.motion import RigidMotion
from casashell.dynamics.simulate import Damping, simulate
from casashell.dynamics.simulation import Simulation
from casashell.io.meshes import read_mesh
from casashell.result import Result
from casashell.typing import FloatArray
from formulations.wind import FaceWind


@dataclass(frozen=True)
class Spell(FaceWind):
    """A wind that rises over ``onset`` seconds, and dies down over as many from ``until`` [s] on."""

    until: float = np.inf

    def at(self, time: float) -> FloatArray:
        """Velocity (3,) of the air [m/s] at ``time`` [s]."""
        late = time - self.until
        left = 1.0 - late / self.onset if self.onset > 0.0 else float(late < 0.0)
        return np.asarray(float(np.clip(left, 0.0, 1.0)) * super().at(time))


@dataclass(frozen=True, eq=False)
class Act:
    """Wind or a moving body, for so many seconds.

    claims  least and largest value of numbers of `measured`, by name
    """

    name: str
    seconds: float
    wind: FaceWind | None = None
    motion: RigidMotion | None = None
    damping: Damping | None = None
    fps: float = 60.0
    claims: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def play(self, result: Result) -> Simulation:
        """The act from the pose of ``result``, with its natural shape."""
        return simulate(
            result,
            self.seconds,
            fps=self.fps,
            wind=self.wind,
            motion=self.motion,
            damping=self.damping,
        )

    def complaints(self, found: Mapping[str, float]) -> list[str]:
        """Claims that are not met, each with its number."""
        return [
            f"{self.name}: {key} is {found[key]:.3g}, not {low:g} .. {high:g}"
            for key, (low, high) in self.claims.items()
            if not low <= found[key] <= high
        ]


@dataclass(frozen=True, eq=False)
class Example:
    """One of the nine: its name in the paper, how its scene is made, and its acts."""

    name: str
    title: str
    make: Callable[[], Scene]
    acts: tuple[Act, ...] = ()


def measured(act: Act, result: Result, played: Simulation) -> dict[str, float]:
    """Numbers of an act; lengths in the size of the shell, speeds in m/s.

    drift, moved    farthest a vertex was, and is at the end, from where it started
    slip, slipped   the same for contacts of the target, seen from the body they started on
    end speed       fastest vertex of the last frame, seen from the body
    touching        share of the contacts of the target that touch at the end
    turned          cosine between the normals at the start and the end, mean of the tenth of the
                    vertices farthest from the pins (1 without pins)
    """
    slips = _slips(act, result, played) / played.size
    contacts = result.contacts.vertices
    last = played.velocities[-1] - _carried(act, played)
    return {
        "drift": float(played.drift.max()),
        "moved": float(played.drift[-1]),
        "slip": float(slips.max(initial=0.0)),
        "slipped": float(slips[-1].max(initial=0.0)),
        "end speed": float(np.linalg.norm(last, axis=1).max()),
        "touching": float(played.contact[-1, contacts].mean()) if len(contacts) else 0.0,
        "turned": _turned(result, played),
    }


def _slips(act: Act, result: Result, played: Simulation) -> FloatArray:
    """How far (F,C) m contacts of the target are from where the body would have taken them."""
    ids = result.contacts.vertices
    there = np.repeat(played.positions[:1, ids], len(played.times), axis=0)
    if act.motion is not None:
        for k, time in enumerate(played.times):
            turn, shift = act.motion.at(float(time))
            there[k] = there[k] @ turn.T + shift
    return np.asarray(np.linalg.norm(played.positions[:, ids] - there, axis=2))


def _carried(act: Act, played: Simulation) -> FloatArray:
    """Velocities (V,3) of the body at the vertices over the last frame."""
    x = played.positions[-1]
    if act.motion is None:
        return np.zeros_like(x)
    before, after = (act.motion.at(float(time)) for time in played.times[-2:])
    riding = (x - after[1]) @ after[0]
    return np.asarray((x - riding @ before[0].T - before[1]) / np.diff(played.times[-2:]))


def _turned(result: Result, played: Simulation) -> float:
    pins, x = result.pinned, result.target.vertices
    if not len(pins):
        return 1.0
    away = np.linalg.norm(x[:, None] - x[pins], axis=2).min(axis=1)
    free = away >= np.quantile(away, 0.9)
    start, end = (_normals(result, played.positions[k])[free] for k in (0, -1))
    return float((start * end).sum(axis=1).mean())


def _normals(result: Result, x: FloatArray) -> FloatArray:
    """Unit normals (V,3) of the vertices of a pose."""
    faces = result.target.faces
    corners = x[faces]
    face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(x)
    np.add.at(normals, faces.ravel(), np.repeat(face, 3, axis=0))
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))


def swung(
    degrees: float,
    period: float,
    *,
    times: int = 1,
    axis: Sequence[float] = (0.0, 1.0, 0.0),
    center: Sequence[float] = (0.0, 0.0, 0.0),
) -> RigidMotion:
    """A body that turns to one side, to the other and back, ``times`` times in ``period`` s each.

    It starts from rest and ends at rest, and turns by ``degrees`` at most.
    """
    share = np.linspace(0.0, 1.0, 24 * times + 1)
    angles = np.sin(2.0 * np.pi * times * share) * np.sin(np.pi * share) ** 2
    angles *= np.radians(degrees) / np.abs(angles).max()
    rotation = np.outer(angles, axis)
    return RigidMotion(times * period * share, rotation=rotation, center=np.asarray(center))


def _garment(
    title: str, folder: str, unit: float, tolerance: float, material: Material, data: Path
) -> Scene:
    """A real garment on its body; ``tolerance`` in units of the file."""
    shell = read_mesh(data / folder / "shell.obj", unit=unit)
    body = read_mesh(data / folder / "obstacle.obj", unit=unit)
    worn = MeshObstacle(body, friction=_FRICTION[title], name="body")
    name = title.lower().replace(" ", "-")
    return Scene(name, shell, (worn,), material, tolerance=tolerance * unit)


_FRICTION: Final = {"Top": 0.2, "Saroual": 0.2, "Gored Skirt": 0.7, "ClothCap Shirt": 0.2}
#: Name in the paper: folder, metres per unit, contact tolerance in the unit, material of Table 1.
_GARMENTS: Final = {
    "Top": ("top_avatar", 0.05, 0.033, Material(density=0.5, stretch=0.2, bend=0.1)),
    "Saroual": ("pants_avatar", 0.1, 0.049, Material(density=0.05, stretch=1.0, bend=1e-2)),
    "Gored Skirt": (
        "skirt_8panel_smpl",
        1.0,
        0.0045,
        Material(density=0.05, stretch=0.8, bend=5e-3),
    ),
    "ClothCap Shirt": (
        "shirt_avatar",
        0.05,
        0.085,
        Material(density=1.0, stretch=3.0, bend=5e-4),
    ),
}

_MADE: Final = {
    "Synthetic Skirt": "synthetic-skirt",
    "Book Page": "book-page",
    "Puff Sleeve": "puff-sleeve",
    "Beret": "beret",
    "Floppy Hat": "floppy-hat",
}

_SETTLES: Final = Damping(stiffness=2e-3)
_ALL: Final = (0.9, 1.0)
#: Slow motions, in which the shell stays where it touches, before those in which it does not.
_ACTS: Final[Mapping[str, tuple[Act, ...]]] = {
    "Synthetic Skirt": (
        Act(
            "wind",
            1.5,
            wind=Spell((3.0, 0.0, 0.0), onset=0.3, until=1.0),
            claims={"drift": (0.1, 0.5), "slipped": (0.0, 0.03), "touching": _ALL},
        ),
    ),
    "Book Page": (
        Act(
            "weak wind",
            3.0,
            wind=Spell((9.0, 0.0, 0.0), onset=0.2, until=0.8),
            damping=_SETTLES,
            claims={"slipped": (0.01, 0.1), "end speed": (0.0, 1e-6), "turned": (0.9, 1.0)},
        ),
        Act(
            "strong wind",
            1.2,
            wind=Spell((-14.0, 0.0, 0.0), onset=0.2, until=0.7),
            claims={"moved": (0.5, 2.0), "turned": (-1.0, -0.5)},
        ),
    ),
    "Beret": (
        Act(
            "light wind",
            1.0,
            wind=Spell((1.0, 0.0, 0.0), onset=0.1, until=0.4),
            claims={"slipped": (1e-3, 0.1), "touching": (0.5, 1.0)},
        ),
        Act(
            "strong wind",
            0.6,
            wind=Spell((6.0, 2.0, 0.0), onset=0.1),
            claims={"moved": (0.5, np.inf), "touching": (0.0, 0.1)},
        ),
    ),
    "Floppy Hat": (
        Act(
            "slow head",
            0.8,
            motion=swung(15.0, 0.8),
            claims={"slip": (0.0, 0.02), "touching": _ALL},
        ),
        Act("fast head", 0.4, motion=swung(45.0, 0.4), claims={"slip": (0.02, np.inf)}),
    ),
    "Top": (Act("turning body", 0.5, motion=swung(5.0, 0.5), claims={"slip": (0.0, 0.02)}),),
    "Saroual": (Act("turning body", 0.5, motion=swung(5.0, 0.5), claims={"slip": (0.0, 0.02)}),),
    "Puff Sleeve": (
        Act(
            "swinging arm",
            0.8,
            motion=swung(15.0, 0.8, axis=(0.0, 0.0, 1.0)),
            claims={"drift": (0.05, 0.5), "slipped": (0.0, 0.03)},
        ),
    ),
    "Gored Skirt": (
        Act(
            "turning body",
            1.0,
            motion=swung(20.0, 1.0),
            claims={"drift": (0.05, 0.5), "slip": (0.0, 0.05)},
        ),
    ),
    "ClothCap Shirt": (
        Act("turning body", 0.5, motion=swung(5.0, 0.5), claims={"slip": (0.0, 0.02)}),
    ),
}


def examples(data: Path | None = None) -> tuple[list[Example], list[str]]:
    """The nine in the order of the paper's Table 1, and a line on each that is skipped.

    data  folder of real garments and bodies; without it, or without a garment in it, that is skipped
    """
    found, skipped = [], []
    for title in _ORDER:
        make: Callable[[], Scene]
        if title in _MADE:
            make = PAPER[_MADE[title]]
        else:
            folder = _GARMENTS[title][0]
            if data is None or not (data / folder / "shell.obj").is_file():
                skipped.append(f"{title}: no {folder} in {data or 'a data folder (none given)'}")
                continue
            make = partial(_garment, title, *_GARMENTS[title], data)
        name = title.lower().replace(" ", "-")
        found.append(Example(name, title, make, _ACTS.get(title, ())))
    return found, skipped


_ORDER: Final = (
    "Synthetic Skirt",
    "Book Page",
    "Beret",
    "Floppy Hat",
    "Top",
    "Saroual",
    "Puff Sleeve",
    "Gored Skirt",
    "ClothCap Shirt",
)
