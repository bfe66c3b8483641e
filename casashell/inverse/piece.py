"""One mechanically independent piece of a problem, in its own vertex numbering."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from casashell.contact.detect import Contacts
from casashell.engine.assembly import Assembly
from casashell.engine.energy import Energy
from casashell.inverse.rigid import is_blind, parts_of
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
    """

    vertices: IntArray
    origin: FloatArray
    target: FloatArray
    edges: IntArray
    energies: tuple[Energy, ...]
    assembly: Assembly
    contacts: Contacts
    pinned: IntArray

    @cached_property
    def f0(self) -> float:
        """Mean nodal weight [N], which tolerances on forces are relative to; 1 N without weight."""
        largest = float(np.abs(self.loads).max(initial=0.0))  # squares of tiny loads would vanish
        weight = largest * float(np.linalg.norm(self.loads / (largest or 1.0), axis=1).mean())
        return weight if weight > 0.0 else 1.0

    @cached_property
    def h(self) -> float:
        """Mean edge length [m]."""
        ends = self.target[self.edges]
        lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        return float(lengths.mean()) if len(lengths) else 1.0

    @cached_property
    def loads(self) -> FloatArray:
        """External force on every vertex at the target (n,3) [N]."""
        return self.assembly.nodal_loads(self.target)

    @cached_property
    def load_terms(self) -> tuple[FloatArray, ...]:
        """The same for each load term by itself."""
        loads = [term for term in self.assembly.energies if term.load]
        count = len(self.target)
        return tuple(Assembly([term], count).nodal_loads(self.target) for term in loads)

    @cached_property
    def elastic_terms_are_blind(self) -> bool:
        """Whether no energy but the loads feels a rigid motion; springs to the world do."""
        count = len(self.target)
        rng = np.random.default_rng(0)
        strained = 1.1 * self.target + 0.01 * self.h * rng.standard_normal(self.target.shape)
        return all(
            is_blind(Assembly([term], count).gradient(strained, self.target), strained)
            for term in self.assembly.energies
            if not term.load
        )

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
        # The square factor of the rows is not needed, and large where many vertices are pinned.
        _, size, vh = np.linalg.svd(rows, full_matrices=len(rows) < 6)
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


def _origin(points: FloatArray, assembly: Assembly) -> FloatArray:
    """Where to solve a piece from: its middle, or zero when an energy feels its place in space.

    A multiple of the unit in the last place of the points, so that subtracting it is exact.
    """
    middle = np.asarray(np.round(points.mean(axis=0) * 2.0**20) / 2.0**20)
    strained = points + 0.05 * (points - middle)
    here = assembly.gradient(strained, points)
    there = assembly.gradient(strained - middle, points - middle)
    same = np.abs(here - there).max(initial=0.0) <= 1e-6 * np.abs(here).max(initial=0.0)
    return middle if same else np.zeros(3)


def split(problem: Problem, *, interpreted: bool = False) -> Iterator[Piece]:
    """Independent pieces of ``problem``; one piece shares all arrays when there is only one."""
    points = problem.target.vertices
    whole = Assembly(problem.energies, len(points), interpreted=interpreted)
    pinned = np.asarray(problem.pinned)
    stencils = [problem.target.faces, *(term.stencils for term in problem.energies)]
    labels = parts_of(stencils, len(points))
    count = int(labels.max()) + 1
    for part in range(count):
        ids = np.flatnonzero(labels == part)
        renumber = np.full(len(points), -1, dtype=np.int64)
        renumber[ids] = np.arange(len(ids))
        energies = tuple(
            term.restricted(labels[term.stencils[:, 0]] == part, renumber)
            for term in problem.energies
        )
        assembly = whole if count == 1 else Assembly(energies, len(ids), interpreted=interpreted)
        origin = _origin(points[ids], assembly)
        contacts = problem.contacts.subset(labels[problem.contacts.vertices] == part)
        edges = problem.target.edges
        yield Piece(
            vertices=ids,
            origin=origin,
            target=np.ascontiguousarray(points[ids] - origin),
            edges=renumber[edges[labels[edges[:, 0]] == part]],
            energies=energies,
            assembly=assembly,
            contacts=replace(contacts, vertices=renumber[contacts.vertices]),
            pinned=renumber[pinned[labels[pinned] == part]],
        )
