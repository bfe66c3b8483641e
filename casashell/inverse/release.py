"""The release test of Ly 2018, Sec. 8.3: change gravity a little, let go, see how far the shell moves.

A stable equilibrium answers in proportion and comes back when gravity does; an unstable one leaves for
another pose.  This looks at the energy where the lowest eigenvalue of a certificate looks at its second
derivative, and also tells how far the shell would go.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from casashell.contact.cone import margin
from casashell.contact.cone import split as split_force
from casashell.contact.obstacles import Obstacle
from casashell.inverse.drape import Draped, Draper
from casashell.inverse.outcome import judged, pushing
from casashell.inverse.piece import Piece, split
from casashell.inverse.pulled import Pulled
from casashell.problem import Problem
from casashell.typing import BoolArray, FloatArray, IntArray

#: Iterations of one drape: a pose that is left is far from the one that is found.
BUDGET: Final = 2000
#: Distance to the pose, in mean edge lengths, at which a shell counts as having come back to it.
BACK: Final = 1e-3
#: Cone violation / f0 from which a contact counts as slipping.
SLIPS: Final = 1e-9


@dataclass(frozen=True, eq=False)
class Released:
    """Where a shell went when gravity changed, and where it went when gravity was as before.

    pose      (V,3) m, under the changed load;  returned  (V,3) m, under the load as it was
    moved     m, largest distance of a vertex of ``pose`` from where it was released
    back      m, the same of ``returned``
    h         m, mean edge length of the target
    let_go    contacts that did not push or stopped pushing: their vertices are free
    slipping  contacts whose force under the changed load is beyond their friction: they are
              held all the same, so that a shell that leaves would do so even more
    depth     m, how deep a vertex of ``pose`` has gone into an obstacle, which a free one does not feel;
              0 for none
    settled   both poses are minima of the energy
    """

    pose: FloatArray
    returned: FloatArray
    moved: float
    back: float
    h: float
    let_go: IntArray
    slipping: IntArray
    depth: float
    settled: bool

    @property
    def stays(self) -> bool:
        """The shell came back when the load did: it was released at a stable equilibrium."""
        return self.settled and self.back <= BACK * self.h


class _Loaded(Pulled):
    """The energy of a piece with all its loads times a factor; no pull."""

    def __init__(self, piece: Piece, load: float) -> None:
        super().__init__(piece, 0.0)
        self.load = load

    def energy(self, x: FloatArray, r: FloatArray) -> float:
        return self.piece.assembly.energy(x, r, self.load)

    def gradient(self, x: FloatArray, r: FloatArray) -> FloatArray:
        return self.piece.assembly.gradient(x, r, self.load)

    def hessian(self, x: FloatArray, r: FloatArray) -> tuple[FloatArray, FloatArray]:
        return self.piece.assembly.hessian(x, r, self.load)

    def mixed(self, x: FloatArray, r: FloatArray) -> tuple[FloatArray, FloatArray]:
        return self.piece.assembly.mixed(x, r, self.load)


def release(
    problem: Problem,
    rest: FloatArray,
    pose: FloatArray,
    contact_forces: FloatArray,
    gravity_factor: float = 1.01,
) -> Released:
    """Drape natural shape ``rest`` (V,3) from ``pose`` (V,3) under ``gravity_factor`` times the loads.

    contact_forces  (C,3) N at ``pose``: contacts that push hold their vertex.  Those that pull in the
                    pose found are let go, and the drape goes on without them
    Pins and contacts that push stay; other vertices do not feel obstacles.
    Raises ValueError for arrays of the wrong shape or not finite, and a factor that is not positive.
    """
    count, contacts = len(problem.target.vertices), len(problem.contacts)
    for name, array, rows in (
        ("rest", rest, count),
        ("pose", pose, count),
        ("contact_forces", contact_forces, contacts),
    ):
        if np.shape(array) != (rows, 3) or not np.all(np.isfinite(array)):
            raise ValueError(
                f"{name} must be ({rows}, 3) finite numbers, got shape {np.shape(array)}; "
                "give it in the order of the problem"
            )
    if not (math.isfinite(gravity_factor) and gravity_factor > 0.0):
        raise ValueError(f"gravity_factor must be a positive number, got {gravity_factor}")
    there, again = pose.copy(), pose.copy()
    free, slips = np.zeros(contacts, dtype=bool), np.zeros(contacts, dtype=bool)
    settled = True
    for piece in split(problem):
        ids, of = piece.vertices, np.isin(problem.contacts.vertices, piece.vertices)
        run = _Run(piece, rest[ids] - piece.origin, contact_forces[of])
        out, back = run.drapes(pose[ids] - piece.origin, gravity_factor)
        there[ids], again[ids] = out.pose + piece.origin, back.pose + piece.origin
        free[of], slips[of] = ~run.active, run.slipping(out.pose, gravity_factor)
        settled &= out.good and back.good
    return Released(
        pose=there,
        returned=again,
        moved=_farthest(there - pose),
        back=_farthest(again - pose),
        h=float(problem.target.mean_edge_length),
        let_go=np.flatnonzero(free),
        slipping=np.flatnonzero(slips),
        depth=_depth(problem.obstacles, there),
        settled=settled,
    )


class _Run:
    """One piece and which of its contacts still push."""

    def __init__(self, piece: Piece, rest: FloatArray, contact_forces: FloatArray) -> None:
        self.piece, self.rest, self.forces = piece, rest, contact_forces
        self.active: BoolArray = pushing(piece, contact_forces)

    def drapes(self, pose: FloatArray, load: float) -> tuple[Draped, Draped]:
        """The poses found under ``load`` times the loads, and then under the loads as they are."""
        while True:
            held = np.union1d(self.piece.contacts.vertices[self.active], self.piece.pinned)
            draper = Draper(_Loaded(self.piece, load), held)
            out = draper.drape(self.rest, pose, budget=BUDGET)
            pulls = self.active & (self._normal(out.pose, load) <= 0.0)
            if not (out.good and pulls.any()):
                break
            self.active &= ~pulls
        draper.pulled = _Loaded(self.piece, 1.0)
        return out, draper.drape(self.rest, out.pose, budget=BUDGET)

    def slipping(self, pose: FloatArray, load: float) -> BoolArray:
        """Contacts (C,) that hold a force beyond their friction."""
        contacts = self.piece.contacts
        room = margin(self._felt(pose, load), contacts.normals, contacts.friction)
        return np.asarray(self.active & (room < -SLIPS * self.piece.f0))

    def _normal(self, pose: FloatArray, load: float) -> FloatArray:
        return split_force(self._felt(pose, load), self.piece.contacts.normals)[0]

    def _felt(self, pose: FloatArray, load: float) -> FloatArray:
        """Forces (C,3) [N] of the contacts at ``pose``."""
        found = judged(self.piece, self.rest, self.forces, "release", pose=pose, load=load)
        return found.contact_forces


def _farthest(moves: FloatArray) -> float:
    return float(np.linalg.norm(moves, axis=1).max(initial=0.0))


def _depth(obstacles: Sequence[Obstacle], points: FloatArray) -> float:
    """How deep [m] the deepest of the points lies inside an obstacle."""
    depths = (float((-one.signed_distance(points)[0]).max(initial=0.0)) for one in obstacles)
    return max(depths, default=0.0)
