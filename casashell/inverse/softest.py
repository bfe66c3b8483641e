"""How soft a material may be: the load path continued until nothing stable is left.

With natural shape r in balance at load t, all stiffnesses divided by t hold the target at load 1.  The
same path makes one term alone softer when every other term is scaled with the load.  Points count only
when they balance, push inside their cones and have a positive lowest eigenvalue: the range that is
reported has been computed point by point, and it belongs to the contact forces that were tried.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from casashell.engine.assembly import Assembly
from casashell.inverse.forces import SHRINKS, bilateral_reactions, project_reactions
from casashell.inverse.load_path import BUDGET, TIGHT, LoadPath, PathPoint, Report
from casashell.inverse.outcome import BALANCED, ROUNDING_OF_CONES, judged, pushing
from casashell.inverse.piece import Piece
from casashell.inverse.stability import NEUTRAL, free_dofs, lowest_eigenpairs
from casashell.inverse.stress import StressProgram
from casashell.typing import FloatArray

#: Loads tried first, until one works: 1 is the material as given.
STARTS = tuple(8.0**-k for k in range(5))
#: Steps of the load by a smaller ratio than this are not tried: the end lies within its square.
RESOLUTION = 1.04
CEILING = 1e3
_FIRST, _LONGEST, _REBALANCES = 1.3, 2.0, 2


@dataclass(frozen=True)
class Held:
    """The target in balance at ``load``: natural shape (n,3) m and contact forces (C,3) N at load 1."""

    point: PathPoint
    forces: FloatArray

    @property
    def load(self) -> float:
        """Share of the load carried."""
        return self.point.load


@dataclass(frozen=True)
class Softest:
    """How many times softer (below 1: stiffer) the material may be.

    factor  largest factor that was solved with every cone and a positive eigenvalue; 0 if none was
    failed  smallest factor above it that was tried and failed; None when it reached the ceiling
    reason  what ended it: "unstable", "no equilibrium" (a fold of the path, as far as Newton can tell),
            "slides", "no contact forces", "tested no further", or "stopped" by an interrupt
    held    the natural shape at ``factor``
    """

    factor: float
    failed: float | None
    reason: str
    held: Held | None = None


class SoftestSearch:
    """Climbs the load path of one piece; ``best`` is kept up to date for an interrupt.

    softened  names of the elastic terms that become softer; all of them by default
    budget    factorisations after which no new load is tried
    Raises ValueError for a name that no elastic term has.
    """

    def __init__(
        self,
        piece: Piece,
        report: Report,
        softened: frozenset[str] | None = None,
        *,
        budget: int = BUDGET,
    ) -> None:
        elastic = {term.name for term in piece.energies if not term.load}
        wrong = (softened or frozenset()) - elastic
        if wrong:
            raise ValueError(
                f"no elastic term is called {sorted(wrong)[0]}; there are {', '.join(sorted(elastic))}"
            )
        self.softened = elastic if softened is None else set(softened)
        self.piece = piece
        self.path = LoadPath(self._scaled_with_the_load(), report)
        self.budget = budget
        self.best = Softest(0.0, None, "stopped")

    @property
    def spent(self) -> bool:
        """Whether the factorisations have been used up."""
        return self.path.factorizations >= self.budget

    def _scaled_with_the_load(self) -> Piece:
        """The piece with every term that does not soften counted among the loads."""
        energies = tuple(
            term if term.load or term.name in self.softened else replace(term, load=True)
            for term in self.piece.energies
        )
        if all(a is b for a, b in zip(energies, self.piece.energies, strict=True)):
            return self.piece
        return replace(
            self.piece, energies=energies, assembly=Assembly(energies, len(self.piece.target))
        )

    def softer(self, factor: float) -> Piece:
        """The piece made ``factor`` times softer; parameters are taken to multiply their energy."""
        energies = tuple(
            replace(term, params=term.params / factor) if term.name in self.softened else term
            for term in self.piece.energies
        )
        return replace(
            self.piece, energies=energies, assembly=Assembly(energies, len(self.piece.target))
        )

    def run(
        self, start: Held | None = None, ceiling: float = CEILING, refreshes: int = 0
    ) -> Softest:
        """The search: from ``start`` or from scratch.

        ceiling    factor beyond which nobody asks
        refreshes  how often to go on from the end with contact forces made for the softest material
        """
        held = start if start is not None else self.start()
        if held is None:
            if self.best.reason != "no contact forces":
                self.best = Softest(0.0, STARTS[-1], "no equilibrium")
            return self.best
        self._climb(held, ceiling)
        for _ in range(refreshes):
            again = self._refreshed() if self.best.failed is not None else None
            before = self.best.factor
            if again is None:
                break
            self._climb(again, ceiling)
            if self.best.factor <= RESOLUTION * before:
                break
        return self.best

    def start(self) -> Held | None:
        """The first load of `STARTS` that works, with the forces of least strain energy."""
        for forces in self._choices():
            held = self.first(forces, STARTS)
            if held is not None:
                return held
        return None

    def first(self, forces: FloatArray, loads: Iterable[float]) -> Held | None:
        """The first of ``loads`` that works with contact forces (C,3) [N], from the rigid limit."""
        for load in loads:
            if self.spent:
                break
            held, _ = self.at(self.rigid(forces), load)
            if held is not None:
                return held
        return None

    def rigid(self, forces: FloatArray) -> Held:
        """The target itself: what an infinitely stiff material is made like."""
        nothing = np.zeros(self.path.border.shape[1])
        return Held(PathPoint(self.piece.target, nothing, 0.0, 0.0), forces)

    def _choices(self) -> list[FloatArray]:
        """Contact forces to start with, best first."""
        piece = self.piece
        if len(piece.contacts.vertices) == 0 or not piece.loads.any():
            return [np.zeros((len(piece.contacts.vertices), 3))]
        program = StressProgram(piece)
        for shrink in SHRINKS:
            stress = program.solve(shrink) if program.complete else None
            if stress is not None:
                return [stress.contact_forces]
            forces = project_reactions(piece, bilateral_reactions(piece), piece.loads, shrink)
            if forces is not None:
                return [forces]
        self.best = Softest(0.0, None, "no contact forces")
        return []

    def _refreshed(self) -> Held | None:
        """Forces of least strain energy of the softest material so far, stable along its weak modes."""
        held = self.best.held
        if held is None or len(self.piece.contacts.vertices) == 0:
            return None
        program = StressProgram(self.softer(held.load))
        if not program.complete:
            return None
        modes = self._lowest(held, 2)[1]
        delta = 1e-2 * self.piece.f0 / self.piece.h
        stress = program.solve(SHRINKS[0], [mode.reshape(-1, 3) for mode in modes.T], delta)
        if stress is None:
            return None
        return self.at(Held(held.point, stress.contact_forces), held.load)[0]

    def _climb(self, held: Held, ceiling: float) -> None:
        """Raise the load in growing steps, then close in on where it ends."""
        self._keep(Softest(held.load, None, "stopped", held))
        before: Held | None = None
        growth, failed, reason = _FIRST, None, ""
        while held.load < ceiling and growth > RESOLUTION and not self.spent:
            load = min(held.load * growth, ceiling)
            if failed is not None and load >= failed and reason != "no equilibrium":
                growth **= 0.5  # known to be bad; a path that Newton lost may come back
                continue
            found, why = self.at(held, load, before)
            if found is None:
                failed, reason, growth = load, why, growth**0.5
                continue
            before, held = held, found
            growth = min(growth**1.5, _LONGEST) if failed is None else growth
            beyond = failed if failed is not None and failed > held.load else None
            self._keep(Softest(held.load, beyond, "stopped", held))
        if held.load >= ceiling:
            failed, reason = None, "tested no further"
        elif self.spent and growth > RESOLUTION:
            reason = "stopped"
        self._keep(Softest(held.load, failed, reason, held))

    def _keep(self, found: Softest) -> None:
        if found.factor >= self.best.factor:
            self.best = found

    def at(self, held: Held, load: float, before: Held | None = None) -> tuple[Held | None, str]:
        """The equilibrium at ``load``, starting from one or two others; None and why not."""
        guess, correction = held.point.rest, held.point.correction
        if before is not None and before.load < held.load:
            along = (load - held.load) / (held.load - before.load)
            guess = guess + along * (guess - before.point.rest)
            correction = correction + along * (correction - before.point.correction)
        forces = held.forces
        for _ in range(1 + _REBALANCES):
            point = self.path.newton(
                guess, correction, self.piece.spread(forces), load, TIGHT * min(load, 1.0)
            )
            if point is None or point.residual > BALANCED * load:
                return None, "no equilibrium"
            outcome = judged(self.path.piece, point.rest, forces, "softest", load=load)
            if outcome.missing > BALANCED * load:
                return None, "no equilibrium"
            found = Held(point, forces)
            if outcome.cone_margin >= -ROUNDING_OF_CONES * load:
                low = float(self._lowest(found, 1)[0][0])
                stable = low * self.piece.h / (load * self.piece.f0) > NEUTRAL
                return (found, "") if stable else (None, "unstable")
            # The masses have moved with the natural shape: balance them inside the cones again.
            loads = self.piece.assembly.nodal_loads(point.rest)
            better = project_reactions(self.piece, forces, loads, SHRINKS[0])
            if better is None:
                break
            forces, guess, correction = better, point.rest, np.zeros_like(point.correction)
        return None, "slides"

    def _lowest(self, held: Held, count: int) -> tuple[FloatArray, FloatArray]:
        """Lowest eigenvalues [N/m] and modes (3n, count) at the load of ``held``."""
        piece = self.path.piece
        dofs = free_dofs(piece, pushing(piece, held.forces))
        _, entries = piece.assembly.hessian(piece.target, held.point.rest, held.load)
        full = piece.assembly.pattern.matrix(entries)
        values, vectors = lowest_eigenpairs(sp.csr_array(full[dofs][:, dofs]), count)
        modes = np.zeros((piece.target.size, len(values)))
        modes[dofs] = vectors
        return values, modes
