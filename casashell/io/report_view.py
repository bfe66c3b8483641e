"""Data of the report's 3-D view: meshes, maps and arrows, packed as JSON with base64 arrays."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from casashell.io.camera import directions
from casashell.io.colours import (
    NATURAL,
    OBSTACLE,
    PINNED,
    SHELL,
    TOO_MUCH,
    ColourMap,
    bending_map,
    friction_map,
    stretch_map,
)
from casashell.io.forces import BEYOND, force_arrows
from casashell.io.packing import pack
from casashell.io.placing import placed
from casashell.io.tessellate import Region, Surface, cropped, sunk, tessellate, thinned
from casashell.result import Result
from casashell.strain import Strain, strain
from casashell.typing import AnyArray, FloatArray

# Limits that keep the file below about 8 MB, plotly.js included (5 MB of it).
SHELL_FACES: Final = 30_000
OBSTACLE_FACES: Final = 20_000
ARROWS: Final = 1_000
_EDGED_FACES: Final = 15_000
_SIDES: Final = 6
#: How far obstacles are drawn below their surface, relative to the radius of what is shown.
SUNK: Final = 0.004


def view_data(result: Result, up: Sequence[float]) -> tuple[str, tuple[str, ...]]:
    """JSON for the view, and remarks on what it leaves out.  The natural shape must be finite."""
    target = result.target
    surface, ids = thinned(Surface(target.vertices, target.faces), SHELL_FACES)
    measured = strain(target, result.rest)
    natural = placed(target, result.rest)[ids]
    region = Region.around(target.vertices[ids], natural, scale=1.3)
    remarks = []
    if len(surface.faces) < len(target.faces):
        remarks.append(
            f"The 3-D view shows {len(surface.faces)} of {len(target.faces)} triangles; "
            "all numbers are of the full mesh."
        )
    obstacles, coarse = _obstacles(result, region)
    if coarse:
        remarks.append("Obstacles are simplified and cut off around the shell in the 3-D view.")
    arrows, some = _arrows(result)
    if some:
        remarks.append(
            f"The 3-D view shows the {ARROWS} largest of {len(result.contacts)} contact forces."
        )
    right, axis, front = directions(up)
    data = {
        "shell": _shell(surface, ids, natural, measured),
        "edges": pack(target.edges) if len(target.faces) <= _EDGED_FACES else None,
        "rims": [pack(target.vertices[np.append(loop, loop[0])]) for loop in _rims(result)],
        "obstacles": obstacles,
        "arrows": arrows,
        "pinned": pack(target.vertices[result.pinned]),
        "maps": {
            "stretch": _map(stretch_map(measured.stretch_vertices), 100.0),
            "bend": _map(bending_map(measured.bend_vertices), math.degrees(1.0)),
            "use": _map(friction_map(np.zeros(0)), 100.0),
        },
        "colours": {
            "shell": SHELL,
            "natural": NATURAL,
            "obstacle": OBSTACLE,
            "pinned": PINNED,
            "beyond": TOO_MUCH,
        },
        "box": _box(target.vertices[ids], natural, arrows["points"]),
        "up": [float(value) for value in axis],
        "eye": [float(value) for value in 0.45 * right + 0.25 * axis + 0.85 * front],
    }
    data["arrows"] = {**arrows, "points": pack(arrows["points"])}
    return json.dumps(data, allow_nan=False, separators=(",", ":")), tuple(remarks)


def _shell(
    surface: Surface, ids: AnyArray, natural: FloatArray, measured: Strain
) -> dict[str, Any]:
    return {
        "target": pack(surface.vertices),
        "natural": pack(natural),
        "faces": pack(surface.faces),
        "ids": pack(ids),
        "stretch": pack(100.0 * measured.stretch_vertices[ids]),
        "bend": pack(np.degrees(measured.bend_vertices[ids])),
    }


def _rims(result: Result) -> tuple[AnyArray, ...]:
    """Boundary curves, unless there are so many that they would not read."""
    loops = result.target.boundary_loops
    return tuple(loops) if sum(len(loop) for loop in loops) <= 20_000 else ()


def _obstacles(result: Result, region: Region) -> tuple[list[dict[str, Any]], bool]:
    """Surfaces to draw, cut to the region and thinned when large; whether any was."""
    drawn, coarse = [], False
    share = OBSTACLE_FACES // max(len(result.obstacles), 1)
    for number, obstacle in enumerate(result.obstacles):
        whole = tessellate(obstacle, region)
        part = cropped(whole, region) if len(whole.faces) > share else whole
        part, _ = thinned(part, share)
        part = sunk(part, SUNK * region.radius)
        coarse = coarse or len(part.faces) < len(whole.faces)
        if len(part.faces):
            name = obstacle.name or f"obstacle {number}"
            drawn.append({"name": name, "points": pack(part.vertices), "faces": pack(part.faces)})
    return drawn, coarse


def _arrows(result: Result) -> tuple[dict[str, Any], bool]:
    """Arrows, one block of triangles per contact; whether some contacts are left out."""
    size = np.linalg.norm(result.contact_forces, axis=1)
    chosen = np.sort(np.argsort(-size, kind="stable")[:ARROWS])
    drawn = force_arrows(result, chosen, _SIDES)
    count = max(len(chosen), 1)
    forces, contacts = result.contact_forces[chosen], result.contacts
    normal = np.einsum("ij,ij->i", forces, contacts.normals[chosen])
    tangential = np.linalg.norm(forces - normal[:, None] * contacts.normals[chosen], axis=1)
    packed = {
        "points": drawn.surface.vertices,
        "faces": pack(drawn.surface.faces),
        "perArrow": len(drawn.surface.vertices) // count,
        "facesPerArrow": len(drawn.surface.faces) // count,
        # JSON and WebGL know no infinity: a contact that pulls is simply far beyond its cone.
        "use": pack(np.minimum(100.0 * drawn.use, 1e6)),
        "limit": 100.0 * BEYOND,
        "vertices": pack(contacts.vertices[chosen]),
        "normal": pack(normal),
        "tangential": pack(tangential),
        "friction": pack(contacts.friction[chosen]),
        "gap": pack(contacts.gaps[chosen]),
        "legend": drawn.legend,
    }
    return packed, len(chosen) < len(result.contacts)


def _map(colours: ColourMap, factor: float) -> dict[str, Any]:
    return {
        "low": colours.low * factor,
        "high": colours.high * factor,
        "scale": [[place, colour] for place, colour in colours.css()],
    }


def _box(*clouds: FloatArray) -> list[list[float]]:
    """Axis ranges around all points, a little larger: what lies beyond is not drawn."""
    points = np.concatenate(clouds)
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.06 * float(np.linalg.norm(high - low))
    return [[float(a - margin), float(b + margin)] for a, b in zip(low, high)]
