"""What the program prints: the scene, a live line while solving, the verdict."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np

from casashell.app.scene import Scene
from casashell.app.values import unit_name
from casashell.contact.detect import ContactSummary
from casashell.io.labels import STATUS_WORDS, degrees, engineering, percent
from casashell.result import Result, Step

_LABEL: Final = 12
#: Penetration, relative to the shell's size, that is not worth a word.
_ROUNDING: Final = 1e-9


class Reporter:
    """Lines on stdout and a live line on stderr; silent with ``quiet``."""

    def __init__(self, *, quiet: bool) -> None:
        self.quiet = quiet

    def line(self, text: str = "", *, important: bool = False) -> None:
        """One line; important ones go to stderr when everything else is silent."""
        if not self.quiet:
            print(text)
        elif important:
            print(f"casashell: {text}", file=sys.stderr)

    def entry(self, label: str, text: str) -> None:
        """A labelled line of a summary."""
        self.line(f"{label:<{_LABEL}}{text}")

    @contextmanager
    def live(self) -> Iterator[Callable[[Step], None] | None]:
        """A callback that keeps one line up to date; None when there is nobody to see it."""
        if self.quiet or not sys.stderr.isatty():
            yield None
            return
        from rich.console import Console

        with Console(stderr=True).status("solving", spinner="line") as status:
            yield lambda step: status.update(live_text(step))

    def scene(
        self, scene: Scene, contacts: Sequence[ContactSummary], *, complete: bool = True
    ) -> None:
        """Shell, material, contacts; only what a broken mesh allows unless ``complete``."""
        for remark in scene.remarks:
            self.entry("Input", remark)
        self.entry("Shell", _shell(scene, complete))
        if not complete:
            return
        self.entry("Material", _material(scene))
        for summary, obstacle in zip(contacts, scene.obstacles):
            self.entry("Contacts", _contacts(summary, float(obstacle.friction), scene))
        if not scene.obstacles:
            self.entry("Contacts", "none: no obstacles")
        if scene.pinned:
            self.entry("Pinned", _count(len(set(scene.pinned)), "vertex", "vertices"))

    def verdict(self, result: Result) -> None:
        """Status, advice, certificate, quality, notes."""
        words = STATUS_WORDS[result.status]
        self.line()
        self.line(
            f"{result.status}  {words} ({result.seconds:.2f} s)",
            important=not result.status.certified,
        )
        self.line(result.advice, important=not result.status.certified)
        for note in result.notes:
            self.line(f"note: {note}")
        self.line()
        for label, text in certificate_lines(result):
            self.line(f"  {label:<22}{text}")
        self.line()
        for label, text in quality_lines(result):
            self.line(f"  {label:<22}{text}")

    def files(self, folder: Path, names: Sequence[str], timings: Mapping[str, float]) -> None:
        """What was written, and where the time went."""
        self.line()
        self.entry("Files", f"{folder}/")
        self.line(" " * _LABEL + "  ".join(names))
        spent = ", ".join(f"{name} {seconds:.2f} s" for name, seconds in timings.items())
        self.entry("Time", f"{spent}, together {sum(timings.values()):.2f} s")


def live_text(step: Step) -> str:
    """``newton: load 50 %, step 3, residual 1.2e-04, 0.8 s``."""
    text = (
        f"{step.stage}: load {100 * step.load:.0f} %, step {step.iteration}, "
        f"residual {step.residual:.1e}, {step.seconds:.1f} s"
    )
    return f"{text}  {step.note}" if step.note else text


def certificate_lines(result: Result) -> list[tuple[str, str]]:
    """Label and text of every number of the certificate, with what it has to be."""
    c = result.certificate
    rows = [("free force", _relative(c.free_force, "of a vertex's weight (<= 1e-6)"))]
    if len(result.contacts):
        rows += [
            ("least normal force", _relative(c.min_normal_force, "of a vertex's weight (>= 0)")),
            ("friction in reserve", _relative(c.cone_margin, "of a vertex's weight (>= 0)")),
        ]
    stiffness = "not computed" if c.free_force is None else "no vertex is free to move"
    if c.min_eigenvalue is not None:
        stiffness = f"{engineering(c.min_eigenvalue, 'N/m')} (> 0)"
    if c.neutral_modes:
        stiffness += f", {_count(c.neutral_modes, 'neutral motion', 'neutral motions')}"
    rows.append(("lowest stiffness", stiffness))
    rows.append(("distance to target", _relative(c.target_distance, "of its size (<= 1e-3)")))
    return rows


def quality_lines(result: Result) -> list[tuple[str, str]]:
    """Label and text of what the natural shape is like."""
    q = result.quality
    crossings = _count(q.rest_self_intersections, "crossing", "crossings")
    return [
        ("natural edges", f"up to {percent(q.max_stretch)} longer or shorter than designed"),
        ("natural folds", f"up to {degrees(q.max_rest_fold)} away from designed"),
        (
            "natural triangles",
            f"smallest angle {degrees(q.min_rest_angle)}, "
            f"{q.flipped_faces} turned over, {crossings}",
        ),
    ]


def _relative(value: float | None, text: str) -> str:
    return "not computed" if value is None else f"{value:.2g} {text}"


def _shell(scene: Scene, complete: bool) -> str:
    mesh = scene.target
    size = mesh.vertices.max(axis=0) - mesh.vertices.min(axis=0)
    text = f"{scene.name}: {len(mesh.vertices)} vertices, {len(mesh.faces)} triangles"
    if mesh.polygons:
        text += f" ({len(mesh.polygons)} polygons)"
    if complete:
        pieces, rims = int(mesh.components[0]), len(mesh.boundary_loops)
        text += f", {_count(pieces, 'piece', 'pieces')}, {_count(rims, 'rim', 'rims')}"
    sides = " x ".join(f"{side:.3g}" for side in size)
    return f"{text}; {sides} m (unit {unit_name(scene.unit)}, up {scene.up})"


def _material(scene: Scene) -> str:
    material = scene.material
    return (
        f"density {_value(material.density)} kg/m2, stretch {_value(material.stretch)} N, "
        f"bend {_value(material.bend)} J; mass {engineering(1000.0 * scene.mass, 'g')}, "
        f"weight {engineering(scene.weight, 'N')}"
    )


def _value(value: Any) -> str:
    array = np.asarray(value)
    if array.ndim == 0:
        return f"{float(array):g}"
    return f"{array.min():.3g}..{array.max():.3g} ({len(array)} values)"


def _contacts(summary: ContactSummary, friction: float, scene: Scene) -> str:
    tolerance = engineering(scene.problem.tolerance, "m")
    text = (
        f"{_count(summary.count, 'vertex', 'vertices')} within {tolerance} of {summary.label}, "
        f"friction {friction:g}"
    )
    if summary.deepest > _ROUNDING * scene.target.bbox_diagonal:
        depth = engineering(summary.deepest, "m")
        text += f"; {summary.penetrating} inside, deepest {depth} (vertex {summary.deepest_vertex})"
    return text


def _count(number: int, one: str, more: str) -> str:
    return f"{number} {one if number == 1 else more}"
