"""Strips of triangles as the collision response sees them: connectivity, masses, thickness.

A ribbon of N segments has N + 1 stations; station i carries a bottom and a top vertex, numbered
2 i and 2 i + 1.  A closed ribbon has N stations: its last one is its first, with bottom and top
exchanged for a Moebius band.  Each quad between two stations is split along one diagonal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from casashell.typing import AnyArray, ArrayLike, FloatArray, IntArray

Ends = Literal["open", "loop", "moebius"]


@dataclass(frozen=True, eq=False)
class Strip:
    """One body of triangles.

    faces      (F,3) vertex ids
    masses     (V,) kg, positive; what a vertex weighs in the correction
    thickness  m, positive: two strips of this thickness keep their middle surfaces that far apart.
               Choose it well below the segment length: parts of one strip keep at most half its
               shortest edge apart
    pinned     ids of vertices that the response may not move

    Arrays are copied and read-only.  Raises ValueError naming the field, face or vertex.
    """

    faces: IntArray
    masses: FloatArray
    thickness: float
    pinned: IntArray | Sequence[int] = ()

    def __post_init__(self) -> None:
        faces = np.array(self.faces, dtype=np.int64)
        masses = np.array(self.masses, dtype=np.float64)
        pinned = np.unique(np.array(self.pinned, dtype=np.int64))
        if masses.ndim != 1 or len(masses) == 0:
            raise ValueError(f"Strip.masses must have shape (V,), got {masses.shape}")
        bad = np.flatnonzero(~(np.isfinite(masses) & (masses > 0.0)))
        if bad.size:
            raise ValueError(
                f"Strip.masses: vertex {bad[0]} has {masses[bad[0]]}; masses must be positive, "
                "and a vertex that may not move goes into pinned"
            )
        if faces.ndim != 2 or faces.shape[1] != 3 or len(faces) == 0:
            raise ValueError(f"Strip.faces must have shape (F,3), got {faces.shape}")
        _check_faces(faces, len(masses))
        if not (np.isfinite(self.thickness) and self.thickness > 0.0):
            raise ValueError(f"Strip.thickness must be a positive number, got {self.thickness!r}")
        if pinned.size and (pinned[0] < 0 or pinned[-1] >= len(masses)):
            raise ValueError(f"Strip.pinned must lie in 0..{len(masses) - 1}, got {pinned}")
        for name, array in (("faces", faces), ("masses", masses), ("pinned", pinned)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @property
    def edges(self) -> IntArray:
        """(E,2) vertex ids, smaller first: rims, creases and diagonals."""
        return face_edges(self.faces)[0]


def face_edges(faces: IntArray) -> tuple[IntArray, IntArray]:
    """Edges (E,2), smaller id first, and the three edges (F,3) of each face."""
    sides = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, back = np.unique(sides, axis=0, return_inverse=True)
    return edges, back.reshape(-1, 3)


def ribbon_strip(
    bottom: ArrayLike,
    top: ArrayLike,
    *,
    mass: float,
    thickness: float,
    ends: Ends = "open",
    pinned: Sequence[int] = (),
) -> Strip:
    """Strip of a ribbon, its quads split along the shorter diagonal of the given positions.

    bottom, top  (N+1,3) m, at any time: diagonals keep their length when a ribbon bends.  Keep
                 the strip for a whole simulation: flipping a diagonal would move the surface
    mass         kg, of the whole ribbon, shared among the stations, half to an open end
    pinned       stations that may not be moved

    Raises ValueError naming the argument.
    """
    low, high = _stations(bottom, top)
    count = len(low) - 1
    if not (np.isfinite(mass) and mass > 0.0):
        raise ValueError(f"mass must be a positive number, got {mass!r}")
    ids = _station_ids(count, ends)
    a, b, c, d = ids[:-1, 0], ids[1:, 0], ids[1:, 1], ids[:-1, 1]
    falling = np.linalg.norm(high[1:] - low[:-1], axis=1) <= np.linalg.norm(
        high[:-1] - low[1:], axis=1
    )
    faces = np.where(
        falling[:, None, None],
        np.stack([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)], axis=1),
        np.stack([np.stack([a, b, d], axis=1), np.stack([b, c, d], axis=1)], axis=1),
    )
    masses = np.zeros(int(ids.max()) + 1)
    for station in (ids[:-1], ids[1:]):
        np.add.at(masses, station, 0.25 * mass / count)
    stations = np.asarray(pinned, dtype=np.int64)
    if stations.size and (stations.min() < 0 or stations.max() > count):
        raise ValueError(f"pinned stations must lie in 0..{count}, got {list(pinned)}")
    return Strip(faces.reshape(-1, 3), masses, thickness, ids[stations].ravel())


def to_vertices(bottom: ArrayLike, top: ArrayLike, ends: Ends = "open") -> FloatArray:
    """Vertices (V,3) of a strip from rims (N+1,3); the two ends of a closed one are averaged."""
    low, high = _stations(bottom, top)
    ids = _station_ids(len(low) - 1, ends)
    total, seen = np.zeros((int(ids.max()) + 1, 3)), np.zeros((int(ids.max()) + 1, 1))
    np.add.at(total, ids, np.stack([low, high], axis=1))
    np.add.at(seen, ids, 1.0)
    return total / seen


def to_rims(vertices: ArrayLike, ends: Ends = "open") -> tuple[FloatArray, FloatArray]:
    """Rims bottom, top (N+1,3) from the vertices (V,3) of a strip; inverse of `to_vertices`."""
    points = np.asarray(vertices, dtype=np.float64)
    count = len(points) // 2 - (1 if ends == "open" else 0)
    ids = _station_ids(count, ends)
    return points[ids[:, 0]], points[ids[:, 1]]


def _station_ids(count: int, ends: Ends) -> IntArray:
    """Vertex ids (N+1,2), bottom and top, of the stations of ``count`` segments."""
    if ends not in ("open", "loop", "moebius"):
        raise ValueError(f'ends must be "open", "loop" or "moebius", got {ends!r}')
    if count < (1 if ends == "open" else 3):
        raise ValueError(f"a strip with {ends} ends needs more than {count} segments")
    ids = np.arange(2 * (count + 1)).reshape(-1, 2)
    if ends != "open":
        ids[-1] = ids[0] if ends == "loop" else ids[0, ::-1]
    return ids


def _stations(bottom: ArrayLike, top: ArrayLike) -> tuple[FloatArray, FloatArray]:
    low: AnyArray = np.asarray(bottom, dtype=np.float64)
    high: AnyArray = np.asarray(top, dtype=np.float64)
    if low.ndim != 2 or low.shape[1] != 3 or low.shape != high.shape or len(low) < 2:
        raise ValueError(
            f"bottom and top must both have shape (N+1,3), got {low.shape} and {high.shape}"
        )
    return low, high


def _check_faces(faces: IntArray, count: int) -> None:
    wrong = np.flatnonzero(((faces < 0) | (faces >= count)).any(axis=1))
    if wrong.size:
        raise ValueError(
            f"Strip.faces: face {wrong[0]} is {faces[wrong[0]]}, ids must lie in 0..{count - 1}"
        )
    ordered = np.sort(faces, axis=1)
    double = np.flatnonzero((ordered[:, 1:] == ordered[:, :-1]).any(axis=1))
    if double.size:
        raise ValueError(
            f"Strip.faces: face {double[0]} is {faces[double[0]]}, it needs three different vertices"
        )
