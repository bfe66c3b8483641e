"""What `casashell simulate` prints: the scene, a live line, how it ended."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Final

from casashell.app.display import Reporter
from casashell.app.scene import Scene
from casashell.dynamics.simulation import Frame
from casashell.io.animation_files import Progress
from casashell.io.labels import engineering

_WORDS: Final = {
    "COMPLETE": "every step was solved",
    "INTERRUPTED": "frames so far are written; the same command with --resume goes on",
    "FAILED": "frames so far are written",
}
#: Drift below which a shell is said to hold.
_HELD: Final = 1e-6


class Clock:
    """Frames as they come: when the first one came, and what a step takes."""

    def __init__(self) -> None:
        self.began = time.perf_counter()
        self.first: Frame | None = None
        self.steps = 0
        self.spent = 0.0

    def tick(self, frame: Frame) -> None:
        """A new frame."""
        if self.first is None:
            self.first = frame
            return
        self.steps += frame.steps
        self.spent = frame.seconds - self.first.seconds

    @property
    def step_seconds(self) -> float | None:
        """Mean wall time of a step of this process, the first frame and all setting up left out."""
        return self.spent / self.steps if self.steps else None

    def left(self, frame: Frame) -> float | None:
        """Wall time [s] that the frames to come will take."""
        made = 0 if self.first is None else frame.number - self.first.number
        return (frame.count - 1 - frame.number) * self.spent / made if made else None


class SimulationReporter(Reporter):
    """Lines on stdout and a live line on stderr; silent with ``quiet``."""

    @contextmanager
    def following(self, clock: Clock) -> Iterator[Callable[[Frame], None] | None]:
        """A callback that keeps the live line; None when there is nobody to see it."""
        with self.busy("building kernels") as update:
            if update is None:
                yield None
            else:
                yield lambda frame: update(live_text(frame, clock))

    @contextmanager
    def writing(self, name: str) -> Iterator[Progress | None]:
        """A progress callback for a file that takes its time."""
        with self.busy(f"writing {name}") as update:
            if update is None:
                yield None
            else:
                yield lambda done, count: update(f"writing {name}: {done} of {count}")

    @contextmanager
    def busy(self, text: str) -> Iterator[Callable[[str], None] | None]:
        """A live line, and how to change it; None when there is nobody to see it."""
        if self.quiet or not sys.stderr.isatty():
            yield None
            return
        from rich.console import Console

        with Console(stderr=True).status(text, spinner="line") as status:
            yield status.update

    def plan(self, scene: Scene, lines: Sequence[tuple[str, str]], remarks: Sequence[str]) -> None:
        """What is about to be simulated."""
        from casashell.contact.detect import describe

        self.scene(scene, describe(scene.problem.contacts, scene.obstacles))
        for label, text in lines:
            self.entry(label, text)
        for remark in remarks:
            self.line(f"note: {remark}")

    def outcome(self, record: Mapping[str, Any]) -> None:
        """Status, notes and numbers."""
        ended = record["status"]
        important = ended != "COMPLETE"
        self.line()
        text = f"{ended}  {_WORDS[ended]} ({record['time']:g} s simulated in {record['seconds']:.1f} s)"
        self.line(text, important=important)
        if ended == "FAILED":
            self.line(record["advice"], important=True)
        for note in record["notes"]:
            self.line(f"note: {note}")
        self.line()
        for label, text in outcome_lines(record):
            self.line(f"  {label:<22}{text}")


def live_text(frame: Frame, clock: Clock) -> str:
    """``frame 12 of 600, fastest 0.031 m/s, 62 contacts, 0.02 s a step, 14 s left``."""
    speed = float((frame.velocities**2).sum(axis=1).max() ** 0.5)
    text = (
        f"frame {frame.number} of {frame.count - 1}, fastest {engineering(speed, 'm/s')}, "
        f"{int(frame.contact.sum())} contacts"
    )
    left = clock.left(frame)
    return text if left is None else f"{text}, {duration(left)} left"


def duration(seconds: float) -> str:
    """``14 s``, ``3 min 05 s``, ``2 h 10 min``."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


def outcome_lines(record: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Label and text of the numbers of a record."""
    drift, speed, contacts = record["drift"], record["speed"], record["contacts"]
    held = "  (holds)" if drift["largest"] <= _HELD else ""
    lines = [
        (
            "farthest from start",
            f"{drift['largest']:.2g} of its size, at the end {drift['last']:.2g}{held}",
        ),
        (
            "fastest vertex",
            f"{engineering(speed['largest'], 'm/s')}, at the end "
            f"{engineering(speed['last'], 'm/s')}",
        ),
        ("contacts", f"{contacts['first']} at the start, {contacts['last']} at the end"),
    ]
    slid = speed["contacts_last_second"]
    if slid is not None:
        lines.append(("contacts, last second", f"at most {slid:.2g} m/s"))
    energy = [record["energy"][key] for key in ("first", "last")]
    if None not in energy:
        lines.append(("energy", " to ".join(engineering(value, "J") for value in energy)))
    if record["residual"] is not None:
        lines.append(("residual", f"at most {record['residual']:.2g} of a vertex's weight"))
    if record["step_seconds"] is not None:
        lines.append(("time a step", engineering(record["step_seconds"], "s")))
    return lines
