"""One camera for all pictures of a result: framed on the shell, not on what it rests on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from casashell.typing import FloatArray

_VIEW_ANGLE: Final = math.radians(22.0)
_MARGIN: Final = 1.10


@dataclass(frozen=True, eq=False)
class Camera:
    """Perspective camera.

    position, focus, up   (3,) m
    aspect                width / height of a picture that fits what was framed, 0.6 .. 2
    size                  m, height of the picture at the focus
    """

    position: FloatArray
    focus: FloatArray
    up: FloatArray
    aspect: float
    size: float

    @property
    def view_angle(self) -> float:
        """Vertical opening angle in degrees."""
        return math.degrees(_VIEW_ANGLE)


def directions(up: Sequence[float]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Unit vectors (right, up, front) of the scene; ValueError unless ``up`` has a direction.

    Front is where garments face by custom: +z when y is up, -y when z is up, +y when x is up.
    """
    axis = np.asarray(up, dtype=np.float64)
    if axis.shape != (3,) or not np.all(np.isfinite(axis)) or not axis.any():
        raise ValueError(f"up must be three numbers, not all zero, got {tuple(up)}")
    axis = axis / np.abs(axis).max()  # the squares of tiny and huge numbers leave the range
    axis = axis / np.linalg.norm(axis)
    customs = {0: (0.0, 1.0, 0.0), 1: (0.0, 0.0, 1.0), 2: (0.0, -1.0, 0.0)}
    front = np.array(customs[int(np.argmax(np.abs(axis)))])
    front = front - (front @ axis) * axis
    front = front / np.linalg.norm(front)
    return np.cross(axis, front), axis, front


def framed(
    *clouds: FloatArray, up: Sequence[float], azimuth: float = 28.0, elevation: float = 14.0
) -> Camera:
    """Camera that sees all points of the clouds (n,3), turned by the angles [degrees]."""
    right, axis, front = directions(up)
    turn, lift = math.radians(azimuth), math.radians(elevation)
    level = math.cos(turn) * front + math.sin(turn) * right
    toward = math.cos(lift) * level + math.sin(lift) * axis
    across = np.cross(axis, toward)
    across /= np.linalg.norm(across)
    frame = np.stack([across, np.cross(toward, across), toward])
    points = np.concatenate(clouds) @ frame.T
    low, high = points.min(axis=0), points.max(axis=0)
    width, height = np.maximum(high - low, 1e-9 + 1e-3 * np.max(high - low))[:2] * _MARGIN
    aspect = float(np.clip(width / height, 0.6, 2.0))
    center = 0.5 * (low + high)
    # Far enough that every point falls inside the opening angle, nearer points needing more room.
    slope = math.tan(0.5 * _VIEW_ANGLE)
    x, y, z = (points - center).T * np.array([[_MARGIN], [_MARGIN], [1.0]])
    reach = np.maximum(np.abs(x) / (slope * aspect), np.abs(y) / slope)
    distance = float((reach + z).max(initial=0.0)) or 1.0
    focus = center @ frame
    return Camera(focus + distance * toward, focus, axis, aspect, 2 * slope * distance)
