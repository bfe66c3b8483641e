"""An earlier answer of the same mesh as the place where Newton begins.

A designer changes a material and solves again: the natural shape moves a little, the contact forces
keep their directions and scale with the weight.  Both are guesses only; what is found is judged as
from any other start.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casashell.contact.cone import split
from casashell.inverse.forces import Shrink
from casashell.inverse.outcome import ROUNDING_OF_CONES
from casashell.inverse.piece import Piece
from casashell.problem import Problem
from casashell.result import Result
from casashell.typing import FloatArray


@dataclass(frozen=True, eq=False)
class Guess:
    """Natural shape (n,3) m of a piece, and the contact forces (C,3) N wanted with it."""

    rest: FloatArray
    wanted: FloatArray

    def comfortable(self, piece: Piece, shrink: Shrink) -> bool:
        """Whether the wanted forces, as they are, keep half the distance that ``shrink`` asks for."""
        contacts = piece.contacts
        normal, tangential = split(self.wanted, contacts.normals)
        widest = 0.5 * (1.0 + shrink.factor) * contacts.friction * normal
        inside = np.linalg.norm(tangential, axis=1) <= widest + ROUNDING_OF_CONES * piece.f0
        return bool(np.all(inside & (normal >= 0.5 * shrink.floor * piece.f0)))

    def scaled(self, piece: Piece) -> FloatArray:
        """Natural shape (n,3) with the displacement scaled to the new stiffness.

        A shell twice as stiff needs half of it.  The factor makes the unbalanced forces least, if they
        were linear in it; it is used when they do get smaller.
        """
        moved = self.rest - piece.target
        forces = piece.spread(self.wanted)

        def unbalanced(rest: FloatArray) -> FloatArray:
            gap = piece.assembly.gradient(piece.target, rest) - forces
            gap[piece.pinned] = 0.0
            return gap

        none, all_ = unbalanced(piece.target), unbalanced(self.rest)
        change = all_ - none
        size = float((change * change).sum())
        if not size > 0.0 or not np.isfinite(size):
            return self.rest
        factor = -float((none * change).sum()) / size
        other = piece.target + factor * moved
        smaller = float(np.abs(unbalanced(other)).max()) < 0.5 * float(np.abs(all_).max())
        return other if smaller else self.rest


@dataclass(frozen=True, eq=False)
class WarmStart:
    """An earlier result, checked against the problem that is to be solved.

    Contacts, pins, materials and even the target's positions may differ.  Raises ValueError when the
    mesh is another one, naming what differs.
    """

    result: Result
    problem: Problem

    def __post_init__(self) -> None:
        before, now = self.result.target, self.problem.target
        if len(before.vertices) != len(now.vertices):
            raise ValueError(
                f"start has {len(before.vertices)} vertices, the target {len(now.vertices)}: "
                "start must be a result of the same mesh; leave it out"
            )
        if len(before.faces) != len(now.faces):
            raise ValueError(
                f"start has {len(before.faces)} faces, the target {len(now.faces)}: "
                "start must be a result of the same mesh; leave it out"
            )
        other = np.flatnonzero((before.faces != now.faces).any(axis=1))
        if other.size:
            face = int(other[0])
            raise ValueError(
                f"start has vertices {before.faces[face].tolist()} in face {face}, the target "
                f"{now.faces[face].tolist()}: start must be a result of the same mesh; leave it out"
            )

    def of(self, piece: Piece) -> Guess | None:
        """The part of the result that belongs to ``piece``; None when it is not finite."""
        earlier, ids = self.result, piece.vertices
        moved = earlier.rest[ids] - earlier.pose[ids]
        if not np.isfinite(moved).all() or not np.isfinite(earlier.contact_forces).all():
            return None
        # A natural shape may lie anywhere; what holds it says where it belongs.
        if len(piece.held):
            moved = moved - moved[piece.pinned if len(piece.pinned) else piece.held].mean(axis=0)
        moved[piece.pinned] = 0.0
        rest = piece.target + moved
        return Guess(rest, self._wanted(piece, rest))

    def _wanted(self, piece: Piece, rest: FloatArray) -> FloatArray:
        """Earlier forces by vertex, scaled to the new weight and shared by the contacts there."""
        earlier, at = self.result, piece.contacts.vertices
        total = np.zeros_like(earlier.pose)
        np.add.at(total, earlier.contacts.vertices, earlier.contact_forces)
        share = np.bincount(at, minlength=len(piece.target))[at]
        # Forces sum up to minus the weight, also when pins take a part of it.
        before = float(np.linalg.norm(earlier.forces[piece.vertices].sum(axis=0)))
        weight = float(np.linalg.norm(piece.assembly.nodal_loads(rest).sum(axis=0)))
        ratio = weight / before if before > 0.0 else 1.0
        scale = ratio if np.isfinite(ratio) else 1.0
        return np.asarray(scale * total[piece.vertices[at]] / share[:, None])
