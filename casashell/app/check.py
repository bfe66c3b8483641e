"""`casashell check`: everything that can be said about a scene without solving it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

from casashell.app.display import Reporter
from casashell.app.failures import INPUT_ERROR, reading_input
from casashell.app.hints import hints, size_hints
from casashell.app.options import SceneOptions
from casashell.app.scene import Scene
from casashell.app.values import unit_name
from casashell.contact.detect import ContactSummary, describe
from casashell.mesh_checks import Finding, MeshError, inspect_mesh
from casashell.repair import repaired

_IDS_SHOWN = 1000


@dataclass(frozen=True)
class Check:
    """What was found; no contacts when the mesh has errors."""

    scene: Scene
    findings: tuple[Finding, ...]
    contacts: tuple[ContactSummary, ...] = ()
    hints: tuple[str, ...] = ()

    @property
    def sound(self) -> bool:
        """True when the scene can be solved."""
        return all(finding.severity != "error" for finding in self.findings)

    @property
    def record(self) -> dict[str, Any]:
        """The same for programs; lengths in m."""
        mesh = self.scene.target
        return {
            "ok": self.sound,
            "vertices": len(mesh.vertices),
            "faces": len(mesh.faces),
            "polygons": len(mesh.polygons) or len(mesh.faces),
            "components": int(mesh.components[0]),
            "boundary_loops": len(mesh.boundary_loops) if self.sound else None,
            "unit": self.scene.unit,
            "up": self.scene.up,
            "size": (mesh.vertices.max(axis=0) - mesh.vertices.min(axis=0)).tolist(),
            "area": float(mesh.face_areas.sum()),
            "mass": self.scene.mass if self.sound else None,
            "weight": self.scene.weight if self.sound else None,
            "pinned": len(self.scene.pinned),
            "tolerance": self.scene.problem.tolerance if self.sound else None,
            "contacts": sum(each.count for each in self.contacts),
            "obstacles": [
                {
                    "name": each.label,
                    "contacts": each.count,
                    "penetrating": each.penetrating,
                    "deepest": each.deepest,
                    "deepest_vertex": each.deepest_vertex,
                    "friction": float(obstacle.friction),
                }
                for each, obstacle in zip(self.contacts, self.scene.obstacles)
            ],
            "findings": [
                {
                    "kind": finding.kind,
                    "severity": finding.severity,
                    "message": finding.message,
                    "ids": finding.ids[:_IDS_SHOWN].tolist(),
                }
                for finding in self.findings
            ],
            "hints": list(self.hints),
            "remarks": list(self.scene.remarks),
        }


def checked(scene: Scene) -> Check:
    """Check a scene; ValueError for what is no fault of the mesh (pins, material, obstacles)."""
    try:
        problem = scene.problem
    except MeshError:
        return Check(scene, inspect_mesh(scene.target), hints=_repair_hints(scene))
    summary = describe(problem.contacts, scene.obstacles)
    return Check(scene, problem.findings, summary, hints(scene))


def _repair_hints(scene: Scene) -> tuple[str, ...]:
    """For a mesh with errors: would repair do, and is the unit likely?"""
    if repaired(scene.target).sound:
        advice = "--repair mends these errors"
    else:
        advice = "--repair does not mend all of these errors: edit the mesh first"
    return (advice, *size_hints(scene))


def run_check(options: SceneOptions, *, repair: bool, quiet: bool, as_json: bool) -> int:
    """Check and print; the exit code."""
    with reading_input():
        check = checked(options.spec().load(repair=repair))
    if as_json:
        print(json.dumps(check.record, indent=1, allow_nan=False))
    else:
        _print(check, Reporter(quiet=quiet))
    return 0 if check.sound else INPUT_ERROR


def _print(check: Check, reporter: Reporter) -> None:
    scene = check.scene
    reporter.scene(scene, check.contacts, complete=check.sound)
    for finding in check.findings:
        reporter.line(
            f"{finding.severity}: {finding.message}", important=finding.severity == "error"
        )
    for hint in check.hints:
        reporter.line(f"hint: {hint}")
    if not check.sound:
        reporter.line("The mesh cannot be solved as it is.", important=True)
    elif not check.findings and not check.hints:
        reporter.line(f"Nothing to complain about (unit {unit_name(scene.unit)}).")
