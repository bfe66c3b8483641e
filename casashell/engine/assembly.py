"""From stencil blocks to global vectors and sparse matrices of one fixed pattern."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from casashell.engine.energy import Energy
from casashell.engine.kernels import KERNELS, Kernel, get_kernel
from casashell.engine.recent import Recent, digest, frozen
from casashell.typing import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Pattern:
    """CSR pattern of a (3V, 3V) matrix whose 3x3 blocks couple vertices that share a stencil.

    key  the same for the same topology; patterns of one key have the same arrays
    """

    size: int
    indptr: IntArray
    indices: IntArray
    key: bytes

    @property
    def nnz(self) -> int:
        """Number of stored entries."""
        return len(self.indices)

    def matrix(self, data: FloatArray) -> sp.csr_array:
        """Sparse matrix with these entries; shares the index arrays."""
        return sp.csr_array((data, self.indices, self.indptr), shape=(self.size, self.size))

    @cached_property
    def rows(self) -> IntArray:
        """Row of every stored entry."""
        return frozen(np.repeat(np.arange(self.size), np.diff(self.indptr)))


@dataclass(frozen=True, eq=False)
class _Layout:
    """Pattern of a topology, and for each term (S, 9 k k) the places of its blocks in it."""

    pattern: Pattern
    places: tuple[IntArray, ...]

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays, the rows of the pattern with them."""
        pattern = 2 * self.pattern.indices.nbytes + self.pattern.indptr.nbytes
        return pattern + sum(place.nbytes for place in self.places)


#: Layouts of the last topologies: another material or another load makes none.
_LAYOUTS: Recent[_Layout] = Recent()


def forget_layouts() -> None:
    """Give back the memory of the layouts kept."""
    _LAYOUTS.clear()


def _lay_out(stencils: Sequence[IntArray], count: int, key: bytes) -> _Layout:
    """Layout of terms with these stencils (S,k) on ``count`` vertices."""
    keys = [np.arange(count, dtype=np.int64) * (count + 1)]
    keys += [np.unique((s[:, :, None] * count + s[:, None, :]).ravel()) for s in stencils]
    pairs = np.unique(np.concatenate(keys))
    row, column = np.divmod(pairs, count)
    degree = np.bincount(row, minlength=count)
    start = np.concatenate([[0], np.cumsum(degree)])
    indptr = np.concatenate([[0], np.cumsum(np.repeat(3 * degree, 3))])
    # Scalar entry (3 row + a, 3 column + b) of pair q sits at indptr[3 row + a] + 3 (rank) + b.
    rank = np.arange(len(pairs)) - start[row]
    offset = np.arange(3)
    indices = np.empty(9 * len(pairs), dtype=np.int64)
    for a in range(3):
        for b in range(3):
            indices[indptr[3 * row + a] + 3 * rank + b] = 3 * column + b
    places = []
    for s in stencils:
        pair = np.searchsorted(pairs, s[:, :, None] * count + s[:, None, :])
        begin = indptr[3 * s[:, :, None] + offset]  # (S, k, 3)
        target = (
            begin[:, :, :, None, None]
            + 3 * (pair - start[s][:, :, None])[:, :, None, :, None]
            + offset[None, None, None, None, :]
        )
        places.append(frozen(np.ascontiguousarray(target.reshape(len(s), 9 * s.shape[1] ** 2))))
    return _Layout(Pattern(3 * count, frozen(indptr), frozen(indices), key), tuple(places))


class Assembly:
    """Energy, gradient and sparse second derivatives of a sum of terms on ``count`` vertices.

    The pattern and the scatter maps are made once a topology, also for the next assembly of the same
    one; every call is kernels plus one summation a term.
    ``load`` scales the terms marked as external loads.
    """

    def __init__(
        self, energies: Sequence[Energy], count: int, *, interpreted: bool = False
    ) -> None:
        self.energies = tuple(
            e for e in (term.without_idle() for term in energies) if len(e.stencils)
        )
        self.count = count
        self.interpreted = interpreted
        self._number = {id(term): number for number, term in enumerate(self.energies)}
        self._kernels: dict[tuple[int, str], Kernel] = {}
        for term in self.energies:
            term.require_vertices(count)

    def _kernel(self, term: Energy, name: str) -> Kernel:
        key = id(term), name
        if key not in self._kernels:
            self._kernels[key] = get_kernel(term.density, name, interpreted=self.interpreted)
        return self._kernels[key]

    @property
    def compiled(self) -> bool:
        """True when the kernels run as compiled C."""
        return all(self._kernel(term, "gradient").compiled for term in self.energies)

    @cached_property
    def _layout(self) -> _Layout:
        stencils = tuple(term.stencils for term in self.energies)
        key = digest(self.count, *stencils)
        return _LAYOUTS.get(
            key, lambda: _lay_out(stencils, self.count, key), lambda made: made.nbytes
        )

    @property
    def pattern(self) -> Pattern:
        """Union of the vertex pairs of all terms, and every vertex with itself."""
        return self._layout.pattern

    def scatter_map(self, term: Energy) -> IntArray:
        """Where each entry of the row-major (3k, 3k) blocks of ``term`` goes in the pattern."""
        return self._layout.places[self._number[id(term)]]

    def _total(
        self,
        name: str,
        x: FloatArray,
        r: FloatArray,
        load: float,
        totals: tuple[FloatArray, ...],
        w: FloatArray | None = None,
        terms: Sequence[Energy] | None = None,
    ) -> None:
        """Add the outputs of kernel ``name``, summed over all stencils, to ``totals``."""
        for term in self.energies if terms is None else terms:
            scale = load if term.load else 1.0
            kernel = self._kernel(term, name)
            square = max(kernel.shape.outputs) == 9 * term.size**2
            places = self.scatter_map(term) if square else None
            rows = x if w is None else w
            kernel.add(x, r, term.params, term.stencils, rows, scale, places, totals)

    def energy(self, x: FloatArray, r: FloatArray, load: float = 1.0) -> float:
        """Total energy [J] at pose x and natural shape r, both (V,3)."""
        x, r = _positions(x, self.count), _positions(r, self.count)
        total = 0.0
        for term in self.energies:
            parts = self._kernel(term, "energy")(x, r, term.params, term.stencils, x)[0]
            # Line searches live on small differences: NumPy sums pairwise.
            total += (load if term.load else 1.0) * float(parts.sum())
        return total

    def gradient(self, x: FloatArray, r: FloatArray, load: float = 1.0) -> FloatArray:
        """dE/dx (V,3) [N]."""
        x, r = _positions(x, self.count), _positions(r, self.count)
        total = np.zeros((self.count, 3))
        self._total("gradient", x, r, load, (total.reshape(-1),))
        return total

    def nodal_loads(self, r: FloatArray) -> FloatArray:
        """Force of the external loads on every vertex (V,3) [N], at x = r (-dE_load/dx)."""
        r = _positions(r, self.count)
        total = np.zeros((self.count, 3))
        loads = [term for term in self.energies if term.load]
        self._total("gradient", r, r, 1.0, (total.reshape(-1),), terms=loads)
        return -total

    def _second(
        self, name: str, x: FloatArray, r: FloatArray, load: float, w: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        x, r = _positions(x, self.count), _positions(r, self.count)
        force = np.zeros((self.count, 3))
        data = np.zeros(self.pattern.nnz)
        totals = (force.reshape(-1), data) if len(KERNELS[name]) == 2 else (data,)
        self._total(name, x, r, load, totals, w)
        return force, data

    def hessian(
        self, x: FloatArray, r: FloatArray, load: float = 1.0
    ) -> tuple[FloatArray, FloatArray]:
        """dE/dx (V,3) and the entries of d2E/dx2 [N/m] in ``pattern``."""
        return self._second("hessian", x, r, load)

    def mixed(
        self, x: FloatArray, r: FloatArray, load: float = 1.0
    ) -> tuple[FloatArray, FloatArray]:
        """dE/dx (V,3) and the entries of d2E/dx dr [N/m] in ``pattern``."""
        return self._second("mixed", x, r, load)

    def lagrangian(
        self, x: FloatArray, r: FloatArray, w: FloatArray, load: float = 1.0
    ) -> FloatArray:
        """Entries of d2(w . dE/dx)/dr2 in ``pattern``, for multipliers w (V,3)."""
        return self._second("lagrangian", x, r, load, _positions(w, self.count))[1]

    def lagrangian_mixed(
        self, x: FloatArray, r: FloatArray, w: FloatArray, load: float = 1.0
    ) -> FloatArray:
        """Entries of d2(w . dE/dx)/dr dx in ``pattern``, rows by r and columns by x."""
        return self._second("lagrangian_mixed", x, r, load, _positions(w, self.count))[1]

    def lagrangian_pose(
        self, x: FloatArray, r: FloatArray, w: FloatArray, load: float = 1.0
    ) -> FloatArray:
        """Entries of d2(w . dE/dx)/dx2 in ``pattern``: with w = v, times v, the slope of v.Hv."""
        return self._second("lagrangian_pose", x, r, load, _positions(w, self.count))[1]


def _positions(x: FloatArray, count: int) -> FloatArray:
    """``x`` as contiguous (count, 3) doubles, which is what the kernels read."""
    x = np.ascontiguousarray(x, dtype=np.float64)
    if x.shape != (count, 3):
        raise ValueError(f"positions must have shape ({count}, 3), got {x.shape}")
    return x
