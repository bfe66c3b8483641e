"""What is wrong with a mesh, which ids it concerns, and what to do about it.

Errors make the equilibrium problem meaningless or numerically hopeless; warnings are for the user
to judge.  The thresholds:

* degenerate: height over longest side below 1e-10 (rounding level: the normal is noise);
* sliver, error: smallest angle below 0.1 degrees.  Bending stiffness grows like 1/height^2, so one
  such face is some 3e5 times stiffer than a good one and neither the solver nor the certificate
  (1e-6 of a nodal weight) can resolve the forces of both;
* sliver, warning: smallest angle below 1 degree (real garments contain a few and solve).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from casashell.mesh import TriMesh
from casashell.self_intersections import self_intersections
from casashell.typing import BoolArray, IntArray

__all__ = [
    "Finding",
    "MeshError",
    "coincident_groups",
    "degenerate_faces",
    "duplicate_faces",
    "inspect_mesh",
    "self_intersections",
    "validate",
]

DEGENERATE_RATIO = 1e-10  # height / longest side
HOPELESS_ANGLE = 0.1  # degrees
SLIVER_ANGLE = 1.0  # degrees

_NAMED = 5  # ids spelled out in a message; Finding.ids has them all
_REPAIR = "casashell.repaired(mesh)"


@dataclass(frozen=True, eq=False)
class Finding:
    """One kind of fault.

    kind: e.g. ``"non_manifold_edge"``, stable for programs.
    severity: an error stops a solve, a warning does not.
    ids: vertices (V), faces (F), edges (rows of vertex pairs) or face pairs, as the kind says.
    message: one sentence with the count, the first ids and the next step.
    """

    kind: str
    severity: Literal["error", "warning"]
    ids: IntArray
    message: str

    def __str__(self) -> str:
        return f"{self.severity}: {self.message}"


class MeshError(ValueError):
    """The mesh has errors; ``findings`` holds all of them, warnings included."""

    def __init__(self, findings: tuple[Finding, ...]) -> None:
        self.findings = findings
        errors = [finding.message for finding in findings if finding.severity == "error"]
        super().__init__("\n".join(errors))


def validate(mesh: TriMesh, self_intersections: bool = True) -> tuple[Finding, ...]:
    """The warnings of `inspect_mesh`; raises `MeshError` with everything found on an error."""
    findings = inspect_mesh(mesh, self_intersections)
    if any(finding.severity == "error" for finding in findings):
        raise MeshError(findings)
    return findings


def inspect_mesh(mesh: TriMesh, self_intersections: bool = True) -> tuple[Finding, ...]:
    """All faults of the mesh, errors first; empty for a sound one.

    self_intersections=False leaves out the only check that takes longer than the rest together.
    """
    findings = [*_connectivity(mesh), *_orientation(mesh), *_faces(mesh), *_vertices(mesh)]
    if self_intersections:
        findings += _intersections(mesh)
    return tuple(sorted(findings, key=lambda finding: finding.severity))


def degenerate_faces(mesh: TriMesh) -> IntArray:
    """Ids of faces that repeat a vertex or have no area (see above)."""
    corners = mesh.vertices[mesh.faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    flat = 2 * mesh.face_areas <= DEGENERATE_RATIO * longest**2
    return np.flatnonzero(flat | _repeats_vertex(mesh.faces))


def duplicate_faces(faces: IntArray) -> IntArray:
    """Ids of faces whose three vertices an earlier face has too (in any order)."""
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    later: BoolArray = np.ones(len(faces), dtype=np.bool_)
    later[first] = False
    return np.flatnonzero(later)


def coincident_groups(mesh: TriMesh) -> tuple[IntArray, IntArray]:
    """Vertices in exactly the same place as another, and the lowest vertex there, both (N,)."""
    _, first, inverse = np.unique(
        mesh.vertices + 0.0, axis=0, return_index=True, return_inverse=True
    )
    inverse = inverse.reshape(-1)
    shared = np.flatnonzero(np.bincount(inverse)[inverse] > 1)
    return shared, first[inverse[shared]]


def _repeats_vertex(faces: IntArray) -> BoolArray:
    repeats: BoolArray = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    return repeats


def _connectivity(mesh: TriMesh) -> Iterator[Finding]:
    edges = mesh.edges[mesh.topology.non_manifold_edges]
    if len(edges):
        yield _error(
            "non_manifold_edge",
            edges,
            f"{_many(edges, 'edge')} with more than two faces (vertices {_pairs(edges)}): "
            "separate the layers that meet there or delete the surplus faces in a mesh editor",
        )
    fans = mesh.topology.non_manifold_vertices
    if len(fans):
        yield _warning(
            "non_manifold_vertex",
            fans,
            f"{_many(fans, 'vertex')} where parts of the surface meet in a point only "
            f"({_names(fans)}): each acts as a ball joint; split it if that is not meant",
        )
    count, labels = mesh.topology.face_components
    if count > 1:
        sizes, first = np.bincount(labels), np.unique(labels, return_index=True)[1]
        yield _warning(
            "components",
            first,
            f"{count} separate pieces (of {_names(sizes)} faces, from faces {_names(first)}): each "
            "must be held by contact or pins of its own; if they belong together, sew them "
            f"({_REPAIR} welds coincident vertices)",
        )


def _orientation(mesh: TriMesh) -> Iterator[Finding]:
    turn, one_sided = mesh.topology.orientation
    faces = np.flatnonzero(turn & ~one_sided)
    if len(faces):
        yield _error(
            "inconsistent_orientation",
            faces,
            f"{_many(faces, 'face')} wound against the neighbours ({_names(faces)}): "
            f"{_REPAIR} turns them over",
        )
    faces = np.flatnonzero(one_sided)
    if len(faces):
        yield _error(
            "one_sided",
            faces,
            f"a one-sided (Moebius) piece of {_many(faces, 'face')} ({_names(faces)}): "
            "cut it open along a line of edges",
        )


def _faces(mesh: TriMesh) -> Iterator[Finding]:
    flat = degenerate_faces(mesh)
    if len(flat):
        yield _error(
            "degenerate_face",
            flat,
            f"{_many(flat, 'face')} without area ({_names(flat)}): {_REPAIR} removes what can be "
            "removed without a hole",
        )
    copies = duplicate_faces(mesh.faces)
    copies = copies[~_repeats_vertex(mesh.faces[copies])]
    if len(copies):
        yield _error(
            "duplicate_face",
            copies,
            f"{_many(copies, 'face')} with the vertices of another ({_names(copies)}): "
            f"{_REPAIR} drops the copies",
        )
    angle = np.degrees(mesh.face_angles.min(axis=1))
    angle[flat] = np.inf  # already an error of its own
    hopeless = np.flatnonzero(angle < HOPELESS_ANGLE)
    thin = np.flatnonzero((angle >= HOPELESS_ANGLE) & (angle < SLIVER_ANGLE))
    if len(hopeless):
        yield _error(
            "sliver",
            hopeless,
            f"{_many(hopeless, 'face')} with an angle below {HOPELESS_ANGLE:g} degrees "
            f"({_names(hopeless)}; smallest {angle.min():.2g}): too thin for any solver; remesh "
            "there, or join vertices that nearly coincide with casashell.repaired(mesh, "
            "tolerance=...)",
        )
    if len(thin):
        yield _warning(
            "sliver",
            thin,
            f"{_many(thin, 'face')} with an angle below {SLIVER_ANGLE:g} degree "
            f"({_names(thin)}; smallest {angle[thin].min():.2g}): stiff spots; remeshing helps",
        )


def _vertices(mesh: TriMesh) -> Iterator[Finding]:
    lone = mesh.topology.unreferenced
    if len(lone):
        yield _error(
            "unreferenced_vertex",
            lone,
            f"{_many(lone, 'vertex')} in no face ({_names(lone)}), without mass or stiffness: "
            f"{_REPAIR} drops them and says how the others are renumbered",
        )
    shared, _ = coincident_groups(mesh)
    if len(shared):
        yield _warning(
            "coincident_vertices",
            shared,
            f"{_many(shared, 'vertex')} exactly on top of another ({_names(shared)}): the surface "
            f"is not joined there; {_REPAIR} welds them where that gives a proper surface",
        )


def _intersections(mesh: TriMesh) -> Iterator[Finding]:
    pairs = self_intersections(mesh.vertices, mesh.faces)
    if len(pairs):
        yield _warning(
            "self_intersection",
            pairs,
            f"{len(pairs)} {'pair' if len(pairs) == 1 else 'pairs'} of faces that pass through each"
            f" other (faces {_pairs(pairs)}): the solve ignores it, but such a shell cannot be"
            " made; untangle it if that matters",
        )


def _error(kind: str, ids: IntArray, message: str) -> Finding:
    return Finding(kind, "error", ids, message)


def _warning(kind: str, ids: IntArray, message: str) -> Finding:
    return Finding(kind, "warning", ids, message)


def _many(ids: IntArray, noun: str) -> str:
    plural = {"vertex": "vertices"}.get(noun, noun + "s")
    return f"{len(ids)} {noun if len(ids) == 1 else plural}"


def _names(ids: IntArray) -> str:
    return ", ".join(map(str, ids[:_NAMED].tolist())) + (", ..." if len(ids) > _NAMED else "")


def _pairs(rows: IntArray) -> str:
    shown = ", ".join(f"{first}-{second}" for first, second in rows[:_NAMED].tolist())
    return shown + (", ..." if len(rows) > _NAMED else "")
