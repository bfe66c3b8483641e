"""Collision response of strips: proposed positions in, positions without interpenetration out.

One step (Pan, Huang, Bao 2016, Section 5.2): detect the impacts on the straight ways from the
start to the proposed positions, add them as rows, find the smallest correction that satisfies all
rows so far, detect again.  After `rounds` rounds, or when rows contradict each other, the vertices
that still collide move as rigid zones.  Every result is checked once more by other code: no two
faces may pass through each other.

The ways need not be those of material points.  What counts is that they lead from a state without
interpenetration to another one, so that linked loops stay linked.  Hence the start is simply what
the last step returned, whichever rulings it had, and no resampled state that might interpenetrate
is needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from casashell.contact.obstacles import Obstacle, checked
from casashell.contact.validation import number1
from casashell.ribbon.bodies import Bodies
from casashell.ribbon.impact_qp import ImpactProgram
from casashell.ribbon.impacts import Detector, Moving, Rows
from casashell.ribbon.rigid_zones import Unresolved, rigid_zones
from casashell.ribbon.strips import Strip
from casashell.self_intersections import self_intersections
from casashell.typing import ArrayLike, FloatArray, IntArray

Positions = ArrayLike | Sequence[ArrayLike]
# Share of the largest multiplier below which a row carries nothing.
_ACTIVE = 1e-6


@dataclass(frozen=True, eq=False)
class Resolved:
    """Positions after the collision response.

    positions     (V,3) m, all strips stacked as in the arguments
    rounds        quadratic programs solved; 0 when the proposed positions were free of impacts
    contacts      the rows that carry an impulse; their multipliers (C,) in kg m divided by the
                  time step are impulses, by its square forces
    fail_safe     rigid zones were needed
    min_distance  m, between parts of strips that no edge joins; infinite above the thickness
    min_gap       m, between free vertices and obstacles
    """

    positions: FloatArray
    rounds: int
    contacts: Rows
    multipliers: FloatArray
    fail_safe: bool
    min_distance: float
    min_gap: float


@dataclass(frozen=True, eq=False)
class Collider:
    """Collision response of a fixed set of strips.

    strips     in the order in which their vertices are stacked
    obstacles  that stay in place; others may be given for each step
    stiffness  k of the correction, in units of the mean vertex mass of a strip.  0: vertices give
               way one by one; 100 spreads a push over some ten stations
    rounds     most quadratic programs in a step before the fail-safe
    """

    strips: tuple[Strip, ...]
    obstacles: tuple[Obstacle, ...] = ()
    stiffness: float = 100.0
    rounds: int = 20

    def __post_init__(self) -> None:
        strips = tuple(self.strips)
        if not strips:
            raise ValueError("Collider.strips is empty; give at least one Strip")
        if number1(self.stiffness, "Collider.stiffness") < 0.0:
            raise ValueError(f"Collider.stiffness must be zero or more, got {self.stiffness!r}")
        if self.rounds < 1:
            raise ValueError(f"Collider.rounds must be one or more, got {self.rounds!r}")
        object.__setattr__(self, "strips", strips)
        object.__setattr__(self, "obstacles", checked(self.obstacles))

    @cached_property
    def bodies(self) -> Bodies:
        """The strips as one mesh."""
        return Bodies(self.strips)

    def resolve(
        self,
        start: Positions,
        end: Positions,
        moving: Sequence[Moving] = (),
    ) -> Resolved:
        """Positions near ``end`` that are reached from ``start`` without interpenetration.

        start, end  m, (V,3) of all strips stacked, or a list of one array per strip.  Pinned
                    vertices arrive exactly at their ``end``
        moving      obstacles that move in this step, besides those that stay

        Raises ValueError on wrong shapes and on a start that interpenetrates, Unresolved when
        pinned vertices or obstacles leave no way out.
        """
        before = self.bodies.stack(start, "start")
        proposed = self.bodies.stack(end, "end")
        self._check_start(before)
        every = (*(Moving(obstacle) for obstacle in self.obstacles), *moving)
        detector = Detector(self.bodies, before, proposed, every)
        result = self._by_programs(detector)
        if result is None or len(self.crossings(result.positions)):
            x = rigid_zones(detector, proposed if result is None else result.positions)
            result = self._described(detector, x, self.rounds, Rows.joined([]), np.zeros(0), True)
            crossing = self.crossings(x)
            if len(crossing):
                raise Unresolved(f"after the fail-safe {self._words(crossing[0])} still cross")
        return result

    def crossings(self, positions: Positions) -> IntArray:
        """Pairs (N,2) of stacked face ids that pass through each other; empty when all is well."""
        return self_intersections(self.bodies.stack(positions, "positions"), self.bodies.faces)

    def _by_programs(self, detector: Detector) -> Resolved | None:
        """Rounds of detection and quadratic program; None when they do not succeed."""
        program = ImpactProgram(self.bodies, self.stiffness)
        x, rows, multipliers = detector.proposed, Rows.joined([]), np.zeros(0)
        for number in range(self.rounds + 1):
            new = detector.rows(x)
            if len(new) == 0:
                return self._described(detector, x, number, rows, multipliers, False)
            rows = Rows.joined([rows, new]).without_repeats()  # the old ones stay in front
            carrying = multipliers > _ACTIVE * multipliers.max(initial=0.0)
            known = np.pad(carrying, (0, len(rows) - len(carrying)))
            correction = program.solve(rows, detector.proposed, known)
            if correction is None:
                return None
            x, multipliers = correction.positions, correction.multipliers
        return None

    def _described(
        self,
        detector: Detector,
        x: FloatArray,
        rounds: int,
        rows: Rows,
        multipliers: FloatArray,
        fail_safe: bool,
    ) -> Resolved:
        active = multipliers > _ACTIVE * multipliers.max(initial=0.0)
        return Resolved(
            positions=x,
            rounds=rounds,
            contacts=rows.subset(active),
            multipliers=multipliers[active],
            fail_safe=fail_safe,
            min_distance=detector.smallest_separation(x),
            min_gap=detector.smallest_gap(x),
        )

    def _check_start(self, start: FloatArray) -> None:
        crossing = self.crossings(start)
        if len(crossing):
            raise ValueError(
                f"start interpenetrates: {self._words(crossing[0])} cross; move the strips apart "
                "before the first step, and start each step from the positions of the last one"
            )

    def _words(self, faces: IntArray) -> str:
        """Names of two stacked faces."""
        strips = self.bodies.owner[self.bodies.faces[faces, 0]]
        sizes = np.cumsum([0, *(len(strip.faces) for strip in self.strips)])
        one, two = (f"face {f - sizes[s]} of strip {s}" for f, s in zip(faces, strips))
        return f"{one} and {two}"
