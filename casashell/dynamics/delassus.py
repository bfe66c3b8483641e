"""Contact alone: a linearised step reduced to the motions and forces of its touches.

u = W f + b      W (3C,3C) the Delassus operator, u (C,3) motions in the axes (N, T1, T2) of the
                 touches, the gap at the end of the step in place of the normal motion
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from casashell.contact.cone import tangents
from casashell.dynamics.linear import LinearStep
from casashell.dynamics.touch import Touches
from casashell.typing import FloatArray


@dataclass(frozen=True, eq=False)
class Delassus:
    """The operator at one linearisation.

    matrix  (3C,3C) m/N;  alone (C,3) m: motions without contact forces
    axes    (C,3,3) rows: normal and two tangents;  answers (3V,3C+1): displacements for unit forces,
            and for none
    """

    matrix: FloatArray
    alone: FloatArray
    axes: FloatArray
    answers: FloatArray

    def moved(self, local: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Change of the displacements (V,3) and forces (C,3) for forces (C,3) in the axes."""
        change = self.answers[:, :-1] @ local.ravel() + self.answers[:, -1]
        return change.reshape(-1, 3), np.einsum("cij,ci->cj", self.axes, local)


def reduce(linear: LinearStep, force: FloatArray, touches: Touches, d: FloatArray) -> Delassus:
    """The operator of the shell factored last, where the step without contact leaves forces (V,3)."""
    frame = np.stack([touches.normal, *tangents(touches.normal)], axis=1)
    rows = _rows(touches, frame, d.size)
    motion = np.einsum("cij,cj->ci", frame, touches.slips(d))
    motion[:, 0] = touches.gaps(d)
    answers = linear.push_shell(np.column_stack([rows.T.toarray(), -force.ravel()]))
    alone = motion + (rows @ answers[:, -1]).reshape(-1, 3)
    return Delassus(np.asarray(rows @ answers[:, :-1]), alone, frame, answers)


def _rows(touches: Touches, frame: FloatArray, size: int) -> sp.csr_array:
    """Matrix (3C,3V) from displacements to motions of the touches in their axes."""
    count = len(touches)
    column = np.repeat(3 * touches.vertex[:, None] + np.arange(3), 3, axis=0)
    row = np.repeat(np.arange(3 * count), 3)
    values = (frame.reshape(-1), (row, column.ravel()))
    return sp.csr_array(sp.coo_array(values, shape=(3 * count, size)))
