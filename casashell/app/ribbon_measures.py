"""What is measured on the frames of a ribbon simulation, by code of its own, and ribbon.json."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from casashell.app.ribbon_setup import RibbonSetup
from casashell.ribbon.chain import reconstruct
from casashell.ribbon.collide import Collider
from casashell.ribbon.impacts import Detector, Moving
from casashell.ribbon.record import RibbonSimulation, RunStatus, Track
from casashell.ribbon.scene import Body
from casashell.ribbon.strips import Ends, Strip, ribbon_strip, to_vertices
from casashell.typing import FloatArray

#: Error of lengths, relative, that is said aloud.
_STRETCHED = 0.01
#: Distances are looked for up to this part of the narrowest ribbon's width where no thickness is set.
_NEAR: Final = 0.05
_ADVICE: Final = {
    RunStatus.COMPLETE: "The frames are complete.",
    RunStatus.INTERRUPTED: "The frames so far are written; go on with --resume.",
    RunStatus.FAILED: "The frames so far are written; take shorter steps (--step), the other "
    "--solver, or look at the last frame for what is wedged.",
}


def strip_ends(body: Body) -> Ends:
    """How the triangles of a ribbon are joined."""
    ends = body.ribbon.ends
    return ends if ends == "loop" or ends == "moebius" else "open"


def strip_of(body: Body, thickness: float) -> Strip:
    """Triangles of a ribbon; 2 vertices a station, bottom first."""
    ribbon, shape = body.ribbon, reconstruct(body.ribbon, body.initial)
    mass = ribbon.density * ribbon.width * ribbon.length
    ends = strip_ends(body)
    return ribbon_strip(shape.bottom, shape.top, mass=mass, thickness=thickness, ends=ends)


def isometry_error(track: Track) -> FloatArray:
    """(F,) largest error of a length over that length: rims, rulings and both diagonals of quads.

    Of edges shorter than a segment, over the length of a segment.
    """
    ribbon = track.ribbon
    ends = np.zeros((len(track.slopes), 1))
    c = np.concatenate([ends, track.slopes, ends], axis=1)
    at = np.linspace(0.0, ribbon.length, ribbon.segments + 1)
    half = 0.5 * ribbon.width
    below = np.stack([at - half * c, np.full_like(c, -half)], axis=2)
    above = np.stack([at + half * c, np.full_like(c, half)], axis=2)
    worst = np.zeros(len(c))
    for i, j, a, b in ((0, 1, 0, 0), (0, 1, 1, 1), (0, 0, 0, 1), (0, 1, 0, 1), (0, 1, 1, 0)):
        flat, world = (below, above), (track.bottom, track.top)
        n = ribbon.segments
        one, two = slice(i, i + n), slice(j, j + n)
        wanted = np.linalg.norm(flat[a][:, one] - flat[b][:, two], axis=2)
        found = np.linalg.norm(world[a][:, one] - world[b][:, two], axis=2)
        worst = np.maximum(
            worst, (np.abs(found - wanted) / np.maximum(wanted, ribbon.segment)).max(axis=1)
        )
    return worst


@dataclass(frozen=True)
class Distances:
    """How close parts come; infinite beyond ``reach`` [m].

    between   least distance [m] of parts that no edge joins, and the time it is seen
    obstacles least distance [m] of a vertex from an obstacle, negative inside
    crossing  frames in which faces pass through each other
    """

    reach: float
    between: float
    obstacles: float
    crossing: int


def distances(setup: RibbonSetup, simulation: RibbonSimulation) -> Distances:
    """Looked for in every frame, by the detection of the collision response."""
    bodies = setup.scene.bodies
    reach = setup.scene.thickness or _NEAR * min(body.ribbon.width for body in bodies)
    # Somewhat further than the thickness, which is what resting parts have between them.
    strips = tuple(strip_of(body, 1.5 * reach) for body in bodies)
    collider = Collider(strips, setup.scene.obstacles)
    moving = tuple(Moving(obstacle) for obstacle in setup.scene.obstacles)
    between, gap, crossing = np.inf, np.inf, 0
    for frame in range(len(simulation.times)):
        x = np.concatenate(vertices_at(setup, simulation, frame))
        detector = Detector(collider.bodies, x, x, moving)
        between = min(between, detector.smallest_separation(x))
        gap = min(gap, detector.smallest_gap(x))
        crossing += bool(len(collider.crossings(x)))
    return Distances(1.5 * reach, between, gap, crossing)


def vertices_at(setup: RibbonSetup, simulation: RibbonSimulation, frame: int) -> list[FloatArray]:
    """(V,3) [m] of every ribbon."""
    return [
        to_vertices(track.bottom[frame], track.top[frame], strip_ends(body))
        for body, track in zip(setup.scene.bodies, simulation.tracks)
    ]


def total_energy(simulation: RibbonSimulation) -> FloatArray:
    """(F,4) [J] of all ribbons: kinetic, elastic, weight, and their sum."""
    parts = simulation.energies.sum(axis=1)
    return np.column_stack([parts, parts.sum(axis=1)])


def record_of(setup: RibbonSetup, simulation: RibbonSimulation, seconds: float) -> dict[str, Any]:
    """What ribbon.json says; numbers that are not finite become null."""
    steps = slice(1, None)
    found = distances(setup, simulation)
    isometry = [isometry_error(track) for track in simulation.tracks]
    energy = total_energy(simulation)
    words = ("kinetic", "elastic", "weight", "total")
    record: dict[str, Any] = {
        "status": str(simulation.status),
        "advice": _ADVICE[simulation.status],
        "message": simulation.message,
        "scene": setup.name,
        "seconds": seconds,
        "time": float(simulation.times[-1]),
        "frames": len(simulation.times),
        "ribbons": [_ribbon(track, error) for track, error in zip(simulation.tracks, isometry)],
        "inner_iterations": _spread(simulation.inner[steps]),
        "outer_iterations": _spread(simulation.outer[steps]),
        "seconds_per_step": _spread(simulation.seconds[steps]),
        "steps_made_in_parts": int(np.sum(simulation.parts > 1)),
        "constraint_violation": float(simulation.violation.max()),
        "residual": float(simulation.residual.max()),
        "isometry_error": float(max(error.max() for error in isometry)),
        "smallest_distance": found.between,
        "smallest_gap_to_obstacles": found.obstacles,
        "distances_up_to": found.reach,
        "frames_with_crossings": found.crossing,
        "energies": {
            name: {"first": first, "last": last, "largest": most}
            for name, first, last, most in zip(
                words, *(row.tolist() for row in (energy[0], energy[-1], energy.max(axis=0)))
            )
        },
        "settings": settings_of(setup),
    }
    record["notes"] = notes_on(record)
    plain: dict[str, Any] = _plain(record)
    return plain


def notes_on(record: Mapping[str, Any]) -> list[str]:
    """What somebody who reads only the status should know besides."""
    notes = []
    if record["isometry_error"] > _STRETCHED:
        notes.append(
            f"lengths were off by {100.0 * record['isometry_error']:.1g} % somewhere: a collision pushed "
            "parts out of the developable shape; a shorter step or a smaller thickness leaves less"
        )
    if record["frames_with_crossings"]:
        notes.append(
            "strips pass through each other or themselves: set a thickness, or shorten the step"
        )
    return notes


def settings_of(setup: RibbonSetup) -> dict[str, Any]:
    """What decides the frames, beside the scene itself."""
    rule = setup.rule
    return {
        "step": setup.step,
        "solver": rule.solver,
        "resample": rule.interpolant,
        "mass": rule.mass,
        "form": rule.kinetics,
        "gravity": np.asarray(setup.scene.gravity).tolist(),
        "thickness": float(setup.scene.thickness),
        "up": list(setup.up),
    }


def _ribbon(track: Track, error: FloatArray) -> dict[str, Any]:
    ribbon = track.ribbon
    numbers = ("length", "width", "segments", "stiffness", "density", "ends", "energy")
    return {
        "name": track.name,
        **{key: getattr(ribbon, key) for key in numbers},
        "isometry_error": float(error.max()),
    }


def _spread(values: FloatArray) -> dict[str, float] | None:
    return {"mean": float(values.mean()), "largest": float(values.max())} if values.size else None


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
