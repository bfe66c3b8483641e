"""Static equilibria of one ribbon: least energy under its holds, with a certificate."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias, get_args

import numpy as np

from casashell.engine.threads import one_thread
from casashell.ribbon import forces, holds, loops
from casashell.ribbon.augmented import Schedule, augmented
from casashell.ribbon.chain import Strip, reconstruct
from casashell.ribbon.conditions import Condition
from casashell.ribbon.coordinates import Coordinates
from casashell.ribbon.exact import exact
from casashell.ribbon.mixed import mixed
from casashell.ribbon.physics import RibbonPhysics
from casashell.ribbon.potential import Potential
from casashell.ribbon.program import Outcome, Stop
from casashell.ribbon.ribbon import Ribbon, RibbonState, flat, uncrossed
from casashell.ribbon.stability import Stability, stability
from casashell.ribbon.taut import held_points
from casashell.ribbon.terms import Term, Terms
from casashell.typing import ArrayLike, FloatArray

Method: TypeAlias = Literal["exact", "mixed", "augmented"]
Junction: TypeAlias = Literal["flat", "crease"]

#: Runs after which the quads that hold loaded and attached points must no longer change.
MOST_RUNS = 8
#: Saddles to leave behind, and how far a start beside one is from it [rad, slope].
MOST_SADDLES, ASIDE = 8, 0.05


@dataclass(frozen=True, eq=False)
class Setting:
    """What acts on a ribbon at rest.

    gravity      (3,) [m/s2]
    loads        dead forces at material points
    attachments  material points that are held
    end          frame in which the end is held
    terms        any other energy on the station table
    junction     of a closed ribbon: "flat", or a "crease" that bends; default flat for a Moebius band,
                 whose curvature vanishes somewhere anyway, and a crease for a loop
    """

    gravity: ArrayLike = (0.0, 0.0, 0.0)
    loads: Sequence[forces.PointLoad] = ()
    attachments: Sequence[holds.Attachment] = ()
    end: holds.HeldEnd | None = None
    terms: Sequence[Term] = ()
    junction: Junction | None = None

    def joint(self, ribbon: Ribbon) -> Junction:
        """The junction of a closed ribbon."""
        return self.junction or ("flat" if ribbon.ends == "moebius" else "crease")

    def potential(
        self,
        ribbon: Ribbon,
        physics: RibbonPhysics,
        base: RibbonState,
        *,
        increments: bool = True,
        slopes: FloatArray | None = None,
    ) -> Potential:
        """Energy and conditions; ``slopes`` (N+1,) tell which quads hold material points now.

        Raises ValueError for holds that contradict each other.
        """
        holds.require_consistent(ribbon, base, self.attachments, self.end)
        terms = [*forces.elastic(ribbon, physics), *self.terms]
        terms += [forces.load(ribbon, physics, point, slopes) for point in self.loads]
        if np.any(forces.vector("gravity", self.gravity)):
            terms.append(forces.gravity(ribbon, physics, self.gravity))
        kept = held_points(ribbon, self.attachments, slopes)
        conditions = [
            holds.attached(ribbon, physics, a, quad)
            for a, quad in zip(self.attachments, kept.quads)
        ]
        far: tuple[Term, ...] = ()
        if ribbon.closed:
            joint = self.joint(ribbon)
            conditions.append(holds.closing(ribbon, physics, flat=joint == "flat"))
            far = (forces.junction(ribbon, physics),) if joint == "crease" else ()
        elif self.end is not None:
            conditions.append(holds.held(ribbon, physics, self.end))
        conditions += [holds.still(physics, *ruling) for ruling in kept.rulings]
        space = Coordinates(ribbon, base, floating=ribbon.ends == "free", increments=increments)
        return Potential(
            space,
            Terms(ribbon.segments + 1, tuple(terms)),
            ribbon.energy_unit,
            far,
            tuple(conditions),
            kept.limits,
        )


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """A state at rest and what is known about it.

    energy      [J] of everything, loads included
    residual    largest entry of the projected gradient, over D W / l
    violation   largest unmet condition, of positions as part of the length
    stability   second-order check on what the conditions leave free
    saddles     unstable equilibria that the search left behind
    reactions   one array a condition: (3,) [N] force on the ribbon at an attachment; (6,) force [N] and
                moments at a held or joined end
    """

    ribbon: Ribbon
    state: RibbonState
    energy: float
    residual: float
    violation: float
    stability: Stability
    reactions: tuple[FloatArray, ...]
    outcome: Outcome = field(repr=False)
    saddles: int = 0
    seconds: float = 0.0

    @property
    def certified(self) -> bool:
        """A stable equilibrium: forces and conditions within tolerance, no direction downhill."""
        return self.converged and self.stability.stable

    @property
    def converged(self) -> bool:
        """Forces balance and conditions hold; says nothing of stability."""
        return self.residual <= 1e-5 and self.violation <= 1e-7

    def strip(self) -> Strip:
        """The strip in space."""
        return reconstruct(self.ribbon, self.state)

    def require(self) -> Equilibrium:
        """Itself, or RuntimeError that says what is missing."""
        if self.certified:
            return self
        if self.converged:
            raise RuntimeError(f"the equilibrium is not stable: {self.stability}")
        raise RuntimeError(
            f"no equilibrium: {self.outcome.stop.value}; residual {self.residual:.1e}, "
            f"violation {self.violation:.1e}; try another start or the other method"
        )


def equilibrium(
    ribbon: Ribbon,
    physics: RibbonPhysics,
    setting: Setting | None = None,
    *,
    start: RibbonState | None = None,
    method: Method = "exact",
    tolerance: float = 1e-9,
) -> Equilibrium:
    """Local minimum of the energy from ``start`` (flat by default).

    method     "exact": Ipopt with exact second derivatives; "augmented": the paper's augmented
               Lagrangian around L-BFGS-B; "mixed": Ipopt without the chain, see `mixed`: O(N) an
               iteration, two to three times faster than "exact" at 300 segments and even at 150,
               but only from a start near the end: far from it, under strong loads, it gets lost
    tolerance  of the gradient over D W / l; the augmented Lagrangian often ends in rounding before
    Where a strip is flat its rulings cost nothing but the regulariser, and so does their turning: flat
    and loaded in its own plane it is at rest, for any load.  Start from a bent state to see it twist.
    Raises ValueError for a start that is none of the ribbon's, and for contradictory holds.
    """
    if method not in get_args(Method):
        raise ValueError(f"method must be one of {', '.join(get_args(Method))}; got {method!r}")
    begin = time.perf_counter()
    setting = setting or Setting()
    state = flat(ribbon) if start is None else start.checked(ribbon)
    if ribbon.closed and start is None:
        raise ValueError("a closed ribbon needs a start: see casashell.ribbon.loops and bands")
    with one_thread():
        found, saddles = _rest(ribbon, physics, setting, state, method, tolerance), 0
        while not found.stability.stable and found.converged and saddles < MOST_SADDLES:
            saddles += 1
            found = _rest(ribbon, physics, setting, _aside(found), method, tolerance)
    return replace(found, saddles=saddles, seconds=time.perf_counter() - begin)


def _rest(
    ribbon: Ribbon,
    physics: RibbonPhysics,
    setting: Setting,
    state: RibbonState,
    method: Method,
    tolerance: float,
) -> Equilibrium:
    """Where one descent ends."""
    for _ in range(MOST_RUNS):
        slopes = state.all_slopes
        potential = setting.potential(ribbon, physics, state, slopes=slopes)
        outcome = _minimum(potential, physics, state, method, tolerance)
        state = potential.coordinates.state(outcome.z)
        broken = outcome.stop in (Stop.NONFINITE, Stop.FAILED)
        if broken or _same_quads(ribbon, setting, slopes, state):
            break
    direct = setting.potential(ribbon, physics, state, increments=False, slopes=state.all_slopes)
    return Equilibrium(
        ribbon=ribbon,
        state=state,
        energy=potential.energy(outcome.z),
        residual=outcome.projected_gradient,
        violation=max(outcome.violation, _gap(ribbon, setting, state)),
        stability=stability(direct, state, outcome.multipliers.equality),
        reactions=_reactions(potential, outcome.multipliers.equality),
        outcome=outcome,
    )


def _gap(ribbon: Ribbon, setting: Setting, state: RibbonState) -> float:
    """How far a closed ribbon is from closed; 0 for an open one."""
    if not ribbon.closed:
        return 0.0
    return loops.gap(ribbon, reconstruct(ribbon, state), flat=setting.joint(ribbon) == "flat")


def _aside(found: Equilibrium) -> RibbonState:
    """A start beside a saddle, along its steepest way down."""
    space = Coordinates(found.ribbon, found.state, found.ribbon.ends == "free", increments=False)
    away = found.stability.direction
    z = space.pack(found.state) + ASIDE / np.abs(away).max() * away
    state = space.state(np.clip(z, space.lower, space.upper))
    return replace(state, slopes=uncrossed(found.ribbon, state.slopes))


def _minimum(
    potential: Potential,
    physics: RibbonPhysics,
    state: RibbonState,
    method: Method,
    tolerance: float,
) -> Outcome:
    if method == "mixed":
        return mixed(potential, physics, state, gradient=tolerance)
    program = potential.program(potential.coordinates.pack(state))
    if method == "exact":
        return exact(program, feasibility=1e-10, gradient=tolerance)
    return augmented(program, Schedule(gradient=max(tolerance, 1e-7), feasibility=1e-9))


def _same_quads(ribbon: Ribbon, setting: Setting, slopes: FloatArray, state: RibbonState) -> bool:
    """True when loaded and attached points lie in the quads they were taken to lie in."""
    now, points = state.all_slopes, setting.attachments
    held = held_points(ribbon, points, slopes).quads == held_points(ribbon, points, now).quads
    return held and all(
        forces.material(ribbon, p.s, p.y, slopes)[0] == forces.material(ribbon, p.s, p.y, now)[0]
        for p in setting.loads
    )


def _reactions(potential: Potential, multipliers: FloatArray) -> tuple[FloatArray, ...]:
    """Forces of the conditions, from the multipliers of the scaled program."""
    conditions: Sequence[Condition] = potential.conditions
    cuts = np.cumsum([c.count for c in conditions])[:-1]
    parts = np.split(-potential.unit * multipliers, cuts) if conditions else []
    scaled = []
    for condition, part in zip(conditions, parts, strict=True):
        force = part.copy()
        if condition.count > 3:
            force[:3] /= potential.coordinates.ribbon.length
        scaled.append(force)
    return tuple(scaled)
