"""Ribbon shapes for the collision tests: rims, placed strips, linking numbers."""

from __future__ import annotations

import numpy as np

from casashell.ribbon.strips import Ends, Strip, ribbon_strip, to_vertices
from casashell.typing import FloatArray

THICKNESS = 2e-3
Placed = tuple[Strip, FloatArray]


def turn(axis: tuple[float, float, float], angle: float) -> FloatArray:
    """Rotation matrix (3,3) by Rodrigues' formula."""
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    result: FloatArray = np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * (k @ k)
    return result


def flat(
    segments: int = 10,
    length: float = 0.5,
    width: float = 0.06,
    place: tuple[float, float, float] = (0.0, 0.0, 0.0),
    rotation: FloatArray | None = None,
    pinned: tuple[int, ...] = (),
) -> Placed:
    """A flat strip of 10 g along x, middle at ``place``, turned about it."""
    s = np.linspace(-0.5 * length, 0.5 * length, segments + 1)[:, None]
    along, across = s * np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.5 * width, 0.0])
    r = np.eye(3) if rotation is None else rotation
    bottom, top = ((p @ r.T) + place for p in (along - across, along + across))
    strip = ribbon_strip(bottom, top, mass=0.01, thickness=THICKNESS, pinned=pinned)
    return strip, to_vertices(bottom, top)


def ring(
    center: tuple[float, float, float],
    upright: bool,
    segments: int = 20,
    radius: float = 0.05,
    width: float = 0.015,
    ends: Ends = "loop",
) -> Placed:
    """A closed band around the z axis, or around y when upright."""
    angle = np.linspace(0.0, 2.0 * np.pi, segments + 1)
    second = np.array([0.0, 0.0, 1.0] if upright else [0.0, 1.0, 0.0])
    axis = np.cross([1.0, 0.0, 0.0], second)
    middle = radius * (np.cos(angle)[:, None] * [1.0, 0.0, 0.0] + np.sin(angle)[:, None] * second)
    bottom, top = (middle + side * 0.5 * width * axis + center for side in (-1.0, 1.0))
    strip = ribbon_strip(bottom, top, mass=0.005, thickness=THICKNESS, ends=ends)
    return strip, to_vertices(bottom, top, ends)


def linking(one: FloatArray, two: FloatArray) -> float:
    """Gauss linking number of two closed polygons (N,3), exact for straight edges.

    Sum of the signed solid angles of all pairs of edges over 4 pi (Klenin and Langowski 2000).
    """
    a, b = one[:, None], np.roll(one, -1, axis=0)[:, None]
    c, d = two[None], np.roll(two, -1, axis=0)[None]
    ac, ad, bc, bd = c - a, d - a, c - b, d - b
    faces = [np.cross(p, q) for p, q in ((ac, ad), (ad, bd), (bd, bc), (bc, ac))]
    units = [f / np.linalg.norm(f, axis=-1, keepdims=True) for f in faces]
    angle = sum(
        np.arcsin(np.clip(np.sum(p * q, axis=-1), -1.0, 1.0))
        for p, q in zip(units, units[1:] + units[:1])
    )
    sign = np.sign(np.sum(np.cross(b - a, d - c) * ac, axis=-1))
    return float((angle * sign).sum() / (4.0 * np.pi))
