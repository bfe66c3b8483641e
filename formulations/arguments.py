"""Checks of what a user passes to a formulation."""

from __future__ import annotations

import numpy as np

from casashell.typing import ArrayLike, FloatArray


def per_element(
    name: str, value: ArrayLike, count: int, element: str, *, minimum: float, strict: bool = False
) -> tuple[FloatArray, FloatArray]:
    """``value`` as given (scalar or (count,)) and spread over ``count`` elements.

    Raises ValueError naming the parameter and the element when the shape or a value is wrong.
    """
    given = np.array(value, dtype=np.float64)
    if given.ndim > 0 and given.shape != (count,):
        raise ValueError(
            f"{name} must be a number or one value per {element}, shape ({count},); "
            f"got shape {given.shape}"
        )
    spread = np.array(np.broadcast_to(given, (count,)))
    wrong = ~np.isfinite(spread) | (spread <= minimum if strict else spread < minimum)
    if given.ndim == 0 and not np.all(np.isfinite(given)):
        raise ValueError(f"{name} must be a finite number, got {float(given)}")
    if np.any(wrong):
        at = int(np.flatnonzero(wrong)[0])
        where = f" at {element} {at}" if given.ndim else ""
        bound = f"> {minimum:g}" if strict else f">= {minimum:g}"
        raise ValueError(f"{name}{where} must be finite and {bound}, got {spread[at]:g}")
    return given, spread


def finite_vector(name: str, value: ArrayLike) -> FloatArray:
    """``value`` as a finite vector of shape (3,), or ValueError."""
    vector = np.array(value, dtype=np.float64)
    if vector.shape != (3,) or not np.all(np.isfinite(vector)):
        raise ValueError(f"{name} must be three finite numbers, got {value!r}")
    return vector
