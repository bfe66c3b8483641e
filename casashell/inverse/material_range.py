"""The materials for which a target can be held (the open question of Ly 2018, Sec. 9.2).

Starting from the material of a problem, each elastic term alone, all of them together and the friction
are taken as far as they go; see `softest` for what counts.  Heavier is the same as softer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from casashell.inverse.forces import SHRINKS, project_reactions, rigid_obstruction
from casashell.inverse.piece import Piece, split
from casashell.inverse.softest import Held, Softest, SoftestSearch
from casashell.problem import Problem
from casashell.result import Step

Progress = Callable[[str, Step], None]

#: Name of the search in which all elastic terms become softer together.
TOGETHER = "together"
#: How many times stiffer is tried beside the material itself.
STIFFER = (10.0, 100.0)
#: Friction: shares closer than this ratio are the same answer, and below the second it is none.
_CLOSE, _SLIPPERY = 1.1, 0.02


@dataclass(frozen=True)
class FrictionRange:
    """Shares of the given friction coefficients.

    solved      smallest share at which the target was solved
    failed      largest share below it that was tried and did not work; None if none was
    impossible  share at which it is proved that no natural shape of any material holds; 0 if no proof
    """

    solved: float
    failed: float | None
    impossible: float


@dataclass
class MaterialRange:
    """What is known of the range; filled as the search goes on, and kept at an interrupt.

    together  all stiffnesses softer at once, or everything heavier
    alone     each elastic term softer by itself, by name
    stiffer   largest factor by which each term alone was made stiffer and solved; 1 if none worked
    friction  None without contacts, and when the material itself does not hold
    starts    natural shape and forces the searches began with, one a piece
    """

    together: Softest | None = None
    alone: dict[str, Softest] = field(default_factory=dict)
    stiffer: dict[str, float] = field(default_factory=dict)
    friction: FrictionRange | None = None
    pieces: tuple[Piece, ...] = ()
    starts: tuple[Held | None, ...] = ()
    complete: bool = False

    @property
    def holds(self) -> bool:
        """Whether the material as given was solved."""
        return self.together is not None and self.together.factor >= 1.0


def material_range(
    problem: Problem, progress: Progress | None = None, known: MaterialRange | None = None
) -> MaterialRange:
    """Take every parameter of the material of ``problem`` as far as the target can be held.

    progress  called with what is being searched and a `Step` at every iteration
    known     filled in place, so that a caller who is interrupted has what was found by then
    """
    found = MaterialRange() if known is None else known
    found.pieces = tuple(split(problem))
    names = sorted({t.name for p in found.pieces for t in p.assembly.energies if not t.load})

    def search(piece: Piece, name: str) -> SoftestSearch:
        def report(step: Step) -> None:
            if progress is not None:
                progress(name, step)

        mine = {t.name for t in piece.energies if not t.load}
        wanted = mine if name == TOGETHER or name not in mine else {name}
        return SoftestSearch(piece, report, frozenset(wanted))

    searches = [search(piece, TOGETHER) for piece in found.pieces]
    found.starts = tuple(each.start() for each in searches)
    found.together = _weakest(
        [each.run(start) if start else each.run() for each, start in zip(searches, found.starts)]
    )
    full = [held for held in found.starts if held is not None and held.load == 1.0]
    if len(full) == len(found.pieces):
        for name in names:
            ways = [search(piece, name) for piece in found.pieces]
            found.alone[name] = _weakest(
                [w.run(h, STIFFER[-1]) for w, h in zip(ways, full, strict=True)]
            )
            found.stiffer[name] = min(_stiffer(w, h) for w, h in zip(ways, full, strict=True))
        touched = [(p, h) for p, h in zip(found.pieces, full) if len(p.contacts.vertices)]
        if touched:
            each = [_friction(search(p, "friction"), h) for p, h in touched]
            found.friction = max(each, key=lambda one: one.solved)
    found.complete = True
    return found


def _weakest(found: list[Softest]) -> Softest:
    return min(found, key=lambda one: one.factor)


def _stiffer(search: SoftestSearch, held: Held) -> float:
    """Largest of `STIFFER` that is solved, each one after the last."""
    reached = 1.0
    for factor in STIFFER:
        if search.at(search.rigid(held.forces), 1.0 / factor)[0] is None:
            break
        reached = factor
    return reached


def _friction(search: SoftestSearch, held: Held) -> FrictionRange:
    """Smoother and smoother, by bisection on the share of the given friction."""
    piece = search.piece

    def smoother(share: float) -> Piece:
        contacts = replace(piece.contacts, friction=share * piece.contacts.friction)
        return piece.touching(contacts)

    def solved(share: float) -> bool:
        less = smoother(share)
        for shrink in (SHRINKS[0], SHRINKS[-1]):
            loads = piece.assembly.nodal_loads(held.point.rest)
            forces = project_reactions(less, held.forces, loads, shrink)
            if forces is None:
                continue
            there = SoftestSearch(less, search.path.report)
            nothing = np.zeros(there.path.border.shape[1])
            start = Held(replace(held.point, correction=nothing), forces)
            if there.at(start, 1.0)[0] is not None:
                return True
        return False

    impossible = 0.0
    if piece.contacts.friction.any():
        impossible = _edge(lambda share: rigid_obstruction(smoother(share)) is not None)
    if solved(0.0):
        return FrictionRange(0.0, None, 0.0)
    low, high = impossible, 1.0
    while high - low > max((_CLOSE - 1.0) * high, 0.5 * _SLIPPERY):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if solved(middle) else (middle, high)
    return FrictionRange(high, low or None, impossible)


def _edge(holds: Callable[[float], bool]) -> float:
    """Largest share (to a hundredth) up to which ``holds``; 0 if it never does."""
    if not holds(0.0):
        return 0.0
    low, high = 0.0, 1.0
    while high - low > 0.01:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
