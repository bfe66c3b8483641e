"""Time stepping of a scene (Pan 2016, Alg. 1): optimise every ribbon, then respond to collisions."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from casashell.engine.threads import one_thread
from casashell.ribbon.chain import reconstruct
from casashell.ribbon.contact import StripCollisions
from casashell.ribbon.parallel import Workers
from casashell.ribbon.pressed import with_contacts
from casashell.ribbon.record import (
    Frame,
    Progress,
    RibbonSimulation,
    RunStatus,
    load_checkpoint,
    save_checkpoint,
)
from casashell.ribbon.resample import Resample
from casashell.ribbon.response import responded
from casashell.ribbon.rigid_zones import Unresolved
from casashell.ribbon.scene import Body, Collide, Scene
from casashell.ribbon.step import (
    Form,
    Mass,
    Past,
    Proposed,
    Rule,
    Solver,
    Task,
    advance,
    rim_points,
)
from casashell.typing import BoolArray, FloatArray

#: Most steps of a run.
MOST_STEPS = 10_000_000
#: A step that fails is made in two halves, those in two quarters, at most so often.
HALVINGS = 5


class StepFailed(RuntimeError):
    """A step that could not be made, in one sentence."""


@dataclass(frozen=True, eq=False)
class _Made:
    """A whole step: what follows, counts of all its parts (K,) and how many parts it took."""

    pasts: tuple[Past, ...]
    inner: FloatArray
    outer: FloatArray
    residual: FloatArray
    violation: FloatArray
    parts: int


@dataclass(frozen=True, eq=False)
class Stepper:
    """Makes steps of ``scene`` by ``rule``; holds the threads and the collision response."""

    scene: Scene
    rule: Rule
    workers: Workers
    collide: Collide | None

    def begin(self, h: float) -> tuple[Past, ...]:
        """What the first step starts from.  ValueError when ribbons or obstacles interpenetrate."""
        pasts = tuple(_first(body, h) for body in self.scene.bodies)
        for number, (body, past) in enumerate(zip(self.scene.bodies, pasts)):
            for obstacle in self.scene.obstacles:
                gap = float(obstacle.signed_distance(past.points.reshape(-1, 3))[0].min())
                if gap < 0:
                    raise ValueError(
                        f"{body.name or f'ribbon {number}'} starts {-gap:.3g} m inside of obstacle "
                        f"'{obstacle.name}': move one of them"
                    )
        if self.collide is not None:
            points = [past.points for past in pasts]
            self.collide(points, points)
        return pasts

    def step(self, pasts: tuple[Past, ...], t: float, h: float, halvings: int = HALVINGS) -> _Made:
        """From t to t + h, in parts where that fails.  Raises StepFailed."""
        try:
            return self._whole(pasts, t, h)
        except StepFailed:
            if halvings == 0:
                raise
        first = self.step(pasts, t, h / 2, halvings - 1)
        second = self.step(first.pasts, t + h / 2, h / 2, halvings - 1)
        return _Made(
            second.pasts,
            first.inner + second.inner,
            first.outer + second.outer,
            np.maximum(first.residual, second.residual),
            np.maximum(first.violation, second.violation),
            first.parts + second.parts,
        )

    def _whole(self, pasts: tuple[Past, ...], t: float, h: float) -> _Made:
        scene = self.scene
        try:
            tasks = [self._task(body, past, t + h, h) for body, past in zip(scene.bodies, pasts)]
            ends = self.workers.map(lambda task: advance(task, scene.physics, self.rule), tasks)
        except ValueError as error:
            raise StepFailed(str(error)) from error
        for number, end in enumerate(ends):
            self._require(number, end)
        try:
            last, points, pushed = self._respond(tasks, ends)
        except (Unresolved, ValueError) as error:
            raise StepFailed(f"collision response: {error}") from error
        outcomes = [end.outcome for end in last]
        return _Made(
            tuple(
                replace(past, pushed=mask)
                for past, mask in zip(
                    responded(tasks, ends, last, points, scene.physics, self.rule), pushed
                )
            ),
            np.array([float(o.inner) for o in outcomes]),
            np.array([float(o.outer) for o in outcomes]),
            np.array([o.projected_gradient for o in outcomes]),
            np.array([o.violation for o in outcomes]),
            1,
        )

    def _respond(
        self, tasks: list[Task], ends: list[Proposed]
    ) -> tuple[list[Proposed], list[FloatArray], Sequence[BoolArray | None]]:
        """Ends, vertices (2,N+1,3) [m] without interpenetration, and which of them were pushed."""
        scene, points, none = self.scene, [end.points for end in ends], [None] * len(ends)
        if self.collide is None:
            return ends, points, none
        if not isinstance(self.collide, StripCollisions):
            return ends, list(self.collide([task.past.points for task in tasks], points)), none
        return with_contacts(
            self.collide,
            tasks,
            ends,
            lambda again: self.workers.map(lambda t: advance(t, scene.physics, self.rule), again),
            self._sound,
        )

    def _sound(self, number: int, end: Proposed) -> bool:
        """Whether the end of a step counts."""
        try:
            self._require(number, end)
        except StepFailed:
            return False
        return True

    def _task(self, body: Body, past: Past, t: float, h: float) -> Task:
        return Task(
            ribbon=body.ribbon,
            past=past,
            h=h,
            setting=body.at(t, np.asarray(self.scene.gravity)),
            terms=body.terms(t, self.scene.physics),
            begin=body.pose(t),
        )

    def _require(self, number: int, end: Proposed) -> None:
        """Raise StepFailed for a minimum that is none, or that does not meet its conditions."""
        outcome = end.outcome
        name = self.scene.bodies[number].name or f"ribbon {number}"
        if not (end.usable(self.rule) and np.all(np.isfinite(end.points))):
            raise StepFailed(f"{name}: {outcome.stop.value}")
        if outcome.violation > 100.0 * self.rule.feasibility:
            raise StepFailed(f"{name}: conditions are off by {outcome.violation:.1e}")


def _first(body: Body, h: float) -> Past:
    """At t = 0: the shape before follows from the velocities."""
    shape = reconstruct(body.ribbon, body.initial)
    points = rim_points(shape)
    return Past(
        state=body.initial,
        points=points,
        former=points - h * body.velocities(shape),
        former_slopes=body.initial.all_slopes,
        lapse=h,
    )


def simulate(
    scene: Scene,
    seconds: float,
    step: float,
    *,
    solver: Solver = "ipopt",
    resample: Resample | None = None,
    mass: Mass = "consistent",
    form: Form | None = None,
    tolerance: float | None = None,
    callback: Callable[[Progress], bool | None] | None = None,
    workers: int | None = None,
    checkpoint: str | Path | None = None,
    every: int = 10,
    resume: bool = False,
) -> RibbonSimulation:
    """Motion of ``scene`` over ``seconds`` in steps of ``step`` [s].

    solver      "ipopt" uses exact second derivatives; "augmented" is the paper's method.  `Rule`
                explains these, resample, mass, form and tolerance
    callback    gets a `Progress` after every step; False ends the run as INTERRUPTED
    workers     threads for several ribbons; as many as the machine has processors by default
    checkpoint  file that is written after every ``every`` steps and at the end; ``resume``: go on
                from it, with the frames that an uninterrupted run would have made

    A step that fails is made in parts; when that fails too the simulation ends as FAILED and says
    why.  Ctrl-C ends it as INTERRUPTED; the frames so far are kept.
    Raises ValueError for a scene that cannot start, and for a checkpoint of another scene.
    """
    count = _steps(seconds, step)
    rule = Rule(solver, resample, mass, form, tolerance)
    with one_thread(), Workers() if workers is None else Workers(workers) as pool:
        stepper = Stepper(scene, rule, pool, scene.response())
        run = _Run(stepper, step, callback, Path(checkpoint) if checkpoint else None, every)
        return run.go(count, resume)


def _steps(seconds: float, step: float) -> int:
    """Number of steps; ValueError for times that are none."""
    if not (np.isfinite(step) and step > 0):
        raise ValueError(f"step must be a positive time [s], got {step}")
    if not (np.isfinite(seconds) and seconds >= step * (1 - 1e-9)):
        raise ValueError(f"seconds must be at least one step of {step:g} s, got {seconds}")
    if seconds / step > MOST_STEPS:
        raise ValueError(
            f"step is {step:g} s, {seconds / step:.1e} steps for {seconds:g} s, at most "
            f"{MOST_STEPS:.0e} are possible: take longer steps or fewer seconds"
        )
    return round(seconds / step)


@dataclass(eq=False)
class _Run:
    """The loop over time, with what it writes down."""

    stepper: Stepper
    h: float
    callback: Callable[[Progress], bool | None] | None
    checkpoint: Path | None
    every: int

    def go(self, count: int, resume: bool) -> RibbonSimulation:
        """``count`` steps."""
        bodies = self.stepper.scene.bodies
        if resume:
            if self.checkpoint is None or not self.checkpoint.exists():
                raise ValueError("resume needs the file of an earlier run as checkpoint")
            pasts, frames = load_checkpoint(self.checkpoint, bodies, self.h)
        else:
            pasts = self.stepper.begin(self.h)
            frames = [Frame.of(self.stepper.scene, self.stepper.rule, pasts, 0.0, None)]
        status, message = RunStatus.COMPLETE, f"all {count} steps"
        stopped = False
        while len(frames) <= count and not stopped:
            try:
                pasts, frame = self._next(pasts, len(frames) - 1)
                frames.append(frame)
                stopped = self._told(pasts, frames, count)
            except KeyboardInterrupt:
                stopped = True
            except StepFailed as error:
                status = RunStatus.FAILED
                message = f"step {len(frames)} (t = {len(frames) * self.h:g} s) failed: {error}"
                break
        if stopped:
            status, message = RunStatus.INTERRUPTED, f"stopped after {len(frames) - 1} steps"
        self._write(pasts, frames)
        return RibbonSimulation.of(bodies, frames, status, message)

    def _told(self, pasts: tuple[Past, ...], frames: list[Frame], count: int) -> bool:
        """Write a checkpoint when it is due and tell the caller; true when that asks for the end."""
        if (len(frames) - 1) % self.every == 0:
            self._write(pasts, frames)
        if self.callback is None:
            return False
        return self.callback(Progress(len(frames) - 1, count, frames[-1])) is False

    def _next(self, pasts: tuple[Past, ...], number: int) -> tuple[tuple[Past, ...], Frame]:
        begin = time.perf_counter()
        made = self.stepper.step(pasts, number * self.h, self.h)
        counts = (made.inner, made.outer, made.residual, made.violation)
        took = (time.perf_counter() - begin, float(made.parts))
        t = (number + 1) * self.h
        frame = Frame.of(self.stepper.scene, self.stepper.rule, made.pasts, t, (counts, took))
        return made.pasts, frame

    def _write(self, pasts: tuple[Past, ...], frames: list[Frame]) -> None:
        if self.checkpoint is not None:
            save_checkpoint(self.checkpoint, pasts, frames, self.h)


__all__ = ["RibbonSimulation", "StepFailed", "Stepper", "simulate"]
