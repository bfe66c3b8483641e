"""Guesses about a scene that is well-formed but probably not what was meant.

Wrong units and axes are the commonest mistakes with mesh files, and no solver can tell.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from casashell.app.scene import Scene
from casashell.app.values import UNITS, UP_VECTORS, unit_name
from casashell.contact.mesh_obstacle import MeshObstacle
from casashell.io.camera import directions
from casashell.typing import FloatArray

#: Sizes (bounding box diagonal, m) that things people wear, read and hang have.
SMALLEST, LARGEST = 0.05, 5.0
_USUAL: Final = 0.8
#: Contact tolerance, relative to the shell's size, that is hardly meant.
_WIDE: Final = 0.1


def hints(scene: Scene) -> tuple[str, ...]:
    """Sentences, each with what to try; empty for a scene that looks right."""
    return (*size_hints(scene), *_placement(scene), *_contact(scene))


def size_hints(scene: Scene) -> Iterator[str]:
    """A wrong unit; works on a mesh with faults too."""
    size = scene.target.bbox_diagonal
    if SMALLEST <= size <= LARGEST:
        return
    raw = size / scene.unit
    fitting = {n: raw * u for n, u in UNITS.items() if SMALLEST <= raw * u <= LARGEST}
    guess = ""
    if fitting:
        name = min(fitting, key=lambda n: abs(np.log(fitting[n] / _USUAL)))
        guess = f"; with --unit {name} it would be {fitting[name]:.2g} m"
    yield (
        f"the shell is {size:.3g} m across, which is {'large' if size > LARGEST else 'small'} "
        f"for unit {unit_name(scene.unit)}{guess}"
    )


def _placement(scene: Scene) -> Iterator[str]:
    lower, upper = scene.target.vertices.min(axis=0), scene.target.vertices.max(axis=0)
    up = directions(scene.up_vector)[1]
    for number, obstacle in enumerate(scene.obstacles):
        label = obstacle.name or f"obstacle {number + 1}"
        if isinstance(obstacle, MeshObstacle):
            points = obstacle.surface.vertices
            extent, slack = (points.min(axis=0), points.max(axis=0)), 1e-9 * (upper - lower).max()
            if np.allclose(extent, (lower, upper), rtol=0.0, atol=slack):
                yield f"'{label}' has the very extent of the shell: is it the same file by mistake?"
                continue
        box = obstacle.bounding_box()
        if box is None:
            continue
        gap = float(np.linalg.norm(np.maximum(np.maximum(box[0] - upper, lower - box[1]), 0.0)))
        if gap > scene.problem.tolerance:
            yield (
                f"shell and '{label}' are {gap:.3g} m apart: are both files in the same unit "
                "and the same axes?"
            )
        elif float(np.max(scene.target.vertices @ up)) < _lowest(box, up):
            yield f"the whole shell is below '{label}' along the up axis: is --up right?"


def _contact(scene: Scene) -> Iterator[str]:
    contacts = scene.problem.contacts
    if not len(contacts) and not scene.pinned:
        yield "nothing holds the shell: no vertex touches an obstacle and none is pinned"
    if not scene.obstacles:
        return
    inside = len(np.unique(contacts.vertices[contacts.gaps < -scene.problem.tolerance]))
    count = len(scene.target.vertices)
    if inside > 0.1 * count:
        yield (
            f"{inside} of {count} vertices are deep inside an obstacle: is it inside out (flip in "
            "a scene file), in another unit, or is a plane's normal pointing down?"
        )
    tolerance = scene.problem.tolerance / scene.target.bbox_diagonal
    if len(contacts) and tolerance > _WIDE:
        yield (
            f"the contact tolerance is {100.0 * tolerance:.0f} % of the shell's size: vertices far "
            "from an obstacle count as touching it; is --tolerance in input units?"
        )
    if len(contacts) == 0:
        points = scene.target.vertices
        nearest = min(float(each.signed_distance(points)[0].min()) for each in scene.obstacles)
        yield (
            f"no vertex touches an obstacle; the nearest is {nearest / scene.unit:.3g} away "
            f"(--tolerance is {scene.problem.tolerance / scene.unit:.3g}, in input units)"
        )
        return
    push = contacts.normals.mean(axis=0)
    up = directions(scene.up_vector)[1]
    axes = {axis: float(push @ np.array(vector)) for axis, vector in UP_VECTORS.items()}
    best = max(axes, key=lambda axis: axes[axis])
    if any(scene.gravity) and push @ up < 0.1 and axes[best] > 0.5:
        yield f"the contacts push along {best}, not against gravity: is it --up {best}?"


def _lowest(box: tuple[FloatArray, FloatArray], up: FloatArray) -> float:
    """Height of the lowest corner of a box."""
    return float(np.sum(np.where(up > 0.0, up * box[0], up * box[1])))
