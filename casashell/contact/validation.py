"""Checks of what a user hands to an obstacle: points, directions, lengths, friction."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from casashell.typing import AnyArray, ArrayLike, FloatArray

Vector3: TypeAlias = tuple[float, float, float]


def point3(value: ArrayLike, what: str) -> Vector3:
    """Three finite floats [m]; ``what`` names the parameter in the ValueError."""
    array = _floats(value, what)
    if array.shape != (3,):
        raise ValueError(f"{what} must be three numbers, got shape {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{what} must be finite, got {array.tolist()}")
    x, y, z = array.tolist()
    return (x, y, z)


def direction3(value: ArrayLike, what: str) -> tuple[Vector3, float]:
    """Unit vector along ``value`` and the length of ``value``; ValueError if that is zero."""
    vector = point3(value, what)
    largest = max(map(abs, vector))
    if largest == 0.0:
        raise ValueError(
            f"{what} is the zero vector and has no direction; give for example (0, 1, 0)"
        )
    # scaled first: squares of 1e-200 or 1e200 would leave the range of floats
    scaled = [component / largest for component in vector]
    length = math.hypot(*scaled)
    x, y, z = (component / length for component in scaled)
    return (x, y, z), largest * length


def number1(value: float, what: str) -> float:
    """One finite float."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise ValueError(f"{what} must be a number, got {value!r}") from None
    if not math.isfinite(number):
        raise ValueError(f"{what} must be finite, got {value!r}")
    return number


def positive(value: float, what: str) -> float:
    """Finite float above zero."""
    number = number1(value, what)
    if number <= 0.0:
        raise ValueError(f"{what} must be a positive number, got {value!r}")
    return number


def friction_coefficient(value: float, owner: str) -> float:
    """Finite Coulomb coefficient, zero or more."""
    number = number1(value, f"{owner} friction")
    if number < 0.0:
        raise ValueError(f"{owner} friction must be zero or more, got {value!r}")
    return number


def points3(value: ArrayLike, what: str = "points", row: str = "vertex") -> FloatArray:
    """Finite float64 array (N, 3), C-contiguous; the ValueError names the first bad ``row``."""
    array = _floats(value, what)
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"{what} must have shape (N, 3), got {array.shape}")
    bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
    if bad.size:
        first = int(bad[0])
        raise ValueError(
            f"{what}: {row} {first} is not finite, {array[first].tolist()} "
            f"({bad.size} such rows); remove it or repair the file"
        )
    return np.ascontiguousarray(array)


def indices(value: ArrayLike, count: int, what: str) -> AnyArray:
    """Flat int64 array of vertex ids in [0, count)."""
    array = np.asarray(value)
    if array.size == 0:
        return np.zeros(0, dtype=np.int64)
    if array.dtype.kind not in "iu":
        raise ValueError(f"{what} must be integer vertex ids, got values of type {array.dtype}")
    flat = array.astype(np.int64).reshape(-1)
    bad = flat[(flat < 0) | (flat >= count)]
    if bad.size:
        raise ValueError(f"{what} names vertex {int(bad[0])}; ids run from 0 to {count - 1}")
    return flat


def _floats(value: ArrayLike, what: str) -> FloatArray:
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{what} must be numbers: {error}") from None
