"""Hinge bending in plain NumPy, by the wings of the hinge instead of its normals."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from casashell.typing import AnyArray


def _cross(a: AnyArray, b: AnyArray) -> AnyArray:
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def _wings(x: AnyArray) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Unit edge and the parts of the two triangles orthogonal to it, for hinges x (4,3,S)."""
    edge, a, b = x[1] - x[0], x[2] - x[0], x[3] - x[0]
    edge = edge / np.sqrt((edge * edge).sum(axis=0))
    return edge, a - edge * (a * edge).sum(axis=0), b - edge * (b * edge).sum(axis=0)


def _fold(x: AnyArray) -> AnyArray:
    """Dihedral angle as pi minus the angle between the wings; complex-step safe atan2."""
    edge, a, b = _wings(x)
    cosine, sine = -(a * b).sum(axis=0), (_cross(b, a) * edge).sum(axis=0)
    turned = np.arctan2(sine.real, cosine.real)
    if not np.iscomplexobj(sine):
        return np.asarray(turned)
    slope = cosine.real * sine.imag - sine.real * cosine.imag
    return np.asarray(turned + 1j * slope / (sine.real**2 + cosine.real**2))


def reference(r: AnyArray, p: AnyArray) -> Callable[[AnyArray], AnyArray]:
    """The same energy in plain NumPy: r (4,3,S), p (1,S) -> function of x (4,3,S), complex allowed.

    Angle and area come from the wings of the hinge, not from its normals.
    """
    _, a, b = _wings(r)
    heights = np.sqrt((a * a).sum(axis=0)) + np.sqrt((b * b).sum(axis=0))
    length = np.sqrt(((r[1] - r[0]) ** 2).sum(axis=0))
    mean = 0.25 * length * heights
    return metric_reference(np.stack([_fold(r), length, mean, mean]), p)


def metric_reference(n: AnyArray, p: AnyArray) -> Callable[[AnyArray], AnyArray]:
    """The same from n (4,S): natural angle, length of the edge and the two areas."""
    return lambda x: 1.5 * p[0] * n[1] ** 2 / (n[2] + n[3]) * (_fold(x) - n[0]) ** 2
