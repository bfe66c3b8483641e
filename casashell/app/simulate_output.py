"""Files of a simulation: frames, record, player, animation formats, the last frame beside the first."""

from __future__ import annotations

import importlib.util
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from casashell.app.failures import CommandError
from casashell.contact.obstacles import Obstacle
from casashell.dynamics.motion import MeshSequence, Motion, RigidMotion
from casashell.dynamics.simulation import Simulation, SimulationStatus
from casashell.io.animation import Animation, Track
from casashell.io.animation_files import Progress
from casashell.io.staging import staged_file
from casashell.io.tessellate import Region, tessellate
from casashell.typing import FloatArray

if TYPE_CHECKING:
    from casashell.ribbon.record import RibbonSimulation

FRAMES, RECORD, PLAYER, PICTURE = "frames.npz", "simulation.json", "player.html", "first-last.png"
#: What a format is written to, and the modules it needs.
_FORMATS: Final[Mapping[str, tuple[str, tuple[str, ...]]]] = {
    "html": (PLAYER, ()),
    "obj": ("obj", ()),
    "vtk": ("vtk", ()),
    "usd": ("animation.usdc", ("pxr",)),
    "mp4": ("animation.mp4", ("av", "pyvista", "matplotlib", "PIL")),
    "gif": ("animation.gif", ("av", "pyvista", "matplotlib", "PIL")),
}
_INSTALL: Final = {
    "pxr": "pip install usd-core, or casashell with the extra 'usd'",
    "": "pip install av pyvista matplotlib pillow, or casashell with the extra 'viz'",
}
_PICTURE_NEEDS: Final = ("pyvista", "matplotlib", "PIL")
#: Height of the picture of one frame, pixels.
_HEIGHT: Final = 720


def wanted_formats(text: str) -> tuple[str, ...]:
    """Formats of ``--formats``, none twice; CommandError for unknown ones and missing packages."""
    names = dict.fromkeys(part.strip().lower() for part in text.split(",") if part.strip())
    for name in names:
        if name not in _FORMATS:
            known = ", ".join(_FORMATS)
            raise CommandError(f"--formats: no format '{name}'; known: {known}")
        missing = absent(_FORMATS[name][1])
        if missing:
            hint = _INSTALL.get(missing[0], _INSTALL[""])
            raise CommandError(
                f"--formats {name} needs {', '.join(missing)}, not installed: {hint}"
            )
    return tuple(names)


def wanted_files(formats: tuple[str, ...], *, picture: bool) -> tuple[str, ...]:
    """What to write in order: the player, what is asked for, the picture."""
    asked = (name for name in formats if name != "html")
    return ("html", *asked, *((PICTURE,) if picture else ()))


def picture_remark() -> str | None:
    """Why there will be no picture, or None."""
    missing = absent(_PICTURE_NEEDS)
    return f"no picture: {', '.join(missing)} missing; {_INSTALL['']}" if missing else None


def absent(modules: Sequence[str]) -> list[str]:
    """Those that are not installed; nothing is imported."""
    return [name for name in modules if importlib.util.find_spec(name) is None]


def owned_paths(folder: Path) -> list[Path]:
    """Everything in ``folder`` that an older simulation has written."""
    names = [FRAMES, RECORD, PICTURE, *(name for name, _ in _FORMATS.values())]
    return [folder / name for name in names if (folder / name).exists()]


def record_of(simulation: Simulation, settings: Mapping[str, Any]) -> dict[str, Any]:
    """What simulation.json says; numbers that are not finite become null."""
    energy, kinetic = simulation.energies, simulation.kinetic
    record: dict[str, Any] = {
        "status": str(simulation.status),
        "advice": simulation.advice,
        "seconds": simulation.seconds,
        "time": float(simulation.times[-1]),
        "frames": len(simulation.times),
        "steps": int(simulation.steps.sum()),
        "iterations": simulation.iterations,
        "factorizations": simulation.factorizations,
        "vertices": simulation.positions.shape[1],
        "residual": _finite(simulation.residuals.max()),
        "size": simulation.size,
        "drift": {
            "largest": float(simulation.drift.max()),
            "last": float(simulation.drift[-1]),
        },
        "speed": {
            "largest": float(simulation.speeds.max()),
            "last": float(simulation.speeds[-1]),
            "contacts_last_second": contact_speed(simulation),
        },
        "contacts": {
            "first": int(simulation.contact[0].sum()),
            "last": int(simulation.contact[-1].sum()),
        },
        "energy": {
            "first": _finite(energy[0]),
            "last": _finite(energy[-1]),
            "largest": _finite(energy.max()),
            "largest_kinetic": _finite(kinetic.max()),
        },
        "notes": list(simulation.notes),
        "settings": dict(settings),
    }
    return record


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def contact_speed(simulation: Simulation) -> float | None:
    """Fastest vertex that touches an obstacle over the last second [m/s]; None if none does."""
    late = simulation.times >= simulation.times[-1] - 1.0
    speeds = np.linalg.norm(simulation.velocities[late], axis=2)[simulation.contact[late]]
    return float(speeds.max()) if speeds.size else None


def animation_of(
    simulation: Simulation,
    rest: FloatArray | None,
    obstacles: Sequence[Obstacle],
    motions: Mapping[int, Motion],
    *,
    name: str,
    title: str,
    up: tuple[float, float, float],
) -> Animation:
    """The shell with its natural shape ``rest`` (V,3) m, if a mesh has it, and the moving obstacles."""
    points = simulation.positions
    shell = Track(name, points, simulation.faces, rest=rest, contact=simulation.contact)
    region = Region.around(points.min(axis=(0, 1)), points.max(axis=(0, 1)), scale=1.25)
    tracks, taken = [shell], {name}
    for number, obstacle in enumerate(obstacles):
        label = obstacle.name or f"obstacle {number}"
        label = f"{label} ({number})" if label in taken else label
        taken.add(label)
        tracks.append(_body(label, obstacle, motions.get(number), simulation.times, region))
    state = simulation.status
    count = points.shape[1]
    touching = simulation.contact.sum(axis=1)
    return Animation(
        simulation.times,
        tuple(tracks),
        up,
        title if state is SimulationStatus.COMPLETE else f"{title} ({state}, not complete)",
        tuple(f"{n} of {count} vertices touch an obstacle" for n in touching) if obstacles else (),
        {
            "farthest from the start (sizes)": simulation.drift,
            "fastest vertex (m/s)": simulation.speeds,
            "energy (J)": simulation.energies,
            "kinetic energy (J)": simulation.kinetic,
        },
    )


def _body(
    label: str, obstacle: Obstacle, motion: Motion | None, times: FloatArray, region: Region
) -> Track:
    surface = tessellate(obstacle, region)
    if isinstance(motion, MeshSequence):
        return Track(label, np.array([motion.at(t) for t in times]), surface.faces, body=True)
    if isinstance(motion, RigidMotion):
        poses = [motion.at(t) for t in times]
        moved = np.array([surface.vertices @ turn.T + shift for turn, shift in poses])
        return Track(label, moved, surface.faces, body=True)
    return Track.still(label, surface.vertices, surface.faces, len(times))


def write_frames(simulation: Simulation | RibbonSimulation, folder: Path) -> None:
    """frames.npz of shells or ribbons, complete or not at all."""
    with staged_file(folder / FRAMES, overwrite=True) as temporary:
        simulation.save(temporary)


def write_record(record: Mapping[str, Any], path: Path) -> None:
    """A record as JSON, complete or not at all."""
    text = json.dumps(record, indent=1, allow_nan=False)
    with staged_file(path, overwrite=True) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def write_format(
    name: str, animation: Animation, folder: Path, unit: float, progress: Progress | None
) -> str:
    """One format of ``--formats`` or the picture; the name of the file or folder.

    Mesh series are in units of ``unit`` metres, as the input; USD is in metres and says so.
    """
    from casashell.io.animation_files import write_obj_series, write_vtk_series
    from casashell.io.movie import write_movie
    from casashell.io.player import write_player
    from casashell.io.usd_file import write_usd

    if name == PICTURE:
        return write_picture(animation, folder)
    target = folder / _FORMATS[name][0]
    if name == "html":
        write_player(animation, target, overwrite=True)
    elif name in ("obj", "vtk"):
        write: Callable[..., Path] = write_obj_series if name == "obj" else write_vtk_series
        write(_in_unit(animation, unit), target, overwrite=True, progress=progress)
    elif name == "usd":
        write_usd(animation, target, overwrite=True, progress=progress)
    else:
        write_movie(animation, target, overwrite=True, progress=progress)
    return target.name


def write_picture(animation: Animation, folder: Path) -> str:
    """The first frame and the last from one camera; the name of the file."""
    from casashell.io.animation_camera import framing
    from casashell.io.colours import OBSTACLE, SHELL, SHELL_INSIDE
    from casashell.io.sheet import Panel, write_sheet
    from casashell.io.studio import Layer, Studio
    from casashell.io.tessellate import Surface

    camera = framing(animation)
    size = (2 * round(0.5 * _HEIGHT * camera.aspect), _HEIGHT)
    panels = []
    with Studio() as studio:
        for frame, label in ((0, "start"), (-1, "end")):
            layers = [
                Layer(Surface(track.positions[frame], track.faces), OBSTACLE, behind=True)
                if track.body
                else Layer(
                    Surface(track.positions[frame], track.faces), SHELL, SHELL_INSIDE, edges=True
                )
                for track in animation.tracks
            ]
            text = f"{label}, {animation.times[frame]:.2f} s"
            panels.append(Panel(label, text, studio.shoot(layers, camera, size)))
    with staged_file(folder / PICTURE, overwrite=True) as temporary:
        write_sheet([panels], temporary)
    return PICTURE


def _in_unit(animation: Animation, unit: float) -> Animation:
    """The animation in units of ``unit`` metres."""
    if unit == 1.0:
        return animation
    tracks = []
    for track in animation.tracks:
        still = track.positions.strides[0] == 0
        frames = len(track.positions)
        scaled = track.positions[0] / unit if still else track.positions / unit
        tracks.append(
            replace(
                track,
                positions=np.broadcast_to(scaled, (frames, *scaled.shape)) if still else scaled,
                rest=None if track.rest is None else track.rest / unit,
            )
        )
    return replace(animation, tracks=tuple(tracks))
