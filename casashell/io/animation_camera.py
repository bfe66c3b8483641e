"""One fixed camera that sees a whole motion."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from casashell.io.animation import Animation
from casashell.io.camera import Camera, framed
from casashell.typing import FloatArray

# A body up to this many times as large as all that moves is shown whole, a larger one cut off.
_WHOLE: Final = 1.3
_DIRECTIONS: Final = 128


def framing(animation: Animation) -> Camera:
    """Camera on everything that moves in any frame, and on the bodies that are not much larger."""
    shells = [track for track in animation.tracks if not track.body]
    clouds = [outermost(track.positions) for track in shells]
    if clouds:
        extent = _diagonal(np.concatenate(clouds))
        bodies = [outermost(track.positions) for track in animation.tracks if track.body]
        clouds += [cloud for cloud in bodies if _diagonal(cloud) <= _WHOLE * extent]
    else:
        clouds = [outermost(track.positions) for track in animation.tracks]
    return framed(*clouds, up=animation.up)


def outermost(positions: FloatArray) -> FloatArray:
    """The points of (F,V,3) that lie furthest out in some direction, over all frames.

    They stand for the convex hull of the motion: a few hundred points instead of millions.
    """
    # Directions evenly over the sphere (a Fibonacci spiral), and both ways along the axes.
    count = np.arange(_DIRECTIONS) + 0.5
    height = 1.0 - 2.0 * count / _DIRECTIONS
    around = math.pi * (1.0 + math.sqrt(5.0)) * count
    level = np.sqrt(1.0 - height**2)
    spiral = np.stack([np.cos(around) * level, np.sin(around) * level, height])
    directions = np.concatenate([spiral, np.eye(3), -np.eye(3)], axis=1)
    best: FloatArray = positions[0][np.argmax(positions[0] @ directions, axis=0)]
    if positions.strides[0] == 0:
        return best
    column = np.arange(directions.shape[1])
    reach = np.einsum("nc,cn->n", best, directions)
    for frame in positions[1:]:
        heights = frame @ directions
        winner = np.argmax(heights, axis=0)
        better = heights[winner, column] > reach
        best[better] = frame[winner[better]]
        reach[better] = heights[winner[better], column[better]]
    return best


def _diagonal(cloud: FloatArray) -> float:
    return float(np.linalg.norm(cloud.max(axis=0) - cloud.min(axis=0)))
