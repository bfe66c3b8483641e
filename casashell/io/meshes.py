"""Mesh files in and out: OBJ and OFF directly, every other format through meshio.

The vertex order of the file is kept exactly; polygons are cut into triangles and remembered, so
that they are written back as they came.
"""

from __future__ import annotations

import io
import warnings
from collections import Counter
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from casashell.io.mesh_text import PolygonSoup, read_obj, read_off, write_obj
from casashell.io.polygons import triangulated
from casashell.mesh import TriMesh
from casashell.typing import ArrayLike, FloatArray, IntArray

_SURFACE_CELLS = ("triangle", "quad", "polygon")
_POLYGON_FORMATS = (".ply", ".vtk", ".vtu")  # beside OBJ: mixed polygons survive a round trip
_VOLUME_FORMATS = (".node", ".ele")  # tetgen: no surfaces, and its reader may never return
_T = TypeVar("_T")


@dataclass(frozen=True, eq=False)
class MeshFile:
    """mesh: what the file holds.  notes: what was done to it, one sentence each, for the user."""

    mesh: TriMesh
    notes: tuple[str, ...]


def read_mesh(path: str | Path, *, unit: float = 1.0) -> TriMesh:
    """Triangle mesh from a file; see `read_mesh_file` for what is done to polygons.

    unit: metres per unit of the file.  Raises ValueError naming the file and what is wrong.
    """
    return read_mesh_file(path, unit=unit).mesh


def read_mesh_file(path: str | Path, *, unit: float = 1.0) -> MeshFile:
    """Like `read_mesh`, with notes on what the file held beyond triangles.

    Quads are cut along the shorter diagonal, larger polygons by ear clipping; the originals stay
    in ``mesh.polygons``.  STL has no connectivity: corners in the same place become one vertex.
    """
    source = Path(path)
    _check_unit(unit)
    if not source.is_file():
        what = "is a folder, not a mesh file" if source.is_dir() else "no such file"
        raise ValueError(f"{source}: {what}")
    notes: list[str] = []
    try:
        soup = _read(source)
        if not soup.polygons:
            raise ValueError(_no_faces(soup))
        points = np.array(soup.points, dtype=np.float64)
        with np.errstate(invalid="ignore", over="ignore"):  # TriMesh names such a vertex
            faces = triangulated(points, soup.polygons)
            points *= unit
        all_triangles = len(faces) == len(soup.polygons)
        mesh = TriMesh(points, faces, () if all_triangles else tuple(soup.polygons))
    except (ValueError, OSError) as problem:
        raise ValueError(f"{source}: {_reason(problem)}") from None
    notes += _polygon_notes(soup)
    if source.suffix.lower() == ".stl":
        notes.append(
            f"STL stores no connectivity: {3 * len(faces)} corners were joined to {len(points)} "
            "vertices where they coincide exactly"
        )
    return MeshFile(mesh, tuple(notes))


def write_mesh(
    path: str | Path, mesh: TriMesh, vertices: ArrayLike | None = None, unit: float = 1.0
) -> None:
    """Write the mesh, or its faces over other ``vertices`` (V,3) [m], in units of ``unit`` metres.

    OBJ, PLY, VTK and VTU get the original polygons, other formats the triangles; OBJ and the
    binary formats keep every bit of the coordinates.  Raises ValueError naming the file.
    """
    target = Path(path)
    _check_unit(unit)
    try:
        shown = mesh if vertices is None else mesh.moved(vertices)
        points = shown.vertices / unit
        if target.suffix.lower() == ".obj":
            write_obj(target, points, list(mesh.polygons) or list(map(tuple, mesh.faces.tolist())))
        else:
            _write_with_meshio(target, points, mesh)
    except (ValueError, OSError) as problem:
        raise ValueError(f"{target}: cannot write: {_reason(problem)}") from None


def _reason(problem: Exception) -> str:
    """Text of an error without the file name Python puts into it."""
    return (isinstance(problem, OSError) and problem.strerror) or str(problem)


def _check_unit(unit: float) -> None:
    if not (np.isfinite(unit) and unit > 0):
        raise ValueError(f"unit must be a positive number of metres per file unit, got {unit}")


def _read(source: Path) -> PolygonSoup:
    readers = {".obj": read_obj, ".off": read_off}
    return readers.get(source.suffix.lower(), _read_with_meshio)(source)


def _polygon_notes(soup: PolygonSoup) -> list[str]:
    sizes = Counter(map(len, soup.polygons))
    quads, larger = sizes[4], sum(count for size, count in sizes.items() if size > 4)
    notes = []
    if quads:
        notes.append(f"{_many(quads, 'quad was', 'quads were')} split along the shorter diagonal")
    if larger:
        notes.append(
            f"{_many(larger, 'polygon', 'polygons')} with five corners or more cut into triangles"
        )
    for name, count in soup.ignored.items():
        notes.append(f"{_many(count, f'{name} was', f'{name}s were')} ignored: only faces count")
    return notes


def _many(count: int, one: str, more: str) -> str:
    return f"{count} {one if count == 1 else more}"


def _no_faces(soup: PolygonSoup) -> str:
    held = [_many(count, name, f"{name}s") for name, count in soup.ignored.items()]
    content = ", ".join([_many(len(soup.points), "vertex", "vertices"), *held])
    return f"no faces, only {content}; a mesh of triangles or polygons is needed"


def _read_with_meshio(source: Path) -> PolygonSoup:
    import meshio  # slow to import

    if not _known_to_meshio(source):
        raise ValueError(_unknown_extension(source))
    if source.suffix.lower() == ".ply" and b"end_header" not in source.read_bytes():
        raise ValueError("damaged, or not what its extension says (the PLY header has no end)")
    loaded = _quietly(lambda: meshio.read(source), "damaged, or not what its extension says")
    points = np.asarray(loaded.points, dtype=np.float64)
    if points.ndim == 2 and points.shape[1] == 2:
        points = np.column_stack([points, np.zeros(len(points))])
    polygons: list[tuple[int, ...]] = []
    ignored: Counter[str] = Counter()
    for block in loaded.cells:
        if block.type in _SURFACE_CELLS:
            polygons += [tuple(map(int, cell)) for cell in block.data]
        else:
            ignored[f"{block.type} cell"] += len(block.data)
    bad = [p for p, cell in enumerate(polygons) if min(cell) < 0 or max(cell) >= len(points)]
    if bad:
        raise ValueError(
            f"face {bad[0]} has vertices {polygons[bad[0]]}, outside 0..{len(points) - 1}"
        )
    return PolygonSoup(points.tolist(), polygons, dict(ignored))


def _write_with_meshio(target: Path, points: FloatArray, mesh: TriMesh) -> None:
    import meshio  # slow to import

    if not _known_to_meshio(target):
        raise ValueError(_unknown_extension(target))
    cells: list[tuple[str, IntArray]] = [("triangle", mesh.faces.astype(np.int32))]
    if mesh.polygons and target.suffix.lower() in _POLYGON_FORMATS:
        cells = _blocks(mesh.polygons)
    # legacy VTK and PLY default to binary, VTU to compressed binary: all exact
    writer = "meshio's writer of this format failed"
    _quietly(lambda: meshio.write(target, meshio.Mesh(points, cells)), writer)


def _blocks(polygons: tuple[tuple[int, ...], ...]) -> list[tuple[str, IntArray]]:
    """Runs of polygons with as many corners, in order, as meshio wants them."""
    names = {3: "triangle", 4: "quad"}
    runs: list[list[tuple[int, ...]]] = []
    for polygon in polygons:
        if not runs or len(runs[-1][0]) != len(polygon):
            runs.append([])
        runs[-1].append(polygon)
    return [(names.get(len(run[0]), "polygon"), np.array(run, dtype=np.int32)) for run in runs]


def _known_to_meshio(path: Path) -> bool:
    import meshio

    suffix = path.suffix.lower()
    return suffix in meshio.extension_to_filetypes and suffix not in _VOLUME_FORMATS


def _unknown_extension(path: Path) -> str:
    return (
        f"unknown extension {path.suffix!r}; "
        "use .obj, .ply, .stl, .off, .vtk, .vtu or another format meshio knows"
    )


def _quietly(action: Callable[[], _T], failure: str) -> _T:
    """Run meshio without its printing, warnings and exits; anything it raises is a ValueError."""
    said = io.StringIO()
    try:
        with warnings.catch_warnings(), redirect_stdout(said), redirect_stderr(said):
            warnings.simplefilter("ignore")
            return action()
    except ModuleNotFoundError as missing:
        raise ValueError(f"this format needs the package {missing.name}: install it") from None
    except OSError:
        raise
    # a damaged file makes its parsers fail in any way, from IndexError to sys.exit
    except (Exception, SystemExit) as problem:
        text = " ".join(said.getvalue().split()) or f"{type(problem).__name__} {problem}".strip()
        raise ValueError(f"{failure} ({text})") from None
