"""One mechanically independent piece of a problem, in its own vertex numbering."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from casashell.contact.detect import Contacts
from casashell.engine.assembly import Assembly
from casashell.engine.energy import Energy
from casashell.problem import Problem
from casashell.typing import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Piece:
    """A connected part of the shell with what touches and holds it.

    vertices   (n,) ids in the whole mesh; every other id is local
    origin     (3,) m, what was subtracted from all positions: stiff elements feel the rounding of
               coordinates, so a piece is solved near the origin
    target     (n,3) m, relative to the origin (exactly)
    edges      (E,2) mesh edges, for measuring how far a step distorts the mesh
    f0, h      force and length that tolerances are relative to, those of the whole problem
    """

    vertices: IntArray
    origin: FloatArray
    target: FloatArray
    edges: IntArray
    energies: tuple[Energy, ...]
    assembly: Assembly
    contacts: Contacts
    pinned: IntArray
    f0: float
    h: float

    @cached_property
    def loads(self) -> FloatArray:
        """External force on every vertex at the target (n,3) [N]."""
        return self.assembly.nodal_loads(self.target)

    @cached_property
    def held(self) -> IntArray:
        """Vertices that contacts or pins hold, sorted."""
        return np.union1d(self.contacts.vertices, self.pinned).astype(np.int64)

    @cached_property
    def rigid_modes(self) -> FloatArray:
        """Rigid motions that leave the pins in place, (3n, d) with d = 6, 3, 1 or 0.

        Translations and rotations about the centroid, scaled to comparable size.
        """
        modes = rigid_modes(self.target)
        if len(self.pinned) == 0:
            return modes
        rows = modes.reshape(len(self.target), 3, 6)[self.pinned].reshape(-1, 6)
        _, size, vh = np.linalg.svd(rows, full_matrices=True)
        rank = int(np.sum(size > 1e-9 * size[0]))
        return np.asarray(modes @ vh[rank:].T)

    def spread(self, contact_forces: FloatArray) -> FloatArray:
        """Forces per vertex (n,3) of forces per contact (C,3)."""
        total = np.zeros_like(self.target)
        np.add.at(total, self.contacts.vertices, contact_forces)
        return total

    def touching(self, contacts: Contacts) -> Piece:
        """The same piece with other contacts."""
        return replace(self, contacts=contacts)


def rigid_modes(points: FloatArray) -> FloatArray:
    """Translations and rotations of ``points`` (n,3) about their centroid, (3n, 6).

    Rotations are scaled by the radius of gyration so that all columns have comparable size.
    """
    arm = points - points.mean(axis=0)
    radius = float(np.sqrt((arm * arm).sum(axis=1).mean())) or 1.0
    modes = np.zeros((len(points), 3, 6))
    for axis in range(3):
        modes[:, axis, axis] = 1.0
        modes[:, :, 3 + axis] = np.cross(np.eye(3)[axis], arm) / radius
    return modes.reshape(-1, 6)


def scales(problem: Problem, assembly: Assembly) -> tuple[float, float]:
    """f0 [N], the mean nodal weight (1 N without weight), and h [m], the mean edge length."""
    loads = assembly.nodal_loads(problem.target.vertices)
    weight = float(np.linalg.norm(loads, axis=1).mean())
    return weight if weight > 0.0 else 1.0, float(problem.target.mean_edge_length)


def labels_of_parts(problem: Problem) -> tuple[int, IntArray]:
    """Parts of the shell that no energy couples: count and the part of every vertex."""
    from scipy.sparse.csgraph import connected_components  # slow to import

    count = len(problem.target.vertices)
    rows, columns = [problem.target.faces[:, 0]] * 2, list(problem.target.faces[:, 1:].T)
    for term in problem.energies:
        for other in term.stencils.T[1:]:
            rows.append(term.stencils[:, 0])
            columns.append(other)
    row, column = np.concatenate(rows), np.concatenate(columns)
    graph = sp.coo_array((np.ones(len(row)), (row, column)), shape=(count, count))
    parts, labels = connected_components(graph.tocsr(), directed=False)
    return int(parts), labels.astype(np.int64)


def split(problem: Problem, *, interpreted: bool = False) -> Iterator[Piece]:
    """Independent pieces of ``problem``; one piece shares all arrays when there is only one."""
    points = problem.target.vertices
    whole = Assembly(problem.energies, len(points), interpreted=interpreted)
    f0, h = scales(problem, whole)
    pinned = np.asarray(problem.pinned)
    count, labels = labels_of_parts(problem)
    for part in range(count):
        ids = np.flatnonzero(labels == part)
        renumber = np.full(len(points), -1, dtype=np.int64)
        renumber[ids] = np.arange(len(ids))
        energies = tuple(
            term.restricted(labels[term.stencils[:, 0]] == part, renumber)
            for term in problem.energies
        )
        # A multiple of the unit in the last place of the points, so that the subtraction is exact.
        origin = np.round(points[ids].mean(axis=0) * 2.0**20) / 2.0**20
        contacts = problem.contacts.subset(labels[problem.contacts.vertices] == part)
        edges = problem.target.edges
        yield Piece(
            vertices=ids,
            origin=origin,
            target=np.ascontiguousarray(points[ids] - origin),
            edges=renumber[edges[labels[edges[:, 0]] == part]],
            energies=energies,
            assembly=whole if count == 1 else Assembly(energies, len(ids), interpreted=interpreted),
            contacts=replace(contacts, vertices=renumber[contacts.vertices]),
            pinned=renumber[pinned[labels[pinned] == part]],
            f0=f0,
            h=h,
        )
