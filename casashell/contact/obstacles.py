"""Rigid obstacles given by an exact signed distance.

    d(x)  signed Euclidean distance from x to the surface [m], negative inside the obstacle
    n(x)  grad d(x), unit, pointing out of the obstacle

Analytic shapes are reduced to their half-plane (s, rho), s along the axis and rho >= 0 away from
it.  Where d has a kink (an edge, the medial axis) n is one of the one-sided gradients; where no
gradient exists at all (the centre of a sphere) it is a fixed unit vector.  It is never NaN.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np

from casashell.contact.mesh_obstacle import MeshObstacle
from casashell.contact.validation import (
    Vector3,
    direction3,
    friction_coefficient,
    number1,
    point3,
    points3,
    positive,
)
from casashell.typing import ArrayLike, FloatArray

__all__ = ["Capsule", "Cone", "Cylinder", "MeshObstacle", "Obstacle", "Plane", "Sphere", "checked"]

Box: TypeAlias = tuple[FloatArray, FloatArray]

#: relative distance from an axis below which its direction is rounding noise
_ON_AXIS = 1e-12


@runtime_checkable
class Obstacle(Protocol):
    """What contact detection asks of an obstacle; write your own by offering these four.

    friction         Coulomb coefficient, finite, zero or more
    name             label for reports, may be empty
    signed_distance  points (N, 3) m -> distance (N,) m, negative inside; normal (N, 3), the unit
                     gradient of the distance, which points out of the obstacle
    bounding_box     (lower, upper) corners, each (3,) m, of a box around the obstacle; every point
                     outside it must have a distance of at least that to the box.  None when there
                     is no such box (a half-space)
    """

    @property
    def friction(self) -> float: ...

    @property
    def name(self) -> str: ...

    def signed_distance(self, points: ArrayLike) -> tuple[FloatArray, FloatArray]: ...

    def bounding_box(self) -> Box | None: ...


def checked(obstacles: Iterable[Obstacle]) -> tuple[Obstacle, ...]:
    """The obstacles as a tuple; ValueError naming the first entry that is none."""
    if isinstance(obstacles, Obstacle):
        raise ValueError(f"obstacles must be a list, got one {type(obstacles).__name__}; add [ ]")
    entries = tuple(obstacles)
    for number, entry in enumerate(entries):
        if not isinstance(entry, Obstacle):
            raise ValueError(
                f"obstacle {number} is a {type(entry).__name__} without friction, name, "
                "signed_distance and bounding_box; a mesh becomes one by MeshObstacle(mesh)"
            )
        friction_coefficient(entry.friction, f"obstacle {number}")
    return entries


@dataclass(frozen=True)
class Plane:
    """Half-space obstacle; the shell lives where ``normal . x >= offset``.

    normal  any non-zero vector; stored as a unit vector, ``offset`` divided by its length
    offset  m when ``normal`` is a unit vector
    """

    normal: Vector3
    offset: float = 0.0
    friction: float = 0.5
    name: str = ""

    def __post_init__(self) -> None:
        normal, length = direction3(self.normal, "Plane normal")
        offset = number1(number1(self.offset, "Plane offset") / length, "Plane offset / |normal|")
        object.__setattr__(self, "normal", normal)
        object.__setattr__(self, "offset", offset)
        object.__setattr__(self, "friction", friction_coefficient(self.friction, "Plane"))

    def signed_distance(self, points: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Distance (N,) m and normal (N, 3) at points (N, 3)."""
        x = points3(points)
        normal = np.array(self.normal)
        return x @ normal - self.offset, np.tile(normal, (len(x), 1))

    def bounding_box(self) -> Box | None:
        """None: a half-space is unbounded."""
        return None


@dataclass(frozen=True)
class Sphere:
    """Solid ball; center and radius in m."""

    center: Vector3
    radius: float
    friction: float = 0.5
    name: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", point3(self.center, "Sphere center"))
        object.__setattr__(self, "radius", positive(self.radius, "Sphere radius"))
        object.__setattr__(self, "friction", friction_coefficient(self.friction, "Sphere"))

    def signed_distance(self, points: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Distance (N,) m and normal (N, 3) at points (N, 3); +z at the centre."""
        arm = points3(points) - np.array(self.center)
        length = np.linalg.norm(arm, axis=1)
        return length - self.radius, _unit_or(arm, length, np.array([0.0, 0.0, 1.0]))

    def bounding_box(self) -> Box | None:
        """Tight box around the ball."""
        center = np.array(self.center)
        return center - self.radius, center + self.radius


@dataclass(frozen=True)
class Cylinder:
    """Solid cylinder with flat caps.

    base    point on the axis: the centre of the first cap [m]
    axis    direction from the first cap to the second, any length but zero (stored as unit)
    radius  m
    length  m between the caps; None: infinite in both directions
    """

    base: Vector3
    axis: Vector3
    radius: float
    length: float | None = None
    friction: float = 0.5
    name: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "base", point3(self.base, "Cylinder base"))
        object.__setattr__(self, "axis", direction3(self.axis, "Cylinder axis")[0])
        object.__setattr__(self, "radius", positive(self.radius, "Cylinder radius"))
        if self.length is not None:
            object.__setattr__(self, "length", positive(self.length, "Cylinder length"))
        object.__setattr__(self, "friction", friction_coefficient(self.friction, "Cylinder"))

    def signed_distance(self, points: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Distance (N,) m and normal (N, 3) at points (N, 3)."""
        axis = np.array(self.axis)
        s, rho, radial = _half_plane(points3(points), np.array(self.base), axis)
        side = rho - self.radius
        if self.length is None:
            return side, radial
        half = 0.5 * self.length
        cap = np.abs(s - half) - half
        along = np.where(s < half, -1.0, 1.0)
        beyond = np.hypot(np.maximum(side, 0.0), np.maximum(cap, 0.0))
        distance = np.where(beyond > 0.0, beyond, np.maximum(side, cap))
        scale = np.where(beyond > 0.0, beyond, 1.0)
        weight_side = np.where(beyond > 0.0, np.maximum(side, 0.0) / scale, side >= cap)
        weight_cap = np.where(beyond > 0.0, np.maximum(cap, 0.0) / scale, side < cap)
        normal = weight_side[:, None] * radial + (weight_cap * along)[:, None] * axis
        return distance, normal

    def bounding_box(self) -> Box | None:
        """Tight box around the two caps; None when infinite."""
        if self.length is None:
            return None
        base, axis = np.array(self.base), np.array(self.axis)
        first = _disc_box(base, axis, self.radius)
        second = _disc_box(base + self.length * axis, axis, self.radius)
        return np.minimum(first[0], second[0]), np.maximum(first[1], second[1])


@dataclass(frozen=True)
class Cone:
    """Solid circular cone.

    apex        m
    axis        direction from the apex towards the base, any length but zero (stored as unit)
    half_angle  rad between axis and side, strictly between 0 and pi/2
    length      m along the axis from the apex to the flat base; None: infinite
    """

    apex: Vector3
    axis: Vector3
    half_angle: float
    length: float | None = None
    friction: float = 0.5
    name: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "apex", point3(self.apex, "Cone apex"))
        object.__setattr__(self, "axis", direction3(self.axis, "Cone axis")[0])
        angle = positive(self.half_angle, "Cone half_angle")
        if angle >= 0.5 * math.pi:
            raise ValueError(
                f"Cone half_angle must be below pi/2 rad, got {self.half_angle!r} (degrees?)"
            )
        object.__setattr__(self, "half_angle", angle)
        if self.length is not None:
            object.__setattr__(self, "length", positive(self.length, "Cone length"))
        object.__setattr__(self, "friction", friction_coefficient(self.friction, "Cone"))

    def signed_distance(self, points: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Distance (N,) m and normal (N, 3) at points (N, 3); ``-axis`` at the apex."""
        apex, axis = np.array(self.apex), np.array(self.axis)
        x = points3(points)
        s, rho, radial = _half_plane(x, apex, axis)
        c, sn = math.cos(self.half_angle), math.sin(self.half_angle)
        side = rho * c - s * sn
        slant = s * c + rho * sn
        last = math.inf if self.length is None else self.length / c
        # nearest point of the side, a segment from the apex (0, 0) to the rim (last c, last sn)
        foot = np.clip(slant, 0.0, last)
        on_side = (slant > 0.0) & (slant < last)
        ds, dr = s - foot * c, rho - foot * sn
        distance = np.where(on_side, np.abs(side), np.hypot(ds, dr))
        inside = side < 0.0
        if self.length is not None:
            cap = s - self.length
            inside &= cap < 0.0
            under_cap = (rho <= last * sn) & (np.abs(cap) < distance)
        else:
            cap = np.full_like(s, -math.inf)
            under_cap = np.zeros(len(s), dtype=bool)
        sign = np.where(inside, -1.0, 1.0)
        # at a corner the gradient is the direction from it, unless that is rounding noise
        noise = _ON_AXIS * (np.abs(x).max(axis=1, initial=0.0) + np.abs(apex).max())
        far = distance > noise
        scale = np.where(far, distance, 1.0)
        at_apex = slant <= 0.0
        corner_s = np.where(far, sign * ds / scale, np.where(at_apex, -1.0, -sn))
        corner_r = np.where(far, sign * dr / scale, np.where(at_apex, 0.0, c))
        g_s = np.where(under_cap, 1.0, np.where(on_side, -sn, corner_s))
        g_r = np.where(under_cap, 0.0, np.where(on_side, c, corner_r))
        distance = np.where(under_cap, np.abs(cap), distance)
        return sign * distance, g_s[:, None] * axis + g_r[:, None] * radial

    def bounding_box(self) -> Box | None:
        """Tight box around apex and base; None when infinite."""
        if self.length is None:
            return None
        apex, axis = np.array(self.apex), np.array(self.axis)
        radius = self.length * math.tan(self.half_angle)
        lower, upper = _disc_box(apex + self.length * axis, axis, radius)
        return np.minimum(apex, lower), np.maximum(apex, upper)


@dataclass(frozen=True)
class Capsule:
    """All points within ``radius`` of the segment from ``a`` to ``b`` [m]; a sphere when a == b."""

    a: Vector3
    b: Vector3
    radius: float
    friction: float = 0.5
    name: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "a", point3(self.a, "Capsule a"))
        object.__setattr__(self, "b", point3(self.b, "Capsule b"))
        object.__setattr__(self, "radius", positive(self.radius, "Capsule radius"))
        object.__setattr__(self, "friction", friction_coefficient(self.friction, "Capsule"))

    def signed_distance(self, points: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Distance (N,) m and normal (N, 3) at points (N, 3); across the axis on the segment."""
        x = points3(points)
        a, span = np.array(self.a), np.array(self.b) - np.array(self.a)
        length = float(np.linalg.norm(span))
        axis = span / length if length > 0.0 else np.array([1.0, 0.0, 0.0])
        s, rho, radial = _half_plane(x, a, axis)
        beyond = s - np.clip(s, 0.0, length)
        reach = np.hypot(beyond, rho)
        scale = np.where(reach > 0.0, reach, 1.0)
        g_s, g_r = beyond / scale, np.where(reach > 0.0, rho / scale, 1.0)
        return reach - self.radius, g_s[:, None] * axis + g_r[:, None] * radial

    def bounding_box(self) -> Box | None:
        """Tight box around the capsule."""
        ends = np.array([self.a, self.b])
        return ends.min(axis=0) - self.radius, ends.max(axis=0) + self.radius


def _half_plane(
    points: FloatArray, origin: FloatArray, axis: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Coordinate s (N,) along the axis, distance rho (N,) from it, unit radial direction (N, 3)."""
    arm = points - origin
    s = arm @ axis
    radial = arm - s[:, None] * axis
    radial -= (radial @ axis)[:, None] * axis
    rho = np.linalg.norm(radial, axis=1)
    size = np.abs(points).max(axis=1, initial=0.0) + np.abs(origin).max()
    on_axis = rho <= _ON_AXIS * size
    rho = np.where(on_axis, 0.0, rho)
    return s, rho, _unit_or(radial, rho, _across(axis))


def _unit_or(vectors: FloatArray, lengths: FloatArray, fallback: FloatArray) -> FloatArray:
    """vectors / lengths (N, 3), the fallback where the length is zero."""
    safe = np.where(lengths > 0.0, lengths, 1.0)
    unit: FloatArray = np.where(lengths[:, None] > 0.0, vectors / safe[:, None], fallback)
    return unit


def _across(axis: FloatArray) -> FloatArray:
    """A fixed unit vector perpendicular to the unit vector ``axis``."""
    helper = np.zeros(3)
    helper[np.argmin(np.abs(axis))] = 1.0
    across = np.cross(axis, helper)
    unit: FloatArray = across / np.linalg.norm(across)
    return unit


def _disc_box(center: FloatArray, axis: FloatArray, radius: float) -> Box:
    """Tight box of a disc with unit normal ``axis``."""
    reach = radius * np.sqrt(np.maximum(1.0 - axis**2, 0.0))
    return center - reach, center + reach
