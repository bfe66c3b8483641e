"""Arrays inside a page: base64 of little-endian numbers, with their type and number of columns."""

from __future__ import annotations

import base64
from typing import Any, Final

import numpy as np

from casashell.typing import AnyArray, FloatArray

#: Steps of `quantised` over the longest side of the box.
STEPS: Final = 65_534


def pack(values: AnyArray) -> dict[str, Any]:
    """Base64 of int16 and uint8 as they are, of other integers as int32, of the rest as float32."""
    narrow = {"int16": "i2", "uint8": "u1"}
    kind = narrow.get(values.dtype.name, "i4" if values.dtype.kind in "iu" else "f4")
    flat = np.ascontiguousarray(values, dtype=f"<{kind}")
    width = flat.shape[1] if flat.ndim == 2 else 1
    return {"t": kind, "w": width, "d": base64.b64encode(flat.tobytes()).decode("ascii")}


def quantised(points: FloatArray) -> dict[str, Any]:
    """Points (...,3) as int16 over their bounding cube, and the box to get them back.

    Off by half a step at most: ``step`` is the longest side over `STEPS`;
    ``point = center + step * integer``.
    """
    low = points.reshape(-1, 3).min(axis=0)
    high = points.reshape(-1, 3).max(axis=0)
    center = low + 0.5 * (high - low)
    step = float((high - low).max()) / STEPS or 1.0
    whole = np.empty(points.shape, dtype=np.int16)
    for frame, place in zip(points, whole):  # one frame at a time: no copy of all of them
        np.rint((frame - center) / step, out=place, casting="unsafe")
    return {**pack(whole.ravel()), "center": center.tolist(), "step": step}
