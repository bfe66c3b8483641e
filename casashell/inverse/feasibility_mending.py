"""What would make an infeasible target feasible: friction, pins, contacts under the centre of mass."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from casashell.inverse.advice import needed_friction
from casashell.inverse.feasibility_masses import TRUE_CONES, area_spread, free_masses
from casashell.inverse.feasibility_proof import rigid_proof, with_pins
from casashell.inverse.piece import Piece
from casashell.inverse.stress import StressProgram
from casashell.typing import FloatArray, IntArray

_MOST_PINS = 4
#: Natural areas that differ from the target's by a factor of 1 + this much are the target's.
SAME_AREAS = 1e-6


@dataclass(frozen=True, eq=False)
class Mending:
    """Changes that would do, each tried out.

    friction      least coefficient on all contacts that balances the weight; None: none does
    pins          vertices to pin besides the pinned ones, ids of the piece
    pins_suffice  whether pinning them was found to be enough
    off_support   distance [m] of the centre of mass from the polygon of the contacts, seen along the
                  load; None with pins, without contacts, or when loads are not parallel
    sliding       contacts (ids of the piece's vertices) that the motion of a proof drags along
    lifting       contacts that it lifts off
    """

    friction: float | None
    pins: tuple[int, ...]
    pins_suffice: bool
    off_support: float | None
    sliding: IntArray
    lifting: IntArray


def mend_rigid(piece: Piece, motion: FloatArray | None) -> Mending:
    """For contacts and pins that cannot balance the loads as a whole.

    motion  (n,3) of a proof, or None when there is none
    """
    moved = _pushed(piece) if motion is None else motion
    sliding, lifting = _dragged(piece, moved)
    friction = needed_friction(piece) if len(piece.contacts) else None
    pins: list[int] = []
    trial = piece
    suffice = False
    while len(pins) < _MOST_PINS and not suffice:
        pins.append(int(np.argmax(np.linalg.norm(moved, axis=1))))
        trial = with_pins(piece, np.array(pins))
        suffice = balanced(trial)
        proof = None if suffice else rigid_proof(trial)
        moved = _pushed(trial) if proof is None else proof.motion
    off = off_support(piece) if friction is None else None
    return Mending(friction, tuple(pins), suffice, off, sliding, lifting)


def mend_elastic(program: StressProgram, motion: FloatArray, deadline: float) -> Mending:
    """For a shell that is a mechanism: pins where it moves most, tried until ``deadline``."""
    piece = program.piece
    sliding, lifting = _dragged(piece, motion)
    pins: list[int] = []
    suffice = False
    while len(pins) < _MOST_PINS and not suffice and time.perf_counter() < deadline:
        pins.append(int(np.argmax(np.linalg.norm(motion, axis=1))))
        trial = StressProgram(with_pins(piece, np.array(pins)))
        suffice = trial.solve(TRUE_CONES) is not None
        proof = None if suffice else free_masses(trial).proof
        if proof is None:
            break
        motion = proof.motion
    return Mending(None, tuple(pins), suffice, None, sliding, lifting)


def balanced(piece: Piece) -> bool:
    """Whether contacts and pins can carry the loads of the target as a whole."""
    if len(piece.contacts) == 0:
        modes = piece.rigid_modes
        left = np.linalg.norm(modes.T @ piece.loads.ravel())
        return bool(left <= 1e-9 * piece.f0 * len(piece.target))
    spread = area_spread(piece)
    return spread is not None and spread[0] <= 1.0 + SAME_AREAS


def _pushed(piece: Piece) -> FloatArray:
    """Rigid motion along which the loads do most work."""
    modes = piece.rigid_modes
    motion = (modes @ (modes.T @ piece.loads.ravel())).reshape(-1, 3)
    size = float(np.linalg.norm(motion, axis=1).max(initial=0.0))
    return np.asarray(motion / size if size > 0.0 else motion)


def _dragged(piece: Piece, motion: FloatArray) -> tuple[IntArray, IntArray]:
    """Vertices of contacts that slide along and that lift off."""
    contacts = piece.contacts
    at = motion[contacts.vertices]
    normal = (at * contacts.normals).sum(axis=1)
    slip = np.linalg.norm(at - normal[:, None] * contacts.normals, axis=1)
    moves = np.hypot(normal, slip) > 1e-3
    lifts = moves & (normal > np.maximum(10.0 * contacts.friction, 1.0) * slip)
    slides = moves & ~lifts
    return np.unique(contacts.vertices[slides]), np.unique(contacts.vertices[lifts])


def off_support(piece: Piece) -> float | None:
    """Distance [m] of the centre of mass from the hull of the contacts, seen along the load."""
    from scipy.optimize import nnls

    if len(piece.contacts) == 0 or len(piece.pinned):
        return None
    size = np.linalg.norm(piece.loads, axis=1)
    total = piece.loads.sum(axis=0)
    down = total / (np.linalg.norm(total) or 1.0)
    if not np.allclose(piece.loads, size[:, None] * down, atol=1e-9 * float(size.max())):
        return None
    centre = (size[:, None] * piece.target).sum(axis=0) / size.sum()
    arms = piece.target[np.unique(piece.contacts.vertices)] - centre
    flat = arms - (arms @ down)[:, None] * down
    reach = float(np.abs(flat).max()) or 1.0
    # The nearest point of the hull: convex weights, the sum to one enforced by a heavy row.
    rows = np.vstack([flat.T / reach, np.full(len(flat), 1e4)])
    weights, _ = nnls(rows, np.concatenate([np.zeros(3), [1e4]]))
    distance = float(np.linalg.norm(weights @ flat) / weights.sum())
    return distance if distance > 1e-6 * reach else 0.0
