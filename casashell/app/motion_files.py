"""Motions of obstacles as files: which obstacle is meant, and sequences of numbered meshes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np

from casashell.app.keyframe_files import read_keyframes
from casashell.contact.mesh_obstacle import MeshObstacle
from casashell.contact.obstacles import Obstacle
from casashell.dynamics.motion import MeshSequence, RigidMotion
from casashell.mesh import TriMesh
from casashell.typing import FloatArray, IntArray

#: Files that a folder of meshes is searched for.
_SUFFIXES: Final = (".obj", ".ply", ".off")
_COUNTER: Final = re.compile(r"%0?\d*d")


def read_motions(
    sequences: Sequence[str],
    keyframes: Sequence[str],
    obstacles: Sequence[Obstacle],
    *,
    unit: float,
    fps: float,
) -> dict[int, RigidMotion | MeshSequence]:
    """Motions by the number of the obstacle they move.

    sequences, keyframes  ``[WHICH=]FILES`` as typed;  unit: metres per unit of the files
    fps                   meshes of the sequences a second

    Raises ValueError naming option, obstacle and file, OSError for a file that cannot be opened.
    """
    motions: dict[int, RigidMotion | MeshSequence] = {}
    for option, texts in (("--obstacle-sequence", sequences), ("--keyframes", keyframes)):
        for text in texts:
            number, files = _which(text, obstacles, option)
            if number in motions:
                raise ValueError(f"{option} {text}: obstacle {number} has a motion already")
            if option == "--keyframes":
                motions[number] = read_keyframes(Path(files), unit)
            else:
                motions[number] = _read_sequence(files, obstacles[number], number, unit, fps)
    return motions


def motion_files(text: str) -> Path:
    """The file or folder that ``[WHICH=]FILES`` speaks of; of a pattern, its folder."""
    files = Path(_parts(text)[1])
    return files if files.exists() else files.parent


def known_obstacles(obstacles: Sequence[Obstacle]) -> str:
    """``0 (head), 1``."""
    named = (f"{k} ({entry.name})" if entry.name else str(k) for k, entry in enumerate(obstacles))
    return ", ".join(named)


def _parts(text: str) -> tuple[str, str]:
    """What stands before and behind ``=``; nothing before when that is part of a path."""
    which, equals, files = text.partition("=")
    if not equals or re.search(r"[/\\*%]", which):
        return "", text
    return which.strip(), files


def _which(text: str, obstacles: Sequence[Obstacle], option: str) -> tuple[int, str]:
    """Number of the obstacle that is meant, and the files."""
    which, files = _parts(text)
    if not obstacles:
        raise ValueError(f"{option} {text}: the scene has no obstacle to move")
    known = known_obstacles(obstacles)
    if not which:
        if len(obstacles) > 1:
            raise ValueError(
                f"{option} {text}: say which obstacle moves, WHICH={files}; the scene has: {known}"
            )
        return 0, files
    found = [k for k, entry in enumerate(obstacles) if which in (entry.name, str(k))]
    if not found:
        raise ValueError(f"{option} {text}: no obstacle '{which}'; the scene has: {known}")
    if len(found) > 1:
        raise ValueError(f"{option} {text}: '{which}' may be any of {found}: give the number")
    return found[0], files


def _read_sequence(
    files: str, obstacle: Obstacle, number: int, unit: float, fps: float
) -> MeshSequence:
    label = f"obstacle {number}" + (f" ({obstacle.name})" if obstacle.name else "")
    if not isinstance(obstacle, MeshObstacle):
        kind = type(obstacle).__name__.lower()
        raise ValueError(f"{files}: {label} is a {kind}, meshes cannot deform it; use --keyframes")
    from casashell.io.meshes import read_mesh

    paths = sequence_files(files)
    faces, count = np.asarray(obstacle.mesh.faces), len(obstacle.mesh.vertices)
    frames = np.empty((len(paths), count, 3))
    polygons = obstacle.mesh.polygons if isinstance(obstacle.mesh, TriMesh) else ()
    for frame, path in enumerate(paths):
        mesh = read_mesh(path, unit=unit)
        if len(mesh.vertices) != count:
            raise ValueError(
                f"{path} has {len(mesh.vertices)} vertices, {label} has {count}: every mesh of a "
                "sequence needs the vertices and faces of the obstacle, in its order"
            )
        # diagonals of quads follow the shape: polygons tell whether the faces are the same
        same = mesh.polygons == polygons if polygons else np.array_equal(mesh.faces, faces)
        polygons = polygons or mesh.polygons
        if not same:
            raise ValueError(f"{path} has other faces than {label}: the topology must not change")
        _check_areas(mesh.vertices, faces, path)
        frames[frame] = mesh.vertices
    return MeshSequence.at_rate(frames, fps, faces)


def _check_areas(vertices: FloatArray, faces: IntArray, path: Path) -> None:
    """ValueError for a frame in which all of the surface has collapsed, or that is not finite."""
    wrong = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if wrong.size:
        raise ValueError(f"{path}: vertex {int(wrong[0])} is not finite")
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    if not np.cross(b - a, c - a).any():
        raise ValueError(f"{path}: no face has an area")


def sequence_files(files: str) -> list[Path]:
    """Numbered files in order: those in a folder, or those of a pattern with ``*`` or ``%04d``.

    Raises ValueError when there are none, numbers are missing or double, or a folder holds more than
    one series.
    """
    place = Path(files)
    if place.is_dir():
        found = [path for path in place.iterdir() if path.suffix.lower() in _SUFFIXES]
        found = [path for path in found if re.search(r"\d", path.stem)]
        series = {_series(path) for path in found}
        if len(series) > 1:
            names = ", ".join(sorted(series)[:4])
            raise ValueError(f"{files} holds several series ({names}): give a pattern for one")
    else:
        counter = _COUNTER.search(place.name)
        name = place.name if counter is None else _COUNTER.sub("*", place.name)
        found = sorted(place.parent.glob(name)) if place.parent.is_dir() else []
        if counter is not None:
            form = re.escape(place.name).replace(re.escape(counter[0]), r"\d+")
            found = [path for path in found if re.fullmatch(form, path.name)]
    if not found:
        raise ValueError(f"{files}: no numbered meshes there; give a folder or 'name_*.obj'")
    numbered: dict[int, Path] = {}
    for path in found:
        digits = re.findall(r"\d+", path.stem)
        if not digits or int(digits[-1]) in numbered:
            raise ValueError(f"{path}: the end of every name must be a number of its own")
        numbered[int(digits[-1])] = path
    order = sorted(numbered)
    for before, after in pairwise(order):
        if after != before + 1:
            raise ValueError(
                f"{files}: number {before + 1} is missing, between {before} and {after}"
            )
    return [numbered[number] for number in order]


def _series(path: Path) -> str:
    """``body_*.obj`` for body_0007.obj."""
    return re.sub(r"\d+(\D*)$", r"*\1", path.stem) + path.suffix
