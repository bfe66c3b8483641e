"""Second-order check of an equilibrium of a ribbon."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import null_space

from casashell.ribbon.potential import Potential
from casashell.ribbon.ribbon import RibbonState
from casashell.typing import FloatArray

#: A bound or inequality closer than this is taken to hold with equality: Ipopt keeps some 1e-9 over its
#: multiplier away from one.
ACTIVE = 1e-6
#: Curvature over D W / l, which is that of one angle, below which the energy is as good as level:
#: solvers cannot follow it, and rulings where a ribbon is nearly straight cost no more than that.
NEUTRAL = 1e-8
#: The same over the highest curvature: what rounding leaves.
ROUNDING = 1e-13


@dataclass(frozen=True)
class Stability:
    """Extreme eigenvalues of the Hessian of the Lagrangian on the free directions, over D W / l.

    lowest, highest  of slopes c, angles and the frame, orthogonal to all conditions that are active
    free             number of free directions
    direction        (n,) where the energy falls fastest, or rises most slowly
    """

    lowest: float
    highest: float
    free: int
    direction: FloatArray = field(repr=False)

    @property
    def neutral(self) -> float:
        """Curvature that counts as zero."""
        return NEUTRAL + ROUNDING * self.highest

    @property
    def stable(self) -> bool:
        """No direction along which the energy falls, beyond `neutral` ones."""
        return self.free == 0 or self.lowest >= -self.neutral

    @property
    def strict(self) -> bool:
        """The energy rises in every direction, beyond `neutral` ones."""
        return self.free == 0 or self.lowest > self.neutral

    def __str__(self) -> str:
        word = "stable" if self.strict else "neutral" if self.stable else "unstable"
        return f"{word}, curvature {self.lowest:.2e} .. {self.highest:.2e} D W / l"


def stability(potential: Potential, state: RibbonState, multipliers: FloatArray) -> Stability:
    """Of ``state`` under ``potential``; ``multipliers`` (m,) belong to its conditions."""
    space = potential.coordinates
    z = space.pack(state)
    hessian = potential.hessian(z, multipliers)
    matrix, bound = potential.matrix, potential.bound
    held = [potential.equalities(z)[1], matrix[bound - matrix @ z < ACTIVE]]
    stuck = np.minimum(z - space.lower, space.upper - z) < ACTIVE
    held.append(np.eye(len(z))[stuck])
    rows = np.concatenate(held)
    basis = null_space(rows, rcond=1e-10) if len(rows) else np.eye(len(z))
    if basis.shape[1] == 0:
        return Stability(np.inf, np.inf, 0, np.zeros(len(z)))
    values, vectors = np.linalg.eigh(basis.T @ hessian @ basis)
    highest = float(np.abs(values).max())
    return Stability(float(values[0]), highest, basis.shape[1], basis @ vectors[:, 0])
