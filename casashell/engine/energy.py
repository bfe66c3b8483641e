"""One additive term of the potential energy, as the machine sees it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import casadi as ca
import numpy as np

from casashell.typing import AnyArray, FloatArray, IntArray

Reference: TypeAlias = Callable[[AnyArray, AnyArray], Callable[[AnyArray], AnyArray]]


@dataclass(frozen=True, eq=False)
class MetricForm:
    """A term that reads natural lengths, angles and areas where `Energy` reads natural positions.

    reads      the natural numbers n of a stencil by its own vertices: two are a length [m], three an
               area [m2], four the angle of a hinge [rad].  The first is what the strain measure of
               the term is compared with
    density    SX function (y, n, p) -> scalar [J]; y is the strain measure of a term that has one,
               its positions (3,k) otherwise
    reference  the same energy in plain NumPy: n (m,S), p -> function of x (k,3,S) -> (S,), as for
               `Energy`
    in_motion  as for `Energy`, of positions x (3,k), n and p
    """

    reads: tuple[tuple[int, ...], ...]
    density: ca.Function
    reference: Reference
    in_motion: ca.Function | None = None


@dataclass(frozen=True, eq=False)
class Energy:
    """``E(x, r) = sum_s e(x[s], r[s], p[s])`` over stencils of ``k`` mesh vertices.

    name       key of the term in every report
    density    SX function (3,k), (3,k), (m,) -> scalar [J]; knows no mesh
    stencils   (S,k) vertex ids, in the order ``density`` documents
    params     (S,m) SI units
    load       True for external loads; these are what the load path scales
    measure    SX function (3,k) -> scalar strain measure q, for terms of the form e(q(x), q(r), r)
    reference  the same energy in plain NumPy: r (k,3,S), p (m,S) -> function of x (k,3,S) -> (S,)
               that allows complex x; certificates differentiate it by complex step
    material   arrays the term writes about itself into result files
    metric     the same energy with natural lengths, angles and areas; needed for a natural metric
    in_motion  density that simulations take instead: the same, but smooth where a motion may crush
               stencils; None where ``density`` already is
    """

    name: str
    density: ca.Function
    stencils: IntArray
    params: FloatArray
    load: bool = False
    measure: ca.Function | None = None
    reference: Reference | None = None
    material: Mapping[str, AnyArray] = field(default_factory=dict)
    metric: MetricForm | None = None
    in_motion: ca.Function | None = None

    def __post_init__(self) -> None:
        stencils = np.ascontiguousarray(self.stencils, dtype=np.int64)
        params = np.ascontiguousarray(self.params, dtype=np.float64)
        k, m = self._density_shape()
        if stencils.ndim != 2 or stencils.shape[1] != k:
            raise ValueError(
                f"energy '{self.name}': stencils must be (S, {k}) to suit its density, "
                f"got {stencils.shape}"
            )
        if params.shape != (len(stencils), m):
            raise ValueError(
                f"energy '{self.name}': params must be ({len(stencils)}, {m}), got {params.shape}"
            )
        if not np.all(np.isfinite(params)):
            bad = int(np.flatnonzero(~np.isfinite(params).all(axis=1))[0])
            raise ValueError(f"energy '{self.name}': params of element {bad} are not finite")
        object.__setattr__(self, "stencils", stencils)
        object.__setattr__(self, "params", params)

    def _density_shape(self) -> tuple[int, int]:
        f = self.density
        if f.n_in() != 3 or f.n_out() != 1 or f.size_out(0) != (1, 1):
            raise ValueError(
                f"energy '{self.name}': density must map (x, r, p) to one number, got {f}"
            )
        if f.size1_in(0) != 3 or f.size_in(0) != f.size_in(1) or not f.is_a("SXFunction"):
            raise ValueError(
                f"energy '{self.name}': density must be an SX function of x (3,k) and r (3,k), "
                f"got {f}"
            )
        return int(f.size2_in(0)), int(f.numel_in(2))

    @property
    def size(self) -> int:
        """Number of vertices of one stencil."""
        return int(self.stencils.shape[1])

    def require_vertices(self, count: int) -> None:
        """Raise ValueError when a stencil refers to a vertex outside 0 .. count - 1."""
        wrong = self.stencils[(self.stencils < 0) | (self.stencils >= count)]
        if wrong.size:
            raise ValueError(
                f"energy '{self.name}' refers to vertex {int(wrong[np.argmax(np.abs(wrong))])}, "
                f"the target has {count}: was it built for another mesh?"
            )

    def restricted(self, keep: AnyArray, renumber: IntArray) -> Energy:
        """The term on the stencils ``keep`` (mask or ids), with vertices renumbered."""
        return replace(
            self, stencils=renumber[self.stencils[keep]], params=self.params[keep], material={}
        )

    def without_idle(self) -> Energy:
        """The term without stencils whose parameters are all zero: they cost time and add nothing."""
        active = np.any(self.params != 0.0, axis=1)
        if np.all(active):
            return self
        return replace(self, stencils=self.stencils[active], params=self.params[active])
