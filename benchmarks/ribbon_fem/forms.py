"""Quadratic forms of nodes: what keeps lengths, exactly or stiffly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from casashell.typing import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Forms:
    """C_p = 1/2 sum_ij Q_pij x_i . x_j - c_p over the nodes of each form; C = 0 on the flat sheet.

    nodes       (P,k) nodes of each form
    weights     (P,k,k) Q, symmetric
    compliance  (P,) s >= 0: the form costs C^2 / (2 s) [J], and must vanish where s is 0.  Its tension
                is C / s, or what keeps it zero
    """

    nodes: IntArray
    weights: FloatArray
    compliance: FloatArray
    target: FloatArray

    @staticmethod
    def on(rest: FloatArray, nodes: IntArray, weights: FloatArray, compliance: FloatArray) -> Forms:
        """Forms that vanish at ``rest`` (n,3)."""
        flat = Forms(nodes, weights, compliance, np.zeros(len(nodes)))
        return Forms(nodes, weights, compliance, flat.values(rest))

    @staticmethod
    def links(rest: FloatArray, pairs: IntArray) -> Forms:
        """C = (|d|^2 - l^2) / (2 l) [m]: pairs (P,2) of nodes keep their distance l."""
        length = np.linalg.norm(rest[pairs[:, 1]] - rest[pairs[:, 0]], axis=1)
        weights = np.array([[1.0, -1.0], [-1.0, 1.0]]) / length[:, None, None]
        return Forms.on(rest, pairs, weights, np.zeros(len(pairs)))

    def __len__(self) -> int:
        return len(self.nodes)

    def slopes(self, x: FloatArray) -> FloatArray:
        """(P,k,3) derivatives of C by the nodes of a form."""
        return np.asarray(self.weights @ x[self.nodes])

    def values(self, x: FloatArray) -> FloatArray:
        """(P,) C."""
        half = 0.5 * np.einsum("pka,pka->p", self.slopes(x), x[self.nodes])
        return np.asarray(half - self.target)

    def energy(self, x: FloatArray) -> float:
        """What the compliant forms cost [J]."""
        soft = self.compliance > 0
        return float((0.5 * self.values(x)[soft] ** 2 / self.compliance[soft]).sum())
