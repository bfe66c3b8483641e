"""Where to draw a natural shape: its own place means nothing, for energies do not feel rigid motions."""

from __future__ import annotations

import numpy as np

from casashell.mesh import TriMesh, aligned
from casashell.typing import FloatArray


def placed(target: TriMesh, rest: FloatArray) -> FloatArray:
    """``rest`` (V,3) with every piece turned and shifted onto the target as well as it goes.

    Least squares over the vertices of a piece (Kabsch); no mirror images, no scaling.
    """
    made = rest.copy()
    count, labels = target.components
    for piece in range(count):
        ids = np.flatnonzero(labels == piece)
        made[ids] = aligned(rest[ids], target.vertices[ids])
    return made
