"""A natural metric of one piece as strains of its terms, and what forces and stiffness it gives.

Every term with a strain measure q is e(q, n, p): its strain force tau = de/dq and its own natural number
n_0 (the rest length of an edge, the rest angle of a hinge) determine each other.  The other natural
numbers it reads (the areas in the stiffness of a hinge) follow from the rest lengths.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property

import casadi as ca
import numpy as np
import scipy.sparse as sp

from casashell.engine.energy import Energy, MetricForm
from casashell.inverse.piece import Piece
from casashell.inverse.stress import StressProgram
from casashell.mesh import TriMesh
from casashell.metric import Metric, MetricIndex, heron, require_forms
from casashell.typing import FloatArray, IntArray

_INVERSION_STEPS = 60


@cache
def _slopes_of(density: str) -> ca.Function:
    """(q, n, p) -> tau, dtau/dq, dtau/dn_0, d2tau/dq dn_0 of a term with a strain measure."""
    form = ca.Function.deserialize(density)
    q, n, p = ca.SX.sym("q"), ca.SX.sym("n", form.numel_in(1)), ca.SX.sym("p", form.numel_in(2))
    tau = ca.gradient(form(q, n, p), q)
    c = ca.gradient(tau, q)
    return ca.Function(
        "strain_force", [q, n, p], [tau, c, ca.jacobian(tau, n)[0], ca.jacobian(c, n)[0]]
    )


@cache
def _loads_of(density: str) -> ca.Function:
    """(x, n, p) -> dE/dx (3k,), d2E/dx dn (3k,m), d2E/dx2 of a term without a strain measure."""
    form = ca.Function.deserialize(density)
    x = ca.SX.sym("x", 3, form.size2_in(0))
    n, p = ca.SX.sym("n", form.numel_in(1)), ca.SX.sym("p", form.numel_in(2))
    g = ca.vec(ca.gradient(form(x, n, p), x))
    parts = [g, ca.jacobian(g, n), ca.jacobian(g, x)]
    return ca.Function("metric_load", [x, n, p], [ca.vec(ca.densify(part)) for part in parts])


@dataclass(frozen=True, eq=False)
class Strained:
    """Strain forces of all elements of a piece at one metric, one entry an element.

    tau    strain force de/dq;  c  dtau/dq
    reply  dn_0/dtau;  stiffening  dc/dtau, both with the other natural numbers held
    """

    tau: FloatArray
    c: FloatArray
    reply: FloatArray
    stiffening: FloatArray


class MetricState:
    """The terms of one piece in metric form; metrics are those of the whole mesh.

    Raises ValueError for a term without metric form, and for two terms on the same natural number.
    """

    def __init__(self, piece: Piece, mesh: TriMesh) -> None:
        require_forms(piece.energies)
        self.piece, self.index = piece, MetricIndex(mesh)
        self.program = StressProgram(piece)
        self.terms = self.program.terms
        strained = {term.name for term in self.terms}
        self.loads = [
            term.without_idle()
            for term in piece.energies
            if term.name not in strained and np.any(term.params != 0.0)
        ]
        self.own = [
            self.index.locate(_form(term).reads[0], self._whole(term)) for term in self.terms
        ]
        self.kinds = [len(_form(term).reads[0]) for term in self.terms]
        for kind in set(self.kinds):
            of_kind = [at for at, k in zip(self.own, self.kinds, strict=True) if k == kind]
            joined = np.concatenate(of_kind)
            if len(np.unique(joined)) < len(joined):
                raise ValueError(
                    "two energies share a natural length or angle: no metric is defined"
                )
        self.ends = np.cumsum([0, *(len(term.stencils) for term in self.terms)])
        self.measures = [self._measures(term) for term in self.terms]
        self.start = Metric.of(mesh, mesh.vertices)

    @property
    def size(self) -> int:
        """Number of elements with a strain."""
        return int(self.ends[-1])

    def _whole(self, term: Energy) -> IntArray:
        """Stencils by the vertices of the whole mesh."""
        return np.asarray(self.piece.vertices[term.stencils])

    def _measures(self, term: Energy) -> FloatArray:
        if term.measure is None:
            raise ValueError(f"energy '{term.name}' has no strain measure")
        columns = self.piece.target[term.stencils].reshape(-1, 3).T
        return np.asarray(term.measure.map(len(term.stencils))(columns)).ravel()

    def _slopes(self, term: int, numbers: FloatArray) -> tuple[FloatArray, ...]:
        function = _slopes_of(_form(self.terms[term]).density.serialize())
        made = function(self.measures[term][None, :], numbers.T, self.terms[term].params.T)
        return tuple(np.asarray(part).ravel() for part in made)

    def strained(self, metric: Metric) -> Strained:
        """Strain forces and their slopes at a metric."""
        parts = []
        for at, term in enumerate(self.terms):
            numbers = self.index.numbers(_form(term), self._whole(term), metric)
            tau, c, tau_n, c_n = self._slopes(at, numbers)
            parts.append((tau, c, 1.0 / tau_n, c_n / tau_n))
        return Strained(*(np.concatenate(column) for column in zip(*parts, strict=True)))

    def natural_numbers(self, metric: Metric) -> list[FloatArray]:
        """The natural number that each element is measured against, per term."""
        values = {2: metric.rest_length, 3: metric.rest_area, 4: metric.rest_angle}
        return [values[kind][own] for kind, own in zip(self.kinds, self.own, strict=True)]

    def realised(self, metric: Metric, tau: FloatArray) -> Metric:
        """The metric with the strain forces ``tau`` (T,), found from ``metric``."""
        lengths, angles = metric.rest_length.copy(), metric.rest_angle.copy()
        made = metric
        for kind, values in ((2, lengths), (4, angles)):  # angles need the areas
            for at, term in enumerate(self.terms):
                if self.kinds[at] == kind:
                    numbers = self.index.numbers(_form(term), self._whole(term), made)
                    wanted = tau[self.ends[at] : self.ends[at + 1]]
                    values[self.own[at]] = self._inverted(at, numbers, wanted)
            areas = heron(lengths[self.index.sides])
            made = replace(made, rest_length=lengths, rest_angle=angles, rest_area=areas)
        return replace(made, embedded=False)

    def _inverted(self, at: int, numbers: FloatArray, wanted: FloatArray) -> FloatArray:
        """Natural numbers n_0 that give the strain forces ``wanted``.

        Newton, on the logarithm of a length: a tension k (q / n_0 - 1) is convex in it.
        """
        trial, positive = numbers.copy(), self.kinds[at] == 2
        trial[:, 0] = self.measures[at]
        for _ in range(_INVERSION_STEPS):
            tau, _, slope, _ = self._slopes(at, trial)
            step = (wanted - tau) / slope
            old = trial[:, 0].copy()
            trial[:, 0] = old * np.exp(np.clip(step / old, -2.0, 2.0)) if positive else old + step
            if np.all(np.abs(step) <= 1e-13 * (np.abs(old) + (0.0 if positive else 1.0))):
                break
        return np.asarray(trial[:, 0])

    def length_bounds(self, factor: float) -> tuple[FloatArray, FloatArray]:
        """Strain forces (T,) at natural lengths ``factor`` longer and shorter than the lengths.

        Not finite for elements whose natural number is no length.
        """
        low, high = np.full(self.size, -np.inf), np.full(self.size, np.inf)
        for at, (begin, end, kind) in enumerate(self._ranges()):
            if kind == 2:
                numbers = self.index.numbers(
                    _form(self.terms[at]), self._whole(self.terms[at]), self.start
                )
                longer, shorter = numbers.copy(), numbers.copy()
                longer[:, 0] *= factor
                shorter[:, 0] /= factor
                low[begin:end] = self._slopes(at, longer)[0]
                high[begin:end] = self._slopes(at, shorter)[0]
        return low, high

    def load(self, metric: Metric, replies: FloatArray) -> tuple[FloatArray, sp.csr_array]:
        """dE/dx (3n,) of the terms without strain, and its slope (3n,T) by the strain forces.

        replies  (T,) dn_0/dtau
        """
        count = self.piece.target.size
        total, slope = np.zeros(count), sp.csr_array((count, len(metric.rest_length)))
        for term in self.loads:
            rows = (3 * term.stencils[:, :, None] + np.arange(3)).reshape(len(term.stencils), -1)
            force, by_number, _ = self._load_parts(term, metric)
            np.add.at(total, rows, force)
            whole = self._whole(term)
            for number, read in enumerate(_form(term).reads):
                edges, weights = self._by_length(read, whole, metric)
                change = by_number[:, number, :, None] * weights[:, None, :]
                at = np.broadcast_to(rows[:, :, None], change.shape)
                column = np.broadcast_to(edges[:, None, :], change.shape)
                slope = slope + sp.csr_array(
                    (change.ravel(), (at.ravel(), column.ravel())), shape=slope.shape
                )
        return total, sp.csr_array(slope @ self._lengths_by_tau(replies, len(metric.rest_length)))

    def _load_parts(self, term: Energy, metric: Metric) -> tuple[FloatArray, ...]:
        """dE/dx (S,3k), its slope (S,m,3k) by the natural numbers and d2E/dx2 (S,3k,3k)."""
        form, count = _form(term), len(term.stencils)
        numbers = self.index.numbers(form, self._whole(term), metric)
        points = self.piece.target[term.stencils].reshape(-1, 3).T
        function = _loads_of(form.density.serialize()).map(count)
        made = [np.asarray(part).T for part in function(points, numbers.T, term.params.T)]
        size = 3 * term.size
        return made[0], made[1].reshape(count, -1, size), made[2].reshape(count, size, size)

    def _by_length(
        self, read: tuple[int, ...], stencils: IntArray, metric: Metric
    ) -> tuple[IntArray, FloatArray]:
        """Edges (S,a) that a natural number depends on, and its slopes (S,a) by their lengths."""
        at = self.index.locate(read, stencils)
        if len(read) == 2:
            return at[:, None], np.ones((len(at), 1))
        if len(read) == 4:
            raise ValueError("an energy without a strain measure may not read natural angles")
        edges = self.index.sides[at]
        return edges, area_slopes(metric.rest_length[edges])

    def _lengths_by_tau(self, replies: FloatArray, count: int) -> sp.csr_array:
        """Slope (E,T) of the rest lengths by the strain forces."""
        column = np.concatenate(
            [np.arange(a, b) for a, b, k in self._ranges() if k == 2] or [np.empty(0, np.int64)]
        )
        row = np.concatenate(
            [own for own, k in zip(self.own, self.kinds, strict=True) if k == 2]
            or [np.empty(0, np.int64)]
        )
        return sp.csr_array((replies[column], (row, column)), shape=(count, self.size))

    def _ranges(self) -> list[tuple[int, int, int]]:
        return list(zip(self.ends[:-1].tolist(), self.ends[1:].tolist(), self.kinds, strict=True))

    def side_slopes(self, replies: FloatArray, faces: IntArray) -> sp.csr_array:
        """Slope (3 F',T) of the rest lengths of the sides of ``faces`` (F',) by the strain forces."""
        by_tau = self._lengths_by_tau(replies, len(self.index.mesh.edges))
        return sp.csr_array(by_tau[self.index.sides[faces].ravel()])

    @cached_property
    def curvatures(self) -> list[tuple[FloatArray, FloatArray]]:
        """dq/dx (S,3k) and d2q/dx2 (S,3k,3k) of every term."""
        return [self.program.measured(term) for term in self.terms]

    def constant_stiffness(self, metric: Metric) -> sp.csr_array:
        """d2E/dx2 (3n,3n) of the terms without strain."""
        count = self.piece.target.size
        total = sp.csr_array((count, count))
        for term in self.loads:
            block = self._load_parts(term, metric)[2]
            rows, columns = block_entries(term)
            entries = (block.ravel(), (rows.ravel(), columns.ravel()))
            total = total + sp.csr_array(sp.coo_array(entries, shape=(count, count)).tocsr())
        return sp.csr_array(total)


def block_entries(term: Energy) -> tuple[IntArray, IntArray]:
    """Rows and columns (S,3k,3k) of the blocks of the stencils in a matrix over all coordinates."""
    rows = (3 * term.stencils[:, :, None] + np.arange(3)).reshape(len(term.stencils), -1)
    shape = (*rows.shape, rows.shape[1])
    return np.broadcast_to(rows[:, :, None], shape), np.broadcast_to(rows[:, None, :], shape)


def _form(term: Energy) -> MetricForm:
    if term.metric is None:
        raise ValueError(f"energy '{term.name}' has no metric form")
    return term.metric


def area_slopes(sides: FloatArray) -> FloatArray:
    """Slopes (F,3) of Heron's area by the sides (F,3); large for a needle."""
    squares = sides**2
    area = np.maximum(heron(sides), 1e-3 * squares.max(axis=1))
    opposite = squares.sum(axis=1, keepdims=True) - 2.0 * squares
    return np.asarray(sides * opposite / (8.0 * area[:, None]))
