"""The potential energy with a pull towards the target (Ly 2018, Eq. 24)."""

from __future__ import annotations

import math

import numpy as np

from casashell.inverse.piece import Piece
from casashell.typing import FloatArray, IntArray


class Pulled:
    """``E(x, r) + pull/2 |x - x_t|^2`` for one piece.

    A pull keeps poses near the target and adds ``pull`` [N/m] to every eigenvalue of the Hessian; a
    minimum of E at x_t stays one whatever the pull.  Positions are (n,3) m in the numbering of the
    piece; matrix entries belong to ``piece.assembly.pattern``.
    Raises ValueError for a pull that is negative or not finite.
    """

    def __init__(self, piece: Piece, pull: float) -> None:
        if not (math.isfinite(pull) and pull >= 0.0):
            raise ValueError(f"pull must be a stiffness >= 0 N/m, got {pull}")
        self.piece = piece
        self.pull = float(pull)
        pattern = piece.assembly.pattern
        self._diagonal: IntArray = np.flatnonzero(pattern.rows == pattern.indices)

    def energy(self, x: FloatArray, r: FloatArray) -> float:
        """Energy [J]."""
        away = x - self.piece.target
        return self.piece.assembly.energy(x, r) + 0.5 * self.pull * float(np.vdot(away, away))

    def gradient(self, x: FloatArray, r: FloatArray) -> FloatArray:
        """Derivative by x (n,3) [N]."""
        return self.piece.assembly.gradient(x, r) + self.pull * (x - self.piece.target)

    def hessian(self, x: FloatArray, r: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivative by x (n,3) [N] and the entries of the second one [N/m]."""
        gradient, entries = self.piece.assembly.hessian(x, r)
        if self.pull > 0.0:
            entries[self._diagonal] += self.pull
        return gradient + self.pull * (x - self.piece.target), entries

    def mixed(self, x: FloatArray, r: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivative by x (n,3) [N] and the entries of the one by x and r [N/m]."""
        gradient, entries = self.piece.assembly.mixed(x, r)
        return gradient + self.pull * (x - self.piece.target), entries
