"""Forward statics for the tests: from a natural shape to the pose it takes."""

from __future__ import annotations

import numpy as np

from casashell.engine.assembly import Assembly
from casashell.typing import BoolArray, FloatArray


def settle(
    assembly: Assembly, start: FloatArray, rest: FloatArray, free: BoolArray, *, steps: int = 200
) -> FloatArray:
    """Local minimum of the energy over the vertices ``free`` (V,), from the pose ``start``.

    Newton with a dense Hessian made positive definite by reflecting its eigenvalues, and halving of
    the step until the energy falls.  Raises RuntimeError when the forces do not vanish to rounding.
    """
    dofs = np.flatnonzero(np.repeat(free, 3))
    x, last = start.copy(), np.inf
    for _ in range(steps):
        gradient, entries = assembly.hessian(x, rest)
        matrix = assembly.pattern.matrix(entries).toarray()[np.ix_(dofs, dofs)]
        force = gradient.ravel()[dofs]
        size = float(np.abs(force).max())
        values, vectors = np.linalg.eigh(matrix)
        curvature = np.maximum(np.abs(values), 1e-9 * np.abs(values).max())
        if size <= 1e-12 * np.abs(gradient).max() or (last <= 1e-10 and size >= 0.5 * last):
            return x
        last = size
        step = np.zeros(x.size)
        step[dofs] = -vectors @ ((vectors.T @ force) / curvature)
        x = _shortened(assembly, x, rest, step.reshape(-1, 3), float(step[dofs] @ force))
    raise RuntimeError(f"forces of {size:.1e} N are left after {steps} steps")


def _shortened(
    assembly: Assembly, x: FloatArray, rest: FloatArray, step: FloatArray, slope: float
) -> FloatArray:
    """``x + t step`` with the first t = 1, 1/2, ... at which the energy falls enough."""
    energy = assembly.energy(x, rest)
    t = 1.0
    while t > 1e-6:
        new = assembly.energy(x + t * step, rest)
        if new <= energy + 1e-4 * t * slope + 1e-13 * abs(energy):
            return np.asarray(x + t * step)
        t /= 2.0
    return x
