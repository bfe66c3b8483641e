"""Mend what can be mended without judgement, and say what was done.

Welding joins vertices in the same place, but only where the surface stays a surface: a weld that
would give an edge a third face, make two pieces meet in a point, fold a face onto another or close
a one-sided band is left undone and named.  Nothing here moves a vertex.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casashell.mesh import TriMesh
from casashell.mesh_checks import (
    Finding,
    coincident_groups,
    degenerate_faces,
    duplicate_faces,
    inspect_mesh,
)
from casashell.topology import Topology, linked
from casashell.typing import BoolArray, IntArray


@dataclass(frozen=True, eq=False)
class Repair:
    """What `repaired` made of a mesh.

    mesh: the repaired mesh, the very input if nothing was to be done.
    vertex_map: (V_old,) where each vertex of the input went, -1 if dropped.
    report: one sentence per action, with counts and ids of the input; then what is still wrong.
    remaining: errors and warnings of the repaired mesh (self-intersections are not looked for).
    """

    mesh: TriMesh
    vertex_map: IntArray
    report: tuple[str, ...]
    remaining: tuple[Finding, ...]

    @property
    def sound(self) -> bool:
        """True if the repaired mesh has no errors left."""
        return all(finding.severity != "error" for finding in self.remaining)


def repaired(mesh: TriMesh, tolerance: float = 0.0) -> Repair:
    """Weld, drop degenerate and duplicate faces, orient, drop unused vertices; report every action.

    tolerance: weld vertices up to this far apart [m]; the default welds exact copies only.

    Raises ValueError for a negative tolerance and when no face would be left.
    """
    if not (np.isfinite(tolerance) and tolerance >= 0):
        raise ValueError(f"tolerance must be a length >= 0, got {tolerance}")
    report: list[str] = []
    weld = _weld(mesh, tolerance, report)
    faces = weld[mesh.faces]
    keep = _kept_faces(mesh, faces, report)
    if not keep.any():
        raise ValueError(
            f"none of the {len(faces)} faces has an area, so nothing is left to repair; "
            "check the file and its unit"
        )
    turn = np.zeros(len(faces), dtype=np.bool_)
    wrong, one_sided = Topology(faces[keep], len(weld)).orientation
    turn[keep] = wrong & ~one_sided
    _say(report, "turned over {} to agree with the neighbours", np.flatnonzero(turn), "face")
    new_ids = _new_vertex_ids(mesh, weld, faces[keep], report)
    result = mesh
    if keep.sum() < len(faces) or turn.any() or (new_ids < 0).any():
        final = np.where(turn[:, None], faces[:, [0, 2, 1]], faces)[keep]
        polygons = _polygons(mesh, weld, keep, turn)
        result = TriMesh(
            mesh.vertices[new_ids >= 0],
            new_ids[final],
            tuple(tuple(new_ids[list(polygon)].tolist()) for polygon in polygons),
        )
    remaining = inspect_mesh(result, self_intersections=False)
    report += [f"still wrong: {f.message}" for f in remaining if f.severity == "error"]
    return Repair(result, new_ids[weld], tuple(report), remaining)


def _weld(mesh: TriMesh, tolerance: float, report: list[str]) -> IntArray:
    """(V,) the vertex each vertex becomes: the lowest of its place, or itself."""
    own = np.arange(len(mesh.vertices))
    weld = own.copy()
    shared, lowest = coincident_groups(mesh) if tolerance == 0 else _near_groups(mesh, tolerance)
    weld[shared] = lowest
    while True:
        joined = np.unique(weld[weld != own])
        spoiled = joined[np.isin(joined, _improper_vertices(mesh, weld))]
        if not len(spoiled):
            break
        undo = np.isin(weld, spoiled)
        weld[undo] = own[undo]
    moved = np.flatnonzero(weld != own)
    place = "the same place" if tolerance == 0 else f"the same place within {tolerance:g} m"
    _say(report, f"welded {{}} to a lower-numbered one in {place}", moved, "vertex")
    refused = shared[(weld[shared] == shared) & ~np.isin(shared, weld[moved])]
    _say(
        report,
        "left {} unwelded although coincident: joining them would not give a proper surface",
        refused,
        "vertex",
    )
    return weld


def _near_groups(mesh: TriMesh, tolerance: float) -> tuple[IntArray, IntArray]:
    """Like `coincident_groups` for vertices linked by gaps up to the tolerance."""
    from scipy.spatial import cKDTree  # slow to import

    pairs = cKDTree(mesh.vertices).query_pairs(tolerance, output_type="ndarray")
    labels = linked(pairs[:, 0], pairs[:, 1], len(mesh.vertices))
    _, first = np.unique(labels, return_index=True)
    shared = np.flatnonzero(np.bincount(labels)[labels] > 1)
    return shared, first[labels[shared]]


def _improper_vertices(mesh: TriMesh, weld: IntArray) -> IntArray:
    """Vertices of the welded surface at which it is not an orientable manifold."""
    originals = np.delete(mesh.faces, duplicate_faces(mesh.faces), axis=0)
    faces = weld[originals]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    if not len(faces):
        return np.unique(weld)  # welding may not do away with the whole surface
    topology = Topology(faces, len(weld))
    return np.concatenate(
        [
            topology.edges[topology.non_manifold_edges].ravel(),
            topology.non_manifold_vertices,
            faces[duplicate_faces(faces)].ravel(),
            faces[topology.orientation[1]].ravel(),
        ]
    )


def _kept_faces(mesh: TriMesh, faces: IntArray, report: list[str]) -> BoolArray:
    """(F,) which of the welded faces stay."""
    keep: BoolArray = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    flat = np.zeros(len(faces), dtype=np.bool_)
    flat[degenerate_faces(TriMesh(mesh.vertices, faces))] = True
    while True:  # a flat face at the rim can go, and may bare the next one
        rim = np.flatnonzero(keep & flat)
        rim = rim[_closes_no_gap(mesh, faces, keep)[rim]]
        if not len(rim):
            break
        keep[rim] = False
    _say(report, "dropped {} without area", np.flatnonzero(~keep), "face")
    kept = np.flatnonzero(keep)
    copies = kept[duplicate_faces(faces[kept])]
    _say(report, "dropped {} with the vertices of an earlier one", copies, "face")
    keep[copies] = False
    return keep


def _closes_no_gap(mesh: TriMesh, faces: IntArray, keep: BoolArray) -> BoolArray:
    """(F,) could a kept flat face go without a slit?  One with neighbours on both sides may not."""
    corners = mesh.vertices[faces]
    longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).argmax(axis=1)
    rows = np.flatnonzero(keep)
    idle = np.zeros(len(faces), dtype=np.bool_)
    if len(rows):
        topology = Topology(faces[rows], len(mesh.vertices))
        free = topology.edge_valence[topology.half_edge_edges.reshape(-1, 3)] == 1
        sides = (longest[rows, None] + np.arange(3)) % 3  # the long one, then the two short ones
        free = np.take_along_axis(free, sides, axis=1)
        idle[rows] = free[:, 0] | (free[:, 1] & free[:, 2])
    return idle


def _new_vertex_ids(mesh: TriMesh, weld: IntArray, faces: IntArray, report: list[str]) -> IntArray:
    """(V,) new number of every vertex in use, -1 for the others."""
    used = np.zeros(len(weld), dtype=np.bool_)
    used[faces] = True
    own = weld == np.arange(len(weld))
    _say(report, "dropped {} in no face", np.flatnonzero(~used & own), "vertex")
    return np.where(used, np.cumsum(used) - 1, -1)


def _polygons(
    mesh: TriMesh, weld: IntArray, keep: BoolArray, turn: BoolArray
) -> list[tuple[int, ...]]:
    """The input's polygons after welding; where one lost a triangle, the triangles left of it."""
    polygons: list[tuple[int, ...]] = []
    face = 0
    for polygon in mesh.polygons:
        own = np.arange(face, face + len(polygon) - 2)
        face += len(polygon) - 2
        corners = weld[list(polygon)]
        corners = corners[corners != np.roll(corners, 1)]
        rest = own[keep[own]]
        whole = len(rest) == len(corners) - 2 and len(np.unique(corners)) == len(corners)
        if whole and len(set(turn[rest].tolist())) == 1:
            order = np.roll(corners[::-1], 1) if turn[rest[0]] else corners
            polygons.append(tuple(order.tolist()))
        else:
            for triangle, over in zip(weld[mesh.faces[rest]], turn[rest], strict=True):
                polygons.append(tuple((triangle[[0, 2, 1]] if over else triangle).tolist()))
    return [] if all(len(polygon) == 3 for polygon in polygons) else polygons


def _say(report: list[str], action: str, ids: IntArray, noun: str) -> None:
    """Add a sentence with the count and the first ids, if there are any."""
    if len(ids):
        plural = {"vertex": "vertices"}.get(noun, noun + "s")
        names = ", ".join(map(str, ids[:5].tolist())) + (", ..." if len(ids) > 5 else "")
        many = f"{len(ids)} {noun if len(ids) == 1 else plural} ({names})"
        report.append(action.format(many))
