"""Contacts of one ribbon as conditions of its step: the developable strip itself keeps them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casashell.ribbon.composite import Placed
from casashell.ribbon.conditions import table_rows
from casashell.typing import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Touch:
    """C conditions  sum_k pushes_k . x_k >= bounds  on rows of the station table, at most 4 each.

    rows    (C,4);  pushes (C,4,3): normal times weight, zero where a row is not used
    bounds  (C,) [m];  unit [m] in which a condition is told
    """

    rows: IntArray
    pushes: FloatArray
    bounds: FloatArray
    unit: float

    def __len__(self) -> int:
        return len(self.bounds)

    def values(self, table: FloatArray) -> FloatArray:
        """G (C,) <= 0."""
        held = np.einsum("cka,cka->c", self.pushes, table[self.rows])
        return np.asarray((self.bounds - held) / self.unit)

    def slopes(self, placed: Placed) -> FloatArray:
        """(C, 6 + 2 (N+1)) derivative, as `Placed.gradient`."""
        used, place = np.unique(self.rows, return_inverse=True)
        each = table_rows(placed, used).reshape(len(used), 3, -1)
        far = np.zeros((len(self), len(used), 3))
        np.add.at(far, (np.arange(len(self))[:, None], place.reshape(self.rows.shape)), self.pushes)
        return -np.tensordot(far, each, axes=2) / self.unit

    def add_forces(self, multipliers: FloatArray, gradient: FloatArray) -> None:
        """Add the derivative of multipliers (C,) . G by the table (4 (N+1), 3)."""
        np.add.at(gradient, self.rows, -multipliers[:, None, None] / self.unit * self.pushes)
