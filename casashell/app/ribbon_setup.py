"""A scene of ribbons with its times and solver, and what moves in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from casashell.dynamics.motion import RigidMotion
from casashell.ribbon import holds
from casashell.ribbon.chain import reconstruct
from casashell.ribbon.dynamics import MOST_STEPS
from casashell.ribbon.forces import PointLoad
from casashell.ribbon.holds import Attachment, HeldEnd
from casashell.ribbon.resample import Resample
from casashell.ribbon.ribbon import Ribbon, RibbonState
from casashell.ribbon.scene import Body, Pose, Scene
from casashell.ribbon.statics import Junction, Setting
from casashell.ribbon.step import Form, Mass, Rule, Solver
from casashell.typing import ArrayLike, FloatArray

#: Largest turn of a guided normal in one step: no force leads back from the opposite direction.
MOST_TURNED = 0.5 * np.pi


@dataclass(frozen=True, eq=False)
class Course:
    """Values over time: monotone cubics (PCHIP) between keyframes, at rest before and after.

    times   (K,) s, increasing;  values (K,) or (K,D)
    Raises ValueError for keyframes that are not finite, not in order, or of the wrong number.
    """

    times: ArrayLike
    values: ArrayLike

    def __post_init__(self) -> None:
        times, values = (np.array(v, dtype=np.float64) for v in (self.times, self.values))
        if times.ndim != 1 or not len(times) or len(values) != len(times):
            raise ValueError(f"times and values must be as many, got {times.shape}, {values.shape}")
        if not (np.all(np.isfinite(times)) and np.all(np.isfinite(values))):
            raise ValueError("times and values must be finite")
        late = np.flatnonzero(np.diff(times) <= 0)
        if late.size:
            raise ValueError(f"times must increase: {times[late[0] + 1]:g} is not after the last")
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "values", values)

    @staticmethod
    def constant(value: ArrayLike) -> Course:
        """The same at all times."""
        return Course([0.0], np.asarray(value, dtype=np.float64)[None])

    @cached_property
    def _curve(self) -> Any:
        from scipy.interpolate import PchipInterpolator

        return PchipInterpolator(self.times, self.values)

    def at(self, t: float) -> FloatArray:
        """The value at time t [s]."""
        times, values = np.asarray(self.times), np.asarray(self.values)
        if len(times) == 1:
            return np.asarray(values[0])
        return np.asarray(self._curve(np.clip(t, times[0], times[-1])))


@dataclass(frozen=True, eq=False)
class Hold:
    """The material point (s, y) [m] follows ``place`` until the time ``until`` [s]."""

    s: float
    y: float
    place: Course
    until: float = np.inf


@dataclass(frozen=True, eq=False)
class Load:
    """A force [N] over time at the material point (s, y) [m]."""

    s: float
    y: float
    force: Course


@dataclass(frozen=True, eq=False)
class Actions:
    """What acts on one ribbon over time: a `Setting` for each moment.

    end     middle (3,) and frame (3,3) of the last quad's end at t = 0, and the motion that carries it
    """

    holds: tuple[Hold, ...] = ()
    loads: tuple[Load, ...] = ()
    end: tuple[FloatArray, FloatArray, RigidMotion | None] | None = None
    junction: Junction | None = None

    def __call__(self, t: float) -> Setting:
        """At time t [s]."""
        return Setting(
            attachments=tuple(
                Attachment(h.s, h.y, h.place.at(t)) for h in self.holds if t <= h.until
            ),
            loads=tuple(PointLoad(load.s, load.y, load.force.at(t)) for load in self.loads),
            end=self._held_end(t),
            junction=self.junction,
        )

    @property
    def moves(self) -> bool:
        """Whether anything changes over time."""
        courses = [hold.place for hold in self.holds] + [load.force for load in self.loads]
        changes = any(len(np.asarray(course.times)) > 1 for course in courses)
        changes |= any(np.isfinite(hold.until) for hold in self.holds)
        return changes or (self.end is not None and self.end[2] is not None)

    def _held_end(self, t: float) -> HeldEnd | None:
        if self.end is None:
            return None
        middle, frame, motion = self.end
        if motion is None:
            return HeldEnd(middle, frame)
        turn, shift = motion.at(t)
        return HeldEnd(turn @ middle + shift, turn @ frame)


@dataclass(frozen=True, eq=False)
class Twist:
    """A direction (3,) that turns about an axis: the normal of a guide over time."""

    normal: FloatArray
    axis: FloatArray
    turns: Course

    def __call__(self, t: float) -> FloatArray:
        """The unit vector at time t [s]."""
        from scipy.spatial.transform import Rotation

        angle = 2.0 * np.pi * float(self.turns.at(t))
        axis = self.axis / np.linalg.norm(self.axis)
        return np.asarray(Rotation.from_rotvec(angle * axis).apply(self.normal))


def carried(state: RibbonState, motion: RigidMotion) -> Pose:
    """Frame and origin of a clamped begin that starts at ``state`` and moves."""

    def pose(t: float) -> tuple[FloatArray, FloatArray]:
        turn, shift = motion.at(t)
        return turn @ state.frame, turn @ state.origin + shift

    return pose


def end_of(ribbon: Ribbon, state: RibbonState) -> tuple[FloatArray, FloatArray]:
    """Middle (3,) and frame (3,3) of the end of the last quad."""
    shape = reconstruct(ribbon, state)
    return shape.middle[-1], shape.behind[-1]


@dataclass(frozen=True, eq=False)
class RibbonSetup:
    """Everything that decides which frames come out.

    name     for titles;  ``about`` one sentence
    source   text that is different when the scene is: guards --resume
    """

    name: str
    scene: Scene
    seconds: float
    step: float
    solver: Solver = "ipopt"
    resample: Resample | None = None
    mass: Mass = "consistent"
    form: Form | None = None
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    about: str = ""
    source: str = ""

    @property
    def rule(self) -> Rule:
        """How steps are made; ValueError for unknown names."""
        return Rule(self.solver, self.resample, self.mass, self.form)

    @property
    def steps(self) -> int:
        """Their number."""
        return round(self.seconds / self.step)

    def with_times(self, seconds: float | None, step: float | None) -> RibbonSetup:
        """With other times where given; ValueError for times that are none."""
        made = replace(self, seconds=seconds or self.seconds, step=step or self.step)
        for name, given in (("seconds", seconds), ("step", step)):
            value = getattr(made, name) if given is None else given
            if not (np.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be a positive time in s, got {value:g}")
        if made.seconds / made.step > MOST_STEPS:
            raise ValueError(
                f"step is {made.step:g} s, {made.seconds / made.step:.1e} steps for "
                f"{made.seconds:g} s, at most {MOST_STEPS:.0e} are possible: take longer steps or "
                "fewer seconds"
            )
        if made.steps < 1:
            raise ValueError(
                f"seconds is {made.seconds:g}, less than one step of {made.step:g} s: "
                "take shorter steps"
            )
        return made

    def require_possible(self) -> None:
        """Look at all that moves, at every step: ValueError naming the ribbon and the time."""
        _ = self.rule
        for number, body in enumerate(self.scene.bodies):
            label = body.name or f"ribbon {number}"
            for k in range(self.steps + 1):
                t = k * self.step
                try:
                    _require(body, t, self.step, np.asarray(self.scene.gravity))
                except ValueError as problem:
                    raise ValueError(f"{label} at t = {t:g} s: {problem}") from None
                if not _moves(body):
                    break


def _moves(body: Body) -> bool:
    """Whether what acts on the ribbon is different at different times."""
    setting = body.setting
    moving = setting.moves if isinstance(setting, Actions) else callable(setting)
    return moving or body.begin is not None or any(callable(g.normal) for g in body.guides)


def _require(body: Body, t: float, h: float, gravity: FloatArray) -> None:
    """ValueError when holds contradict each other at t, or a guide turns too far in a step."""
    setting, pose, base = body.at(t, gravity), body.pose(t), body.initial
    if pose is not None:
        base = replace(base, frame=pose[0], origin=pose[1])
    holds.require_consistent(body.ribbon, base, setting.attachments, setting.end)
    for number, guide in enumerate(body.guides):
        if callable(guide.normal):
            _require_slow(guide.normal, t, h, number)


def _require_slow(normal: Callable[[float], ArrayLike], t: float, h: float, number: int) -> None:
    now, then = (np.asarray(normal(time), dtype=np.float64) for time in (t, t + h))
    turn = float(np.arccos(np.clip(now @ then, -1.0, 1.0)))
    if isinstance(normal, Twist):
        turn = 2.0 * np.pi * abs(float(normal.turns.at(t + h) - normal.turns.at(t)))
    if turn >= MOST_TURNED:
        raise ValueError(
            f"guide {number} turns by {np.degrees(turn):.0f} degrees in one step of {h:g} s, less "
            "than 90 are possible: turn it more slowly or take shorter steps"
        )


__all__ = [
    "Actions",
    "Course",
    "Hold",
    "Load",
    "RibbonSetup",
    "Twist",
    "carried",
    "end_of",
]
