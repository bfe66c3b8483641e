"""One step of a shell among obstacles: find touches, solve, check, and try a shorter step if need be."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from casashell.dynamics.newton import Solved, StepSolver
from casashell.dynamics.sequence import solve_sequence
from casashell.dynamics.system import Inertia, System
from casashell.dynamics.touch import Touches, contact_residual
from casashell.dynamics.touching import Detector, Reach
from casashell.typing import BoolArray, FloatArray, IntArray

#: A step may be halved this often.
LEVELS = 10
#: Residual, in mean nodal weights, that is let pass in steps of the shortest length.
_LAST = 1e-2
#: Acceleration [m/s2] that vertices may feel before the check after a step finds them.
_SURPRISE = 20.0
#: Rounds in which vertices that were missed are added.
_ROUNDS = 4
#: So few touches are always swept over before a step is halved; more where they are in each other's way.
_FEW = 60
#: See `_softened`; 0.01 .. 10 were tried on moving garments and hats that land.
_SOFT = 0.1
#: Shares of the motion so far that a first guess may keep.
_SHARES = (1.0, 0.5, 0.0)
#: Forces this near to the limit of friction do not make a first guess of sticking.
_LIMIT = 1e-3


@dataclass(eq=False)
class State:
    """Where a run is: positions, velocities (V,3), contact forces (B,V,3), how often halved."""

    time: float
    x: FloatArray
    v: FloatArray
    forces: FloatArray
    level: int = 0


@dataclass
class Tally:
    """What the steps since the last frame were like."""

    steps: int = 0
    iterations: int = 0
    residual: float = 0.0
    contact: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=bool))


class StepFailed(ArithmeticError):
    """A step failed however short it was made; the message says where."""


class Stepper:
    """Advances a `State`; everything it remembers beside it is dropped by `refresh`."""

    def __init__(self, system: System, detector: Detector, solver: StepSolver, step: float) -> None:
        self.system, self.detector, self.solver = system, detector, solver
        self.step = step
        self.coarse = 0  # steps taken at the shortest length although a gap was wrong
        self.rough = 0  # steps at the shortest length that kept a residual
        self.rescued = 0  # steps that Newton's method alone did not solve

    def prepare(self, x: FloatArray) -> None:
        """Analyse the matrices at the start of the run, the same when it is taken up again."""
        self.system.begin(Inertia(x, np.zeros_like(x), self.step, 0.0))
        self.solver.linear.prepare(self.system.linearised(np.zeros_like(x))[1])

    def refresh(self, state: State) -> None:
        """Forget what earlier steps left behind, so that a run can be taken up from here."""
        self.solver.linear.forget()
        self.system.begin(Inertia(state.x, state.v, self.step, state.time))
        _, entries = self.system.linearised(np.zeros_like(state.x))
        self.solver.stiffest = float(np.abs(entries).max(initial=0.0))
        blocks = self.system.blocks
        inertia = self.system.mass / self.step**2
        self._stiffness = _upward(entries[blocks.place[blocks.diagonal]], inertia)
        for watch in self.detector.watches:
            watch.forget()

    def advance(self, state: State, h: float, end: float, tally: Tally, *, last: bool) -> bool:
        """Take one step of length h to the time ``end``; False when a shorter one is needed.

        last  the step cannot be made shorter: small errors of gaps are let pass
        """
        self.system.begin(Inertia(state.x, state.v, h, end))
        speed = np.linalg.norm(state.v, axis=1)
        room = 2.0 * (h * speed + h * h * _SURPRISE) + 0.5 * self.detector.deep
        step = Reach(state.time, end, state.x, room)
        also: list[IntArray] = []
        for _ in range(_ROUNDS):
            touches = self.detector.find(step, self._stiffness, also)
            solved = self._solve(touches, state, h)
            tally.iterations += solved.iterations
            if not solved.converged:
                if not last or solved.residual > _LAST * self.solver.weight:
                    return False
                self.rough += 1
            x = state.x + solved.d
            pushed = (solved.f * touches.normal).sum(axis=1) > 0.0
            fresh, worst = self.detector.missed(step, touches, x, pushed)
            if worst > self.detector.deep and not last:
                return False
            if not any(len(ids) for ids in fresh):
                break
            also = [np.union1d(a, b) for a, b in zip(also, fresh)] if also else fresh
        self.coarse += int(worst > self.detector.deep)
        self._accept(state, touches, solved, h, end, tally)
        return True

    def _solve(self, touches: Touches, state: State, h: float) -> Solved:
        """The step by Newton's method, or by a sequence of linear ones when that fails."""
        f = state.forces[touches.body, touches.vertex]
        push = (f * touches.normal).sum(axis=1)
        drag = np.linalg.norm(f - push[:, None] * touches.normal, axis=1)
        stuck = (push > 0.0) & (drag < (1.0 - _LIMIT) * touches.friction * push)
        touches = _softened(touches, push > 0.0)
        settled = touches.carried - touches.gap[:, None] * touches.normal
        d = self._guess(state, h, touches.vertex[stuck], settled[stuck])
        solved = self.solver.solve(touches, d, f, h)
        if not solved.converged and not solved.balanced:
            solved = self.solver.solve(touches, d, f, h, energy=True)
        if not solved.converged and (solved.tangled or len(touches) <= _FEW):
            self.rescued += 1
            solved = solve_sequence(self.solver, touches, d, f, h)
        return solved

    def _guess(self, state: State, h: float, stuck: IntArray, settled: FloatArray) -> FloatArray:
        """Displacements (V,3) m to begin with, vertices that stick carried along.

        The motion goes on, unless that would crush the shell: then less of it, or as much as seen
        from a body that has changed its own motion, whichever has the least action.
        """
        onward = h * state.v
        tries = [share * onward for share in _SHARES]
        tries += [onward + change for change in self._changes(state, h)]
        for d in tries:
            d[~self.system.free] = 0.0
            d[stuck] = settled
        actions = [self.system.action(d) for d in tries]
        least = int(np.nanargmin([*actions, np.finfo(float).max]))
        if least == len(tries):
            return tries[len(_SHARES) - 1]
        return tries[0] if actions[0] <= actions[least] + self.solver.noticed else tries[least]

    def _changes(self, state: State, h: float) -> list[FloatArray]:
        """How much farther (V,3) m each body carries the shell in this step than in one before it."""
        x, now = state.x, state.time
        found = []
        for watch in self.detector.watches:
            ahead = watch.body.carry(x, now, now + h)
            behind = watch.body.carry(x, now, max(now - h, 0.0))
            change = (ahead - x) - (x - behind)
            if change.any():
                found.append(change)
        return found

    def _accept(
        self, state: State, touches: Touches, solved: Solved, h: float, end: float, tally: Tally
    ) -> None:
        v = solved.d / h
        push = (solved.f * touches.normal).sum(axis=1)
        # A vertex that started too deep was moved out; that is a correction, not a motion.
        sunk = np.flatnonzero((push > 0.0) & (touches.gap < -1e-9 * self.solver.size))
        if len(sunk):
            out = -touches.gap[sunk] / h
            np.subtract.at(v, touches.vertex[sunk], out[:, None] * touches.normal[sunk])
        state.x = state.x + solved.d
        state.v, state.time = v, end
        state.forces = np.zeros_like(state.forces)
        state.forces[touches.body, touches.vertex] = solved.f
        tally.steps += 1
        law = float(contact_residual(touches, solved.f, solved.d).max(initial=0.0))
        worst = max(solved.residual, law) / self.solver.weight
        tally.residual = max(tally.residual, worst)
        tally.contact = np.zeros(len(v), dtype=bool)
        tally.contact[touches.vertex[push > 0.0]] = True


def _upward(blocks: FloatArray, least: FloatArray) -> FloatArray:
    """Stiffness (V,3,3) of each vertex, with that of its mass (V,) N/m where pressure leaves less.

    The natural map needs scales above zero: below, a vertex in free air would count as pushed.
    """
    values, vectors = np.linalg.eigh(blocks)
    sizes = np.abs(values)
    floor = np.maximum(least, 1e-3 * sizes.max(axis=1))[:, None]
    low = np.flatnonzero((values < floor).any(axis=1))
    made = np.array(blocks)
    kept = np.maximum(sizes[low], floor[low])
    made[low] = (vectors[low] * kept[:, None, :]) @ vectors[low].transpose(0, 2, 1)
    return made


def _softened(touches: Touches, pushed: BoolArray) -> Touches:
    """The natural map made soft: along the normal where there is a force, so that its sign decides."""
    return replace(
        touches,
        normal_stiffness=_SOFT * touches.normal_stiffness,
        tangent_stiffness=np.where(pushed, 1.0, _SOFT) * touches.tangent_stiffness,
    )
