"""An animation as mesh files, one a frame: OBJ for any modeller, VTU with a PVD list for ParaView."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeAlias
from xml.etree import ElementTree

import numpy as np

from casashell.io.animation import Animation, Track
from casashell.io.mesh_text import write_obj
from casashell.io.staging import staged
from casashell.typing import FloatArray, IntArray

#: Called with the number of frames done and of all frames.
Progress: TypeAlias = Callable[[int, int], None]


def write_obj_series(
    animation: Animation,
    folder: Path,
    *,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Path:
    """``NAME_0000.obj`` ... for every track, ``NAME.obj`` for one that never moves; the folder.

    ``NAME_rest.obj`` is the natural shape, ``frames.csv`` the time of every frame.  Coordinates are
    in metres and read back to the last bit; lines and contacts have no place in this format.

    FileExistsError: the folder holds files and ``overwrite`` is False.
    """
    place = Path(folder)
    with staged(place, overwrite=overwrite, owned=_owned_by(".obj"), last="frames.csv") as made:
        for track, stem in zip(animation.tracks, stems(animation)):
            polygons = list(map(tuple, track.faces.tolist()))
            if track.rest is not None:
                write_obj(made / f"{stem}_rest.obj", track.rest, polygons)
            if not track.moves:
                write_obj(made / f"{stem}.obj", track.positions[0], polygons)
        moving = [pair for pair in zip(animation.tracks, stems(animation)) if pair[0].moves]
        for frame in _counted(animation, progress):
            for track, stem in moving:
                polygons = list(map(tuple, track.faces.tolist()))
                name = f"{stem}_{_number(frame, animation)}.obj"
                write_obj(made / name, track.positions[frame], polygons)
        rows = (f"{frame},{time!r}\n" for frame, time in enumerate(animation.times.tolist()))
        (made / "frames.csv").write_text("frame,seconds\n" + "".join(rows), encoding="ascii")
    return place


def write_vtk_series(
    animation: Animation,
    folder: Path,
    *,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Path:
    """``animation.pvd`` with the times, and a ``.vtu`` for every track and frame; the ``.pvd``.

    Vertices carry ``contact`` (0 or 1).  Lines are a part of their own; one that never moves is
    written once.  ``NAME_rest.vtu`` is the natural shape, outside the list.  Doubles are exact.

    FileExistsError: the folder holds files and ``overwrite`` is False.
    """
    place = Path(folder)
    last = "animation.pvd"
    with staged(place, overwrite=overwrite, owned=_owned_by(".vtu"), last=last) as made:
        root = ElementTree.Element("VTKFile", type="Collection", version="0.1")
        listed = ElementTree.SubElement(root, "Collection")
        for track, stem in zip(animation.tracks, stems(animation)):
            if track.rest is not None:
                _write_vtu(made / f"{stem}_rest.vtu", track.rest, track.faces, {})
        for frame in _counted(animation, progress):
            for part, (name, once, write) in enumerate(_vtk_parts(animation, frame)):
                file = name + ("" if once else f"_{_number(frame, animation)}") + ".vtu"
                if not (once and frame):
                    write(made / file)
                ElementTree.SubElement(
                    listed,
                    "DataSet",
                    timestep=repr(float(animation.times[frame])),
                    part=str(part),
                    name=name,
                    file=file,
                )
        ElementTree.indent(root)
        ElementTree.ElementTree(root).write(made / last, encoding="utf-8", xml_declaration=True)
    return place / last


def stems(animation: Animation) -> tuple[str, ...]:
    """File names for the tracks: letters, digits, ``-`` and ``_``, all different, even without case."""
    made: list[str] = []
    for track in animation.tracks:
        plain = re.sub(r"[^A-Za-z0-9-]+", "_", track.name).strip("_") or "track"
        stem, count = plain, 1
        while stem.lower() in {other.lower() for other in made}:
            count += 1
            stem = f"{plain}-{count}"
        made.append(stem)
    return tuple(made)


def _vtk_parts(
    animation: Animation, frame: int
) -> Iterator[tuple[str, bool, Callable[[Path], None]]]:
    """Name, whether one file serves all frames, and the writer of each part at a frame."""
    for track, stem in zip(animation.tracks, stems(animation)):
        yield stem, not track.moves and track.contact is None, _surface_writer(track, frame)
        if track.lines is not None and track.lines.shape[1]:
            yield f"{stem}_lines", False, _line_writer(track.lines[frame])


def _surface_writer(track: Track, frame: int) -> Callable[[Path], None]:
    data = {} if track.contact is None else {"contact": track.contact[frame].astype(np.int32)}
    return lambda path: _write_vtu(path, track.positions[frame], track.faces, data)


def _line_writer(lines: FloatArray) -> Callable[[Path], None]:
    pairs = np.arange(2 * len(lines), dtype=np.int64).reshape(-1, 2)
    return lambda path: _write_vtu(path, lines.reshape(-1, 3), pairs, {})


def _write_vtu(path: Path, points: FloatArray, cells: IntArray, data: dict[str, Any]) -> None:
    import meshio  # slow to import

    kind = "triangle" if cells.shape[1] == 3 else "line"
    mesh = meshio.Mesh(np.array(points), [(kind, cells.astype(np.int32))], point_data=data)
    meshio.write(path, mesh, file_format="vtu")


def _counted(animation: Animation, progress: Progress | None) -> Iterator[int]:
    """Frame numbers; the progress is told after each."""
    for frame in range(animation.frames):
        yield frame
        if progress is not None:
            progress(frame + 1, animation.frames)


def _number(frame: int, animation: Animation) -> str:
    return f"{frame:0{max(4, len(str(animation.frames - 1)))}d}"


def _owned_by(suffix: str) -> Callable[[str], bool]:
    """What an older series in the same folder consists of: numbered, natural and still meshes."""
    return lambda name: name.endswith(suffix)
