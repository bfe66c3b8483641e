"""One implicit Euler step of one ribbon in its variational form (Pan 2016, Sec. 4).

    minimise  r^T M(c) r / (2 h^2) + potential,    r = x - 2 R(c; c^n, x^n) + R(c; c^{n-1}, x^{n-1})

The stored x^n are positions of the vertices after collision response, so they need not be reachable
by slopes and angles.  A floating ribbon turns about a base frame predicted for the end of the step;
the frame found becomes the next base, so that the rotation vector stays small.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias, get_args

import numpy as np

from casashell.ribbon import forces
from casashell.ribbon.augmented import Schedule, augmented
from casashell.ribbon.balanced import Balanced
from casashell.ribbon.chain import BOTTOM, TOP, Strip
from casashell.ribbon.coordinates import Coordinates
from casashell.ribbon.exact import exact
from casashell.ribbon.forces import quads
from casashell.ribbon.physics import RibbonPhysics
from casashell.ribbon.potential import Potential
from casashell.ribbon.program import Multipliers, Outcome, Program, Stop
from casashell.ribbon.resample import History, Resample, Rims, abscissae, piece_of
from casashell.ribbon.ribbon import Ribbon, RibbonState
from casashell.ribbon.saddles import left
from casashell.ribbon.statics import Setting
from casashell.ribbon.terms import Term
from casashell.ribbon.touch import Touch
from casashell.typing import BoolArray, FloatArray

#: Projected gradient, in units of D W / l, below which Ipopt's smallest steps are an end.
_NEARLY = 1e-3
#: Largest penalty of the augmented Lagrangian that a step hands on to the next.
MOST_KEPT = 1e4

Solver: TypeAlias = Literal["augmented", "ipopt"]
Mass: TypeAlias = Literal["consistent", "lumped"]
Form: TypeAlias = Literal["positions", "velocities"]


@dataclass(frozen=True)
class Rule:
    """How a step is made.

    solver    "ipopt" (exact Hessian) or "augmented" (the paper: L-BFGS-B inside an augmented
              Lagrangian)
    resample  "linear" (the paper) or "hermite"; None: linear for "augmented", hermite otherwise
    mass      "consistent" or "lumped" on the centreline
    form      "positions" (the paper): both former shapes are resampled; "velocities": vertices carry
              velocities, so that short steps do not divide errors of resampling by h^2.  None:
              positions for "augmented", velocities otherwise
    tolerance of the projected gradient, in units of D W / l; None: 1e-5 for "augmented", which
              seldom gets further, 1e-8 for "ipopt", which also counts complementarity
    feasibility of conditions, in their own units
    proximal  m of  m D W / (2 l) (c - c^n)^2, as if every crease were bent by sqrt(m) more: rulings of
              a flat strip are free to run, and an optimiser runs after them.  Vanishes with the step.
              None: 0 for "augmented", which has none in the paper, 5e-4 (1.3 degrees) otherwise
    iterations most of one minimisation; None: 3000 for "augmented", 500 for "ipopt"
    Raises ValueError for names that are not known.
    """

    solver: Solver = "ipopt"
    resample: Resample | None = None
    mass: Mass = "consistent"
    form: Form | None = None
    tolerance: float | None = None
    feasibility: float = 1e-8
    iterations: int | None = None
    proximal: float | None = None

    def __post_init__(self) -> None:
        for name, names in (("solver", Solver), ("mass", Mass), ("form", Form)):
            given = getattr(self, name)
            if given not in get_args(names) and not (name == "form" and given is None):
                wanted = ", ".join(repr(n) for n in get_args(names))
                raise ValueError(f"{name} must be one of {wanted}; got {given!r}")
        if self.resample not in (None, "linear", "hermite"):
            raise ValueError(f"resample must be 'linear' or 'hermite', got {self.resample!r}")
        if not self.hold >= 0:
            raise ValueError(f"proximal must be >= 0, got {self.proximal}")
        if not (self.gradient > 0 and self.feasibility > 0 and self.most > 0):
            raise ValueError("tolerance, feasibility and iterations must be positive")

    @property
    def kinetics(self) -> Form:
        """The form asked for, or the one that suits the solver."""
        return self.form or ("positions" if self.solver == "augmented" else "velocities")

    @property
    def gradient(self) -> float:
        """The tolerance asked for, or the one that suits the solver."""
        usual = {"augmented": 1e-5, "ipopt": 1e-8}
        return usual[self.solver] if self.tolerance is None else self.tolerance

    @property
    def hold(self) -> float:
        """The weight of the proximal term asked for, or the one that suits the solver."""
        usual = {"augmented": 0.0, "ipopt": 5e-4}
        return usual[self.solver] if self.proximal is None else self.proximal

    @property
    def most(self) -> int:
        """The limit asked for, or the one that suits the solver."""
        usual = {"augmented": 3000, "ipopt": 500}
        return usual[self.solver] if self.iterations is None else self.iterations

    @property
    def interpolant(self) -> Resample:
        """The one asked for, or the one that suits the solver."""
        return self.resample or ("linear" if self.solver == "augmented" else "hermite")


@dataclass(frozen=True, eq=False)
class Past:
    """What a step of one ribbon starts from.

    state     of the last optimisation; ``earlier`` of the one before it
    points    (2,N+1,3) [m] bottom and top vertices after collision response
    former    (2,N+1,3) [m] where the same vertices were ``lapse`` [s] before, on the rulings
              ``former_slopes`` (N+1,)
    pushed    (2,N+1) vertices which the collision response moved by more than the thickness
    """

    state: RibbonState
    points: FloatArray
    former: FloatArray
    former_slopes: FloatArray
    lapse: float
    earlier: RibbonState | None = None
    pushed: BoolArray | None = None
    multipliers: Multipliers | None = None

    def velocities(self, ribbon: Ribbon, physics: RibbonPhysics, resample: Resample) -> FloatArray:
        """(2,N+1,3) [m/s] of the vertices of ``state``."""
        before = rims(ribbon, self.former_slopes, self.former, physics, resample)
        s = abscissae(ribbon.length, ribbon.width, self.state.all_slopes)
        return (self.points - before.at(s)) / self.lapse


@dataclass(frozen=True, eq=False)
class Task:
    """A step to be made: ``h`` [s] from ``past``.

    setting  what acts at the end of the step, and ``terms`` beside it
    begin    frame and origin of a clamped ribbon's first quad at the end of the step
    touch    contacts it keeps
    near     a state near its end, to start from
    """

    ribbon: Ribbon
    past: Past
    h: float
    setting: Setting
    terms: tuple[Term, ...] = ()
    begin: tuple[FloatArray, FloatArray] | None = None
    touch: Touch | None = None
    near: RibbonState | None = None


@dataclass(frozen=True, eq=False)
class Proposed:
    """End of a step before collision response."""

    state: RibbonState
    points: FloatArray
    outcome: Outcome

    def usable(self, rule: Rule) -> bool:
        """True when the step may be kept.

        With kinks in the resampling the paper's method seldom meets a gradient; it ends where no
        decrease is left.  For Ipopt that is an end only near a minimum.
        """
        outcome = self.outcome
        if outcome.stop is Stop.DECREASE:
            return rule.solver == "augmented" or outcome.projected_gradient < _NEARLY
        return outcome.stop is Stop.CONVERGED


def rims(
    ribbon: Ribbon, slopes: FloatArray, points: FloatArray, physics: RibbonPhysics, how: Resample
) -> Rims:
    """Interpolants of vertices (2,N+1,3) on the rulings with ``slopes`` (N+1,)."""
    knots = abscissae(ribbon.length, ribbon.width, slopes)
    return Rims(knots, points, piece_of(physics, how))


def rim_points(shape: Strip) -> FloatArray:
    """(2,N+1,3) bottom and top vertices."""
    return np.stack([shape.bottom, shape.top])


def inertia(task: Task, physics: RibbonPhysics, rule: Rule) -> Term:
    """The kinetic term of the step."""
    ribbon, past, h = task.ribbon, task.past, task.h
    slopes = past.state.all_slopes
    same = np.isclose(past.lapse, h, rtol=1e-12, atol=0.0)
    if rule.mass == "lumped":
        middle, former = past.points.mean(axis=0), past.former.mean(axis=0)
        free = middle + (middle - former) * (1.0 if same else h / past.lapse)
        return lumped(ribbon, physics, h, free)
    how = rule.interpolant
    if rule.kinetics == "positions" and same:
        now = rims(ribbon, slopes, past.points, physics, how)
        before = rims(ribbon, past.former_slopes, past.former, physics, how)
    else:
        free = past.points + h * past.velocities(ribbon, physics, how)
        now = before = rims(ribbon, slopes, free, physics, how)
    return consistent(ribbon, physics, h, now, before)


def consistent(ribbon: Ribbon, physics: RibbonPhysics, h: float, now: Rims, before: Rims) -> Term:
    """M(c) of bilinear shape functions, with 2 ``now`` - ``before`` as the motion without forces."""
    head = np.array([ribbon.density, ribbon.segment, ribbon.width, h, 0.0])
    history = History(ribbon.length, now, before, head)
    return Term(physics.consistent, quads(ribbon.segments), history)


def lumped(ribbon: Ribbon, physics: RibbonPhysics, h: float, free: FloatArray) -> Term:
    """All mass on the centreline; ``free`` (N+1,3) is its motion without forces."""
    n = ribbon.segments
    mass = np.full(n + 1, ribbon.density * ribbon.width * ribbon.segment)
    mass[[0, -1]] *= 0.5
    stencils = 4 * np.arange(n + 1)[:, None] + np.array([BOTTOM, TOP])
    return Term(physics.lumped, stencils, np.column_stack([mass, np.full(n + 1, h), free]))


def advance(task: Task, physics: RibbonPhysics, rule: Rule) -> Proposed:
    """One step of one ribbon, without collision response."""
    starts = _starts(task)
    space = Coordinates(task.ribbon, starts[0], floating=task.ribbon.ends != "clamped")
    slopes = task.past.state.all_slopes
    potential = task.setting.potential(task.ribbon, physics, starts[0], slopes=slopes)
    moving = potential.terms.with_terms([inertia(task, physics, rule), *task.terms])
    if rule.hold > 0:
        moving = moving.with_terms([forces.hesitant(task.ribbon, physics, rule.hold, slopes)])
    potential = replace(potential, coordinates=space, terms=moving, touch=task.touch)
    if task.near is not None:
        starts = [task.near]
    z = _best_start(potential, [space.pack(s) for s in starts])
    boxed = np.arange(space.size) < space.creases
    outcome = solve(potential.program(z), rule, boxed, task.past.multipliers)
    if rule.solver == "ipopt":
        outcome = left(potential, outcome, lambda at: solve(potential.program(at), rule, boxed))
    shape = space.strip(outcome.z)
    return Proposed(space.state(outcome.z), rim_points(shape), outcome)


def solve(
    program: Program, rule: Rule, boxed: BoolArray, warm: Multipliers | None = None
) -> Outcome:
    """Minimum by the rule's method; ``boxed`` (n,) are the unknowns whose bounds matter."""
    if rule.solver == "ipopt":
        return exact(
            program,
            feasibility=rule.feasibility,
            gradient=rule.gradient,
            iterations=rule.most,
        )
    schedule = Schedule(feasibility=rule.feasibility, gradient=rule.gradient, inner=rule.most)
    known = None
    if warm is not None:
        counts = len(warm.equality), len(warm.inequality)
        here = program.equalities(program.start)[0], program.inequalities(program.start)
        known = warm if counts == (len(here[0]), len(here[1])) else None
    even = Balanced.of(program, boxed, schedule.penalty if known is None else known.penalty)
    return even.back(augmented(even.program, schedule, known and even.there(known)))


def _starts(task: Task) -> list[RibbonState]:
    """Where to start: the last state carried on as a rigid body, and with its rates of bending."""
    past, state = task.past, task.past.state
    if task.begin is not None:
        state = replace(state, frame=task.begin[0], origin=task.begin[1])
    if past.earlier is None:
        return [state]
    ratio = task.h / past.lapse
    if task.ribbon.ends != "clamped" and np.isclose(ratio, 1.0):
        turn = past.state.frame @ past.earlier.frame.T
        origin = 2.0 * past.state.origin - past.earlier.origin
        state = replace(state, frame=_orthonormal(turn @ past.state.frame), origin=origin)
    ahead = replace(
        state,
        slopes=state.slopes + ratio * (past.state.slopes - past.earlier.slopes),
        angles=state.angles + ratio * (past.state.angles - past.earlier.angles),
        start_angle=state.start_angle + ratio * (state.start_angle - past.earlier.start_angle),
        end_angle=state.end_angle + ratio * (state.end_angle - past.earlier.end_angle),
    )
    return [state, ahead]


def _orthonormal(frame: FloatArray) -> FloatArray:
    """Nearest rotation: products of rotations lose their last digits."""
    u, _, v = np.linalg.svd(frame)
    made: FloatArray = u @ v
    return made


def _best_start(potential: Potential, starts: Sequence[FloatArray]) -> FloatArray:
    """The start of least energy among those that keep all bounds; the first one always counts."""
    space = potential.coordinates
    best, least = starts[0], np.inf
    for number, z in enumerate(starts):
        inside = np.all(z >= space.lower) and np.all(z <= space.upper)
        if number and not (inside and np.all(potential.matrix @ z <= potential.bound)):
            continue
        value = potential.objective(z)[0]
        if value < least:
            best, least = z, value
    return best


def after(task: Task, proposed: Proposed, points: FloatArray) -> Past:
    """What the next step starts from, with vertices (2,N+1,3) after collision response."""
    past = task.past
    multipliers = proposed.outcome.multipliers
    return Past(
        state=proposed.state,
        points=points,
        former=past.points,
        former_slopes=past.state.all_slopes,
        lapse=task.h,
        earlier=past.state,
        multipliers=replace(multipliers, penalty=min(multipliers.penalty, MOST_KEPT)),
    )


__all__ = [
    "Past",
    "Proposed",
    "Rule",
    "Task",
    "advance",
    "after",
    "consistent",
    "inertia",
    "lumped",
    "rim_points",
    "rims",
    "solve",
]
