"""The loop over frames: steps between fixed frame times, checkpoints, callback, interrupts."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from casashell.dynamics.checkpoint import Checkpoint
from casashell.dynamics.simulation import Frame, Simulation, SimulationStatus
from casashell.dynamics.stepper import LEVELS, State, StepFailed, Stepper, Tally
from casashell.typing import AnyArray, IntArray

#: Frames between two states that a run can be taken up from.
EVERY = 10
#: A step counts this many ticks, so that halved steps end at frame times exactly.
_TICKS = 1 << LEVELS

_ADVICE = {
    SimulationStatus.COMPLETE: "every step was solved",
    SimulationStatus.INTERRUPTED: "interrupted: frames so far are kept; with checkpoint= it goes on",
    SimulationStatus.FAILED: "try more substeps, damping, or a slower motion",
}


class Run:
    """Frames of one simulation as they are made."""

    def __init__(
        self,
        stepper: Stepper,
        state: State,
        faces: IntArray,
        count: int,
        substeps: int,
        rate: float,
        began: float,
    ) -> None:
        self.stepper, self.state, self.faces = stepper, state, faces
        self.count, self.substeps, self.rate = count, substeps, rate
        self.began = began
        self.notes: list[str] = []
        self.iterations = 0
        vertices = len(state.x)
        self.record = np.dtype(
            [
                ("time", "f8"),
                ("positions", "f8", (vertices, 3)),
                ("velocities", "f8", (vertices, 3)),
                ("contact", "?", (vertices,)),
                ("residual", "f8"),
                ("kinetic", "f8"),
                ("potential", "f8"),
                ("steps", "i8"),
            ]
        )
        self.frames: AnyArray = np.zeros(count, dtype=self.record)
        self.made = 0
        self._kept: Checkpoint | None = None

    def use(self, checkpoint: Checkpoint) -> None:
        """Keep frames in ``checkpoint``, and go on from there when it holds some."""
        self._kept = checkpoint
        stored = checkpoint.resume()
        if stored is None:
            return
        values, frames = stored
        self.made = min(len(frames), self.count)
        self.frames[: self.made] = frames[: self.made]
        state = self.state
        state.time, state.level = float(values["time"]), int(values["level"])
        state.x, state.v, state.forces = values["x"], values["v"], values["forces"]
        self.iterations = int(values["iterations"])
        self.stepper.solver.linear.factorizations = int(values["factorizations"])
        self.notes.append(f"taken up again behind frame {self.made - 1}")

    def go(self, callback: Callable[[Frame], None] | None) -> Simulation:
        """All frames that are left; never raises for what the steps do."""
        status, advice = SimulationStatus.COMPLETE, ""
        try:
            self._frames(callback)
        except KeyboardInterrupt:
            status = SimulationStatus.INTERRUPTED
        except StepFailed as failure:
            status, advice = SimulationStatus.FAILED, f"{failure}: "
        if self.stepper.coarse:
            self.notes.append(
                f"{self.stepper.coarse} steps at the shortest length left a gap wrong: a body is finer "
                "than the shell, or moves too fast"
            )
        if self.stepper.rough:
            self.notes.append(
                f"{self.stepper.rough} steps at the shortest length kept a residual (see residuals): "
                "parts of the shell are crushed flat"
            )
        if self.stepper.rescued:
            self.notes.append(f"{self.stepper.rescued} steps needed sweeps over the contacts")
        return self._simulation(status, advice + _ADVICE[status])

    def _frames(self, callback: Callable[[Frame], None] | None) -> None:
        self.stepper.prepare(self.frames["positions"][0] if self.made else self.state.x)
        if self.made == 0:
            self._record(self._start(), callback)
        while self.made < self.count:
            if (self.made - 1) % EVERY == 0:
                self.stepper.refresh(self.state)
            tally = Tally()
            self._between(self.made - 1, tally)
            self.iterations += tally.iterations
            self._record(tally, callback)

    def _start(self) -> Tally:
        """Contacts at time 0: vertices at their offset."""
        contact = np.zeros(len(self.state.x), dtype=bool)
        for watch in self.stepper.detector.watches:
            gap, _ = watch.body.signed_distance(self.state.x, 0.0)
            small = gap - watch.offset <= 1e-9 * self.stepper.solver.size
            contact |= watch.allowed & small
        return Tally(contact=contact)

    def _between(self, frame: int, tally: Tally) -> None:
        """Steps from ``frame`` to the next, halved where one fails and doubled again later."""
        state, total = self.state, self.substeps * _TICKS
        position = 0
        while position < total:
            ticks = _TICKS >> state.level
            end = (frame + (position + ticks) / total) / self.rate
            h = ticks / (total * self.rate)
            last = state.level == LEVELS
            if not self.stepper.advance(state, h, end, tally, last=last):
                if last:
                    raise StepFailed(f"the step to {end:.6g} s does not converge at {h:.2g} s")
                state.level += 1
                continue
            position += ticks
            if state.level and position % (2 * ticks) == 0:
                state.level -= 1

    def _record(self, tally: Tally, callback: Callable[[Frame], None] | None) -> None:
        state, system, number = self.state, self.stepper.system, self.made
        row = self.frames[number : number + 1]
        row["time"], row["positions"], row["velocities"] = number / self.rate, state.x, state.v
        row["contact"], row["residual"] = tally.contact, tally.residual
        row["kinetic"], row["potential"] = system.kinetic(state.v), system.potential(state.x)
        row["steps"] = tally.steps
        self.made += 1
        if self._kept is not None:
            self._kept.append(row)
            if number % EVERY == 0 or self.made == self.count:
                self._save()
        if callback is not None:
            callback(self._told(number, tally))

    def _save(self) -> None:
        state = self.state
        values = {
            "time": np.array(state.time),
            "level": np.array(state.level),
            "x": state.x,
            "v": state.v,
            "forces": state.forces,
            "iterations": np.array(self.iterations),
            "factorizations": np.array(self.stepper.solver.linear.factorizations),
        }
        if self._kept is not None and (self.made - 1) % EVERY == 0:
            self._kept.save(self.made, values)

    def _told(self, number: int, tally: Tally) -> Frame:
        row = self.frames[number]
        return Frame(
            number=number,
            count=self.count,
            time=float(row["time"]),
            positions=self.state.x.copy(),
            velocities=self.state.v.copy(),
            contact=tally.contact.copy(),
            residual=tally.residual,
            kinetic=float(row["kinetic"]),
            potential=float(row["potential"]),
            steps=tally.steps,
            iterations=tally.iterations,
            seconds=time.perf_counter() - self.began,
        )

    def _simulation(self, status: SimulationStatus, advice: str) -> Simulation:
        rows = self.frames[: self.made]
        return Simulation(
            times=np.ascontiguousarray(rows["time"]),
            positions=np.ascontiguousarray(rows["positions"]),
            velocities=np.ascontiguousarray(rows["velocities"]),
            contact=np.ascontiguousarray(rows["contact"]),
            faces=self.faces,
            residuals=np.ascontiguousarray(rows["residual"]),
            kinetic=np.ascontiguousarray(rows["kinetic"]),
            potential=np.ascontiguousarray(rows["potential"]),
            steps=np.ascontiguousarray(rows["steps"]),
            status=status,
            advice=advice,
            notes=tuple(self.notes),
            seconds=time.perf_counter() - self.began,
            iterations=self.iterations,
            factorizations=self.stepper.solver.linear.factorizations,
        )
