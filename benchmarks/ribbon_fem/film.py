"""Positions over time, what a step costs, and how far lengths and areas drift."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from benchmarks.ribbon_fem.body import Body
from benchmarks.ribbon_fem.implicit import State
from casashell.typing import FloatArray, IntArray


class Steps(Protocol):
    """A way to step a body."""

    body: Body

    def begin(self, x: FloatArray | None = None, v: FloatArray | None = None) -> State: ...

    def step(self, state: State, h: float) -> State: ...


@dataclass(frozen=True)
class Drift:
    """Largest relative error of an edge, |area / rest - 1| of the whole, and of the worst triangle."""

    length: float
    area: float
    triangle: float


@dataclass(frozen=True, eq=False)
class Film:
    """A run.

    times     (T,) [s];  nodes (T,n,3), surface (T,V,3) [m]
    elements  drift of the triangles themselves, a row (length, area, triangle) for each time (T,3)
    drawn     the same of the surface whose vertices have one place each (T,3)
    seconds   (T - 1,) a step;  iterations (T - 1,) Newton or projections a step
    moves     (T - 1,) last Newton move of a step in mean edges
    last      the last state, to go on from
    """

    times: FloatArray
    nodes: FloatArray
    surface: FloatArray
    elements: FloatArray
    drawn: FloatArray
    seconds: FloatArray
    iterations: IntArray
    moves: FloatArray
    last: State


def drift(body: Body, corners: FloatArray) -> Drift:
    """Drift of triangles with ``corners`` (F,3,3) from those of the flat sheet."""
    inside = ~body.patch.outside
    mesh = body.patch.mesh
    length, area = _measures(corners[inside])
    rest_length, rest_area = _measures(mesh.vertices[mesh.faces[inside]])
    return Drift(
        float(np.abs(length / rest_length - 1.0).max()),
        float(abs(area.sum() / rest_area.sum() - 1.0)),
        float(np.abs(area / rest_area - 1.0).max()),
    )


def _measures(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    sides = np.roll(corners, -1, axis=1) - corners
    normal = np.cross(sides[:, 0], sides[:, 1])
    return np.linalg.norm(sides, axis=2), 0.5 * np.linalg.norm(normal, axis=1)


def _row(body: Body, corners: FloatArray) -> tuple[float, float, float]:
    found = drift(body, corners)
    return found.length, found.area, found.triangle


def simulate(
    way: Steps,
    steps: int,
    h: float,
    *,
    start: State | None = None,
    watch: Callable[[State], None] | None = None,
) -> Film:
    """``steps`` steps of h [s] from ``start`` (flat and at rest by default).

    Raises StepFailed from a step that does not converge.
    """
    body = way.body
    state = way.begin() if start is None else start
    states, seconds = [state], []
    for _ in range(steps):
        begin = time.perf_counter()
        state = way.step(state, h)
        seconds.append(time.perf_counter() - begin)
        states.append(state)
        if watch is not None:
            watch(state)
    surface = np.stack([body.surface(s.x) for s in states])
    faces = body.patch.mesh.faces
    return Film(
        times=np.array([s.time for s in states]),
        nodes=np.stack([s.x for s in states]),
        surface=surface,
        elements=np.array([_row(body, body.corners(s.x)) for s in states]),
        drawn=np.array([_row(body, vertices[faces]) for vertices in surface]),
        seconds=np.array(seconds),
        iterations=np.array([s.iterations for s in states[1:]], dtype=np.int64),
        moves=np.array([s.move for s in states[1:]]),
        last=state,
    )
