"""A flat sheet of triangles, its material, and what holds it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np

from casashell.mesh import TriMesh
from casashell.typing import ArrayLike, BoolArray, FloatArray, IntArray

#: Rotation (3,3) and shift (3,) [m] that carry the flat sheet to where it is held at a time [s].
Motion: TypeAlias = Callable[[float], tuple[FloatArray, FloatArray]]

Diagonals: TypeAlias = Literal["chequered", "parallel"]


def still(time: float) -> tuple[FloatArray, FloatArray]:
    """The motion of what stays where it is."""
    del time
    return np.eye(3), np.zeros(3)


@dataclass(frozen=True, eq=False)
class Hold:
    """These vertices of the mesh move as one rigid piece."""

    vertices: IntArray
    motion: Motion = still

    def place(self, rest: FloatArray, time: float) -> FloatArray:
        """Where points ``rest`` (n,3) of the held piece are at a time."""
        rotation, shift = self.motion(time)
        return np.asarray(rest @ np.asarray(rotation).T + np.asarray(shift))


@dataclass(frozen=True, eq=False)
class Guide:
    """The normals of ``faces`` are drawn to the unit vector ``normal`` (3,) of a time [s].

    weight  k of k/2 |n - nstar|^2 [J], shared by the triangles
    """

    faces: IntArray
    normal: Callable[[float], FloatArray]
    weight: float


@dataclass(frozen=True, eq=False)
class Patch:
    """Flat mesh, plate modulus D [J], density [kg/m2], gravity (3,) [m/s2], what holds and guides it.

    Triangles with three held vertices lie beyond the ends of the sheet: they say how a clamp directs
    it, and belong to no length or area.
    """

    mesh: TriMesh
    stiffness: float
    density: float
    gravity: ArrayLike = (0.0, 0.0, 0.0)
    holds: tuple[Hold, ...] = ()
    guides: tuple[Guide, ...] = ()

    def __post_init__(self) -> None:
        for number, guide in enumerate(self.guides):
            if not (np.isfinite(guide.weight) and guide.weight > 0 and len(guide.faces)):
                raise ValueError(f"guide {number} needs faces and a weight > 0")
        for name in ("stiffness", "density"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise ValueError(f"{name} of a patch must be finite and > 0, got {value}")
        gravity = np.array(self.gravity, dtype=np.float64)
        if gravity.shape != (3,) or not np.all(np.isfinite(gravity)):
            raise ValueError(f"gravity must be three finite numbers, got {self.gravity!r}")
        object.__setattr__(self, "gravity", gravity)

    @cached_property
    def owner(self) -> IntArray:
        """(V,) number of the hold of every vertex, -1 where free; ValueError if held twice."""
        made = np.full(len(self.mesh.vertices), -1, dtype=np.int64)
        for number, hold in enumerate(self.holds):
            if np.any(made[hold.vertices] >= 0):
                raise ValueError(f"vertices of hold {number} are held already")
            made[hold.vertices] = number
        return made

    @cached_property
    def outside(self) -> BoolArray:
        """(F,) triangles beyond the ends."""
        made: BoolArray = np.all(self.owner[self.mesh.faces] >= 0, axis=1)
        return made

    @cached_property
    def hinge_share(self) -> FloatArray:
        """(H,) 2 at hinges along a clamp, of whose area only the half inside bends; 1 elsewhere.

        Hinges between held triangles never bend.
        """
        held = self.owner[self.mesh.hinges] >= 0
        clamp = held[:, 0] & held[:, 1] & (held[:, 2] != held[:, 3])
        return np.where(clamp, 2.0, 1.0)


def strip(
    length: float,
    width: float,
    columns: int,
    rows: int,
    stiffness: float,
    density: float,
    *,
    gravity: ArrayLike = (0.0, 0.0, 0.0),
    begin: Motion | None = None,
    end: Motion | None = None,
    diagonals: Diagonals = "chequered",
) -> Patch:
    """Strip 0 <= x <= length, -width/2 <= y <= width/2 of 2 columns rows right-angled triangles.

    ``begin`` and ``end`` move a clamped end; it is clamped at x = 0 or x = length by one column of
    held triangles beyond it.
    diagonals  'chequered': as the fields of a chequerboard, none preferred;  'parallel'
    Raises ValueError for sizes that are not positive.
    """
    if columns < 1 or rows < 1 or not (length > 0 and width > 0):
        raise ValueError(
            f"a strip needs positive sizes and counts, got {length:g} x {width:g} m "
            f"in {columns} x {rows}"
        )
    if diagonals not in ("chequered", "parallel"):
        raise ValueError(f"diagonals must be 'chequered' or 'parallel', got {diagonals!r}")
    first, last = -int(begin is not None), columns + int(end is not None)
    along = np.arange(first, last + 1)
    x = along * (length / columns)
    y = (np.arange(rows + 1) / rows - 0.5) * width
    grid = np.stack(np.meshgrid(x, y, [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
    mesh = TriMesh(grid, _triangles(len(along) - 1, rows, diagonals))
    column = np.repeat(along, rows + 1)
    holds = []
    if begin is not None:
        holds.append(Hold(np.flatnonzero(column <= 0), begin))
    if end is not None:
        holds.append(Hold(np.flatnonzero(column >= columns), end))
    return Patch(mesh, stiffness, density, gravity, tuple(holds))


def last_column(patch: Patch) -> IntArray:
    """Triangles of the column of cells at the end of a strip with the largest x."""
    x = patch.mesh.vertices[patch.mesh.faces][:, :, 0]
    return np.flatnonzero(x.max(axis=1) > x.max() - 0.5 * (x.max(axis=1) - x.min(axis=1)))


def _triangles(columns: int, rows: int, diagonals: Diagonals) -> IntArray:
    """(2 columns rows, 3) triangles of a grid, vertex i (rows + 1) + j in column i and row j."""
    i, j = (a.ravel() for a in np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij"))
    a = i * (rows + 1) + j
    b, c, d = a + rows + 1, a + rows + 2, a + 1
    rising = ((i + j) % 2 == 0)[:, None] | (diagonals == "parallel")
    lower = np.where(rising, np.stack([a, b, c], 1), np.stack([a, b, d], 1))
    upper = np.where(rising, np.stack([a, c, d], 1), np.stack([b, c, d], 1))
    return np.stack([lower, upper], axis=1).reshape(-1, 3).astype(np.int64)
