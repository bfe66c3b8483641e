"""What `casashell ribbon` prints: the scene, a live line, how it ended, the list of scenes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Final

from casashell.app.ribbon_setup import RibbonSetup
from casashell.app.simulate_display import SimulationReporter, duration
from casashell.io.labels import engineering
from casashell.ribbon.record import Progress

_WORDS: Final = {
    "COMPLETE": "Complete",
    "INTERRUPTED": "Interrupted: frames so far are written, --resume goes on",
    "FAILED": "Failed: frames so far are written",
}
#: Names of ribbons shown before "and N more".
_SHOWN: Final = 3


class RibbonReporter(SimulationReporter):
    """Lines on stdout and a live line on stderr; silent with ``quiet``."""

    @contextmanager
    def stepping(self) -> Iterator[Callable[[Progress], None] | None]:
        """A callback that keeps the live line; None when there is nobody to see it."""
        with self.busy("preparing the first step") as update:
            if update is None:
                yield None
                return
            clock = Clock()
            yield lambda progress: update(clock.text(progress))

    def setup(self, setup: RibbonSetup) -> None:
        """What is about to be simulated."""
        self.entry("Scene", f"{setup.name}{': ' if setup.about else ''}{setup.about}")
        bodies = setup.scene.bodies
        for body in bodies[:_SHOWN]:
            ribbon = body.ribbon
            self.entry(
                "Ribbon",
                f"{body.name}: {ribbon.length:.3g} x {ribbon.width:.3g} m, {ribbon.segments} "
                f"segments, {ribbon.ends}, D {engineering(ribbon.stiffness, 'J')}, "
                f"{ribbon.density:g} kg/m2",
            )
        if len(bodies) > _SHOWN:
            self.entry("", f"and {len(bodies) - _SHOWN} more")
        scene = setup.scene
        contact = f"thickness {1e3 * scene.thickness:g} mm" if scene.thickness else "off"
        if scene.obstacles:
            contact += ", " + ", ".join(o.name or "obstacle" for o in scene.obstacles)
        self.entry("Collisions", contact)
        self.entry("Steps", f"{setup.steps} of {setup.step:g} s by {setup.solver}")

    def ended(self, record: Mapping[str, Any]) -> None:
        """Status and numbers."""
        status = record["status"]
        important = status != "COMPLETE"
        text = f"{status}  {_WORDS[status]} ({record['time']:g} s in {record['seconds']:.1f} s)"
        self.line()
        self.line(text, important=important)
        if status == "FAILED":
            self.line(record["message"], important=True)
            self.line(record["advice"], important=True)
        self.line()
        for label, words in ended_lines(record):
            self.line(f"  {label:<22}{words}")


class Clock:
    """Steps as they come, and the time that is left."""

    def __init__(self) -> None:
        self.first: tuple[int, float] | None = None

    def text(self, progress: Progress) -> str:
        """``step 12 of 100, t = 0.12 s, 14 + 1 iterations, 0.31 s a step, 27 s left``."""
        now = time.perf_counter()
        if self.first is None:
            self.first = (progress.step, now)
        frame, made = progress.frame, progress.step - self.first[0]
        text = (
            f"step {progress.step} of {progress.steps}, t = {frame.time:.3g} s, "
            f"{frame.inner.mean():.0f} / {frame.outer.mean():.0f} iterations"
        )
        if not made:
            return text
        each = (now - self.first[1]) / made
        return (
            f"{text}, {engineering(each, 's')} a step, "
            f"{duration(each * (progress.steps - progress.step))} left"
        )


def ended_lines(record: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Label and text of the numbers of a record."""
    lines = []
    for label, key in (("inner iterations", "inner_iterations"), ("outer", "outer_iterations")):
        if record[key] is not None:
            mean, most = record[key]["mean"], record[key]["largest"]
            lines.append((label, f"{mean:.1f} a step, at most {most:.0f}"))
    if record["seconds_per_step"] is not None:
        each = record["seconds_per_step"]
        words = f"{engineering(each['mean'], 's')}, at most {engineering(each['largest'], 's')}"
        lines.append(("time a step", words))
    if record["steps_made_in_parts"]:
        lines.append(("made in parts", f"{record['steps_made_in_parts']} steps"))
    lines.append(("conditions off by", f"{record['constraint_violation']:.1g}"))
    lines.append(("lengths off by", f"{record['isometry_error']:.1g} of themselves"))
    energy = record["energies"]["total"]
    if None not in energy.values():
        words = " to ".join(engineering(energy[key], "J") for key in ("first", "last"))
        lines.append(("energy", words))
    if record["smallest_distance"] is not None:
        lines.append(("closest parts", engineering(record["smallest_distance"], "m")))
    if record["smallest_gap_to_obstacles"] is not None:
        gap = engineering(record["smallest_gap_to_obstacles"], "m")
        lines.append(("closest to obstacles", gap))
    crossing = record["frames_with_crossings"]
    if crossing:
        lines.append(("passes through itself", f"in {crossing} frames"))
    lines += [("note", note) for note in record["notes"]]
    return lines
